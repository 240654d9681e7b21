"""Which samples of two streams carry the same stamp: the one place in which that is looked for."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs_bridge.columns import Int64Rows, Int64s
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.state import UNKNOWN

_NO_RING = -1  # all bits: a position is its place


@helper
def at_instant(t_us: Any, last: Any, end: Any, oldest: Any, at_us: Any, late_us: Any) -> Any:
    """The last position from `oldest` on and before `end` whose sample is of the instant `at_us`; UNKNOWN: none.

    `t_us`: a ring, `last` its last place, its room a power of two; or an array, −1. No sample came by more than
    `late_us` behind one with a later time: 0 where all are in order.
    """
    for position in range(end - 1, oldest - 1, -1):
        time_us = t_us[position & last]
        if time_us == at_us:
            return position
        if time_us < at_us - late_us:
            break
    return UNKNOWN


class Stamps(NamedTuple):
    """Samples (n,) of one stream, in order of arrival and of their time."""

    frame_index: Int64s
    t_us: Int64s


@kernel
def match_kernel(a: Stamps, b: Stamps, after: int, reach: int, rows: Int64Rows, count: Int64s) -> None:
    """Fill in the pairs of one instant: `rows` (2, room), those of `a` and of `b`; `count` (1,) of them.

    As `same_instants`; there is room for as many as there are samples in the shorter stream.
    """
    i, j, n = 0, 0, 0
    while i < a.t_us.size or j < b.t_us.size:
        if j == b.t_us.size or (i < a.t_us.size and a.frame_index[i] < b.frame_index[j]):
            if a.frame_index[i] > after:
                partner = at_instant(b.t_us, _NO_RING, j, max(j - reach, 0), a.t_us[i], 0)
                if partner != UNKNOWN:
                    rows[0, n], rows[1, n] = i, partner
                    n += 1
            i += 1
        else:
            if b.frame_index[j] > after:
                partner = at_instant(a.t_us, _NO_RING, i, max(i - reach, 0), b.t_us[j], 0)
                if partner != UNKNOWN:
                    rows[0, n], rows[1, n] = partner, j
                    n += 1
            j += 1
    count[0] = n


def same_instants(a: Stamps, b: Stamps, after: int, reach: int) -> tuple[Int64s, Int64s]:
    """The rows (k,), (k,) of the pairs of one instant in two streams, in the order in which they were completed.

    Of those that were completed after the frame `after`; a sample finds its partner among the last `reach` that came of
    the other stream.
    """
    rows, count = np.empty((2, min(len(a.t_us), len(b.t_us))), np.int64), np.empty(1, np.int64)
    match_kernel(a, b, after, reach, rows, count)
    n = int(count[0])
    return rows[0, :n], rows[1, :n]
