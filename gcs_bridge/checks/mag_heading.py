"""The compass against the attitude's heading, once their constant difference is known: information, never an alarm.

The difference is declination, mounting and hard iron together; currents and steel shift it by tens of degrees on
healthy aircraft.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.checks.base import Check, length
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.settings import MagHeadingSettings

_LEAST_GAUSS = 0.01  # the earth's field is 0.2 to 0.7: what reads less is no compass


class MagHeading(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "mag_heading"
    not_a_sign_of: ClassVar[str] = "not the tilt, which a compass cannot show"
    ok_text: ClassVar[str] = "followed for information: it raises no alarm"

    def __init__(self, settings: MagHeadingSettings) -> None:
        """Start with nothing judged; no alarm: a compass alone never decides."""
        super().__init__()
        self._settings = settings
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._first_us: int | None = None
        self._mean = np.zeros((1, 2))  # running sum of the difference's direction

    def judge(self, batch: CheckBatch, _ballot: Ballot) -> None:
        """Follow the difference; nothing is rated."""
        seen = batch.imu_with_attitude.where(length(batch.imu_with_attitude.m_b_gauss) > _LEAST_GAUSS)
        if not len(seen):
            return
        t_us = seen.t_boot_us
        if self._first_us is None:
            self._first_us = int(t_us[0])
        # With the attitude's own heading the field lies in one direction: north, but for the constant difference.
        field_n = attitude.rotate(seen.q_nb, seen.m_b_gauss)
        size = np.hypot(field_n[:, 0], field_n[:, 1])
        direction = np.divide(field_n[:, :2], size[:, None], out=np.zeros((len(size), 2)), where=size[:, None] > 0)
        sums = np.cumsum(np.concatenate((self._mean[-1:], direction)), axis=0)
        self._mean = sums[-1:]
        mean = sums[:-1]
        cross = mean[:, 0] * direction[:, 1] - mean[:, 1] * direction[:, 0]
        value = np.abs(np.arctan2(cross, (mean * direction).sum(axis=1)))
        rates, down = np.nan_to_num(seen.w1_b_rad_s), attitude.body_down(seen.q_nb)
        calm = (length(rates) < self._settings.quiet_below_rad_s) & (down[:, 2] > np.cos(self._settings.quiet_bank_rad))
        self._watch(t_us, value, calm & (t_us - self._first_us >= self._settings.skipped_s * 1e6) & (size > 0))

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "too little of a magnetic field of known unit was received while the vehicle flew calmly"

    @property
    def remark(self) -> str | None:
        """That the difference grew large: a hint, and no more."""
        off = self.residual.quantile(0.95)
        if off > self._settings.information_rad:
            return f"in a twentieth of it the compass was off by more than {math.degrees(off):.0f}°: a hint, no alarm"
        return None
