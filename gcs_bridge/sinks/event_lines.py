"""Events as they happen: one JSON object a line for programs, one readable line for people."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from gcs_bridge.errors import one_line
from gcs_bridge.events import Event
from gcs_bridge.files import write_stdout
from gcs_bridge.report.wording import difference
from gcs_bridge.sinks.base import Plan, Sink
from gcs_bridge.sinks.file import FileSink

__all__ = ["EventLines", "event_json", "event_line", "event_words", "is_alarm", "is_detail"]
_STDOUT = "-"
_SAID = {
    "vehicle_seen": "vehicle seen",
    "vehicle_lost": "vehicle LOST: nothing comes from it any more",
    "reboot": "rebooted",
    "estimator_reset": "the estimator was reset",
}


class EventLines(FileSink):
    """Writes events as JSON lines, all of a batch at once."""

    @classmethod
    def plan(cls, path: str) -> Plan:
        """A sink that appends to the file at `path`, or writes to standard output where that is `-`."""
        return Plan(lambda _: _StdoutLines(), takes_stdout=True) if path == _STDOUT else super().plan(path)

    def events(self, events: Sequence[Event]) -> None:
        """Write them."""
        self._file.append(b"".join(map(event_json, events)))


class _StdoutLines(Sink):
    """The same on standard output."""

    def events(self, events: Sequence[Event]) -> None:
        for event in events:
            write_stdout(event_json(event).decode())


def event_json(event: Event) -> bytes:
    """The event as one line of JSON; what is unknown is null."""
    return msgspec.json.encode(event) + b"\n"


def event_line(event: Event) -> str:
    """The event as one readable line: UTC, vehicle, its boot time, what happened."""
    clock = "time ?" if event["utc"] is None else event["utc"][11:19]
    who = ",".join(map(str, event["vehicle"])) if event["vehicle"] else "link"
    at = "" if event["boot_s"] is None else f"{event['boot_s']:.1f} s"
    return f"{clock:<8}  {who:<5}  {at:>9}  {event_words(event)}"


def event_words(event: Event) -> str:
    """What happened, in a few words: no time, no vehicle, one line."""
    return one_line(_said(event))


def is_alarm(event: Event) -> bool:
    """Whether somebody who wants to see nothing but alarms wants to see it."""
    return event["event"].startswith("alarm_") and not is_detail(event)


def is_detail(event: Event) -> bool:
    """Whether it is for those who want to see everything: a disagreement that may yet pass."""
    return bool(event["event"] == "alarm_pending")


def _said(event: Event) -> str:
    name = event["event"]
    if name.startswith("alarm_"):
        return _alarm(event)
    if name.startswith("stream_"):
        what = "went silent" if name == "stream_stale" else name.removeprefix("stream_")
        return f"{event['stream']} {what}"
    if name == "diagnosis":
        found = event["diagnosis"]
        return f"{event['check']}: {' or '.join(found['candidates'] or [found['cause']])}: {found['fix']}"
    if name == "no_compare":
        return f"NO COMPARE {event['check']}: {event['reason']}"
    if name == "compare_resumed":
        return f"{event['check']} is compared again"
    if name == "clock_step":
        return f"boot clock stepped by {event['step_s']:+.1f} s"
    said = _SAID.get(name) or name.replace("_", " ")
    about = [str(event[key]) for key in ("link", "reason") if event.get(key) and not event["vehicle"]]
    return ": ".join([said, *about])


def _alarm(event: Event) -> str:
    what = event["event"].removeprefix("alarm_")
    label = str(event["severity"]).upper() if what == "raised" else f"{event['severity']} {what}"
    said = f"{label} {event['check']}: {difference(event)}"
    diagnosis = event.get("diagnosis")
    return f"{said}; cause: {diagnosis['cause']}, {diagnosis['confidence']}" if diagnosis else said
