"""Where Python enters a kernel: a function, written in LLVM's language, that opens the arguments and calls the kernel.

It is what CPython knows as METH_FASTCALL. Each argument is held against its declared type: of an array its dimensions,
its layout and the kind and size of its items, which are read where numpy keeps them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils

from gcs_bridge.jit.declared import ArrayOf, Declared, TupleOf, text_of
from gcs_bridge.jit.native import symbol_of

_BYTE, _INT, _INT64, _FLOAT = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.DoubleType()
_POINTER, _NOTHING = _BYTE.as_pointer(), ir.VoidType()
_NULL = ir.Constant(_POINTER, None)
# Where CPython and numpy keep what is read here, by numpy's ndarraytypes.h; `layout_is_known` tries it.
_HEAD = object.__basicsize__
_TYPE = _HEAD - 8
_DATA, _NDIM, _SHAPE, _STRIDES, _DTYPE, _FLAGS = (_HEAD + offset for offset in (0, 8, 16, 24, 40, 48))
_KIND, _BYTE_ORDER = _HEAD + 8, _HEAD + 10  # of a dtype
_ITEM_SIZE = _HEAD + (24 if int(np.__version__.partition(".")[0]) >= 2 else 16)
_NEEDED = 0x0001 | 0x0100 | 0x0400  # of an array's flags: C-contiguous, aligned, writeable


def layout_is_known() -> bool:
    """Whether arrays of this numpy, in this CPython, are laid out as is written above."""

    def at(thing: object, offset: int, kind: Any) -> Any:
        return kind.from_address(id(thing) + offset).value

    array = np.zeros((3, 5), np.dtype([("a", "<i4"), ("b", "<i8")]))
    pointer, dtype = ctypes.c_void_p, array.dtype
    shape, strides = at(array, _SHAPE, pointer), at(array, _STRIDES, pointer)
    return (
        [at(array, _TYPE, pointer), at(array, _DATA, pointer)] == [id(np.ndarray), array.ctypes.data]
        and [at(array, _NDIM, ctypes.c_int), at(array, _DTYPE, pointer)] == [2, id(dtype)]
        and at(array, _FLAGS, ctypes.c_int) & _NEEDED == array.flags.num & _NEEDED == _NEEDED
        and list((ctypes.c_int64 * 2).from_address(shape)) == [3, 5]
        and list((ctypes.c_int64 * 2).from_address(strides)) == [60, 12]
        and [at(dtype, _KIND, ctypes.c_char), at(dtype, _ITEM_SIZE, ctypes.c_int)] == [b"V", 12]
        and at(np.dtype(">i8"), _BYTE_ORDER, ctypes.c_char) == b">"
    )


class Entry:
    """Writes the entry to one kernel."""

    def __init__(self, target: Any, library: Any, kernel: Any, symbol: str) -> None:
        """Begin with numba's target context, the library that the kernel is in, and its descriptor."""
        self._target, self._library, self._kernel = target, library, kernel
        self._module = library.create_ir_module(symbol)
        takes = ir.FunctionType(_POINTER, [_POINTER, _POINTER.as_pointer(), _INT64])
        self._function = ir.Function(self._module, takes, name=symbol)
        self._to = ir.IRBuilder(self._function.append_basic_block("entry"))

    def add(self, declared: Sequence[Declared]) -> None:
        """Write it for arguments of these types, and put it into the library."""
        _, arguments, count = self._function.args
        name = self._kernel.qualname.rpartition(".")[2]
        wrong_count = self._refusal("TypeError", f"{name}() takes {len(declared)} arguments by their position")
        self._go_on_if(self._same(count, len(declared)), else_to=wrong_count)
        opened = []
        for place, (argument, kind) in enumerate(zip(self._kernel.args, declared, strict=True)):
            what = f"{name}(): {argument} is not what its annotation says: {text_of(kind)}"
            given = self._to.load(self._to.gep(arguments, [_INT64(place)]))
            opened.append(self._opened(given, kind, self._kernel.argtypes[place], self._refusal("TypeError", what)))
        self._go_on_if(self._same(self._call("PyErr_Occurred", _POINTER), _NULL), else_to=self._refusal())
        callee = self._target.declare_function(self._module, self._kernel)
        thread = self._call("PyEval_SaveThread", _POINTER)
        status, result = self._target.call_conv.call_function(
            self._to, callee, self._kernel.restype, self._kernel.argtypes, opened
        )
        self._call("PyEval_RestoreThread", _NOTHING, thread)
        failed = self._refusal("RuntimeError", f"{name}() has failed: NUMBA_BOUNDSCHECK=1 tells more")
        self._go_on_if(self._to.not_(status.is_error), else_to=failed)
        self._to.ret(self._closed(result, self._kernel.restype))
        self._library.add_ir_module(self._module)

    def _opened(self, given: Any, kind: Declared, known_as: Any, refusal: Any) -> Any:
        """A Python object as the value that numba's code takes."""
        if isinstance(kind, ArrayOf):
            return self._array(given, kind, known_as, refusal)
        if isinstance(kind, TupleOf):
            self._go_on_if(self._same(self._call("PyTuple_Size", _INT64, given), len(kind.fields)), else_to=refusal)
            return self._target.make_tuple(self._to, known_as, [
                self._opened(self._call("PyTuple_GetItem", _POINTER, given, _INT64(place)), field, of, refusal)
                for place, (field, of) in enumerate(zip(kind.fields, known_as, strict=True))
            ])  # fmt: skip
        if kind.of is float:
            return self._call("PyFloat_AsDouble", _FLOAT, given)
        if kind.of is bool:
            return self._to.icmp_signed("!=", self._call("PyObject_IsTrue", _INT, given), _INT(0))
        return self._call("PyLong_AsLongLong", _INT64, given)

    def _array(self, given: Any, kind: ArrayOf, known_as: Any, refusal: Any) -> Any:
        self._go_on_if(self._same(self._at(given, _TYPE, _POINTER), self._object("ndarray")), else_to=refusal)
        flags, dtype = self._at(given, _FLAGS, _INT), self._at(given, _DTYPE, _POINTER)
        foreign = ord(">" if np.little_endian else "<")
        for holds in (
            self._same(self._at(given, _NDIM, _INT), kind.ndim),
            self._same(self._to.and_(flags, _INT(_NEEDED)), _NEEDED),
            self._same(self._at(dtype, _KIND, _BYTE), ord(kind.dtype.kind)),
            self._same(self._at(dtype, _ITEM_SIZE, _INT), kind.dtype.itemsize),
            self._to.not_(self._same(self._at(dtype, _BYTE_ORDER, _BYTE), foreign)),
        ):
            self._go_on_if(holds, else_to=refusal)
        array = self._target.make_array(known_as)(self._target, self._to)
        shape, strides = (self._numbers(given, offset, kind.ndim) for offset in (_SHAPE, _STRIDES))
        items: Any = _INT64(1)
        for length in shape:
            items = self._to.mul(items, length)
        array.data = self._to.bitcast(self._at(given, _DATA, _POINTER), array.data.type)
        array.shape, array.strides = cgutils.pack_array(self._to, shape), cgutils.pack_array(self._to, strides)
        array.nitems, array.itemsize = items, _INT64(kind.dtype.itemsize)
        array.meminfo, array.parent = _NULL, ir.Constant(array.parent.type, None)  # nobody counts references
        return array._getvalue()

    def _numbers(self, given: Any, offset: int, count: int) -> list[Any]:
        first = self._at(given, offset, _INT64.as_pointer())
        return [self._to.load(self._to.gep(first, [_INT64(place)])) for place in range(count)]

    def _closed(self, value: Any, kind: Any) -> Any:
        """What numba's code returns as a Python object."""
        if isinstance(kind, types.BaseTuple):
            whole = self._call("PyTuple_New", _POINTER, _INT64(len(kind)))
            for place, of in enumerate(kind):
                part = self._closed(self._to.extract_value(value, place), of)
                self._call("PyTuple_SetItem", _INT, whole, _INT64(place), part)
            return whole
        if isinstance(kind, types.Boolean):
            return self._call("PyBool_FromLong", _POINTER, self._to.zext(value, _INT64))
        if isinstance(kind, types.Integer):
            return self._call("PyLong_FromLongLong", _POINTER, self._target.cast(self._to, value, kind, types.int64))
        if isinstance(kind, types.Float):
            return self._call("PyFloat_FromDouble", _POINTER, value)
        if isinstance(kind, types.NoneType):
            self._call("Py_IncRef", _NOTHING, self._object("None"))
            return self._object("None")
        raise TypeError(f"{self._kernel.qualname}: a kernel cannot return {kind}")

    def _go_on_if(self, holds: Any, *, else_to: Any) -> None:
        on = self._function.append_basic_block()
        self._to.cbranch(holds, on, else_to)
        self._to.position_at_end(on)

    def _refusal(self, error: str | None = None, message: str = "") -> Any:
        """A block that returns with an exception, by default with the one that is there."""
        block = self._function.append_basic_block()
        with self._to.goto_block(block):
            if error is not None:
                text = self._target.insert_const_string(self._module, message)
                self._call("PyErr_SetString", _NOTHING, self._object(error), text)
            self._to.ret(_NULL)
        return block

    def _call(self, name: str, returns: Any, *arguments: Any) -> Any:
        """A call of CPython's C API."""
        takes = ir.FunctionType(returns, [argument.type for argument in arguments])
        return self._to.call(cgutils.get_or_insert_function(self._module, takes, name), arguments)

    def _object(self, name: str) -> Any:
        known = self._module.globals.get(symbol_of(name))
        return known or ir.GlobalVariable(self._module, _BYTE, symbol_of(name))

    def _at(self, thing: Any, offset: int, kind: Any) -> Any:
        """What stands `offset` bytes behind a pointer."""
        return self._to.load(self._to.bitcast(self._to.gep(thing, [_INT64(offset)]), kind.as_pointer()))

    def _same(self, value: Any, other: Any) -> Any:
        return self._to.icmp_unsigned("==", value, other if isinstance(other, ir.Value) else value.type(other))
