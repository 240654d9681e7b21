"""ATTITUDE against ATTITUDE_QUATERNION: the two forms of one estimate, which must be one rotation.

Compared on SO(3), never angle by angle, then split into tilt and heading (rule M17). As both messages come from one
estimate, this check finds mistakes of convention, encoding, timing and firmware, and never an estimator that is wrong.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from msgspec.structs import replace

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.votes import Votes, forget_samples, vote
from gcs_bridge.attitude.compiled import put, ray_at
from gcs_bridge.attitude.quaternion import angle_of, conjugated, length, logarithm, product, tilt_heading_of, turned
from gcs_bridge.checks.base import Check, Numbers, Watched, is_known, row_at
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.disagreement import NO_DISAGREEMENT, Disagreement
from gcs_bridge.checks.quantiles import Quantiles, Waiting, note
from gcs_bridge.checks.windows import Sliding, SlidingSums, slide_in
from gcs_bridge.checks.withheld import CALM_US, LEVEL_TRIM_RAD, is_withheld
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.settings import AlarmSettings, EulerQuaternionSettings
from gcs_bridge.telemetry.statements import held_at

_WEIGHT_FLOOR_RAD = math.radians(0.05)
_GREATEST_RATE_RAD_S = 100.0  # what is more is damage
_LEAST_RATE_RAD_S = math.radians(2.0)  # root mean square, below which no lag shows


_MEMORY = np.dtype(
    [
        # Of all boots.
        ("same_instant", "i8"),  # of the judged pairs, those of one instant
        ("counted", "i8"),  # of the pairs, those that had a vote
        ("bad", "i8"),  # and of these, those above their limit
        ("along_rate", "f8"),  # sums, for the lag
        ("rate_squared", "f8"),
        # Of one boot.
        ("interval_id", "i8"),  # of the pair before
        ("first_us", "i8"),  # of the first pair, -1 before it
        ("latest_us", "i8"),  # of the mean
        ("bad_us", "i8"),  # the latest bad pair
        ("onset_us", "i8"),  # of the present disagreement
        ("is_fault", "i8"),  # whether a pair of it was none that a firmware makes on purpose
        ("explained", "f8"),  # how often a trim had been fitted by then
        ("spoken_for", "f8"),  # and when a pair last agreed
    ]
)


class _Limits(NamedTuple):
    """What of the settings the kernel needs."""

    limit_rad: float
    usable_bound_rad: float
    mean_limit_rad: float
    mean_pairs: int
    mean_window_s: float


class EulerQuaternion(Check):
    """The check over one vehicle: votes over single pairs, and their mean for small constant offsets."""

    name: ClassVar[str] = "euler_quaternion"
    needs: ClassVar[Literal["both", "quaternion", "any", "nothing"]] = "both"
    not_a_sign_of: ClassVar[str] = "not an estimator that is wrong: both messages come from one estimate"
    ok_text: ClassVar[str] = "both forms are one rotation, within the limit and the bound of each comparison"

    def __init__(self, settings: EulerQuaternionSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self.raw, self.tilt, self.heading = Quantiles(), Quantiles(), Quantiles()
        self.found: Disagreement | None = None  # of the last batch
        self._limits = _Limits(
            limit_rad=settings.limit_rad,
            usable_bound_rad=settings.usable_bound_rad,
            mean_limit_rad=settings.mean_limit_rad,
            mean_pairs=settings.mean_pairs,
            mean_window_s=settings.mean_window_s,
        )
        pairs = self._alarm_spec(
            "pairs",
            "alarm",
            "ATTITUDE and ATTITUDE_QUATERNION are not one rotation",
            delays,
            id_part=self.name,
            recurring_window_s=settings.recurring_window_s,
            asks_doctor=True,
        )
        mean = self._alarm_spec(
            "mean",
            "warning",
            "ATTITUDE and ATTITUDE_QUATERNION differ by a small constant turn",
            replace(delays, bad_samples=1, counted_samples=1, on_delay_s=settings.mean_hold_s),
            asks_doctor=True,
            onset_lead_s=settings.mean_window_s + settings.mean_hold_s,
        )
        self.alarm_specs = pairs, mean
        self._memory = np.zeros(1, _MEMORY)
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._sums = SlidingSums(self._limits.mean_window_s, 8)
        of = self._memory
        of["interval_id"] = of["first_us"] = of["latest_us"] = -1
        of["bad_us"] = of["onset_us"] = -CALM_US

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Compare the pairs, and rate those that count."""
        pairs = batch.pairs
        n = len(pairs)
        if not n:
            self.found = NO_DISAGREEMENT
            return
        self.found = found = Disagreement(
            frame_index=pairs.frame_index,
            angle=np.empty(n),
            tilt=np.empty(n),
            heading=np.empty(n),
            rotvec_body=np.empty((n, 3)),
            rotvec_world=np.empty((n, 3)),
            limit=np.empty(n),
            judged=np.empty(n, np.bool_),
            counted=np.empty(n, np.bool_),
        )
        judge_pairs(
            ballot.votes(2 * n),
            self._watching(n),
            self.raw.room(n),
            self.tilt.room(n),
            self.heading.room(n),
            self._sums.room(n),
            self._memory,
            self._places(ballot),
            self._limits,
            batch.ardupilot.steps,
            batch.fixed_wing.steps,
            batch.may_be_trim.steps,
            batch.explained.steps,
            _Pairs(
                frame_index=pairs.frame_index,
                t_boot_us=pairs.t_boot_us,
                same_instant=pairs.same_instant,
                q_euler=pairs.q_euler,
                q_quaternion=pairs.q_quaternion,
                q_euler_sent=pairs.q_euler_sent,
                w_nb_b_rad_s=pairs.w_nb_b_rad_s,
                bound_rad=pairs.bound_rad,
                after_reset=pairs.after_reset,
                interval_id=pairs.interval_id,
                duration_us=pairs.duration_us,
            ),
            pairs.q_euler_sent is pairs.q_euler,
            _Found(
                angle=found.angle,
                tilt=found.tilt,
                heading=found.heading,
                rotvec_body=found.rotvec_body,
                rotvec_world=found.rotvec_world,
                limit=found.limit,
                judged=found.judged,
                counted=found.counted,
            ),
        )

    @property
    def same_instant(self) -> int:
        """Of the judged pairs, those of one instant."""
        return int(self._memory["same_instant"][0])

    @property
    def counted(self) -> int:
        """Of the pairs, those that had a vote."""
        return int(self._memory["counted"][0])

    @property
    def bad(self) -> int:
        """Of the pairs that had a vote, those above their limit."""
        return int(self._memory["bad"][0])

    @property
    def lag_ms(self) -> float | None:
        """By how much the quaternion's stamps are late, by the whole recording; None without much motion.

        A regression, and so small where any other mistake makes the difference: a diagnosis tells better.
        """
        of = self._memory[0]
        if of["rate_squared"] < _LEAST_RATE_RAD_S**2 * max(self.judged, 1):
            return None
        return float(-1e3 * of["along_rate"] / of["rate_squared"])

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


class _Pairs(NamedTuple):
    """Columns of `Pairs`, by their names there."""

    frame_index: Int64s
    t_boot_us: Int64s
    same_instant: Mask
    q_euler: FloatRows
    q_quaternion: FloatRows
    q_euler_sent: FloatRows
    w_nb_b_rad_s: FloatRows
    bound_rad: Floats
    after_reset: Mask
    interval_id: Int64s
    duration_us: Int64s


class _Found(NamedTuple):
    """Columns of `Disagreement`, by their names there."""

    angle: Floats
    tilt: Floats
    heading: Floats
    rotvec_body: FloatRows
    rotvec_world: FloatRows
    limit: Floats
    judged: Mask
    counted: Mask


@kernel
def judge_pairs(
    votes: Votes,
    watched: Watched,
    raw: Waiting,
    tilt: Waiting,
    heading: Waiting,
    sums: Sliding,
    memory: Annotated[Records, _MEMORY],
    places: Int64s,
    limits: _Limits,
    ardupilot: tuple[Int64s, Floats],
    fixed_wing: tuple[Int64s, Floats],
    may_be_trim: tuple[Int64s, Floats],
    explained: tuple[Int64s, Floats],
    pairs: _Pairs,
    as_sent: bool,
    found: _Found,
) -> None:
    """Compare pairs in order of arrival, rate and count them; fill `found`. `as_sent`: nothing was undone in them."""
    of = memory[0]
    for i in range(pairs.t_boot_us.size):
        _compare(pairs, i, found)
        _tell(pairs, i, limits, of, found)
        if of.first_us < 0:
            of.first_us = pairs.t_boot_us[i]
        if not found.judged[i]:
            continue
        angle, limit = found.angle[i], found.limit[i]
        watched.of[0].judged += 1
        watched.of[0].judged_us += pairs.duration_us[i]
        of.same_instant += pairs.same_instant[i]
        note(watched, angle)
        note(raw, angle if as_sent else _apart(pairs.q_euler_sent, pairs.q_quaternion, i))
        note(tilt, found.tilt[i])
        note(heading, abs(found.heading[i]))
        _follow_lag(pairs, i, of, found)
        trim = held_at(may_be_trim, pairs.frame_index[i]) == 1.0
        if found.counted[i] and angle > limit and held_at(ardupilot, pairs.frame_index[i]) != 0.0:  # NaN: not known yet
            wings = held_at(fixed_wing, pairs.frame_index[i]) != 0.0
            so_far = held_at(explained, pairs.frame_index[i])
            found.counted[i] = not is_withheld(pairs, i, of, found, wings, trim, so_far)
        if found.counted[i]:
            of.counted += 1
            of.bad += angle > limit
            if angle <= limit and of.spoken_for != held_at(explained, pairs.frame_index[i]):
                # It agrees with what was found meanwhile: so would those have done that were judged without it.
                of.spoken_for = held_at(explained, pairs.frame_index[i])
                forget_samples(votes, places[0])
            detail = _detail(found, i, row_at(found.rotvec_body, i))
            vote(votes, places[0], pairs.frame_index[i], pairs.t_boot_us[i], angle, limit, detail)
        means = np.isfinite(found.rotvec_body[i, 0])
        is_open = trim and pairs.bound_rad[i] < angle <= LEVEL_TRIM_RAD  # a trim may make that of each pair
        if angle <= limit and pairs.t_boot_us[i] > of.latest_us and means and not is_open:
            of.latest_us = pairs.t_boot_us[i]
            is_enough, value, limit, turn = _mean(pairs, i, limits, sums, found)
            if is_enough:
                detail = _detail(found, i, turn)
                vote(votes, places[1], pairs.frame_index[i], pairs.t_boot_us[i], value, limit, detail)


@helper
def _compare(pairs: Any, i: Any, found: Any) -> Any:
    """The rotation between both forms, and its parts (rule M17)."""
    q_euler, norm2 = ray_at(pairs.q_euler, i)
    q_quaternion, _ = ray_at(pairs.q_quaternion, i)
    w, x, y, z = product(conjugated(q_euler), q_quaternion)
    found.angle[i] = angle_of((w, x, y, z))
    found.tilt[i], found.heading[i] = tilt_heading_of(product(q_quaternion, conjugated(q_euler)))
    turn = logarithm((w + 0.0, x, y, z))  # of half a turn the axis goes by the sign of w: no negative zero
    put(turn, found.rotvec_body, i)
    put(turned(q_euler, norm2, turn), found.rotvec_world, i)


@helper
def _tell(pairs: Any, i: Any, limits: Any, of: Any, found: Any) -> Any:
    """Judge by a limit that grows with the bound of the alignment.

    A pair above its limit is bad; one below it is good only if the bound leaves anything to tell, else it is not
    judged. Pairs on one step of the faster stream count once.
    """
    bound, interval_id = pairs.bound_rad[i], pairs.interval_id[i]
    limit = limits.limit_rad + bound  # NaN where the bound is unknown: then not judged
    judged = (found.angle[i] > limit or bound <= limits.usable_bound_rad) and not pairs.after_reset[i]
    found.limit[i], found.judged[i] = limit, judged
    found.counted[i] = judged and (interval_id == -1 or interval_id != of.interval_id)
    if judged:
        of.interval_id = interval_id


@helper
def _apart(a: Any, b: Any, i: Any) -> Any:
    """As `angle_between`, of rows `i`."""
    return angle_of(product(conjugated(ray_at(a, i)[0]), ray_at(b, i)[0]))


@helper
def _follow_lag(pairs: Any, i: Any, of: Any, found: Any) -> Any:
    """Sum up, pair after pair, how the difference goes along the rate: a stamp that is late makes it so."""
    w, turn = row_at(pairs.w_nb_b_rad_s, i), row_at(found.rotvec_body, i)
    if is_known(w) and is_known(turn) and length(w) < _GREATEST_RATE_RAD_S:
        of.along_rate += w[0] * turn[0] + w[1] * turn[1] + w[2] * turn[2]
        of.rate_squared += w[0] * w[0] + w[1] * w[1] + w[2] * w[2]


@helper
def _mean(pairs: Any, i: Any, limits: Any, sums: Any, found: Any) -> Any:
    """The mean turn of the last seconds' good pairs, in world and body axes: noise averages out, offsets don't.

    Returns whether there are enough pairs, the angle and its limit, and the mean in body axes.
    """
    t_us, bound = pairs.t_boot_us[i], pairs.bound_rad[i]
    weight = 1.0 / ((_WEIGHT_FLOOR_RAD + bound) * (_WEIGHT_FLOOR_RAD + bound))
    spread = weight * bound
    bx, by, bz = row_at(found.rotvec_body, i)
    wx, wy, wz = row_at(found.rotvec_world, i)
    row = weight, spread * spread, weight * bx, weight * by, weight * bz, weight * wx, weight * wy, weight * wz
    count, since_us = slide_in(sums, t_us, row)
    is_enough = count >= limits.mean_pairs and t_us - since_us >= 0.5e6 * limits.mean_window_s
    total, weights = sums.sums, sums.sums[0]
    in_body = total[2] / weights, total[3] / weights, total[4] / weights
    in_world = total[5] / weights, total[6] / weights, total[7] / weights
    limit = limits.mean_limit_rad + np.sqrt(max(total[1], 0.0)) / weights
    return is_enough, max(length(in_body), length(in_world)), limit, in_body


@helper
def _detail(found: Any, i: Any, turn: Any) -> Any:
    return found.tilt[i], found.heading[i], turn[0], turn[1], turn[2]
