"""The norm of ATTITUDE_QUATERNION, which is 1 within rounding (rule M8): anything else is a fault of its own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np

from gcs_bridge.checks.protocol import Check, Ratings, Tier, rated
from gcs_bridge.flight import Flight
from gcs_bridge.samples import finite
from gcs_bridge.settings import AlarmSettings, QuaternionNormSettings


class QuaternionNorm(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "quaternion_norm"
    needs: ClassVar[Literal["both", "quaternion", "any", "nothing"]] = "quaternion"
    compares: ClassVar[bool] = False
    unit: ClassVar[str] = "1"
    is_not: ClassVar[str] = "not a wrong angle: that is judged on a normalised copy"
    agrees: ClassVar[str] = "every quaternion has unit norm"

    def __init__(self, settings: QuaternionNormSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._delays = delays

    @property
    def tiers(self) -> tuple[Tier, ...]:
        """A warning and an alarm."""
        what = "the norm of ATTITUDE_QUATERNION is not 1"
        return Tier("warning", "warning", what, self._delays), Tier("alarm", "alarm", what, self._delays)

    def judge(self, flight: Flight) -> Iterator[Ratings]:
        """Rate each finite quaternion, those without any attitude left included."""
        q = flight.quaternion.q_nb
        with np.errstate(over="ignore"):
            off = np.abs(np.sqrt(q[:, 0] ** 2 + q[:, 1] ** 2 + q[:, 2] ** 2 + q[:, 3] ** 2) - 1.0)
        numbers = finite(q)
        self._watch(flight.quaternion.t_boot_us, off, numbers)
        t_us, ordinal = flight.quaternion.t_boot_us[numbers], flight.quaternion_ordinal[numbers]
        for tier, limit in (("warning", self._settings.warning), ("alarm", self._settings.alarm)):
            yield Ratings(tier, rated(t_us, ordinal, off[numbers], limit, self._delays))

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "no quaternion of finite numbers was received"
