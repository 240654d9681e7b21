"""The body rates of ATTITUDE against those of ATTITUDE_QUATERNION at the same instant: one estimate has one set."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.checks.base import Check, along, length, rated
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.settings import AlarmSettings, BodyRatesSettings


class BodyRates(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "body_rates"
    needs: ClassVar[Literal["both", "quaternion", "any", "nothing"]] = "both"
    compares: ClassVar[bool] = False
    unit: ClassVar[str] = "deg/s"
    not_a_sign_of: ClassVar[str] = "not the angles: they are judged by other checks"
    ok_text: ClassVar[str] = "both messages carry the same body rates"

    def __init__(self, settings: BodyRatesSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._delays = delays
        what = "the body rates of ATTITUDE and ATTITUDE_QUATERNION differ"
        self.alarm_specs = self._warning, self._alarm = self._warning_and_alarm(what, delays)

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate the pairs of the same instant, with what the streams' own last steps allow for."""
        pairs = batch.pairs
        rows = np.flatnonzero(pairs.same_instant)
        difference, allowed = pairs.w_differs_b_rad_s[rows], pairs.unsteady_rad_s[rows]
        value = length(difference)
        judged = np.isfinite(value) & np.isfinite(allowed)
        t_us, frame_index = pairs.t_boot_us[rows], pairs.frame_index[rows]
        self._watch(t_us, value, judged)
        detail = along(difference[judged])
        for spec, limit in ((self._warning, self._settings.warning_rad_s), (self._alarm, self._settings.alarm_rad_s)):
            limits = limit + allowed[judged]
            ballot.rate(spec, rated(t_us[judged], frame_index[judged], value[judged], limits, self._delays, detail))

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "the two messages never came at the same instant with rates in both"
