"""All that is drawn of one vehicle beside the scene: angles, indicator, disagreement, streams, verdicts, alarms."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from gcs_bridge.checks.disagreement import Disagreement
from gcs_bridge.events import Event
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.alarm_text import AlarmText
from gcs_bridge.viewer.angles import AngleLines, angle_parts
from gcs_bridge.viewer.horizon import Horizon, horizon_parts
from gcs_bridge.viewer.lanes import Lanes
from gcs_bridge.viewer.palette import Colour
from gcs_bridge.viewer.rows import Rows, Shown
from gcs_bridge.viewer.scene import DISAGREEMENT, Part, path_of
from gcs_bridge.viewer.streams import StreamLines, rate_rows, stream_parts
from gcs_bridge.viewer.stretch import Stretch
from gcs_bridge.viewer.times import Times

__all__ = ["LEAST_POWER", "Panels", "panel_parts"]

LEAST_POWER = -4.0
"""Of ten, in degrees: what is less, nothing included, is drawn there. A float32 of the wire tells no more."""
_POWERS: dict[str, tuple[Colour, float]] = {  # in the order of DISAGREEMENT: colour and width
    "angle": ((240, 90, 80), 4.0),
    "limit": ((192, 192, 192), 1.5),
    "tilt": ((250, 220, 90), 1.5),
    "heading": ((90, 200, 250), 1.5),
}


def panel_parts(key: VehicleId) -> Iterator[Part]:
    """What never changes of a vehicle's panels."""
    yield from angle_parts(key)
    yield from horizon_parts(key)
    yield from stream_parts(key)
    colours, widths = zip(*(_POWERS[name] for name in DISAGREEMENT), strict=True)
    lines = rr.SeriesLines(names=DISAGREEMENT, colors=colours, widths=widths)
    yield path_of(key, "disagreement_power"), lines


class Panels:
    """Follows one vehicle."""

    def __init__(self, key: VehicleId) -> None:
        """Start with nothing drawn."""
        self._key = key
        self._angles = AngleLines(key)
        self._horizon = Horizon(key)
        self._lanes = Lanes(key)
        self._alarms = AlarmText(key)
        self._streams = StreamLines(key)

    def indicate(self, stretch: Stretch) -> Iterator[Rows]:
        """What attitudes add to the indicator."""
        for angles in stretch.angles:
            yield from self._horizon.feed(angles.source, angles.times, np.degrees(angles.rpy_rad))

    def plot(self, stretch: Stretch) -> Iterator[Rows | Shown]:
        """What else is added: lines and lanes."""
        for angles in stretch.angles:
            yield from self._angles.feed(angles.source, angles.times, np.degrees(angles.rpy_rad))
        if stretch.compared is not None:
            yield self._apart(*stretch.compared)
        for one in stretch.observations:
            yield from self._lanes.observe(one)
        yield from self._streams.feed(stretch.segment)
        yield from rate_rows(self._key, stretch)

    def _apart(self, times: Times, found: Disagreement) -> Rows:
        """The disagreement, in degrees and as powers of ten. What could not be judged is left open, not a value."""
        values = {name: np.where(found.judged, getattr(found, name), np.nan) for name in ("angle", "tilt", "heading")}
        values["limit"] = found.limit
        degrees = np.degrees([values[name] for name in DISAGREEMENT]).T
        powers = np.log10(np.maximum(np.abs(degrees), 10.0**LEAST_POWER))
        paths = (path_of(self._key, name) for name in ("disagreement", "disagreement_power"))
        return Rows(times, numbers=dict(zip(paths, (degrees, powers), strict=True)))

    def hear(self, event: Event) -> Iterator[Shown]:
        """An event of the vehicle."""
        self._lanes.hear(event)
        yield from self._alarms.hear(event)

    def settle(self) -> Iterator[Shown]:
        """All events of what was observed were heard."""
        yield from self._lanes.settle()
