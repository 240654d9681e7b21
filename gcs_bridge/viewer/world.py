"""The one picture that one recording or several are drawn into: who stands in it, its legend and layout."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import rerun as rr

from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer import scene
from gcs_bridge.viewer.base import Beside
from gcs_bridge.viewer.below import move_below
from gcs_bridge.viewer.drawing import Drawing
from gcs_bridge.viewer.layout import layout
from gcs_bridge.viewer.panels import panel_parts
from gcs_bridge.viewer.processes import Window
from gcs_bridge.viewer.scene import Legend
from gcs_bridge.viewer.trail import Origins, Reach

__all__ = ["World", "world_of"]

_FLUSH_S = 5.0


class World:
    """Holds what all that draw into a recording share."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        *,
        live: bool,
        timeline: str | None = None,
        window: Window | None = None,
        prefix: str = "",
    ) -> None:
        """Draw the empty world. `live`: the newest is followed; else the whole is laid out when nothing follows.

        `timeline`: what to show it by; None: by what there is. `window`: its cursor is moved. `prefix`: the entity
        below which all is drawn.
        """
        self.recording = recording
        self.live = live
        self.timeline = timeline
        self.prefix = prefix
        self._drawing = Drawing(recording, prefix=prefix)
        self._window = window
        self._vehicles: dict[VehicleId, bool] = {}  # and whether its motion is known
        self._reaches: dict[VehicleId, Reach] = {}  # where those have been whose places are known
        self._legend: set[Legend] = set()  # what has been drawn
        self.origins = Origins()
        self.draw(scene.world_parts())

    @property
    def vehicles(self) -> int:
        """How many stand in it."""
        return len(self._vehicles)

    def add(self, key: VehicleId) -> int:
        """A vehicle that has not been seen yet takes its place: its number, from 0."""
        place = len(self._vehicles)
        self.draw(scene.vehicle_parts(key, place))
        self.draw(panel_parts(key))
        self._vehicles[key] = False
        self.draw(scene.world_parts(len(self._vehicles), self._legend))  # the more, the further away
        return place

    def moves(self, key: VehicleId) -> None:
        """From now on a vehicle's motion is known."""
        self._vehicles[key] = True

    def reaches(self, key: VehicleId, reach: Reach | None) -> None:
        """Where a vehicle has been; None: that is not known."""
        if reach is not None:
            self._reaches[key] = reach

    def draw(self, parts: Iterable[scene.Part]) -> None:
        """Draw what never changes."""
        for path, archetype in parts:
            self._drawing.log(path, archetype, static=True)

    def draw_legend(self, names: Collection[Legend]) -> None:
        """Name what is drawn for the first time."""
        if not self._legend.issuperset(names):
            self._legend.update(names)
            self.draw(scene.world_parts(len(self._vehicles), self._legend))

    def lay_out(self, timeline: str, around_us: int | None = None, *, at_end: bool = False) -> None:
        """Lay it out anew, by a timeline, around a time on it if given; and put the window's cursor there."""
        shown = layout(
            self._vehicles, timeline, live=self.live, reaches=self._reaches, around_us=around_us, at_end=at_end
        )
        if self.prefix:
            move_below(self.prefix, shown.root_container)
        self.recording.send_blueprint(shown)
        if around_us is not None and self._window is not None:
            self.recording.flush(timeout_sec=_FLUSH_S)
            self._window.show(str(self.recording.get_recording_id()), timeline, around_us)


def world_of(
    recording: rr.RecordingStream,
    several: Sequence[Beside | None],
    *,
    live: bool,
    window: Window | None = None,
    prefix: str = "",
) -> World:
    """The world that several are drawn into side by side; None: it is alone."""
    shared = next((one.timeline for one in several if one is not None), None)
    return World(recording, live=live, timeline=shared, window=window, prefix=prefix)
