"""One way to compile a kernel, with a cache that works wherever the package is installed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

import numpy

Kernel = TypeVar("Kernel", bound=Callable[..., Any])
Fields = tuple[Any, ...]
"""A named tuple's fields, as a kernel is given them: as a plain tuple, which it puts together again by `Name(*fields)`.

A named tuple as an argument costs some µs a call, as numba asks Python for its type; a plain one next to nothing.
"""
_KERNELS: list[Any] = []  # of all modules that were imported so far


def _writable(folder: Path) -> bool:
    """Whether files can be made in `folder`, or in its nearest existing parent."""
    while not folder.exists():
        folder = folder.parent
    return os.access(folder, os.W_OK | os.X_OK)


def _ensure_cache_folder() -> None:
    """Point numba at a folder of its own where neither the package nor the home can be written (it would refuse)."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    beside_source = Path(__file__).parent / "__pycache__"
    home_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    if not _writable(beside_source) and not _writable(home_cache):
        user = str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
        os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / f"gcs-bridge-kernels-{user}")


_ensure_cache_folder()

import numba  # noqa: E402  numba reads NUMBA_CACHE_DIR when it is imported
from numba.extending import register_jitable  # noqa: E402


def _compiled(function: Kernel, **options: Any) -> Kernel:
    """Compile `function` without the GIL and, where this numba can, without counting references to arrays.

    Counting takes more time than all the rest. Without it a kernel can make no array of its own; ours never do.
    Division by zero is as in numpy.
    """
    decorate: Any = numba.njit
    options |= {"nogil": True, "error_model": "numpy"}
    try:
        return decorate(_nrt=False, **options)(function)  # type: ignore[no-any-return]  # untyped in numba
    except KeyError:  # options of numba's own use: one day they may be gone
        options.pop("forceinline", None)
        return decorate(**options)(function)  # type: ignore[no-any-return]


def kernel(function: Kernel) -> Kernel:
    """Compile what Python calls; the machine code is kept for the next process."""
    compiled: Any = _compiled(function, cache=True)
    with contextlib.suppress(AttributeError):  # parts of numba's own: without them it loads as it is used to
        _load_without_compiler(compiled)
    with contextlib.suppress(AttributeError):
        compiled._cache._cache_file._source_stamp = fingerprint(function)
    _KERNELS.append(compiled)
    return compiled  # type: ignore[no-any-return]  # untyped in numba


def fingerprint(function: Callable[..., Any]) -> str:
    """What a kernel's machine code is made of: its own code, all functions that it calls, and the constants of both.

    Numba looks at the kernel's own file alone, and would go on with what was compiled of another version of a helper.
    """
    digest, met = hashlib.sha256(), set[int]()
    to_come: list[Any] = [function]
    while to_come:
        one = to_come.pop()
        one = getattr(one, "py_func", one)
        if id(one) in met:
            continue
        met.add(id(one))
        code = one.__code__
        digest.update(code.co_code + repr((code.co_consts, code.co_names)).encode())
        for name in code.co_names:
            value = one.__globals__.get(name)
            if isinstance(value, FunctionType) or hasattr(value, "py_func"):
                to_come.append(value)
            elif isinstance(value, int | float | tuple):
                digest.update(f"{name}={value!r}".encode())
            elif isinstance(value, numpy.ndarray):
                digest.update(value.tobytes())
    return digest.hexdigest()


def _load_without_compiler(compiled: Any) -> None:
    """Let a kernel's cache load machine code without numba's compiler, which takes a third of a short program's time.

    Numba makes it ready before it looks, and again where it finds nothing and does compile.
    """
    cache = compiled._cache
    load, guard = cache._load_overload, cache._guard_against_spurious_io_errors

    def load_overload(signature: Any, target_context: Any) -> Any:
        with guard():
            return load(signature, target_context)

    cache.load_overload = load_overload


def helper(function: Callable[..., Any]) -> Any:
    """Compile what kernels call: it becomes part of theirs, and is typed there."""
    return _compiled(function)


def inlined(function: Callable[..., Any]) -> Any:
    """As `helper`, for what is short and called at several places.

    A call hands over every array word by word, which takes longer than what such a function does.
    """
    return _compiled(function, forceinline=True)


def share(*functions: Callable[..., Any]) -> None:
    """Let kernels call plain functions, of numbers and tuples, that Python goes on calling with arrays."""
    for function in functions:
        register_jitable(function)


def needs_compiling(package: str) -> bool:
    """Whether any kernel of `package`, as far as it was imported, will be compiled when it is called first.

    That is so where its cache is missing or out of date.
    """
    return not all(_is_cached(one) for one in _KERNELS if f"{one.__module__}.".startswith(f"{package}."))


def _is_cached(compiled: Any) -> bool:
    try:
        return bool(compiled._cache._cache_file._load_index())  # empty, where the source is another
    except AttributeError:  # a part of numba's own: one day it may be gone, and then nothing is foretold
        return True
