"""Machine code becomes a function that Python calls: by llvmlite and CPython alone, in a few milliseconds."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import llvmlite.binding as llvm
import numpy as np

OBJECTS = {"ndarray": np.ndarray, "None": None, "TypeError": TypeError, "RuntimeError": RuntimeError}
"""What machine code refers to by the names of `symbol_of`; Python objects that live as long as the process."""
_METH_FASTCALL = 0x0080


def symbol_of(name: str) -> str:
    """How an object of `OBJECTS` is named in machine code."""
    return f"gcs_bridge.{name}"


@cache
def processor() -> str:
    """What the code of this machine is compiled for."""
    _initialize()
    return f"{llvm.get_process_triple()} {llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"


@cache
def _initialize() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    for name, value in OBJECTS.items():
        llvm.add_symbol(symbol_of(name), id(value))


@cache
def _engine() -> Any:
    _initialize()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


class _MethodDef(ctypes.Structure):
    """PyMethodDef of CPython's stable ABI."""

    _fields_ = (("name", ctypes.c_char_p), ("code", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p))


_new_function = ctypes.pythonapi.PyCFunction_NewEx
_new_function.argtypes = [ctypes.POINTER(_MethodDef), ctypes.c_void_p, ctypes.c_void_p]
_new_function.restype = ctypes.py_object
_kept: list[Any] = []  # functions refer to it


def function_of(code: bytes, entry: str, name: str) -> Callable[..., Any]:
    """The function whose machine code, an object file, begins at the symbol `entry`; Python shows it as `name`."""
    engine = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    method = _MethodDef(name.encode(), engine.get_function_address(entry), _METH_FASTCALL, None)
    _kept.append(method)
    return _new_function(ctypes.byref(method), None, None)  # type: ignore[no-any-return]  # untyped in ctypes
