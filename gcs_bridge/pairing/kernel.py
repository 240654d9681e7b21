"""Pairs the samples of two streams, and follows each stream's steps, one sample after the other in order of arrival.

So what is paired, and what a pair is worth, cannot depend on how the samples were cut into batches.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple, TypeVar

import numpy as np

from gcs_bridge.attitude._rows import where
from gcs_bridge.attitude.compiled import put, unit_at, vector_of
from gcs_bridge.attitude.kinematics import interpolated
from gcs_bridge.attitude.quaternion import conjugated, length, product
from gcs_bridge.columns import FloatRows, Floats, Int64Rows, Int64s, Mask, MaskRows
from gcs_bridge.jit import helper, kernel, share
from gcs_bridge.pairing.bounds import (
    KIN_PER_CHANGE,
    KIN_PER_TURN,
    interpolation_bound_of,
    turn_and_kin_of,
)

share(turn_and_kin_of, interpolation_bound_of)

NumbersT = TypeVar("NumbersT", Int64s, Floats)
EULER, QUATERNION = 0, 1  # the two streams
RING = 1024  # samples of each stream that can still find a partner; a power of two
_FIRST_ROOM = 16  # samples that there is room for at first: many components send no more
_BLOCK = 32  # sample intervals behind each estimate of a stream's period
_FIRST_BLOCK = 8
_FASTER = 1.25  # ratio of periods from which a stream counts as the slower one
_LATE_US = 1_000_000  # how far back a late sample may still find a partner at its own instant
_INTERPOLATED, _SAME_INSTANT = 1, 2  # how a sample was paired
# Slots of `PairState.of`, one row a stream.
_COUNT, _ORDERED, _LATEST, _INTERVALS, _WAITING, _PERIOD, _RX_PERIOD, _RX_START = range(8)
# Columns of `PairState.rows`: what is kept of a sample, and of the step that led to it.
_Q, _W = 0, 4  # four: unit quaternion; three: body rates, rad/s
_KIN = 7  # rad by which the step differs from what the rates say
_DENIED = 8  # whether the rates contradict it
_UNSTEADY = 9  # rad/s by which the rates may be off at the sample, as the step shows them
_APPLIED = 10  # four: the quaternion from expected to sent, body side
_EXPECTED = 14  # which difference was undone: another number for another one
_COLUMNS = 15
UNKNOWN = -1


class PairState(NamedTuple):
    """What the pairing remembers within one boot."""

    of: Int64Rows  # (2, 8) counters, see above
    slower: Int64s  # (1,)
    time: Int64Rows  # (2, room) by position; the room is a power of two and grows up to RING
    rows: Annotated[Floats, 3]  # (2, room, 15) by position
    latest: FloatRows  # (2, 15) of the latest sample in order
    paired: Int64Rows  # (2, room) by position: 0, or how it was paired
    ordered: Int64Rows  # (2, room) positions whose time is later than all before
    waiting: Int64Rows  # (2, room) positions that wait for a partner
    interval: Int64Rows  # (2, _BLOCK)

    @property
    def n_waiting(self) -> int:
        """How many samples wait for a partner."""
        return int(self.of[:, _WAITING].sum())

    def with_room(self, more: int) -> PairState:
        """The same with room for `more` samples of each stream, or for as many as can still find a partner."""
        room = self.time.shape[1]
        needed = min(int(self.of[:, _COUNT].max()) + more, RING)
        if room >= needed:
            return self
        room = max(_FIRST_ROOM, 1 << (needed - 1).bit_length())
        # As long as there is room for all, a position is its place too.
        rings = {name: _rings(room, getattr(self, name)) for name in ("time", "paired", "ordered", "waiting")}
        return self._replace(rows=_rings(room, self.rows), **rings)


def _rings(room: int, filled: NumbersT) -> NumbersT:
    """A ring a stream (2, room, …), filled so far as `filled`."""
    rings = np.zeros((2, room, *filled.shape[2:]), filled.dtype)
    rings[:, : filled.shape[1]] = filled
    return rings


def new_pair_state() -> PairState:
    """Before a boot's first sample."""
    none = np.empty((2, 0), np.int64)
    of = np.zeros((2, 8), np.int64)
    of[:, [_LATEST, _PERIOD, _RX_PERIOD]] = UNKNOWN
    return PairState(
        of=of,
        slower=np.full(1, UNKNOWN),
        time=none,
        rows=np.empty((2, 0, _COLUMNS)),
        latest=np.zeros((2, _COLUMNS)),
        paired=none,
        ordered=none,
        waiting=none,
        interval=np.zeros((2, _BLOCK), np.int64),
    )


class Came(NamedTuple):
    """Samples (n,) of one stream as they came, valid or not."""

    frame_index: Int64s
    t_us: Int64s
    t_rx_us: Int64s
    q_nb: FloatRows  # (n, 4) what is expected undone
    q_sent: FloatRows  # (n, 4) as sent; (0, 4): nothing was undone
    expected: Int64s  # (n,) which difference was; (0,): the same in all samples so far
    w_b_rad_s: FloatRows  # (n, 3)
    valid: Mask


class StepRows(NamedTuple):
    """Where the steps of both streams go: as `Steps` of `pairing.steps`, each with room (2, n)."""

    frame_index: Int64Rows
    t0_us: Int64Rows
    t1_us: Int64Rows
    q0_nb: Annotated[Floats, 3]
    q1_nb: Annotated[Floats, 3]
    w0_b_rad_s: Annotated[Floats, 3]
    w1_b_rad_s: Annotated[Floats, 3]
    turn_b_rad: Annotated[Floats, 3]
    rate_residual_rad: FloatRows
    limit_rad: FloatRows
    contradicts_rates: MaskRows


class PairRows(NamedTuple):
    """Where the pairs go: as `Pairs` of `pairing.pairs`, with room (n,)."""

    frame_index: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    same_instant: Mask
    q_euler: FloatRows
    q_quaternion: FloatRows
    q_euler_sent: FloatRows
    w_nb_b_rad_s: FloatRows
    w_differs_b_rad_s: FloatRows
    unsteady_rad_s: Floats
    bound_rad: Floats
    after_reset: Mask
    interval_id: Int64s
    duration_us: Int64s


class Limits(NamedTuple):
    """Of the pairing."""

    max_gap_us: int
    same_instant_bound_rad: float
    step_rad: float
    per_rate_s: float


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
def _three(row, at):  # type: ignore[no-untyped-def]  # typed by numba
    """Three numbers of a row."""
    return row[at], row[at + 1], row[at + 2]


@helper
def _four(row, at):  # type: ignore[no-untyped-def]  # typed by numba
    """Four numbers of a row."""
    return row[at], row[at + 1], row[at + 2], row[at + 3]


@helper
def _step_to(state, k, position, frame_index, limits, steps, n):  # type: ignore[no-untyped-def]  # typed by numba
    """Put down the step from the stream's latest sample to the one at `position`; how many steps there are then."""
    last = state.time.shape[1] - 1
    row, before = state.rows[k, position & last], state.latest[k]
    t0_us, t1_us = state.of[k, _LATEST], state.time[k, position & last]
    h = (t1_us - t0_us) * 1e-6
    q0, q1 = _four(before, _Q), _four(row, _Q)
    w0, w1 = _three(before, _W), _three(row, _W)
    phi, kin = turn_and_kin_of(q0, q1, w0, w1, h)
    rate, change = np.maximum(length(w0), length(w1)), length((w1[0] - w0[0], w1[1] - w0[1], w1[2] - w0[2]))
    limit = limits.step_rad + limits.per_rate_s * rate + 1.5 * h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
    # A step that hardly turned was not a step, whatever the rates made of it.
    denied = kin > limit and length(phi) > limits.step_rad
    # Across a change of what is undone there is no step of the vehicle.
    changed = before[_EXPECTED] != row[_EXPECTED]
    kin, denied = where(changed, np.nan, kin), denied and not changed
    row[_KIN], row[_DENIED], row[_UNSTEADY] = kin, denied, change + 2.0 * kin / h
    steps.frame_index[k, n], steps.t0_us[k, n], steps.t1_us[k, n] = frame_index, t0_us, t1_us
    put(q0, steps.q0_nb[k], n)
    put(q1, steps.q1_nb[k], n)
    for axis in range(3):
        steps.w0_b_rad_s[k, n, axis], steps.w1_b_rad_s[k, n, axis] = w0[axis], w1[axis]
    put(phi, steps.turn_b_rad[k], n)
    steps.rate_residual_rad[k, n], steps.limit_rad[k, n], steps.contradicts_rates[k, n] = kin, limit, denied
    return n + 1


@helper
def _stamp(came, i):  # type: ignore[no-untyped-def]  # typed by numba
    """Whether sample `i` is valid, its frame, and its times."""
    return came.valid[i], came.frame_index[i], came.t_us[i], came.t_rx_us[i]


@helper
def _keep(state, k, position, came, i):  # type: ignore[no-untyped-def]  # typed by numba
    """Remember sample `i`, of which no step is known yet."""
    at = position & (state.time.shape[1] - 1)
    row = state.rows[k, at]
    state.time[k, at] = came.t_us[i]
    state.paired[k, at] = 0
    q = unit_at(came.q_nb, i)
    for axis in range(4):
        row[_Q + axis], row[_APPLIED + axis] = q[axis] + 0.0, 0.0
    row[_APPLIED] = 1.0
    # Where nothing was undone nothing is put back either, to the last bit: another batch may not ask.
    if came.q_sent.shape[0] and _four(came.q_sent[i], 0) != _four(came.q_nb[i], 0):
        applied = product(conjugated(q), _four(came.q_sent[i], 0))
        for axis in range(4):
            row[_APPLIED + axis] = applied[axis] + 0.0
    for axis in range(3):
        row[_W + axis] = came.w_b_rad_s[i, axis]
    row[_EXPECTED] = came.expected[i] if came.expected.size else 0
    row[_KIN], row[_DENIED], row[_UNSTEADY] = np.inf, 0.0, np.nan


@helper
def _begin_pair(state, slower, sample, row, pairs, n):  # type: ignore[no-untyped-def]  # typed by numba
    """What every pair has, whatever its partner: time, and the slower stream's own attitude."""
    pairs.t_boot_us[n] = state.time[slower, sample & (state.time.shape[1] - 1)]
    q = pairs.q_euler if slower == EULER else pairs.q_quaternion
    for axis in range(4):
        q[n, axis] = row[axis]


@helper
def _resend(pairs, n, row):  # type: ignore[no-untyped-def]  # typed by numba
    """Put back into the Euler side what was expected of its sample."""
    put(product(_four(pairs.q_euler[n], 0), _four(row, _APPLIED)), pairs.q_euler_sent, n)


@helper
def _pair_at_once(state, slower, sample, partner, limits, pairs, n):  # type: ignore[no-untyped-def]  # typed by numba
    """A pair of one instant; the rates of both are compared, unless one reports none and sends zeros."""
    last = state.time.shape[1] - 1
    row, other = state.rows[slower, sample & last], state.rows[1 - slower, partner & last]
    _begin_pair(state, slower, sample, row, pairs, n)
    q = pairs.q_quaternion if slower == EULER else pairs.q_euler
    for axis in range(4):
        q[n, axis] = other[axis]
    reported = length(_three(row, _W)) != 0.0 and length(_three(other, _W)) != 0.0
    sign = 1.0 if slower == EULER else -1.0
    for axis in range(3):
        pairs.w_nb_b_rad_s[n, axis] = other[_W + axis]
        pairs.w_differs_b_rad_s[n, axis] = sign * (other[_W + axis] - row[_W + axis]) if reported else np.nan
    # The calmer one's: a stream whose rates are wrong finds its own step unsteady, and would excuse itself.
    pairs.unsteady_rad_s[n] = np.fmin(row[_UNSTEADY], other[_UNSTEADY])
    pairs.same_instant[n], pairs.after_reset[n], pairs.interval_id[n] = True, False, -1
    pairs.bound_rad[n] = limits.same_instant_bound_rad
    _resend(pairs, n, row if slower == EULER else other)


@helper
def _pair_between(state, slower, sample, before, after, limits, pairs, n):  # type: ignore[no-untyped-def]  # typed by numba
    """A pair with the faster stream interpolated between two of its samples (rule M18), and the bound of that."""
    last = state.time.shape[1] - 1
    row, fast = state.rows[slower, sample & last], 1 - slower
    _begin_pair(state, slower, sample, row, pairs, n)
    rows = state.rows[fast]
    one, two = rows[before & last], rows[after & last]
    t0_us = state.time[fast, before & last]
    gap_us = state.time[fast, after & last] - t0_us
    u, h = (pairs.t_boot_us[n] - t0_us) / gap_us, gap_us * 1e-6
    q0, q1 = unit_at(rows, before & last), unit_at(rows, after & last)
    own, w0, w1 = _three(row, _W), _three(one, _W), _three(two, _W)
    q, w = interpolated(q0, q1, vector_of(w0[0], w0[1], w0[2]), vector_of(w1[0], w1[1], w1[2]), h, u)
    put(q, pairs.q_quaternion if slower == EULER else pairs.q_euler, n)
    put(w, pairs.w_nb_b_rad_s, n)
    for axis in range(3):
        pairs.w_differs_b_rad_s[n, axis] = np.nan
    pairs.unsteady_rad_s[n] = np.nan
    pairs.same_instant[n], pairs.interval_id[n] = False, after
    pairs.after_reset[n] = two[_DENIED] != 0.0 and one[_DENIED] == 0.0
    pairs.bound_rad[n] = limits.same_instant_bound_rad + interpolation_bound_of(
        w0, w1, own, w, two[_KIN], row[_KIN], h, u
    )
    _resend(pairs, n, row if slower == EULER else two)


@helper
def _pair_waiting(state, k, limits, pairs, n):  # type: ignore[no-untyped-def]  # typed by numba
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
        if state.of[other, _COUNT] - before >= RING or gap > limits.max_gap_us:
            continue
        state.paired[k, position & last] = _INTERPOLATED
        _pair_between(state, k, position, before, after, limits, pairs, n)
        pairs.duration_us[n] = _stands_for(state, k, position, limits.max_gap_us)
        n += 1
    state.of[k, _WAITING] = left
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
        if not is_valid or t == state.of[k, _LATEST]:  # a second one of an instant tells nothing new of it
            continue
        other = 1 - k
        position = state.of[k, _COUNT]
        if k == EULER:
            _keep(state, k, position, euler, i)
        else:
            _keep(state, k, position, quaternion, i)
        state.of[k, _COUNT] += 1
        if t > state.of[k, _LATEST]:
            if state.of[k, _LATEST] != UNKNOWN:
                counts[k] = _step_to(state, k, position, frame_index, limits, steps, counts[k])
            for column in range(_COLUMNS):
                state.latest[k, column] = state.rows[k, position & last, column]
            _follow_period(state, k, t, t_rx_us)
            _decide_slower(state)
            state.ordered[k, state.of[k, _ORDERED] & last] = position
            state.of[k, _ORDERED] += 1
            state.of[k, _LATEST] = t
        slower = state.slower[0]
        first = n
        partner = _same_instant(state, other, t)
        if partner != UNKNOWN:
            was_judged = state.paired[other, partner & last]
            state.paired[k, position & last] = state.paired[other, partner & last] = _SAME_INSTANT
            of = QUATERNION if slower == UNKNOWN else slower
            sample, there = (position, partner) if k == of else (partner, position)
            _pair_at_once(state, of, sample, there, limits, pairs, n)
            pairs.duration_us[n] = 0 if was_judged else _stands_for(state, of, sample, limits.max_gap_us)
            n += 1
        elif slower != other and state.of[k, _WAITING] < RING:
            state.waiting[k, state.of[k, _WAITING]] = position
            state.of[k, _WAITING] += 1
        if slower != UNKNOWN:
            state.of[1 - slower, _WAITING] = 0
            n = _pair_waiting(state, slower, limits, pairs, n)
        for pair in range(first, n):
            pairs.frame_index[pair], pairs.t_rx_us[pair] = frame_index, t_rx_us
        periods[0, at], periods[1, at] = state.of[k, _PERIOD], state.of[k, _RX_PERIOD]
    counts[2] = n
