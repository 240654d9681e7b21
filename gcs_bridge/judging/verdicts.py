"""What the checks of a vehicle come to: a verdict each, the reason for it, and the vehicle's own.

A verdict is cheap, as it is asked for while the vehicle flies; its reason is put into words for the report alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gcs_bridge.alarms.manager import AlarmManager
from gcs_bridge.checks.base import Check
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.checks.quaternion_norm import QuaternionNorm
from gcs_bridge.contract import Distribution, ExplainedBy, Severity, known
from gcs_bridge.expected import Expected
from gcs_bridge.judging.start_up import StartUpChange
from gcs_bridge.mavlink.requests import request_command
from gcs_bridge.report import schema
from gcs_bridge.report.wording import UNITS
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.known import Known
from gcs_bridge.telemetry.samples import ATTITUDE_QUATERNION, STREAMS
from gcs_bridge.telemetry.stream_counts import StreamCount

_OF_DOWN = ("gravity", "secondary_estimate")
_LEAST_SHARE = 0.01  # of the time with sources
_ENOUGH_US = 10_000_000  # a flight is long, and rest before it is short
_SEVERITIES: tuple[Severity, ...] = ("alarm", "warning")  # worst first


class Verdicts:
    """Of one vehicle, by what its checks, alarms and streams show when they are asked for."""

    def __init__(
        self,
        checks: Sequence[Check],
        alarms: AlarmManager,
        expected: Expected,
        streams: Mapping[str, StreamCount],
        settings: Settings,
    ) -> None:
        """Look at these, which go on changing."""
        self._start_ups: dict[int, tuple[str, int, int]] = {}  # by boot: who said so, from when to when, µs
        self._is_starting = False
        self.left_pending = False  # a boot ended before its alarm's on-delay did
        self._checks = checks
        self._euler_quaternion = next(check for check in checks if isinstance(check, EulerQuaternion))
        self._quaternion_norm = next(check for check in checks if isinstance(check, QuaternionNorm))
        self._alarms = alarms
        self._expected = expected
        self._streams = streams
        self._settings = settings

    def started_up(self, boot: int, latest_us: int, changes: Sequence[StartUpChange]) -> None:
        """A boot was in start-up, up to `latest_us` if it still is; `changes`: where that began or ended."""
        source, since_us, _ = self._start_ups.get(boot, ("", 0, 0))
        until_us = latest_us
        for change in changes:
            if change.starting:
                source, since_us, until_us = change.source, change.t_boot_us, latest_us
            else:
                until_us = change.t_boot_us
        self._start_ups[boot] = source, since_us, until_us
        self._is_starting = changes[-1].starting if changes else True

    def of_vehicle(self, of_checks: Mapping[str, schema.CheckVerdict]) -> schema.Verdict:
        """The worst of its alarms; else whether any attitude comparator judged it, by the verdicts `of_checks`."""
        severities = {alarm.severity for alarm in self._alarms.alarms}
        for severity in _SEVERITIES:
            if severity in severities:
                return severity
        agreeing = [check for check in self._checks if of_checks[check.name] in ("agree", "explained")]
        if not any(check.compares for check in agreeing):
            return "no_compare"
        return "agree" if self._euler_quaternion in agreeing or not self._undecided else "no_compare"

    def of_checks(self) -> dict[str, schema.CheckVerdict]:
        """The verdict of each check, by its name."""
        worst: dict[str, Severity] = {}
        for alarm in self._alarms.alarms:
            if worst.get(alarm.check) != "alarm":
                worst[alarm.check] = alarm.severity
        return {check.name: worst.get(check.name) or self._unalarmed(check) for check in self._checks}

    def _unalarmed(self, check: Check) -> schema.CheckVerdict:
        """The verdict of a check that raised nothing."""
        if check.broken is not None:
            return "inop"
        if check.judged < self._settings.alarm.counted_samples or self._hardly_judged(check):
            return "no_compare"
        if check is not self._euler_quaternion:
            agrees: schema.CheckVerdict = "explained" if self._is_explained(check) else "agree"
            return agrees if check.tells else "no_compare"
        if self._undecided:
            return "no_compare"
        return "explained" if self._expected.explains else "agree"

    def _is_explained(self, check: Check) -> bool:
        """Whether a check of the attitude's down had ATTITUDE alone, of which a view was undone first."""
        return check.name in _OF_DOWN and not self._euler_quaternion.judged and self._expected.undoes_view

    def _hardly_judged(self, check: Check) -> bool:
        """Whether so little of the time was judged that agreement in it says nothing of the rest."""
        return check is not self._euler_quaternion and check.judged_us < min(_LEAST_SHARE * check.alive_us, _ENOUGH_US)

    def entry(self, check: Check, verdict: schema.CheckVerdict, vehicle: Known, both_alive_us: int) -> schema.Check:
        """The report's entry of one check; `both_alive_us`: for so long both attitude streams were alive."""
        numbers = check.numbers()
        explained_by: list[ExplainedBy] = []
        if check is self._euler_quaternion:
            numbers["coverage"] = min(check.judged_us / both_alive_us, 1.0) if both_alive_us > 0 else None
            explained_by = self._expected.explanations()
        elif verdict == "explained":
            explained_by = self._expected.explanations()
            numbers["raw"] = Distribution(median=None, p95=None, p99=None, max=None)  # not measured
        reason = self._reason(check, verdict, vehicle)
        judged = check.judged or not check.compares  # what is said beside it is of what was judged
        remark = check.remark if verdict in ("agree", "explained", "no_compare") and judged else None
        if check.compares and self._start_ups:
            reason = self._with_start_up(check, verdict, reason)
        return schema.Check(
            name=check.name,
            verdict=verdict,
            reason=f"{reason}; {remark}" if remark else reason,
            unit=check.unit,
            **numbers,
            lag_ms=known(self._euler_quaternion.lag_ms) if check is self._euler_quaternion else None,
            explained_by=tuple(explained_by),
            bias=check.bias,
        )

    def _reason(self, check: Check, verdict: schema.CheckVerdict, vehicle: Known) -> str:
        if verdict in _SEVERITIES:
            found = [alarm for alarm in self._alarms.alarms if (alarm.check, alarm.severity) == (check.name, verdict)]
            worst = max(found, key=lambda alarm: alarm.peak)
            count = f"1 {verdict}" if len(found) == 1 else f"{len(found)} {verdict}s"
            up_to = f", up to {worst.peak:.3g}{UNITS.get(worst.unit, f' {worst.unit}')}" if worst.unit else ""
            return f"{count}: {worst.what}{up_to}"
        if verdict == "inop":
            return check.broken or ""
        if verdict == "no_compare":
            if check is self._euler_quaternion:
                return self._why_not_compared(vehicle)
            if check.judged >= self._settings.alarm.counted_samples and self._hardly_judged(check):
                return f"only {check.judged_us / 1e6:.1f} s of {check.alive_us / 1e6:.0f} s could be judged"
            return check.why_not()
        if verdict == "explained" and check is not self._euler_quaternion:
            return "agrees once what the firmware does to ATTITUDE on purpose is undone"
        if verdict == "explained":
            return "the firmware sends the two forms differently on purpose, by what was undone here"
        return check.ok_text

    def _with_start_up(self, check: Check, verdict: schema.CheckVerdict, reason: str) -> str:
        """A verdict's reason beside that of start-up; where that goes on, there is no other."""
        said = self._start_up_said
        if verdict != "no_compare" or check.judged:
            return f"{said}; {reason}"
        return said if self._is_starting and check is not self._euler_quaternion else f"{reason}; {said}"

    @property
    def _start_up_said(self) -> str:
        """When alarms waited, and why."""
        spans = [
            f"from {since_us / 1e6:.1f} to {until_us / 1e6:.1f} s of boot {boot}"
            for boot, (_, since_us, until_us) in self._start_ups.items()
        ]
        sources = sorted({source for source, _, _ in self._start_ups.values()})
        return (
            f"start-up {', '.join(spans)}: not judged, as {' and '.join(sources)} said that the attitude was not ready"
        )

    @property
    def _undecided(self) -> bool:
        """Whether the two forms disagreed, and the alarm's votes and delays never came to decide on it."""
        check = self._euler_quaternion
        return self.left_pending or 2 * check.bad > check.counted or self._alarms.pending(check.name)

    def _why_not_compared(self, vehicle: Known) -> str:
        """Why the two forms of the attitude could not be compared, or came to no decision."""
        check, least = self._euler_quaternion, self._settings.alarm.counted_samples
        if check.judged >= least:
            differs = f"{check.bad} of {check.counted} pairs differ, by up to {math.degrees(check.residual.max):.3g}°"
            return f"{differs}, but for too short a time or too seldom to raise an alarm"
        autopilot = vehicle.autopilot
        missing = [name for name in STREAMS if name not in self._streams]
        for name, unbelieved in zip(STREAMS, vehicle.unbelieved, strict=True):
            if name in missing and unbelieved >= least:
                return f"the times of {name} do not go on, or not with the vehicle's clock: {unbelieved} messages of it"
        if len(missing) == len(STREAMS):
            return "neither ATTITUDE nor ATTITUDE_QUATERNION was received"
        if missing:
            return f"{missing[0]} was never received: {_how_to_get(missing[0], autopilot)}"
        usable = {name: self._streams[name].count - self._streams[name].invalid for name in STREAMS}
        rarest = min(STREAMS, key=lambda name: usable[name])
        if usable[rarest] < least:
            zeros = self._quaternion_norm.zeros
            if rarest == ATTITUDE_QUATERNION and 2 * zeros > self._streams[rarest].count:
                return f"{zeros} of {self._streams[rarest].count} ATTITUDE_QUATERNION are all four zero: no attitude"
            if 2 * self._streams[rarest].invalid > self._streams[rarest].count:
                return f"only {usable[rarest]} of {self._streams[rarest].count} samples of {rarest} hold an attitude"
            return f"only {usable[rarest]} usable samples of {rarest}: {_how_to_get(rarest, autopilot)}"
        standing = [name for name in STREAMS if self._streams[name].stands]
        if standing:
            return f"the clock stands still: {' and '.join(standing)} came with one and the same time again and again"
        return (
            f"only {check.judged} pairs could be judged: the two streams never came at one instant, "
            f"nor with gaps below {self._settings.alignment.max_gap_s:g} s and body rates to interpolate with"
        )


def _how_to_get(message: str, autopilot: str) -> str:
    """What to do about a message that does not come."""
    where, command = request_command(message, autopilot)
    return f"ask for it, in {where}: {command}"
