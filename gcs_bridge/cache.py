"""What is made once on a machine, machine code and tables, is kept here: in files of this user, or of root.

Machine code runs with all that its user may do. So what somebody else could have written is passed over, as if it were
not there. Whoever finds nothing makes it; two who do so at once put the same file there, one after the other.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

if sys.platform != "win32":
    import fcntl

_CHOSEN = "GCS_BRIDGE_CACHE_DIR"
_BESIDE_SOURCE = Path(__file__).parent / "__pycache__"
_ROOT = 0
_FORGOTTEN_S = 90 * 86_400.0  # so old versions of something go when it is made anew


@cache
def folders() -> tuple[Path, ...]:
    """Where files may be, in the order in which they are looked for: beside the source, then at the user's."""
    chosen = os.environ.get(_CHOSEN)
    return (Path(chosen),) if chosen else (_BESIDE_SOURCE, *_of_user())


def _of_user() -> Iterator[Path]:
    if sys.platform == "win32":
        yield Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "gcs-bridge"
        return
    with contextlib.suppress(RuntimeError):  # there is no home
        usual = "~/Library/Caches" if sys.platform == "darwin" else "~/.cache"
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path(usual).expanduser()) / "gcs-bridge"
    yield Path(tempfile.gettempdir()) / f"gcs-bridge-{os.geteuid()}"


@cache
def writable() -> Path | None:
    """The folder that is written to, None where there is none: then each process makes its own."""
    for folder in folders():
        if folder == _BESIDE_SOURCE and sys.dont_write_bytecode:
            continue
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o755, parents=True, exist_ok=True)
            if _is_ours(folder.lstat(), stat.S_ISDIR) and os.access(folder, os.W_OK | os.X_OK):
                return folder
    return None


def _is_ours(status: os.stat_result, kind: Callable[[int], bool]) -> bool:
    """Whether it is what it should be, and nobody but this user and root can have written it."""
    if sys.platform == "win32":  # what lies in a user's own folders is the user's
        return kind(status.st_mode)
    others = stat.S_IWGRP | stat.S_IWOTH
    return kind(status.st_mode) and status.st_uid in (_ROOT, os.geteuid()) and not status.st_mode & others


def is_kept(name: str) -> bool:
    """Whether there is a file of this name; whether it can be used shows when it is read."""
    return any((folder / name).exists() for folder in folders())


def read(name: str) -> bytes | None:
    """What is kept under this name, None where there is nothing that can be trusted."""
    for folder in folders():
        with contextlib.suppress(OSError):
            if not _is_ours(folder.lstat(), stat.S_ISDIR):
                continue
            with (folder / name).open("rb") as file:
                content = file.read() if _is_ours(os.fstat(file.fileno()), stat.S_ISREG) else b""
            head, _, data = content.partition(b"\n")
            if head == _head(name, data):
                return data
    return None


def write(name: str, data: bytes) -> None:
    """Keep `data` under this name, where that is possible: who reads meanwhile sees all of it or nothing."""
    folder = writable()
    if folder is None:
        return
    temporary = folder / f"{name}.{os.getpid()}.tmp"
    with contextlib.suppress(OSError):  # the disk is full: it is made again the next time
        try:
            temporary.touch(0o644, exist_ok=False)
            with temporary.open("r+b") as out:
                out.write(_head(name, data) + b"\n" + data)
            temporary.replace(folder / name)
        finally:
            temporary.unlink(missing_ok=True)
        _forget_others(folder, name)


def _head(name: str, data: bytes) -> bytes:
    """What a file begins with: by it one that is damaged, or stands under another's name, is known."""
    return f"{name} {zlib.crc32(data):08x}".encode()


def _forget_others(folder: Path, name: str) -> None:
    """Delete what was kept long ago of the same thing, whose name ends at the last hyphen."""
    for other in folder.glob(f"{name.rpartition('-')[0]}-*"):
        if time.time() - other.stat().st_mtime > _FORGOTTEN_S:
            other.unlink()


@contextlib.contextmanager
def claimed(name: str) -> Iterator[bool]:
    """Whether, among all processes, this one is to make what is kept under `name`; others are told no meanwhile.

    No harm is done where that cannot be told: the same is made twice.
    """
    folder = writable()
    if sys.platform == "win32" or folder is None:
        yield True
        return
    try:
        file = os.open(folder / "gcs-bridge.lock", os.O_RDWR | os.O_CREAT, 0o600)  # else others could hold it for ever
    except OSError:
        yield True
        return
    try:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, zlib.crc32(name.encode()))  # a byte each
            mine = True
        except BlockingIOError:
            mine = False
        except OSError:  # this file system has no locks
            mine = True
        yield mine
    finally:
        os.close(file)  # which ends the claim, as the end of the process does
