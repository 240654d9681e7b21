"""The IMU's gyro against the body rates of the attitude: it shows an estimator that changes its gyro, or lost it.

The attitude's rates are corrected by the estimator's bias, the gyro's are not (0.1 to 2.6 deg/s on healthy aircraft):
the difference is followed slowly, and only what comes on top of it counts.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.checks.base import ImuCheck, along, length, rated
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.windows import Turning
from gcs_bridge.columns import FloatRows, Floats, Int64s
from gcs_bridge.jit import kernel
from gcs_bridge.settings import AlarmSettings, GyroSettings
from gcs_bridge.telemetry.samples import finite

_BLOCK_US = 10_000_000  # after so long, the lag between the clocks is estimated anew
_LEAST_CHANGE_RAD_S2 = math.radians(20.0)  # on average, before a lag can be told
_LONGEST_LAG_S = 0.1

# Slots of the kernel's state.
_STARTED, _FIRST_US, _LAST_US, _BLOCK_END_US, _LAG_S, _ALONG, _SQUARES, _COUNT, _BIAS = range(9)  # the bias has three


@kernel
def follow_bias(
    t_us: Int64s,
    difference: FloatRows,
    change: FloatRows,
    bias_time_s: float,
    block_us: int,
    state: Floats,
    out: FloatRows,
) -> None:
    """Take lag and bias out of `difference` (n, 3), rad/s, sample after sample; the rest goes to `out` (n, 3).

    `change` (n, 3), rad/s², is how the rates change: by it a lag of the clocks shows. The bias follows with the time
    constant `bias_time_s`, faster in the beginning; a sample is judged by what was known before it.
    """
    for i in range(t_us.size):
        if state[_STARTED] == 0.0:
            state[_STARTED], state[_BLOCK_END_US] = 1.0, t_us[i] + block_us
            state[_FIRST_US], state[_LAST_US] = t_us[i], t_us[i]
            for axis in range(3):
                state[_BIAS + axis] = difference[i, axis]
        if t_us[i] >= state[_BLOCK_END_US]:
            if state[_COUNT] > 0 and state[_SQUARES] > _LEAST_CHANGE_RAD_S2**2 * state[_COUNT]:
                lag = state[_LAG_S] + state[_ALONG] / state[_SQUARES]
                state[_LAG_S] = min(max(lag, -_LONGEST_LAG_S), _LONGEST_LAG_S)
            state[_ALONG], state[_SQUARES], state[_COUNT], state[_BLOCK_END_US] = 0.0, 0.0, 0.0, t_us[i] + block_us
        age_s = max((t_us[i] - state[_FIRST_US]) * 1e-6, 0.0)
        step_s = max((t_us[i] - state[_LAST_US]) * 1e-6, 0.0)
        state[_LAST_US] = max(t_us[i], state[_LAST_US])
        share = step_s / max(min(age_s, bias_time_s), 1e-3)
        state[_COUNT] += 1.0
        for axis in range(3):
            rest = difference[i, axis] - state[_LAG_S] * change[i, axis]
            out[i, axis] = rest - state[_BIAS + axis]
            state[_ALONG] += out[i, axis] * change[i, axis]
            state[_SQUARES] += change[i, axis] ** 2
            state[_BIAS + axis] += min(share, 1.0) * out[i, axis]


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
        self._delays = delays
        what = "the IMU's gyro and the attitude's rates differ"
        self.alarm_specs = self._warning, self._alarm = self._warning_and_alarm(what, delays)
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._state = np.zeros(_BIAS + 3)
        self._turning = Turning()
        self._first_us: int | None = None

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each sample of the IMU between two of the attitude."""
        self._follow_scale(batch, ballot)
        seen = batch.imu_with_attitude.where(finite(batch.imu_with_attitude.w_b_rad_s))
        # Beyond what gyros can measure, and where the int16 of the wire starts anew (32.767 rad/s), they tell nothing,
        # of their bias neither.
        speeds = length(seen.w0_b_rad_s), length(seen.w1_b_rad_s)
        told = self._turning.told_by_rates(seen.w0_b_rad_s, seen.w1_b_rad_s, seen.gap_s)
        told &= (speeds[0] > 0) & (speeds[1] > 0) & (np.maximum(*speeds) < self._settings.usable_below_rad_s)
        seen = seen.where(told)
        found_t, frame_index = seen.t_boot_us, seen.frame_index
        step = seen.w1_b_rad_s - seen.w0_b_rad_s
        difference = seen.w_b_rad_s - (seen.w0_b_rad_s + seen.place[:, None] * step)
        change = step / np.maximum(seen.gap_s, 1e-3)[:, None]
        rest = np.empty_like(difference)
        follow_bias(found_t, difference, change, self._settings.bias_time_s, _BLOCK_US, self._state, rest)
        if self._first_us is None and len(found_t):
            self._first_us = int(found_t[0])
        since_us = (self._first_us or 0) + self._settings.skipped_s * 1e6
        value = length(rest)
        judged = found_t >= since_us
        self._watch(found_t, value, judged)
        allowed = length(step)[judged]
        detail = along(rest[judged])
        for spec, limit in ((self._warning, self._settings.warning_rad_s), (self._alarm, self._settings.alarm_rad_s)):
            ballot.rate(
                spec, rated(found_t[judged], frame_index[judged], value[judged], limit + allowed, self._delays, detail)
            )

    def why_not(self) -> str:
        """Why nothing was judged."""
        if self._scale is None:
            return "no message with a gyro was received"
        return f"no gyro sample came between two attitudes with rates ({self._scale})"
