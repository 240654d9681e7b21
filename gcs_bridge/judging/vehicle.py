"""Judges one vehicle: its samples become pairs, every check is given both, and what they rate goes to the alarms.

Knows neither the link nor other vehicles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import starmap

import numpy as np

from gcs_bridge.alarms.manager import AlarmManager
from gcs_bridge.checks import all_checks
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.checks.stream import StreamCheck
from gcs_bridge.columns import Int64s
from gcs_bridge.events import Notice, in_order
from gcs_bridge.expected import Expected
from gcs_bridge.judging.boot import Boot, timeline_of
from gcs_bridge.judging.doctor import Doctor
from gcs_bridge.judging.in_force import InForce
from gcs_bridge.judging.notices import (
    clock_notice,
    rate_notice,
    reset_entry,
    reset_notice,
    stream_changes,
)
from gcs_bridge.judging.observation import Observation, Observer
from gcs_bridge.judging.rating import Beside, Rating, begun
from gcs_bridge.judging.sent import SentBatch, SentPairs
from gcs_bridge.judging.snapshot import CheckNow, VehicleNow, alarm_now, attitude_now
from gcs_bridge.judging.untimed import Untimed
from gcs_bridge.judging.verdicts import Verdicts
from gcs_bridge.report import schema
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.batches import BootSegment, VehicleBatch, no_segment
from gcs_bridge.telemetry.clocks import ClockChange
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.known import Known
from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock
from gcs_bridge.telemetry.others import OfOthers
from gcs_bridge.telemetry.positions import NO_POSITIONS
from gcs_bridge.telemetry.samples import STREAMS, AttitudeSamples
from gcs_bridge.telemetry.statements import ModeSet, ParameterSet
from gcs_bridge.telemetry.stream_counts import StreamCount

_MOST_RESETS = 100  # that the report lists
_MOST_POSITIONS = 256  # that wait for a message with a time


class VehicleJudge:
    """Judges one vehicle, batch by batch."""

    def __init__(
        self,
        vehicle: VehicleId,
        settings: Settings,
        observer: Observer | None = None,
        *,
        doctor_waits: bool = False,
        beside: Beside | None = None,
    ) -> None:
        """Start with nothing judged; `observer` is shown what is judged. `doctor_waits`: for `answer`.

        With `beside` some checks are judged in another thread.
        """
        self.vehicle = vehicle
        self._observer = observer
        self._settings = settings
        self._boots: list[schema.Boot] = []
        self._resets: list[schema.EstimatorReset] = []
        self._boot: Boot | None = None
        self._both_alive_us = 0
        self._checks = all_checks(settings, vehicle.address)
        self._euler_quaternion = next(check for check in self._checks if isinstance(check, EulerQuaternion))
        self._stream_check = next(check for check in self._checks if isinstance(check, StreamCheck))
        self.alarm_manager = AlarmManager(
            vehicle, (spec for check in self._checks for spec in check.alarm_specs), settings.alarm
        )
        self._beside = beside
        self._rating = Rating(vehicle, self._checks, self.alarm_manager.ballot, beside)
        self.doctor = Doctor(self.alarm_manager, waits=doctor_waits)
        self._answered: list[Notice] = []  # between two batches, and not shown to the observer yet
        self._expected = Expected()
        self._in_force = InForce(settings)
        self._streams: dict[str, StreamCount] = {}
        self._verdicts = Verdicts(self._checks, self.alarm_manager, self._expected, self._streams, settings)
        self._untimed = Untimed()  # that the checks have not been given yet
        self._latest: list[AttitudeSamples | None] = [None, None]  # what came last of both streams
        self._positions = NO_POSITIONS  # that nobody was shown yet

    def take(
        self, batch: VehicleBatch, frame_indices: Int64s, link: LinkClock, said: Sequence[OfOthers] = ()
    ) -> Iterator[Notice]:
        """Judge what a batch brought in the frames `frame_indices`; yield what happened, each with its frame.

        `said`: what others asked of this vehicle, or told it, in the batch.
        """
        for name, t_rx_us in batch.counted.items():
            self._stream(name).add(t_rx_us)
        self._in_force.hear(batch, link)
        for change in batch.clock_changes:
            yield clock_notice(self.vehicle, change)
        yield from self._hear_others(batch, said)
        self._untimed.bring(batch)
        self._positions = batch.positions if self._positions is NO_POSITIONS else self._positions.then(batch.positions)
        boots = {segment.boot: segment for segment in batch.segments}
        starts = {change.boot: change for change in batch.clock_changes if change.t_boot_us < 0}
        indices = sorted(batch.boots | starts.keys())
        for index in indices:
            is_last = index == indices[-1]
            yield from self._take_boot(index, boots.get(index), batch, link, starts.get(index), is_last=is_last)
        self._positions = NO_POSITIONS if indices else self._positions[-_MOST_POSITIONS:]
        if not indices or self._untimed.has_frames:  # nothing with a time came
            yield from self.advance(link)
            yield from self._hear_more(link)
        else:
            yield from self.alarm_manager.pass_time(link)
        self._in_force.forget(int(frame_indices[-1]))

    @property
    def due_us(self) -> int:
        """The time on the link, as it is heard, from which on time alone may change something."""
        if self.alarm_manager.due_us < NEVER_US:
            return 0  # shelving ends by receive time: rare, and asked for with each batch
        return NEVER_US if self._boot is None else self._boot.liveness.due_us

    @property
    def calm_s(self) -> float:
        """As `Monitor.calm_s`; 0 as well while no attitude comes, or none that is ready."""
        boot = self._boot
        if boot is None or boot.is_starting or not any(boot.alive):
            return 0.0
        return self.alarm_manager.calm_s

    def answer(self) -> Iterator[Notice]:
        """Have the doctor answer one question."""
        for notice in self.doctor.answer():
            self._answered.append(notice)
            yield notice

    def advance(self, link: LinkClock) -> Iterator[Notice]:
        """Time passed on the link and nothing of this vehicle came."""
        if self._boot is not None:
            yield from self._pass_silence(self._boot, link)
        yield from self.alarm_manager.pass_time(link)

    def _pass_silence(self, boot: Boot, link: LinkClock, until_frame_index: int | None = None) -> Iterator[Notice]:
        turns = list(boot.liveness.pass_silence(link, until_frame_index))
        if turns:
            notices, signals = stream_changes(self.vehicle, boot, self._checks, turns, link)
            yield from notices
            self.alarm_manager.begin(signals, link)
            yield from self.alarm_manager.tell(link)

    def _hear_more(self, link: LinkClock, until_frame_index: int | None = None) -> Iterator[Notice]:
        """The vehicle's frames behind its last message with a time, before the one that begins another boot, if any."""
        heard = self._untimed.heard_until(until_frame_index)
        if self._boot is not None and len(heard):
            self.alarm_manager.begin((), link)
            said = self._untimed.said_until(int(heard.frame_index[-1]))
            self._stream_check.hear(heard, said, self.alarm_manager.ballot)
            yield from self.alarm_manager.tell(link)

    def entry(self, known: Known) -> schema.Vehicle:
        """The vehicle's entry in the report."""
        both_alive_us = self._both_alive_us + (self._boot.liveness.both_alive_us if self._boot else 0)
        verdicts = self._verdicts.of_checks()
        boots = [*self._boots, *([self._boot.entry()] if self._boot else [])]
        return schema.Vehicle(
            sysid=self.vehicle.sysid,
            compid=self.vehicle.compid,
            autopilot=known.autopilot,
            type=known.type,
            verdict=self._verdicts.of_vehicle(verdicts),
            boots=tuple(boots),
            resets=tuple(self._resets),
            streams={name: self._streams[name].entry() for name in sorted(self._streams)},
            checks=tuple(
                self._verdicts.entry(check, verdicts[check.name], known, both_alive_us) for check in self._checks
            ),
            alarms=tuple(alarm.entry() for alarm in self.alarm_manager.alarms),
        )

    def now(self, known: Known, t_rx_us: int) -> VehicleNow:
        """What is known now, at the receive time `t_rx_us` of the link."""
        boot = self._boot
        alarms, places_of = list(starmap(alarm_now, self.alarm_manager.slots_now())), self.alarm_manager.places_of
        verdicts = self._verdicts.of_checks()
        alive = boot.alive if boot else [False, False]
        heard_us = known.heard_rx_us
        return VehicleNow(
            link=self.vehicle.link,
            sysid=self.vehicle.sysid,
            compid=self.vehicle.compid,
            autopilot=known.autopilot,
            type=known.type,
            verdict=self._verdicts.of_vehicle(verdicts),
            boot=boot.index if boot else None,
            t_boot_s=boot.last_us / 1e6 if boot and boot.last_us >= 0 else None,
            age_s=(t_rx_us - heard_us) / 1e6 if heard_us >= 0 else None,
            received=known.received,
            lost=known.lost,
            attitude=attitude_now(self._latest[0], t_rx_us, alive=alive[0]),
            attitude_quaternion=attitude_now(self._latest[1], t_rx_us, alive=alive[1]),
            streams={name: count.entry() for name, count in self._streams.items()},
            message_age_s={
                name: (t_rx_us - came_us) / 1e6 if (came_us := count.latest_rx_us) >= 0 else None
                for name, count in self._streams.items()
            },
            checks=tuple(
                CheckNow(name=name, verdict=verdict, alarms=tuple([alarms[place] for place in places_of(name)]))
                for name, verdict in verdicts.items()
            ),
        )

    def _stream(self, name: str) -> StreamCount:
        count = self._streams.get(name)
        if count is None:
            count = self._streams[name] = StreamCount()
        return count

    def hear(self, said: Sequence[OfOthers]) -> Iterator[Notice]:
        """What others said, in a batch that brought nothing of this vehicle."""
        yield from self._hear_others(None, said)

    def _hear_others(self, batch: VehicleBatch | None, said: Sequence[OfOthers]) -> Iterator[Notice]:
        """Take which rates were asked for, by whom, and what slows the streams."""
        told = [] if batch is None else [say for say in batch.statements if isinstance(say, ParameterSet)]
        if said or told:
            for change in self._untimed.take(said, told):
                self._stream_check.hear_wish(change)
                yield rate_notice(self.vehicle, change)

    def _take_boot(
        self,
        index: int,
        segment: BootSegment | None,
        batch: VehicleBatch,
        link: LinkClock,
        start: ClockChange | None = None,
        *,
        is_last: bool,
    ) -> Iterator[Notice]:
        """Judge what came of one boot; `start`: it began before anything told its time; `is_last`: of the batch."""
        boot = self._boot
        if boot is None or boot.index != index:
            if start is not None:
                first = start.frame_index, start.t_boot_us, start.t_rx_us
            elif segment is not None:
                first = int(segment.frame_index[0]), int(segment.t_boot_us[0]), int(segment.t_rx_us[0])
            else:
                return  # nothing of it came yet that tells that it began
            if boot is not None:
                frame_index, _, t_rx_us = first
                yield from self._pass_silence(boot, link, frame_index)
                yield from self._hear_more(link, frame_index)
                yield from self.doctor.answer_all()
                yield from self.alarm_manager.end_boot(frame_index, boot.last_us, t_rx_us)
            boot = self._start_boot(index, first)
        if segment is None:
            segment = no_segment(index)
        else:
            boot.begin_clock(int(segment.t_boot_us[0]), int(segment.t_rx_us[0]))
            boot.last_us = max(boot.last_us, int(segment.t_boot_us.max()))
        yield from self._judge(boot, segment, batch, link, is_last=is_last)

    def _judge(
        self, boot: Boot, segment: BootSegment, batch: VehicleBatch, link: LinkClock, *, is_last: bool
    ) -> Iterator[Notice]:
        """Judge a segment, with what came behind it if it is the last of its batch."""
        sent, quaternion = segment.euler, segment.quaternion
        self._latest = [new if len(new) else old for new, old in zip((sent, quaternion), self._latest, strict=True)]
        until = int(segment.frame_index[-1]) if len(segment.frame_index) else -1
        told = self._in_force.up_to(until)
        self._expected.told(say for say in told if isinstance(say, ParameterSet | ModeSet))
        chosen = boot.inertial(batch)
        corrected = self._expected.correct(sent, quaternion, chosen)
        euler = sent if corrected.q_nb is sent.q_nb else replace(sent, q_nb=corrected.q_nb)
        self._in_force.follow(corrected)
        imu = self._in_force.imu_of(chosen)
        as_sent = None if euler is sent else sent.q_nb
        seeing = partial(boot.references.take, segment.message, euler, quaternion, imu)
        seen = begun(seeing, self._beside, len(segment.message))
        aligned = boot.aligner.pair(euler, quaternion, segment.message, as_sent, corrected.changes)
        attitudes, imu_with_attitude = seen()
        self._count(segment, aligned.period_us)
        line = timeline_of(segment, aligned, link)
        turns = list(boot.liveness.take(line, link)) if len(segment.message) else []
        heard = self._untimed.heard_until(None if is_last else until + 1)
        if is_last:
            turns += boot.liveness.pass_silence(link)
        was_starting, start_ups = boot.is_starting, boot.start_up.take(told, segment)
        notices, signals = stream_changes(self.vehicle, boot, self._checks, turns, link, start_ups)
        yield from notices

        flight = CheckBatch(
            euler=euler,
            quaternion=quaternion,
            pairs=aligned.pairs,
            steps=aligned.steps,
            attitude=attitudes,
            imu=imu,
            imu_with_attitude=imu_with_attitude,
            secondary=boot.secondary(batch),
            fixed_wing=self._in_force.fixed_wing,
            ardupilot=self._in_force.ardupilot,
            may_be_trim=self._in_force.may_be_trim,
            explained=self._in_force.explained,
            trim_open=self._in_force.trim_open,
            stream_changes=turns,
            line=line,
            heard=heard,
            said_by_others=self._untimed.said_until(int(heard.frame_index[-1])) if len(heard) else [],
            statements=told,
        )
        for reset in boot.resets.take(flight.steps):
            boot.diagnosis_cases.reset_at(reset.frame_index, reset.t1_us)
            t_rx_us = link.at(reset.frame_index)
            said = self._in_force.before(reset.frame_index, t_rx_us)
            notice = reset_notice(self.vehicle, boot.index, reset, t_rx_us, said)
            if len(self._resets) < _MOST_RESETS:
                self._resets.append(reset_entry(notice.event))
            yield notice
        self.alarm_manager.begin(signals, link)
        if was_starting or start_ups:
            self._verdicts.started_up(boot.index, boot.last_us, start_ups)
        yield from self._rating.judge(boot, flight, was_starting, start_ups, link)
        if self._untimed.has_signs and len(segment.frame_index):
            self._rate_senders(segment)
        found = self._euler_quaternion.found
        assert found is not None
        kept = None
        if len(sent) or len(quaternion) or len(aligned.pairs):
            pairs = SentPairs.of(aligned.pairs, found)
            kept = SentBatch(euler=sent, corrected=corrected, quaternion=quaternion, pairs=pairs)
        boot.diagnosis_cases.keep(kept, aligned.pairs, boot.last_us)
        told_of = [*self.alarm_manager.tell(link, lambda moment: self.doctor.ask(boot, moment, link))]
        told_of += self.doctor.ask_again(boot, link)
        yield from told_of
        answered, self._answered = self._answered, []
        if self._observer is not None:
            self._observer(
                Observation(
                    vehicle=self.vehicle,
                    type=self._in_force.type,
                    segment=segment,
                    pairs=aligned.pairs,
                    disagreement=found,
                    flight=flight,
                    corrected=corrected,
                    notices=tuple(in_order([*answered, *told_of])),
                    taken_back=tuple(self.alarm_manager.taken_back),
                    judged={check.name: check.judged for check in self._checks},
                    positions=self._positions.where(self._positions.boot == boot.index),
                )
            )

    def _rate_senders(self, segment: BootSegment) -> None:
        """Rate the signs of more than one sender up to the segment's last message, each with the next message."""
        told = self._untimed.signs_until(int(segment.frame_index[-1]))
        rows = np.searchsorted(segment.frame_index, [sign.frame_index for sign in told])
        self._stream_check.senders(told, segment.frame_index[rows], segment.t_boot_us[rows], self.alarm_manager.ballot)

    def _start_boot(self, index: int, first: tuple[int, int, int]) -> Boot:
        """Begin a boot with the frame and times of what shows it first."""
        before = self._boot
        boot = Boot(index, *first, self._in_force.at_boot, self._settings)
        if before is not None:
            self._boots.append(before.entry())
            self._both_alive_us += before.liveness.both_alive_us
            boot.no_compare_told = before.no_compare_told
            self._verdicts.left_pending |= self.alarm_manager.pending(self._euler_quaternion.name)
        self._boot = boot
        self.alarm_manager.start_boot(boot.index)
        self._expected.start_boot()
        for check in self._checks:
            check.start_boot()
        for name in self._streams.keys() & set(STREAMS):  # all others are followed on receive time
            self._streams[name].start_boot()
        return boot

    def _count(self, segment: BootSegment, period_us: Int64s) -> None:
        for index, samples in enumerate((segment.euler, segment.quaternion)):
            if len(samples):
                count = self._stream(samples.source)
                count.add_stream(
                    index,
                    segment.message,
                    segment.t_boot_us,
                    segment.t_rx_us,
                    segment.lost,
                    period_us,
                    samples.valid,
                )
