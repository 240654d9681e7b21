"""What the doctor tells, for reading: a part a link, then this machine, and last a line a link, verdict first."""

from __future__ import annotations

from collections.abc import Iterator

from gcs_bridge.errors import one_line
from gcs_bridge.inspection.schema import (
    Advice,
    Ask,
    Examination,
    Finding,
    LinkFound,
    MachinePart,
    Message,
    PartState,
    Station,
    Vehicle,
)
from gcs_bridge.report.rows import counted, in_bytes, in_percent, in_seconds, labelled, unbroken

__all__ = ["to_text"]
_FINDINGS: dict[Finding, str] = {"good": "GOOD", "missing": "MISSING", "wrong": "WRONG", "unusable": "UNUSABLE"}
_STATES: dict[PartState, str] = {"good": "good", "mend": "TO MEND", "absent": "absent", "unknown": "unknown"}
_UNKNOWN, _MOST_UNKNOWN = "UNKNOWN_", 8  # of which so many are named
_NOTES = ("advice", "note")


def to_text(found: Examination, *, detail: int = 0) -> str:
    """The examination for reading; `detail` -1 gives the last lines alone, 1 lists what others than vehicles send."""
    lines: list[str] = []
    if detail >= 0:
        for link in found.links:
            lines += [*_link(link, found, detail), ""]
        lines += [*_machine(found.machine), ""]
    for link in found.links:
        lines += _conclusion(link, found)
    return "\n".join(lines).rstrip("\n") + "\n"


def _link(link: LinkFound, found: Examination, detail: int) -> Iterator[str]:
    yield f"{one_line(link.name)}  ({_amount(link)})"
    said = [
        f"{counted(count, noun)} {what}"
        for count, noun, what in (
            (link.bad_crc, "frame", "with a bad checksum"),
            (link.skipped_bytes, "byte", "skipped"),
            (link.unverified, "frame", "of unknown kind"),
            (link.duplicates, "frame", "that had come before"),
        )
        if count
    ]
    if said:
        yield from labelled(
            "damage" if link.bad_crc or link.skipped_bytes else "data", ", ".join(map(unbroken, said)), indent=2
        )
    for vehicle in found.vehicles:
        if vehicle.link == link.name:
            yield from _vehicle(vehicle)
    others = [one for one in found.stations if one.link == link.name]
    for station in others:
        yield from _station(station, detail)
    for one in found.advice:
        if one.link == link.name:
            yield from _advice(one)


def _amount(link: LinkFound) -> str:
    seconds = [] if link.seconds is None else [in_seconds(link.seconds)]
    rate = "" if link.frames_per_s is None else f", {link.frames_per_s:.0f}/s"
    return ", ".join([*seconds, in_bytes(link.bytes), counted(link.frames, "frame") + rate])


def _vehicle(vehicle: Vehicle) -> Iterator[str]:
    version = vehicle.firmware or "of unknown version"
    whence = f", from {vehicle.address}" if vehicle.address else ""
    speaks = " and ".join(f"MAVLink {version}" for version in vehicle.mavlink)
    yield (
        f"  {vehicle.sysid},{vehicle.compid} {vehicle.autopilot} {version}, {vehicle.type}, {speaks}, "
        f"{counted(vehicle.frames, 'frame')}{whence}"
    )
    yield from _messages(vehicle.messages)
    yield from labelled("loss", vehicle.loss.text)
    yield from labelled("clock", vehicle.clock.text)
    yield from labelled("signing", vehicle.signing.text)
    for one in vehicle.missing:
        yield from labelled("missing", f"{one.message}; in {one.where}: {unbroken(one.command)}")


def _messages(messages: dict[str, Message]) -> Iterator[str]:
    known = {name: one for name, one in messages.items() if not name.startswith(_UNKNOWN)}
    width = max(map(len, known), default=0)
    for name, one in known.items():
        rate = "   rate unknown" if one.rate_hz is None else f"{one.rate_hz:>9.2f} Hz "
        jitter = "" if one.jitter_ms is None else f"± {one.jitter_ms:.1f} ms"
        age = "" if one.age_s is None else f"{one.age_s:.1f} s ago"
        copies = f"  {one.copies} of them copies" if one.copies else ""
        yield f"      {name:<{width}} {one.count:>7} {rate} {jitter:>13} {age:>12}{copies}".rstrip()
    unknown = sorted(messages.keys() - known.keys(), key=lambda name: -messages[name].count)
    if unknown:
        said = [f"{name.removeprefix(_UNKNOWN)} ({messages[name].count})" for name in unknown[:_MOST_UNKNOWN]]
        more = len(unknown) - len(said)
        text = ", ".join(map(unbroken, said)) + (f" and {counted(more, 'more id')}" if more else "")
        yield from labelled("of unknown ids", text)


def _station(station: Station, detail: int) -> Iterator[str]:
    said = [f"{station.sysid},{station.compid} {station.type}", counted(station.frames, "frame")]
    yield from labelled("beside", ", ".join(map(unbroken, [*said, *map(_ask, station.asks)])), indent=2)
    if detail > 0:
        yield from _messages(station.messages)


def _ask(ask: Ask) -> str:
    whom = "all" if ask.of == (0, 0) else "{},{}".format(*ask.of)
    rate = "its own rate" if ask.rate_hz is None else f"{ask.rate_hz:g} Hz"
    return f"asks {whom} for {ask.what} at {rate} ({counted(ask.times, 'time')}, {ask.how})"


def _advice(one: Advice) -> Iterator[str]:
    of = "" if one.vehicle is None else "{},{}: ".format(*one.vehicle)
    yield from labelled(one.code, f"{of}{one.text}", indent=2)


def _machine(parts: dict[str, MachinePart]) -> Iterator[str]:
    yield "this machine"
    for name, part in parts.items():
        state = "" if part.state == "good" else f"{_STATES[part.state]}: "
        command = f": {unbroken(part.command)}" if part.command else ""
        yield from labelled(name.replace("_", " "), f"{state}{part.text}{command}", indent=2)


def _conclusion(link: LinkFound, found: Examination) -> Iterator[str]:
    """The link's last line, verdict first, and the commands that mend what is worse than a note."""
    said = [one for one in found.advice if one.link == link.name]
    flying = [one for one in found.vehicles if one.link == link.name]
    worst = [one for one in said if one.level not in _NOTES] or [one for one in said if one.level == "advice"]
    codes = ", ".join(dict.fromkeys(one.code for one in worst)) or "nothing to mend"
    codes = f"to know: {codes}" if worst and link.finding == "good" else codes
    lost = [one.loss.share for one in flying if one.loss.share is not None]
    loss = f", {in_percent(max(lost))} lost" if lost and max(lost) >= 0.001 else ""
    yield f"{_FINDINGS[link.finding]:<10}  {one_line(link.name)}: {counted(len(flying), 'vehicle')}{loss}: {codes}"
    if link.finding == "unusable":
        yield from (f"            {one.text}" for one in worst)
    for command in dict.fromkeys(one.command for one in worst if one.command):
        yield f"            next: {command}"
