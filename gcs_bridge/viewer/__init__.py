"""The 3D viewer: the only place that imports rerun, and only when a viewer is really opened.

`open_viewer` opens what `--viewer` asks for; `Viewer.recording` gives the sink that draws what a Monitor tells.
It draws what was judged, and must not judge: limits come with what they were applied to.
"""

from __future__ import annotations

from gcs_bridge.viewer.base import Beside, Viewer, ViewerSink, ViewerSpec
from gcs_bridge.viewer.open import open_viewer

__all__ = ["Beside", "Viewer", "ViewerSink", "ViewerSpec", "open_viewer"]
