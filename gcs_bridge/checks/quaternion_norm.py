"""The norm of ATTITUDE_QUATERNION, which is 1 within rounding (rule M8): anything else is a fault of its own."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.votes import Ballot, Votes, vote
from gcs_bridge.checks.base import NO_DETAIL, Check, Watched, is_known, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.columns import FloatRows, Int64s
from gcs_bridge.jit import kernel
from gcs_bridge.settings import AlarmSettings, QuaternionNormSettings


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
        self._limits = settings.warning, settings.alarm
        what = "the norm of ATTITUDE_QUATERNION is not 1"
        self.alarm_specs = self._warning_and_alarm(what, delays, asks_doctor=True)

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each finite quaternion, those without any attitude left included."""
        came = batch.quaternion
        if n := len(came):
            rate_norms(
                ballot.votes(2 * n),
                self._watching(n),
                self._places(ballot),
                self._limits,
                came.frame_index,
                came.t_boot_us,
                came.q_nb,
            )

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "no quaternion of finite numbers was received"


@kernel
def rate_norms(
    votes: Votes,
    watched: Watched,
    places: Int64s,
    limits: tuple[float, float],
    frame_index: Int64s,
    t_us: Int64s,
    q: FloatRows,
) -> None:
    """Rate the norms of quaternions (n, 4)."""
    for i in range(t_us.size):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        off = abs(np.sqrt(w * w + x * x + y * y + z * z) - 1.0)
        known = is_known((w, x, y, z))
        watch(watched, t_us[i], off, known)
        for k in range(2):
            if known:
                vote(votes, places[k], frame_index[i], t_us[i], off, limits[k], NO_DETAIL)
