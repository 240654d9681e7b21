"""Rows to be drawn: what was true at n times of one boot, by entity path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Floats
from gcs_bridge.columns import Rows as Picked
from gcs_bridge.viewer.arrays import ARROW, GEO_LINE, GEO_POINT, LINE, LINE_LABEL, PLACE, SCALARS, TURN
from gcs_bridge.viewer.drawing import Drawing
from gcs_bridge.viewer.scene import Part
from gcs_bridge.viewer.times import Instant, Times

__all__ = ["POSE", "Rows", "Shown", "broken_at_wraps"]

POSE = 7
"""Numbers of a place with an attitude."""
Texts = npt.NDArray[np.str_]


class Shown(NamedTuple):
    """From a moment on, other parts are shown; `static`: they hold for all times."""

    moment: Instant
    parts: list[Part]
    static: bool = False


@dataclass(frozen=True)
class Rows:
    """What is drawn at n times, by path.

    `attitudes` (n, 4) as [w, x, y, z]; `numbers` (n,) or (n, series); `arrows` (n, 3) and the points of lines, `strips`
    (n, points, 3), in their parent's axes; `labels` (n,) of the strips, if any; `poses` (n, 3) places, or
    (n, 7) places and attitudes; `geo_points` (n, 2) and `geo_strips` (n, points, 2) latitudes and longitudes, degrees.
    """

    times: Times
    attitudes: Mapping[str, Floats] = field(default_factory=dict)
    numbers: Mapping[str, Floats] = field(default_factory=dict)
    arrows: Mapping[str, Floats] = field(default_factory=dict)
    strips: Mapping[str, Floats] = field(default_factory=dict)
    labels: Mapping[str, Texts] = field(default_factory=dict)
    poses: Mapping[str, Floats] = field(default_factory=dict)
    geo_points: Mapping[str, Floats] = field(default_factory=dict)
    geo_strips: Mapping[str, Floats] = field(default_factory=dict)

    @property
    def paths(self) -> tuple[str, ...]:
        """Where they are drawn."""
        return (
            *self.attitudes,
            *self.numbers,
            *self.arrows,
            *self.strips,
            *self.poses,
            *self.geo_points,
            *self.geo_strips,
        )

    @classmethod
    def joined(cls, parts: list[Rows]) -> Rows:
        """Rows of the same boot and paths, one behind the other."""
        first = parts[0]
        if len(parts) == 1:
            return first
        times = Times.joined([part.times for part in parts])
        values = [
            {
                path: np.concatenate([getattr(part, kind.name)[path] for part in parts])
                for path in getattr(first, kind.name)
            }
            for kind in fields(cls)[1:]
        ]
        return cls(times, *values)

    def without_moves(self) -> Rows | None:
        """What there is beside attitudes and poses; None: nothing."""
        if not (self.attitudes or self.poses):
            return self
        if len(self.paths) == len(self.attitudes) + len(self.poses):
            return None
        return replace(self, attitudes={}, poses={})

    def send(self, recording: Drawing) -> None:
        """Draw them."""
        for times, rows in self.times.parts():
            (self if len(times) == len(self.times) else self._where(rows))._send(recording)

    def _where(self, rows: Picked) -> Rows:
        values = [{path: of[rows] for path, of in getattr(self, kind.name).items()} for kind in fields(self)[1:]]
        return Rows(self.times[rows], *values)

    def _send(self, recording: Drawing) -> None:
        """The same of rows, one at least, whose receive times are all known, or all unknown."""
        times = self.times.columns(recording.aligned)
        for path, q in self.attitudes.items():
            recording.send_columns(path, times, [TURN.column(q)])
        for path, numbers in self.numbers.items():
            recording.send_columns(path, times, [SCALARS.column(numbers)])
        for path, vectors in self.arrows.items():
            recording.send_columns(path, times, [ARROW.column(vectors)])
        for path, poses in self.poses.items():
            moved = [PLACE.column(poses[:, :3])]
            if poses.shape[1] == POSE:
                moved.append(TURN.column(poses[:, 3:]))
            recording.send_columns(path, times, moved)
        for path, strips in self.strips.items():
            lines = [LINE.column(strips)]
            if path in self.labels:
                lines.append(LINE_LABEL.column(self.labels[path].tolist()))
            recording.send_columns(path, times, lines)
        for path, degrees in self.geo_points.items():
            recording.send_columns(path, times, [GEO_POINT.column(degrees)])
        for path, strips in self.geo_strips.items():
            recording.send_columns(path, times, [GEO_LINE.column(strips)])


def broken_at_wraps(times: Times, angle_deg: Floats, before_deg: float, beyond_deg: float) -> tuple[Times, Floats]:
    """Angles (n,) with a row that is no number right before each that lies `beyond_deg` from the one before it.

    So no line crosses the plot where an angle wraps. `before_deg`: what came before the first; NaN: nothing.
    """
    before = np.concatenate(([before_deg], angle_deg[:-1]))
    across = np.flatnonzero(np.abs(angle_deg - before) > beyond_deg)
    if not len(across):
        return times, angle_deg
    t_boot_us, t_rx_us = (np.insert(t_us, across, t_us[across] - 1) for t_us in (times.t_boot_us, times.t_rx_us))
    broken = Times(boot=times.boot, t_boot_us=t_boot_us, t_rx_us=t_rx_us)
    return broken, np.insert(angle_deg, across, np.nan)
