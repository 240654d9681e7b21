"""The 3D viewer: the only place that imports rerun, and only when a viewer is really opened.

`open_viewer` opens what `--viewer` asks for; `Viewer.recording` gives the sink that takes what a Monitor tells.
It draws what was judged, and must not judge: limits come with what they were applied to.
"""

from __future__ import annotations

from gcs_bridge.viewer.open import Viewer, ViewerSink, ViewerSpec, open_viewer

__all__ = ["Viewer", "ViewerSink", "ViewerSpec", "open_viewer"]
