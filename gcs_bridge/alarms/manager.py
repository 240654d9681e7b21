"""The alarms of one vehicle: what each check's ratings make of them, which are told, and what people say to them.

Every alarm lives by its own samples alone. What one does to another (a warning is not told beside an alarm of the same
check, raises that come thick are grouped) is decided here, in the order of the frames that brought things about.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Literal, NamedTuple

import numpy as np

from gcs_bridge.alarms.ballot import Ballot, SlotNow
from gcs_bridge.alarms.grouping import RaiseGrouping
from gcs_bridge.alarms.rated import Worst
from gcs_bridge.alarms.record import AlarmRecord
from gcs_bridge.alarms.slot import AlarmSlot
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.state import MOVING, PENDING, STANDING, AnnouncementSignal, Change, Signal, State
from gcs_bridge.contract import Diagnosis
from gcs_bridge.errors import UsageError
from gcs_bridge.events import (
    AlarmAcknowledged,
    AlarmCleared,
    AlarmEvent,
    AlarmPending,
    AlarmRaised,
    AlarmShelved,
    AlarmUnshelved,
    DiagnosisMade,
    Notice,
    head,
    utc,
)
from gcs_bridge.settings import AlarmSettings
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock


class SignalAt(NamedTuple):
    """What became of a source of a check, told by a frame."""

    frame_index: int
    check: str
    signal: Signal


@dataclass(frozen=True, kw_only=True)
class AlarmTransition:
    """An alarm was raised, goes, or is told again, with the frame `frame_index`; the difference began at `onset_us`."""

    record: AlarmRecord
    spec: AlarmSpec
    what: Literal["raised", "goes", "told"]
    frame_index: int
    t_boot_us: int
    onset_us: int


Ask = Callable[[AlarmTransition], Iterable[Notice]]


class TakenBack(NamedTuple):
    """An alarm that was pending, and passed without a raise at `t_boot_us`: no event tells of that."""

    id: str
    t_boot_us: int


class _At(NamedTuple):
    """A frame, and when it was received."""

    frame_index: int
    t_rx_us: int


class AlarmManager:
    """All alarms of one vehicle, over all its boots."""

    def __init__(self, vehicle: VehicleId, specs: Iterable[AlarmSpec], settings: AlarmSettings) -> None:
        """Start with every alarm normal."""
        self.alarms: list[AlarmRecord] = []
        self.taken_back: list[TakenBack] = []  # by what was told last
        self._vehicle = vehicle
        self._settings = settings
        self.ballot = Ballot(sorted(specs, key=lambda spec: spec.severity != "alarm"))
        self._slots = [AlarmSlot(spec, self.ballot) for spec in self.ballot.specs]
        self._of_check: dict[str, list[AlarmSlot]] = {}
        for slot in self._slots:
            self._of_check.setdefault(slot.spec.check, []).append(slot)
        self._places_of = {check: [slot.place for slot in slots] for check, slots in self._of_check.items()}
        self._shortest_s = min(
            (
                delay
                for spec in self.ballot.specs
                for delay in (spec.delays.on_delay_s, spec.delays.off_delay_s)
                if delay
            ),
            default=0.0,
        )
        self.calm_s = 0.0  # how long it takes at least until an alarm that has a delay is raised or goes
        self._shelf: dict[AlarmSlot, int] = {}  # what is shelved → receive time at which that ends, µs
        self.start_boot(0)

    def start_boot(self, boot: int) -> None:
        """Begin a boot: its alarms are new."""
        self._boot = boot
        self._grouping = RaiseGrouping(self._settings)
        self.ballot.start_boot()
        for slot in self._slots:
            slot.start_boot()

    def end_boot(self, frame_index: int, t_boot_us: int, t_rx_us: int) -> Iterator[Notice]:
        """The boot is over, and with it alarms that were never seen to go: their `cleared_boot_s` stays unknown."""
        for slot in self._slots:
            if slot.record is not None and slot.stands and not slot.is_suppressed:
                at = _At(frame_index, t_rx_us)
                yield self._notice(AlarmCleared, slot.record, t_boot_us, at, reason="reboot")

    def slots_now(self) -> Iterator[tuple[AlarmSlot, SlotNow]]:
        """Every alarm, and where it is, in the order of their places."""
        return zip(self._slots, self.ballot.now(), strict=True)

    def places_of(self, check: str) -> Sequence[int]:
        """Of the alarms of this check."""
        return self._places_of.get(check, ())

    def pending(self, check: str) -> bool:
        """Whether an alarm of this check waits for its delay."""
        return any(slot.is_pending for slot in self._of_check.get(check, ()))

    def standing(self) -> list[AlarmRecord]:
        """The alarms that are pending or stand, severe ones first."""
        return [slot.record for slot in self._slots if slot.record is not None and not slot.is_suppressed]

    def begin(self, signals: Iterable[SignalAt], link: LinkClock) -> None:
        """Take, before the samples of a batch are given to the ballot, what became of the sources of checks in it."""
        for one in signals:
            for place, spec in enumerate(self.ballot.specs):
                if spec.check == one.check:
                    self.ballot.signal(place, [(one.frame_index, one.signal)])
        for slot, frame_index in self._ends_of_shelving(link).items():
            self.ballot.signal(self._slots.index(slot), [(frame_index, None)])

    def tell(self, link: LinkClock, ask: Ask = lambda _: ()) -> Iterator[Notice]:
        """Yield what is to be told of all that the ballot was given in a batch of frames of the link.

        `ask` is called right behind each raise and right before each end of an alarm, to find out why.
        """
        self.taken_back = []
        changes = sorted(self.ballot.changes(), key=lambda one: (one.frame_index, one.alarm))
        for frame_index, together in groupby(changes, key=lambda one: one.frame_index):
            at = _At(frame_index, link.at(frame_index))
            for one in together:
                latest = one.change
                yield from self._tell(self._slots[one.alarm], latest, at, ask)
            yield from self._release(latest, at, ask)
        self.calm_s = self._shortest_s
        for slot in self._slots:
            if slot.record is not None:
                if slot.state in MOVING:
                    self.calm_s = 0.0
                if not slot.is_suppressed:
                    slot.show_worst()

    def _tell(self, slot: AlarmSlot, change: Change, at: _At, ask: Ask) -> Iterator[Notice]:
        """One alarm changed: what that is called, and what follows from it."""
        before, after = change.before, change.state
        slot.state = after
        if before is after:
            if slot.stands:
                yield from ask(_transition(slot, "told", change, at))
            yield from self._end_shelving(slot, change.worst, at.frame_index)
        elif after in PENDING and before not in PENDING:
            yield from self._begin(slot, change, at)
        elif before in PENDING and after not in PENDING | STANDING:
            if slot.record is not None:
                self.taken_back.append(TakenBack(slot.record.id, change.t_boot_us))
            slot.record = None
        elif after is State.RAISED and before in PENDING:
            yield from self._raise(slot, change, at, ask)
        elif before in STANDING and after not in STANDING:
            yield from self._clear(slot, change, at, ask)

    def _begin(self, slot: AlarmSlot, change: Change, at: _At) -> Iterator[Notice]:
        """An excursion, which waits for the on-delay: a new alarm, or the last one again."""
        due_us = change.t_boot_us + round(slot.spec.delays.on_delay_s * 1e6)
        again = slot.last is not None and self._grouping.belongs_to_last(slot.spec, due_us)
        slot.record = self._new_record(slot.spec, slot.numbered if again else slot.numbered + 1)
        if not self._is_said_already(slot) and not slot.is_shelved:
            slot.record.show(change.worst)
            yield self._notice(AlarmPending, slot.record, change.t_boot_us, at)

    def _raise(self, slot: AlarmSlot, change: Change, at: _At, ask: Ask) -> Iterator[Notice]:
        """The delay has run out, or what suppressed it has gone."""
        if self._is_said_already(slot):
            slot.announce(AnnouncementSignal.SUPPRESS)
            return
        slot.announce(AnnouncementSignal.RELEASE)
        grouped = self._grouping.group(slot.spec, change.t_boot_us)
        record = slot.record
        assert record is not None
        if slot.is_repeat and slot.last is not None:
            grouped = grouped or "repeat"
            record = slot.record = slot.last
            record.repeats += 1
            record.cleared_boot_s, record.acknowledged = None, False
        else:
            slot.numbered += 1
            slot.last = record
            record.raised_boot_s, record.raised_utc = change.t_boot_us / 1e6, utc(at.t_rx_us)
            self.alarms.append(record)
        record.grouped = grouped or record.grouped
        record.show(change.worst)
        if not slot.is_shelved:
            yield self._notice(AlarmRaised, record, change.t_boot_us, at)
        yield from ask(_transition(slot, "raised", change, at))

    def _clear(self, slot: AlarmSlot, change: Change, at: _At, ask: Ask) -> Iterator[Notice]:
        """It has gone; one that was suppressed to its end was never told."""
        if slot.record is not None and not slot.is_suppressed:
            slot.record.show(change.worst)
            slot.record.cleared_boot_s = change.t_boot_us / 1e6
            yield from ask(_transition(slot, "goes", change, at))
            if not slot.is_shelved:
                yield self._notice(AlarmCleared, slot.record, change.t_boot_us, at)
        slot.record = None
        slot.announce(AnnouncementSignal.RELEASE)

    def _release(self, latest: Change, at: _At, ask: Ask) -> Iterator[Notice]:
        """What stood beside an alarm that went with this frame says by itself now what is left."""
        for slot in self._slots:
            if slot.is_suppressed and not self._is_said_already(slot):
                yield from self._raise(slot, latest._replace(worst=slot.worst), at, ask)

    def _is_said_already(self, slot: AlarmSlot) -> bool:
        """Whether this is a warning, and an alarm of the same check is pending or stands."""
        return slot.spec.severity == "warning" and any(
            other.is_pending or other.stands
            for other in self._slots
            if other.spec.check == slot.spec.check and other.spec.severity == "alarm"
        )

    def _new_record(self, spec: AlarmSpec, number: int) -> AlarmRecord:
        return AlarmRecord.new(
            alarm_id=f"{self._vehicle.name}-{spec.id_part}-{self._boot}-{number}",
            check=spec.check,
            severity=spec.severity,
            boot=self._boot,
            what=spec.what,
            is_not=spec.not_a_sign_of,
            unit=spec.unit,
        )

    def diagnosis(
        self, record: AlarmRecord, entry: Diagnosis, frame_index: int, t_boot_us: int, t_rx_us: int
    ) -> Iterator[Notice]:
        """The doctor's answer about an alarm: the record keeps it, and an event tells what is new in it."""
        before, record.diagnosis = record.diagnosis, entry
        if before is not None and _gist(before) == _gist(entry):
            return
        where = head(self._vehicle, record.boot, t_boot_us, t_rx_us, record.check)
        told = DiagnosisMade(**where, id=record.id, severity=record.severity, diagnosis=entry)
        yield Notice(frame_index, told)

    def _notice(
        self, kind: type[AlarmEvent], record: AlarmRecord, t_boot_us: int | None, at: _At, **more: Any
    ) -> Notice:
        where = head(self._vehicle, record.boot, t_boot_us, at.t_rx_us, record.check)
        return Notice(at.frame_index, kind(**where, **record.told(), **more))

    # What people say to alarms; times are receive times.

    def owns(self, alarm_id: str) -> bool:
        """Whether the alarm is one of this vehicle's."""
        return any(record.id == alarm_id for record in (*self.alarms, *self.standing()))

    def acknowledge(self, alarm_id: str, frame_index: int, t_rx_us: int) -> Iterator[Notice]:
        """Somebody has seen the alarm."""
        slot, record = self._of(alarm_id)
        if record.acknowledged or record.raised_boot_s is None:
            raise UsageError(f"alarm {alarm_id}: {'acknowledged already' if record.acknowledged else 'not raised yet'}")
        if slot is not None:
            slot.acknowledge()
        record.acknowledged = True
        yield self._notice(AlarmAcknowledged, record, None, _At(frame_index, t_rx_us))

    def shelve(self, alarm_id: str, frame_index: int, t_rx_us: int, duration_s: float) -> Iterator[Notice]:
        """Tell nothing of this alarm for a time."""
        slot, record = self._of(alarm_id)
        if slot is None:
            raise UsageError(f"alarm {alarm_id}: of an earlier boot, over")
        if not 0 < duration_s < math.inf:
            raise UsageError(f"duration_s = {duration_s}: must be above 0")
        slot.announce(AnnouncementSignal.SHELVE)
        self._shelf[slot] = t_rx_us + round(duration_s * 1e6)
        at = _At(frame_index, t_rx_us)
        yield self._notice(AlarmShelved, record, None, at, until_utc=utc(self._shelf[slot]))

    def unshelve(self, alarm_id: str, frame_index: int, t_rx_us: int) -> Iterator[Notice]:
        """Tell of this alarm again."""
        slot, record = self._of(alarm_id)
        if slot is None or not slot.is_shelved:
            raise UsageError(f"alarm {alarm_id}: not shelved")
        self._take_from_shelf(slot)
        yield from self._unshelved(slot, record, _At(frame_index, t_rx_us))

    @property
    def due_us(self) -> int:
        """The receive time of the link at which the next shelving runs out."""
        return min(self._shelf.values(), default=NEVER_US)

    def pass_time(self, link: LinkClock) -> Iterator[Notice]:
        """Shelving that has run out ends, with the first frame behind its time."""
        for slot, frame_index in self._ends_of_shelving(link).items():
            yield from self._end_shelving(slot, slot.worst, frame_index)

    def _ends_of_shelving(self, link: LinkClock) -> dict[AlarmSlot, int]:
        """Alarms whose shelving runs out with these frames, and the frame that is behind its time."""
        if not self._shelf:
            return {}
        rows = {slot: int(np.searchsorted(link.latest_rx_us, until_us)) for slot, until_us in self._shelf.items()}
        return {slot: int(link.frame_index[row]) for slot, row in rows.items() if row < len(link.frame_index)}

    def _end_shelving(self, slot: AlarmSlot, worst: Worst, frame_index: int) -> Iterator[Notice]:
        """Its time has run out; of what was not raised since the boot began there is nothing to tell."""
        until_us = self._take_from_shelf(slot)
        if slot.last is not None:
            if slot.record is not None and slot.stands:
                slot.record.show(worst)
            yield from self._unshelved(slot, slot.last, _At(frame_index, until_us))

    def _take_from_shelf(self, slot: AlarmSlot) -> int:
        slot.announce(AnnouncementSignal.UNSHELVE)
        return self._shelf.pop(slot)

    def _unshelved(self, slot: AlarmSlot, record: AlarmRecord, at: _At) -> Iterator[Notice]:
        yield self._notice(AlarmUnshelved, record, None, at)
        if slot.record is not None and slot.stands:  # and nobody was told of this
            yield self._notice(AlarmRaised, slot.record, None, at)

    def _of(self, alarm_id: str) -> tuple[AlarmSlot | None, AlarmRecord]:
        for slot in self._slots:
            for record in (slot.last, slot.record):  # what repeats the last has its id
                if record is not None and record.id == alarm_id:
                    return slot, record
        for record in self.alarms:
            if record.id == alarm_id:
                return None, record
        raise UsageError(f"unknown alarm {alarm_id!r}")


def _transition(slot: AlarmSlot, what: Literal["raised", "goes", "told"], change: Change, at: _At) -> AlarmTransition:
    assert slot.record is not None
    return AlarmTransition(
        record=slot.record,
        spec=slot.spec,
        what=what,
        frame_index=at.frame_index,
        t_boot_us=change.t_boot_us,
        onset_us=change.onset_us,
    )


def _gist(diagnosis: Diagnosis) -> tuple[Any, ...]:
    """What a diagnosis says, its value to the digits that matter."""
    value = diagnosis.value
    rounded = [round(number, 1) for number in (value if isinstance(value, tuple) else [value] if value else [])]
    return diagnosis.causes, diagnosis.candidates, diagnosis.confidence, diagnosis.side, rounded
