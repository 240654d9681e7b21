"""Kernels as numba compiles and calls them by itself, nearly by what it documents alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.extending import overload

from gcs_bridge.jit.declared import ArrayOf, Declared, TupleOf
from gcs_bridge.jit.recipe import StandIns

# Without the GIL; division by zero is as in numpy; no array is made, so no references to any are counted, which would
# take more time than all the rest.
OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
_known: set[FunctionType] = set()


def make_known(stand_ins: StandIns, **options: Any) -> None:
    """Tell numba what it is to compile where a kernel calls one of these functions."""
    for function, (instead, is_inlined) in stand_ins.items():
        if function not in _known:
            _known.add(function)
            options_of = {**OPTIONS, **options, "forceinline": is_inlined}
            overload(function, jit_options=options_of, strict=False)(lambda *_, _instead=instead: _instead)


@contextmanager
def counted_from_the_front() -> Iterator[None]:
    """Meanwhile an index is compiled as what it says: none but a number in the code counts from an array's end.

    numba asks at each access whether it does, which takes a tenth of a kernel's time. Where it is not as it is known
    here, it goes on asking.
    """
    try:
        from numba.np import arrayobj

        as_usual = arrayobj.fix_integer_index
    except (ImportError, AttributeError):
        yield
        return

    def of_the_front(context: Any, builder: Any, index_type: Any, index: Any, size: Any) -> Any:
        at = context.cast(builder, index, index_type, numba.types.intp)
        if isinstance(at, ir.Constant) or not index_type.signed:
            return as_usual(context, builder, index_type, index, size)
        return at

    arrayobj.fix_integer_index = of_the_front
    try:
        yield
    finally:
        arrayobj.fix_integer_index = as_usual


def numba_type(declared: Declared) -> Any:
    """As numba names it."""
    if isinstance(declared, ArrayOf):
        return numba.typeof(np.empty((0,) * declared.ndim, declared.dtype))
    if isinstance(declared, TupleOf):
        fields = [numba_type(field) for field in declared.fields]
        return numba.types.BaseTuple.from_types(fields, declared.of)
    return {int: numba.types.int64, float: numba.types.float64, bool: numba.types.boolean}[declared.of]


def dispatcher(function: FunctionType, declared: tuple[Declared, ...], stand_ins: StandIns) -> Callable[..., Any]:
    """The kernel as numba calls it, as its variables say, NUMBA_BOUNDSCHECK among them; for other types too.

    It is compiled anew in each process: numba's own cache knows nothing of the functions that a kernel calls.
    """
    make_known(stand_ins)
    compiled: Any = numba.njit(**OPTIONS)(function)
    if hasattr(compiled, "compile"):  # else NUMBA_DISABLE_JIT has left it as it was
        with counted_from_the_front():
            compiled.compile(tuple(map(numba_type, declared)))
    return compiled  # type: ignore[no-any-return]  # untyped in numba
