"""A kernel becomes machine code: numba compiles it, and an entry of our own lets Python call it.

Numba's own way to call a function asks Python for the type of each argument, which takes longer than many a kernel, and
needs numba in every process that calls one. And it makes machine code of each helper, in case that Python calls it, and
optimises a helper anew for every function that it is linked into; here only whole kernels are. Where anything of numba,
numpy or CPython is not as it is known here, an `UnfamiliarError` is raised.
"""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import FunctionType
from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import CPUCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.registry import cpu_target
from numba.core.targetconfig import TargetConfig
from numba.core.types.functions import BaseFunction

from gcs_bridge.jit.by_numba import OPTIONS, counted_from_the_front, make_known, numba_type
from gcs_bridge.jit.declared import Declared
from gcs_bridge.jit.entry import Entry, layout_is_known
from gcs_bridge.jit.native import symbol_of
from gcs_bridge.jit.recipe import StandIns

_NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
# Of what helpers never have: expressions of whole arrays, functions within them, `with`, overloads that are inlined.
_NOT_NEEDED = {"nopython_rewrites", "inline_closure_likes", "with_lifting", "inline_overloads"}


_FUNCTIONS: Any = BaseFunction  # whose methods are not to be set, says mypy


class UnfamiliarError(Exception):
    """Something of numba, numpy or CPython is not as this package knows it."""


class _Library(CPUCodeLibrary):  # type: ignore[misc]  # untyped in numba
    """The code of a function in LLVM's language: to be linked into others, never to be run itself."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Nothing: optimised as a whole, a kernel takes as long to make, and runs faster."""
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        for linked in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(linked._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002  # numba asks for it
        return 0


class _Codegen(JITCPUCodegen):  # type: ignore[misc]  # untyped in numba
    _library_class = _Library

    def set_env(self, env_name: str, env: Any) -> None:
        """Nothing: it is written into what runs."""


class _Passes(CompilerBase):  # type: ignore[misc]  # untyped in numba
    """Those of numba's passes over a function that find something to do."""

    def define_pipelines(self) -> list[PassManager]:
        kept = PassManager("kernels")
        for one, why in DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            if one.name() not in _NOT_NEEDED:
                kept.add_pass(one, why)
        kept.finalize()
        return [kept]


@cache
def _codegen() -> _Codegen:
    return _Codegen("gcs_bridge")


@contextmanager
def _hurried(target: Any) -> Iterator[None]:
    """Meanwhile numba makes no machine code of what it compiles, and does not look for the same thing over and over.

    It compares all flags whenever it looks for a helper, a hundred thousand times, which takes a tenth of the time:
    they are told apart by those that are set. And it asks a function for its type, of the same arguments, fifteen times
    on average, which takes another tenth: what it answers is remembered.
    """
    as_usual = target._internal_codegen, TargetConfig.__eq__, TargetConfig.__hash__, _FUNCTIONS.get_call_type

    def equal(one: Any, other: object) -> bool:
        return isinstance(other, TargetConfig) and (one._values == other._values or bool(as_usual[1](one, other)))

    def remembered(one: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        if kws:
            return as_usual[3](one, context, args, kws)
        answers = vars(one).setdefault("_answers", {})
        if args not in answers:
            answers[args] = as_usual[3](one, context, args, kws)
        return answers[args]

    target._internal_codegen = _codegen()
    TargetConfig.__eq__, TargetConfig.__hash__ = equal, lambda one: hash(type(one))
    _FUNCTIONS.get_call_type = remembered
    try:
        yield
    finally:
        target._internal_codegen, TargetConfig.__eq__, TargetConfig.__hash__, _FUNCTIONS.get_call_type = as_usual


@contextmanager
def _uncollected() -> Iterator[None]:
    """No garbage is looked for: numba keeps nearly all that it makes, and looking takes a sixth of the time."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@_uncollected()
@global_compiler_lock  # type: ignore[untyped-decorator]  # in numba
def machine_code(function: FunctionType, declared: tuple[Declared, ...], stand_ins: StandIns, entry: str) -> bytes:
    """The kernel as an object file, which is called at the symbol `entry`; NumbaError where it means nothing."""
    if not layout_is_known():
        raise UnfamiliarError("arrays are laid out in another way")
    make_known(stand_ins, **_NO_WRAPPERS, pipeline_class=_Passes)
    target = cpu_target.target_context
    target.refresh()
    cpu_target.typing_context.refresh()
    flags = Flags()
    cpu_target.options.parse_as_flags(flags, {"nopython": True, **OPTIONS, **_NO_WRAPPERS})
    flags.no_compile = True  # the entry is to be part of it
    arguments = tuple(map(numba_type, declared))
    with _hurried(target), counted_from_the_front():
        result = compile_extra(cpu_target.typing_context, target, function, arguments, None, flags, {}, None, _Passes)
        library = result.library
        Entry(target, library, result.fndesc, entry).add(declared)
        library.finalize()
    module = library._final_module
    for one in module.functions:  # what is called from the entry alone can be made part of it
        if not one.is_declaration and one.name != entry:
            one.linkage = "internal"
    library._optimize_final_module()
    module.verify()
    _refuse_strangers(module)
    return bytes(target.codegen()._tm.emit_object(module))


def _refuse_strangers(module: Any) -> None:
    """Raise UnfamiliarError if the code needs what is not there without numba: loading it would end the process."""
    for one in (*module.functions, *module.global_variables):
        name = str(one.name)
        if one.is_declaration and not name.startswith(("llvm.", symbol_of(""))) and not _is_there(name):
            raise UnfamiliarError(f"numba's code calls {name}")


def _is_there(name: str) -> bool:
    """Whether every Python process has this symbol."""
    if sys.platform == "win32":
        return not name.startswith(("numba", "NRT_")) and bool(llvm.address_of_symbol(name))
    return hasattr(ctypes.CDLL(None), name)
