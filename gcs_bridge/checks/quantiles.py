"""Quantiles of a stream of numbers, in memory that does not grow.

A histogram with logarithmic bins (the idea of DDSketch, Masson, Rim and Lee, VLDB 2019): a quantile is the mean of the
values in its bin, so within 0.1 % of a value that was seen. The largest value and an exact zero are exact.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

_SMALLEST = 1e-12  # anything below counts as zero
_LARGEST = 1e4
_LOG_RATIO = math.log(1.001)
_BINS = math.ceil(math.log(_LARGEST / _SMALLEST) / _LOG_RATIO) + 1


class Quantiles:
    """Collects numbers of zero and above, up to 10,000 (in whatever unit); NaN is passed over."""

    def __init__(self) -> None:
        """Start empty."""
        self.count = 0
        self.max = math.nan
        self._bins: tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]] | None = None  # counts and sums; 0: zeros

    def add(self, values: npt.NDArray[np.float64]) -> None:
        """Take the values, in their order: the sums do not depend on how a stream was cut."""
        values = values[~np.isnan(values)]
        if not values.size:
            return
        if self._bins is None:
            self._bins = np.zeros(_BINS + 1, np.int64), np.zeros(_BINS + 1)
        self.count += values.size
        self.max = float(np.fmax(self.max, values.max()))
        bins = np.ceil(np.log(np.maximum(values, _SMALLEST) / _SMALLEST) / _LOG_RATIO).astype(np.int64)
        bins = np.minimum(bins, _BINS)
        counts, sums = self._bins
        np.add.at(counts, bins, 1)
        np.add.at(sums, bins, values)

    def quantile(self, share: float) -> float:
        """The value that `share` of the numbers do not exceed (nearest rank); NaN while empty."""
        if self._bins is None:
            return math.nan
        counts, sums = self._bins
        rank = max(math.ceil(share * self.count), 1)
        index = int(np.searchsorted(np.cumsum(counts), rank))
        return min(float(sums[index] / counts[index]), self.max)

    def summary(self, scale: float = 1.0) -> dict[str, float]:
        """Median, p95, p99 and max, each times `scale`; NaN while empty."""
        at = {"median": self.quantile(0.5), "p95": self.quantile(0.95), "p99": self.quantile(0.99), "max": self.max}
        return {name: value * scale for name, value in at.items()}
