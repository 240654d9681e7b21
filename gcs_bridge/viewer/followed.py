"""What the viewer remembers of one vehicle."""

from __future__ import annotations

from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer import scene
from gcs_bridge.viewer.disagreement import Apart
from gcs_bridge.viewer.figure import Figure
from gcs_bridge.viewer.motion_lines import MotionLines
from gcs_bridge.viewer.panels import Panels
from gcs_bridge.viewer.trail import Origins, Trail

__all__ = ["Followed"]


class Followed:
    """One vehicle, as it is drawn."""

    def __init__(self, key: VehicleId, place: int, origins: Origins) -> None:
        """Start with nothing drawn of the `place`-th vehicle, from 0."""
        self.figure = Figure(key, place)
        self.trail = Trail(key, place, origins)
        self.named = False  # above what is drawn
        self.compared: set[int] = set()  # boots in which something could be compared
        self.silent = False  # by the latest event: there is nothing to compare
        self.raised: dict[str, str] = {}  # alarms of all checks, by id: severity
        self.motion: MotionLines | None = None
        self.apart = Apart(key)
        self.panels = Panels(key)

    @property
    def state(self) -> scene.State:
        """The worst that is raised; else whether the two forms are compared."""
        if self.raised:
            return "alarm" if "alarm" in self.raised.values() else "warning"
        return "not compared" if self.silent else "compared"
