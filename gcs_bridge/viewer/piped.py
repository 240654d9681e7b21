"""What is drawn goes to standard output: to the program that has started this one, which shows it."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr

from gcs_bridge.viewer.base import Beside, Viewer, ViewerSink
from gcs_bridge.viewer.drawing import new_recording
from gcs_bridge.viewer.saved import FLUSH_S, GATHER
from gcs_bridge.viewer.sink import sinks_of
from gcs_bridge.viewer.world import world_of

__all__ = ["PipedViewer"]


class PipedViewer(Viewer):
    """Writes recordings to standard output, as rerun reads them from there."""

    kind = "pipe"

    def __init__(self, *, application_id: str | None, recording_id: str | None, prefix: str) -> None:
        """As whose recording it is drawn, as one of its own if None; below which entity: "" is the root."""
        self._application_id = application_id
        self._recording_id = recording_id
        self._prefix = prefix.strip("/")
        self._recording: rr.RecordingStream | None = None

    def recordings(self, name: str, several: Sequence[Beside | None]) -> list[ViewerSink]:
        """Where each of several is drawn that are shown side by side as `name`; None: it is alone."""
        recording = self._recording = new_recording(
            name, live=False, application_id=self._application_id, recording_id=self._recording_id
        )
        recording.stdout()
        return list(sinks_of(world_of(recording, several, live=False, prefix=self._prefix), several, gather=GATHER))

    def close(self) -> None:
        """Write out what is under way."""
        recording, self._recording = self._recording, None
        if recording is not None:
            recording.flush(timeout_sec=FLUSH_S)
            recording.disconnect()
