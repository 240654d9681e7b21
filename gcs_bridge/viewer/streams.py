"""How the two attitudes of a vehicle arrive, second by second of its boot, and its rates beside the gyro's.

vehicle/1.1/streams/rate_hz        messages of each stream in the second
vehicle/1.1/streams/age_s          the longest time that each stream's newest sample was old
vehicle/1.1/streams/lost_percent   of all frames of the vehicle
vehicle/1.1/rates_deg_s            body rates by the attitude and by the gyro, where one is heard
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import rerun as rr

from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.telemetry.batches import BootSegment
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.samples import STREAMS
from gcs_bridge.viewer.palette import EULER, GREY, LEVEL_AXES, QUATERNION
from gcs_bridge.viewer.rows import Rows
from gcs_bridge.viewer.scene import Part, path_of
from gcs_bridge.viewer.stretch import Stretch
from gcs_bridge.viewer.times import Times

__all__ = ["STREAM_PANELS", "StreamLines", "rate_rows", "stream_parts"]

STREAM_PANELS = ("rate_hz", "age_s", "lost_percent")
_S_US = 1_000_000
_AXES = ("forward", "right", "down")


def stream_parts(key: VehicleId) -> Iterator[Part]:
    """What never changes of these lines."""
    for panel in STREAM_PANELS[:2]:
        lines = rr.SeriesLines(names=STREAMS, colors=[EULER, QUATERNION], widths=[4.0, 1.5])
        yield path_of(key, "streams", panel), lines
    yield path_of(key, "streams", STREAM_PANELS[2]), rr.SeriesLines(names="lost", colors=GREY, widths=2.0)
    names = [f"{axis}, {source}" for source in ("gyro", "attitude") for axis in _AXES]
    pale = [tuple((255 + part) // 2 for part in colour) for colour in LEVEL_AXES]
    lines = rr.SeriesLines(names=names, colors=[*LEVEL_AXES, *pale], widths=[3.5] * 3 + [1.2] * 3)
    yield path_of(key, "rates_deg_s"), lines


class StreamLines:
    """Counts what came in each second of a boot."""

    def __init__(self, key: VehicleId) -> None:
        """Start with nothing counted."""
        self._key = key
        self._boot: int | None = None
        self._start(0)

    def _start(self, second: int) -> None:
        self._second = second
        self._count = np.zeros(2)
        self._age_us = np.zeros(2)
        self._latest_us = np.full(2, np.nan)  # of each stream
        self._t_boot_us = self._t_rx_us = -1  # of the latest message
        self._lost = self._received = 0  # of the vehicle's frames, up to here
        self._before = (0, 0)  # the same where the second began

    def feed(self, segment: BootSegment) -> Iterator[Rows]:
        """What a batch adds: the seconds that are over."""
        if not len(segment.t_boot_us):
            return
        if segment.boot != self._boot:
            self._boot = segment.boot
            self._start(int(segment.t_boot_us[0]) // _S_US)
            self._before = int(segment.lost[0]), int(segment.received[0])
        seconds = np.maximum(np.maximum.accumulate(segment.t_boot_us // _S_US), self._second)
        cuts = [0, *(np.flatnonzero(np.diff(seconds)) + 1).tolist(), len(seconds)]
        ends: list[tuple[int, int, Floats]] = []
        for first, end in pairwise(cuts):
            while self._second < seconds[first]:
                silent = not self._count.any()
                ends.append(self._end())
                # Of a long silence the first and the last second are enough.
                self._second = max(self._second + 1, int(seconds[first]) - 1 if silent else 0)
            self._add(segment, first, end)
        if ends:
            t_boot_us, t_rx_us = (np.array([end[at] for end in ends], np.int64) for at in (0, 1))
            numbers = np.array([end[2] for end in ends])
            parts = (numbers[:, :2], numbers[:, 2:4], numbers[:, 4])
            paths = [path_of(self._key, "streams", panel) for panel in STREAM_PANELS]
            times = Times(boot=segment.boot, t_boot_us=t_boot_us, t_rx_us=t_rx_us)
            yield Rows(times, numbers=dict(zip(paths, parts, strict=True)))

    def _add(self, segment: BootSegment, first: int, end: int) -> None:
        """Take messages of the present second."""
        message, t_us = segment.message[first:end], segment.t_boot_us[first:end]
        for stream in range(2):
            mine: Int64s = t_us[message == stream]
            if len(mine):
                gaps = np.diff(mine, prepend=self._latest_us[stream])
                self._age_us[stream] = np.fmax(self._age_us[stream], np.nanmax(gaps, initial=0.0))
                self._latest_us[stream] = mine[-1]
                self._count[stream] += len(mine)
        self._t_boot_us, self._t_rx_us = int(segment.t_boot_us[end - 1]), int(segment.t_rx_us[end - 1])
        self._lost, self._received = int(segment.lost[end - 1]), int(segment.received[end - 1])

    def _end(self) -> tuple[int, int, Floats]:
        """What the present second comes to, at its end."""
        end_us = (self._second + 1) * _S_US
        age_us = np.fmax(self._age_us, end_us - self._latest_us)
        age_us[np.isnan(self._latest_us)] = np.nan
        lost, received = self._lost - self._before[0], self._received - self._before[1]
        share = 100.0 * lost / (lost + received) if lost + received > 0 else np.nan
        numbers = np.concatenate((self._count, age_us / 1e6, [share]))
        self._count, self._age_us, self._before = np.zeros(2), np.zeros(2), (self._lost, self._received)
        return end_us, self._t_rx_us + end_us - self._t_boot_us if self._t_rx_us > 0 else -1, numbers


def rate_rows(key: VehicleId, stretch: Stretch) -> Iterator[Rows]:
    """Body rates by the gyro and, at the same times, by the attitude; deg/s."""
    seen = stretch.seen
    if seen is not None:
        w_b_rad_s = seen.w0_b_rad_s + seen.place[:, None] * (seen.w1_b_rad_s - seen.w0_b_rad_s)
        times = Times(boot=stretch.boot, t_boot_us=seen.t_boot_us, t_rx_us=seen.t_rx_us)
        rates = np.degrees(np.column_stack((seen.w_b_rad_s, w_b_rad_s)))
        yield Rows(times, numbers={path_of(key, "rates_deg_s"): rates})
