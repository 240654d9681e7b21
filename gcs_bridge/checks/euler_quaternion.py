"""ATTITUDE against ATTITUDE_QUATERNION: the two forms of one estimate, which must be one rotation.

Compared on SO(3), never angle by angle, then split into tilt and heading (rule M17). As both messages come from one
estimate, this check finds mistakes of convention, encoding, timing and firmware, and never an estimator that is wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from msgspec.structs import replace

from gcs_bridge import attitude
from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.checks.base import Check, Numbers, length, rated
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.quantiles import Quantiles
from gcs_bridge.checks.windows import SlidingSums
from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, RunningMax
from gcs_bridge.pairing.neighbours import in_order
from gcs_bridge.pairing.pairs import Pairs
from gcs_bridge.settings import AlarmSettings, EulerQuaternionSettings
from gcs_bridge.telemetry.samples import finite


@dataclass(frozen=True, kw_only=True)
class Disagreement(FrameColumns):
    """The quaternion seen from the Euler angles, n pairs: all in rad.

    `angle` (n,) of the rotation between them; `tilt` and `heading` (n,) its parts, heading NaN where it means nothing;
    `rotvec_body`, `rotvec_world` (n, 3) the rotation in FRD body axes and in NED; `limit` (n,); `judged` (n,) whether a
    pair could be told good or bad at all; `counted` (n,) whether it has a vote in the alarm.
    """

    angle: Floats
    tilt: Floats
    heading: Floats
    rotvec_body: Floats
    rotvec_world: Floats
    limit: Floats
    judged: Mask
    counted: Mask


def compare(pairs: Pairs, settings: EulerQuaternionSettings, last_interval_id: int = -1) -> Disagreement:
    """Judge each pair by a limit that grows with the bound of its alignment.

    A pair above its limit is bad; one below it is good only if the bound leaves anything to tell, else it is not
    judged. `last_interval_id` is that of the pair before the first: pairs on one step of the faster stream count once.
    """
    delta = attitude.multiply(attitude.conjugate(pairs.q_euler), pairs.q_quaternion)
    tilt, heading = attitude.tilt_heading_between(pairs.q_euler, pairs.q_quaternion)
    angle = attitude.angle_between(pairs.q_euler, pairs.q_quaternion)
    rotvec_body = attitude.rotvec_from_quaternion(delta)
    rotvec_world = attitude.rotate(pairs.q_euler, rotvec_body)
    limit = settings.limit_rad + pairs.bound_rad  # NaN where the bound is unknown: then not judged
    judged = ((angle > limit) | (pairs.bound_rad <= settings.usable_bound_rad)) & ~pairs.after_reset
    interval_before = np.concatenate(([last_interval_id], pairs.interval_id))[:-1]
    counted = judged & ((pairs.interval_id == -1) | (pairs.interval_id != interval_before))
    return Disagreement(
        frame_index=pairs.frame_index,
        angle=angle,
        tilt=tilt,
        heading=heading,
        rotvec_body=rotvec_body,
        rotvec_world=rotvec_world,
        limit=limit,
        judged=judged,
        counted=counted,
    )


class EulerQuaternion(Check):
    """The check over one vehicle: votes over single pairs, and their mean for small constant offsets."""

    name: ClassVar[str] = "euler_quaternion"
    needs: ClassVar[Literal["both", "quaternion", "any", "nothing"]] = "both"
    not_a_sign_of: ClassVar[str] = "not an estimator that is wrong: both messages come from one estimate"
    ok_text: ClassVar[str] = "both forms are one rotation, within the limit and the bound of each comparison"

    def __init__(self, settings: EulerQuaternionSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self.same_instant = 0
        self.counted = 0  # of the pairs, those that had a vote
        self.bad = 0  # and of these, those above their limit
        self.raw, self.tilt, self.heading = Quantiles(), Quantiles(), Quantiles()
        self.found: Disagreement | None = None  # of the last batch
        self._along_rate, self._rate_squared = 0.0, 0.0  # sums, for the lag
        self._settings = settings
        self._delays = delays
        self._slow = replace(delays, bad_samples=1, counted_samples=1, on_delay_s=settings.mean_hold_s)
        self._pairs = self._alarm_spec(
            "pairs",
            "alarm",
            "ATTITUDE and ATTITUDE_QUATERNION are not one rotation",
            delays,
            id_part=self.name,
            recurring_window_s=settings.recurring_window_s,
            asks_doctor=True,
        )
        self._mean_turn = self._alarm_spec(
            "mean",
            "warning",
            "ATTITUDE and ATTITUDE_QUATERNION differ by a small constant turn",
            self._slow,
            asks_doctor=True,
            onset_lead_s=settings.mean_window_s + settings.mean_hold_s,
        )
        self.alarm_specs = self._pairs, self._mean_turn
        self._last_interval_id = -1
        self._start_mean()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._last_interval_id = -1
        self._start_mean()

    def _start_mean(self) -> None:
        self._sums = SlidingSums(self._settings.mean_window_s, 8)
        self._latest_us = -1
        self._first_us: int | None = None
        self._bad_us, self._onset_us = RunningMax(-_CALM_US), RunningMax(-_CALM_US)

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Compare the pairs, and rate those that count."""
        pairs = batch.pairs
        self.found = found = compare(pairs, self._settings, self._last_interval_id)
        if not len(pairs):
            return
        self._last_interval_id = int(pairs.interval_id[-1])
        self._watched["judged"] += found.judged.sum()
        self.same_instant += int((found.judged & pairs.same_instant).sum())
        self._watched["judged_us"] += pairs.duration_us[found.judged].sum()
        self.residual.add(found.angle[found.judged])
        self._follow_lag(pairs.w_nb_b_rad_s[found.judged], found.rotvec_body[found.judged])
        as_sent = pairs.q_euler_sent
        raw = found.angle if as_sent is pairs.q_euler else attitude.angle_between(as_sent, pairs.q_quaternion)
        self.raw.add(raw[found.judged])
        self.tilt.add(found.tilt[found.judged])
        self.heading.add(np.abs(found.heading[found.judged]))
        found.counted[self._withheld(batch, found)] = False
        rows = np.flatnonzero(found.counted)
        angle, limit = found.angle[rows], found.limit[rows]
        detail = np.column_stack((found.tilt, found.heading, found.rotvec_body))[rows]
        self.counted += len(rows)
        self.bad += int((angle > limit).sum())
        t_us, frame_index = pairs.t_boot_us[rows], pairs.frame_index[rows]
        ballot.rate(self._pairs, rated(t_us, frame_index, angle, limit, self._delays, detail))
        self._mean(batch, found, ballot)

    def _withheld(self, batch: CheckBatch, found: Disagreement) -> Int64s:
        """Pairs that disagree as a firmware may on purpose, while that could still be found out.

        What a firmware does is told by parameters and modes, or fitted to some pairs: both take a moment. For so long
        after its onset a disagreement has no vote if it is a turn about the body's y axis on an ArduPlane (a trim, a
        view), or, where it is there from a boot's first seconds on, no larger than AHRS_TRIM could make it there.
        """
        t_us = batch.pairs.t_boot_us
        if self._first_us is None:
            self._first_us = int(t_us[0])
        bad = np.flatnonzero(found.counted & (found.angle > found.limit))
        bad = np.asarray(bad[batch.ardupilot.at(batch.pairs.frame_index[bad]) != 0])  # NaN: not known yet
        if not len(bad):
            return bad
        at_us = self._bad_us.feed(t_us[bad])
        fresh = np.diff(at_us) > _CALM_US
        onset_us = self._onset_us.feed(np.where(fresh, at_us[1:], -1))[1:]
        turn = found.rotvec_body[bad]
        about_y = np.hypot(turn[:, 0], turn[:, 2]) <= _OFF_AXIS * found.angle[bad] + found.limit[bad]
        q_nb = batch.pairs.q_quaternion[bad]
        tilt = np.arccos(np.clip(attitude.body_down(q_nb)[:, 2], -1.0, 1.0))
        by_trim = found.angle[bad] <= 2.0 * np.sin(tilt / 2.0) * _MOST_TRIM_RAD + found.limit[bad]
        starting = onset_us - self._first_us < _START_US
        slow = batch.pairs.duration_us[bad] >= _SLOW_US
        young = at_us[1:] - onset_us < np.where(slow, _HELD_SLOW_US, _HELD_US)
        return np.asarray(
            bad[young & ((about_y & (batch.fixed_wing.at(batch.pairs.frame_index[bad]) != 0)) | (by_trim & starting))]
        )

    def _mean(self, batch: CheckBatch, found: Disagreement, ballot: Ballot) -> None:
        """The mean turn of the last seconds' good pairs, in world and body axes: noise averages out, offsets don't."""
        pairs = batch.pairs
        good = np.flatnonzero(found.judged & (found.angle <= found.limit) & np.isfinite(found.rotvec_body[:, 0]))
        good = good[in_order(pairs.t_boot_us[good], self._latest_us)]
        if not len(good):
            return
        t_us = pairs.t_boot_us[good]
        self._latest_us = int(t_us[-1])
        bound = pairs.bound_rad[good, None]
        weight = 1.0 / (_WEIGHT_FLOOR_RAD + bound) ** 2
        turns = np.hstack((found.rotvec_body[good], found.rotvec_world[good]))
        sums, count, since_us = self._sums.feed(t_us, np.hstack((weight, (weight * bound) ** 2, weight * turns)))
        mean = sums[:, 2:] / sums[:, :1]
        value = np.maximum(length(mean[:, :3]), length(mean[:, 3:]))
        limit = self._settings.mean_limit_rad + np.sqrt(np.maximum(sums[:, 1], 0.0)) / sums[:, 0]
        enough = (count >= self._settings.mean_pairs) & (t_us - since_us >= 0.5e6 * self._settings.mean_window_s)
        detail = np.hstack((found.tilt[good, None], found.heading[good, None], mean[:, :3]))[enough]
        ballot.rate(
            self._mean_turn,
            rated(t_us[enough], pairs.frame_index[good][enough], value[enough], limit[enough], self._slow, detail),
        )

    def _follow_lag(self, w_b_rad_s: Floats, rotvec_body: Floats) -> None:
        """Sum up, pair after pair, how the difference goes along the rate: a stamp that is late makes it so."""
        known = finite(w_b_rad_s) & finite(rotvec_body) & (length(w_b_rad_s) < _GREATEST_RATE_RAD_S)
        w, turn = w_b_rad_s[known], rotvec_body[known]
        self._along_rate = float(np.cumsum(np.concatenate(([self._along_rate], (w * turn).sum(axis=1))))[-1])
        self._rate_squared = float(np.cumsum(np.concatenate(([self._rate_squared], (w**2).sum(axis=1))))[-1])

    @property
    def lag_ms(self) -> float | None:
        """By how much the quaternion's stamps are late, by the whole recording; None without much motion.

        A regression, and so small where any other mistake makes the difference: a diagnosis tells better.
        """
        if self._rate_squared < _LEAST_RATE_RAD_S**2 * max(self.judged, 1):
            return None
        return -1e3 * self._along_rate / self._rate_squared

    def why_not(self) -> str:
        """Why nothing was judged."""
        return f"only {self.judged} pairs could be judged"

    def numbers(self) -> Numbers:
        """The report's numbers, in degrees."""
        numbers = super().numbers()
        numbers["same_instant"] = self.same_instant
        numbers["raw"] = self.distribution(self.raw)
        numbers["tilt"], numbers["heading"] = self.distribution(self.tilt), self.distribution(self.heading)
        return numbers


_CALM_US = 5_000_000  # without a bad pair, before the next one is a new onset
_HELD_US, _HELD_SLOW_US = 3_000_000, 6_000_000  # how long a disagreement may be withheld; for pairs that come slowly
_SLOW_US = 400_000
_START_US = 3_000_000
_OFF_AXIS = 0.05  # share of a turn that may be about other axes
_MOST_TRIM_RAD = math.radians(10.0)
_WEIGHT_FLOOR_RAD = math.radians(0.05)
_GREATEST_RATE_RAD_S = 100.0  # what is more is damage
_LEAST_RATE_RAD_S = math.radians(2.0)  # root mean square, below which no lag shows
