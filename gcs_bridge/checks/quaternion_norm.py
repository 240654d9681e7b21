"""The norm of ATTITUDE_QUATERNION, which is 1 within rounding (rule M8): anything else is a fault of its own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.spec import AlarmSpec, RatedSamples
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

    @property
    def alarm_specs(self) -> tuple[AlarmSpec, ...]:
        """A warning and an alarm."""
        what = "the norm of ATTITUDE_QUATERNION is not 1"
        return AlarmSpec("warning", "warning", what, self._delays), AlarmSpec("alarm", "alarm", what, self._delays)

    def judge(self, batch: CheckBatch) -> Iterator[RatedSamples]:
        """Rate each finite quaternion, those without any attitude left included."""
        q = batch.quaternion.q_nb
        with np.errstate(over="ignore"):
            off = np.abs(np.sqrt(q[:, 0] ** 2 + q[:, 1] ** 2 + q[:, 2] ** 2 + q[:, 3] ** 2) - 1.0)
        numbers = finite(q)
        self._watch(batch.quaternion.t_boot_us, off, numbers)
        t_us, frame_index = batch.quaternion.t_boot_us[numbers], batch.quaternion.frame_index[numbers]
        for tier, limit in (("warning", self._settings.warning), ("alarm", self._settings.alarm)):
            yield RatedSamples(tier, rated(t_us, frame_index, off[numbers], limit, self._delays))

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "no quaternion of finite numbers was received"
