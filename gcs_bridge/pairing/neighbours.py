"""Finds, for the samples of one stream, their neighbours in time in another, on both sides and as they come.

A query is answered by the first sample at or behind its time, so an answer rests on what had arrived by then and never
on how the streams were cut into batches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, running_max

_LATE_US = 1_000_000  # a query this much older than the series, when it comes, is not answered
_PENDING = 1024  # queries that can wait
NumbersT = TypeVar("NumbersT", Int64s, Floats)


def first_at_or_behind(t: NumbersT, series: NumbersT, within: float = 0) -> tuple[Int64s, Mask]:
    """Where in a series (k,) of increasing times the first one is that is not before `t` (n,); k: there is none.

    And whether it is of the same instant (n,): not further away than `within`, which may be before `t` too.
    """
    at = np.searchsorted(series, t - within if within else t)
    same = at < len(series)
    same[same] = np.abs(series[at[same]] - t[same]) <= within
    return at, same


@dataclass(frozen=True, kw_only=True)
class Track(FrameColumns):
    """n samples in order of arrival: `t_us` (n,) since boot, `rows` (n, k) what they hold."""

    t_us: Int64s
    rows: Floats


def no_track(width: int) -> Track:
    """A track without samples, with rows of `width`."""
    return Track(frame_index=np.empty(0, np.int64), t_us=np.empty(0, np.int64), rows=np.empty((0, width)))


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
        held = self._series.then(series[in_order(series.t_us, past)])  # what comes late is nobody's neighbour
        at_arrival = np.searchsorted(held.frame_index, queries.frame_index) - 1
        known = at_arrival >= 0
        on_time = ~known
        on_time[known] = held.t_us[at_arrival[known]] - queries.t_us[known] <= _LATE_US
        waiting = self._pending.then(queries.where(on_time))
        behind, exact = first_at_or_behind(waiting.t_us, held.t_us)
        self._pending = waiting[behind == len(held)][-_PENDING:]
        at = np.flatnonzero(behind < len(held))
        asked, behind, exact = waiting.frame_index[at], behind[at], exact[at]
        before = np.maximum(behind - 1, 0)
        near = (held.t_us[behind] - held.t_us[before] <= self._max_gap_us) & (behind > 0)
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
    return np.flatnonzero(t_us > running_max(t_us, latest_us)[:-1])
