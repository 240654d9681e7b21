"""A file that grows while the program runs, and is whole to the last write if the program is killed."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from gcs_bridge.errors import UsageError
from gcs_bridge.files import refuse_unwritable
from gcs_bridge.sinks.base import Plan, Sink

__all__ = ["FileSink", "LiveFile"]


class LiveFile:
    """Appends to a file, without a buffer of its own.

    A file that cannot be opened is a UsageError. One that cannot be written to later (the disk is full) is told once to
    `complain`, and then left alone until it is opened anew: what watches a vehicle must not end for want of a record.
    `failed` tells of it.
    """

    def __init__(self, path: Path, complain: Callable[[str], None]) -> None:
        """Open the file; what is in it already stays."""
        refuse_unwritable(path, sources=[])
        try:
            self._descriptor = _opened(path)
        except OSError as error:
            raise UsageError(f"cannot write {path}: {error.strerror}") from None
        self.failed = False
        self._is_left = False
        self._path = path
        self._complain = complain

    def __enter__(self) -> LiveFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the file back; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def reopen(self) -> None:
        """Go on in the file that has its name now, or in a new one; in the old one where that cannot be."""
        if self._descriptor < 0:
            return
        try:
            descriptor = _opened(self._path)
        except OSError as error:
            self._complain(f"cannot open {self._path} anew: {error.strerror}; going on as before")
            return
        os.close(self._descriptor)
        self._descriptor, self._is_left = descriptor, False

    def append(self, data: bytes) -> None:
        """Hand the bytes to the system: from here on they outlive this process."""
        rest = memoryview(data)
        while rest and not self._is_left:
            try:
                rest = rest[os.write(self._descriptor, rest) :]
            except OSError as error:
                self.failed = self._is_left = True
                self._complain(f"cannot write {self._path} any longer: {error.strerror}; going on without it")


def _opened(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o666)


class FileSink(Sink):
    """A sink that appends to a file."""

    def __init__(self, file: LiveFile, links: Sequence[str] = ()) -> None:
        """Append to `file`, and close it in the end; `links`: the names of the links, by their numbers."""
        self._file = file
        self._links = links

    @classmethod
    def plan(cls, path: str) -> Plan:
        """A sink that appends to the file at `path`; UsageError where it could not."""
        refuse_unwritable(Path(path), sources=[])
        return Plan(lambda context: cls(LiveFile(Path(path), context.complain), context.links), writes=Path(path))

    @property
    def failed(self) -> bool:
        """Whether the file could not be written to any longer."""
        return self._file.failed

    def reopen(self) -> None:
        """Go on in the file that has its name now."""
        self._file.reopen()

    def close(self) -> None:
        """Close the file."""
        self._file.close()
