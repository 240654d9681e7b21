"""The report for reading: plain lines of at most 100 columns, from the report's entries and nothing else.

Each vehicle's first line tells whether `euler_quaternion` could be judged, and how much. The last lines tell the
verdict of each file and, where a message is missing, the command that requests it. Unknown is never shown as 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec.structs import asdict

from gcs_bridge.contract import Alarm, Diagnosis, Distribution, ExplainedBy, Stream
from gcs_bridge.errors import one_line
from gcs_bridge.mavlink.requests import request_command
from gcs_bridge.report.rows import NBSP, counted, in_bytes, in_percent, in_seconds, labelled, shown, unbroken
from gcs_bridge.report.schema import Boot, Check, EstimatorReset, File, Salvage, Vehicle
from gcs_bridge.report.verdicts import LABELS, UNJUDGED, compared, sends_attitude
from gcs_bridge.report.wording import UNITS, difference, quantity

__all__ = [
    "alarm_line",
    "explained_line",
    "lines",
    "requests",
    "reset_line",
    "salvage_line",
    "summary",
    "value_of",
    "when_raised",
]

_NOTHING = 1e-6  # so much less than another part of a value is none of it
_OTHERS = 8  # that the last line names
_START_UP = "start-up"
_ASSUMED = "assumed"  # how what is said of units begins
_COMPARED = ("ATTITUDE", "ATTITUDE_QUATERNION")  # the two sides of euler_quaternion


def lines(files: Sequence[File], *, detail: int = 0) -> list[str]:
    """The lines of a report of these files; `detail` -1 keeps the last line of each file alone, 1 adds every number."""
    told = [] if detail < 0 else [line for entry in files for line in (*_file(entry, detail), "")]
    return told + [line for entry in files for line in _conclusion(entry)]


def _file(entry: File, detail: int) -> Iterator[str]:
    salvage = entry.salvage
    yield f"{one_line(entry.path)}  ({in_bytes(entry.bytes)}, {counted(salvage.frames, 'frame')})"
    damaged = salvage.bad_crc or salvage.skipped_bytes or salvage.gap_count or salvage.read_fraction != 1
    if damaged or detail > 0:
        yield from labelled("damage" if damaged else "data", salvage_line(salvage), indent=2)
    if detail > 0:
        for gap in salvage.gaps:
            yield from labelled("", f"gap of {counted(gap.bytes, 'byte')} at byte {shown(gap.offset)}", indent=2)
    if salvage.signed or salvage.signatures is not None:
        yield from labelled("signing", _signing(salvage), indent=2)
    for remark in salvage.remarks:
        yield from labelled("note", one_line(remark), indent=2)
    if detail > 0 and entry.others:
        yield from labelled("others", _heard(entry, len(entry.others)), indent=2)
    for vehicle in entry.vehicles:
        yield from _vehicle(vehicle, detail)


def salvage_line(salvage: Salvage) -> str:
    """What was read, and what was damaged."""
    said = [
        f"read {in_percent(salvage.read_fraction)} of the bytes",
        f"{shown(salvage.bad_crc)} with a bad checksum",
        f"{counted(salvage.skipped_bytes, 'byte')} skipped in {counted(salvage.gap_count, 'gap')}",
    ]
    for count, word in (
        (salvage.repaired_crc, "repaired"),
        (salvage.unverified, "of unknown kind"),
        (salvage.duplicates, "duplicate"),
    ):
        if count:
            said.append(f"{count} {word}")
    return ", ".join(map(unbroken, said))


def _signing(salvage: Salvage) -> str:
    """How many frames are signed, and what their signatures are worth."""
    found = salvage.signatures
    if found is None:
        all_frames = salvage.frames + salvage.unverified
        return f"{shown(salvage.signed)} of {counted(all_frames, 'frame')} signed, not verified: no key was given"
    said = [f"{shown(found.valid)} of {shown(salvage.signed)} signatures verified"]
    for count, word in (
        (found.wrong, "by another key, or changed"),
        (found.replayed, "replayed, or late"),
        (found.old, "of streams more than a minute old"),
        (found.unsigned, "frames without a signature"),
        (found.refused, "frames not used for that"),
    ):
        if count:
            said.append(f"{count} {word}")
    return ", ".join(map(unbroken, said))


def _vehicle(vehicle: Vehicle, detail: int) -> Iterator[str]:
    euler_quaternion = next((check for check in vehicle.checks if check.name == "euler_quaternion"), None)
    yield (
        f"  {_name(vehicle)} {vehicle.autopilot} {vehicle.type}  {LABELS[vehicle.verdict]}  "
        f"euler_quaternion {_judged(euler_quaternion)}"
    )
    for boot in vehicle.boots:
        yield from labelled(f"boot {boot.index}", _boot(boot))
    for reset in vehicle.resets:
        yield from labelled("reset", reset_line(reset))
    started = {check.reason.partition("; ")[0] for check in vehicle.checks if check.reason.startswith(_START_UP)}
    for said in sorted(started):
        yield from labelled(_START_UP, one_line(said.removeprefix(f"{_START_UP} ")))
    streams = [_stream(name, stream, detail) for name, stream in vehicle.streams.items()]
    yield from labelled("streams", ", ".join(map(unbroken, streams)) or "none")
    for check in vehicle.checks:
        yield from labelled(check.name, f"{LABELS[check.verdict]:<10}  {_findings(check, detail)}")
    for alarm in vehicle.alarms:
        yield from labelled(LABELS[alarm.severity], alarm_line(alarm))


def _judged(check: Check | None) -> str:
    if check is None or check.verdict == "inop":
        return "could not run"
    if check.verdict == "no_compare":
        return "not judged" if check.coverage is None else f"not judged (coverage {in_percent(check.coverage)})"
    return f"judged over {in_percent(check.coverage)} of the time both came"


def _boot(boot: Boot) -> str:
    first, last = boot.first_boot_s, boot.last_boot_s
    began = "" if boot.start_utc is None else f", started {boot.start_utc}"
    if first is None or last is None:
        return "restarted; no time was told since"
    return f"{in_seconds(first)} to {in_seconds(last)} ({in_seconds(last - first)}){began}"


def reset_line(reset: EstimatorReset) -> str:
    """When and by how much the estimate stepped, and what was said before."""
    said = f"at {in_seconds(reset.boot_s)} of boot {reset.boot} the estimator's heading stepped by "
    said += f"{quantity(reset.heading, 'deg')}, its tilt by {quantity(reset.tilt, 'deg')}"
    return f"{said} (said before it: {one_line('; '.join(reset.explained_by))})" if reset.explained_by else said


def _stream(name: str, stream: Stream, detail: int) -> str:
    notes = [f"{count} {word}" for count, word in ((stream.lost, "lost"), (stream.invalid, "invalid")) if count]
    if detail > 0:
        notes = [shown(stream.count), f"longest gap {in_seconds(stream.max_gap_s, 2)}", *notes]
    rate = "rate unknown" if stream.rate_hz is None else f"{stream.rate_hz:.1f} Hz"
    return f"{name} {rate}" + (f" ({', '.join(notes)})" if notes else "")


def _findings(check: Check, detail: int) -> str:
    """What a check found; where it could not judge, why."""
    said = []
    unit = check.unit
    quiet = check.verdict in ("agree", "explained") and detail <= 0
    if check.verdict not in UNJUDGED:
        if check.pairs:
            said.append(_distribution(check.residual, unit, short=quiet))
        same = "" if check.same_instant is None else f" ({check.same_instant} at the same instant)"
        said.append(counted(check.pairs, "pair") + same)
        said += map(explained_line, check.explained_by)
        if (detail > 0 or check.explained_by) and check.raw.max is not None:
            said.append(f"raw {_distribution(check.raw, unit)}")
        if detail > 0:
            parts = (("tilt", check.tilt), ("heading", check.heading))
            said += [f"{name} {_distribution(part, unit)}" for name, part in parts if part is not None]
            said.append(f"judged {in_percent(check.coverage)} of the time")
            if check.lag_ms is not None:
                said.append(f"lag {_value(check.lag_ms, 'ms')}")
    told = check.reason
    if told.startswith(_START_UP):  # it has a row of its own
        told = told.partition("; ")[2] or told
    if quiet:  # what it agrees in is known; what was said beside that is not, but for the units
        told = "; ".join(one for one in told.split("; ")[1:] if not one.startswith(_ASSUMED))
    reason = [one_line(told)] if told else []
    return "; ".join([*map(unbroken, said), *reason])


def _distribution(values: Distribution, unit: str, *, short: bool = False) -> str:
    numbers = asdict(values)
    return ", ".join(f"{name} {_value(numbers[name], unit)}" for name in numbers if name != "p95" or not short)


def alarm_line(alarm: Alarm) -> str:
    """What was raised, in one sentence or two: when, what, how much, where, and why if that is known."""
    said = f"{alarm.check} {when_raised(alarm)}: {difference(alarm)}. This is {alarm.is_not}."
    diagnosis = alarm.diagnosis
    return said if diagnosis is None else f"{said} {_diagnosis(diagnosis)}"


def when_raised(alarm: Alarm) -> str:
    """From when to when it was on, and how often."""
    cleared = alarm.cleared_boot_s
    until = "to the end" if cleared is None else f"to {in_seconds(cleared)}"
    utc = "" if alarm.raised_utc is None else f" (raised {alarm.raised_utc})"
    again = f", {counted(alarm.repeats, 'time')} again" if alarm.repeats else ""
    return f"from {in_seconds(alarm.raised_boot_s)} {until} of boot {shown(alarm.boot)}{utc}{again}"


def value_of(diagnosis: Diagnosis) -> str:
    """What the mistake added, with its unit; nothing where it has no number."""
    return "" if diagnosis.value is None else _value(diagnosis.value, diagnosis.unit)


def explained_line(cause: ExplainedBy) -> str:
    """What the firmware did on purpose, and how it is known."""
    estimated = " (estimated)" if cause.estimated else ""
    return f"explained by {cause.cause} {_value(cause.value, cause.unit)}{estimated}"


def _diagnosis(diagnosis: Diagnosis) -> str:
    value = f" {value_of(diagnosis)}".rstrip()
    side = "" if diagnosis.side is None else f" in message {diagnosis.side}"
    said = f"Cause: {diagnosis.cause}{value}{side} ({diagnosis.confidence})."
    return f"{said} {one_line(diagnosis.fix)}" if diagnosis.fix else said


def _conclusion(entry: File) -> Iterator[str]:
    """The file's last line, verdict first, and the commands that would get what was missing."""
    vehicles = entry.vehicles
    alarms = [(vehicle, alarm) for vehicle in vehicles for alarm in vehicle.alarms]
    yield f"{LABELS[entry.verdict]:<10}  {one_line(entry.path)}: {summary(entry)}{_worst(alarms)}"
    if alarms:
        return  # what does not come is not what they are about
    # Where others send an attitude, a vehicle that sends none may have none: a tracker, a gimbal.
    flying = [vehicle for vehicle in vehicles if sends_attitude(vehicle)]
    for vehicle in flying or vehicles:
        for where, command in requests(vehicle):
            yield f"            next, in {where} for vehicle {vehicle.sysid}: {command}"


def _worst(alarms: Sequence[tuple[Vehicle, Alarm]]) -> str:
    """The first of the worst of them, and its cause, for the last line."""
    if not alarms:
        return ""
    severity = "alarm" if any(alarm.severity == "alarm" for _, alarm in alarms) else "warning"
    vehicle, alarm = next(one for one in alarms if one[1].severity == severity)
    of = "" if len({id(one) for one, _ in alarms}) == 1 else f"vehicle {vehicle.sysid}: "
    cause = "" if alarm.diagnosis is None else f", {alarm.diagnosis.cause}"
    return f": {of}{alarm.check} at {in_seconds(alarm.raised_boot_s)}{cause}"


def _heard(entry: File, most: int) -> str:
    """Who was heard beside the vehicles, and what they say that they are: those that sent most first."""
    heard = sorted(entry.others, key=lambda one: -one.frames)[:most]
    said = [f"{one.sysid},{one.compid} {one.type}" for one in heard]
    more = entry.other_count - len(said)
    return ", ".join(map(unbroken, said)) + (f" and {more} more" if more > 0 else "")


def summary(entry: File) -> str:
    """What was found in a file, in half a line."""
    vehicles = entry.vehicles
    if not vehicles:
        return f"no vehicle; heard: {_heard(entry, _OTHERS)}".replace(NBSP, " ") if entry.others else "no vehicle"
    said = [counted(len(vehicles), "vehicle")]
    severities = [alarm.severity for vehicle in vehicles for alarm in vehicle.alarms]
    said += [counted(severities.count(kind), kind) for kind in ("alarm", "warning") if kind in severities]
    if not any(map(sends_attitude, vehicles)):
        said.append("no attitude")
    said += [f"vehicle {v.sysid} not compared" for v in vehicles if sends_attitude(v) and not compared(v)]
    return ", ".join(said if len(said) > 1 else [*said, "no alarm"])


def requests(vehicle: Vehicle) -> list[tuple[str, str]]:
    """The commands that make the autopilot send the messages without which nothing can be compared."""
    if any(check.name == "euler_quaternion" and check.verdict not in UNJUDGED for check in vehicle.checks):
        return []
    return [
        request_command(message, vehicle.autopilot)
        for message in _COMPARED
        if message not in vehicle.streams or not vehicle.streams[message].count
    ]


def _name(vehicle: Vehicle) -> str:
    return f"{vehicle.sysid},{vehicle.compid}"


def _value(value: float | Sequence[float] | None, unit: str | None) -> str:
    if value is None:
        return "unknown"
    numbers = value if isinstance(value, Sequence) else [value]
    least = _NOTHING * max(map(abs, numbers))
    return "/".join(shown(number if abs(number) > least else 0) for number in numbers) + UNITS.get(
        unit or "", f" {unit}"
    )
