"""The alarms of one vehicle: what each check's ratings make of them, which are told, and what people say to them.

Every alarm lives by its own samples alone. What one does to another (a warning is not told beside an alarm of the same
check, raises that come thick are grouped) is decided here, in the order of the frames that brought things about.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
from typing import Any, Literal, NamedTuple

import numpy as np

from gcs_bridge.alarms.grouping import Announcer
from gcs_bridge.alarms.rated import Rated, Worst
from gcs_bridge.alarms.record import AlarmRecord
from gcs_bridge.alarms.spec import AlarmSpec, RatedSamples
from gcs_bridge.alarms.state import PENDING, STANDING, Alarm, Change, Signal, State
from gcs_bridge.checks.base import Check
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
from gcs_bridge.telemetry.link_clock import LinkClock


class _ToldChange(NamedTuple):
    """A change of one alarm, and the frame that brought it about."""

    frame_index: int
    change: Change
    place: int  # of the alarm among all: severe ones first


class SignalAt(NamedTuple):
    """What became of a source of a check, told by a frame."""

    frame_index: int
    check: str
    signal: Signal


def _fed(alarm: Alarm, samples: Rated) -> list[tuple[int, Change]]:
    """The changes that samples bring about, each with the index of its frame."""
    return [(int(samples.frame_index[change.place]), change) for change in alarm.feed(samples)]


class AlarmTransition(NamedTuple):
    """An alarm was raised, goes, or is told again, with the frame `frame_index`; the difference began at `onset_us`."""

    record: AlarmRecord
    tier: str
    what: Literal["raised", "goes", "told"]
    frame_index: int
    t_boot_us: int
    onset_us: int
    t_rx_us: int


class AlarmSlot:
    """One alarm and its record within one boot."""

    def __init__(self, check: Check, tier: AlarmSpec) -> None:
        self.check = check
        self.tier = tier
        self.alarm = Alarm(tier.delays, tier.recurring_window_s)
        self.record: AlarmRecord | None = None  # of the excursion that is pending or stands
        self.last: AlarmRecord | None = None  # the latest that was raised
        self.raises = 0
        self.state = State.NORMAL  # as of what has been told
        self.told = False  # whether the excursion was told as raised
        self.is_repeat = False  # whether it belongs to the last one
        self.suppressed = False  # whether it stands, untold, beside an alarm of the same check

    @property
    def name(self) -> str:
        """Check and tier, joined."""
        return f"{self.check.name} {self.tier.name}"


def _gist(diagnosis: Diagnosis) -> tuple[Any, ...]:
    """What a diagnosis says, its value to the digits that matter."""
    value = diagnosis.value
    rounded = [round(number, 1) for number in (value if isinstance(value, tuple) else [value] if value else [])]
    return diagnosis.causes, diagnosis.candidates, diagnosis.confidence, diagnosis.side, rounded


def _moment(
    slot: AlarmSlot, change: Change, frame_index: int, t_rx_us: int, what: Literal["raised", "goes", "told"]
) -> AlarmTransition:
    assert slot.record is not None
    return AlarmTransition(slot.record, slot.tier.name, what, frame_index, change.t_boot_us, change.onset_us, t_rx_us)


class AlarmManager:
    """All alarms of one vehicle; a new set of them in every boot."""

    def __init__(self, vehicle: VehicleId, checks: Iterable[Check], settings: AlarmSettings) -> None:
        """Start with every alarm normal."""
        self.alarms: list[AlarmRecord] = []
        self._vehicle = vehicle
        self._checks = list(checks)
        self._settings = settings
        self._shelved: dict[str, int] = {}  # alarm name → receive time at which it ends, µs
        self.start_boot(0)

    def start_boot(self, boot: int) -> None:
        """Begin a boot: its alarms are new."""
        self._boot = boot
        self._announcer = Announcer(self._settings)
        slots = [AlarmSlot(check, tier) for check in self._checks for tier in check.alarm_specs]
        self._slots = sorted(slots, key=lambda slot: slot.tier.severity != "alarm")
        self._by_name = {slot.name: slot for slot in self._slots}

    def pending(self, check: str) -> bool:
        """Whether an alarm of this check waits for its delay."""
        return any(slot.check.name == check and slot.alarm.state in PENDING for slot in self._slots)

    def standing(self) -> list[AlarmRecord]:
        """The alarms that are pending or stand, severe ones first."""
        return [slot.record for slot in self._slots if slot.record is not None and not slot.suppressed]

    def feed(
        self,
        ratings: Iterable[tuple[Check, RatedSamples]],
        signals: Iterable[SignalAt],
        link: LinkClock,
        ask: Callable[[AlarmTransition], Iterable[Notice]] = lambda _: (),
    ) -> Iterator[Notice]:
        """Take what the checks found in one batch, and what became of their sources; yield what is to be told.

        `ask` is called right behind each raise and right before each end of an alarm, to find out why.
        """
        self._ask = ask
        rated = {f"{check.name} {found.tier}": found.rated for check, found in ratings}
        heard: dict[str, list[tuple[int, Signal | None]]] = {}
        for one in signals:
            heard.setdefault(one.check, []).append((one.frame_index, one.signal))
        ends = self._ends_of_shelving(link)
        told = []
        for place, slot in enumerate(self._slots):
            samples = rated.get(slot.name)
            marks = heard.get(slot.check.name, [])
            if slot.name in ends:
                marks = [*marks, (ends[slot.name], None)]
            for frame_index, signal in sorted(marks, key=lambda mark: mark[0]):
                if samples is not None:
                    until = int(np.searchsorted(samples.frame_index, frame_index))
                    told += [_ToldChange(*each, place=place) for each in _fed(slot.alarm, samples[:until])]
                    samples = samples[until:]
                before = after = slot.alarm.state
                if signal is not None:
                    before, after = slot.alarm.signal(signal)
                if before is not after or signal is None:
                    told.append(_ToldChange(frame_index, Change(-1, before, after, 0, slot.alarm.worst), place))
            if samples is not None:
                told += [_ToldChange(*each, place=place) for each in _fed(slot.alarm, samples)]
        told.sort(key=lambda one: (one.frame_index, one.place))
        for frame_index, together in groupby(told, key=lambda one: one.frame_index):
            changes = list(together)
            for _, change, place in changes:
                yield from self._tell(self._slots[place], change, frame_index, link.at(frame_index))
            for slot in self._slots:  # a warning that stood beside an alarm says by itself now what is left
                if slot.suppressed and self._severer(slot) is None:
                    change = changes[-1].change._replace(worst=slot.alarm.worst)
                    yield from self._raise(slot, change, frame_index, link.at(frame_index))
        for slot in self._slots:
            if slot.record is not None and not slot.suppressed:
                slot.record.show(slot.alarm.worst)

    def end_boot(self, frame_index: int, t_boot_us: int, t_rx_us: int) -> Iterator[Notice]:
        """The boot is over, and with it alarms that were never seen to go: their `cleared_boot_s` stays unknown."""
        for slot in self._slots:
            if slot.record is not None and slot.alarm.state in STANDING and slot.told:
                yield self._notice(AlarmCleared, slot.record, t_boot_us, frame_index, t_rx_us, reason="reboot")

    def _tell(self, slot: AlarmSlot, change: Change, frame_index: int, t_rx_us: int) -> Iterator[Notice]:
        before, after = change.before, change.state
        if before is after:
            if slot.record is not None and slot.state in STANDING:
                yield from self._ask(_moment(slot, change, frame_index, t_rx_us, "told"))
            yield from self._end_shelving(slot, change.worst, frame_index)
            return
        slot.state = after
        if after in PENDING and before not in PENDING:
            slot.told = slot.suppressed = False
            due_us = change.t_boot_us + round(slot.tier.delays.on_delay_s * 1e6)
            slot.is_repeat = slot.last is not None and self._announcer.belongs_to_last(slot.name, due_us)
            slot.record = self._new_record(slot)
            if self._severer(slot) is None and not self._is_shelved(slot):
                slot.record.show(change.worst)
                yield self._notice(AlarmPending, slot.record, change.t_boot_us, frame_index, t_rx_us)
        elif before in PENDING and after not in PENDING | STANDING:
            slot.record = None
        elif after is State.RAISED and before in PENDING:
            yield from self._raise(slot, change, frame_index, t_rx_us)
        elif before in STANDING and after not in STANDING:
            yield from self._clear(slot, change, frame_index, t_rx_us)

    def _clear(self, slot: AlarmSlot, change: Change, frame_index: int, t_rx_us: int) -> Iterator[Notice]:
        at_s = change.t_boot_us / 1e6
        if slot.record is not None and not slot.suppressed:
            slot.record.show(change.worst)
            slot.record.cleared_boot_s = at_s
            yield from self._ask(_moment(slot, change, frame_index, t_rx_us, "goes"))
            if slot.told and not self._is_shelved(slot):
                yield self._notice(AlarmCleared, slot.record, change.t_boot_us, frame_index, t_rx_us)
        slot.record, slot.suppressed = None, False

    def _raise(self, slot: AlarmSlot, change: Change, frame_index: int, t_rx_us: int) -> Iterator[Notice]:
        record = slot.record
        assert record is not None
        if self._severer(slot) is not None:
            slot.suppressed = True  # an alarm of the same check says it already
            return
        slot.suppressed = False
        grouped = self._announcer.group(slot.name, change.t_boot_us)
        if slot.is_repeat and slot.last is not None:
            grouped = grouped or "repeat"
            record = slot.record = slot.last
            record.repeats += 1
            record.cleared_boot_s, record.acknowledged = None, False
        else:
            slot.raises += 1
            slot.last = record
            record.raised_boot_s, record.raised_utc = change.t_boot_us / 1e6, utc(t_rx_us)
            self.alarms.append(record)
        record.grouped = grouped or record.grouped
        record.show(change.worst)
        slot.told = True
        if not self._is_shelved(slot):
            yield self._notice(AlarmRaised, record, change.t_boot_us, frame_index, t_rx_us)
        yield from self._ask(_moment(slot, change, frame_index, t_rx_us, "raised"))

    def _severer(self, slot: AlarmSlot) -> AlarmSlot | None:
        """An alarm of the same check beside which this warning is not told."""
        if slot.tier.severity == "alarm":
            return None
        busy = PENDING | STANDING
        same = (other for other in self._slots if other.check is slot.check and other.tier.severity == "alarm")
        return next((other for other in same if other.state in busy), None)

    def _new_record(self, slot: AlarmSlot) -> AlarmRecord:
        tier = "" if slot.tier.name in ("pairs", "alarm") else "-" + slot.tier.name.replace(" ", "-").lower()
        number = slot.raises if slot.is_repeat else slot.raises + 1
        name = f"{self._vehicle.name}-{slot.check.name}{tier}-{self._boot}-{number}"
        return AlarmRecord.new(
            alarm_id=name,
            check=slot.check.name,
            severity=slot.tier.severity,
            boot=self._boot,
            what=slot.tier.what,
            is_not=slot.check.not_a_sign_of,
            unit=slot.tier.unit or slot.check.unit,
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
        self,
        kind: type[AlarmEvent],
        record: AlarmRecord,
        t_boot_us: int | None,
        frame_index: int,
        t_rx_us: int,
        **more: Any,
    ) -> Notice:
        where = head(self._vehicle, record.boot, t_boot_us, t_rx_us, record.check)
        return Notice(frame_index, kind(**where, **record.told(), **more))

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
            _, slot.state = slot.alarm.signal(Signal.ACKNOWLEDGE)
        record.acknowledged = True
        yield self._notice(AlarmAcknowledged, record, None, frame_index, t_rx_us)

    def shelve(self, alarm_id: str, frame_index: int, t_rx_us: int, duration_s: float) -> Iterator[Notice]:
        """Tell nothing of this alarm for a time."""
        slot, record = self._of(alarm_id)
        if slot is None:
            raise UsageError(f"alarm {alarm_id}: of an earlier boot, over")
        if not 0 < duration_s < math.inf:
            raise UsageError(f"duration_s = {duration_s}: must be above 0")
        until_us = self._shelved[slot.name] = t_rx_us + round(duration_s * 1e6)
        yield self._notice(AlarmShelved, record, None, frame_index, t_rx_us, until_utc=utc(until_us))

    def unshelve(self, alarm_id: str, frame_index: int, t_rx_us: int) -> Iterator[Notice]:
        """Tell of this alarm again."""
        slot, record = self._of(alarm_id)
        if slot is None or self._shelved.pop(slot.name, None) is None:
            raise UsageError(f"alarm {alarm_id}: not shelved")
        yield from self._unshelved(slot, record, frame_index, t_rx_us)

    def pass_time(self, link: LinkClock) -> Iterator[Notice]:
        """Shelving that has run out ends, with the first frame behind its time."""
        for name, frame_index in self._ends_of_shelving(link).items():
            slot = self._by_name[name]
            yield from self._end_shelving(slot, slot.alarm.worst, frame_index)

    def _ends_of_shelving(self, link: LinkClock) -> dict[str, int]:
        """Alarms whose shelving runs out with these frames, and the frame that is behind its time."""
        rows = {name: int(np.searchsorted(link.latest_rx_us, until_us)) for name, until_us in self._shelved.items()}
        return {name: int(link.frame_index[row]) for name, row in rows.items() if row < len(link.frame_index)}

    def _end_shelving(self, slot: AlarmSlot, worst: Worst, frame_index: int) -> Iterator[Notice]:
        until_us = self._shelved.pop(slot.name, None)
        if until_us is None or slot.last is None:
            return
        if slot.record is not None and slot.state in STANDING:
            slot.record.show(worst)
        yield from self._unshelved(slot, slot.last, frame_index, until_us)

    def _unshelved(self, slot: AlarmSlot, record: AlarmRecord, frame_index: int, t_rx_us: int) -> Iterator[Notice]:
        yield self._notice(AlarmUnshelved, record, None, frame_index, t_rx_us)
        if slot.state in STANDING and slot.record is not None:  # it stands, and nobody was told of this
            yield self._notice(AlarmRaised, slot.record, None, frame_index, t_rx_us)

    def _is_shelved(self, slot: AlarmSlot) -> bool:
        return slot.name in self._shelved

    def _of(self, alarm_id: str) -> tuple[AlarmSlot | None, AlarmRecord]:
        for slot in self._slots:
            for record in (slot.last, slot.record):  # what repeats the last has its id
                if record is not None and record.id == alarm_id:
                    return slot, record
        for record in self.alarms:
            if record.id == alarm_id:
                return None, record
        raise UsageError(f"unknown alarm {alarm_id!r}")
