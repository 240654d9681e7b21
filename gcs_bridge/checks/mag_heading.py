"""The compass against the attitude's heading, once their constant difference is known: information, never an alarm.

The difference is declination, mounting and hard iron together; currents and steel shift it by tens of degrees on
healthy aircraft. While banked a little tilt turns a compass far: there twice as much is allowed. A heading that never
agreed with the compass is of another kind, as a GPS yaw is, and then neither tells anything of the other.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

import numpy as np

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.attitude.compiled import ray_at, vector_at
from gcs_bridge.attitude.gravity import down_of
from gcs_bridge.attitude.quaternion import length, turned
from gcs_bridge.checks.base import Check, Watched, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.columns import FloatRows, Int64s, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.seen import rates_of
from gcs_bridge.settings import MagHeadingSettings

_HINT = 0.05  # of the samples
_LEAST_GAUSS = 0.01  # the earth's field is 0.2 to 0.7: what reads less is no compass


_STATE = np.dtype(
    [
        ("started", "i8"),
        ("first_us", "i8"),  # the first field
        ("north", "f8"),  # running sum of the difference's direction
        ("east", "f8"),
        # Of the settings.
        ("skipped_us", "f8"),
        ("quiet_below_rad_s", "f8"),
        ("quiet_down", "f8"),  # the cosine of the bank
        ("level_down", "f8"),
        ("most_rad", "f8"),
        ("banked_times", "f8"),
    ]
)


class MagHeading(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "mag_heading"
    not_a_sign_of: ClassVar[str] = "not the tilt, which a compass cannot show"
    ok_text: ClassVar[str] = "followed for information: it raises no alarm"

    def __init__(self, settings: MagHeadingSettings) -> None:
        """Start with nothing judged; no alarm: a compass alone never decides."""
        super().__init__()
        self._settings = settings
        self._off = np.zeros(1, np.int64)
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        settings = self._settings
        self._state = np.zeros(1, _STATE)
        self._state["skipped_us"] = settings.skipped_s * 1e6
        self._state["quiet_below_rad_s"], self._state["quiet_down"] = (
            settings.quiet_below_rad_s,
            np.cos(settings.quiet_bank_rad),
        )
        self._state["level_down"], self._state["most_rad"] = np.cos(settings.level_bank_rad), settings.information_rad
        self._state["banked_times"] = settings.banked_times

    def judge(self, batch: CheckBatch, _ballot: Ballot) -> None:
        """Follow the difference; nothing is rated."""
        seen = batch.imu_with_attitude
        if n := len(seen):
            follow_difference(
                self._watching(n),
                self._state,
                self._off,
                seen.t_boot_us,
                seen.m_b_gauss,
                seen.q_nb,
                seen.w1_b_rad_s,
            )

    @property
    def tells(self) -> bool:
        """Whether compass and heading agreed more often than not."""
        return 2 * self._off.item(0) <= self.judged

    def why_not(self) -> str:
        """Why nothing was judged."""
        if not self.tells:
            return "the compass and the heading never agreed for long: they are of different kinds"
        return "too little of a magnetic field of known unit was received while the vehicle flew calmly"

    @property
    def remark(self) -> str | None:
        """That the difference grew large: a hint, and no more."""
        if not self.tells or self._off.item(0) <= _HINT * self.judged:
            return None
        off = math.degrees(self.residual.quantile(0.95))
        return f"in a twentieth of it the compass was off by more than {off:.0f}°: a hint, no alarm"


@kernel
def follow_difference(
    watched: Watched,
    states: Annotated[Records, _STATE],
    often_off: Int64s,
    t_us: Int64s,
    field_b: FloatRows,
    q_nb: FloatRows,
    w: FloatRows,
) -> None:
    """Follow the compass's difference at samples (n,) with their attitude; `w` (n, 3) are its rates.

    `often_off` (1,) counts what is off by more than is usual.
    """
    state = states[0]
    for i in range(t_us.size):
        field = vector_at(field_b, i)
        if not length(field) > _LEAST_GAUSS:
            continue
        if not state.started:
            state.started, state.first_us = 1, t_us[i]
        q, norm2 = ray_at(q_nb, i)
        # With the attitude's own heading the field lies in one direction: north, but for the constant difference.
        x, y, _ = turned(q, norm2, field)
        size = np.hypot(x, y)
        judged = size > 0 and t_us[i] - state.first_us >= state.skipped_us and _is_calm(state, q, norm2, w, i)
        north, east = (x / size, y / size) if size > 0 else (0.0, 0.0)
        cross, along = state.north * east - state.east * north, state.north * north + state.east * east
        off = abs(np.arctan2(cross, along)) if judged else 0.0
        state.north, state.east = state.north + north, state.east + east
        most = state.most_rad if down_of(q, norm2)[2] >= state.level_down else state.banked_times * state.most_rad
        often_off[0] += judged and off > most
        watch(watched, t_us[i], off, judged)


@helper
def _is_calm(state: Any, q: Any, norm2: Any, rates: Any, i: Any) -> Any:
    """Whether the vehicle neither turns fast nor is banked far."""
    rate = length(rates_of(rates[i, 0], rates[i, 1], rates[i, 2]))
    return rate < state.quiet_below_rad_s and down_of(q, norm2)[2] > state.quiet_down
