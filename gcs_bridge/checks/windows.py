"""What checks remember of the last seconds: sums, and how fast a stream turned.

Times and numbers: what they are of is not known here.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs_bridge.columns import FloatRows, Floats, Int64s
from gcs_bridge.jit import helper

TOO_SLOW = "its motion is too fast for the streams: between two samples it swings further than they tell"
_WORTH_SAYING = 0.01  # of the samples
_LATELY = 4  # gaps before this one
_TOLD_RAD = math.radians(20.0)
_SHORT_S = 0.12  # 10 Hz and above
_TOLD_SHORT_RAD = math.radians(45.0)
_FADES_GAPS = 5.0  # to half
_SWINGS_S = 20.0
PEAK = 1.5  # of a swing above its root mean square, 1.41 of a sine
_FEW = 16  # samples that there is room for at first

# Slots of `Sliding.of`.
_WINDOW_US, _FIRST, _END = range(3)


class Sliding(NamedTuple):
    """What a kernel is given of sums over the last seconds."""

    of: Int64s  # (3,) how long the window is, µs; the samples from `first` up to `end` are in it
    t_us: Int64s  # (room,) of each sample
    before: FloatRows  # (room + 1, width) the running sum, from the boot on, before each
    sums: Floats  # (width,) of the samples in the window


@helper
def slide_in(sliding: Any, t_us: Any, row: Any) -> Any:
    """Take a sample, later than all before, with its numbers `row`; there must be room.

    Then `sums` are over the window that ends with it. Returns of how many samples they are, and since when, µs. One
    running sum goes from the boot on, one row after the other: the bits are the same however the samples were cut.
    """
    of, before, end = sliding.of, sliding.before, sliding.of[_END]
    sliding.t_us[end] = t_us
    for column in range(len(row)):
        before[end + 1, column] = before[end, column] + row[column]
    first = of[_FIRST]
    while sliding.t_us[first] <= t_us - of[_WINDOW_US]:
        first += 1
    for column in range(len(row)):
        sliding.sums[column] = before[end + 1, column] - before[first, column]
    of[_FIRST], of[_END] = first, end + 1
    return end + 1 - first, sliding.t_us[first]


@helper
def told_by_rates(turning: Any, speed0: Any, speed1: Any, gap_s: Any) -> Any:
    """Whether the rates at both ends of the next gap, in order of time, tell what was between them.

    They do not where the stream may have turned far, as fast as it turned of late. `turning`: of `new_turning`.
    """
    for i in range(_LATELY, 0, -1):
        turning[i] = turning[i - 1]
    turning[0] = speed1 if speed0 != speed0 or speed1 > speed0 else speed0  # the faster one that is known
    told = True
    for i in range(_LATELY + 1):
        turned = turning[i] * gap_s
        told &= turned <= _TOLD_RAD or (gap_s <= _SHORT_S and turned <= _TOLD_SHORT_RAD)
    return told


@helper
def follow_swing(swing: Any, missed: Any, dt_s: Any, gap_s: Any) -> Any:
    """Take how far one account of the turn across a gap `missed` it, rad/s, and return by how much it may miss now.

    In the mean square over the last gaps, and over so long a time as a slow beat of the motion with the samples may
    hide it. `swing`: of `new_swing`.
    """
    squared = missed * missed
    swing[0] += (1.0 - 0.5 ** (dt_s / (_FADES_GAPS * max(gap_s, 1e-3)))) * (squared - swing[0])
    swing[1] += min(dt_s / _SWINGS_S, 1.0) * (squared - swing[1])
    return PEAK * np.sqrt(max(swing[0], swing[1]))


def too_slow_for(slow: int, judged: int) -> str | None:
    """What there is to say of samples too `slow` for the motion, beside those judged; None: hardly any, or all."""
    if not judged or slow < _WORTH_SAYING * (slow + judged):
        return None
    return f"{slow} of {slow + judged} samples are not judged: {TOO_SLOW}"


def new_swing() -> Floats:
    """How far an account of a stream's turns misses them (2,): lately, rad/s, and over longer times, squared."""
    return np.zeros(2)


def new_turning() -> Floats:
    """How fast a stream turned over its last gaps (5,), rad/s, the latest first: before a boot's first sample."""
    return np.zeros(_LATELY + 1)


class SlidingSums:
    """Sums of rows over the last seconds, within one boot."""

    def __init__(self, window_s: float, width: int) -> None:
        """Start empty; rows have `width` columns."""
        self._sliding = Sliding(
            of=np.array([round(window_s * 1e6), 0, 0]),
            t_us=np.empty(_FEW, np.int64),
            before=np.zeros((_FEW + 1, width)),
            sums=np.zeros(width),
        )

    def room(self, samples: int) -> Sliding:
        """What a kernel is given to take so many samples more."""
        sliding = self._sliding
        if sliding.of.item(_END) + samples > len(sliding.t_us):
            first, end = sliding.of[_FIRST:].tolist()
            kept = end - first
            room = max(len(sliding.t_us), 2 * kept + samples)  # moved to the front once in `kept` samples at most
            t_us, before = np.empty(room, np.int64), np.empty((room + 1, len(sliding.sums)))
            t_us[:kept], before[: kept + 1] = sliding.t_us[first:end], sliding.before[first : end + 1]
            sliding.of[_FIRST:] = 0, kept
            self._sliding = sliding = sliding._replace(t_us=t_us, before=before)
        return sliding
