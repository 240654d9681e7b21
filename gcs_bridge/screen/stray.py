"""What would be written on standard error while the terminal is drawn on: kept, shown as lines, written afterwards.

Warnings and notes of this program, of libraries (rerun's are no Python) and of threads would go across the picture.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from typing import IO

__all__ = ["StrayLines"]
_STDERR = 2
_MOST = 65536  # bytes are kept


class StrayLines:
    """Stands in for standard error between `catch` and `release`, where that is a terminal.

    A file without a name takes it: whoever writes is never held up, as a pipe would that is not read in time.
    """

    def __init__(self) -> None:
        """Catch nothing yet."""
        self._file: IO[bytes] | None = None
        self._real = -1
        self._kept = self._rest = b""

    def catch(self) -> None:
        """Begin; a second call does nothing."""
        if self._file is not None or not os.isatty(_STDERR):
            return
        sys.stderr.flush()
        self._file = tempfile.TemporaryFile("a+b", buffering=0)  # noqa: SIM115  # until `release`
        self._real = os.dup(_STDERR)
        os.dup2(self._file.fileno(), _STDERR)

    def read(self) -> list[str]:
        """The lines that came since this was asked last."""
        if self._file is None or not (size := os.fstat(self._file.fileno()).st_size):
            return []
        data = os.pread(self._file.fileno(), size, 0)
        os.ftruncate(self._file.fileno(), 0)
        self._kept = (self._kept + data)[-_MOST:]
        *lines, self._rest = (self._rest + data)[-_MOST:].split(b"\n")
        return [line.decode("utf-8", "replace") for line in lines if line.strip()]

    def release(self) -> None:
        """End, and write what came where it would have gone; a second call does nothing."""
        if self._file is None:
            return
        sys.stderr.flush()
        self.read()
        os.dup2(self._real, _STDERR)
        os.close(self._real)
        self._file.close()
        self._file = None
        with contextlib.suppress(OSError):  # a terminal that has gone
            os.write(_STDERR, self._kept)
        self._kept = self._rest = b""
