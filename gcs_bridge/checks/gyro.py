"""The IMU's gyro against the body rates of the attitude: it shows an estimator that changes its gyro, or lost it.

The attitude's rates are corrected by the estimator's bias, the gyro's are not (0.1 to 2.6 deg/s on healthy aircraft):
the difference is followed slowly, and only what comes on top of it counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from gcs_bridge.checks.protocol import Break, Check, Ratings, Tier, Turning, Usable, along, finite, length, rated
from gcs_bridge.flight import ATTITUDE_WIDTH, Flight
from gcs_bridge.lookup import Lookup, Track, no_track
from gcs_bridge.mavlink.jit import kernel
from gcs_bridge.settings import AlarmSettings, GyroSettings

Floats = npt.NDArray[np.float64]
Int64s = npt.NDArray[np.int64]

_MAX_GAP_US = 1_000_000
_BLOCK_US = 10_000_000  # after so long, the lag between the clocks is estimated anew
_LEAST_CHANGE_RAD_S2 = math.radians(20.0)  # on average, before a lag can be told
_LONGEST_LAG_S = 0.1

# Slots of the kernel's state.
_STARTED, _FIRST_US, _LAST_US, _BLOCK_END_US, _LAG_S, _MOVED, _SQUARES, _COUNT, _BIAS = range(9)


@kernel
def follow_bias(
    t_us: Int64s, difference: Floats, change: Floats, bias_time_s: float, block_us: int, state: Floats, out: Floats
) -> None:
    """Take lag and bias out of `difference` (n, 3), rad/s, sample after sample; the rest goes to `out` (n, 3).

    `change` (n, 3), rad/s², is how the rates change: by it a lag of the clocks shows. The bias follows with the time
    constant `bias_time_s`, faster in the beginning; a sample is judged by what was known before it.
    """
    for i in range(t_us.size):
        if state[0] == 0.0:
            state[0], state[1], state[2], state[3] = 1.0, t_us[i], t_us[i], t_us[i] + block_us
            for axis in range(3):
                state[8 + axis] = difference[i, axis]
        if t_us[i] >= state[3]:
            if state[7] > 0 and state[6] > _LEAST_CHANGE_RAD_S2**2 * state[7]:
                lag = state[4] + state[5] / state[6]
                state[4] = min(max(lag, -_LONGEST_LAG_S), _LONGEST_LAG_S)
            state[5], state[6], state[7], state[3] = 0.0, 0.0, 0.0, t_us[i] + block_us
        age_s = max((t_us[i] - state[1]) * 1e-6, 0.0)
        step_s = max((t_us[i] - state[2]) * 1e-6, 0.0)
        state[2] = max(t_us[i], state[2])
        share = step_s / max(min(age_s, bias_time_s), 1e-3)
        state[7] += 1.0
        for axis in range(3):
            rest = difference[i, axis] - state[4] * change[i, axis]
            out[i, axis] = rest - state[8 + axis]
            state[5] += out[i, axis] * change[i, axis]
            state[6] += change[i, axis] ** 2
            state[8 + axis] += min(share, 1.0) * out[i, axis]


class Gyro(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "gyro"
    unit: ClassVar[str] = "deg/s"
    is_not: ClassVar[str] = "not a convention or encoding of the attitude: rates are compared with rates"
    agrees: ClassVar[str] = "the IMU's gyro and the attitude's rates agree, but for a slow bias"

    def __init__(self, settings: GyroSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._delays = delays
        self._scale: str | None = None
        self._usable = Usable()
        self._start()

    @property
    def tiers(self) -> tuple[Tier, ...]:
        """A warning and an alarm."""
        what = "the IMU's gyro and the attitude's rates differ"
        return Tier("warning", "warning", what, self._delays), Tier("alarm", "alarm", what, self._delays)

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._lookup = Lookup(3, ATTITUDE_WIDTH, _MAX_GAP_US)
        self._state = np.zeros(11)
        self._turning = Turning()
        self._first_us: int | None = None

    def judge(self, flight: Flight) -> Iterator[Ratings]:
        """Rate each sample of the IMU between two of the attitude."""
        queries = no_track(3)
        self._usable.breaks = []
        if flight.imu is not None:
            samples = flight.imu.samples
            self._scale = samples.scale
            usable = finite(samples.w_b_rad_s)
            self._usable.follow(usable, samples.t_boot_us, flight.imu.ordinal)
            queries = Track(samples.t_boot_us, flight.imu.ordinal, samples.w_b_rad_s)[usable]
        found = self._lookup.feed(flight.attitude, queries)
        before, after, u = found.before.rows[:, 4:], found.after.rows[:, 4:], found.place[:, None]
        # Beyond what gyros can measure, and where the int16 of the wire starts anew (32.767 rad/s), they tell nothing,
        # of their bias neither.
        fast = np.maximum(length(before), length(after)) >= self._settings.usable_below_rad_s
        told = self._turning.told_by_rates(before, after, found.gap_s)
        reported = before.any(axis=1) & after.any(axis=1) & finite(before + after) & ~fast & told
        found_t, ordinal = found.query.t_us[reported], found.ordinal[reported]
        before, after, u = before[reported], after[reported], u[reported]
        measured, rates = found.query.rows[reported], before + u * (after - before)
        difference = measured - rates
        change = (after - before) / np.maximum(found.gap_s[reported], 1e-3)[:, None]
        rest = np.empty_like(difference)
        follow_bias(found_t, difference, change, self._settings.bias_time_s, _BLOCK_US, self._state, rest)
        if self._first_us is None and len(found_t):
            self._first_us = int(found_t[0])
        since_us = (self._first_us or 0) + self._settings.skipped_s * 1e6
        value = length(rest)
        judged = found_t >= since_us
        self._watch(found_t, value, judged)
        allowed = length(after - before)[judged]
        detail = along(rest[judged])
        for tier, limit in (("warning", self._settings.warning_rad_s), ("alarm", self._settings.alarm_rad_s)):
            yield Ratings(
                tier, rated(found_t[judged], ordinal[judged], value[judged], limit + allowed, self._delays, detail)
            )

    @property
    def broken(self) -> str | None:
        """Why the gyro's numbers mean nothing."""
        return self._scale if self._usable.broken else None

    def breaks(self) -> list[Break]:
        """Where the IMU's numbers lost or got their meaning."""
        return self._usable.breaks

    def why_not(self) -> str:
        """Why nothing was judged."""
        if self._scale is None:
            return "no message with a gyro was received"
        return f"no gyro sample came between two attitudes with rates ({self._scale})"

    @property
    def remark(self) -> str | None:
        """The unit that was taken for the numbers, where none is defined."""
        return self._scale if self._scale is not None and self._scale.startswith("assumed") else None
