"""AHRS2 from the wire: the second estimate's roll, pitch and yaw in rad; it has neither a time of its own nor rates.

It is stamped midway between the timed messages on both sides; the last ones wait for the next timed message.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import FloatRows, Int64Rows, Int64s, Mask, Records
from gcs_bridge.jit import kernel
from gcs_bridge.mavlink.decode import float_in, offsets
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.attitudes import turn_of_rpy
from gcs_bridge.telemetry.clocks import BOOT, FRAME_INDEX, T_BOOT_US, TimedMessages
from gcs_bridge.telemetry.messages import KIND
from gcs_bridge.telemetry.samples import AHRS2, Ahrs2Samples, room_for_ahrs2
from gcs_bridge.telemetry.sorting import Share, SortedFrames

_KIND = KIND[AHRS2]
_NONE = room_for_ahrs2(0)
WAITING = np.dtype([("frame_index", "i8"), ("t_rx_us", "i8"), ("rpy_rad", "f8", (3,))])


@kernel
def _read_ahrs2(
    frames: Frames,
    buffer: Bytes,
    by_message: Int64s,
    start: int,
    end: int,
    first: int,
    in_window: Mask,
    at: Int64s,
    timed: Int64Rows,
    boot_before: int,
    us_before: int,
    waiting: Annotated[Records, WAITING],
    waits: int,
    frame_index: Int64s,
    boot: Int64s,
    t_boot_us: Int64s,
    t_rx_us: Int64s,
    q_nb: FloatRows,
    valid: Mask,
    rpy_rad: FloatRows,
    gap_us: Int64s,
) -> tuple[int, int]:
    """Let each AHRS2 from `start` to `end` of `by_message` wait, and stamp those that wait, `waits` so far.

    `timed`: the timed messages of the component, and before them the boot and time last believed. Return how many have
    a time now, and how many wait.
    """
    for i in range(start, end):
        row = by_message[i]
        if in_window[row]:
            frame, one = frames[row], waiting[waits]
            payload = (buffer, np.int64(frame.payload), np.int64(frame.length))
            one.frame_index, one.t_rx_us = first + row, frame.t_rx_us
            for axis in range(3):
                one.rpy_rad[axis] = float_in(payload, at[axis])
            waits += 1
    n = left = behind = 0
    for i in range(waits):
        one = waiting[i]
        while behind < timed.shape[1] and timed[FRAME_INDEX, behind] < one.frame_index:
            boot_before, us_before = timed[BOOT, behind], timed[T_BOOT_US, behind]
            behind += 1
        if us_before < 0:  # no time was known when it came
            continue
        if behind == timed.shape[1]:
            waiting[left] = one
            left += 1
        elif timed[BOOT, behind] == boot_before:
            us_behind = timed[T_BOOT_US, behind]
            frame_index[n], boot[n], t_rx_us[n] = timed[FRAME_INDEX, behind], boot_before, one.t_rx_us
            t_boot_us[n], gap_us[n] = (us_before + us_behind) // 2, abs(us_behind - us_before)
            has_started = False  # as long as all three are exactly zero
            for axis in range(3):
                rpy_rad[n, axis] = one.rpy_rad[axis]
                has_started |= rpy_rad[n, axis] != 0.0
            valid[n] = turn_of_rpy(rpy_rad, q_nb, n) and has_started
            n += 1
    return n, left


class Ahrs2Reader:
    """Reads the second estimate of one vehicle."""

    def __init__(self, dialect: Dialect) -> None:
        """Start with nothing heard."""
        self._at = offsets(dialect[AHRS2], "roll", "pitch", "yaw") if AHRS2 in dialect else None
        self._waiting: npt.NDArray[np.void] = np.empty(0, WAITING)
        self._waits = 0

    def read(self, batch: SortedFrames, share: Share, timed: TimedMessages) -> Ahrs2Samples:
        """The samples, in the window, whose time is known by now; `timed`: the vehicle's timed messages."""
        most = self._waits + share.counts[_KIND]
        if not most or self._at is None:
            return _NONE
        if most > len(self._waiting):
            room = np.empty(2 * most, WAITING)
            room[: self._waits] = self._waiting[: self._waits]
            self._waiting = room
        samples = room_for_ahrs2(most)
        assert samples.rpy_rad is not None
        n, self._waits = _read_ahrs2(
            batch.frames,
            batch.buffer,
            batch.by_message,
            share.starts[_KIND],
            share.starts[_KIND + 1],
            batch.first,
            batch.in_window,
            self._at,
            timed.columns,
            *timed.before,
            self._waiting,
            self._waits,
            samples.frame_index,
            samples.boot,
            samples.t_boot_us,
            samples.t_rx_us,
            samples.q_nb,
            samples.valid,
            samples.rpy_rad,
            samples.gap_us,
        )
        return samples.first(n)
