"""Roll, pitch and yaw of both forms as lines that do not cross the plot where an angle wraps at ±180°.

Near the pole, nose up or down, roll and yaw turn about one axis and each alone means nothing: there a grey bar lies
under them.

    vehicle/1.1/roll/euler …             as sent, in degrees; not a number right before a sample beyond a wrap
    vehicle/1.1/roll/near_pole/euler …   the bar, while this form lies near the pole; likewise under yaw
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
import rerun as rr

from gcs_bridge.columns import Floats, Mask
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.palette import GREY
from gcs_bridge.viewer.rows import Rows, broken_at_wraps
from gcs_bridge.viewer.scene import ANGLES, Part, path_of
from gcs_bridge.viewer.times import Times

__all__ = ["POLE_DEG", "AngleLines", "angle_parts"]

POLE_DEG = 85.0
"""From this pitch on, up or down, roll and yaw alone say little: 1° of the body's turn may be 11° of theirs."""
_BAR_DEG = -180.0  # where the bar lies
_OF_POLE = ("roll", "yaw")


def angle_parts(key: VehicleId) -> Iterator[Part]:
    """What never changes of the bars."""
    for angle, source in product(_OF_POLE, ("euler", "quaternion")):
        yield path_of(key, angle, "near_pole", source), rr.SeriesLines(names="near the pole", colors=GREY, widths=8.0)


class AngleLines:
    """Follows the angles of one vehicle, and makes rows of them."""

    def __init__(self, key: VehicleId) -> None:
        """Start with nothing drawn."""
        self._key = key
        self._boot: dict[str, int] = {}  # of each source
        self._before: dict[tuple[str, str], float] = {}  # of each source and angle, degrees
        self._near: set[str] = set()  # sources that were near the pole last

    def feed(self, source: str, times: Times, rpy_deg: Floats) -> Iterator[Rows]:
        """What samples of `source`, "euler" or "quaternion", add: `rpy_deg` (n, 3)."""
        if self._boot.get(source) != times.boot:
            self._boot[source] = times.boot
            self._near.discard(source)
            for angle in ANGLES:
                self._before[source, angle] = np.nan
        whole = {}
        for angle, degrees in zip(ANGLES, rpy_deg.T, strict=True):
            broken, values = broken_at_wraps(times, degrees, self._before[source, angle], 180.0)
            self._before[source, angle] = float(degrees[-1])
            path = path_of(self._key, angle, source)
            if broken is times:
                whole[path] = values
            else:
                yield Rows(broken, numbers={path: values})
        if whole:
            yield Rows(times, numbers=whole)
        near = np.abs(rpy_deg[:, 1]) > POLE_DEG
        if near.any() or source in self._near:
            yield self._bars(source, times, near)

    def _bars(self, source: str, times: Times, near: Mask) -> Rows:
        was_near = np.concatenate(([source in self._near], near[:-1]))
        (self._near.add if near[-1] else self._near.discard)(source)
        rows = np.flatnonzero(near | was_near)
        bar = np.where(near[rows], _BAR_DEG, np.nan)
        return Rows(times[rows], numbers={path_of(self._key, angle, "near_pole", source): bar for angle in _OF_POLE})
