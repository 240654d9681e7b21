"""What a path means, and where a result goes: a file that is whole or not there, or standard output."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs_bridge.errors import UsageError

__all__ = ["INSIDE", "file_of", "lead_nowhere", "refuse_unwritable", "write_file", "write_stdout", "writing"]

INSIDE = "::"
"""Stands between a file and the name of a recording in it."""


def file_of(path: Path) -> tuple[Path, str | None]:
    """The file that a path means, and which of the recordings in it."""
    file, colons, inside = str(path).partition(INSIDE)
    return (Path(file), inside) if colons and not path.exists() else (path, None)


def refuse_unwritable(path: Path, *, sources: list[Path]) -> None:
    """Raise UsageError now, before any work, if the output could not be written or would replace a source."""
    try:
        _refuse(path, sources)
    except OSError as error:  # it may not even be looked at
        raise UsageError(f"cannot write {path}: {error.strerror}") from None


def _refuse(path: Path, sources: list[Path]) -> None:
    folder = Path(os.path.realpath(path)).parent
    if path.is_dir():
        raise UsageError(f"cannot write {path}: it is a folder")
    if not folder.is_dir():
        raise UsageError(f"cannot write {path}: there is no folder {folder}")
    if path.exists() and any(file.exists() and path.samefile(file) for file, _ in map(file_of, sources)):
        raise UsageError(f"cannot write {path}: it is one of the recordings to be read")
    is_device = path.exists() and not path.is_file()  # is written to itself, its folder need not be
    if not os.access(path if is_device else folder, os.W_OK):
        raise UsageError(f"cannot write {path}: no permission")


def write_file(content: str | bytes, path: Path) -> None:
    """Write the file under a temporary name beside it, then rename it: a reader never sees half of it."""
    target = Path(os.path.realpath(path))  # a link stays a link
    data = content.encode() if isinstance(content, str) else content
    with writing(path):
        if target.exists() and not target.is_file():  # a device or pipe is written to, not replaced
            target.write_bytes(data)
            return
        temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
        try:
            temporary.write_bytes(data)
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """UsageError in one line for what keeps a file, or what is below a folder, from being written."""
    try:
        yield
    except OSError as error:  # pyarrow's too
        raise UsageError(f"cannot write {path}: {error.strerror or error}") from None


def write_stdout(text: str) -> None:
    """Write to standard output, as UTF-8 whatever the terminal's encoding: JSON knows no other."""
    try:
        sys.stdout.flush()
        rest = memoryview(text.encode())
        while rest:  # with PYTHONUNBUFFERED a write may take a part only
            rest = rest[sys.stdout.buffer.write(rest) or 0 :]
        sys.stdout.buffer.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        lead_nowhere(sys.stdout.fileno())  # else Python's own flush at exit fails again, and has the last word
        raise UsageError(f"cannot write to standard output: {error.strerror}") from error


def lead_nowhere(file: int) -> None:
    """What is still written to an open file, by its number, is lost: flushing and closing it cannot fail any more."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, file)
    os.close(nowhere)
