"""The norm of ATTITUDE_QUATERNION, which is 1 within rounding (rule M8): anything else is a fault of its own."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.votes import Votes, vote
from gcs_bridge.checks.base import NO_DETAIL, Check, Watched, is_known, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.columns import FloatRows, Int64s
from gcs_bridge.jit import kernel
from gcs_bridge.settings import AlarmSettings, QuaternionNormSettings

_ZERO = 2  # place of that alarm


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
        zero = self._alarm_spec(
            "zero",
            "alarm",
            "ATTITUDE_QUATERNION is all four zero: no attitude",
            delays,
            not_a_sign_of="not a stream that is missing: it comes, with nothing in it",
            unit="",
        )
        self.alarm_specs = *self._warning_and_alarm(what, delays, asks_doctor=True), zero
        self._zeros = np.zeros(2, np.int64)  # how many there were, and in the boot

    @property
    def zeros(self) -> int:
        """How many quaternions were all four zero."""
        return int(self._zeros[0])

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._zeros[1] = 0

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each finite quaternion, those without any attitude left included."""
        came = batch.quaternion
        if n := len(came):
            rate_norms(
                ballot.votes(3 * n),
                self._watching(n),
                self._places(ballot),
                self._limits,
                self._zeros,
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
    zeros: Int64s,
    frame_index: Int64s,
    t_us: Int64s,
    q: FloatRows,
) -> None:
    """Rate the norms of quaternions (n, 4); `zeros` (2,) counts those of zero, at all and since the boot's start."""
    for i in range(t_us.size):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        off = abs(np.sqrt(w * w + x * x + y * y + z * z) - 1.0)
        known = is_known((w, x, y, z))
        watch(watched, t_us[i], off, known)
        is_zero = w == 0.0 and x == 0.0 and y == 0.0 and z == 0.0
        zeros[0] += is_zero
        zeros[1] += is_zero
        if known and zeros[1]:
            vote(votes, places[_ZERO], frame_index[i], t_us[i], 1.0 if is_zero else 0.0, 0.5, NO_DETAIL)
        for k in range(2):
            if known and not is_zero:
                vote(votes, places[k], frame_index[i], t_us[i], off, limits[k], NO_DETAIL)
