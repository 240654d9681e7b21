"""Decides which samples of two streams form a pair, one sample after the other in order of arrival.

So what is paired cannot depend on how the samples were cut into batches.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s
from gcs_bridge.jit import helper, kernel

EULER, QUATERNION = 0, 1  # the two streams
RING = 1024  # samples of each stream that can still find a partner; a power of two
_FIRST_ROOM = 16  # samples that there is room for at first: many components send no more
_BLOCK = 32  # sample intervals behind each estimate of a stream's period
_FIRST_BLOCK = 8
_FASTER = 1.25  # ratio of periods from which a stream counts as the slower one
_LATE_US = 1_000_000  # how far back a late sample may still find a partner at its own instant
MATCH = np.dtype(
    [
        ("completed_by", "i8"),  # index in the batch of the sample that completed the pair
        ("slower", "i8"),  # EULER or QUATERNION
        ("same", "i8"),  # 1: same instant, `before` and `after` are that sample of the other stream
        ("sample", "i8"),  # position of the slower stream's sample, counted since the boot
        ("before", "i8"),  # positions of the faster stream's samples on both sides of it
        ("after", "i8"),
        ("duration_us", "i8"),  # the time that this pair judges
    ]
)
_INTERPOLATED, _SAME_INSTANT = 1, 2  # how a sample was paired
# Slots of `MatchState.of`, one row a stream.
_COUNT, _ORDERED, _LATEST, _INTERVALS, _WAITING, _PERIOD, _RX_PERIOD, _RX_START = range(8)
UNKNOWN = -1


class MatchState(NamedTuple):
    """What the matching remembers within one boot."""

    of: Int64s  # (2, 8) counters, see above
    slower: Int64s  # (1,)
    time: Int64s  # (2, room) by position; the room is a power of two and grows up to RING
    paired: Int64s  # (2, room) by position: 0, or how it was paired
    ordered: Int64s  # (2, room) positions whose time is later than all before
    waiting: Int64s  # (2, room) positions that wait for a partner
    interval: Int64s  # (2, _BLOCK)

    @property
    def n_waiting(self) -> int:
        """How many samples wait for a partner."""
        return int(self.of[:, _WAITING].sum())

    def with_room(self, more: int) -> MatchState:
        """The same with room for `more` samples of each stream, or for as many as can still find a partner."""
        room = self.time.shape[1]
        needed = min(int(self.of[:, _COUNT].max()) + more, RING)
        if room >= needed:
            return self
        room = max(_FIRST_ROOM, 1 << (needed - 1).bit_length())
        # As long as there is room for all, a position is its place too.
        rings = {name: _rings(room, getattr(self, name)) for name in ("time", "paired", "ordered", "waiting")}
        return self._replace(**rings)


def _rings(room: int, filled: Int64s) -> Int64s:
    """A ring a stream (2, room), filled so far as `filled`."""
    rings = np.zeros((2, room), np.int64)
    rings[:, : filled.shape[1]] = filled
    return rings


def new_match_state() -> MatchState:
    """Before a boot's first sample."""
    none = np.empty((2, 0), np.int64)
    of = np.zeros((2, 8), np.int64)
    of[:, [_LATEST, _PERIOD, _RX_PERIOD]] = UNKNOWN
    return MatchState(
        of=of,
        slower=np.full(1, UNKNOWN),
        time=none,
        paired=none,
        ordered=none,
        waiting=none,
        interval=np.zeros((2, _BLOCK), np.int64),
    )


# Helpers of the kernel carry no types: numba types them anew wherever they are compiled into it.


@helper
def _median(values, n):  # type: ignore[no-untyped-def]  # typed by numba
    """The lower median of the first `n` values, which it sorts: they are few."""
    for i in range(1, n):
        value = values[i]
        j = i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return values[(n - 1) // 2]


@helper
def _follow_period(state, k, t, t_rx):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the interval before a sample into the running estimate of its stream's period: the median of a block."""
    of = state.of[k]
    if of[_LATEST] == UNKNOWN:
        of[_RX_START] = t_rx
        return
    n = of[_INTERVALS]
    state.interval[k, n] = t - of[_LATEST]
    n += 1
    if n == _BLOCK or (n == _FIRST_BLOCK and of[_PERIOD] == UNKNOWN):
        of[_PERIOD] = _median(state.interval[k], n)
    if n == _BLOCK:
        if t_rx >= 0:
            of[_RX_PERIOD] = max((t_rx - of[_RX_START]) // n, 0)
        of[_RX_START] = t_rx
        n = 0
    of[_INTERVALS] = n


@helper
def _decide_slower(state):  # type: ignore[no-untyped-def]  # typed by numba
    """Which stream is the slower one, once both periods are known; it changes only with a clear ratio."""
    euler, quaternion = state.of[0, _PERIOD], state.of[1, _PERIOD]
    if euler == UNKNOWN or quaternion == UNKNOWN:
        return
    if euler > _FASTER * quaternion:
        state.slower[0] = EULER
    elif quaternion > _FASTER * euler or state.slower[0] == UNKNOWN:
        # At equal rates firmwares send ATTITUDE first, so its partner is there when the quaternion comes.
        state.slower[0] = QUATERNION


@helper
def _same_instant(state, k, t):  # type: ignore[no-untyped-def]  # typed by numba
    """Position of the sample of stream `k` at exactly `t`, −1 if there is none that still wants its partner.

    One that was compared with its neighbours while its partner was overtaken still does.
    """
    last = state.time.shape[1] - 1
    if state.of[k, _LATEST] < t:
        return UNKNOWN
    count = state.of[k, _COUNT]
    for position in range(count - 1, max(count - RING, 0) - 1, -1):
        time = state.time[k, position & last]
        if time == t and state.paired[k, position & last] != _SAME_INSTANT:
            return position
        if time < t - _LATE_US:
            break
    return UNKNOWN


@helper
def _ordered_after(state, k, t):  # type: ignore[no-untyped-def]  # typed by numba
    """Index in `ordered` of the first sample of stream `k` behind `t`; the one before it is at or before `t`."""
    last = state.time.shape[1] - 1
    n = state.of[k, _ORDERED]
    index = n
    while index > max(n - RING, 0) and state.time[k, state.ordered[k, (index - 1) & last] & last] > t:
        index -= 1
    return index


@helper
def _stands_for(state, slower, position, max_gap_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Time since the slower stream's sample before the one at `position`, three periods at the most.

    0 for one that came late: the one behind it stands for its time already.
    """
    last = state.time.shape[1] - 1
    k = QUATERNION if slower == UNKNOWN else slower
    t = state.time[k, position & last]
    index = _ordered_after(state, k, t) - 1
    if index - 1 < max(state.of[k, _ORDERED] - RING, 0):
        return np.int64(0)
    if state.ordered[k, index & last] != position:
        return np.int64(0)
    since = t - state.time[k, state.ordered[k, (index - 1) & last] & last]
    period = state.of[k, _PERIOD]
    return min(since, 3 * period if period != UNKNOWN else max_gap_us)


@helper
def _pair_waiting(state, k, completed_by, max_gap_us, matches, n):  # type: ignore[no-untyped-def]  # typed by numba
    """Pair the waiting samples of the slower stream `k` that the other stream has by now passed."""
    last = state.time.shape[1] - 1
    other = 1 - k
    left = 0
    for i in range(state.of[k, _WAITING]):
        position = state.waiting[k, i]
        if state.of[k, _COUNT] - position >= RING or state.paired[k, position & last]:
            continue
        t = state.time[k, position & last]
        if t >= state.of[other, _LATEST]:
            state.waiting[k, left] = position
            left += 1
            continue
        index = _ordered_after(state, other, t)
        if index - 1 < max(state.of[other, _ORDERED] - RING, 0):
            continue
        before = state.ordered[other, (index - 1) & last]
        after = state.ordered[other, index & last]
        gap = state.time[other, after & last] - state.time[other, before & last]
        if state.of[other, _COUNT] - before >= RING or gap > max_gap_us:
            continue
        state.paired[k, position & last] = _INTERPOLATED
        match = matches[n]
        match.completed_by, match.slower, match.same = completed_by, k, 0
        match.sample, match.before, match.after = position, before, after
        match.duration_us = _stands_for(state, k, position, max_gap_us)
        n += 1
    state.of[k, _WAITING] = left
    return n


@kernel
def match_kernel(
    stream: Int64s, t_us: Int64s, t_rx_us: Int64s, max_gap_us: int, state: MatchState, matches: npt.NDArray[np.void],
    periods: Int64s,
) -> int:  # fmt: skip
    """Find the pairs that each sample completes, in order of arrival; fill `matches` and `periods`, return how many.

    There must be room in `state` for as many samples of each stream.
    """
    n, last = 0, state.time.shape[1] - 1
    for i in range(stream.size):
        k = stream[i]
        other = 1 - k
        t = t_us[i]
        position = state.of[k, _COUNT]
        state.time[k, position & last] = t
        state.paired[k, position & last] = 0
        state.of[k, _COUNT] += 1
        in_order = t > state.of[k, _LATEST]
        if in_order:
            _follow_period(state, k, t, t_rx_us[i])
            _decide_slower(state)
            state.ordered[k, state.of[k, _ORDERED] & last] = position
            state.of[k, _ORDERED] += 1
            state.of[k, _LATEST] = t
        slower = state.slower[0]
        partner = _same_instant(state, other, t)
        if partner != UNKNOWN:
            was_judged = state.paired[other, partner & last]
            state.paired[k, position & last] = _SAME_INSTANT
            state.paired[other, partner & last] = _SAME_INSTANT
            match = matches[n]
            match.completed_by, match.same = i, 1
            match.slower = QUATERNION if slower == UNKNOWN else slower
            match.sample = position if k == match.slower else partner
            match.before = match.after = partner if k == match.slower else position
            match.duration_us = 0 if was_judged else _stands_for(state, match.slower, match.sample, max_gap_us)
            n += 1
        elif slower != other and state.of[k, _WAITING] < RING:
            state.waiting[k, state.of[k, _WAITING]] = position
            state.of[k, _WAITING] += 1
        if slower != UNKNOWN:
            state.of[1 - slower, _WAITING] = 0
            n = _pair_waiting(state, slower, i, max_gap_us, matches, n)
        periods[i, 0] = state.of[k, _PERIOD]
        periods[i, 1] = state.of[k, _RX_PERIOD]
    return n
