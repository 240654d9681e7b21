"""Events as they happen: one JSON object a line for programs, one readable line for people."""

from __future__ import annotations

import msgspec

from gcs_bridge.contract import readable
from gcs_bridge.errors import one_line
from gcs_bridge.events import (
    AlarmEvent,
    AlarmPending,
    AlarmRaised,
    ClockStep,
    CompareResumed,
    Damage,
    DiagnosisMade,
    Event,
    LinkDown,
    NoCompare,
    StreamEvent,
    StreamStale,
)
from gcs_bridge.report.wording import difference

__all__ = ["event_json", "event_line", "event_words", "is_alarm", "is_detail"]
_SAID = {
    "vehicle_seen": "vehicle seen",
    "vehicle_lost": "vehicle LOST: nothing comes from it any more",
    "reboot": "rebooted",
    "estimator_reset": "the estimator was reset",
}


def event_json(event: Event, link: str | None = None) -> bytes:
    """The event as one line of JSON, with the name of its link where one is given; what is unknown is null."""
    if link is not None:
        event = msgspec.structs.replace(event, link=readable(link))
    return msgspec.json.encode(event) + b"\n"


def event_line(event: Event) -> str:
    """The event as one readable line: UTC, vehicle, its boot time, what happened."""
    clock = "time ?" if event.utc is None else event.utc[11:19]
    who = ",".join(map(str, event.vehicle)) if event.vehicle else "link"
    at = "" if event.boot_s is None else f"{event.boot_s:.1f} s"
    return f"{clock:<8}  {who:<5}  {at:>9}  {event_words(event)}"


def event_words(event: Event) -> str:
    """What happened, in a few words: no time, no vehicle, one line."""
    return one_line(_said(event))


def is_alarm(event: Event) -> bool:
    """Whether somebody who wants to see nothing but alarms wants to see it."""
    return isinstance(event, AlarmEvent) and not is_detail(event)


def is_detail(event: Event) -> bool:
    """Whether it is for those who want to see everything: a disagreement that may yet pass."""
    return isinstance(event, AlarmPending)


def _said(event: Event) -> str:
    match event:
        case AlarmEvent():
            return _alarm(event)
        case StreamStale():
            return f"{event.stream} went silent"
        case StreamEvent():
            return f"{event.stream} {event.name.removeprefix('stream_')}"
        case DiagnosisMade(diagnosis=found):
            return f"{event.check}: {' or '.join(found.candidates or [found.cause])}: {found.fix}"
        case NoCompare():
            return f"NO COMPARE {event.check}: {event.reason}"
        case CompareResumed():
            return f"{event.check} is compared again"
        case ClockStep():
            return f"boot clock stepped by {event.step_s:+.1f} s"
    said = [_SAID.get(event.name) or event.name.replace("_", " ")]
    if isinstance(event.link, str):
        said.append(event.link)
    if isinstance(event, LinkDown | Damage):
        said.append(event.reason)
    return ": ".join(said)


def _alarm(event: AlarmEvent) -> str:
    what = event.name.removeprefix("alarm_")
    label = event.severity.upper() if isinstance(event, AlarmRaised) else f"{event.severity} {what}"
    said = f"{label} {event.check}: {difference(event)}"
    diagnosis = event.diagnosis
    return f"{said}; cause: {diagnosis.cause}, {diagnosis.confidence}" if diagnosis else said
