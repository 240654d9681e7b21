"""Rows to be drawn: what was true at n times of one boot, by entity path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import rerun as rr

from gcs_bridge.columns import Floats
from gcs_bridge.viewer.drawing import Drawing
from gcs_bridge.viewer.scene import Part
from gcs_bridge.viewer.times import Instant, Times

__all__ = ["PLOT_HOLD_US", "Rows", "Shown", "broken_at_wraps"]

PLOT_HOLD_US = 200_000
"""A live link's plots grow five times a second: the eye sees no more, and each time costs as much as 100 rows."""

_POSE = 7  # numbers of a place with an attitude
Texts = npt.NDArray[np.str_]


class Shown(NamedTuple):
    """From a moment on, other parts are shown; `static`: they hold for all times."""

    moment: Instant
    parts: list[Part]
    static: bool = False


@dataclass(frozen=True)
class Rows:
    """What is drawn at n times, by path.

    `attitudes` (n, 4) as [x, y, z, w]; `numbers` (n,) or (n, series); `arrows` (n, 3) and the points of lines, `strips`
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

    def send(self, recording: Drawing) -> None:
        """Draw them."""
        known = self.times.t_rx_us > 0
        for picked in (np.flatnonzero(known), np.flatnonzero(~known)):
            if not len(picked):
                continue
            columns = self.times.columns(picked, recording.aligned)
            for path, xyzw in self.attitudes.items():
                recording.send_columns(path, columns, rr.Transform3D.columns(quaternion=xyzw[picked]))
            for path, numbers in self.numbers.items():
                recording.send_columns(path, columns, rr.Scalars.columns(scalars=numbers[picked]))
            for path, vectors in self.arrows.items():
                recording.send_columns(path, columns, rr.Arrows3D.columns(vectors=vectors[picked]))
            for path, poses in self.poses.items():
                turned = poses[picked, 3:] if poses.shape[1] == _POSE else None
                moved = rr.Transform3D.columns(translation=poses[picked, :3], quaternion=turned)
                recording.send_columns(path, columns, moved)
            for path, strips in self.strips.items():
                labels = self.labels[path][picked] if path in self.labels else None
                lines = rr.LineStrips3D.columns(strips=list(strips[picked]), labels=labels)
                recording.send_columns(path, columns, lines)
            for path, degrees in self.geo_points.items():
                recording.send_columns(path, columns, rr.GeoPoints.columns(positions=degrees[picked]))
            for path, strips in self.geo_strips.items():
                recording.send_columns(path, columns, rr.GeoLineStrings.columns(line_strings=list(strips[picked])))


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
