"""A viewer that is a file: an .rrd, to be opened with `rerun` later.

It grows under the name FILE.partial.rrd and gets its own when it is closed, so that FILE.rrd is always whole. What a
killed process leaves is FILE.partial.rrd, which `rerun` reads as well: all but the last second or two.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import TracebackType

import rerun as rr

from gcs_bridge.errors import GcsBridgeError, UsageError
from gcs_bridge.viewer.base import SUFFIX, Viewer, ViewerSink
from gcs_bridge.viewer.sink import RerunSink, new_recording

__all__ = ["FLUSH_S", "GATHER", "SavedViewer"]

FLUSH_S = 60.0  # a disk may be slow
GATHER = 64  # rows: each piece costs 1 kB more in the file, and 0.2 kB of memory until its index is written


class SavedViewer(Viewer):
    """Writes each recording to a file of its own, and at the end makes them one."""

    kind = "save"

    def __init__(self, path: Path, *, live: bool) -> None:
        """Touch nothing yet: a file appears with the first recording."""
        self._path = path
        self._live = live
        self._refused = False
        self._open: list[tuple[RerunSink, rr.RecordingStream, Path]] = []

    def recording(self, name: str) -> ViewerSink:
        """Where one link session, or one file, is drawn; `links`: the names by which events call the links."""
        number = len(self._open) + 1
        part = self._path.with_suffix(f".partial{'' if number == 1 else number}{SUFFIX}")
        recording = new_recording(name, live=self._live)
        try:
            recording.set_sinks(rr.FileSink(part))
        except RuntimeError as error:
            raise UsageError(f"cannot write {self._path}: {error}") from None
        sink = RerunSink(recording, live=self._live, gather=GATHER)
        self._open.append((sink, recording, part))
        return sink

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._refused = isinstance(error, GcsBridgeError)
        self.close()

    def close(self) -> None:
        """Give the file its name; what was refused leaves none."""
        parts = [part for *_, part in self._open]
        for sink, recording, _ in self._open:
            sink.flush()
            recording.flush(timeout_sec=FLUSH_S)
            recording.disconnect()
        self._open = []
        if self._refused:
            for part in parts:
                part.unlink(missing_ok=True)
            return
        try:
            if len(parts) > 1:  # one file can hold several recordings, but only rerun's own tool puts them together
                _merge(parts)
            for part in parts[:1]:
                part.replace(self._path)
            for part in parts[1:]:
                part.unlink()
        except (OSError, subprocess.CalledProcessError) as error:
            raise UsageError(f"cannot write {self._path}: {error}") from None


def _merge(parts: list[Path]) -> None:
    """All recordings into the first file."""
    merged = parts[0].with_suffix(f".merged{SUFFIX}")
    command = [sys.executable, "-m", "rerun_cli", "rrd", "merge", *map(str, parts), "-o", str(merged)]
    subprocess.run(command, check=True, capture_output=True)  # noqa: S603  # rerun's own program
    merged.replace(parts[0])
