"""Pairs the samples of two streams, and follows each stream's steps, one sample after the other in order of arrival.

So what is paired, and what a pair is worth, cannot depend on how the samples were cut into batches.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_bridge.columns import Int64Rows, Int64s
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.instants import at_instant
from gcs_bridge.pairing.periods import decide_slower, follow_period
from gcs_bridge.pairing.state import (
    COLUMNS,
    COUNT,
    EULER,
    INTERPOLATED,
    LATEST,
    ORDERED,
    PERIOD,
    QUATERNION,
    RING,
    RX_PERIOD,
    SAME_INSTANT,
    UNKNOWN,
    WAITING,
    Came,
    PairState,
    keep,
)
from gcs_bridge.pairing.values import Limits, PairRows, StepRows, pair_at_once, pair_between, step_to

_LATE_US = 1_000_000  # how far back a late sample may still find a partner at its own instant


@helper
def _same_instant(state: Any, k: Any, t: Any) -> Any:
    """Position of the sample of stream `k` at exactly `t`, UNKNOWN if there is none that still wants its partner.

    One that was compared with its neighbours while its partner was overtaken still does.
    """
    if state.of[k, LATEST] < t:
        return UNKNOWN
    last, count = state.time.shape[1] - 1, state.of[k, COUNT]
    oldest = max(count - RING, 0)
    position = at_instant(state.time[k], last, count, oldest, t, _LATE_US)
    while position != UNKNOWN and state.paired[k, position & last] == SAME_INSTANT:
        position = at_instant(state.time[k], last, position, oldest, t, _LATE_US)
    return position


@helper
def _ordered_after(state: Any, k: Any, t: Any) -> Any:
    """Index in `ordered` of the first sample of stream `k` behind `t`; the one before it is at or before `t`."""
    last = state.time.shape[1] - 1
    n = state.of[k, ORDERED]
    index = n
    while index > max(n - RING, 0) and state.time[k, state.ordered[k, (index - 1) & last] & last] > t:
        index -= 1
    return index


@helper
def _stands_for(state: Any, slower: Any, position: Any, max_gap_us: Any) -> Any:
    """Time since the slower stream's sample before the one at `position`, three periods at the most.

    0 for one that came late: the one behind it stands for its time already.
    """
    last = state.time.shape[1] - 1
    k = QUATERNION if slower == UNKNOWN else slower
    t = state.time[k, position & last]
    index = _ordered_after(state, k, t) - 1
    if index - 1 < max(state.of[k, ORDERED] - RING, 0):
        return np.int64(0)
    if state.ordered[k, index & last] != position:
        return np.int64(0)
    since = t - state.time[k, state.ordered[k, (index - 1) & last] & last]
    period = state.of[k, PERIOD]
    return min(since, 3 * period if period != UNKNOWN else max_gap_us)


@helper
def _stamp(came: Any, i: Any) -> Any:
    """Whether sample `i` is valid, its frame, and its times."""
    return came.valid[i], came.frame_index[i], came.t_us[i], came.t_rx_us[i]


@helper
def _pair_waiting(state: Any, k: Any, limits: Any, pairs: Any, n: Any) -> Any:
    """Pair the waiting samples of the slower stream `k` that the other stream has by now passed."""
    last = state.time.shape[1] - 1
    other = 1 - k
    left = 0
    for i in range(state.of[k, WAITING]):
        position = state.waiting[k, i]
        if state.of[k, COUNT] - position >= RING or state.paired[k, position & last]:
            continue
        t = state.time[k, position & last]
        if t >= state.of[other, LATEST]:
            state.waiting[k, left] = position
            left += 1
            continue
        index = _ordered_after(state, other, t)
        if index - 1 < max(state.of[other, ORDERED] - RING, 0):
            continue
        before = state.ordered[other, (index - 1) & last]
        after = state.ordered[other, index & last]
        gap = state.time[other, after & last] - state.time[other, before & last]
        if state.of[other, COUNT] - before >= RING or gap > limits.max_gap_us:
            continue
        state.paired[k, position & last] = INTERPOLATED
        pair_between(state, k, position, before, after, limits, pairs, n)
        pairs.duration_us[n] = _stands_for(state, k, position, limits.max_gap_us)
        n += 1
    state.of[k, WAITING] = left
    return n


@kernel
def pair_kernel(
    stream: Int64s, euler: Came, quaternion: Came, limits: Limits, state: PairState, pairs: PairRows, steps: StepRows,
    periods: Int64Rows, counts: Int64s,
) -> None:  # fmt: skip
    """Take messages (n,) in order of arrival: of `stream` 0 and 1 the next sample of each, others are passed over.

    Fills pairs and steps, and with each valid sample its stream's `periods` (2, n); `counts` (5,) is how many steps of
    both streams, pairs, and samples of both streams. There must be room in `state` for as many samples of each stream.
    """
    for slot in range(counts.size):
        counts[slot] = 0
    n, last = 0, state.time.shape[1] - 1
    for at in range(stream.size):
        periods[0, at] = periods[1, at] = UNKNOWN
        k = stream[at]
        if k > QUATERNION:
            continue
        i = counts[3 + k]
        counts[3 + k] += 1
        is_valid, frame_index, t, t_rx_us = _stamp(euler, i) if k == EULER else _stamp(quaternion, i)
        if not is_valid or t == state.of[k, LATEST]:  # a second one of an instant tells nothing new of it
            continue
        other = 1 - k
        position = state.of[k, COUNT]
        if k == EULER:
            keep(state, k, position, euler, i)
        else:
            keep(state, k, position, quaternion, i)
        state.of[k, COUNT] += 1
        if t > state.of[k, LATEST]:
            if state.of[k, LATEST] != UNKNOWN:
                counts[k] = step_to(state, k, position, frame_index, limits, steps, counts[k])
            for column in range(COLUMNS):
                state.latest[k, column] = state.rows[k, position & last, column]
            follow_period(state, k, t, t_rx_us)
            decide_slower(state)
            state.ordered[k, state.of[k, ORDERED] & last] = position
            state.of[k, ORDERED] += 1
            state.of[k, LATEST] = t
        slower = state.slower[0]
        first = n
        partner = _same_instant(state, other, t)
        if partner != UNKNOWN:
            was_judged = state.paired[other, partner & last]
            state.paired[k, position & last] = state.paired[other, partner & last] = SAME_INSTANT
            of = QUATERNION if slower == UNKNOWN else slower
            sample, there = (position, partner) if k == of else (partner, position)
            pair_at_once(state, of, sample, there, limits, pairs, n)
            pairs.duration_us[n] = 0 if was_judged else _stands_for(state, of, sample, limits.max_gap_us)
            n += 1
        elif slower != other and state.of[k, WAITING] < RING:
            state.waiting[k, state.of[k, WAITING]] = position
            state.of[k, WAITING] += 1
        if slower != UNKNOWN:
            state.of[1 - slower, WAITING] = 0
            n = _pair_waiting(state, slower, limits, pairs, n)
        for pair in range(first, n):
            pairs.frame_index[pair], pairs.t_rx_us[pair] = frame_index, t_rx_us
        periods[0, at], periods[1, at] = state.of[k, PERIOD], state.of[k, RX_PERIOD]
    counts[2] = n
