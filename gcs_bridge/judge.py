"""Judges one vehicle: samples become pairs, disagreements, alarms and notices, and at the end a report's entry."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gcs_bridge.alarms import Alarm, Change, State, Worst
from gcs_bridge.align import Aligner, Pairs
from gcs_bridge.checks.euler_quaternion import NAME, Disagreement, EulerQuaternion
from gcs_bridge.events import Notice, Rank, make_event, utc
from gcs_bridge.liveness import OTHER, LinkClock, Liveness, Timeline, Turn
from gcs_bridge.mavlink.requests import request_command
from gcs_bridge.samples import ATTITUDE, ATTITUDE_QUATERNION
from gcs_bridge.settings import Settings
from gcs_bridge.streams import StreamCount
from gcs_bridge.vehicles import ClockNotice, Segment, VehicleBatch, VehicleReader

Int64s = npt.NDArray[np.int64]

STREAMS = (ATTITUDE, ATTITUDE_QUATERNION)
US_PER_S = 1e6


@dataclass
class AlarmRecord:
    """One alarm, as the contract's report and events show it; angles in degrees."""

    id: str
    check: str
    severity: str
    boot: int
    raised_boot_s: float | None = None
    cleared_boot_s: float | None = None
    raised_utc: str | None = None
    unit: str = "deg"
    peak: float = 0.0
    tilt: float = 0.0
    heading: float | None = None
    rotvec_body: list[float] = field(default_factory=list)
    diagnosis: dict[str, Any] | None = None

    def show(self, worst: Worst) -> None:
        """Take the peak of the excursion, and what came with it."""
        tilt, heading, *rotvec = np.degrees(worst.detail).tolist()
        self.peak, self.tilt = math.degrees(worst.value), tilt
        self.heading, self.rotvec_body = None if math.isnan(heading) else heading, rotvec


@dataclass(frozen=True)
class Observation:
    """What one batch showed of a vehicle: its samples, the pairs they made, and the disagreement of each pair."""

    vehicle: tuple[int, int]
    segment: Segment
    pairs: Pairs
    disagreement: Disagreement


Observer = Callable[[Observation], None]


class _Boot:
    """What is followed within one boot of the vehicle."""

    def __init__(self, index: int, t_boot_us: int, t_rx_us: int, settings: Settings) -> None:
        self.index = index
        self.first_us = self.last_us = t_boot_us
        self.start_rx_us = t_rx_us - t_boot_us if t_rx_us >= 0 else -1
        self.aligner = Aligner(settings.alignment, settings.reset)
        self.liveness = Liveness(settings.stream)
        self.alarm = Alarm(settings.euler_quaternion)
        self.record: AlarmRecord | None = None  # of the alarm that is pending or raised
        self.no_compare_told = False

    def entry(self) -> dict[str, Any]:
        return {
            "index": self.index,
            "first_boot_s": self.first_us / US_PER_S,
            "last_boot_s": self.last_us / US_PER_S,
            "start_utc": utc(self.start_rx_us),
        }


class VehicleJudge:
    """Judges one vehicle, batch by batch."""

    def __init__(self, key: tuple[int, int], settings: Settings, observer: Observer | None = None) -> None:
        """Start with nothing judged; `key` is (system, component), `observer` is shown what is judged."""
        self.key = key
        self._observer = observer
        self.alarms: list[AlarmRecord] = []
        self._settings = settings
        self._boots: list[dict[str, Any]] = []
        self._boot: _Boot | None = None
        self._both_alive_us = 0
        self._left_pending = False  # a boot ended before its alarm's on-delay did
        self._check = EulerQuaternion(settings.euler_quaternion)
        self._streams: dict[str, StreamCount] = {}

    def take(self, batch: VehicleBatch, link: LinkClock) -> Iterator[Notice]:
        """Judge what a batch brought; yield what happened, each with the frame that brought it about."""
        for name, t_rx_us in batch.counted.items():
            self._stream(name).add(t_rx_us)
        for notice in batch.clock_changes:
            yield self._clock_notice(notice)
        for segment in batch.segments:
            yield from self._take_segment(segment, link)
        if self._boot is not None:
            yield from self._turns(self._boot.liveness.pass_silence(link), link)

    def advance(self, link: LinkClock) -> Iterator[Notice]:
        """Time passed on the link and nothing of this vehicle came."""
        if self._boot is not None:
            yield from self._turns(self._boot.liveness.pass_silence(link), link)

    def entry(self, reader: VehicleReader) -> dict[str, Any]:
        """The vehicle's entry in the report."""
        check = self._check_entry(reader.autopilot)
        boots = [*self._boots, *([self._boot.entry()] if self._boot else [])]
        return {
            "sysid": self.key[0],
            "compid": self.key[1],
            "autopilot": reader.autopilot,
            "type": reader.type,
            "verdict": check["verdict"],
            "boots": boots,
            "streams": {name: self._streams[name].entry() for name in sorted(self._streams)},
            "checks": [check],
            "alarms": [asdict(alarm) for alarm in self.alarms],
        }

    def _stream(self, name: str) -> StreamCount:
        return self._streams.setdefault(name, StreamCount())

    def _take_segment(self, segment: Segment, link: LinkClock) -> Iterator[Notice]:
        boot = self._boot
        if boot is None or boot.index != segment.boot:
            if boot is not None:
                yield from self._turns(boot.liveness.pass_silence(link, int(segment.ordinal[0])), link)
                yield from self._end_alarm(boot, int(segment.ordinal[0]), int(segment.t_rx_us[0]))
            boot = self._start_boot(segment)
        boot.last_us = max(boot.last_us, int(segment.t_boot_us.max()))

        paired = np.flatnonzero(segment.valid_attitude)
        euler, quaternion = segment.euler[segment.euler.valid], segment.quaternion[segment.quaternion.valid]
        by_stream = np.argsort(segment.message[paired], kind="stable")
        order = np.argsort(by_stream, kind="stable")  # the inverse: from one stream behind the other to arrival
        aligned = boot.aligner.pair(euler, quaternion, order)

        periods = np.full((2, len(segment.message)), -1)
        periods[0, paired], periods[1, paired] = aligned.period_us, aligned.rx_period_us
        self._count(segment, periods[0])
        line = Timeline(
            np.minimum(segment.message, OTHER),
            segment.t_boot_us,
            link.latest_rx_us[segment.ordinal - link.ordinal[0]],
            segment.ordinal,
            periods[0],
            periods[1],
        )
        yield from self._turns(boot.liveness.take(line, link), link)

        found, rated, rows = self._check.judge(aligned.pairs)
        if self._observer is not None:
            self._observer(Observation(self.key, segment, aligned.pairs, found))
        for change in boot.alarm.feed(rated):
            at = paired[aligned.pairs.trigger[rows[change.place]]]
            yield from self._alarm_notices(boot, change, int(segment.ordinal[at]), int(segment.t_rx_us[at]))
        if boot.record is not None and boot.alarm.state is not State.NORMAL:
            boot.record.show(boot.alarm.worst)

    def _end_alarm(self, boot: _Boot, ordinal: int, t_rx_us: int) -> Iterator[Notice]:
        """The boot is over, and with it an alarm that was never seen to go: its `cleared_boot_s` stays unknown."""
        if boot.record is not None and boot.alarm.state in (State.RAISED, State.CLEARING):
            head = make_event("alarm_cleared", self.key, boot.index, boot.last_us, t_rx_us)
            yield Notice(ordinal, head | asdict(boot.record) | {"reason": "reboot"})

    def _start_boot(self, segment: Segment) -> _Boot:
        before = self._boot
        boot = _Boot(segment.boot, int(segment.t_boot_us[0]), int(segment.t_rx_us[0]), self._settings)
        if before is not None:
            self._boots.append(before.entry())
            self._both_alive_us += before.liveness.both_alive_us
            boot.no_compare_told = before.no_compare_told
            self._left_pending |= before.alarm.state is State.PENDING
        self._boot = boot
        self._check.start_boot()
        for name in self._streams.keys() & set(STREAMS):  # all others are followed on receive time
            self._streams[name].start_boot()
        return boot

    def _count(self, segment: Segment, period_us: Int64s) -> None:
        for index, samples in enumerate((segment.euler, segment.quaternion)):
            if len(samples):
                count = self._stream(samples.source)
                mine = segment.message == index
                steps = count.add(samples.t_boot_us)
                count.add_losses(steps, period_us[mine], segment.lost[mine])
                count.invalid += int((~samples.valid).sum())

    def _clock_notice(self, notice: ClockNotice) -> Notice:
        change = notice.change
        boot = change.boot
        event = make_event(
            change.kind, self.key, boot, change.t_boot_us, notice.t_rx_us, step_s=change.step_us / US_PER_S
        )
        return Notice(notice.ordinal, event, Rank.CLOCK)

    def _turns(self, turns: Iterator[Turn], link: LinkClock) -> Iterator[Notice]:
        boot = self._boot
        assert boot is not None
        for turn in turns:
            t_rx_us = link.at(turn.ordinal)
            where = (self.key, boot.index, turn.t_boot_us, t_rx_us - turn.ago_us if t_rx_us >= 0 else t_rx_us)
            stream = STREAMS[turn.stream]
            if turn.what != "missing":
                yield Notice(turn.ordinal, make_event(f"stream_{turn.what}", *where, stream=stream))
            if turn.what in ("missing", "stale") and not boot.no_compare_told:
                boot.no_compare_told = True
                silent = "was never received" if turn.what == "missing" else "is silent"
                reason = f"{stream} {silent}"
                yield Notice(turn.ordinal, make_event("no_compare", *where, check=NAME, reason=reason))
            elif boot.no_compare_told and boot.liveness.both_alive:
                boot.no_compare_told = False
                yield Notice(turn.ordinal, make_event("compare_resumed", *where, check=NAME))

    def _alarm_notices(self, boot: _Boot, change: Change, ordinal: int, t_rx_us: int) -> Iterator[Notice]:
        at_s = change.t_boot_us / US_PER_S
        if change.state is State.PENDING:
            number = 1 + sum(alarm.boot == boot.index for alarm in self.alarms)
            name = f"{self.key[0]}.{self.key[1]}-{NAME}-{boot.index}-{number}"
            boot.record = AlarmRecord(name, NAME, "alarm", boot.index)
            event = "alarm_pending"
        elif change.before is State.PENDING and change.state is State.RAISED:
            event = "alarm_raised"
        elif change.before is State.CLEARING and change.state is State.NORMAL:
            event = "alarm_cleared"
        else:
            return
        record = boot.record
        assert record is not None
        record.show(change.worst)
        if event == "alarm_raised":
            record.raised_boot_s, record.raised_utc = at_s, utc(t_rx_us)
            self.alarms.append(record)
        elif event == "alarm_cleared":
            record.cleared_boot_s = at_s
        head = make_event(event, self.key, boot.index, change.t_boot_us, t_rx_us)
        yield Notice(ordinal, head | asdict(record))

    def _check_entry(self, autopilot: str) -> dict[str, Any]:
        """The report's entry of the comparison, with its verdict and the reason for it."""
        check = self._check
        both_us = self._both_alive_us + (self._boot.liveness.both_alive_us if self._boot else 0)
        numbers = check.numbers()
        if self.alarms:
            worst = max(self.alarms, key=lambda alarm: alarm.peak)
            alarms = "1 alarm" if len(self.alarms) == 1 else f"{len(self.alarms)} alarms"
            verdict, reason = "alarm", f"{alarms}, up to {worst.peak:.3g}°"
        elif check.pairs < self._settings.euler_quaternion.counted_samples:
            verdict, reason = "no_compare", self._why_not_compared(autopilot)
        elif self._undecided():
            differs = f"{check.bad} of {check.counted} pairs differ, by up to {math.degrees(check.angle.max):.3g}°"
            verdict, reason = "no_compare", f"{differs}, but for too short a time or too seldom to raise an alarm"
        else:
            verdict, reason = "agree", "both forms are one rotation, within the limit and the bound of each comparison"
        return {
            "name": NAME,
            "verdict": verdict,
            "reason": reason,
            "coverage": min(check.judged_us / both_us, 1.0) if both_us > 0 else None,
            **numbers,
            "lag_ms": None,
            "explained_by": [],
        }

    def _undecided(self) -> bool:
        """Whether there was disagreement that the alarm's votes and delays never came to decide on."""
        pending = self._boot is not None and self._boot.alarm.state is State.PENDING
        return pending or self._left_pending or 2 * self._check.bad > self._check.counted

    def _why_not_compared(self, autopilot: str) -> str:
        missing = [name for name in STREAMS if name not in self._streams]
        if len(missing) == len(STREAMS):
            return "neither ATTITUDE nor ATTITUDE_QUATERNION was received"
        if missing:
            return f"{missing[0]} was never received: {how_to_get(missing[0], autopilot)}"
        usable = min(self._streams[name].count - self._streams[name].invalid for name in STREAMS)
        if usable < self._settings.euler_quaternion.counted_samples:
            rarest = min(STREAMS, key=lambda name: self._streams[name].count - self._streams[name].invalid)
            return f"only {usable} usable samples of {rarest}: {how_to_get(rarest, autopilot)}"
        return (
            f"only {self._check.pairs} pairs could be judged: the two streams never came at one instant, nor with gaps "
            f"below {self._settings.alignment.max_gap_s:g} s and body rates to interpolate with"
        )


def how_to_get(message: str, autopilot: str) -> str:
    """What to do about a message that does not come."""
    where, command = request_command(message, autopilot)
    return f"ask for it, in {where}: {command}"
