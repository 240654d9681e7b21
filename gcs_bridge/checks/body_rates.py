"""The body rates of ATTITUDE against those of ATTITUDE_QUATERNION at the same instant: one estimate has one set."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.votes import Votes, vote
from gcs_bridge.attitude.quaternion import length
from gcs_bridge.checks.base import Check, Watched, row_at, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask
from gcs_bridge.jit import kernel
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
        self._limits = settings.warning_rad_s, settings.alarm_rad_s
        what = "the body rates of ATTITUDE and ATTITUDE_QUATERNION differ"
        self.alarm_specs = self._warning_and_alarm(what, delays)

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate the pairs of the same instant, with what the streams' own last steps allow for."""
        pairs = batch.pairs
        if n := len(pairs):
            rate_differences(
                ballot.votes(2 * n),
                self._watching(n),
                self._places(ballot),
                self._limits,
                pairs.frame_index,
                pairs.t_boot_us,
                pairs.same_instant,
                pairs.w_differs_b_rad_s,
                pairs.unsteady_rad_s,
            )

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "the two messages never came at the same instant with rates in both"


@kernel
def rate_differences(
    votes: Votes,
    watched: Watched,
    places: Int64s,
    limits: tuple[float, float],
    frame_index: Int64s,
    t_us: Int64s,
    same_instant: Mask,
    difference: FloatRows,
    unsteady: Floats,
) -> None:
    """Rate the differences of rates (n, 3), rad/s, each with what is `unsteady` (n,) of it."""
    for i in range(t_us.size):
        if not same_instant[i]:
            continue
        x, y, z = row_at(difference, i)
        value, allowed = length((x, y, z)), unsteady[i]
        judged = np.isfinite(value) and np.isfinite(allowed)
        watch(watched, t_us[i], value, judged)
        for k in range(2):
            if judged:
                vote(votes, places[k], frame_index[i], t_us[i], value, limits[k] + allowed, (np.nan, np.nan, x, y, z))
