"""AHRS2, the autopilot's second estimate, against the first: independent enough to show an estimator that is wrong.

The two differ widely in healthy flight (38 deg in acro), so the fine limits hold in quiet flight only, and a gross one
at any time. That of the heading is wider while banked, as in certified comparators: there a little tilt turns it far.

A second estimate that never agreed in heading has one of another kind, or no compass: a remark, and not judged. One
that never agreed in tilt sees another down from the start: a warning, once, as both see gravity.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.votes import Votes, vote
from gcs_bridge.attitude.compiled import ray_at
from gcs_bridge.attitude.gravity import down_of
from gcs_bridge.attitude.quaternion import conjugated, length, logarithm, product, tilt_heading_of
from gcs_bridge.checks.base import NO_DETAIL, Check, Watched, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.columns import FloatRows, Int64s, Mask, Records
from gcs_bridge.contract import Severity
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.seen import (
    ATTITUDE_WIDTH,
    Series,
    Waiting,
    attitude_between,
    hear,
    new_series,
    new_waiting,
    rates_at,
    reached,
    take_waiting,
    wait,
)
from gcs_bridge.settings import AlarmSettings, AlignmentSettings, SecondaryEstimateSettings

_STAMP_BOUND_S = 0.001  # stamps are whole milliseconds
_PARTS = ("tilt", "heading")
_SEVERITIES: tuple[Severity, ...] = ("warning", "alarm")
_TILT, _HEADING = range(2)
_NEVER = 6  # place of the warning that they never agreed in tilt
_QUIET = ATTITUDE_WIDTH  # the column of an attitude behind its own: µs in which the vehicle was quiet
_GAP = 4  # the column of a question behind its quaternion: the gap in which its time lies, µs

_STATE = np.dtype(
    [
        ("attitudes", "i8"),
        ("unquiet_us", "i8"),  # when the vehicle turned fast or was banked last, or the first attitude
        ("compared", "i8"),
        ("first_us", "i8"),  # the first AHRS2 that was
        # Of tilt and heading.
        ("apart_us", "i8", (2,)),  # when the two estimates were apart last, or the first AHRS2
        ("agreed", "i8", (2,)),  # whether they agreed for long enough once
        # Of the settings.
        ("quiet_us", "f8"),
        ("quiet_below_rad_s", "f8"),
        ("quiet_down", "f8"),  # the cosine of the bank
        ("level_down", "f8"),
        ("banked_times", "f8"),
        ("skipped_us", "f8"),
        ("agreed_rad", "f8"),
        ("agreed_us", "f8"),
    ]
)


class SecondaryEstimate(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "secondary_estimate"
    not_a_sign_of: ClassVar[str] = (
        "not one form against the other: one of two estimates is wrong, and it may be the second"
    )
    ok_text: ClassVar[str] = "both estimates agree in quiet flight"

    def __init__(
        self, settings: SecondaryEstimateSettings, delays: AlarmSettings, alignment: AlignmentSettings
    ) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._max_gap_us = alignment.max_gap_us
        self._came = False
        self._never = dict.fromkeys(_PARTS, True)
        gross = msgspec.structs.replace(delays, bad_samples=1, counted_samples=1, on_delay_s=settings.gross_s)
        # In quiet flight a warning and an alarm of each part; an alarm of gross differences at any time.
        fine = [
            self._alarm_spec(f"{part} {severity}", severity, f"the second estimate (AHRS2) has another {part}", delays)
            for part in _PARTS
            for severity in _SEVERITIES
        ]
        wholly = [
            self._alarm_spec(
                f"{part} gross", "alarm", f"the second estimate (AHRS2) has a wholly different {part}", gross
            )
            for part in _PARTS
        ]
        never = self._alarm_spec(
            "tilt never",
            "warning",
            "the second estimate (AHRS2) never agreed in tilt",
            msgspec.structs.replace(delays, on_delay_s=settings.agreed_s, repeat_s=0.0),
        )
        self.alarm_specs = *fine, *wholly, never
        self._limits = (
            settings.tilt_warning_rad,
            settings.tilt_alarm_rad,
            settings.heading_warning_rad,
            settings.heading_alarm_rad,
            settings.gross_rad,
            settings.gross_rad,
        )
        self._start()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        settings = self._settings
        self._series, self._waiting = new_series(ATTITUDE_WIDTH + 1), new_waiting(_GAP + 1)
        self._states = np.zeros(1, _STATE)
        state = self._states[0]
        state["quiet_us"], state["quiet_below_rad_s"] = settings.quiet_s * 1e6, settings.quiet_below_rad_s
        state["quiet_down"], state["skipped_us"] = np.cos(settings.quiet_bank_rad), settings.skipped_s * 1e6
        state["level_down"], state["banked_times"] = np.cos(settings.level_bank_rad), settings.banked_times
        state["agreed_rad"], state["agreed_us"] = settings.agreed_rad, settings.agreed_s * 1e6

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each AHRS2 by the first estimate at its time."""
        first, second = batch.attitude, batch.secondary
        attitude = first.frame_index, first.t_us, first.rows
        if n := len(first):
            self._series = self._series.with_room(n)
        if not len(second) and not (n and self._waiting.n):
            if n:
                follow_quiet(self._states, self._series, *attitude)
            return
        self._came |= bool(second.valid.any())
        self._waiting = self._waiting.with_room(len(second))
        answers = self._waiting.n + len(second)
        compare_estimates(
            ballot.votes(7 * answers),
            self._watching(answers),
            self._places(ballot),
            self._limits,
            self._max_gap_us,
            self._states,
            self._series,
            self._waiting,
            attitude,
            (second.frame_index, second.t_boot_us, second.q_nb, second.gap_us, second.valid),
        )
        for part, agreed in zip(_PARTS, self._states["agreed"][0].tolist(), strict=True):
            self._never[part] &= not agreed

    def why_not(self) -> str:
        """Why nothing was judged."""
        if not self._came:
            return "AHRS2 was never received"
        if self.judged and not self.tells:
            return "the two estimates never agreed in tilt"
        settings = self._settings
        return f"AHRS2 never came in {settings.quiet_s:g} s of quiet flight, {settings.skipped_s:g} s behind its first"

    @property
    def tells(self) -> bool:
        """Whether the two estimates ever agreed in tilt: both see gravity, and one down."""
        return not self._never["tilt"]

    @property
    def remark(self) -> str | None:
        """That the headings never agreed: then they are of different kinds, and nothing can be told by them."""
        if not self._came or not self.tells or not self._never["heading"]:
            return None
        return "the two estimates never agreed in heading: that is not judged"


@kernel
def follow_quiet(
    states: Annotated[Records, _STATE], series: Series, frame_index: Int64s, t_us: Int64s, rows: FloatRows
) -> None:
    """Take attitudes (n,) while there is nothing to compare with them."""
    for i in range(t_us.size):
        _follow_quiet(states[0], series, frame_index, t_us, rows, i)


@kernel
def compare_estimates(
    votes: Votes,
    watched: Watched,
    places: Int64s,
    limits: tuple[float, float, float, float, float, float],
    max_gap_us: int,
    states: Annotated[Records, _STATE],
    series: Series,
    waiting: Waiting,
    first: tuple[Int64s, Int64s, FloatRows],
    second: tuple[Int64s, Int64s, FloatRows, Int64s, Mask],
) -> None:
    """Take attitudes (n,) and AHRS2 (m,) in order of arrival, and compare what can be compared by then."""
    state = states[0]
    frame_index, t_us, rows = first
    second_frame_index, second_us, second_q, gap_us, valid = second
    n = asked = 0
    while n < t_us.size or asked < second_us.size:
        if asked == second_us.size or (n < t_us.size and frame_index[n] < second_frame_index[asked]):
            at = frame_index[n]
            _follow_quiet(state, series, frame_index, t_us, rows, n)
            n += 1
        else:
            at = second_frame_index[asked]
            if valid[asked]:
                _ask(series, waiting, at, second_us[asked], second_q[asked], gap_us[asked])
            asked += 1
        for question in range(take_waiting(waiting)):
            before, behind = reached(series, waiting, question, max_gap_us)
            if behind >= 0:
                _compare(state, series, before, behind, waiting, question, at, places, limits, votes, watched)


@helper
def _follow_quiet(state: Any, series: Any, frame_index: Any, t_us: Any, rows: Any, i: Any) -> Any:
    """Take an attitude, and how long it has been that the vehicle turned fast or was banked."""
    if not state.attitudes:
        state.unquiet_us = t_us[i]
    state.attitudes += 1
    slow = length(rates_at(rows, i)) < state.quiet_below_rad_s
    q, norm2 = ray_at(rows, i)
    if not slow or not down_of(q, norm2)[2] > state.quiet_down:
        state.unquiet_us = max(state.unquiet_us, t_us[i])
    if hear(series, frame_index[i], t_us[i], rows, i):
        series.rows[(series.heard[0] - 1) & (series.t_us.size - 1), _QUIET] = t_us[i] - state.unquiet_us


@helper
def _ask(series: Any, waiting: Any, frame_index: Any, t_us: Any, q: Any, gap_us: Any) -> Any:
    """Ask for the first estimate at an AHRS2's time."""
    at = wait(series, waiting, frame_index, t_us)
    if at >= 0:
        for i in range(4):
            waiting.rows[at, i] = q[i]
        waiting.rows[at, _GAP] = gap_us


@helper
def _compare(
    state: Any,
    series: Any,
    before: Any,
    behind: Any,
    waiting: Any,
    question: Any,
    frame_index: Any,
    places: Any,
    limits: Any,
    votes: Any,
    watched: Any,
) -> Any:
    """Compare an AHRS2 with the first estimate at its time."""
    t_us, last = waiting.t_us[question], series.t_us.size - 1
    if not state.compared:
        state.first_us = state.apart_us[0] = state.apart_us[1] = t_us
    state.compared += 1
    one, two = attitude_between(series, before, behind, t_us)[0], ray_at(waiting.rows, question)[0]
    bound = (0.5 * waiting.rows[question, _GAP] * 1e-6 + _STAMP_BOUND_S) * length(rates_at(series.rows, behind & last))
    quiet = series.rows[behind & last, _QUIET] >= state.quiet_us
    judged = quiet and t_us - state.first_us >= state.skipped_us
    banked = down_of(one, one[0] * one[0] + one[1] * one[1] + one[2] * one[2] + one[3] * one[3])[2] < state.level_down
    tilt, heading = tilt_heading_of(product(two, conjugated(one)))
    watch(watched, t_us, tilt, judged)
    angles = tilt, abs(heading)
    for part in range(2):
        if not angles[part] <= state.agreed_rad:
            state.apart_us[part] = max(state.apart_us[part], t_us)
        state.agreed[part] |= t_us - state.apart_us[part] >= state.agreed_us
    for a in range(6):
        fine = a < 4
        part = a // 2 if fine else a - 4
        wider = state.banked_times if fine and part == _HEADING and banked else 1.0
        angle, limit = angles[part], wider * limits[a] + bound
        if state.agreed[part] and (judged or not fine) and np.isfinite(angle):
            detail = (tilt, heading, *logarithm(product(conjugated(one), two))) if angle > limit else NO_DETAIL
            vote(votes, places[a], frame_index, t_us, angle, limit, detail)
    if judged:
        never = 0.0 if state.agreed[_TILT] else tilt
        vote(
            votes, places[_NEVER], frame_index, t_us, never, limits[0] + bound, (tilt, heading, np.nan, np.nan, np.nan)
        )
