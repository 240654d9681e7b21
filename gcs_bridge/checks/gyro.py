"""The IMU's gyro against the body rates of the attitude: it shows an estimator that changes its gyro, or lost it.

The attitude's rates are corrected by the estimator's bias, the gyro's are not (0.1 to 2.6 deg/s on healthy aircraft):
the difference is followed slowly, and only what comes on top of it counts.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.votes import Ballot, Votes, vote
from gcs_bridge.attitude.quaternion import length
from gcs_bridge.checks.base import ImuCheck, Watched, is_known, row_at, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.windows import new_turning, told_by_rates
from gcs_bridge.columns import FloatRows, Floats, Int64s, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.settings import AlarmSettings, GyroSettings

_BLOCK_US = 10_000_000  # after so long, the lag between the clocks is estimated anew
_LEAST_CHANGE_RAD_S2 = math.radians(20.0)  # on average, before a lag can be told
_LONGEST_LAG_S = 0.1

_STATE = np.dtype(
    [
        ("started", "i8"),
        ("first_us", "i8"),
        ("last_us", "i8"),
        ("bias_rad_s", "f8", (3,)),
        ("lag_s", "f8"),  # of the clocks
        # Of the block that the next lag is estimated by.
        ("block_end_us", "i8"),
        ("along", "f8"),  # sum of the differences along the changes of rate
        ("squares", "f8"),  # and of these changes' squares
        ("count", "i8"),
        # Of the settings.
        ("bias_time_s", "f8"),
        ("skipped_us", "f8"),
        ("usable_below_rad_s", "f8"),
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
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        settings = self._settings
        self._state, self._turning = np.zeros(1, _STATE), new_turning()
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
                self._turning,
                seen.frame_index,
                seen.t_boot_us,
                seen.w_b_rad_s,
                seen.w0_b_rad_s,
                seen.w1_b_rad_s,
                seen.gap_s,
                seen.place,
            )

    def why_not(self) -> str:
        """Why nothing was judged."""
        if self._scale is None:
            return "no message with a gyro was received"
        return f"no gyro sample came between two attitudes with rates ({self._scale})"


@kernel
def rate_gyro(
    votes: Votes,
    watched: Watched,
    places: Int64s,
    limits: tuple[float, float],
    states: Annotated[Records, _STATE],
    turning: Floats,
    frame_index: Int64s,
    t_us: Int64s,
    w: FloatRows,
    w0: FloatRows,
    w1: FloatRows,
    gap_s: Floats,
    place: Floats,
) -> None:
    """Rate a gyro's samples `w` (n, 3), each at its place (n,) between two rates of the attitude, rad/s."""
    state = states[0]
    for i in range(t_us.size):
        own, start, end = row_at(w, i), row_at(w0, i), row_at(w1, i)
        if not is_known(own) or not _is_told(state, turning, length(start), length(end), gap_s[i]):
            continue
        dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
        x = own[0] - (start[0] + place[i] * dx)
        y = own[1] - (start[1] + place[i] * dy)
        z = own[2] - (start[2] + place[i] * dz)
        if not state.started:
            _begin(state, t_us[i], (x, y, z))
        _follow_lag(state, t_us[i])
        share, dt = _share(state, t_us[i]), max(gap_s[i], 1e-3)
        state.count += 1
        x = _beyond_bias(state, 0, x, dx / dt, share)
        y = _beyond_bias(state, 1, y, dy / dt, share)
        z = _beyond_bias(state, 2, z, dz / dt, share)
        value = length((x, y, z))
        judged = t_us[i] >= state.first_us + state.skipped_us
        watch(watched, t_us[i], value, judged)
        allowed = length((dx, dy, dz))  # read a sample early or late, a gyro is off by what the rates change
        for k in range(2):
            if judged:
                vote(votes, places[k], frame_index[i], t_us[i], value, limits[k] + allowed, (np.nan, np.nan, x, y, z))


@helper
def _is_told(state, turning, speed0, speed1, gap_s):  # type: ignore[no-untyped-def]  # typed by numba
    """Whether two rates of the attitude, of these sizes, tell what is between them.

    Beyond what gyros can measure, and where the int16 of the wire starts anew (32.767 rad/s), they tell nothing, of
    their bias neither.
    """
    told = told_by_rates(turning, speed0, speed1, gap_s)
    return told and speed0 > 0 and speed1 > 0 and max(speed0, speed1) < state.usable_below_rad_s


@helper
def _begin(state, t_us, difference):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the first difference for the bias."""
    state.started, state.first_us, state.last_us, state.block_end_us = 1, t_us, t_us, t_us + _BLOCK_US
    for axis in range(3):
        state.bias_rad_s[axis] = difference[axis]


@helper
def _share(state, t_us):  # type: ignore[no-untyped-def]  # typed by numba
    """By which share of a difference the bias follows: with its time constant, faster in the beginning."""
    age_s, step_s = max((t_us - state.first_us) * 1e-6, 0.0), max((t_us - state.last_us) * 1e-6, 0.0)
    state.last_us = max(t_us, state.last_us)
    return min(step_s / max(min(age_s, state.bias_time_s), 1e-3), 1.0)


@helper
def _follow_lag(state, t_us):  # type: ignore[no-untyped-def]  # typed by numba
    """At the end of a block, take from it how much further the clocks lag: that shows where the rates change."""
    if t_us < state.block_end_us:
        return
    if state.squares > _LEAST_CHANGE_RAD_S2**2 * state.count:
        state.lag_s = min(max(state.lag_s + state.along / state.squares, -_LONGEST_LAG_S), _LONGEST_LAG_S)
    state.along, state.squares, state.count, state.block_end_us = 0.0, 0.0, 0, t_us + _BLOCK_US


@helper
def _beyond_bias(state, axis, difference, change, share):  # type: ignore[no-untyped-def]  # typed by numba
    """What is left of a difference, rad/s, without lag and bias, as they were known before; then follow them."""
    beyond = difference - state.lag_s * change - state.bias_rad_s[axis]
    state.along += beyond * change
    state.squares += change * change
    state.bias_rad_s[axis] += share * beyond
    return beyond
