"""One way to compile a kernel, with a cache that works wherever the package is installed."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

Kernel = TypeVar("Kernel", bound=Callable[..., Any])
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


def _compiled(function: Kernel, **options: bool) -> Kernel:
    """Compile `function` without the GIL and, where this numba can, without counting references to arrays.

    Counting takes more time than all the rest. Without it a kernel can make no array of its own; ours never do.
    """
    decorate: Any = numba.njit
    try:
        return decorate(nogil=True, _nrt=False, **options)(function)  # type: ignore[no-any-return]  # untyped in numba
    except KeyError:  # an option of numba's own use: one day it may be gone
        return decorate(nogil=True, **options)(function)  # type: ignore[no-any-return]


def kernel(function: Kernel) -> Kernel:
    """Compile what Python calls; the machine code is kept for the next process."""
    compiled = _compiled(function, cache=True)
    with contextlib.suppress(AttributeError):  # parts of numba's own: without them it loads as it is used to
        _load_without_compiler(compiled)
    _KERNELS.append(compiled)
    return compiled


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
