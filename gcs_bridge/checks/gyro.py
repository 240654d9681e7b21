"""The IMU's gyro against the body rates of the attitude: it shows an estimator that changes its gyro, or lost it.

The attitude's rates are corrected by the estimator's bias, the gyro's are not (0.1 to 2.6 deg/s on healthy aircraft):
the difference is followed slowly, and only what comes on top of it counts.

Where the vehicle swings to and fro about as fast as it is sampled, gyro and rates show different parts of the swing.
The turn from attitude to attitude tells: if neither the rates at its ends nor the gyro between them account for it, the
rates swing unseen, by about as much. A fault leaves one of the two accounts right.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.votes import Votes, vote
from gcs_bridge.attitude.quaternion import length
from gcs_bridge.checks.base import ImuCheck, Watched, is_dead, is_known, row_at, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.windows import PEAK, TOO_SLOW, follow_swing, new_swing, new_turning, told_by_rates, too_slow_for
from gcs_bridge.columns import FloatRows, Floats, Int64s, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.bounds import BEYOND_GYROS_RAD_S, RATE_BOUND_S
from gcs_bridge.settings import AlarmSettings, GyroSettings

_BLOCK_US = 10_000_000  # after so long, the lag between the clocks is estimated anew
_LEAST_CHANGE_RAD_S2 = math.radians(20.0)  # on average, before a lag can be told
_LONGEST_LAG_S = 0.1
_LONGEST_STEP_S = 2.0  # a sample behind a longer gap tells no more of the bias than one of these
_UNSEEN = 2.5  # times what neither account explains: by so much gyro and rates may differ in a swing (a sine: 2.3)
# Where both miss the turn alike, as its stamps make them, the factor is smaller: it is learned from time to time, but
# not from what lies to one side, as a fault does. What it rests on as long as little is known, rad²/s:
_FEW_MISSED = math.radians(2.0) ** 2
_LEARNED_US, _REMEMBERED_S, _ONE_SIDED = 2_000_000, 20.0, 0.8
_SUDDEN = 3.0  # times as much as usual: of that nothing is learned yet
_MOST_UNSEEN = 2.0  # alarm limits, up to which a sample is judged with so much more allowed
_SCALE = 0.05  # of the rate, by which a healthy gyro's scale and axes may be off: it is no bias

_STATE = np.dtype(
    [
        ("started", "i8"),
        ("first_us", "i8"),
        ("last_us", "i8"),
        ("learned_s", "f8"),  # for how long the bias was followed, less where little could be told of it
        ("bias_rad_s", "f8", (3,)),
        ("lag_s", "f8"),  # of the clocks
        # At the end of the last gap: the rates, and half of what they changed by in it.
        ("last_rate_rad_s", "f8", (3,)),
        ("last_change_rad_s", "f8", (3,)),
        # Sums over the last time: of the difference squared, of what neither account of a turn explains squared, s.
        ("differed", "f8"),
        ("missed", "f8"),
        ("remembered_s", "f8"),
        # The same since `new_us`, and of the difference itself.
        ("new_us", "i8"),
        ("new_differed", "f8"),
        ("new_missed", "f8"),
        ("new_s", "f8"),
        ("new_sum", "f8", (3,)),
        # Of the block that the next lag is estimated by.
        ("block_end_us", "i8"),
        ("along", "f8"),  # sum of the differences along the changes of rate
        ("squares", "f8"),  # and of these changes' squares
        ("count", "f8"),
        # Of the settings.
        ("bias_time_s", "f8"),
        ("skipped_us", "f8"),
        ("usable_below_rad_s", "f8"),
    ]
)
_UNTOLD = np.dtype(
    [
        ("too_slow", "i8"),  # samples that could not be judged since the motion was too fast for the sampling
        ("beyond", "i8"),  # since the attitude's rates are beyond any gyro
        ("saturated", "i8"),  # since they are beyond what gyros tell well
    ]
)


class Gyro(ImuCheck):
    """The check over one vehicle."""

    name: ClassVar[str] = "gyro"
    judges: ClassVar[Literal["f_b_m_s2", "w_b_rad_s"]] = "w_b_rad_s"
    unit: ClassVar[str] = "deg/s"
    not_a_sign_of: ClassVar[str] = "not a convention or encoding of the attitude: rates are compared with rates"
    ok_text: ClassVar[str] = "the IMU's gyro and the attitude's rates agree, but for a slow bias"

    def __init__(self, settings: GyroSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._limits = settings.warning_rad_s, settings.alarm_rad_s
        what = "the IMU's gyro and the attitude's rates differ"
        self.alarm_specs = self._warning_and_alarm(what, delays)
        self._untold = np.zeros(1, _UNTOLD)
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        settings = self._settings
        self._state, self._turning = np.zeros(1, _STATE), new_turning()
        self._swings = new_swing(), new_swing()
        self._state["bias_time_s"], self._state["skipped_us"] = settings.bias_time_s, settings.skipped_s * 1e6
        self._state["usable_below_rad_s"] = settings.usable_below_rad_s

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each sample of the IMU between two of the attitude."""
        self._follow_scale(batch, ballot)
        seen = batch.imu_with_attitude
        if n := len(seen):
            rate_gyro(
                ballot.votes(2 * n),
                self._watching(n),
                self._places(ballot),
                self._limits,
                self._state,
                self._untold,
                self._turning,
                self._swings,
                seen.frame_index,
                seen.t_boot_us,
                seen.f_b_m_s2,
                seen.w_b_rad_s,
                seen.w0_b_rad_s,
                seen.w1_b_rad_s,
                seen.turn_b_rad,
                seen.gap_s,
                seen.place,
            )

    def why_not(self) -> str:
        """Why nothing was judged."""
        if self._scale is None:
            return "no message with a gyro was received"
        if self._sends_zeros is not None:
            return self._sends_zeros
        untold = self._untold[0]
        if untold["beyond"]:
            return f"the rates of the attitude are beyond any gyro, above {math.degrees(BEYOND_GYROS_RAD_S):.0f} °/s"
        if untold["saturated"]:
            return (
                f"the vehicle turned beyond what gyros tell, {math.degrees(self._settings.usable_below_rad_s):.0f} °/s"
            )
        if untold["too_slow"]:
            return TOO_SLOW
        if self.judged:
            return f"only {self.judged} gyro samples came between two attitudes with rates ({self._scale})"
        return f"no gyro sample came between two attitudes with rates ({self._scale})"

    @property
    def bias(self) -> tuple[float, float, float] | None:
        """The gyro's, deg/s, as it was last known; None where nothing was judged."""
        if not self.judged or not self._state["started"][0]:
            return None
        x, y, z = np.degrees(self._state["bias_rad_s"][0]).tolist()
        return x, y, z

    @property
    def remark(self) -> str | None:
        """The unit that was taken, and how much could not be told at this sampling."""
        said = (super().remark, too_slow_for(int(self._untold["too_slow"][0]), self.judged))
        return "; ".join(filter(None, said)) or None


@kernel
def rate_gyro(
    votes: Votes,
    watched: Watched,
    places: Int64s,
    limits: tuple[float, float],
    states: Annotated[Records, _STATE],
    untold: Annotated[Records, _UNTOLD],
    turning: Floats,
    swings: tuple[Floats, Floats],
    frame_index: Int64s,
    t_us: Int64s,
    f: FloatRows,
    w: FloatRows,
    w0: FloatRows,
    w1: FloatRows,
    turn: FloatRows,
    gap_s: Floats,
    place: Floats,
) -> None:
    """Rate a gyro's samples `w` (n, 3), each at its place (n,) between two rates of the attitude, rad/s.

    `turn` (n, 3) is how far the attitude turned from the one to the other, `f` (n, 3) the specific force, m/s².
    """
    state = states[0]
    for i in range(t_us.size):
        own, start, end = row_at(w, i), row_at(w0, i), row_at(w1, i)
        speed0, speed1 = length(start), length(end)
        if not is_known(own) or is_dead(f[i], own) or not (speed0 > 0 and speed1 > 0):
            continue
        told = told_by_rates(turning, speed0, speed1, gap_s[i])
        # Beyond what gyros can measure, and where the int16 of the wire starts anew (32.767 rad/s), they tell nothing.
        if max(speed0, speed1) >= state.usable_below_rad_s:
            untold[0].beyond += max(speed0, speed1) > BEYOND_GYROS_RAD_S
            untold[0].saturated += 1
            watch(watched, t_us[i], 0.0, False)
            continue
        dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
        x = own[0] - (start[0] + place[i] * dx)
        y = own[1] - (start[1] + place[i] * dy)
        z = own[2] - (start[2] + place[i] * dz)
        if not state.started:
            _begin(state, t_us[i], (x, y, z))
        step_s = min(max((t_us[i] - state.last_us) * 1e-6, 0.0), _LONGEST_STEP_S)
        state.last_us = max(t_us[i], state.last_us)
        unseen = _unseen(state, swings, t_us[i], start, end, row_at(turn, i), (x, y, z), gap_s[i], step_s)
        if not told:
            untold[0].too_slow += 1
            watch(watched, t_us[i], 0.0, False)
            continue
        _follow_lag(state, t_us[i])
        dt, change = max(gap_s[i], 1e-3), length((dx, dy, dz))
        trust = _trust(limits[0], unseen)
        share = _share(state, step_s * trust * _trust(limits[0], 0.5 * change + _SCALE * max(speed0, speed1)))
        state.count += trust
        x = _beyond_bias(state, 0, x, dx / dt, share, trust)
        y = _beyond_bias(state, 1, y, dy / dt, share, trust)
        z = _beyond_bias(state, 2, z, dz / dt, share, trust)
        value = length((x, y, z))
        judged = t_us[i] >= state.first_us + state.skipped_us
        if judged and value > limits[0] + change and unseen > _MOST_UNSEEN * limits[1]:
            untold[0].too_slow += 1
            judged = False
        watch(watched, t_us[i], value, judged)
        allowed = change + unseen  # read a sample early or late, a gyro is off by what the rates change
        for k in range(2):
            if judged:
                vote(votes, places[k], frame_index[i], t_us[i], value, limits[k] + allowed, (np.nan, np.nan, x, y, z))


@helper
def _begin(state: Any, t_us: Any, difference: Any) -> Any:
    """Take the first difference for the bias."""
    state.started, state.first_us, state.last_us, state.block_end_us = 1, t_us, t_us, t_us + _BLOCK_US
    state.new_us = t_us
    for axis in range(3):
        state.bias_rad_s[axis] = difference[axis]


@helper
def _unseen(
    state: Any, swings: Any, t_us: Any, start: Any, end: Any, turn: Any, difference: Any, gap_s: Any, step_s: Any
) -> Any:
    """By how much gyro and rates may differ, rad/s, since the rates swing between the samples.

    `difference` of the gyro from the rates at its time: with that, the rates' own mean is brought to the gyro's.
    """
    if gap_s <= 0.0:
        return 0.0
    of_rates = of_gyro = most = turned = differs = 0.0
    for axis in range(3):
        mean = 0.5 * (start[axis] + end[axis])
        rate, change = turn[axis] / gap_s, 0.5 * (end[axis] - start[axis])
        off = difference[axis] - state.bias_rad_s[axis] - state.lag_s * 2.0 * change / gap_s
        # Between two gaps a rate that is sampled often enough changes alike; else that the mean is right is chance.
        if state.last_rate_rad_s[axis] == start[axis]:
            of_rates += (0.5 * (change - state.last_change_rad_s[axis])) ** 2
        if state.last_rate_rad_s[axis] != end[axis]:  # else it is the same gap again
            state.last_rate_rad_s[axis], state.last_change_rad_s[axis] = end[axis], change
        of_rates += (rate - mean) ** 2
        of_gyro += (rate - mean - off) ** 2
        turned += rate * rate
        differs += off * off
        state.new_sum[axis] += off * step_s
        most += max(start[axis] * start[axis], end[axis] * end[axis], (mean + off) ** 2)
    most = 2.0 * np.sqrt(most)  # what swings by more shows it: a reset of the attitude does not
    stamps = RATE_BOUND_S / gap_s * np.sqrt(turned)  # both are whole milliseconds
    of_rates, of_gyro = (
        min(max(np.sqrt(of_rates) - stamps, 0.0), most),
        min(max(np.sqrt(of_gyro) - stamps, 0.0), most),
    )
    by_rates = follow_swing(swings[0], of_rates, step_s, gap_s)
    by_gyro = follow_swing(swings[1], of_gyro, step_s, gap_s)
    state.new_differed += min(differs, most * most) * step_s
    state.new_missed += min(of_rates, of_gyro) ** 2 * step_s
    state.new_s += step_s
    if t_us - state.new_us >= _LEARNED_US:
        _learn(state, t_us)
    missed = min(by_rates, by_gyro)
    if missed * missed * state.remembered_s > (PEAK * _SUDDEN) ** 2 * state.missed:
        return _UNSEEN * missed
    squared = (_UNSEEN * _UNSEEN * _FEW_MISSED + state.differed) / (_FEW_MISSED + state.missed)
    return min(np.sqrt(squared), _UNSEEN) * missed


@helper
def _learn(state: Any, t_us: Any) -> Any:
    """Take what was seen since the last time into what is remembered, and begin anew."""
    x, y, z = state.new_sum
    if x * x + y * y + z * z <= _ONE_SIDED * state.new_s * state.new_differed:
        kept = max(1.0 - state.new_s / _REMEMBERED_S, 0.0)
        state.differed = kept * state.differed + state.new_differed
        state.missed = kept * state.missed + state.new_missed
        state.remembered_s = kept * state.remembered_s + state.new_s
    state.new_us, state.new_differed, state.new_missed, state.new_s = t_us, 0.0, 0.0, 0.0
    for axis in range(3):
        state.new_sum[axis] = 0.0


@helper
def _trust(limit: Any, doubt: Any) -> Any:
    """How much a difference tells of what it should be, with so much doubt in it: 1 without."""
    told = limit / (limit + doubt)
    return told * told


@helper
def _share(state: Any, step_s: Any) -> Any:
    """By which share of a difference the bias follows: with its time constant, faster in the beginning."""
    state.learned_s += step_s
    return min(step_s / max(min(state.learned_s, state.bias_time_s), 1e-3), 1.0)


@helper
def _follow_lag(state: Any, t_us: Any) -> Any:
    """At the end of a block, take from it how much further the clocks lag: that shows where the rates change."""
    if t_us < state.block_end_us:
        return
    if state.squares > _LEAST_CHANGE_RAD_S2**2 * state.count:
        state.lag_s = min(max(state.lag_s + state.along / state.squares, -_LONGEST_LAG_S), _LONGEST_LAG_S)
    state.along, state.squares, state.count, state.block_end_us = 0.0, 0.0, 0.0, t_us + _BLOCK_US


@helper
def _beyond_bias(state: Any, axis: Any, difference: Any, change: Any, share: Any, trust: Any) -> Any:
    """What is left of a difference, rad/s, without lag and bias, as they were known before; then follow them."""
    beyond = difference - state.lag_s * change - state.bias_rad_s[axis]
    state.along += trust * beyond * change
    state.squares += trust * change * change
    state.bias_rad_s[axis] += share * beyond
    return beyond
