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
from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.checks.base import Check, along, length, rated
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.windows import SlidingSums, Turning
from gcs_bridge.columns import Floats, Mask
from gcs_bridge.pairing.steps import Steps
from gcs_bridge.settings import AlarmSettings, KinematicsSettings
from gcs_bridge.telemetry.samples import STREAMS


class _StreamAlarms(NamedTuple):
    """Of one stream: an alarm of its steps, and a warning of the slope on any axis."""

    steps: AlarmSpec
    slope: AlarmSpec


class Kinematics(Check):
    """The check over one vehicle."""

    name: ClassVar[str] = "kinematics"
    not_a_sign_of: ClassVar[str] = "not one form against the other: each stream contradicts its own rates"
    ok_text: ClassVar[str] = "the attitude turns as its rates say"

    def __init__(self, settings: KinematicsSettings, delays: AlarmSettings) -> None:
        """Start with nothing judged."""
        super().__init__()
        self._settings = settings
        self._delays = delays
        self._slow = replace(delays, bad_samples=1, counted_samples=1, on_delay_s=settings.slope_window_s / 2)
        self._alarms = tuple(self._alarms_of(name) for name in STREAMS)
        self.alarm_specs = tuple(spec for alarms in self._alarms for spec in alarms)
        self._start_slopes()

    def _alarms_of(self, name: str) -> _StreamAlarms:
        what = f"the rates of {name} have another scale than its turn"
        return _StreamAlarms(
            steps=self._alarm_spec(f"{name} steps", "alarm", f"{name} does not turn as its rates say", self._delays),
            slope=self._alarm_spec(f"{name} slope", "warning", what, self._slow, unit="1"),
        )

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start_slopes()

    def _start_slopes(self) -> None:
        self._sums = [SlidingSums(self._settings.slope_window_s, 10) for _ in STREAMS]
        self._turning = [Turning() for _ in STREAMS]
        self._denied = [False for _ in STREAMS]

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate every step of both streams."""
        both = batch.steps
        told = [
            turning.told_by_rates(steps.w0_b_rad_s, steps.w1_b_rad_s, steps.h_s)
            for turning, steps in zip(self._turning, both, strict=True)
        ]
        reported = [_reported(steps) for steps in both]
        arrival = np.argsort(np.concatenate([steps.frame_index for steps in both]), kind="stable")
        t_us = np.concatenate([steps.t1_us for steps in both])[arrival]
        kin = np.concatenate([steps.rate_residual_rad for steps in both])[arrival]
        usable = np.concatenate(told)[arrival] & np.concatenate(reported)[arrival]
        self._watch(t_us, kin, np.isfinite(kin) & usable)
        for k, (steps, alarms, sums) in enumerate(zip(both, self._alarms, self._sums, strict=True)):
            if not len(steps):
                continue
            # A lone step that the rates deny is a reset of the estimator: it has no vote.
            alone = steps.contradicts_rates & ~np.concatenate(([self._denied[k]], steps.contradicts_rates[:-1]))
            self._denied[k] = bool(steps.contradicts_rates[-1])
            usable = np.isfinite(steps.rate_residual_rad) & reported[k]
            by_rates = _turn_by_rates(steps)
            rows = np.flatnonzero(usable & told[k] & ~alone)
            # What hardly turned is no contradiction, whatever the rates say of it.
            value = np.where(
                steps.contradicts_rates, steps.rate_residual_rad, np.minimum(steps.rate_residual_rad, steps.limit_rad)
            )[rows]
            detail = along((steps.turn_b_rad - by_rates)[rows])
            rating = rated(
                steps.t1_us[rows], steps.frame_index[rows], value, steps.limit_rad[rows], self._delays, detail
            )
            ballot.rate(alarms.steps, rating)
            self._slope(alarms.slope, sums, steps, by_rates, usable & ~steps.contradicts_rates, ballot)

    def _slope(
        self, spec: AlarmSpec, sums: SlidingSums, steps: Steps, by_rates: Floats, usable: Mask, ballot: Ballot
    ) -> None:
        """Turn over rate, per body axis, by least squares over the last seconds."""
        settings = self._settings
        by_rates, turn = np.where(usable[:, None], by_rates, 0.0), np.where(usable[:, None], steps.turn_b_rad, 0.0)
        h = steps.h_s[:, None]
        products = np.hstack((turn * by_rates / h, by_rates**2 / h, turn**2 / h, usable.astype(np.float64)[:, None]))
        totals, _, since_us = sums.feed(steps.t1_us, products)
        span_s = (steps.t1_us - since_us) * 1e-6
        seen = (totals[:, 9] >= settings.slope_least_hz * span_s) & (span_s >= 0.8 * settings.slope_window_s)
        across, rates, turns = totals[:, :3], totals[:, 3:6], totals[:, 6:9]
        # Vibration faster than the samples looks like any slope, but turn and rate then hardly go together.
        coherent = across**2 >= _COHERENCE * rates * turns
        turned = (rates > settings.slope_least_rad_s**2 * span_s[:, None]) & coherent
        slope = np.divide(across, rates, out=np.ones((len(h), 3)), where=turned)
        # On one scale for both sides: 1 at the limit, above it beyond.
        off = np.where(
            slope > 1.0,
            (slope - 1.0) / (settings.slope_high - 1.0),
            (1.0 - slope) / (1.0 - settings.slope_low),
        )
        rows = np.flatnonzero(seen)
        off = off[rows]
        value = np.maximum(np.maximum(off[:, 0], off[:, 1]), off[:, 2])
        ballot.rate(
            spec,
            rated(
                steps.t1_us[rows], steps.frame_index[rows], value, 1.0, self._slow, along(np.maximum(off - 1.0, 0.0))
            ),
        )

    def why_not(self) -> str:
        """Why nothing was judged."""
        return "no stream brought two attitudes in a row with body rates"


_COHERENCE = 0.8  # squared correlation, from which on a slope means a scale
_STILL_RAD = math.radians(0.01)  # what a step turns at rest, by rounding


def _reported(steps: Steps) -> Mask:
    """Which steps have rates to be judged by: exactly zero at both ends of a turn, they are not reported."""
    zero = (length(steps.w0_b_rad_s) == 0) & (length(steps.w1_b_rad_s) == 0)
    return np.asarray(~zero | (length(steps.turn_b_rad) <= _STILL_RAD))


def _turn_by_rates(steps: Steps) -> Floats:
    """The turn (n, 3), rad, that the mean of the rates at both ends makes of each step."""
    return np.asarray(0.5 * steps.h_s[:, None] * (steps.w0_b_rad_s + steps.w1_b_rad_s))
