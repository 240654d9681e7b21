"""Events as they happen: one JSON object a line for programs, one readable line for people."""

from __future__ import annotations

from collections.abc import Sequence

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
    EstimatorReset,
    Event,
    LinkDown,
    NoCompare,
    RateRequested,
    ReceiverPaused,
    StreamEvent,
    StreamStale,
)
from gcs_bridge.files import write_stdout
from gcs_bridge.report.wording import difference, quantity
from gcs_bridge.sinks.base import Plan, Sink
from gcs_bridge.sinks.file import FileSink

__all__ = [
    "EventLines",
    "ReadableLines",
    "event_json",
    "event_line",
    "event_words",
    "is_alarm",
    "is_detail",
    "link_name",
]
_STDOUT = "-"
_SAID = {
    "vehicle_seen": "vehicle seen",
    "vehicle_lost": "vehicle LOST: nothing comes from it any more",
    "reboot": "rebooted",
}


class EventLines(FileSink):
    """Writes events as JSON lines, all of a batch at once; each with the name of its link."""

    @classmethod
    def plan(cls, path: str) -> Plan:
        """A sink that appends to the file at `path`, or writes to standard output where that is `-`."""
        if path == _STDOUT:
            return Plan(lambda context: _StdoutLines(context.links), takes_stdout=True)
        return super().plan(path)

    def events(self, events: Sequence[Event]) -> None:
        """Write them."""
        self._file.append(b"".join(event_json(event, link_name(event, self._links)) for event in events))


class _StdoutLines(Sink):
    """The same on standard output."""

    def __init__(self, links: Sequence[str]) -> None:
        self._links = links

    def events(self, events: Sequence[Event]) -> None:
        for event in events:
            write_stdout(event_json(event, link_name(event, self._links)).decode())


class ReadableLines:
    """Events as lines for people: those that they want; of several links with the one on which each came."""

    def __init__(self, links: Sequence[str], *, detail: int) -> None:
        """`links`: their names, by their numbers; `detail` −1: alarms alone, 1: also what may yet pass."""
        self._links = links
        self._detail = detail

    def __call__(self, event: Event) -> str | None:
        """The line of an event, None where it is not wanted."""
        if not (is_alarm(event) or self._detail >= is_detail(event)):
            return None
        tell_link = event.vehicle and len(self._links) > 1
        return event_line(event) + (f"  ({link_name(event, self._links)})" if tell_link else "")


def link_name(event: Event, links: Sequence[str]) -> str:
    """The name of the link that an event is about, of a run that listens to these; in the order of their numbers."""
    return event.link if isinstance(event.link, str) else links[event.link or 0]


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
        case ClockStep(step_s=float(step_s)):
            return f"boot clock stepped by {step_s:+.1f} s"
        case RateRequested() | ReceiverPaused():
            return event.reason
        case EstimatorReset():
            return _reset(event)
        case Damage(signature=str()):
            return f"signing: {event.reason}"
    said = [_SAID.get(event.name) or event.name.replace("_", " ")]
    if isinstance(event.link, str):
        said.append(event.link)
    if isinstance(event, LinkDown | Damage):
        said.append(event.reason)
    return ": ".join(said)


def _reset(event: EstimatorReset) -> str:
    steps = f"heading stepped by {quantity(event.heading, 'deg')}, tilt by {quantity(event.tilt, 'deg')}"
    said = f" (said before it: {'; '.join(event.explained_by)})" if event.explained_by else ""
    return f"the estimator was reset: {steps}{said}"


def _alarm(event: AlarmEvent) -> str:
    what = event.name.removeprefix("alarm_")
    label = event.severity.upper() if isinstance(event, AlarmRaised) else f"{event.severity} {what}"
    said = f"{label} {event.check}: {difference(event)}"
    diagnosis = event.diagnosis
    return f"{said}; cause: {diagnosis.cause}, {diagnosis.confidence}" if diagnosis else said
