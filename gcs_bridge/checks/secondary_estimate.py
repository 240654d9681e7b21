"""AHRS2, the autopilot's second estimate, against the first: independent enough to show an estimator that is wrong.

The two differ widely in healthy flight (38 deg in acro), so the fine limits hold in quiet flight only, and a gross one
at any time. A second estimate that never agreed (without a compass its yaw does not) is a remark, and no alarm.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, NamedTuple

import msgspec
import numpy as np

from gcs_bridge import attitude
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.votes import Ballot
from gcs_bridge.checks.base import Check, between_attitudes, length, rated
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.columns import Floats, Int64s, Mask, RunningMax
from gcs_bridge.pairing.neighbours import Lookup, Track, in_order
from gcs_bridge.pairing.references import attitude_at
from gcs_bridge.pairing.seen import ATTITUDE_WIDTH
from gcs_bridge.settings import AlarmSettings, AlignmentSettings, SecondaryEstimateSettings

_STAMP_BOUND_S = 0.001  # stamps are whole milliseconds


class _Since:
    """How long something has held, without a break, up to each sample."""

    def __init__(self) -> None:
        self._broken_us: RunningMax | None = None

    def feed(self, t_us: Int64s, holds: Mask) -> Int64s:
        """µs since it last did not hold, or since the first sample."""
        if self._broken_us is None:
            self._broken_us = RunningMax(int(t_us[0]))
        return np.asarray(t_us - self._broken_us.feed(np.where(holds, -1, t_us))[1:])


class _Part:
    """Tilt or heading: whether the two estimates ever agreed in it."""

    def __init__(self) -> None:
        self.agreed = False
        self._since = _Since()

    def has_agreed(self, t_us: Int64s, angle: Floats, settings: SecondaryEstimateSettings) -> Mask:
        """Whether, by each sample, they had agreed for long enough once."""
        long_enough = self._since.feed(t_us, angle <= settings.agreed_rad) >= settings.agreed_s * 1e6
        agreed = np.logical_or.accumulate(np.concatenate(([self.agreed], long_enough)))[1:]
        self.agreed = bool(agreed[-1])
        return agreed


class _PartAlarms(NamedTuple):
    """Of tilt or heading: a warning and an alarm in quiet flight; an alarm of gross differences at any time."""

    warning: AlarmSpec
    alarm: AlarmSpec
    gross: AlarmSpec


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
        self._delays = delays
        self._gross = msgspec.structs.replace(delays, bad_samples=1, counted_samples=1, on_delay_s=settings.gross_s)
        self._came = False
        self._never = {"tilt": True, "heading": True}
        self._alarms = {part: self._alarms_of(part) for part in ("tilt", "heading")}
        fine = (spec for alarms in self._alarms.values() for spec in (alarms.warning, alarms.alarm))
        self.alarm_specs = *fine, *(alarms.gross for alarms in self._alarms.values())
        self._start()

    def _alarms_of(self, part: str) -> _PartAlarms:
        what = f"the second estimate (AHRS2) has another {part}"
        gross = f"the second estimate (AHRS2) has a wholly different {part}"
        return _PartAlarms(
            warning=self._alarm_spec(f"{part} warning", "warning", what, self._delays),
            alarm=self._alarm_spec(f"{part} alarm", "alarm", what, self._delays),
            gross=self._alarm_spec(f"{part} gross", "alarm", gross, self._gross),
        )

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        super().start_boot()
        self._start()

    def _start(self) -> None:
        self._lookup = Lookup(5, ATTITUDE_WIDTH + 1, self._max_gap_us)
        self._quiet = _Since()
        self._parts = {"tilt": _Part(), "heading": _Part()}
        self._first_us: int | None = None
        self._latest_us = -1

    def judge(self, batch: CheckBatch, ballot: Ballot) -> None:
        """Rate each AHRS2 by the first estimate at its time."""
        samples = batch.secondary.where(batch.secondary.valid)
        rows = np.hstack((samples.q_nb, samples.gap_us[:, None] * 1e-6))
        queries = Track(frame_index=samples.frame_index, t_us=samples.t_boot_us, rows=rows)
        self._came |= len(queries) > 0
        found = self._lookup.feed(self._with_quiet(batch.attitude), queries)
        picked = in_order(found.query.t_us, self._latest_us)
        if not len(picked):
            return
        t_us, frame_index = found.query.t_us[picked], found.frame_index[picked]
        self._latest_us = int(t_us[-1])
        if self._first_us is None:
            self._first_us = int(t_us[0])
        first, second = attitude_at(found)[picked], found.query.rows[picked, :4]
        gap_s, rates = found.query.rows[picked, 4], np.nan_to_num(found.after.rows[picked, 4:7])
        rate = length(rates)
        bound = (0.5 * gap_s + _STAMP_BOUND_S) * rate
        quiet = found.after.rows[picked, 7] >= self._settings.quiet_s
        judged = quiet & (t_us - self._first_us >= self._settings.skipped_s * 1e6)
        tilt, heading = attitude.tilt_heading_between(first, second)
        heading = np.abs(heading)
        settings = self._settings
        self._watch(t_us, tilt, judged)
        for part, angle, limits in (
            ("tilt", tilt, (settings.tilt_warning_rad, settings.tilt_alarm_rad)),
            ("heading", heading, (settings.heading_warning_rad, settings.heading_alarm_rad)),
        ):
            agreed = self._parts[part].has_agreed(t_us, angle, settings)
            self._never[part] &= not self._parts[part].agreed
            alarms = self._alarms[part]
            for spec, limit, where in (
                (alarms.warning, limits[0], judged & agreed),
                (alarms.alarm, limits[1], judged & agreed),
                (alarms.gross, settings.gross_rad, agreed),
            ):
                at = np.flatnonzero(where & np.isfinite(angle))
                limits_at = limit + bound[at]
                detail = between_attitudes(angle[at] > limits_at, first[at], second[at])
                ballot.rate(spec, rated(t_us[at], frame_index[at], angle[at], limits_at, spec.delays, detail))

    def _with_quiet(self, track: Track) -> Track:
        """The attitudes, each with the seconds since it was last turning fast or banked."""
        if not len(track):
            return replace(track, rows=np.empty((0, ATTITUDE_WIDTH + 1)))
        settings = self._settings
        rates = track.rows[:, 4:7]
        slow = length(rates) < settings.quiet_below_rad_s
        level = attitude.body_down(track.rows[:, :4])[:, 2] > np.cos(settings.quiet_bank_rad)
        quiet_s = self._quiet.feed(track.t_us, slow & level) * 1e-6
        return replace(track, rows=np.hstack((track.rows, quiet_s[:, None])))

    def why_not(self) -> str:
        """Why nothing was judged."""
        if not self._came:
            return "AHRS2 was never received"
        settings = self._settings
        return f"AHRS2 never came in {settings.quiet_s:g} s of quiet flight, {settings.skipped_s:g} s behind its first"

    @property
    def tells(self) -> bool:
        """Whether the two estimates ever agreed in anything."""
        return len(self.never_agreed) < len(self._never)

    @property
    def never_agreed(self) -> list[str]:
        """The parts in which the two estimates never agreed."""
        return [part for part, never in self._never.items() if never]

    @property
    def remark(self) -> str | None:
        """That the estimates never agreed: then nothing can be told of the first by the second."""
        never = self.never_agreed
        return f"the two estimates never agreed in {' and '.join(never)}: that is not judged" if never else None
