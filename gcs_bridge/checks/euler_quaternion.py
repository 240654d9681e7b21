"""ATTITUDE against ATTITUDE_QUATERNION: the two forms of one estimate, which must be one rotation.

Compared on SO(3), never angle by angle, then split into tilt and heading (rule M17). As both messages come from one
estimate, this check finds mistakes of convention, encoding, timing and firmware, and never an estimator that is wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.alarms import Rated
from gcs_bridge.align import Pairs
from gcs_bridge.settings import EulerQuaternionSettings
from gcs_bridge.statistics import Quantiles

NAME = "euler_quaternion"

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Disagreement:
    """The quaternion seen from the Euler angles, n pairs: all in rad.

    `angle` (n,) of the rotation between them; `tilt` and `heading` (n,) its parts, heading NaN where it means nothing;
    `rotvec_body` (n, 3) the rotation in FRD body axes; `limit` (n,); `judged` (n,) whether a pair could be told good or
    bad at all; `counted` (n,) whether it has a vote in the alarm.
    """

    angle: Floats
    tilt: Floats
    heading: Floats
    rotvec_body: Floats
    limit: Floats
    judged: Mask
    counted: Mask


def compare(pairs: Pairs, settings: EulerQuaternionSettings, last_bracket: int = -1) -> Disagreement:
    """Judge each pair by a limit that grows with the bound of its alignment.

    A pair above its limit is bad; one below it is good only if the bound leaves anything to tell, else it is not
    judged. `last_bracket` is that of the pair before the first: pairs on one step of the faster stream count once.
    """
    delta = attitude.multiply(attitude.conjugate(pairs.q_euler), pairs.q_quaternion)
    tilt, heading = attitude.tilt_heading_between(pairs.q_euler, pairs.q_quaternion)
    angle = attitude.angle_between(pairs.q_euler, pairs.q_quaternion)
    limit = settings.limit_rad + pairs.bound_rad  # NaN where the bound is unknown: then not judged
    judged = ((angle > limit) | (pairs.bound_rad <= settings.usable_bound_rad)) & ~pairs.after_reset
    bracket_before = np.concatenate(([last_bracket], pairs.bracket))[:-1]
    counted = judged & ((pairs.bracket == -1) | (pairs.bracket != bracket_before))
    return Disagreement(angle, tilt, heading, attitude.rotvec_from_quaternion(delta), limit, judged, counted)


class EulerQuaternion:
    """The check over one vehicle: what its alarm is to be fed, and the numbers of the report."""

    def __init__(self, settings: EulerQuaternionSettings) -> None:
        """Start with nothing judged."""
        self.pairs = 0
        self.same_instant = 0
        self.judged_us = 0
        self.counted = 0  # of the pairs, those that had a vote
        self.bad = 0  # and of these, those above their limit
        self.angle, self.tilt, self.heading = Quantiles(), Quantiles(), Quantiles()
        self._settings = settings
        self._last_bracket = -1

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        self._last_bracket = -1

    def judge(self, pairs: Pairs) -> tuple[Disagreement, Rated, npt.NDArray[np.int64]]:
        """Compare the pairs; return that, the ones that count as rated samples, and their rows.

        The samples' `detail` is tilt, heading and the rotation vector, in rad.
        """
        found = compare(pairs, self._settings, self._last_bracket)
        if len(pairs):
            self._last_bracket = int(pairs.bracket[-1])
        self.pairs += int(found.judged.sum())
        self.same_instant += int((found.judged & pairs.same_instant).sum())
        self.judged_us += int(pairs.stands_for_us[found.judged].sum())
        self.angle.add(found.angle[found.judged])
        self.tilt.add(found.tilt[found.judged])
        self.heading.add(np.abs(found.heading[found.judged]))
        rows = np.flatnonzero(found.counted)
        angle, limit = found.angle[rows], found.limit[rows]
        detail = np.column_stack((found.tilt[rows], found.heading[rows], found.rotvec_body[rows]))
        self.counted += len(rows)
        self.bad += int((angle > limit).sum())
        bad, low = angle > limit, angle <= self._settings.clear_below * limit
        return found, Rated(pairs.t_boot_us[rows], angle, bad, low, detail), rows

    def numbers(self) -> dict[str, object]:
        """The report's numbers, in degrees."""
        angle, tilt, heading = (q.summary(math.degrees(1.0)) for q in (self.angle, self.tilt, self.heading))
        return {
            "pairs": self.pairs,
            "same_instant": self.same_instant,
            "unit": "deg",
            "residual": angle,
            "raw": angle,
            "tilt": tilt,
            "heading": heading,
        }
