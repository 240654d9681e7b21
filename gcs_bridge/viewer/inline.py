"""A recording in a notebook: the same scene and panels, inside the page."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rerun.notebook import Viewer

__all__ = ["show"]

_ASSETS = "RERUN_NOTEBOOK_ASSET"  # where the page gets the viewer from: rerun's own site, unless told otherwise


def show(path: str | Path, *, width: int = 1280, height: int = 800, **selected: Any) -> Viewer:
    """The viewer of a recording, to be the last thing in a notebook's cell; needs `gcs-bridge[notebook]`.

    `selected`: as for a `Monitor`, such as `sysid`, `from_s`, `to_s`. The page gets the viewer from this machine, not
    from rerun's site, if this is called before rerun is imported. Raises SourceError where the file cannot be used.
    """
    os.environ.setdefault(_ASSETS, "serve-local")
    from rerun.notebook import Viewer

    from gcs_bridge.judging.monitor import Monitor
    from gcs_bridge.recordings.check import feed
    from gcs_bridge.recordings.open import open_recording
    from gcs_bridge.sinks.base import Sinks
    from gcs_bridge.viewer.drawing import new_recording
    from gcs_bridge.viewer.saved import GATHER
    from gcs_bridge.viewer.sink import RerunSink
    from gcs_bridge.viewer.world import World

    path = Path(path)
    recording = new_recording(path.name, live=False)
    shown = Viewer(width=width, height=height, recording=recording, theme="dark")
    sink = RerunSink(World(recording, live=False), gather=GATHER)
    with open_recording(path, selected.get("dialect", "all")) as source:
        feed(source, Monitor(**selected, observer=sink.observe), Sinks([sink]), lambda _: None)
    sink.finish()
    recording.flush(timeout_sec=60.0)
    return shown
