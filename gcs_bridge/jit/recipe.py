"""What a kernel's machine code is made of, told without numba: where all of it is the same, so is the code.

The kernel's own code, all functions that it calls and the constants of both; the types of its arguments; the compiler,
the interpreter, and the processor that it is for.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from gcs_bridge.jit.declared import Declared, text_of

try:
    from _blake2 import blake2b  # hashlib brings OpenSSL, which takes longer to load than all kernels
except ImportError:
    from hashlib import blake2b


class StandIn(NamedTuple):
    """What is compiled where a kernel calls a function: that function itself, for most of them."""

    function: FunctionType
    is_inlined: bool = False


StandIns = Mapping[FunctionType, StandIn]
"""The functions that kernels may call."""


def recipe_of(function: FunctionType, types: tuple[Declared, ...], stand_ins: StandIns, processor: str) -> str:
    """A digest of all that decides about a kernel's machine code."""
    inlined = {one.function for one in stand_ins.values() if one.is_inlined}
    parts = [_surroundings(), processor, *map(text_of, types)]
    parts += [f"{_told(one)} {one in inlined}" for one in _called(function, stand_ins)]
    return blake2b("\n".join(parts).encode(), digest_size=16).hexdigest()


@cache
def _surroundings() -> str:
    """What compiles, and whose structures the code reads."""
    settings = (f"{key}={value}" for key, value in os.environ.items() if key.startswith("NUMBA_"))
    parts = [sys.version, f"header {object.__basicsize__}", f"numpy {np.__version__}", *sorted(settings)]
    parts += [_version_file(package) for package in ("numba", "llvmlite")]
    parts += [Path(__file__).with_name(name).read_text("utf-8") for name in ("compiler.py", "entry.py", "by_numba.py")]
    return "\n".join(parts)


def _version_file(package: str) -> str:
    """What a package that is not loaded says of its version: loading it would take longer than all the rest."""
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return f"no {package}"
    return Path(spec.origin).with_name("_version.py").read_text("utf-8")


def _called(function: FunctionType, stand_ins: StandIns) -> list[FunctionType]:
    """The function as kernels know it, and every other one that it comes to call."""
    called: list[Any] = [function]
    for one in called:  # it grows meanwhile
        for value in _globals_of(one).values():
            if isinstance(value, FunctionType):
                other = stand_ins[value].function if value in stand_ins else value
                if other not in called:
                    called.append(other)
    return called


@cache
def _globals_of(function: FunctionType) -> dict[str, Any]:
    """What the names in a function's code mean; of a module, those of its things that are named too."""
    names = [name for code in _codes(function.__code__) for name in code.co_names]
    meant = {name: function.__globals__[name] for name in names if name in function.__globals__}
    for module, value in list(meant.items()):
        if isinstance(value, ModuleType) and _package(value.__name__) == _package(function.__module__):
            meant |= {f"{module}.{name}": getattr(value, name) for name in names if hasattr(value, name)}
    return meant


def _package(module: str) -> str:
    return module.partition(".")[0]


def _codes(code: CodeType) -> Iterator[CodeType]:
    """The code of a function, and of those within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


@cache
def _told(function: FunctionType) -> str:
    """A function's code and constants."""
    parts: list[Any] = [function.__defaults__, [cell.cell_contents for cell in function.__closure__ or ()]]
    for code in _codes(function.__code__):
        constants = [one for one in code.co_consts if not isinstance(one, CodeType)]
        parts += [code.co_code, constants, code.co_names, code.co_varnames]
    for name, value in _globals_of(function).items():
        if isinstance(value, np.ndarray):
            parts.append((name, value.dtype, value.shape, value.tobytes()))
        elif isinstance(value, int | float | str | tuple | np.generic | np.dtype):
            parts.append((name, value))
        elif isinstance(value, type):
            parts.append((name, getattr(value, "_fields", None)))
    return repr(parts)
