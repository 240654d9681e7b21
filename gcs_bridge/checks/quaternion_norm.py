"""The norm of ATTITUDE_QUATERNION, which is 1 within rounding (rule M8): anything else is a fault of its own."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.checks.base import Check, rated
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.settings import AlarmSettings, QuaternionNormSettings
from gcs_bridge.telemetry.samples import finite


class QuaternionNorm(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "quaternion_norm"
    needs: ClassVar[Literal["both", "quaternion", "any", "nothing"]] = "quaternion"
    compares: ClassVar[bool] = False
    unit: ClassVar[str] = "1"
    not_a_sign_of: ClassVar[str] = "not a wrong angle: that is judged on a normalised copy"
    ok_text: ClassVar[str] = "every quaternion has unit norm"

    def __init__(self, settings: QuaternionNormSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._delays = delays
        what = "the norm of ATTITUDE_QUATERNION is not 1"
        self.alarm_specs = self._warning, self._alarm = self._warning_and_alarm(what, delays, asks_doctor=True)

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each finite quaternion, those without any attitude left included."""
        q = batch.quaternion.q_nb
        with np.errstate(over="ignore"):
            off = np.abs(np.sqrt(q[:, 0] ** 2 + q[:, 1] ** 2 + q[:, 2] ** 2 + q[:, 3] ** 2) - 1.0)
        numbers = finite(q)
        self._watch(batch.quaternion.t_boot_us, off, numbers)
        t_us, frame_index = batch.quaternion.t_boot_us[numbers], batch.quaternion.frame_index[numbers]
        for spec, limit in ((self._warning, self._settings.warning), (self._alarm, self._settings.alarm)):
            ballot.rate(spec, rated(t_us, frame_index, off[numbers], limit, self._delays))

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "no quaternion of finite numbers was received"
