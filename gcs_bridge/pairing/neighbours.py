"""Samples of a stream by their order in time: where an instant lies among them, and which came late."""

from __future__ import annotations

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, record, running_max


def first_at_or_behind(t: Floats, series: Floats, within: float) -> tuple[Int64s, Mask]:
    """Where in a series (k,) of increasing times the first one is that is not before `t` (n,); k: there is none.

    And whether it is as good as at `t` (n,): not further away than `within`, which may be before `t` too.
    """
    at = np.searchsorted(series, t - within)
    same = at < len(series)
    same[same] = np.abs(series[at[same]] - t[same]) <= within
    return at, same


@record
class Track(FrameColumns):
    """n samples in order of arrival: `t_us` (n,) since boot, `rows` (n, k) what they hold."""

    t_us: Int64s
    rows: Floats


def in_order(t_us: Int64s, latest_us: int) -> Int64s:
    """The rows of samples that are later than all before them."""
    return np.flatnonzero(t_us > running_max(t_us, latest_us)[:-1])
