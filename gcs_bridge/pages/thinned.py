"""Curves of bounded length, however long the recording is, that keep every peak that can be seen."""

from __future__ import annotations

import numpy as np

from gcs_bridge.columns import Floats, Int64s, Mask

__all__ = ["Thinned"]

_SPANS = 1200  # at least, once there is so much: a screen has about as many columns


class Thinned:
    """Rows of some curves over time; of each short span the rows stay that hold the least or the most of any curve.

    While there are few, all of them stay. A row behind a gap stays too, and is known as such.
    """

    def __init__(self, curves: int, gap_us: int = 2_000_000) -> None:
        """Start empty; a gap is what is longer than `gap_us`."""
        self._t_us: Int64s = np.empty(0, np.int64)
        self._values: Floats = np.empty((0, curves))
        self._behind_gap: Mask = np.empty(0, np.bool_)
        self._most = _SPANS * (2 * curves + 1)
        self._gap_us = gap_us
        self._span_us = 0  # 0: nothing was left out yet
        self._latest_us: int | None = None

    def take(self, t_us: Int64s, values: Floats) -> None:
        """Take n more rows (n,), (n, curves), NaN where a curve has no value; times that go back are left out."""
        if not len(t_us):
            return
        before = t_us[0] if self._latest_us is None else self._latest_us
        ahead = np.maximum.accumulate(np.concatenate(([before], t_us)))
        rows = np.flatnonzero((t_us > ahead[:-1]) | ((self._latest_us is None) & (np.arange(len(t_us)) == 0)))
        if not len(rows):
            return
        steps = np.diff(t_us[rows], prepend=before)
        self._latest_us = int(t_us[rows[-1]])
        self._t_us = np.concatenate((self._t_us, t_us[rows]))
        self._values = np.concatenate((self._values, values[rows]))
        self._behind_gap = np.concatenate((self._behind_gap, steps > self._gap_us))
        if len(self._t_us) > 2 * self._most:
            self._thin()

    def rows(self) -> tuple[Int64s, Floats]:
        """Times (n,), µs, and values (n, curves); a row of NaN stands before each that lies behind a gap."""
        if self._span_us:
            self._thin()
        at = np.flatnonzero(self._behind_gap)
        t_us = np.insert(self._t_us, at, self._t_us[at] - 1)
        return t_us, np.insert(self._values, at, np.nan, axis=0)

    def _thin(self) -> None:
        lasts_us = int(self._t_us[-1] - self._t_us[0])
        self._span_us = max(self._span_us, lasts_us // (2 * _SPANS), 1)
        while len(kept := self._kept()) > self._most and self._span_us * _SPANS < 2 * lasts_us:
            self._span_us *= 2
        self._t_us, self._values, self._behind_gap = self._t_us[kept], self._values[kept], self._behind_gap[kept]

    def _kept(self) -> Int64s:
        """The rows that stay."""
        span = self._t_us // self._span_us
        first = np.flatnonzero(np.diff(span, prepend=span[0] - 1))
        which = np.cumsum(np.diff(span, prepend=span[0]) != 0)
        kept = [first, np.flatnonzero(self._behind_gap)]
        for values in self._values.T:
            known = np.flatnonzero(~np.isnan(values))
            order = known[np.lexsort((values[known], which[known]))]
            ends = np.flatnonzero(np.diff(which[order], prepend=-1))
            kept += [order[ends], order[np.append(ends[1:], len(order)) - 1][: len(ends)]]
        return np.unique(np.concatenate(kept))
