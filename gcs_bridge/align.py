"""Two sampled descriptions of one attitude → pairs at one instant, each with a bound on the error of its alignment.

Samples of the same `time_boot_ms` are a pair. Any other sample of the slower stream is compared with the faster one,
interpolated at its time: a cubic Hermite in the rotation vector, which uses the body rates at both ends. (The other
way round, or latest against latest, shows tens of degrees on healthy aircraft.) Nothing is interpolated across a
reboot, a gap that is too long, or a step that the stream's own rates deny.

`match_kernel` decides which samples form a pair, one sample after the other in order of arrival, so it cannot depend
on how they were cut into batches. What a pair is worth is computed for all of a batch's pairs at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.mavlink.jit import helper, kernel
from gcs_bridge.samples import AttitudeSamples
from gcs_bridge.settings import AlignmentSettings, ResetSettings

Floats = npt.NDArray[np.float64]
Int64s = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

EULER, QUATERNION = 0, 1  # the two streams

# The error bound of an interpolated attitude, fitted on some 2.5 hours of flight that carry both messages.
RATE_BOUND_S = 0.001  # both stamps are whole milliseconds
KIN_MARGIN_RAD = radians(0.1)
KIN_FLOOR_RAD = radians(0.2)
KIN_PER_RATE_S = 0.002
KIN_PER_CHANGE = 0.5  # of the change of rate over the gap
KIN_PER_TURN = 0.1  # of the turn over the gap
CHANGE_RAD = radians(0.5)  # by which what is expected may change between two samples, trims in turns included
UNREPORTED_TURN_RAD = radians(0.5)  # a step this large between rates of exactly zero: the sender reports no rates

_RING = 1024  # samples of each stream that can still find a partner; a power of two
_LAST = _RING - 1
_BLOCK = 32  # sample intervals behind each estimate of a stream's period
_FIRST_BLOCK = 8
_FASTER = 1.25  # ratio of periods from which a stream counts as the slower one
_LATE_US = 1_000_000  # how far back a late sample may still find a partner at its own instant

MATCH = np.dtype(
    [
        ("trigger", "i8"),  # index in the batch of the sample that completed the pair
        ("slower", "i8"),  # EULER or QUATERNION
        ("same", "i8"),  # 1: same instant, `before` and `after` are that sample of the other stream
        ("sample", "i8"),  # position of the slower stream's sample, counted since the boot
        ("before", "i8"),  # positions of the faster stream's samples on both sides of it
        ("after", "i8"),
        ("stands_for_us", "i8"),  # the time that this pair judges
    ]
)

_INTERPOLATED, _SAME_INSTANT = 1, 2  # how a sample was paired

# Slots of `_State.of`, one row a stream.
_COUNT, _ORDERED, _LATEST, _INTERVALS, _WAITING, _PERIOD, _RX_PERIOD, _RX_START = range(8)
_UNKNOWN = -1


class _State(NamedTuple):
    """What the matching remembers within one boot."""

    of: Int64s  # (2, 8) counters, see above
    slower: Int64s  # (1,)
    time: Int64s  # (2, _RING) by position
    paired: Int64s  # (2, _RING) by position: 0, or how it was paired
    ordered: Int64s  # (2, _RING) positions whose time is later than all before
    waiting: Int64s  # (2, _RING) positions that wait for a partner
    interval: Int64s  # (2, _BLOCK)


def _new_state() -> _State:
    def ring(size: int) -> Int64s:
        return np.zeros((2, size), np.int64)

    state = _State(ring(8), np.full(1, _UNKNOWN), ring(_RING), ring(_RING), ring(_RING), ring(_RING), ring(_BLOCK))
    state.of[:, [_LATEST, _PERIOD, _RX_PERIOD]] = _UNKNOWN
    return state


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
    if of[_LATEST] == _UNKNOWN:
        of[_RX_START] = t_rx
        return
    n = of[_INTERVALS]
    state.interval[k, n] = t - of[_LATEST]
    n += 1
    if n == _BLOCK or (n == _FIRST_BLOCK and of[_PERIOD] == _UNKNOWN):
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
    if euler == _UNKNOWN or quaternion == _UNKNOWN:
        return
    if euler > _FASTER * quaternion:
        state.slower[0] = EULER
    elif quaternion > _FASTER * euler or state.slower[0] == _UNKNOWN:
        # At equal rates firmwares send ATTITUDE first, so its partner is there when the quaternion comes.
        state.slower[0] = QUATERNION


@helper
def _same_instant(state, k, t):  # type: ignore[no-untyped-def]  # typed by numba
    """Position of the sample of stream `k` at exactly `t`, −1 if there is none that still wants its partner.

    One that was compared with its neighbours while its partner was overtaken still does.
    """
    if state.of[k, _LATEST] < t:
        return _UNKNOWN
    count = state.of[k, _COUNT]
    for position in range(count - 1, max(count - _RING, 0) - 1, -1):
        time = state.time[k, position & _LAST]
        if time == t and state.paired[k, position & _LAST] != _SAME_INSTANT:
            return position
        if time < t - _LATE_US:
            break
    return _UNKNOWN


@helper
def _ordered_after(state, k, t):  # type: ignore[no-untyped-def]  # typed by numba
    """Index in `ordered` of the first sample of stream `k` behind `t`; the one before it is at or before `t`."""
    n = state.of[k, _ORDERED]
    index = n
    while index > max(n - _RING, 0) and state.time[k, state.ordered[k, (index - 1) & _LAST] & _LAST] > t:
        index -= 1
    return index


@helper
def _stands_for(state, slower, position, max_gap_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Time since the slower stream's sample before the one at `position`, three periods at the most.

    0 for one that came late: the one behind it stands for its time already.
    """
    k = QUATERNION if slower == _UNKNOWN else slower
    t = state.time[k, position & _LAST]
    index = _ordered_after(state, k, t) - 1
    if index - 1 < max(state.of[k, _ORDERED] - _RING, 0):
        return np.int64(0)
    if state.ordered[k, index & _LAST] != position:
        return np.int64(0)
    since = t - state.time[k, state.ordered[k, (index - 1) & _LAST] & _LAST]
    period = state.of[k, _PERIOD]
    return min(since, 3 * period if period != _UNKNOWN else max_gap_us)


@helper
def _pair_waiting(state, k, trigger, max_gap_us, matches, n):  # type: ignore[no-untyped-def]  # typed by numba
    """Pair the waiting samples of the slower stream `k` that the other stream has by now passed."""
    other = 1 - k
    left = 0
    for i in range(state.of[k, _WAITING]):
        position = state.waiting[k, i]
        if state.of[k, _COUNT] - position >= _RING or state.paired[k, position & _LAST]:
            continue
        t = state.time[k, position & _LAST]
        if t >= state.of[other, _LATEST]:
            state.waiting[k, left] = position
            left += 1
            continue
        index = _ordered_after(state, other, t)
        if index - 1 < max(state.of[other, _ORDERED] - _RING, 0):
            continue
        before = state.ordered[other, (index - 1) & _LAST]
        after = state.ordered[other, index & _LAST]
        gap = state.time[other, after & _LAST] - state.time[other, before & _LAST]
        if state.of[other, _COUNT] - before >= _RING or gap > max_gap_us:
            continue
        state.paired[k, position & _LAST] = _INTERPOLATED
        match = matches[n]
        match.trigger, match.slower, match.same = trigger, k, 0
        match.sample, match.before, match.after = position, before, after
        match.stands_for_us = _stands_for(state, k, position, max_gap_us)
        n += 1
    state.of[k, _WAITING] = left
    return n


@kernel
def match_kernel(
    stream: Int64s, t_us: Int64s, t_rx_us: Int64s, max_gap_us: int, state: _State, matches: npt.NDArray[np.void],
    periods: Int64s,
) -> int:  # fmt: skip
    """Find the pairs that each sample completes, in order of arrival; fill `matches` and `periods`, return how many."""
    n = 0
    for i in range(stream.size):
        k = stream[i]
        other = 1 - k
        t = t_us[i]
        position = state.of[k, _COUNT]
        state.time[k, position & _LAST] = t
        state.paired[k, position & _LAST] = 0
        state.of[k, _COUNT] += 1
        in_order = t > state.of[k, _LATEST]
        if in_order:
            _follow_period(state, k, t, t_rx_us[i])
            _decide_slower(state)
            state.ordered[k, state.of[k, _ORDERED] & _LAST] = position
            state.of[k, _ORDERED] += 1
            state.of[k, _LATEST] = t
        slower = state.slower[0]
        partner = _same_instant(state, other, t)
        if partner != _UNKNOWN:
            was_judged = state.paired[other, partner & _LAST]
            state.paired[k, position & _LAST] = _SAME_INSTANT
            state.paired[other, partner & _LAST] = _SAME_INSTANT
            match = matches[n]
            match.trigger, match.same = i, 1
            match.slower = QUATERNION if slower == _UNKNOWN else slower
            match.sample = position if k == match.slower else partner
            match.before = match.after = partner if k == match.slower else position
            match.stands_for_us = 0 if was_judged else _stands_for(state, match.slower, match.sample, max_gap_us)
            n += 1
        elif slower != other and state.of[k, _WAITING] < _RING:
            state.waiting[k, state.of[k, _WAITING]] = position
            state.of[k, _WAITING] += 1
        if slower != _UNKNOWN:
            state.of[1 - slower, _WAITING] = 0
            n = _pair_waiting(state, slower, i, max_gap_us, matches, n)
        periods[i, 0] = state.of[k, _PERIOD]
        periods[i, 1] = state.of[k, _RX_PERIOD]
    return n


_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


class _Recent:
    """The last samples of one stream since the boot, and for each the step that led to it."""

    def __init__(self) -> None:
        self.first = 0  # position of the first sample kept
        self.t_us: Int64s = np.empty(0, np.int64)
        self.q: Floats = np.empty((0, 4))
        self.w: Floats = np.empty((0, 3))
        self.kin: Floats = np.empty(0)  # rad by which the step differs from what the rates say
        self.denied: Mask = np.empty(0, np.bool_)
        self.unsteady: Floats = np.empty(0)  # rad/s by which the rates may be off at the sample, as its step shows them
        self.meant: Floats | None = None  # (n, 4) from expected to sent, body side; None: there was no difference yet
        self._meant_last: Floats = _IDENTITY[None]
        self._last: tuple[int, Floats, Floats] | None = None  # the latest in order: t_us, q (1, 4), w (1, 3)

    def append(self, t_us: Int64s, q: Floats, w: Floats, reset: ResetSettings, q_sent: Floats | None) -> Steps:
        """Add samples in order of arrival, and return the steps between them; those that come late have none.

        `q_sent` (n, 4) is the attitude as it was sent, where `q` has been relieved of an expected difference.
        """
        n = len(t_us)
        latest = np.maximum.accumulate(np.concatenate(([-1 if self._last is None else self._last[0]], t_us)))
        in_order = np.flatnonzero(t_us > latest[:-1])
        kin, denied, unsteady = np.full(n, np.inf), np.zeros(n, np.bool_), np.full(n, np.nan)
        steps = _NO_STEPS
        meant: Floats | None = None
        if q_sent is not None:
            meant = attitude.multiply(attitude.conjugate(q), q_sent)
        elif self.meant is not None:
            meant = np.broadcast_to(_IDENTITY, (n, 4))
        if len(in_order):
            t, q_in, w_in = t_us[in_order], q[in_order], w[in_order]
            if self._last is not None:
                t = np.concatenate(([self._last[0]], t))
                q_in = np.concatenate((self._last[1], q_in))
                w_in = np.concatenate((self._last[2], w_in))
            if len(t) > 1:
                steps = _steps(in_order[1 - len(t) :], t, q_in, w_in, reset)
                if meant is not None:
                    steps = _without_changes(steps, np.concatenate((self._meant_last, meant[in_order]))[-len(t) :])
                kin[steps.row], denied[steps.row] = steps.kin_rad, steps.denied
                unsteady[steps.row] = _norm(steps.w1_b_rad_s - steps.w0_b_rad_s) + 2.0 * steps.kin_rad / steps.h_s
            self._last = (int(t[-1]), q_in[-1:], w_in[-1:])
            self._meant_last = _IDENTITY[None] if meant is None else meant[in_order[-1:]]
        surplus = max(len(self.t_us) - _RING, 0)
        self.first += surplus
        self.t_us = np.concatenate((self.t_us[surplus:], t_us))
        self.q = np.concatenate((self.q[surplus:], q))
        self.w = np.concatenate((self.w[surplus:], w))
        self.kin = np.concatenate((self.kin[surplus:], kin))
        self.denied = np.concatenate((self.denied[surplus:], denied))
        self.unsteady = np.concatenate((self.unsteady[surplus:], unsteady))
        if meant is not None:
            before = np.broadcast_to(_IDENTITY, (len(self.t_us) - n, 4)) if self.meant is None else self.meant[surplus:]
            self.meant = np.concatenate((before, meant))
        return steps


def _norm(v: Floats) -> Floats:
    return np.asarray(np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2 + v[..., 2] ** 2))


def turn_and_kin(q0: Floats, q1: Floats, w0: Floats, w1: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Of steps of h (...) s: the rotation vector (..., 3), and how far (...), rad, that is from what the rates say.

    `q0`, `q1` (..., 4); `w0`, `w1` (..., 3), rad/s. The second is NaN where the sender reports no rates.
    """
    phi = attitude.rotvec_from_quaternion(attitude.multiply(attitude.conjugate(q0), q1))
    kin = _norm(phi - 0.5 * h[..., None] * (w0 + w1))
    kin[(_norm(w0) == 0) & (_norm(w1) == 0) & (_norm(phi) > UNREPORTED_TURN_RAD)] = np.nan
    return phi, kin


def interpolation_bound_rad(
    w0: Floats, w1: Floats, own: Floats, w: Floats, *, kin_fast: Floats, kin_slow: Floats, h: Floats, u: Floats
) -> Floats:
    """What interpolating at the share u (...) of a gap of h (...) s may add to a disagreement, rad (...).

    Rates (..., 3): `w0`, `w1` the faster stream's at both ends, `own` the slower sample's, `w` the interpolant's.
    `kin_fast` of the step across the gap, `kin_slow` of the slower stream's last one (NaN, inf: unknown).
    """
    # A slower stream that reports no rates has no say; without the faster one's, nothing bounds the error.
    rate = np.fmax(np.maximum(_norm(w0), _norm(w1)), _norm(own))
    change = _norm(w1 - w0)
    kin = np.minimum(kin_fast, np.nan_to_num(kin_slow, nan=np.inf) + KIN_MARGIN_RAD)
    kin = np.minimum(kin, KIN_FLOOR_RAD + KIN_PER_RATE_S * rate + h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate))
    bow = 4.0 * u * (1.0 - u)
    bend = np.where(np.isfinite(own).all(axis=-1), _norm(w - own), 0.0)
    return np.asarray(RATE_BOUND_S * rate + 0.5 * bow * (kin + h * bend))


@dataclass(frozen=True)
class Steps:
    """n steps of one stream, from each sample to the next one in order.

    `row` (n,) of the later sample in the batch; `t0_us`, `t1_us` (n,) boot times; `q0_nb`, `q1_nb` (n, 4);
    `w0_b_rad_s`, `w1_b_rad_s` (n, 3); `turn_b_rad` (n, 3) rotation vector of the step, body axes; `kin_rad` (n,) how
    far that is from what the rates say, NaN where the sender reports no rates; `limit_rad` (n,) what is still no
    contradiction; `denied` (n,) whether the rates deny the step.
    """

    row: Int64s
    t0_us: Int64s
    t1_us: Int64s
    q0_nb: Floats
    q1_nb: Floats
    w0_b_rad_s: Floats
    w1_b_rad_s: Floats
    turn_b_rad: Floats
    kin_rad: Floats
    limit_rad: Floats
    denied: Mask

    def __len__(self) -> int:
        return len(self.row)

    @property
    def h_s(self) -> Floats:
        """How long each step took, s."""
        return np.asarray((self.t1_us - self.t0_us) * 1e-6)


def _no_steps() -> Steps:
    none, q, v, numbers = np.empty(0, np.int64), np.empty((0, 4)), np.empty((0, 3)), np.empty(0)
    return Steps(none, none, none, q, q, v, v, v, numbers, numbers, np.empty(0, np.bool_))


_NO_STEPS = _no_steps()


def _steps(row: Int64s, t_us: Int64s, q: Floats, w: Floats, reset: ResetSettings) -> Steps:
    """The steps between consecutive samples."""
    h: Floats = np.asarray((t_us[1:] - t_us[:-1]) * 1e-6)
    w0, w1 = w[:-1], w[1:]
    phi, kin = turn_and_kin(q[:-1], q[1:], w0, w1, h)
    rate, change = np.maximum(_norm(w0), _norm(w1)), _norm(w1 - w0)
    limit = reset.step_rad + reset.per_rate_s * rate + 1.5 * h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
    # A step that hardly turned was not a step, whatever the rates made of it.
    denied = (kin > limit) & (_norm(phi) > reset.step_rad)
    return Steps(row, t_us[:-1], t_us[1:], q[:-1], q[1:], w0, w1, phi, kin, limit, denied)


def _without_changes(steps: Steps, meant: Floats) -> Steps:
    """The steps without those across which another difference was undone: these are none of the vehicle."""
    changed = attitude.angle_between(meant[:-1], meant[1:]) > CHANGE_RAD
    kin = np.where(changed, np.nan, steps.kin_rad)
    return replace(steps, kin_rad=kin, denied=steps.denied & ~changed)


@dataclass(frozen=True)
class Pairs:
    """n pairs of attitudes at one instant each, in the order in which they were completed.

    `t_boot_us` (n,); `trigger` (n,) index in the batch of the completing sample; `same_instant` (n,);
    `q_euler`, `q_quaternion` (n, 4) unit [w, x, y, z], FRD to NED, `q_euler_sent` (n, 4) with the differences that are
    expected still in it; `w_nb_b_rad_s` (n, 3) body rates at that instant; `w_differs_b_rad_s` (n, 3) the quaternion's
    rates minus the Euler angles', NaN where the instants differ or rates are not reported, and `unsteady_rad_s` (n,)
    what of it the motion explains;
    `bound_rad` (n,) what the alignment alone may make of a perfect agreement, NaN where it can't be told;
    `after_reset` (n,) the faster stream stepped there, alone, against its own rates;
    `bracket` (n,) equal for pairs that rest on the same step of the faster stream, −1 for the same instant;
    `stands_for_us` (n,) the time each pair judges.
    """

    t_boot_us: Int64s
    trigger: Int64s
    same_instant: Mask
    q_euler: Floats
    q_quaternion: Floats
    q_euler_sent: Floats
    w_nb_b_rad_s: Floats
    w_differs_b_rad_s: Floats
    unsteady_rad_s: Floats
    bound_rad: Floats
    after_reset: Mask
    bracket: Int64s
    stands_for_us: Int64s

    def __len__(self) -> int:
        return len(self.t_boot_us)


@dataclass(frozen=True)
class Aligned:
    """A batch's pairs and steps, and per sample its stream's period by then, in boot and receive time (µs, −1)."""

    pairs: Pairs
    period_us: Int64s
    rx_period_us: Int64s
    steps: tuple[Steps, Steps]  # of ATTITUDE and of ATTITUDE_QUATERNION


class Aligner:
    """Pairs ATTITUDE and ATTITUDE_QUATERNION of one vehicle within one boot."""

    def __init__(self, alignment: AlignmentSettings, reset: ResetSettings) -> None:
        """Start before a boot's first sample."""
        self._alignment = alignment
        self._reset = reset
        self._state = _new_state()
        self._recent = (_Recent(), _Recent())

    def pair(
        self,
        euler: AttitudeSamples,
        quaternion: AttitudeSamples,
        order: Int64s,
        q_euler_sent: Floats | None = None,
    ) -> Aligned:
        """The pairs that these samples complete.

        `order` (n,) sorts the two streams' samples, ATTITUDE's first, into their order of arrival; the batch's index
        is the place in that order. `q_euler_sent` are ATTITUDE's own, where `euler` differs from them.
        """
        stream = np.repeat(np.array([EULER, QUATERNION]), [len(euler), len(quaternion)])[order]
        t_us = np.concatenate((euler.t_boot_us, quaternion.t_boot_us))[order]
        t_rx_us = np.concatenate((euler.t_rx_us, quaternion.t_rx_us))[order]
        steps = [_NO_STEPS, _NO_STEPS]
        for k, (recent, samples) in enumerate(zip(self._recent, (euler, quaternion), strict=True)):
            if len(samples):
                q = attitude.normalise(samples.q_nb)
                with np.errstate(invalid="ignore"):  # rates that are no numbers: they explain no step
                    sent = q_euler_sent if k == EULER else None
                    steps[k] = recent.append(samples.t_boot_us, q, samples.w_nb_b_rad_s, self._reset, sent)
        waiting = int(self._state.of[:, _WAITING].sum())
        matches = np.empty(len(stream) + waiting + 1, MATCH)
        periods = np.empty((len(stream), 2), np.int64)
        max_gap_us = round(self._alignment.max_gap_s * 1e6)
        n = match_kernel(stream, t_us, t_rx_us, max_gap_us, self._state, matches, periods)
        with np.errstate(invalid="ignore"):  # rates that are no numbers: the bound is none then
            pairs = self._evaluated(matches[:n])
        return Aligned(pairs, periods[:, 0], periods[:, 1], (steps[0], steps[1]))

    def _evaluated(self, matches: npt.NDArray[np.void]) -> Pairs:
        """The matched samples as pairs, the faster stream interpolated where the instants differ."""
        n = len(matches)
        q_euler = np.empty((n, 4))
        pairs = Pairs(
            np.empty(n, np.int64),
            matches["trigger"].copy(),
            matches["same"] == 1,
            q_euler,
            np.empty((n, 4)),
            q_euler if self._recent[EULER].meant is None else np.empty((n, 4)),
            np.empty((n, 3)),
            np.full((n, 3), np.nan),
            np.full(n, np.nan),
            np.full(n, self._alignment.same_instant_bound_rad),
            np.zeros(n, np.bool_),
            np.where(matches["same"] == 1, -1, matches["after"]),
            matches["stands_for_us"].copy(),
        )
        for slower in (EULER, QUATERNION):
            for same in (True, False):
                rows = np.flatnonzero((matches["slower"] == slower) & (pairs.same_instant == same))
                if len(rows):
                    self._evaluate(pairs, rows, matches[rows], slower, same)
        return pairs

    def _evaluate(self, pairs: Pairs, rows: Int64s, matches: npt.NDArray[np.void], slower: int, same: bool) -> None:
        slow, fast = self._recent[slower], self._recent[1 - slower]
        at = matches["sample"] - slow.first
        before, after = matches["before"] - fast.first, matches["after"] - fast.first
        q_of = (pairs.q_euler, pairs.q_quaternion)
        pairs.t_boot_us[rows] = slow.t_us[at]
        q_of[slower][rows] = slow.q[at]
        if same:
            q_of[1 - slower][rows] = fast.q[after]
            pairs.w_nb_b_rad_s[rows] = fast.w[after]
            self._compare_rates(pairs, rows, slow, at, fast, after, 1 if slower == EULER else -1)
            self._resend(pairs, rows, at if slower == EULER else after)
            return
        gap_us = fast.t_us[after] - fast.t_us[before]
        u = (slow.t_us[at] - fast.t_us[before]) / gap_us
        h = gap_us * 1e-6
        w0, w1, own = fast.w[before], fast.w[after], slow.w[at]
        q, w = attitude.hermite(fast.q[before], fast.q[after], w0, w1, dt_s=h, u=u)
        q_of[1 - slower][rows] = q
        pairs.w_nb_b_rad_s[rows] = w
        pairs.after_reset[rows] = fast.denied[after] & ~fast.denied[before]
        pairs.bound_rad[rows] += interpolation_bound_rad(
            w0, w1, own, w, kin_fast=fast.kin[after], kin_slow=slow.kin[at], h=h, u=u
        )
        self._resend(pairs, rows, at if slower == EULER else after)

    def _compare_rates(
        self, pairs: Pairs, rows: Int64s, slow: _Recent, at: Int64s, fast: _Recent, there: Int64s, sign: int
    ) -> None:
        """The rates of both messages at one instant; a firmware that reports none sends zeros."""
        one, other = slow.w[at], fast.w[there]
        unreported = (_norm(one) == 0) | (_norm(other) == 0)
        pairs.w_differs_b_rad_s[rows] = np.where(unreported[:, None], np.nan, sign * (other - one))
        # The calmer one's: a stream whose rates are wrong finds its own step unsteady, and would excuse itself.
        pairs.unsteady_rad_s[rows] = np.fmin(slow.unsteady[at], fast.unsteady[there])

    def _resend(self, pairs: Pairs, rows: Int64s, at: Int64s) -> None:
        """Put back into the Euler side what was expected of its sample `at`."""
        meant = self._recent[EULER].meant
        if meant is not None:
            pairs.q_euler_sent[rows] = attitude.multiply(pairs.q_euler[rows], meant[at])
