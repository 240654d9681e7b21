"""Each stream's rotation against its own body rates (rule M20): an attitude must turn as its rates say it turns.

A step that the rates deny is bad, if the one before was too: a lone one is an estimator's reset. Over longer times the
slope of turn against rate shows rates of the wrong scale, sign or axis.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
from msgspec.structs import replace

from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.votes import Ballot, Votes, vote
from gcs_bridge.attitude.quaternion import length
from gcs_bridge.checks.base import Check, Watched, row_at, watch
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.windows import Sliding, SlidingSums, new_turning, slide_in, told_by_rates
from gcs_bridge.columns import Floats, Int64s, Mask
from gcs_bridge.jit import Fields, helper, kernel
from gcs_bridge.pairing.steps import Steps
from gcs_bridge.settings import AlarmSettings, KinematicsSettings
from gcs_bridge.telemetry.samples import STREAMS

_COHERENCE = 0.8  # squared correlation, from which on a slope means a scale
_STILL_RAD = math.radians(0.01)  # what a step turns at rest, by rounding
_COLUMNS = 10  # of the sums: per body axis turn times rate, rate squared, turn squared; and how many are usable


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
        self.alarm_specs = tuple(spec for name in STREAMS for spec in self._alarms_of(name, delays, slow))
        self._start()

    def _alarms_of(self, name: str, delays: AlarmSettings, slow: AlarmSettings) -> tuple[AlarmSpec, AlarmSpec]:
        """Of one stream: an alarm of its steps, and a warning of the slope on any axis."""
        what = f"the rates of {name} have another scale than its turn"
        return (
            self._alarm_spec(f"{name} steps", "alarm", f"{name} does not turn as its rates say", delays),
            self._alarm_spec(f"{name} slope", "warning", what, slow, unit="1"),
        )

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._sums = [SlidingSums(self._limits.window_s, _COLUMNS) for _ in STREAMS]
        self._turning = np.stack([new_turning() for _ in STREAMS])
        self._denied = np.zeros(len(STREAMS), np.bool_)

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate every step of both streams."""
        n = sum(map(len, batch.steps))
        if n:
            votes, places = ballot.votes(2 * n), self._places(ballot)
            euler, quaternion = (
                (
                    places[2 * k : 2 * k + 2],
                    self._turning[k],
                    self._denied[k : k + 1],
                    tuple(self._sums[k].room(len(steps))),
                    _fields(steps),
                )
                for k, steps in enumerate(batch.steps)
            )
            judge_steps(tuple(votes), self._watching(n), tuple(self._limits), euler, quaternion)

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "no stream brought two attitudes in a row with body rates"


class _Steps(NamedTuple):
    """Columns of `Steps`, by their names there."""

    frame_index: Int64s
    t0_us: Int64s
    t1_us: Int64s
    w0_b_rad_s: Floats
    w1_b_rad_s: Floats
    turn_b_rad: Floats
    rate_residual_rad: Floats
    limit_rad: Floats
    contradicts_rates: Mask


def _fields(steps: Steps) -> Fields:
    return (
        steps.frame_index,
        steps.t0_us,
        steps.t1_us,
        steps.w0_b_rad_s,
        steps.w1_b_rad_s,
        steps.turn_b_rad,
        steps.rate_residual_rad,
        steps.limit_rad,
        steps.contradicts_rates,
    )


class _Stream(NamedTuple):
    """One stream: its alarms, what is remembered of it, its steps."""

    places: tuple[int, int]  # of the alarm of its steps, and of the one of its slope
    turning: Floats
    denied: Mask  # (1,) whether its rates denied the last step
    sums: Sliding
    steps: _Steps


@kernel
def judge_steps(votes: Fields, watched: Fields, limits: Fields, euler: Fields, quaternion: Fields) -> None:
    """Rate the steps of both streams in order of arrival; of one frame, the Euler angles' first."""
    votes, watched, limits = Votes(*votes), Watched(*watched), _SlopeLimits(*limits)
    one, other = _stream(euler), _stream(quaternion)
    first, second = one.steps.frame_index, other.steps.frame_index
    i = j = np.int64(0)  # a plain 0 is a type of its own: numba would compile all that follows for that too
    while i < first.size or j < second.size:
        if j == second.size or (i < first.size and first[i] <= second[j]):
            _judge_step(votes, watched, limits, one, i)
            i += 1
        else:
            _judge_step(votes, watched, limits, other, j)
            j += 1


# Helpers of the kernel carry no types: numba types them anew wherever they are compiled into it.


@helper
def _stream(fields):  # type: ignore[no-untyped-def]  # typed by numba
    places, turning, denied, sums, steps = fields
    return _Stream(places, turning, denied, Sliding(*sums), _Steps(*steps))


@helper
def _judge_step(votes, watched, limits, stream, i):  # type: ignore[no-untyped-def]  # typed by numba
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
    usable = reported and np.isfinite(residual)
    watch(watched, t_us, residual, usable and told)
    # A lone step that the rates deny is a reset of the estimator: it has no vote.
    is_alone = denied and not stream.denied[0]
    stream.denied[0] = denied
    # The turn that the mean of the rates at both ends makes.
    half = 0.5 * h_s
    by_rates = half * (w0[0] + w1[0]), half * (w0[1] + w1[1]), half * (w0[2] + w1[2])
    if usable and told and not is_alone:
        # What hardly turned is no contradiction, whatever the rates say of it.
        value = residual if denied else min(residual, limit)
        detail = np.nan, np.nan, turn[0] - by_rates[0], turn[1] - by_rates[1], turn[2] - by_rates[2]
        vote(votes, stream.places[0], frame_index, t_us, value, limit, detail)
    if not usable or denied:
        turn = by_rates = 0.0, 0.0, 0.0
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
        1.0 if usable and not denied else 0.0,
    )
    _, since_us = slide_in(stream.sums, t_us, row)
    span_s, of = (t_us - since_us) * 1e-6, stream.sums.sums
    if of[9] >= limits.least_hz * span_s and span_s >= 0.8 * limits.window_s:
        x = _off(of[0], of[3], of[6], span_s, limits)
        y = _off(of[1], of[4], of[7], span_s, limits)
        z = _off(of[2], of[5], of[8], span_s, limits)
        detail = np.nan, np.nan, max(x - 1.0, 0.0), max(y - 1.0, 0.0), max(z - 1.0, 0.0)
        vote(votes, stream.places[1], frame_index, t_us, max(x, y, z), 1.0, detail)


@helper
def _off(across, rates, turns, span_s, limits):  # type: ignore[no-untyped-def]  # typed by numba
    """How far turn over rate about a body axis, by least squares, is from 1: 1 at the limit, on both sides.

    `across`, `rates`, `turns`: sums of turn times rate, rate squared and turn squared.
    """
    # Vibration faster than the samples looks like any slope, but turn and rate then hardly go together.
    is_coherent = across * across >= _COHERENCE * rates * turns
    if not is_coherent or rates <= limits.least_rad_s * limits.least_rad_s * span_s:
        return 0.0
    slope = across / rates
    return (slope - 1.0) / (limits.high - 1.0) if slope > 1.0 else (1.0 - slope) / (1.0 - limits.low)
