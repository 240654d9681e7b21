"""Each stream's rotation against its own body rates (rule M20): an attitude must turn as its rates say it turns.

A step that the rates deny is bad, if the one before was too: a lone one is an estimator's reset. Over longer times the
slope of turn against rate shows rates of the wrong scale, sign or axis, and the sum of turns against that of rates
shows rates that mean something else, as the angles' own do in a banked turn.

A swing about as fast as the samples, or faster, makes rates and turns that contradict each other on a healthy vehicle.
It gives itself away: it comes back, so in seconds the attitude goes no further than the rates say it does at once.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from msgspec.structs import replace

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.votes import Votes, vote
from gcs_bridge.attitude.quaternion import length
from gcs_bridge.checks.base import Check, Watched, row_at, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.windows import (
    TOO_SLOW,
    Sliding,
    SlidingSums,
    new_turning,
    slide_in,
    told_by_rates,
    too_slow_for,
)
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.bounds import BEYOND_GYROS_RAD_S
from gcs_bridge.pairing.steps import Steps
from gcs_bridge.settings import AlarmSettings, KinematicsSettings
from gcs_bridge.telemetry.samples import STREAMS

_COHERENCE = 0.8  # squared correlation, from which on a slope means a scale
_STILL_RAD = math.radians(0.01)  # what a step turns at rest, by rounding
# Of the sums, per body axis: turn times rate, rate squared, turn squared, change of rate squared, turn, and the turn by
# the rates; and how many steps are usable.
_COLUMNS = 19
_SLOW = 2.8  # (change of rate)² over rate² below which a sine has nine samples or more a period, and a true slope
_SEEN_RAD = math.radians(5.0)  # a swing as fast as 10 Hz or more does not get so far
_ALIASED = (-0.4, 0.3)  # slopes that such a swing can feign
_FORGOTTEN_S = 3.0  # how long what the attitude turned lately is remembered
_STEADY_S = 10.0  # rates that miss the turn to one side for so long are wrong: a swing comes back
_STEADY = 0.9
_FAR_RAD = math.radians(15.0)  # the attitude turns, over the window
# Of turning and rates over the window, healthy within 0.3 deg/s + 2 %.
_TURN_RAD_S, _TURN_SHARE, _TURN_STILL_RAD_S = math.radians(1.0), 0.15, math.radians(10.0)
_LONGEST_S = 1.0  # of a step in the sums: across a longer gap it may have turned otherwise than at both ends
_TURN_LEAST_HZ = 2.0  # sums over ten seconds need fewer samples than a slope
_TURN_PER_CHANGE = 0.2  # of what the rates change by from sample to sample, in the root mean square
# Slots of `_Stream.lately`: what the attitude turned, the largest rates, by how much the rates missed the turn (each
# about three axes), the latter's size, and since when it was not to one side, s; whether rates were beyond any gyro.
_WANDER, _RATES, _MISSED, _MISSED_SIZE, _SIDES_S, _BEYOND = 0, 3, 6, 9, 10, 11
_STEPS, _SLOPE, _TURN, _IMPOSSIBLE = range(4)  # places of a stream's alarms


class _SlopeLimits(NamedTuple):
    """What of the settings the kernel needs."""

    window_s: float
    least_hz: float
    least_rad_s: float
    low: float
    high: float


class Kinematics(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "kinematics"
    not_a_sign_of: ClassVar[str] = "not one form against the other: each stream contradicts its own rates"
    ok_text: ClassVar[str] = "the attitude turns as its rates say"

    def __init__(self, settings: KinematicsSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._limits = _SlopeLimits(
            window_s=settings.slope_window_s,
            least_hz=settings.slope_least_hz,
            least_rad_s=settings.slope_least_rad_s,
            low=settings.slope_low,
            high=settings.slope_high,
        )
        slow = replace(delays, bad_samples=1, counted_samples=1, on_delay_s=settings.slope_window_s / 2)
        self._untold = np.zeros(2, np.int64)  # steps too fast for the sampling; with rates beyond any gyro
        self.alarm_specs = tuple(spec for name in STREAMS for spec in self._alarms_of(name, delays, slow))
        self._start()

    def _alarms_of(self, name: str, delays: AlarmSettings, slow: AlarmSettings) -> tuple[AlarmSpec, ...]:
        """Of one stream: an alarm of its steps; warnings of slope, of turning over seconds, of impossible rates."""
        lead_s = self._limits.window_s
        scale, turn = (
            f"the rates of {name} have another scale than its turn",
            f"{name} turns otherwise than its rates say",
        )
        beyond = f"the rates of {name} are beyond any gyro"
        return (
            self._alarm_spec(
                f"{name} steps", "alarm", f"{name} does not turn as its rates say", delays, asks_doctor=True
            ),
            self._alarm_spec(f"{name} slope", "warning", scale, slow, unit="1", asks_doctor=True, onset_lead_s=lead_s),
            self._alarm_spec(
                f"{name} turn", "warning", turn, slow, unit="deg/s", asks_doctor=True, onset_lead_s=lead_s
            ),
            self._alarm_spec(f"{name} impossible", "warning", beyond, delays, unit="deg/s"),
        )

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._sums = [SlidingSums(self._limits.window_s, _COLUMNS) for _ in STREAMS]
        self._turning = np.stack([new_turning() for _ in STREAMS])
        self._denied = np.zeros(len(STREAMS), np.bool_)
        self._lately = np.zeros((len(STREAMS), _BEYOND + 1))

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate every step of both streams."""
        n = sum(map(len, batch.steps))
        if n:
            places = self._places(ballot)
            euler, quaternion = (
                _Stream(
                    places[4 * k : 4 * k + 4],
                    self._turning[k],
                    self._denied[k : k + 1],
                    self._lately[k],
                    self._untold,
                    self._sums[k].room(len(steps)),
                    _columns(steps),
                )
                for k, steps in enumerate(batch.steps)
            )
            judge_steps(ballot.votes(4 * n), self._watching(n), self._limits, euler, quaternion)

    def why_not(self) -> str:
        """Why nothing was judged."""
        slow, beyond = self._untold.tolist()
        if beyond > slow:
            return f"the rates are beyond any gyro, above {math.degrees(BEYOND_GYROS_RAD_S):.0f} °/s"
        if slow:
            return TOO_SLOW
        if self.judged:
            return f"only {self.judged} steps from one attitude to the next could be judged"
        return "no stream brought two attitudes in a row with body rates"

    @property
    def remark(self) -> str | None:
        """How much could not be told at this sampling."""
        return too_slow_for(int(self._untold[0]), self.judged)


class _Steps(NamedTuple):
    """Columns of `Steps`, by their names there."""

    frame_index: Int64s
    t0_us: Int64s
    t1_us: Int64s
    w0_b_rad_s: FloatRows
    w1_b_rad_s: FloatRows
    turn_b_rad: FloatRows
    rate_residual_rad: Floats
    limit_rad: Floats
    contradicts_rates: Mask


def _columns(steps: Steps) -> _Steps:
    return _Steps(
        frame_index=steps.frame_index,
        t0_us=steps.t0_us,
        t1_us=steps.t1_us,
        w0_b_rad_s=steps.w0_b_rad_s,
        w1_b_rad_s=steps.w1_b_rad_s,
        turn_b_rad=steps.turn_b_rad,
        rate_residual_rad=steps.rate_residual_rad,
        limit_rad=steps.limit_rad,
        contradicts_rates=steps.contradicts_rates,
    )


class _Stream(NamedTuple):
    """One stream: its alarms, what is remembered of it, its steps."""

    places: Int64s  # (4,) of its alarms
    turning: Floats
    denied: Mask  # (1,) whether its rates denied the last step
    lately: Floats
    untold: Int64s  # (2,) of both streams
    sums: Sliding
    steps: _Steps


@kernel
def judge_steps(votes: Votes, watched: Watched, limits: _SlopeLimits, one: _Stream, other: _Stream) -> None:
    """Rate the steps of both streams in order of arrival; of one frame, the Euler angles' first."""
    first, second = one.steps.frame_index, other.steps.frame_index
    i = j = np.int64(0)  # a plain 0 is a type of its own: numba would compile all that follows for that too
    while i < first.size or j < second.size:
        if j == second.size or (i < first.size and first[i] <= second[j]):
            _judge_step(votes, watched, limits, one, i)
            i += 1
        else:
            _judge_step(votes, watched, limits, other, j)
            j += 1


@helper
def _judge_step(votes: Any, watched: Any, limits: Any, stream: Any, i: Any) -> Any:
    """Rate the stream's step `i`."""
    steps = stream.steps
    t_us, frame_index = steps.t1_us[i], steps.frame_index[i]
    residual, limit, denied = steps.rate_residual_rad[i], steps.limit_rad[i], steps.contradicts_rates[i]
    h_s = (t_us - steps.t0_us[i]) * 1e-6
    w0, w1, turn = row_at(steps.w0_b_rad_s, i), row_at(steps.w1_b_rad_s, i), row_at(steps.turn_b_rad, i)
    speed0, speed1 = length(w0), length(w1)
    told = told_by_rates(stream.turning, speed0, speed1, h_s)
    # Exactly zero at both ends of a turn, rates are not reported.
    reported = speed0 != 0.0 or speed1 != 0.0 or length(turn) <= _STILL_RAD
    beyond = BEYOND_GYROS_RAD_S < max(speed0, speed1) < np.inf
    usable = reported and np.isfinite(residual)
    # The turn that the mean of the rates at both ends makes.
    half = 0.5 * h_s
    by_rates = half * (w0[0] + w1[0]), half * (w0[1] + w1[1]), half * (w0[2] + w1[2])
    missed = turn[0] - by_rates[0], turn[1] - by_rates[1], turn[2] - by_rates[2]
    unseen = usable and _may_swing_unseen(stream.lately, w0, w1, turn, missed, h_s, t_us * 1e-6) and denied
    watch(watched, t_us, residual, usable and told and not unseen)
    stream.untold[0] += usable and (unseen or not told)
    stream.untold[1] += beyond
    if beyond or stream.lately[_BEYOND] != 0.0:
        stream.lately[_BEYOND] = 1.0
        wrong = np.nan, np.nan, 0.5 * (w0[0] + w1[0]), 0.5 * (w0[1] + w1[1]), 0.5 * (w0[2] + w1[2])
        vote(votes, stream.places[_IMPOSSIBLE], frame_index, t_us, max(speed0, speed1), BEYOND_GYROS_RAD_S, wrong)
    # A lone step that the rates deny is a reset of the estimator: it has no vote.
    is_alone = denied and not stream.denied[0]
    stream.denied[0] = denied
    if usable and told and not unseen and not is_alone:
        # What hardly turned is no contradiction, whatever the rates say of it.
        value = residual if denied else min(residual, limit)
        detail = np.nan, np.nan, missed[0], missed[1], missed[2]
        vote(votes, stream.places[_STEPS], frame_index, t_us, value, limit, detail)
    change = w1[0] - w0[0], w1[1] - w0[1], w1[2] - w0[2]
    summed = usable and not denied and h_s <= _LONGEST_S
    if not summed:
        turn = by_rates = change = 0.0, 0.0, 0.0
    row = (
        turn[0] * by_rates[0] / h_s,
        turn[1] * by_rates[1] / h_s,
        turn[2] * by_rates[2] / h_s,
        by_rates[0] * by_rates[0] / h_s,
        by_rates[1] * by_rates[1] / h_s,
        by_rates[2] * by_rates[2] / h_s,
        turn[0] * turn[0] / h_s,
        turn[1] * turn[1] / h_s,
        turn[2] * turn[2] / h_s,
        change[0] * change[0] * h_s,
        change[1] * change[1] * h_s,
        change[2] * change[2] * h_s,
        turn[0],
        turn[1],
        turn[2],
        by_rates[0],
        by_rates[1],
        by_rates[2],
        1.0 if summed else 0.0,
    )
    _, since_us = slide_in(stream.sums, t_us, row)
    span_s, of = (t_us - since_us) * 1e-6, stream.sums.sums
    if of[18] < _TURN_LEAST_HZ * span_s or span_s < 0.8 * limits.window_s:
        return
    scale = 0.0
    if of[18] >= limits.least_hz * span_s:
        step_s = span_s / of[18]
        x = _off(of[0], of[3], of[6], of[9], span_s, step_s, limits)
        y = _off(of[1], of[4], of[7], of[10], span_s, step_s, limits)
        z = _off(of[2], of[5], of[8], of[11], span_s, step_s, limits)
        scale = max(x, y, z)
        detail = np.nan, np.nan, max(x - 1.0, 0.0), max(y - 1.0, 0.0), max(z - 1.0, 0.0)
        vote(votes, stream.places[_SLOPE], frame_index, t_us, scale, 1.0, detail)
    turned, by_rates = (of[12], of[13], of[14]), (of[15], of[16], of[17])
    detail = (
        np.nan,
        np.nan,
        (turned[0] - by_rates[0]) / span_s,
        (turned[1] - by_rates[1]) / span_s,
        (turned[2] - by_rates[2]) / span_s,
    )
    value = length((detail[2], detail[3], detail[4]))
    rate = max(length(turned), length(by_rates)) / span_s
    # About the axis on which the rates miss it: a swing that they do not show gets nowhere, in however slow a beat.
    along = abs(turned[0] * detail[2] + turned[1] * detail[3] + turned[2] * detail[4])
    far = along / value if value > 0.0 else 0.0
    if scale > 1.0 or (far <= _FAR_RAD and of[18] < limits.least_hz * span_s):
        value = 0.0  # the scale tells it, or too few samples tell nothing
    allowed = _TURN_SHARE * rate + (_TURN_RAD_S if far > _FAR_RAD else _TURN_STILL_RAD_S)
    allowed += _TURN_PER_CHANGE * np.sqrt((of[9] + of[10] + of[11]) / span_s)
    vote(votes, stream.places[_TURN], frame_index, t_us, value, allowed, detail)


@helper
def _may_swing_unseen(lately: Any, w0: Any, w1: Any, turn: Any, missed: Any, h_s: Any, t_s: Any) -> Any:
    """Whether a step that the rates miss may be part of a swing that the samples do not show.

    About the axis on which they miss it, the attitude went no further lately than the rates turn it within one step,
    and they did not miss it to one side for long.
    """
    kept, fades = np.exp(-h_s / _FORGOTTEN_S), 0.5**0.2  # to half within five steps
    size = max(length(missed), 1e-12)
    wander = reach = step = side = 0.0
    for axis in range(3):
        along = missed[axis] / size
        lately[_WANDER + axis] = kept * lately[_WANDER + axis] + turn[axis]
        lately[_RATES + axis] = max(abs(w0[axis]), abs(w1[axis]), fades * lately[_RATES + axis])
        lately[_MISSED + axis] = kept * lately[_MISSED + axis] + missed[axis]
        wander += along * lately[_WANDER + axis]
        step += along * turn[axis]
        reach += abs(along) * lately[_RATES + axis] * h_s
        side += lately[_MISSED + axis] ** 2
    lately[_MISSED_SIZE] = kept * lately[_MISSED_SIZE] + length(missed)
    if np.sqrt(side) < _STEADY * lately[_MISSED_SIZE] or lately[_SIDES_S] == 0.0:
        lately[_SIDES_S] = t_s
    return abs(wander) <= reach and abs(step) <= reach and t_s - lately[_SIDES_S] < _STEADY_S


@helper
def _off(across: Any, rates: Any, turns: Any, changes: Any, span_s: Any, step_s: Any, limits: Any) -> Any:
    """How far turn over rate about a body axis, by least squares, is from 1: 1 at the limit, on both sides.

    `across`, `rates`, `turns`, `changes`: sums of turn times rate, rate squared, turn squared, change of rate squared.
    """
    # Vibration faster than the samples looks like any slope, but turn and rate then hardly go together.
    is_coherent = across * across >= _COHERENCE * rates * turns
    if not is_coherent or rates <= limits.least_rad_s * limits.least_rad_s * span_s or changes > _SLOW * rates:
        return 0.0
    slope = across / rates
    if _ALIASED[0] < slope < _ALIASED[1]:
        # How far it swings, by how fast its rates seem to change: what hardly moves may swing unseen.
        angle = np.arctan(0.5 * np.sqrt(changes / rates))  # by which the phase of a sine goes on within half a step
        if np.sqrt(2.0 * turns / span_s) * step_s < 2.0 * angle * _SEEN_RAD:
            return 0.0
    return (slope - 1.0) / (limits.high - 1.0) if slope > 1.0 else (1.0 - slope) / (1.0 - limits.low)
