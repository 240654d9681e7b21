"""The alarms of one vehicle: what each check's ratings make of them, which are told, and what people say to them.

Every alarm lives by its own samples alone. What one does to another (a warning is not told beside an alarm of the same
check, raises that come thick are grouped) is decided here, in the order of the frames that brought things about.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.alarms import PENDING, STANDING, Alarm, Announcer, Change, Rated, Signal, State, Worst
from gcs_bridge.checks.protocol import Check, Ratings, Tier
from gcs_bridge.errors import UsageError
from gcs_bridge.events import Notice, make_event, utc
from gcs_bridge.liveness import LinkClock
from gcs_bridge.settings import AlarmSettings

_NAMED_ABOVE = 0.9  # share of a turn along an axis, from which on the axis is named


@dataclass
class AlarmRecord:
    """One alarm, as the contract's report and events show it; angles in degrees, rates in degrees a second.

    `what` it says and `is_not` what it is no sign of; `axis` where the difference lies; `repeats` counts further raises
    that belong to it, `grouped` says why ("repeat", "chatter", "flood").
    """

    id: str
    check: str
    severity: str
    boot: int
    what: str
    is_not: str
    raised_boot_s: float | None = None
    cleared_boot_s: float | None = None
    raised_utc: str | None = None
    unit: str = "deg"
    peak: float = 0.0
    axis: str | None = None
    tilt: float | None = None
    heading: float | None = None
    rotvec_body: list[float] | None = None
    repeats: int = 0
    grouped: str | None = None
    acknowledged: bool = False
    diagnosis: dict[str, Any] | None = None

    def show(self, worst: Worst) -> None:
        """Take the peak of the excursion, and what came with it."""
        scale = math.degrees(1.0) if self.unit.startswith("deg") else 1.0
        if worst.value * scale < self.peak:
            return
        self.peak = worst.value * scale
        tilt, heading, *rotvec = np.degrees(worst.detail).tolist()
        self.tilt, self.heading = _known(tilt), _known(heading)
        self.rotvec_body = None if math.isnan(rotvec[0]) else rotvec
        self.axis = axis_of(worst.detail)


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def axis_of(detail: npt.NDArray[np.float64]) -> str | None:
    """Where a difference lies: its parts, tilt and heading, and the body axis that it is about, if it is about one.

    `detail` (5,) is tilt, heading, rad, and the vector in body axes. A turn about the world's down is a heading error
    even if a body axis lies along down; a turn about a pitched body's axis has both parts, so the axis is named.
    """
    tilt, heading = float(detail[0]), float(detail[1])
    size = float(np.sqrt(np.sum(detail[2:] ** 2)))
    if math.isnan(size) or size == 0.0:
        return None
    along = np.abs(detail[2:]) / size
    best = int(np.argmax(along))
    body = _BODY_AXES[best] if along[best] > _NAMED_ABOVE else None
    if math.isnan(tilt):
        return body
    share = abs(heading) if not math.isnan(heading) else 0.0
    parts = "heading" if share > _NAMED_ABOVE * size and tilt < share / 2 else "tilt"
    if parts == "heading" or body is None:
        return parts if parts == "heading" or share < tilt / 2 else "tilt and heading"
    return f"{parts if share < tilt / 2 else 'tilt and heading'}, about {body}"


_BODY_AXES = ("body x (roll)", "body y (pitch)", "body z (yaw)")


class _Told(NamedTuple):
    """A change of one alarm, and the frame that brought it about."""

    ordinal: int
    change: Change
    place: int  # of the alarm among all: severe ones first


class SignalAt(NamedTuple):
    """What became of a source of a check, told by a frame."""

    ordinal: int
    check: str
    signal: Signal


def _fed(alarm: Alarm, samples: Rated) -> list[tuple[int, Change]]:
    """The changes that samples bring about, each with the ordinal of its frame."""
    return [(int(samples.ordinal[change.place]), change) for change in alarm.feed(samples)]


class Moment(NamedTuple):
    """An alarm was raised, goes, or is told again, with the frame `ordinal`; the difference began at `onset_us`."""

    record: AlarmRecord
    tier: str
    what: Literal["raised", "goes", "told"]
    ordinal: int
    t_boot_us: int
    onset_us: int
    t_rx_us: int


class _Line:
    """One alarm and its record within one boot."""

    def __init__(self, check: Check, tier: Tier) -> None:
        self.check = check
        self.tier = tier
        self.alarm = Alarm(tier.delays, tier.recurring_window_s)
        self.record: AlarmRecord | None = None  # of the excursion that is pending or stands
        self.last: AlarmRecord | None = None  # the latest that was raised
        self.raises = 0
        self.state = State.NORMAL  # as of what has been told
        self.told = False  # whether the excursion was told as raised
        self.joins = False  # whether it belongs to the last one
        self.beside = False  # whether it stands, untold, beside an alarm of the same check

    @property
    def name(self) -> str:
        return f"{self.check.name} {self.tier.name}"


def _gist(diagnosis: dict[str, Any]) -> tuple[Any, ...]:
    """What a diagnosis says, its value to the digits that matter."""
    value = diagnosis["value"]
    rounded = [round(number, 1) for number in (value if isinstance(value, list) else [value] if value else [])]
    return diagnosis["causes"], diagnosis["candidates"], diagnosis["confidence"], diagnosis["side"], rounded


def _moment(line: _Line, change: Change, ordinal: int, t_rx_us: int, what: Literal["raised", "goes", "told"]) -> Moment:
    assert line.record is not None
    return Moment(line.record, line.tier.name, what, ordinal, change.t_boot_us, change.onset_us, t_rx_us)


class Desk:
    """All alarms of one vehicle; a new set of them in every boot."""

    def __init__(self, key: tuple[int, int], checks: Iterable[Check], settings: AlarmSettings) -> None:
        """Start with every alarm normal."""
        self.alarms: list[AlarmRecord] = []
        self._key = key
        self._checks = list(checks)
        self._settings = settings
        self._shelved: dict[str, int] = {}  # alarm name → receive time at which it ends, µs
        self.start_boot(0)

    def start_boot(self, boot: int) -> None:
        """Begin a boot: its alarms are new."""
        self._boot = boot
        self._announcer = Announcer(self._settings)
        lines = [_Line(check, tier) for check in self._checks for tier in check.tiers]
        self._lines = sorted(lines, key=lambda line: line.tier.severity != "alarm")
        self._by_name = {line.name: line for line in self._lines}

    def pending(self, check: str) -> bool:
        """Whether an alarm of this check waits for its delay."""
        return any(line.check.name == check and line.alarm.state in PENDING for line in self._lines)

    def standing(self) -> list[AlarmRecord]:
        """The alarms that are pending or stand, severe ones first."""
        return [line.record for line in self._lines if line.record is not None and not line.beside]

    def feed(
        self,
        ratings: Iterable[tuple[Check, Ratings]],
        signals: Iterable[SignalAt],
        link: LinkClock,
        ask: Callable[[Moment], Iterable[Notice]] = lambda _: (),
    ) -> Iterator[Notice]:
        """Take what the checks found in one batch, and what became of their sources; yield what is to be told.

        `ask` is called right behind each raise and right before each end of an alarm, to find out why.
        """
        self._ask = ask
        rated = {f"{check.name} {found.tier}": found.rated for check, found in ratings}
        heard: dict[str, list[tuple[int, Signal | None]]] = {}
        for one in signals:
            heard.setdefault(one.check, []).append((one.ordinal, one.signal))
        ends = self._ends_of_shelving(link)
        told = []
        for place, line in enumerate(self._lines):
            samples = rated.get(line.name)
            marks = heard.get(line.check.name, [])
            if line.name in ends:
                marks = [*marks, (ends[line.name], None)]
            for ordinal, signal in sorted(marks, key=lambda mark: mark[0]):
                if samples is not None:
                    until = int(np.searchsorted(samples.ordinal, ordinal))
                    told += [_Told(*each, place=place) for each in _fed(line.alarm, samples[:until])]
                    samples = samples[until:]
                before = after = line.alarm.state
                if signal is not None:
                    before, after = line.alarm.signal(signal)
                if before is not after or signal is None:
                    told.append(_Told(ordinal, Change(-1, before, after, 0, line.alarm.worst), place))
            if samples is not None:
                told += [_Told(*each, place=place) for each in _fed(line.alarm, samples)]
        told.sort(key=lambda one: (one.ordinal, one.place))
        for ordinal, together in groupby(told, key=lambda one: one.ordinal):
            changes = list(together)
            for _, change, place in changes:
                yield from self._tell(self._lines[place], change, ordinal, link.at(ordinal))
            for line in self._lines:  # a warning that stood beside an alarm says by itself now what is left
                if line.beside and self._severer(line) is None:
                    change = changes[-1].change._replace(worst=line.alarm.worst)
                    yield from self._raise(line, change, ordinal, link.at(ordinal))
        for line in self._lines:
            if line.record is not None and not line.beside:
                line.record.show(line.alarm.worst)

    def end_boot(self, ordinal: int, t_boot_us: int, t_rx_us: int) -> Iterator[Notice]:
        """The boot is over, and with it alarms that were never seen to go: their `cleared_boot_s` stays unknown."""
        for line in self._lines:
            if line.record is not None and line.alarm.state in STANDING and line.told:
                head = make_event("alarm_cleared", self._key, self._boot, t_boot_us, t_rx_us)
                yield Notice(ordinal, head | asdict(line.record) | {"reason": "reboot"})

    def _tell(self, line: _Line, change: Change, ordinal: int, t_rx_us: int) -> Iterator[Notice]:
        before, after = change.before, change.state
        if before is after:
            if line.record is not None and line.state in STANDING:
                yield from self._ask(_moment(line, change, ordinal, t_rx_us, "told"))
            yield from self._end_shelving(line, change.worst, ordinal)
            return
        line.state = after
        if after in PENDING and before not in PENDING:
            line.told = line.beside = False
            due_us = change.t_boot_us + round(line.tier.delays.on_delay_s * 1e6)
            line.joins = line.last is not None and self._announcer.belongs_to_last(line.name, due_us)
            line.record = self._new_record(line)
            if self._severer(line) is None and not self._is_shelved(line):
                line.record.show(change.worst)
                yield self._notice("alarm_pending", line.record, change.t_boot_us, ordinal, t_rx_us)
        elif before in PENDING and after not in PENDING | STANDING:
            line.record = None
        elif after is State.RAISED and before in PENDING:
            yield from self._raise(line, change, ordinal, t_rx_us)
        elif before in STANDING and after not in STANDING:
            yield from self._clear(line, change, ordinal, t_rx_us)

    def _clear(self, line: _Line, change: Change, ordinal: int, t_rx_us: int) -> Iterator[Notice]:
        at_s = change.t_boot_us / 1e6
        if line.record is not None and not line.beside:
            line.record.show(change.worst)
            line.record.cleared_boot_s = at_s
            yield from self._ask(_moment(line, change, ordinal, t_rx_us, "goes"))
            if line.told and not self._is_shelved(line):
                yield self._notice("alarm_cleared", line.record, change.t_boot_us, ordinal, t_rx_us)
        line.record, line.beside = None, False

    def _raise(self, line: _Line, change: Change, ordinal: int, t_rx_us: int) -> Iterator[Notice]:
        record = line.record
        assert record is not None
        if self._severer(line) is not None:
            line.beside = True  # an alarm of the same check says it already
            return
        line.beside = False
        grouped = self._announcer.group(line.name, change.t_boot_us)
        if line.joins and line.last is not None:
            grouped = grouped or "repeat"
            record = line.record = line.last
            record.repeats += 1
            record.cleared_boot_s, record.acknowledged = None, False
        else:
            line.raises += 1
            line.last = record
            record.raised_boot_s, record.raised_utc = change.t_boot_us / 1e6, utc(t_rx_us)
            self.alarms.append(record)
        record.grouped = grouped or record.grouped
        record.show(change.worst)
        line.told = True
        if not self._is_shelved(line):
            yield self._notice("alarm_raised", record, change.t_boot_us, ordinal, t_rx_us)
        yield from self._ask(_moment(line, change, ordinal, t_rx_us, "raised"))

    def _severer(self, line: _Line) -> _Line | None:
        """An alarm of the same check beside which this warning is not told."""
        if line.tier.severity == "alarm":
            return None
        busy = PENDING | STANDING
        same = (other for other in self._lines if other.check is line.check and other.tier.severity == "alarm")
        return next((other for other in same if other.state in busy), None)

    def _new_record(self, line: _Line) -> AlarmRecord:
        tier = "" if line.tier.name in ("pairs", "alarm") else "-" + line.tier.name.replace(" ", "-").lower()
        number = line.raises if line.joins else line.raises + 1
        name = f"{self._key[0]}.{self._key[1]}-{line.check.name}{tier}-{self._boot}-{number}"
        record = AlarmRecord(name, line.check.name, line.tier.severity, self._boot, line.tier.what, line.check.is_not)
        record.unit = line.tier.unit or line.check.unit
        return record

    def diagnosis(
        self, record: AlarmRecord, entry: dict[str, Any], ordinal: int, t_boot_us: int, t_rx_us: int
    ) -> Iterator[Notice]:
        """The doctor's answer about an alarm: the record keeps it, and an event tells what is new in it."""
        before, record.diagnosis = record.diagnosis, entry
        if before is not None and _gist(before) == _gist(entry):
            return
        head = make_event("diagnosis", self._key, record.boot, t_boot_us, t_rx_us, check=record.check)
        yield Notice(ordinal, head | {"id": record.id, "severity": record.severity, "diagnosis": entry})

    def _notice(self, event: str, record: AlarmRecord, t_boot_us: int | None, ordinal: int, t_rx_us: int) -> Notice:
        head = make_event(event, self._key, record.boot, t_boot_us, t_rx_us)
        return Notice(ordinal, head | asdict(record))

    # What people say to alarms; times are receive times.

    def owns(self, alarm_id: str) -> bool:
        """Whether the alarm is one of this vehicle's."""
        return any(record.id == alarm_id for record in (*self.alarms, *self.standing()))

    def acknowledge(self, alarm_id: str, ordinal: int, t_rx_us: int) -> Iterator[Notice]:
        """Somebody has seen the alarm."""
        line, record = self._of(alarm_id)
        if record.acknowledged or record.raised_boot_s is None:
            raise UsageError(f"alarm {alarm_id}: {'acknowledged already' if record.acknowledged else 'not raised yet'}")
        if line is not None:
            _, line.state = line.alarm.signal(Signal.ACKNOWLEDGE)
        record.acknowledged = True
        yield self._notice("alarm_acknowledged", record, None, ordinal, t_rx_us)

    def shelve(self, alarm_id: str, ordinal: int, t_rx_us: int, duration_s: float) -> Iterator[Notice]:
        """Tell nothing of this alarm for a time."""
        line, record = self._of(alarm_id)
        if line is None:
            raise UsageError(f"alarm {alarm_id}: of an earlier boot, over")
        if not 0 < duration_s < math.inf:
            raise UsageError(f"duration_s = {duration_s}: must be above 0")
        self._shelved[line.name] = t_rx_us + round(duration_s * 1e6)
        notice = self._notice("alarm_shelved", record, None, ordinal, t_rx_us)
        notice.event["until_utc"] = utc(self._shelved[line.name])
        yield notice

    def unshelve(self, alarm_id: str, ordinal: int, t_rx_us: int) -> Iterator[Notice]:
        """Tell of this alarm again."""
        line, record = self._of(alarm_id)
        if line is None or self._shelved.pop(line.name, None) is None:
            raise UsageError(f"alarm {alarm_id}: not shelved")
        yield from self._unshelved(line, record, ordinal, t_rx_us)

    def pass_time(self, link: LinkClock) -> Iterator[Notice]:
        """Shelving that has run out ends, with the first frame behind its time."""
        for name, ordinal in self._ends_of_shelving(link).items():
            line = self._by_name[name]
            yield from self._end_shelving(line, line.alarm.worst, ordinal)

    def _ends_of_shelving(self, link: LinkClock) -> dict[str, int]:
        """Alarms whose shelving runs out with these frames, and the frame that is behind its time."""
        rows = {name: int(np.searchsorted(link.latest_rx_us, until_us)) for name, until_us in self._shelved.items()}
        return {name: int(link.ordinal[row]) for name, row in rows.items() if row < len(link.ordinal)}

    def _end_shelving(self, line: _Line, worst: Worst, ordinal: int) -> Iterator[Notice]:
        until_us = self._shelved.pop(line.name, None)
        if until_us is None or line.last is None:
            return
        if line.record is not None and line.state in STANDING:
            line.record.show(worst)
        yield from self._unshelved(line, line.last, ordinal, until_us)

    def _unshelved(self, line: _Line, record: AlarmRecord, ordinal: int, t_rx_us: int) -> Iterator[Notice]:
        yield self._notice("alarm_unshelved", record, None, ordinal, t_rx_us)
        if line.state in STANDING and line.record is not None:  # it stands, and nobody was told of this
            yield self._notice("alarm_raised", line.record, None, ordinal, t_rx_us)

    def _is_shelved(self, line: _Line) -> bool:
        return line.name in self._shelved

    def _of(self, alarm_id: str) -> tuple[_Line | None, AlarmRecord]:
        for line in self._lines:
            for record in (line.last, line.record):  # what repeats the last has its id
                if record is not None and record.id == alarm_id:
                    return line, record
        for record in self.alarms:
            if record.id == alarm_id:
                return None, record
        raise UsageError(f"unknown alarm {alarm_id!r}")
