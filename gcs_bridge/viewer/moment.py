"""The time around an alarm as an .rrd that opens on it."""

from __future__ import annotations

from pathlib import Path

import rerun as rr

from gcs_bridge.errors import UsageError
from gcs_bridge.judging.alarm_windows import AlarmWindow
from gcs_bridge.viewer.drawing import new_recording
from gcs_bridge.viewer.saved import FLUSH_S, GATHER
from gcs_bridge.viewer.sink import RerunSink
from gcs_bridge.viewer.world import World

__all__ = ["save_moment"]


def save_moment(moment: AlarmWindow, name: str, path: Path) -> None:
    """Write the file; `name` is what the viewer calls it."""
    recording = new_recording(name, live=False)
    try:
        recording.set_sinks(rr.FileSink(path))
    except RuntimeError as error:
        raise UsageError(f"cannot write {path}: {error}") from None
    sink = RerunSink(World(recording, live=False), gather=GATHER)
    for observation in moment.observations:
        sink.observe(observation)
    sink.events(moment.events)
    sink.finish_moment(moment.t_boot_us)
    recording.flush(timeout_sec=FLUSH_S)
    recording.disconnect()
