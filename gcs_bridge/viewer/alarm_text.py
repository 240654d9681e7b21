"""What the alarms of a vehicle say, whole: a text that breaks its lines by itself, beside the scene.

vehicle/1.1/alarms   those that stand at the cursor's time, and the latest that went, with cause and what to do
"""

from __future__ import annotations

from collections.abc import Iterator

import rerun as rr

from gcs_bridge.contract import Diagnosis
from gcs_bridge.errors import one_line
from gcs_bridge.events import (
    AlarmAcknowledged,
    AlarmCleared,
    AlarmEvent,
    AlarmPending,
    AlarmShelved,
    DiagnosisMade,
    Event,
    Reboot,
)
from gcs_bridge.report.wording import difference
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.rows import Shown
from gcs_bridge.viewer.scene import path_of
from gcs_bridge.viewer.times import instant_of

__all__ = ["AlarmText"]

_MOST = 6  # alarms that are written out
_GONE = 2  # of them such that went
_BREAK = "  \n"  # Markdown's: no room between the lines of one alarm


class AlarmText:
    """Follows the alarms of one vehicle."""

    def __init__(self, key: VehicleId) -> None:
        """Start with none."""
        self._path = path_of(key, "alarms")
        self._stand: dict[str, AlarmEvent] = {}  # by id, the latest last
        self._gone: list[AlarmEvent] = []
        self._diagnoses: dict[str, Diagnosis] = {}
        self._said = ""

    def hear(self, event: Event) -> Iterator[Shown]:
        """An event of the vehicle."""
        match event:
            case AlarmCleared() | AlarmShelved():
                self._stand.pop(event.id, None)
                self._gone = [event, *(one for one in self._gone if one.id != event.id)][:_GONE]
            case AlarmPending():
                pass  # it may pass
            case AlarmEvent():
                self._stand.pop(event.id, None)
                self._stand[event.id] = event
            case DiagnosisMade():
                self._diagnoses[event.id] = event.diagnosis
            case Reboot():
                self._stand, self._gone, self._diagnoses = {}, [], {}
        said = self._text()
        if said != self._said and event.boot_s is not None:  # else it would be on one of two timelines alone
            self._said = said
            yield Shown(instant_of(event), [(self._path, rr.TextDocument(said, media_type=rr.MediaType.MARKDOWN))])

    def _text(self) -> str:
        if not self._stand and not self._gone:
            return "No alarm."
        latest_first = list(reversed(self._stand.values()))
        standing = sorted(latest_first, key=lambda alarm: self._found(alarm) is None)[:_MOST]  # what has a remedy first
        gone = self._gone[: max(_MOST - len(standing), 0)]
        return "\n\n".join([*map(self._alarm, standing), *map(self._alarm, gone)])

    def _alarm(self, alarm: AlarmEvent) -> str:
        since = "" if alarm.raised_boot_s is None else f" since {alarm.raised_boot_s:.1f} s"
        label = alarm.severity.upper()
        if isinstance(alarm, AlarmShelved):
            label, since = f"shelved {alarm.severity}", ""
        elif isinstance(alarm, AlarmCleared):
            until = "" if alarm.cleared_boot_s is None else f" to {alarm.cleared_boot_s:.1f} s"
            label, since = f"{alarm.severity} gone", since.replace(" since", "") + until
        elif isinstance(alarm, AlarmAcknowledged):
            since += ", acknowledged"
        lines = [f"**{label} {_plain(alarm.check or '')}**{since}: {_plain(difference(alarm))}"]
        found = self._found(alarm)
        if found is not None:
            causes = " or ".join(found.candidates or (found.cause,))
            lines += [f"**Cause**, {found.confidence}: {_plain(causes)}", f"**Do:** {_plain(found.fix)}"]
        return _BREAK.join(lines)

    def _found(self, alarm: AlarmEvent) -> Diagnosis | None:
        return alarm.diagnosis or self._diagnoses.get(alarm.id)


def _plain(text: str) -> str:
    """Text that Markdown shows as it is."""
    return "".join(f"\\{sign}" if sign in r"\`*_{}[]<>#|~" else sign for sign in one_line(text))
