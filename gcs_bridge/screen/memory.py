"""What events tell that a snapshot does not: the words of an alarm, who is lost, what happened of late."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from gcs_bridge.events import (
    AlarmEvent,
    AlarmRaised,
    AlarmShelved,
    AlarmUnshelved,
    DiagnosisMade,
    Event,
    VehicleLost,
    VehicleSeen,
    vehicle_of,
)
from gcs_bridge.report.wording import difference
from gcs_bridge.screen.canvas import one_cell
from gcs_bridge.telemetry.identity import VehicleId

__all__ = ["Line", "Memory"]

_LINES, _ALARMS = 200, 500  # are kept; a program that runs for days must not grow


class Line(NamedTuple):
    """Something that was told."""

    text: str
    is_alarm: bool = False
    is_note: bool = False  # told by this program about itself


class Memory:
    """What was told so far, as far as it is worth keeping."""

    def __init__(self) -> None:
        """Start with nothing told."""
        self.lines: deque[Line] = deque(maxlen=_LINES)  # the latest last
        self.lost: set[VehicleId] = set()
        self.shelved_until: dict[str, str] = {}
        self._said: dict[str, str] = {}
        self._fixes: dict[str, str] = {}

    def take(self, events: Sequence[Event]) -> None:
        """Take the events of a batch."""
        for event in events:
            match event:
                case VehicleLost():
                    self.lost.add(vehicle_of(event))
                case VehicleSeen():
                    self.lost.discard(vehicle_of(event))
                case DiagnosisMade():
                    _keep(self._fixes, event.id, f"{event.diagnosis.cause}: {event.diagnosis.fix}")
                case AlarmEvent():
                    self._take_alarm(event)

    def tell(self, text: str, *, is_alarm: bool = False, is_note: bool = False) -> None:
        """Keep a line for people."""
        self.lines.append(Line(one_cell(text), is_alarm, is_note))

    def about(self, alarm_id: str | None) -> list[str]:
        """What an alarm says, and then, if it is known, what to do about it."""
        return [said[alarm_id] for said in (self._said, self._fixes) if alarm_id in said]

    def _take_alarm(self, event: AlarmEvent) -> None:
        since = "" if event.raised_utc is None else f"since {event.raised_utc[11:19]}Z: "
        _keep(self._said, event.id, since + difference(event))
        if isinstance(event, AlarmShelved):
            _keep(self.shelved_until, event.id, (event.until_utc or "")[11:16])
        elif isinstance(event, AlarmUnshelved):
            self.shelved_until.pop(event.id, None)
        elif isinstance(event, AlarmRaised) and event.diagnosis is None:
            self._fixes.pop(event.id, None)


def _keep(kept: dict[str, str], key: str, text: str) -> None:
    """Keep a text; the oldest one goes where there are too many."""
    kept.pop(key, None)
    kept[key] = one_cell(text)
    if len(kept) > _ALARMS:
        del kept[next(iter(kept))]
