"""A file that grows while the program runs, and is whole to the last write if the program is killed."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from gcs_bridge.errors import UsageError
from gcs_bridge.files import refuse_unwritable
from gcs_bridge.sinks.base import Plan, Sink

__all__ = ["FileSink", "LiveFile"]
_RETRY_S = 1.0  # so often a file that could not be written to is tried again
_STEADY_S = 10.0  # so long it must be written to until it is told: on a full disk small pieces find room now and then


def _nobody(_: str) -> None:
    """Tell nobody."""


class LiveFile:
    """Appends to a file, without a buffer of its own.

    A file that cannot be opened is a UsageError. One that cannot be written to later (the disk is full) is told once to
    `complain`; what comes then is left out, until there is room again, which `note` is told: what watches a vehicle
    must not end for want of a record. `failed` tells that something was left out.
    """

    def __init__(self, path: Path, complain: Callable[[str], None], note: Callable[[str], None] = _nobody) -> None:
        """Open the file; what is in it already stays."""
        refuse_unwritable(path, sources=[])
        try:
            self._descriptor = _opened(path)
        except OSError as error:
            raise UsageError(f"cannot write {path}: {error.strerror}") from None
        self.path = path
        self.failed = False
        self._is_stuck = False  # what comes is left out, for now
        self._complain = complain
        self._note = note
        self._left_out = 0  # bytes, since it was told that it could not be written to
        self._retry_s = self._well_s = 0.0

    def __enter__(self) -> LiveFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def is_ailing(self) -> bool:
        """Whether it could not be written to, and its recovery was not told yet."""
        return self._left_out > 0

    @property
    def size(self) -> int:
        """How many bytes are in it."""
        return os.fstat(self._descriptor).st_size

    def close(self) -> None:
        """Give the file back; a second call does nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def reopen(self) -> bool:
        """Go on in the file that has its name now, or in a new one; in the old one where that cannot be: False."""
        if self._descriptor < 0:
            return False
        try:
            descriptor = _opened(self.path)
        except OSError as error:
            self._complain(f"cannot open {self.path} anew: {error.strerror}; going on as before")
            return False
        os.close(self._descriptor)
        self._descriptor = descriptor
        if self._is_stuck:  # there may be room in this one
            self._is_stuck, self._well_s = False, time.monotonic()
        return True

    def append(self, data: bytes) -> bool:
        """Hand the bytes to the system, all or none of them: from here on they outlive this process. Whether it did."""
        now_s = time.monotonic()
        if self._is_stuck and now_s < self._retry_s:
            self._left_out += len(data)
            return False
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError as error:
            self._take_back(len(data) - len(rest))
            if not self._left_out:
                self._complain(f"cannot write {self.path}: {error.strerror}; going on without it until that is mended")
            self.failed = self._is_stuck = True
            self._left_out += len(data)
            self._retry_s = now_s + _RETRY_S
            return False
        if self._is_stuck:
            self._is_stuck, self._well_s = False, now_s
        if self._left_out and now_s - self._well_s >= _STEADY_S:
            self._note(f"{self.path} is written again; {self._left_out / 1e6:.3f} MB were left out")
            self._left_out = 0
        return True

    def _take_back(self, size: int) -> None:
        """Cut off what was written of something that did not fit."""
        if size:
            with contextlib.suppress(OSError):  # a device or a pipe
                os.ftruncate(self._descriptor, self.size - size)


def _opened(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o666)


class FileSink(Sink):
    """A sink that appends to one file."""

    def __init__(self, file: LiveFile, links: Sequence[str] = ()) -> None:
        """Append to `file`, and close it in the end; `links`: the names of the links, by their numbers."""
        self._file = file
        self._links = links

    @classmethod
    def plan(cls, path: str) -> Plan:
        """A sink that appends to the file at `path`; UsageError where it could not."""
        refuse_unwritable(Path(path), sources=[])
        return Plan(
            lambda context: cls(LiveFile(Path(path), context.complain, context.note), context.links), writes=Path(path)
        )

    @property
    def failed(self) -> bool:
        """Whether the file could not be written to at some time."""
        return self._file.failed

    def reopen(self) -> None:
        """Go on in the file that has its name now."""
        self._file.reopen()

    def close(self) -> None:
        """Close the file."""
        self._file.close()
