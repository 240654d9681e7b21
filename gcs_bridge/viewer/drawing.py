"""What is drawn into: a rerun recording, seen by one of those that draw into it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
import rerun as rr

from gcs_bridge.viewer.arrays import TimeColumn
from gcs_bridge.viewer.below import frame_below, path_below
from gcs_bridge.viewer.scene import UTC, boot_timeline
from gcs_bridge.viewer.times import Aligned, Instant

__all__ = ["Drawing", "new_recording"]

_TICK_S = 0.05  # so long rerun gathers a live link's events; samples are gathered already, and go at once


def new_recording(
    name: str, *, live: bool, application_id: str | None = None, recording_id: str | None = None
) -> rr.RecordingStream:
    """A recording of its own. Each has its own layout too, which rerun keeps by application: so `name` is in that."""
    config = rr.ChunkBatcherConfig(flush_tick=_TICK_S) if live else None
    if application_id is None:  # no other sign is allowed
        application_id = re.sub(r"[^A-Za-z0-9]+", "-", f"gcs-bridge {name}").strip("-")
    recording = rr.RecordingStream(application_id, recording_id=recording_id, batcher_config=config)
    recording.send_recording_name(name.encode("utf-8", "backslashreplace").decode())  # a file's may be undecodable
    recording.set_log_time_enabled(False)  # when it was drawn is of no interest
    recording.set_log_tick_enabled(False)
    return recording


class Drawing:
    """Draws into a recording that others may draw into, too; each draws in one thread."""

    def __init__(self, recording: rr.RecordingStream, *, aligned: Aligned | None = None, prefix: str = "") -> None:
        """`aligned`: a timeline beside those of boot and receive time, on which all that draw into it meet.

        `prefix`: the entity below which all is drawn.
        """
        self.aligned = aligned
        self._rec = recording
        self._prefix = prefix

    def log(self, path: str, archetype: rr.AsComponents, *, static: bool = False) -> None:
        """Draw what is there from the moment set, or at all times."""
        if self._prefix and isinstance(archetype, rr.CoordinateFrame):
            archetype = frame_below(self._prefix, archetype)
        self._rec.log(path_below(self._prefix, path), archetype, static=static)

    def send_columns(self, path: str, times: Sequence[TimeColumn], columns: Iterable[rr.ComponentColumn]) -> None:
        """Draw many rows at once."""
        self._rec.send_columns(path_below(self._prefix, path), times, columns)

    def set_time(self, moment: Instant) -> None:
        """The time of what is logged next."""
        self._rec.reset_time()
        if moment.t_boot_us is not None:
            self._rec.set_time(boot_timeline(moment.boot), duration=np.timedelta64(moment.t_boot_us, "us"))
        if moment.t_rx_us > 0:
            self._rec.set_time(UTC, timestamp=np.datetime64(moment.t_rx_us, "us"))
        if self.aligned is not None and (since_us := self.aligned.at(moment)) is not None:
            self._rec.set_time(self.aligned.timeline, duration=np.timedelta64(since_us, "us"))
