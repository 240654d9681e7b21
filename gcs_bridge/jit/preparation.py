"""All kernels at once, before they are needed: what is not kept yet is compiled, by two processes if there is much."""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Event
from typing import TYPE_CHECKING

from gcs_bridge import cache
from gcs_bridge.jit.kernels import KERNELS, Kernel

if TYPE_CHECKING:
    import subprocess

_MANY = 4  # kernels that are worth another process, which takes a second to begin
_PATIENCE_S = 60.0  # so long somebody else may compile a kernel; then it is compiled here too
_LOOK_AGAIN_S = 0.05
_others_tell = Event()


def let_others_tell() -> None:
    """Of several processes that begin at once this one says nothing, as another does."""
    _others_tell.set()


def prepare(*packages: str) -> None:
    """Load all kernels of these packages, as far as they were imported; that some must be compiled is told on stderr.

    Without it a kernel is compiled when it is called first, and nobody is told.
    """
    beginnings = tuple(f"{package}." for package in packages)
    ours = [one for one in KERNELS if f"{one.__module__}.".startswith(beginnings)]
    missing = [one for one in ours if not one.is_ready]
    if missing:
        with _told(len(missing)) as tell, _helped(missing):
            for done, _ in enumerate(_compiled(missing), start=1):
                tell(done)
    for one in ours:
        one.load()


def _compiled(missing: Sequence[Kernel]) -> Iterator[Kernel]:
    """Each kernel once it is ready: compiled here, unless another process does that meanwhile."""
    left, since_s = list(missing), time.monotonic()
    while left:
        for one in left:
            with cache.claimed(one.name) as ours:
                if ours or one.is_ready or time.monotonic() - since_s > _PATIENCE_S:
                    one.load()
                    break
        else:
            time.sleep(_LOOK_AGAIN_S)
            continue
        left.remove(one)
        since_s = time.monotonic()
        yield one


@contextmanager
def _told(count: int) -> Iterator[Callable[[int], None]]:
    """Say that so many kernels are compiled; on a terminal a line that goes again, which is told how many are done."""
    if _others_tell.is_set():
        yield lambda _: None
        return
    what = "gcs-bridge: compiling its kernels, once on this machine"
    if not sys.stderr.isatty():
        sys.stderr.write(f"{what} (some seconds)\n")
        sys.stderr.flush()
        yield lambda _: None
        return

    def tell(done: int) -> None:
        sys.stderr.write(f"\r{what}: {done} of {count}")
        sys.stderr.flush()

    tell(0)
    try:
        yield tell
    finally:
        sys.stderr.write(f"\r{' ' * len(f'{what}: {count} of {count}')}\r")
        sys.stderr.flush()


@contextmanager
def _helped(missing: Sequence[Kernel]) -> Iterator[None]:
    """While another process compiles them too, from the other end, if that is worth it and can be had."""
    other = None
    if len(missing) >= _MANY and _processors() > 1 and cache.writable() is not None:
        with suppress(OSError):
            other = _helper(missing)
    try:
        yield
    finally:
        if other is not None:
            other.terminate()  # all is done, or nobody waits for it any more
            other.wait()


def _helper(missing: Sequence[Kernel]) -> subprocess.Popen[bytes]:
    """This interpreter once more; it looks for modules where this one does, and nowhere else."""
    import json
    import subprocess  # both only here: few processes compile

    task = json.dumps([sys.path, sorted({one.__module__ for one in missing})])
    start = "import sys, json; sys.path[:], modules = json.loads(sys.argv[1])"
    command = f"{start}; from gcs_bridge.jit.preparation import help_with; help_with(modules)"
    flags = ["-P", "-B"] if sys.dont_write_bytecode else ["-P"]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(  # noqa: S603  # this interpreter
        [sys.executable, *flags, "-c", command, task], stdin=quiet, stdout=quiet, stderr=quiet
    )


def _processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def help_with(modules: Sequence[str]) -> None:
    """Compile, last to first, the kernels of these modules that nobody else compiles."""
    for module in modules:
        importlib.import_module(module)
    for _ in _compiled([one for one in KERNELS if one.__module__ in modules and not one.is_ready][::-1]):
        pass
