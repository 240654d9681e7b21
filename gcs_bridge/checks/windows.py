"""What checks remember of the last seconds: sums, and how fast a stream turned.

Times and numbers: what they are of is not known here.
"""

from __future__ import annotations

import math

import numpy as np

from gcs_bridge.checks.base import length
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask
from gcs_bridge.jit import kernel


class Turning:
    """How fast a stream turned of late: rates at the ends of a gap say nothing of it where it may have turned far."""

    def __init__(self) -> None:
        """Start with no sample."""
        self._recent: Floats = np.empty(0)

    def told_by_rates(self, w0_b_rad_s: Floats, w1_b_rad_s: Floats, gap_s: Floats) -> Mask:
        """Where rates at both ends (n, 3) of gaps (n,), in order of time, tell what was between them."""
        if not len(gap_s):
            return np.zeros(0, np.bool_)
        fastest = np.fmax(length(w0_b_rad_s), length(w1_b_rad_s))
        held = np.concatenate((self._recent, fastest))
        self._recent = held[max(len(held) - _LATELY, 0) :]
        padded, n = np.concatenate((np.zeros(_LATELY), held)), len(fastest)
        rate = np.maximum.reduce([padded[len(padded) - n - gaps : len(padded) - gaps] for gaps in range(_LATELY + 1)])
        return np.asarray((rate * gap_s <= _TOLD_RAD) | ((gap_s <= _SHORT_S) & (rate * gap_s <= _TOLD_SHORT_RAD)))


_LATELY = 4  # gaps before this one
_TOLD_RAD = math.radians(20.0)
_SHORT_S = 0.12  # 10 Hz and above
_TOLD_SHORT_RAD = math.radians(45.0)


class SlidingSums:
    """Sums of rows over the last seconds, within one boot."""

    def __init__(self, window_s: float, width: int) -> None:
        """Start empty; rows have `width` columns."""
        self._window_us = round(window_s * 1e6)
        self._t_us: Int64s = np.empty(0, np.int64)
        self._sums = np.zeros((1, width))  # up to each sample kept; the first: before them all

    def feed(self, t_us: Int64s, rows: Floats) -> tuple[Floats, Int64s, Int64s]:
        """Take samples in order of time; per sample the sums, how many they are of, and since when, µs."""
        n, held = len(t_us), len(self._t_us)
        times = np.concatenate((self._t_us, t_us))
        totals = np.concatenate((self._sums, np.empty_like(rows)))
        sums, count, since_us = np.empty_like(rows), np.empty(n, np.int64), np.empty(n, np.int64)
        first = slide(times, totals, held, rows, self._window_us, sums, count, since_us)
        self._t_us, self._sums = times[first:], totals[first:]
        return sums, count, since_us


@kernel
def slide(
    t_us: Int64s,
    totals: FloatRows,
    held: int,
    rows: FloatRows,
    window_us: int,
    sums: FloatRows,
    count: Int64s,
    since_us: Int64s,
) -> int:
    """Fill the sums of `rows` (n, k) over the last `window_us`; return from which of the times on these are needed.

    `t_us` (held + n,), `totals` (held + n + 1, k): one running sum from the boot on, taken one row after the other, so
    that the bits are the same however the samples were cut; up to `held` it is filled.
    """
    first = 0
    for i in range(rows.shape[0]):
        at = held + i
        while t_us[first] <= t_us[at] - window_us:
            first += 1
        for column in range(rows.shape[1]):
            totals[at + 1, column] = totals[at, column] + rows[i, column]
            sums[i, column] = totals[at + 1, column] - totals[first, column]
        count[i] = at + 1 - first
        since_us[i] = t_us[first]
    return first
