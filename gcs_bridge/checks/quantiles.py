"""Quantiles of a stream of numbers, in memory that does not grow.

A histogram with logarithmic bins (the idea of DDSketch, Masson, Rim and Lee, VLDB 2019): a quantile is the mean of the
values in its bin, so within 0.1 % of a value that was seen. The largest value and an exact zero are exact.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.jit import helper, kernel

_SMALLEST = 1e-12  # anything below counts as zero
_LARGEST = 1e4
_PER_LOG = 1.0 / math.log(1.001)  # bins
_FIRST = math.log(_SMALLEST) * _PER_LOG
_BINS = math.ceil(math.log(_LARGEST / _SMALLEST) * _PER_LOG) + 1
_BLOCK = 128  # bins, a factor of 1.14 between numbers, for which there is room as soon as one of them is needed
_BLOCKS = _BINS // _BLOCK + 1
_FEW, _MANY = 64, 8192  # numbers that can wait to be counted: at first, and before they are


class Waiting(NamedTuple):
    """Where a kernel puts numbers down that are to be counted."""

    value: Floats  # (room,)
    waiting: Int64s  # (1,) how many of them are taken


@helper
def note(numbers: Any, value: Any) -> Any:
    """Put one number down; there must be room."""
    numbers.value[numbers.waiting[0]] = value
    numbers.waiting[0] += 1


class Quantiles:
    """Collects numbers of zero and above, up to 10,000 (in whatever unit); NaN is passed over."""

    def __init__(self) -> None:
        """Start empty."""
        self._bins: _Bins | None = None  # many a check never judges anything
        self._waiting = Waiting(value=np.empty(0), waiting=np.zeros(1, np.int64))
        self._left = 0  # of its room, at the least

    def room(self, more: int) -> Waiting:
        """Where a kernel may put down so many numbers more: they are counted some thousand at a time."""
        self._left -= more
        if self._left < 0:
            self._make_room(more)
        return self._waiting

    def _make_room(self, more: int) -> None:
        """See that there is as much as `room` promises: kernels may have put down less than they were given it for."""
        waiting = self._waiting
        taken = waiting.waiting.item()
        if taken + more > len(waiting.value):
            if taken + more > _MANY:
                self._settle()
                taken = 0
            if taken + more > len(self._waiting.value):
                value = np.empty(max(taken + more, min(2 * (taken + more), _MANY), _FEW))
                value[:taken] = self._waiting.value[:taken]
                self._waiting = self._waiting._replace(value=value)
        self._left = len(self._waiting.value) - taken - more

    def _settle(self) -> None:
        """Count what waits."""
        taken = int(self._waiting.waiting[0])
        if taken:
            self._waiting.waiting[0] = 0
            self.add(self._waiting.value[:taken])

    @property
    def count(self) -> int:
        """How many numbers were taken."""
        self._settle()
        return 0 if self._bins is None else self._bins.count

    @property
    def max(self) -> float:
        """The largest number; NaN while empty."""
        self._settle()
        return math.nan if self._bins is None else self._bins.largest

    def add(self, values: Floats) -> None:
        """Take the values, in their order: the sums do not depend on how a stream was cut."""
        self._settle()
        if self._bins is None:
            if np.isnan(values).all():
                return
            self._bins = _Bins()
        self._bins.add(values)

    def quantile(self, share: float) -> float:
        """The value that `share` of the numbers do not exceed (nearest rank); NaN while empty."""
        self._settle()
        if self._bins is None:
            return math.nan
        return min(self._bins.mean_at(max(math.ceil(share * self._bins.count), 1)), self._bins.largest)

    def summary(self, scale: float = 1.0) -> dict[str, float]:
        """Median, p95, p99 and max, each times `scale`; NaN while empty."""
        at = {"median": self.quantile(0.5), "p95": self.quantile(0.95), "p99": self.quantile(0.99), "max": self.max}
        return {name: value * scale for name, value in at.items()}


class _Bins:
    """Counts and sums of bins, 0 to _BINS (0: zeros), by blocks that are kept in the order in which they were needed.

    All together take 590 kB, a residual's numbers lie in some of them.
    """

    def __init__(self) -> None:
        self._place = np.full(_BLOCKS, -1)  # of each block; −1: none of its bins was needed yet
        self._kept = np.zeros(1, np.int64)
        self._counts = np.zeros(_BLOCK, np.int64)
        self._sums = np.zeros(_BLOCK)
        self._largest = np.full(1, math.nan)

    def add(self, values: Floats) -> None:
        """Take the values (n,), each into its bin; NaN is passed over."""
        row = 0
        while (
            row := count_values(values, row, self._place, self._kept, self._counts, self._sums, self._largest)
        ) < len(values):
            self._counts = np.append(self._counts, np.zeros_like(self._counts))  # twice the room: copied seldom
            self._sums = np.append(self._sums, np.zeros_like(self._sums))

    @property
    def count(self) -> int:
        """How many values were taken."""
        return int(self._counts.sum())

    @property
    def largest(self) -> float:
        """The largest of them; NaN: there was none."""
        return float(self._largest[0])

    def mean_at(self, rank: int) -> float:
        """The mean of the values in the bin of the one with this rank, from 1 on, in ascending order."""
        places = self._place[self._place >= 0]  # in the order of the bins
        counts = self._counts.reshape(-1, _BLOCK)[places].ravel()
        index = int(np.searchsorted(np.cumsum(counts), rank))
        sums = self._sums.reshape(-1, _BLOCK)[places].ravel()
        return float(sums[index] / counts[index])


@kernel
def count_values(
    values: Floats, row: int, place: Int64s, kept: Int64s, counts: Int64s, sums: Floats, largest: Floats
) -> int:
    """Count values (n,) from `row` on; return at which one there was no room left for its block of bins, n: at none.

    `largest` (1,) is the largest so far, NaN before the first.
    """
    for i in range(row, values.size):
        value = values[i]
        if np.isnan(value):
            continue
        number = int(min(np.ceil(np.log(value) * _PER_LOG - _FIRST), _BINS)) if value > _SMALLEST else 0
        block = number // _BLOCK
        if place[block] < 0:
            if (kept[0] + 1) * _BLOCK > counts.size:
                return i
            place[block] = kept[0]
            kept[0] += 1
        at = place[block] * _BLOCK + number % _BLOCK
        counts[at] += 1
        sums[at] += value
        if not largest[0] >= value:  # NaN is not
            largest[0] = value
    return values.size
