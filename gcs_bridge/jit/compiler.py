"""A kernel becomes machine code: numba compiles it, and an entry of our own lets Python call it.

Numba's own way to call a function asks Python for the type of each argument, which takes longer than many a kernel, and
needs numba in every process that calls one. Where anything of numba, numpy or CPython is not as it is known here, an
`UnfamiliarError` is raised.
"""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any

import llvmlite.binding as llvm
from numba.core.compiler import Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from gcs_bridge.jit.by_numba import OPTIONS, make_known, numba_type
from gcs_bridge.jit.declared import Declared
from gcs_bridge.jit.entry import Entry, layout_is_known
from gcs_bridge.jit.native import symbol_of
from gcs_bridge.jit.recipe import StandIns

_NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class UnfamiliarError(Exception):
    """Something of numba, numpy or CPython is not as this package knows it."""


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
    make_known(stand_ins, **_NO_WRAPPERS)
    target = cpu_target.target_context
    target.refresh()
    cpu_target.typing_context.refresh()
    flags = Flags()
    cpu_target.options.parse_as_flags(flags, {"nopython": True, **OPTIONS, **_NO_WRAPPERS})
    flags.no_compile = True  # the entry is to be part of it
    arguments = tuple(map(numba_type, declared))
    result = compile_extra(cpu_target.typing_context, target, function, arguments, None, flags, {})
    library = result.library
    Entry(target, library, result.fndesc, entry).add(declared)
    module = library._final_module
    for linked in dict.fromkeys(library._linking_libraries):
        module.link_in(linked._get_module_for_linking(), preserve=True)
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
