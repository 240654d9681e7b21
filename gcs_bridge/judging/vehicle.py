"""Judges one vehicle: its samples become pairs, every check is given both, and what they rate goes to the alarms.

Knows neither the link nor other vehicles.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from gcs_bridge.alarms.manager import AlarmManager, AlarmTransition, SignalAt
from gcs_bridge.alarms.state import Signal
from gcs_bridge.checks import all_checks
from gcs_bridge.checks.base import Check
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.checks.stream import StreamCheck
from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.contract import ExplainedBy, Severity, known
from gcs_bridge.events import (
    ClockStep,
    CompareResumed,
    EstimatorReset,
    Inop,
    NoCompare,
    Notice,
    Rank,
    Reboot,
    StreamResumed,
    StreamStale,
    StreamStarted,
    head,
    in_order,
)
from gcs_bridge.expected import Corrected, Expected
from gcs_bridge.judging.boot import Boot
from gcs_bridge.judging.diagnosis_cases import SentBatch
from gcs_bridge.judging.estimator_resets import Reset, Statements
from gcs_bridge.judging.observation import Observation, Observer
from gcs_bridge.mavlink.requests import request_command
from gcs_bridge.pairing.references import VehicleImu
from gcs_bridge.report import schema
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.batches import BootSegment, ClockNotice, VehicleBatch, no_segment
from gcs_bridge.telemetry.component import VehicleReader
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import LinkClock
from gcs_bridge.telemetry.samples import ATTITUDE, ATTITUDE_QUATERNION, Ahrs2Samples
from gcs_bridge.telemetry.statements import ModeSet, ParameterSet, Statement, StepSignal
from gcs_bridge.telemetry.stillness import Stillness
from gcs_bridge.telemetry.stream_counts import StreamCount
from gcs_bridge.telemetry.stream_liveness import OTHER, StreamChange, Timeline

STREAMS = (ATTITUDE, ATTITUDE_QUATERNION)
US_PER_S = 1e6
_FIXED_WING = ("fixed_wing",)  # MAV_TYPE; what hovers too is told by its VTOL types
_TRIMS = ("AHRS_TRIM_X", "AHRS_TRIM_Y")
_SEVERITIES: tuple[Severity, ...] = ("alarm", "warning")  # worst first
_STREAM_EVENTS = {"started": StreamStarted, "stale": StreamStale, "resumed": StreamResumed}
_MOST_NEWS = 10_000  # statements that can wait for a message with a time


class VehicleJudge:
    """Judges one vehicle, batch by batch."""

    def __init__(self, vehicle: VehicleId, settings: Settings, observer: Observer | None = None) -> None:
        """Start with nothing judged; `observer` is shown what is judged."""
        self.vehicle = vehicle
        self._observer = observer
        self._settings = settings
        self._boots: list[schema.Boot] = []
        self._boot: Boot | None = None
        self._both_alive_us = 0
        self._left_pending = False  # a boot ended before its alarm's on-delay did
        self._checks = all_checks(settings)
        self._euler_quaternion = next(check for check in self._checks if isinstance(check, EulerQuaternion))
        self._stream_check = next(check for check in self._checks if isinstance(check, StreamCheck))
        self.alarm_manager = AlarmManager(
            vehicle, (spec for check in self._checks for spec in check.alarm_specs), settings.alarm
        )
        self._expected = Expected()
        self._news: list[Statement] = []  # that came behind the last message with a time
        self._trims_told: list[ParameterSet] = []  # that are not among the trims yet
        self._statements = Statements()
        self._stillness = Stillness(settings.gravity)
        self._trims = {name: StepSignal(0.0) for name in _TRIMS}
        self._trim_b_rad = np.zeros(3)  # as it was undone last
        self._fixed_wing, self._ardupilot = StepSignal(), StepSignal()
        self._streams: dict[str, StreamCount] = {}
        self._heard = StepSignal()  # when any frame of the vehicle came, receive time, µs

    def take(self, batch: VehicleBatch, frame_indices: Int64s, link: LinkClock) -> Iterator[Notice]:
        """Judge what a batch brought in the frames `frame_indices`; yield what happened, each with its frame."""
        self._heard.put(batch.heard, link.latest_rx_us[batch.heard - link.frame_index[0]].astype(np.float64))
        for name, t_rx_us in batch.counted.items():
            self._stream(name).add(t_rx_us)
        self._hear(batch, link)
        for notice in batch.clock_changes:
            yield self._clock_notice(notice)
        boots = {segment.boot: segment for segment in batch.segments}
        more = [*(inertial.boot for inertial in batch.imu.values()), batch.secondary.boot]
        for index in sorted(boots.keys() | set(np.unique(np.concatenate(more)).tolist())):
            yield from self._take_boot(index, boots.get(index), batch, link)
        yield from self.advance(link)
        last = int(frame_indices[-1])
        self._stillness.forget(last)
        for latest in (self._heard, self._fixed_wing, self._ardupilot, *self._trims.values()):
            latest.forget(last)

    def advance(self, link: LinkClock) -> Iterator[Notice]:
        """Time passed on the link and nothing of this vehicle came."""
        if self._boot is not None:
            yield from self._pass_silence(self._boot, link)
        yield from self.alarm_manager.pass_time(link)

    def _pass_silence(self, boot: Boot, link: LinkClock, until_frame_index: int | None = None) -> Iterator[Notice]:
        turns = self._heard_on(list(boot.liveness.pass_silence(link, until_frame_index)), link)
        if turns:
            notices, signals = self._turns(boot, turns, link)
            yield from notices
            yield from self.alarm_manager.feed(self._stream_check.silent(turns), signals, link)

    def _heard_on(self, turns: list[StreamChange], link: LinkClock) -> list[StreamChange]:
        """The same without silences of streams in which the whole vehicle was silent."""
        if all(turn.what != "silent" for turn in turns):
            return turns
        limit_us = self._settings.stream.stale_after_s * 1e6
        heard_us = self._heard.at(np.array([turn.frame_index for turn in turns]))
        return [
            turn
            for turn, last_us in zip(turns, heard_us.tolist(), strict=True)
            if turn.what != "silent" or link.at(turn.frame_index) - last_us <= limit_us
        ]

    def entry(self, reader: VehicleReader) -> schema.Vehicle:
        """The vehicle's entry in the report."""
        checks = [self._check_entry(check, reader.autopilot) for check in self._checks]
        boots = [*self._boots, *([self._boot.entry()] if self._boot else [])]
        return schema.Vehicle(
            sysid=self.vehicle.sysid,
            compid=self.vehicle.compid,
            autopilot=reader.autopilot,
            type=reader.type,
            verdict=self._verdict(checks),
            boots=tuple(boots),
            streams={name: self._streams[name].entry() for name in sorted(self._streams)},
            checks=tuple(checks),
            alarms=tuple(alarm.entry() for alarm in self.alarm_manager.alarms),
        )

    def _verdict(self, entries: Iterable[schema.Check]) -> schema.Verdict:
        severities = {alarm.severity for alarm in self.alarm_manager.alarms}
        for severity in _SEVERITIES:
            if severity in severities:
                return severity
        judged = any(
            check.compares and entry.verdict in ("agree", "explained")
            for check, entry in zip(self._checks, entries, strict=True)
        )
        return "agree" if judged and self._undecided() is None else "no_compare"

    def _stream(self, name: str) -> StreamCount:
        return self._streams.setdefault(name, StreamCount())

    def _hear(self, batch: VehicleBatch, link: LinkClock) -> None:
        """Take what the vehicle said of itself."""
        self._statements.take(batch.statements, link)
        self._news = [*self._news, *batch.statements][-_MOST_NEWS:]
        self._trims_told += [say for say in batch.statements if isinstance(say, ParameterSet) and say.name in _TRIMS]
        self._stillness.told(batch.statements, batch.motion)
        for say in batch.statements:
            if isinstance(say, ModeSet):
                self._fixed_wing.put(np.array([say.frame_index]), np.array([float(say.type in _FIXED_WING)]))
                self._ardupilot.put(np.array([say.frame_index]), np.array([float(say.autopilot == "ardupilot")]))

    def _take_boot(
        self, index: int, segment: BootSegment | None, batch: VehicleBatch, link: LinkClock
    ) -> Iterator[Notice]:
        """Judge what came of one boot."""
        boot = self._boot
        if boot is None or boot.index != index:
            if segment is None:
                return  # nothing with a time came of it yet
            if boot is not None:
                frame_index, t_rx_us = int(segment.frame_index[0]), int(segment.t_rx_us[0])
                yield from self._pass_silence(boot, link, frame_index)
                yield from self.alarm_manager.end_boot(frame_index, boot.last_us, t_rx_us)
            boot = self._start_boot(segment)
        if segment is None:
            segment = no_segment(index)
        else:
            boot.last_us = max(boot.last_us, int(segment.t_boot_us.max()))
        yield from self._judge(boot, segment, batch, link)

    def _judge(self, boot: Boot, segment: BootSegment, batch: VehicleBatch, link: LinkClock) -> Iterator[Notice]:
        sent, quaternion = segment.euler, segment.quaternion
        until = int(segment.frame_index[-1]) if len(segment.frame_index) else -1
        told = [say for say in self._news if say.frame_index <= until]
        self._news = [say for say in self._news if say.frame_index > until]
        self._expected.told(say for say in told if isinstance(say, ParameterSet | ModeSet))
        corrected = self._expected.correct(sent, quaternion)
        euler = sent if corrected.q_nb is sent.q_nb else replace(sent, q_nb=corrected.q_nb)
        self._follow_trims(corrected)
        paired = np.flatnonzero(segment.valid_attitude)
        valid = (euler[euler.valid], quaternion[quaternion.valid])
        by_stream = np.argsort(segment.message[paired], kind="stable")
        order = np.argsort(by_stream, kind="stable")  # the inverse: from one stream behind the other to arrival
        as_sent = None if euler is sent else sent.q_nb[sent.valid]
        aligned = boot.aligner.pair(*valid, order, as_sent)

        periods = np.full((2, len(segment.message)), -1)
        periods[0, paired], periods[1, paired] = aligned.period_us, aligned.rx_period_us
        self._count(segment, periods[0])
        line = Timeline(
            frame_index=segment.frame_index,
            stream=np.minimum(segment.message, OTHER),
            t_boot_us=segment.t_boot_us,
            t_rx_us=link.latest_rx_us[segment.frame_index - link.frame_index[0]],
            period_us=periods[0],
            rx_period_us=periods[1],
            lost=segment.lost,
            received=segment.received,
        )
        turns = self._heard_on(list(boot.liveness.take(line, link)) if len(segment.message) else [], link)
        notices, signals = self._turns(boot, turns, link)
        yield from notices

        imu = self._imu_of(boot, batch)
        attitudes = boot.attitude.take(euler, quaternion)
        flight = CheckBatch(
            euler=euler,
            quaternion=quaternion,
            pairs=aligned.pairs,
            steps=aligned.steps,
            attitude=attitudes,
            imu=imu,
            imu_with_attitude=boot.imu_lookup.feed(attitudes, imu),
            secondary=_of_boot(batch.secondary, boot),
            fixed_wing=self._fixed_wing,
            ardupilot=self._ardupilot,
            stream_changes=turns,
            line=line,
            statements=told,
        )
        for reset in boot.resets.take(flight.steps):
            boot.diagnosis_cases.reset_at(reset.frame_index, reset.t1_us)
            yield self._reset_notice(boot, reset, link)
        ratings = [found for check in self._checks for found in check.judge(flight)]
        notices, broken = self._breaks(boot, link)
        yield from notices
        found = self._euler_quaternion.found
        assert found is not None
        boot.diagnosis_cases.keep(
            SentBatch(
                euler=sent,
                corrected=corrected,
                quaternion=quaternion,
                pairs=aligned.pairs,
                angle_rad=found.angle,
                bad=found.judged & (found.angle > found.limit),
            )
        )
        told_of = [
            *self.alarm_manager.feed(ratings, [*signals, *broken], link, lambda moment: self._ask(boot, moment, link))
        ]
        for name in list(boot.asked):
            for frame_index, t_boot_us in boot.diagnosis_cases.due(name):
                told_of += self._answer(boot, name, frame_index, t_boot_us, link)
        yield from told_of
        if self._observer is not None:
            self._observer(
                Observation(
                    vehicle=self.vehicle,
                    segment=segment,
                    pairs=aligned.pairs,
                    disagreement=found,
                    flight=flight,
                    corrected=corrected,
                    notices=tuple(in_order(told_of)),
                )
            )

    def _ask(self, boot: Boot, moment: AlarmTransition, link: LinkClock) -> Iterator[Notice]:
        """Ask the doctor about an alarm that is raised, or goes."""
        if not moment.spec.asks_doctor:
            return
        name = moment.record.id
        if moment.what == "raised":
            onset_us = moment.onset_us - round(moment.spec.onset_lead_s * 1e6)
            boot.asked[name] = moment.record
            boot.diagnosis_cases.open(name, onset_us, moment.t_boot_us)
            yield from self._answer(boot, name, moment.frame_index, moment.t_boot_us, link)
        elif name in boot.asked:
            for frame_index, t_boot_us in boot.diagnosis_cases.due(name, moment.frame_index):
                yield from self._answer(boot, name, frame_index, t_boot_us, link)
            if moment.what == "goes":
                boot.diagnosis_cases.close(name)
                del boot.asked[name]

    def _answer(self, boot: Boot, name: str, frame_index: int, t_boot_us: int, link: LinkClock) -> Iterator[Notice]:
        record = boot.asked[name]
        answer = boot.diagnosis_cases.ask(name, frame_index, t_boot_us, of_norm=record.check == "quaternion_norm")
        if answer.entry is not None and answer.entry != record.diagnosis:
            yield from self.alarm_manager.diagnosis(record, answer.entry, frame_index, t_boot_us, link.at(frame_index))

    def _imu_of(self, boot: Boot, batch: VehicleBatch) -> VehicleImu | None:
        """The samples, within the boot, of the one sensor that is judged by."""
        own = {}
        for name, samples in batch.imu.items():
            mine = (samples.boot == boot.index) & (samples.t_boot_us >= 0) & (samples.frame_index >= boot.frame_index)
            if mine.any():
                own[name] = samples.where(mine)
        chosen = boot.imu.take(own)
        if chosen is None:
            return None
        may_rest, stands = self._stillness.at(chosen.frame_index)
        trim_b_rad = self._trim_at(chosen.frame_index)
        return VehicleImu(**vars(chosen), may_rest=may_rest, stands=stands, trim_b_rad=trim_b_rad)

    def _trim_at(self, frame_indices: Int64s) -> Floats:
        """The turn (n, 3) from the body's axes to the sensor's, by the trims told."""
        return np.column_stack(
            [*(trim.at(frame_indices) for trim in self._trims.values()), np.zeros(len(frame_indices))]
        )

    def _follow_trims(self, corrected: Corrected) -> None:
        """AHRS_TRIM as it is told, and as it shows in ATTITUDE where it is not."""
        undone = np.vstack((self._trim_b_rad, corrected.trim_b_rad))
        changes = np.flatnonzero((np.diff(undone, axis=0) != 0).any(axis=1))
        self._trim_b_rad = undone[-1]
        news = [(say.frame_index, say.name, say.value) for say in self._trims_told]
        self._trims_told.clear()
        for row in changes.tolist():
            news += [
                (int(corrected.frame_index[row]), name, value)
                for name, value in zip(_TRIMS, undone[row + 1], strict=False)
            ]
        for frame_index, name, value in sorted(news):
            self._trims[name].put(np.array([frame_index]), np.array([value]))

    def _start_boot(self, segment: BootSegment) -> Boot:
        before = self._boot
        first = (int(segment.frame_index[0]), int(segment.t_boot_us[0]), int(segment.t_rx_us[0]))
        boot = Boot(segment.boot, *first, self._settings)
        if before is not None:
            self._boots.append(before.entry())
            self._both_alive_us += before.liveness.both_alive_us
            boot.no_compare_told = before.no_compare_told
            self._left_pending |= self.alarm_manager.pending(self._euler_quaternion.name)
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
                mine = segment.message == index
                steps = count.add(samples.t_boot_us)
                count.add_losses(steps, period_us[mine], segment.lost[mine])
                count.invalid += int((~samples.valid).sum())

    def _clock_notice(self, notice: ClockNotice) -> Notice:
        change = notice.change
        boot = change.boot
        kind = Reboot if change.kind == "reboot" else ClockStep
        where = head(self.vehicle, boot, change.t_boot_us, notice.t_rx_us)
        return Notice(notice.frame_index, kind(**where, step_s=change.step_us / US_PER_S), Rank.CLOCK)

    def _reset_notice(self, boot: Boot, reset: Reset, link: LinkClock) -> Notice:
        t_rx_us = link.at(reset.frame_index)
        event = EstimatorReset(
            **head(self.vehicle, boot.index, reset.t1_us, t_rx_us),
            tilt=math.degrees(reset.tilt_rad),
            heading=known(math.degrees(reset.heading_rad)),
            explained_by=tuple(self._statements.before(reset.frame_index, t_rx_us)),
        )
        return Notice(reset.frame_index, event)

    def _turns(self, boot: Boot, turns: Iterable[StreamChange], link: LinkClock) -> tuple[list[Notice], list[SignalAt]]:
        """What the streams did, which comparisons that ends or brings back, and what the alarms are to know of it."""
        notices, signals = [], []
        name = self._euler_quaternion.name
        for turn in turns:
            t_rx_us = link.at(turn.frame_index)
            where = (self.vehicle, boot.index, turn.t_boot_us, t_rx_us - turn.ago_us if t_rx_us >= 0 else t_rx_us)
            stream = STREAMS[turn.stream]
            had = {check.name for check in self._checks if boot.has_sources(check)}
            if turn.what == "silent":
                continue  # it was told as stale
            if turn.what != "missing":
                boot.alive[turn.stream] = turn.what != "stale"
                notices.append(Notice(turn.frame_index, _STREAM_EVENTS[turn.what](**head(*where), stream=stream)))
            for check in self._checks:
                has = boot.has_sources(check)
                if has != (check.name in had) or (turn.what == "missing" and not has):
                    signal = Signal.FOUND if has else Signal.LOST
                    signals.append(SignalAt(frame_index=turn.frame_index, check=check.name, signal=signal))
            if turn.what in ("missing", "stale") and not boot.no_compare_told:
                boot.no_compare_told = True
                silent = "was never received" if turn.what == "missing" else "is silent"
                event = NoCompare(**head(*where, check=name), reason=f"{stream} {silent}")
                notices.append(Notice(turn.frame_index, event))
            elif boot.no_compare_told and all(boot.alive):
                boot.no_compare_told = False
                notices.append(Notice(turn.frame_index, CompareResumed(**head(*where, check=name))))
        return notices, signals

    def _breaks(self, boot: Boot, link: LinkClock) -> tuple[list[Notice], list[SignalAt]]:
        """Comparisons that became unable to run, or able again."""
        notices, signals = [], []
        for check in self._checks:
            for one in check.breaks():
                where = head(self.vehicle, boot.index, one.t_boot_us, link.at(one.frame_index), check.name)
                told = Inop(**where, reason=check.broken) if one.broken else CompareResumed(**where)
                notices.append(Notice(one.frame_index, told))
                signal = Signal.BROKEN if one.broken else Signal.FOUND
                signals.append(SignalAt(frame_index=one.frame_index, check=check.name, signal=signal))
        return notices, signals

    def _check_entry(self, check: Check, autopilot: str) -> schema.Check:
        """The report's entry of one check, with its verdict and the reason for it."""
        numbers = check.numbers()
        explained_by: list[ExplainedBy] = []
        if check is self._euler_quaternion:
            both_us = self._both_alive_us + (self._boot.liveness.both_alive_us if self._boot else 0)
            numbers["coverage"] = min(check.judged_us / both_us, 1.0) if both_us > 0 else None
            explained_by = self._expected.explanations()
        verdict, reason = self._judged(check, autopilot, explained=bool(explained_by))
        remark = check.remark if verdict in ("agree", "explained", "no_compare") else None
        return schema.Check(
            name=check.name,
            verdict=verdict,
            reason=f"{reason}; {remark}" if remark else reason,
            unit=check.unit,
            **numbers,
            lag_ms=known(self._euler_quaternion.lag_ms) if check is self._euler_quaternion else None,
            explained_by=tuple(explained_by),
        )

    def _judged(self, check: Check, autopilot: str, *, explained: bool) -> tuple[schema.CheckVerdict, str]:
        """Verdict of one check, and the reason for it."""
        alarms = [alarm for alarm in self.alarm_manager.alarms if alarm.check == check.name]
        for severity in _SEVERITIES:
            found = [alarm for alarm in alarms if alarm.severity == severity]
            if found:
                worst = max(found, key=lambda alarm: alarm.peak)
                count = f"1 {severity}" if len(found) == 1 else f"{len(found)} {severity}s"
                return severity, f"{count}: {worst.what}, up to {worst.peak:.3g} {worst.unit}".replace(" deg", "°")
        if check.broken is not None:
            return "inop", check.broken
        if check is self._euler_quaternion:
            if check.judged < self._settings.alarm.counted_samples:
                return "no_compare", self._why_not_compared(autopilot)
            undecided = self._undecided()
            if undecided is not None:
                return "no_compare", undecided
        elif check.judged < self._settings.alarm.counted_samples or not check.tells:
            return "no_compare", check.why_not()
        if explained:
            return "explained", "the firmware sends the two forms differently on purpose, by what was undone here"
        return "agree", check.ok_text

    def _undecided(self) -> str | None:
        """What disagreement of the two forms there was that the alarm's votes and delays never came to decide on."""
        check = self._euler_quaternion
        if self.alarm_manager.pending(check.name) or self._left_pending or 2 * check.bad > check.counted:
            differs = f"{check.bad} of {check.counted} pairs differ, by up to {math.degrees(check.residual.max):.3g}°"
            return f"{differs}, but for too short a time or too seldom to raise an alarm"
        return None

    def _why_not_compared(self, autopilot: str) -> str:
        missing = [name for name in STREAMS if name not in self._streams]
        if len(missing) == len(STREAMS):
            return "neither ATTITUDE nor ATTITUDE_QUATERNION was received"
        if missing:
            return f"{missing[0]} was never received: {how_to_get(missing[0], autopilot)}"
        usable = min(self._streams[name].count - self._streams[name].invalid for name in STREAMS)
        if usable < self._settings.alarm.counted_samples:
            rarest = min(STREAMS, key=lambda name: self._streams[name].count - self._streams[name].invalid)
            return f"only {usable} usable samples of {rarest}: {how_to_get(rarest, autopilot)}"
        return (
            f"only {self._euler_quaternion.judged} pairs could be judged: the two streams never came at one instant, "
            f"nor with gaps below {self._settings.alignment.max_gap_s:g} s and body rates to interpolate with"
        )


def _of_boot(secondary: Ahrs2Samples, boot: Boot) -> Ahrs2Samples:
    """What came of the second estimate within the boot."""
    return secondary.where((secondary.boot == boot.index) & (secondary.frame_index >= boot.frame_index))


def how_to_get(message: str, autopilot: str) -> str:
    """What to do about a message that does not come."""
    where, command = request_command(message, autopilot)
    return f"ask for it, in {where}: {command}"
