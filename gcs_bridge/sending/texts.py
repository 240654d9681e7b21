"""`--statustext`: alarms as a ground station says them, in the 50 characters that one STATUSTEXT has."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from gcs_bridge.events import AlarmCleared, AlarmEvent, AlarmRaised, Event
from gcs_bridge.mavlink.packer import TEXT_BYTES

__all__ = ["AlarmTexts", "Text"]
# MAV_SEVERITY. Critical: a primary system has failed. What has ended is a notice.
_SEVERITY = {"alarm": 2, "warning": 4}
_NOTICE = 5
# No more than so many within so long: each takes room on the vehicle's link, and somebody's ears.
_TEXTS, _WITHIN_S = 20, 10.0


class Text(NamedTuple):
    """What is to be said of a vehicle, by the number of its link and its system."""

    link: int
    system: int
    severity: int
    text: str


class AlarmTexts:
    """Turns alarms into texts; of a flood of them only the first."""

    def __init__(self) -> None:
        """Nothing was said yet."""
        self.withheld = 0
        self._said_s: deque[float] = deque()

    def of(self, events: Sequence[Event], now_s: float) -> Iterator[Text]:
        """What is to be said of the events of one batch."""
        for event in events:
            if isinstance(event, AlarmRaised | AlarmCleared) and event.vehicle is not None:
                while self._said_s and now_s - self._said_s[0] > _WITHIN_S:
                    self._said_s.popleft()
                if len(self._said_s) >= _TEXTS:
                    self.withheld += 1
                    continue
                self._said_s.append(now_s)
                link = event.link if isinstance(event.link, int) else 0
                severity = _SEVERITY[event.severity] if isinstance(event, AlarmRaised) else _NOTICE
                yield Text(link, event.vehicle[0], severity, alarm_text(event))


def alarm_text(event: AlarmEvent) -> str:
    """What is said of one: the check, how bad, how much, and where, as far as there is room.

    Nothing in it is a text from the air.
    """
    if isinstance(event, AlarmCleared):
        return f"{event.check} {event.severity} cleared"[:TEXT_BYTES]
    said = f"{event.check} {event.severity.upper()}"
    if event.unit:  # else it only is so, and how much says nothing
        said += f": {event.peak:.3g} {event.unit.removeprefix('1')}".rstrip()
    axis = f", {event.axis}" if event.axis else ""
    return said + axis if len(said + axis) <= TEXT_BYTES else said[:TEXT_BYTES]
