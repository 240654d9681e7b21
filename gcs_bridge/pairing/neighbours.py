"""Finds, for the samples of one stream, their neighbours in time in another, on both sides and as they come.

A query is answered by the first sample at or behind its time, so an answer rests on what had arrived by then and never
on how the streams were cut into batches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gcs_bridge.columns import Floats, Int64s

_LATE_US = 1_000_000  # a query this much older than the series, when it comes, is not answered
_PENDING = 1024  # queries that can wait


@dataclass(frozen=True)
class Track:
    """n samples in order of arrival: `t_us` (n,), `frame_index` (n,) of their frames, `rows` (n, k) what they hold."""

    t_us: Int64s
    frame_index: Int64s
    rows: Floats

    def __len__(self) -> int:
        return len(self.t_us)

    def __getitem__(self, picked: Any) -> Track:
        """The samples of a slice, mask or index array."""
        return Track(self.t_us[picked], self.frame_index[picked], self.rows[picked])

    def then(self, other: Track) -> Track:
        """These samples, and `other` behind them."""
        return Track(
            np.concatenate((self.t_us, other.t_us)),
            np.concatenate((self.frame_index, other.frame_index)),
            np.concatenate((self.rows, other.rows)),
        )


def no_track(width: int) -> Track:
    """A track without samples, with rows of `width`."""
    return Track(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, width)))


class Answers(NamedTuple):
    """n answered queries, in the order in which they were: `query`, and the neighbours `before` and `after` it.

    A sample at the query's very time is the one after; where nothing is near before it, it is both. `frame_index` (n,)
    is of the frame that completed each.
    """

    query: Track
    before: Track
    after: Track
    frame_index: Int64s

    @property
    def place(self) -> Floats:
        """Where between its neighbours each query lies (n,): 0 at the one before, 1 at the one behind."""
        gap_us = self.after.t_us - self.before.t_us
        return np.asarray((self.query.t_us - self.before.t_us) / np.maximum(gap_us, 1))  # both the same: 0

    @property
    def gap_s(self) -> Floats:
        """From neighbour to neighbour (n,), s."""
        return np.asarray((self.after.t_us - self.before.t_us) * 1e-6)


class Lookup:
    """Answers the queries of one stream by the samples of another, within one boot."""

    def __init__(self, query_width: int, series_width: int, max_gap_us: int) -> None:
        """Start before the first sample; neighbours further apart than `max_gap_us` are none."""
        self._max_gap_us = max_gap_us
        self._series = no_track(series_width)
        self._pending = no_track(query_width)

    def feed(self, series: Track, queries: Track) -> Answers:
        """Take what came of both streams; return the queries that can be answered now."""
        past = int(self._series.t_us[-1]) if len(self._series) else -1
        latest = np.maximum.accumulate(np.concatenate(([past], series.t_us)))
        held = self._series.then(series[series.t_us > latest[:-1]])  # what comes late is nobody's neighbour
        at_arrival = np.searchsorted(held.frame_index, queries.frame_index) - 1
        known = at_arrival >= 0
        on_time = ~known
        on_time[known] = held.t_us[at_arrival[known]] - queries.t_us[known] <= _LATE_US
        waiting = self._pending.then(queries if on_time.all() else queries[on_time])
        behind = np.searchsorted(held.t_us, waiting.t_us)
        self._pending = waiting[behind == len(held)][-_PENDING:]
        at = np.flatnonzero(behind < len(held))
        t_us, asked, behind = waiting.t_us[at], waiting.frame_index[at], behind[at]
        before = np.maximum(behind - 1, 0)
        near = (held.t_us[behind] - held.t_us[before] <= self._max_gap_us) & (behind > 0)
        exact = held.t_us[behind] == t_us
        before[exact & ~near] = behind[exact & ~near]
        frame_index = np.maximum(asked, held.frame_index[behind])
        order = np.flatnonzero(near | exact)
        order = order[np.lexsort((asked[order], frame_index[order]))]
        found = Answers(waiting[at[order]], held[before[order]], held[behind[order]], frame_index[order])
        if len(held):
            keep_us = held.t_us[-1] - _LATE_US - self._max_gap_us
            kept = min(int(np.searchsorted(held.t_us, keep_us)), len(held) - 1)
            self._series = held[kept:]
        return found


def in_order(t_us: Int64s, latest_us: int) -> Int64s:
    """The rows of samples that are later than all before them."""
    latest = np.maximum.accumulate(np.concatenate(([latest_us], t_us)))
    return np.flatnonzero(t_us > latest[:-1])
