"""Two sampled descriptions of one attitude → pairs at one instant, each with a bound on the error of its alignment.

Samples of the same `time_boot_ms` are a pair. Any other sample of the slower stream is compared with the faster one,
interpolated at its time: a cubic Hermite in the rotation vector, which uses the body rates at both ends. (The other
way round, or latest against latest, shows tens of degrees on healthy aircraft.) Nothing is interpolated across a
reboot, a gap that is too long, or a step that the stream's own rates deny.

`match_kernel` decides which samples form a pair, one sample after the other in order of arrival, so it cannot depend
on how they were cut into batches. What a pair is worth is computed for all of a batch's pairs at once.
"""

from __future__ import annotations

from dataclasses import dataclass
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

# Slots of `_State.of`, one row a stream.
_COUNT, _ORDERED, _LATEST, _INTERVALS, _WAITING, _PERIOD, _RX_PERIOD, _RX_START = range(8)
_UNKNOWN = -1


class _State(NamedTuple):
    """What the matching remembers within one boot."""

    of: Int64s  # (2, 8) counters, see above
    slower: Int64s  # (1,)
    time: Int64s  # (2, _RING) by position
    paired: Int64s  # (2, _RING) by position
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
def _median(values, n):  # type: ignore[no-untyped-def]
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
def _follow_period(state, k, t, t_rx):  # type: ignore[no-untyped-def]
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
def _decide_slower(state):  # type: ignore[no-untyped-def]
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
def _same_instant(state, k, t):  # type: ignore[no-untyped-def]
    """Position of the unpaired sample of stream `k` at exactly `t`, −1 if there is none."""
    if state.of[k, _LATEST] < t:
        return _UNKNOWN
    count = state.of[k, _COUNT]
    for position in range(count - 1, max(count - _RING, 0) - 1, -1):
        time = state.time[k, position & _LAST]
        if time == t and not state.paired[k, position & _LAST]:
            return position
        if time < t - _LATE_US:
            break
    return _UNKNOWN


@helper
def _ordered_after(state, k, t):  # type: ignore[no-untyped-def]
    """Index in `ordered` of the first sample of stream `k` behind `t`; the one before it is at or before `t`."""
    n = state.of[k, _ORDERED]
    index = n
    while index > max(n - _RING, 0) and state.time[k, state.ordered[k, (index - 1) & _LAST] & _LAST] > t:
        index -= 1
    return index


@helper
def _stands_for(state, slower, position, max_gap_us):  # type: ignore[no-untyped-def]
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
def _pair_waiting(state, k, trigger, max_gap_us, matches, n):  # type: ignore[no-untyped-def]
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
        state.paired[k, position & _LAST] = 1
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
            state.paired[k, position & _LAST] = 1
            state.paired[other, partner & _LAST] = 1
            match = matches[n]
            match.trigger, match.same = i, 1
            match.slower = QUATERNION if slower == _UNKNOWN else slower
            match.sample = position if k == match.slower else partner
            match.before = match.after = partner if k == match.slower else position
            match.stands_for_us = _stands_for(state, match.slower, match.sample, max_gap_us)
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


class _Recent:
    """The last samples of one stream since the boot, and for each the step that led to it."""

    def __init__(self) -> None:
        self.first = 0  # position of the first sample kept
        self.t_us: Int64s = np.empty(0, np.int64)
        self.q: Floats = np.empty((0, 4))
        self.w: Floats = np.empty((0, 3))
        self.kin: Floats = np.empty(0)  # rad by which the step differs from what the rates say
        self.denied: Mask = np.empty(0, np.bool_)
        self._last: tuple[int, Floats, Floats] | None = None  # the latest in order: t_us, q (1, 4), w (1, 3)

    def append(self, t_us: Int64s, q: Floats, w: Floats, reset: ResetSettings) -> None:
        """Add samples in order of arrival; those that come late have no step."""
        n = len(t_us)
        latest = np.maximum.accumulate(np.concatenate(([-1 if self._last is None else self._last[0]], t_us)))
        in_order = np.flatnonzero(t_us > latest[:-1])
        kin, denied = np.full(n, np.inf), np.zeros(n, np.bool_)
        if len(in_order):
            t, q_in, w_in = t_us[in_order], q[in_order], w[in_order]
            if self._last is not None:
                t = np.concatenate(([self._last[0]], t))
                q_in = np.concatenate((self._last[1], q_in))
                w_in = np.concatenate((self._last[2], w_in))
            if len(t) > 1:
                step_kin, step_denied = _steps(t, q_in, w_in, reset)
                kin[in_order[-len(step_kin) :]] = step_kin
                denied[in_order[-len(step_kin) :]] = step_denied
            self._last = (int(t[-1]), q_in[-1:], w_in[-1:])
        surplus = max(len(self.t_us) - _RING, 0)
        self.first += surplus
        self.t_us = np.concatenate((self.t_us[surplus:], t_us))
        self.q = np.concatenate((self.q[surplus:], q))
        self.w = np.concatenate((self.w[surplus:], w))
        self.kin = np.concatenate((self.kin[surplus:], kin))
        self.denied = np.concatenate((self.denied[surplus:], denied))


def _norm(v: Floats) -> Floats:
    return np.sqrt(v[:, 0] ** 2 + v[:, 1] ** 2 + v[:, 2] ** 2)


def _steps(t_us: Int64s, q: Floats, w: Floats, reset: ResetSettings) -> tuple[Floats, Mask]:
    """Per step between consecutive samples: rad that the rates don't explain, and whether that denies the step."""
    h = (t_us[1:] - t_us[:-1]) * 1e-6
    w0, w1 = w[:-1], w[1:]
    phi = attitude.rotvec_from_quaternion(attitude.multiply(attitude.conjugate(q[:-1]), q[1:]))
    kin = _norm(phi - 0.5 * h[:, None] * (w0 + w1))
    speed0, speed1 = _norm(w0), _norm(w1)
    kin[(speed0 == 0) & (speed1 == 0) & (_norm(phi) > UNREPORTED_TURN_RAD)] = np.nan
    rate, change = np.maximum(speed0, speed1), _norm(w1 - w0)
    limit = reset.step_rad + reset.per_rate_s * rate + 1.5 * h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
    return kin, kin > limit


@dataclass(frozen=True)
class Pairs:
    """n pairs of attitudes at one instant each, in the order in which they were completed.

    `t_boot_us` (n,); `trigger` (n,) index in the batch of the completing sample; `same_instant` (n,);
    `q_euler`, `q_quaternion` (n, 4) unit [w, x, y, z], FRD to NED; `w_nb_b_rad_s` (n, 3) body rates at that instant;
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
    w_nb_b_rad_s: Floats
    bound_rad: Floats
    after_reset: Mask
    bracket: Int64s
    stands_for_us: Int64s

    def __len__(self) -> int:
        return len(self.t_boot_us)


@dataclass(frozen=True)
class Aligned:
    """A batch's pairs, and per sample its stream's period as known by then, in boot and in receive time (µs, −1)."""

    pairs: Pairs
    period_us: Int64s
    rx_period_us: Int64s


class Aligner:
    """Pairs ATTITUDE and ATTITUDE_QUATERNION of one vehicle within one boot."""

    def __init__(self, alignment: AlignmentSettings, reset: ResetSettings) -> None:
        """Start before a boot's first sample."""
        self._alignment = alignment
        self._reset = reset
        self._state = _new_state()
        self._recent = (_Recent(), _Recent())

    def pair(self, euler: AttitudeSamples, quaternion: AttitudeSamples, order: Int64s) -> Aligned:
        """The pairs that these samples complete.

        `order` (n,) sorts the two streams' samples, ATTITUDE's first, into their order of arrival; the batch's index
        is the place in that order.
        """
        stream = np.repeat(np.array([EULER, QUATERNION]), [len(euler), len(quaternion)])[order]
        t_us = np.concatenate((euler.t_boot_us, quaternion.t_boot_us))[order]
        t_rx_us = np.concatenate((euler.t_rx_us, quaternion.t_rx_us))[order]
        for recent, samples in zip(self._recent, (euler, quaternion), strict=True):
            if len(samples):
                q = attitude.normalise(samples.q_nb)
                with np.errstate(invalid="ignore"):  # rates that are no numbers: they explain no step
                    recent.append(samples.t_boot_us, q, samples.w_nb_b_rad_s, self._reset)
        waiting = int(self._state.of[:, _WAITING].sum())
        matches = np.empty(len(stream) + waiting + 1, MATCH)
        periods = np.empty((len(stream), 2), np.int64)
        max_gap_us = round(self._alignment.max_gap_s * 1e6)
        n = match_kernel(stream, t_us, t_rx_us, max_gap_us, self._state, matches, periods)
        with np.errstate(invalid="ignore"):  # rates that are no numbers: the bound is none then
            pairs = self._evaluated(matches[:n])
        return Aligned(pairs, periods[:, 0], periods[:, 1])

    def _evaluated(self, matches: npt.NDArray[np.void]) -> Pairs:
        """The matched samples as pairs, the faster stream interpolated where the instants differ."""
        n = len(matches)
        pairs = Pairs(
            np.empty(n, np.int64),
            matches["trigger"].copy(),
            matches["same"] == 1,
            np.empty((n, 4)),
            np.empty((n, 4)),
            np.empty((n, 3)),
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
            return
        gap_us = fast.t_us[after] - fast.t_us[before]
        u = (slow.t_us[at] - fast.t_us[before]) / gap_us
        h = gap_us * 1e-6
        w0, w1, own = fast.w[before], fast.w[after], slow.w[at]
        q, w = attitude.hermite(fast.q[before], fast.q[after], w0, w1, dt_s=h, u=u)
        q_of[1 - slower][rows] = q
        pairs.w_nb_b_rad_s[rows] = w
        pairs.after_reset[rows] = fast.denied[after] & ~fast.denied[before]
        # A slower stream that reports no rates has no say; without the faster one's, nothing bounds the error.
        rate = np.fmax(np.maximum(_norm(w0), _norm(w1)), _norm(own))
        change = _norm(w1 - w0)
        slow_kin = np.nan_to_num(slow.kin[at], nan=np.inf)
        kin = np.minimum(fast.kin[after], slow_kin + KIN_MARGIN_RAD)
        kin = np.minimum(
            kin, KIN_FLOOR_RAD + KIN_PER_RATE_S * rate + h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
        )
        bow = 4.0 * u * (1.0 - u)
        bend = np.where(np.isfinite(own).all(axis=1), _norm(w - own), 0.0)
        pairs.bound_rad[rows] += RATE_BOUND_S * rate + 0.5 * bow * (kin + h * bend)
