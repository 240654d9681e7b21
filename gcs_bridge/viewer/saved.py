"""A viewer that is a file: an .rrd, to be opened with `rerun` later.

It grows under the name FILE.partial.rrd and gets its own when it is closed, so that FILE.rrd is always whole. What a
killed process leaves is FILE.partial.rrd, which `rerun` reads as well: all but the last second or two.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import rerun as rr

from gcs_bridge.errors import GcsBridgeError, UsageError
from gcs_bridge.viewer.base import SUFFIX, Beside, Viewer, ViewerSink
from gcs_bridge.viewer.drawing import new_recording
from gcs_bridge.viewer.sink import RerunSink, sinks_of
from gcs_bridge.viewer.world import world_of

__all__ = ["FLUSH_S", "GATHER", "SavedViewer"]

FLUSH_S = 60.0  # a disk may be slow
GATHER = 64  # rows: each piece costs 1 kB more in the file, and 0.2 kB of memory until its index is written


class SavedViewer(Viewer):
    """Writes what is drawn to a file."""

    kind = "save"

    def __init__(self, path: Path, *, live: bool) -> None:
        """Touch nothing yet: a file appears with the first recording."""
        self._path = path
        self._part = path.with_suffix(f".partial{SUFFIX}")
        self._live = live
        self._refused = False
        self._recording: rr.RecordingStream | None = None
        self._sinks: list[RerunSink] = []

    def recordings(self, name: str, several: Sequence[Beside | None]) -> list[ViewerSink]:
        """Where each of several is drawn that are shown side by side as `name`; None: it is alone."""
        recording = new_recording(name, live=self._live)
        try:
            recording.set_sinks(rr.FileSink(self._part))
        except RuntimeError as error:
            raise UsageError(f"cannot write {self._path}: {error}") from None
        self._recording = recording
        self._sinks = sinks_of(world_of(recording, several, live=self._live), several, gather=GATHER)
        return list(self._sinks)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._refused = isinstance(error, GcsBridgeError)
        self.close()

    def close(self) -> None:
        """Give the file its name; what was refused leaves none."""
        recording, self._recording = self._recording, None
        if recording is None:
            return
        for sink in self._sinks:
            sink.flush()
        recording.flush(timeout_sec=FLUSH_S)
        recording.disconnect()
        if self._refused:
            self._part.unlink(missing_ok=True)
            return
        try:
            self._part.replace(self._path)
        except OSError as error:
            raise UsageError(f"cannot write {self._path}: {error.strerror}") from None
