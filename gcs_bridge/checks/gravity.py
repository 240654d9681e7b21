"""The down that the accelerometer sees against the attitude's down (rule M23): at rest they must be one.

In flight an accelerometer feels every force but gravity, so there only gross differences over seconds tell anything.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from msgspec.structs import replace

from gcs_bridge import attitude
from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.attitude import RestWatch
from gcs_bridge.checks.base import ImuCheck, length, rated
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.windows import SlidingSums
from gcs_bridge.columns import Floats, Int64s, Mask, RunningMax
from gcs_bridge.settings import AlarmSettings, GravitySettings
from gcs_bridge.telemetry.samples import finite


class Gravity(ImuCheck):
    """The check over one vehicle."""

    name: ClassVar[str] = "gravity"
    judges: ClassVar[Literal["f_b_m_s2", "w_b_rad_s"]] = "f_b_m_s2"
    not_a_sign_of: ClassVar[str] = "not the heading, which gravity cannot show"
    ok_text: ClassVar[str] = "at rest the accelerometer and the attitude see the same down"

    def __init__(self, settings: GravitySettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._delays = delays
        self._at_once = replace(delays, on_delay_s=0.0)
        # At rest a warning and an alarm; in flight an alarm.
        at_rest = "at rest the accelerometer's down is not the attitude's"
        gross = "for seconds the accelerometer's down is far from the attitude's"
        self._warning, self._alarm = self._warning_and_alarm(at_rest, delays)
        self._gross_alarm = self._alarm_spec("gross", "alarm", gross, self._at_once)
        self.alarm_specs = self._warning, self._alarm, self._gross_alarm
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._rest = RestWatch()
        self._sums = SlidingSums(self._settings.gross_window_s, 6)
        self._loud_us = RunningMax(-1)

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each sample of the IMU by the attitude at its time."""
        self._follow_scale(batch, ballot)
        seen = batch.imu_with_attitude.where(finite(batch.imu_with_attitude.f_b_m_s2))
        if not len(seen):
            return
        t_us, frame_index, force = seen.t_boot_us, seen.frame_index, seen.f_b_m_s2
        # The IMU's axes are the body's before the trim: both downs are compared there.
        q_nb = attitude.multiply(seen.q_nb, attitude.quaternion_from_rotvec(seen.trim_b_rad))
        reported = np.where(finite(seen.w_b_rad_s)[:, None], seen.w_b_rad_s, seen.w1_b_rad_s)
        resting = self._rest.feed(t_us * 1e-6, force, reported, seen.may_rest)
        value = attitude.accelerometer_tilt(q_nb, force)
        down = attitude.body_down(q_nb)
        self._watch(t_us, value, resting & np.isfinite(value))
        at = np.flatnonzero(resting & np.isfinite(value))
        detail = _between_downs(down[at], force[at], value[at], self._settings.warning_rad)
        for spec, limit in ((self._warning, self._settings.warning_rad), (self._alarm, self._settings.alarm_rad)):
            ballot.rate(spec, rated(t_us[at], frame_index[at], value[at], limit, self._delays, detail))
        self._gross(t_us, frame_index, force, reported, down, batch.fixed_wing.at(frame_index) == 1, ballot)

    def _gross(
        self,
        t_us: Int64s,
        frame_index: Int64s,
        force: Floats,
        rates: Floats,
        down: Floats,
        fixed_wing: Mask,
        ballot: Ballot,
    ) -> None:
        """The mean specific force of some seconds against the mean down, while the vehicle turns slowly."""
        settings = self._settings
        size = np.sqrt(rates[:, 0] ** 2 + rates[:, 1] ** 2 + rates[:, 2] ** 2)
        loud = ~(size < settings.gross_below_rad_s)
        # On fixed wings a coordinated turn feels level.
        loud |= fixed_wing & (np.abs(np.arctan2(down[:, 1], down[:, 2])) > settings.gross_bank_rad)
        loud_us = self._loud_us.feed(np.where(loud, t_us, -1))[1:]
        sums, _, since_us = self._sums.feed(t_us, np.hstack((force, down)))
        window_us = settings.gross_window_s * 1e6
        rows = np.flatnonzero((t_us - since_us >= 0.8 * window_us) & (t_us - loud_us >= window_us))
        mean_force, mean_down = sums[rows, :3], sums[rows, 3:]
        seen = attitude.down_from_specific_force(mean_force)
        angle = np.arctan2(length(np.cross(mean_down, seen)), np.sum(mean_down * seen, axis=1))
        known = np.isfinite(angle)
        rows, angle = rows[known], angle[known]
        detail = _between_downs(mean_down[known], mean_force[known], angle, settings.gross_rad)
        ballot.rate(
            self._gross_alarm, rated(t_us[rows], frame_index[rows], angle, settings.gross_rad, self._at_once, detail)
        )

    def why_not(self) -> str:
        """Why nothing was judged."""
        if self._scale is None:
            return "no message with an accelerometer was received"
        return "the vehicle was never known to be at rest for 3 s while its attitude came"


def _between_downs(down: Floats, force: Floats, angle: Floats, above_rad: float) -> Floats:
    """The detail (n, 5) of turns above a limit from the attitude's down to the accelerometer's: all of it tilt."""
    detail = np.full((len(angle), 5), np.nan)
    bad = angle > above_rad
    if bad.any():
        detail[bad] = _tilting(down[bad], force[bad], angle[bad])
    return detail


def _tilting(down: Floats, force: Floats, angle: Floats) -> Floats:
    seen = attitude.down_from_specific_force(force)
    axis = np.cross(seen, down)  # the attitude must turn the other way to see what the accelerometer sees
    size = length(axis)
    turn = axis * np.divide(angle, size, out=np.zeros_like(size), where=size > 0)[:, None]
    return np.column_stack((angle, np.full_like(angle, np.nan), turn))
