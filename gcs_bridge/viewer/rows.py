"""Rows to be drawn: what was true at n times of one boot, by entity path.

Times are kept as they came: each boot of a vehicle is a clock of its own, and so a timeline of its own (`boot`,
`boot_1`, …); the receive time is `utc`, where it is known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import rerun as rr

from gcs_bridge.columns import Columns, Floats, Int64s, record
from gcs_bridge.events import Event
from gcs_bridge.judging.observation import Observation
from gcs_bridge.viewer.scene import UTC, Part, boot_timeline

__all__ = ["PLOT_HOLD_US", "Instant", "Rows", "Shown", "Times", "broken_at_wraps", "instant_of", "pair_times"]

PLOT_HOLD_US = 200_000
"""A live link's plots grow five times a second: the eye sees no more, and each time costs as much as 100 rows."""

_POSE = 7  # numbers of a place with an attitude
Texts = npt.NDArray[np.str_]


class Instant(NamedTuple):
    """An instant on the clock of a boot and as received: µs, None and −1 where unknown."""

    boot: int
    t_boot_us: int | None
    t_rx_us: int

    def columns(self, n: int) -> list[rr.TimeColumn]:
        """The times of n rows of this instant; none where neither is known."""
        columns = []
        if self.t_boot_us is not None:
            boot_us = np.full(n, self.t_boot_us, "m8[us]")
            columns.append(rr.TimeColumn(boot_timeline(self.boot), duration=boot_us))
        if self.t_rx_us > 0:
            columns.append(rr.TimeColumn(UTC, timestamp=np.full(n, self.t_rx_us, "M8[us]")))
        return columns


class Shown(NamedTuple):
    """From a moment on, other parts are shown; `static`: they hold for all times."""

    moment: Instant
    parts: list[Part]
    static: bool = False


@record
class Times(Columns):
    """When n rows were true, in one boot: (n,) each, µs, −1 where the receive time is unknown."""

    t_boot_us: Int64s
    t_rx_us: Int64s
    boot: int

    def moment(self, row: int) -> Instant:
        """When one of them was true."""
        return Instant(self.boot, int(self.t_boot_us[row]), int(self.t_rx_us[row]))

    def columns(self, rows: Int64s) -> list[rr.TimeColumn]:
        """The times of rows whose receive times are all known, or all unknown."""
        columns = [rr.TimeColumn(boot_timeline(self.boot), duration=self.t_boot_us[rows].astype("m8[us]"))]
        if self.t_rx_us[rows[0]] > 0:
            columns.append(rr.TimeColumn(UTC, timestamp=self.t_rx_us[rows].astype("M8[us]")))
        return columns


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

    def send(self, recording: rr.RecordingStream) -> None:
        """Draw them."""
        known = self.times.t_rx_us > 0
        for picked in (np.flatnonzero(known), np.flatnonzero(~known)):
            if not len(picked):
                continue
            columns = self.times.columns(picked)
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


def instant_of(event: Event) -> Instant:
    """When an event was."""
    boot_s, utc = event.boot_s, event.utc
    received = -1 if utc is None else int(np.datetime64(utc.removesuffix("Z"), "us").astype(np.int64))
    return Instant(event.boot or 0, None if boot_s is None else round(boot_s * 1e6), received)


def pair_times(observation: Observation) -> Times:
    """When each pair was true, and known: a pair is known when the sample comes that completes it."""
    pairs = observation.pairs
    return Times(t_boot_us=pairs.t_boot_us, t_rx_us=pairs.t_rx_us, boot=observation.segment.boot)
