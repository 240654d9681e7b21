"""From a link's frames to one vehicle's samples: its clock, its identity, its streams; nothing is judged here.

A vehicle is a (system, component) that an autopilot's heartbeat or a plausible run of attitudes names. Ground stations,
radios, gimbals and companions tell by their heartbeat that they are none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from heapq import merge
from typing import Any

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, Records
from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.settings import VehicleSettings
from gcs_bridge.telemetry.batches import (
    TIMED,
    BootSegment,
    ClockNotice,
    VehicleBatch,
    VelocityChange,
)
from gcs_bridge.telemetry.clocks import BootClock, OffsetClock
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.imu_units import UnitResolver
from gcs_bridge.telemetry.samples import (
    AHRS2,
    IMU_MESSAGES,
    Ahrs2Samples,
    ImuSamples,
    Stamps,
    attitude_quaternion_samples,
    attitude_samples,
    clock_us,
    imu_samples,
    secondary_samples,
)
from gcs_bridge.telemetry.statements import FlagsSet, LandedSet, ModeSet, Statement, TextSaid, parameters, text_of

COUNTED = (*IMU_MESSAGES, AHRS2)  # of the others, the ones whose coming is reported
_AUTOPILOT_INVALID = 8  # MAV_AUTOPILOT_INVALID: not a flight controller
_TYPE_GCS = 6  # MAV_TYPE_GCS
_ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
_LANDED = {1: True, 2: False, 3: False, 4: False}  # MAV_LANDED_STATE; 0: it does not know
_FLAGS = (("EKF_STATUS_REPORT", "flags"), ("ESTIMATOR_STATUS", "flags"), ("ODOMETRY", "reset_counter"))
_AUTOPILOTS = {3: "ardupilot"}  # MAV_AUTOPILOT_ARDUPILOTMEGA, as everybody calls it; others by MAVLink's own name


@dataclass(frozen=True, kw_only=True)
class _Timed(FrameColumns):
    """Messages with a boot time, n of any name in order of arrival; `record` (n,) is each one's row in `records`."""

    message: Int64s  # index into TIMED
    record: Int64s
    time_boot_ms: npt.NDArray[np.uint32]
    t_rx_us: Int64s
    lost: Int64s
    received: Int64s
    in_window: Mask
    records: list[Records]  # one array a name in TIMED

    def last(self) -> _Timed:
        """The last message alone."""
        kind, row = int(self.message[-1]), int(self.record[-1])
        records = [of[row : row + 1] if name == kind else of[:0] for name, of in enumerate(self.records)]
        return replace(self[-1:], record=np.zeros(1, np.int64), records=records)

    def followed_by(self, then: _Timed) -> _Timed:
        """These messages, and `then` those."""
        before = np.array([len(of) for of in self.records])
        records = [np.concatenate(both) for both in zip(self.records, then.records, strict=True)]
        return replace(self.then(replace(then, record=then.record + before[then.message])), records=records)


@dataclass(frozen=True, kw_only=True)
class _Known(FrameColumns):
    """Believed times of one batch, (n,) each; the first is the last of the batch before."""

    boot: Int64s
    t_boot_us: Int64s


_MOTION_GAP_S = 2.0
_NO_ANGLES = np.dtype([("roll", "f4"), ("pitch", "f4"), ("yaw", "f4")])


class VehicleReader:
    """Reads one (system, component) of a link."""

    def __init__(self, vehicle: VehicleId, dialect: Dialect, settings: VehicleSettings) -> None:
        """Start with nothing heard."""
        self.vehicle = vehicle
        self.autopilot = "unknown"
        self.type = "unknown"
        self.clock = BootClock()
        self._dialect = dialect
        self._settings = settings
        self._seen: tuple[int, int] | None = None
        self._standing: list[tuple[int, bool]] = []  # from which frame on it is a vehicle, or is none
        self._is_autopilot = False
        self._autopilot_frame_index = 0
        self._run = 0
        self._held: _Timed | None = None  # the message that the clock doubts
        self._latest = (0, -1)  # boot and boot time last believed
        self._imu_clocks: dict[tuple[str, int], OffsetClock] = {}
        self._units = {name: UnitResolver(name) for name in IMU_MESSAGES}
        self._untimed: tuple[Records, Int64s, Int64s] | None = None  # AHRS2 that wait for the next timed message
        self._mode: tuple[int, int, int, bool] | None = None
        self._flags: dict[str, int] = {}
        self._received = 0  # frames before this batch
        self._present: frozenset[int] = frozenset()  # ids in this batch
        self._velocity: tuple[float, Floats] | None = None  # the last time, s, and velocity, m/s

    @property
    def is_vehicle(self) -> bool:
        """Whether it is known to be a vehicle by now."""
        return bool(self._standing) and self._standing[-1][1]

    @property
    def is_decided(self) -> bool:
        """Whether it is known by now that it is a vehicle, or that it is none."""
        return bool(self._standing)

    def is_vehicle_at(self, frame_index: int) -> bool:
        """Whether it was known to be a vehicle once the frame `frame_index` had come."""
        known = [is_one for since, is_one in self._standing if since <= frame_index]
        return bool(known) and known[-1]

    @property
    def seen(self) -> tuple[int, int] | None:
        """Index and receive time of the frame that first made it a vehicle."""
        return self._seen

    def read(self, buffer: Bytes, frames: Frames, frame_indices: Int64s, in_window: Mask) -> VehicleBatch:
        """Take this component's next frames, in order of arrival, without duplicates.

        Samples outside the window are left out; the clock and the identity are followed there too.
        """
        self._present = frozenset(np.unique(frames["msgid"]).tolist())
        timed = self._read_timed(buffer, frames, frame_indices, in_window)
        self._received += len(frames)
        times = self.clock.read(timed.time_boot_ms, timed.t_rx_us)
        changes = [
            ClockNotice(change, int(timed.frame_index[change.place]), int(timed.t_rx_us[change.place]))
            for change in times.changes
        ]
        boot, t_boot_us, believed = times.boot, times.t_boot_us, times.believed
        held = 0
        if self._held is not None and len(timed.message):
            held = 1
            timed = self._held.followed_by(timed)
            boot, t_boot_us = np.concatenate((boot[:1], boot)), np.concatenate((t_boot_us[:1], t_boot_us))
            believed = np.concatenate(([False], believed))
        for release in times.released:
            at = held + release.place - 1
            boot[at], t_boot_us[at], believed[at] = release.boot, release.t_boot_us, True
            timed.frame_index[at] = timed.frame_index[at + 1]  # it counts from when it was believed
        if len(timed.message):
            self._held = timed.last() if self.clock.doubts else None

        segments = []
        usable = believed & timed.in_window
        for index in np.unique(boot[usable]).tolist():
            picked = np.flatnonzero(usable & (boot == index))
            samples = []
            for kind, make in enumerate((attitude_samples, attitude_quaternion_samples)):
                mine = picked[timed.message[picked] == kind]
                records = timed.records[kind][timed.record[mine]]
                samples.append(
                    make(records, Stamps(timed.frame_index[mine], boot[mine], t_boot_us[mine], timed.t_rx_us[mine]))
                )
            segments.append(
                BootSegment(
                    boot=index,
                    message=timed.message[picked],
                    frame_index=timed.frame_index[picked],
                    t_boot_us=t_boot_us[picked],
                    t_rx_us=timed.t_rx_us[picked],
                    lost=timed.lost[picked],
                    received=timed.received[picked],
                    euler=samples[0],
                    quaternion=samples[1],
                )
            )
        self._identify(buffer, frames, frame_indices, segments)

        counted = {name: frames["t_rx_us"][of] for name in COUNTED if len(of := self._rows(frames, name, in_window))}
        known = _Known(
            frame_index=np.concatenate(([-1], timed.frame_index[believed])),
            boot=np.concatenate(([self._latest[0]], boot[believed])),
            t_boot_us=np.concatenate(([self._latest[1]], t_boot_us[believed])),
        )
        self._latest = int(known.boot[-1]), int(known.t_boot_us[-1])
        imu = {}
        for name in IMU_MESSAGES:
            of = self._rows(frames, name, in_window)
            if len(of):
                imu[name] = self._read_imu(name, buffer, frames[of], frame_indices[of], known)
        return VehicleBatch(
            heard=frame_indices[in_window],
            segments=segments,
            clock_changes=changes,
            counted=counted,
            imu=imu,
            secondary=self._read_secondary(buffer, frames, frame_indices, in_window, known),
            statements=self._read_told(buffer, frames, frame_indices),
            motion=self._read_motion(buffer, frames, frame_indices),
        )

    def _read_timed(self, buffer: Bytes, frames: Frames, frame_indices: Int64s, in_window: Mask) -> _Timed:
        rows_of = [self._rows(frames, name) for name in TIMED]
        records = [
            decode(buffer, np.take(frames, rows), self._dialect[name])
            for rows, name in zip(rows_of, TIMED, strict=True)
        ]
        rows = np.concatenate(rows_of)
        order = np.argsort(rows)
        rows = rows[order]
        return _Timed(
            message=np.repeat(np.arange(len(TIMED)), [len(of) for of in rows_of])[order],
            record=np.concatenate([np.arange(len(of)) for of in rows_of])[order],
            time_boot_ms=np.concatenate([of["time_boot_ms"] for of in records])[order],
            t_rx_us=frames["t_rx_us"][rows],
            frame_index=frame_indices[rows],
            lost=frames["lost"][rows],
            received=self._received + rows,
            in_window=in_window[rows],
            records=records,
        )

    def _rows(self, frames: Frames, name: str, also: Mask | None = None) -> Int64s:
        if name not in self._dialect or self._dialect[name].msgid not in self._present:
            return np.empty(0, np.int64)
        mine = frames["msgid"] == self._dialect[name].msgid
        return np.flatnonzero(mine if also is None else mine & also)

    def _identify(self, buffer: Bytes, frames: Frames, frame_indices: Int64s, segments: list[BootSegment]) -> None:
        """Follow what the heartbeats and, without them, the attitudes say of it, in their order of arrival."""
        if self._is_autopilot or self.vehicle.sysid == 0:  # an autopilot is one for good; system 0 is nobody's
            return
        rows = self._rows(frames, "HEARTBEAT")
        beats = decode(buffer, frames[rows], self._dialect["HEARTBEAT"])
        signs: list[tuple[int, int, Any]] = [
            (int(frame_index), int(t_rx_us), beat)
            for frame_index, t_rx_us, beat in zip(frame_indices[rows], frames["t_rx_us"][rows], beats, strict=True)
        ]
        for frame_index, t_rx_us, sign in merge(signs, self._attitude_signs(segments), key=lambda sign: sign[0]):
            if isinstance(sign, bool):
                self._run = self._run + 1 if sign else 0
                if self._run >= self._settings.attitude_run and not self._standing:
                    self._stand(frame_index, t_rx_us, is_one=True)
            elif int(sign["autopilot"]) == _AUTOPILOT_INVALID or int(sign["type"]) == _TYPE_GCS:
                self._stand(frame_index, t_rx_us, is_one=False)
            else:
                self._is_autopilot = True
                self._autopilot_frame_index = frame_index
                self.autopilot = self._autopilot_name(int(sign["autopilot"]))
                self.type = self._type_name(int(sign["type"]))
                self._stand(frame_index, t_rx_us, is_one=True)
                return

    def _attitude_signs(self, segments: list[BootSegment]) -> Iterator[tuple[int, int, Any]]:
        """Frame index, receive time and validity of each attitude, while it is not known whether this is a vehicle."""
        for segment in segments:
            valid = segment.valid_attitude
            for row in np.flatnonzero(segment.attitude).tolist():
                if self._standing:
                    return
                yield int(segment.frame_index[row]), int(segment.t_rx_us[row]), bool(valid[row])

    def _stand(self, frame_index: int, t_rx_us: int, *, is_one: bool) -> None:
        if not self._standing or self._standing[-1][1] != is_one:
            self._standing.append((frame_index, is_one))
        if is_one and self._seen is None:
            self._seen = (frame_index, t_rx_us)

    def _read_imu(self, name: str, buffer: Bytes, frames: Frames, frame_indices: Int64s, known: _Known) -> ImuSamples:
        """IMU samples on the vehicle's boot clock; −1 before its first time."""
        records = decode(buffer, frames, self._dialect[name])
        before = np.searchsorted(known.frame_index, frame_indices) - 1
        boots, t_us = known.boot[before], clock_us(records)
        if name in TIMED:
            at = np.minimum(before + 1, len(known.frame_index) - 1)
            t_boot_us = np.where(known.frame_index[at] == frame_indices, known.t_boot_us[at], -1)
        else:
            t_boot_us = np.full(len(t_us), -1)
            for boot in np.unique(boots).tolist():
                mine = np.flatnonzero((boots == boot) & (known.t_boot_us[before] >= 0))
                if len(mine):
                    clock = self._imu_clocks.setdefault((name, boot), OffsetClock())
                    t_boot_us[mine] = clock.map(t_us[mine], known.t_boot_us[before[mine]])
        since = int(np.searchsorted(frame_indices, self._autopilot_frame_index))
        units = self._units[name].resolve(records, self.autopilot, since)
        return imu_samples(name, records, units, Stamps(frame_indices, boots, t_boot_us, frames["t_rx_us"].copy()))

    def _read_secondary(
        self, buffer: Bytes, frames: Frames, frame_indices: Int64s, in_window: Mask, known: _Known
    ) -> Ahrs2Samples:
        """AHRS2, stamped midway between the timed messages on both sides; the last ones wait for the next message."""
        none = np.empty(0, np.int64)
        rows = self._rows(frames, AHRS2, in_window)
        if AHRS2 not in self._dialect:
            return secondary_samples(np.empty(0, _NO_ANGLES), Stamps(none, none, none, none), none)
        records, at, t_rx_us = (
            decode(buffer, frames[rows], self._dialect[AHRS2]),
            frame_indices[rows],
            frames["t_rx_us"][rows],
        )
        if self._untimed is not None:
            records = np.concatenate((self._untimed[0], records))
            at = np.concatenate((self._untimed[1], at))
            t_rx_us = np.concatenate((self._untimed[2], t_rx_us))
        behind = np.searchsorted(known.frame_index, at)
        timed = behind < len(known.frame_index)
        self._untimed = (records[~timed], at[~timed], t_rx_us[~timed]) if not timed.all() else None
        behind = behind[timed]
        before = behind - 1
        usable = (known.t_boot_us[before] >= 0) & (known.boot[before] == known.boot[behind])
        picked, before, behind = np.flatnonzero(timed)[usable], before[usable], behind[usable]
        t_boot_us = (known.t_boot_us[before] + known.t_boot_us[behind]) // 2
        gap_us = np.abs(known.t_boot_us[behind] - known.t_boot_us[before])
        stamps = Stamps(known.frame_index[behind], known.boot[behind], t_boot_us, t_rx_us[picked])
        return secondary_samples(records[picked], stamps, gap_us)

    def _read_told(self, buffer: Bytes, frames: Frames, frame_indices: Int64s) -> list[Statement]:
        """What the vehicle said of itself, in order of arrival."""
        told: list[Statement] = []
        for beat, frame_index in self._records("HEARTBEAT", buffer, frames, frame_indices):
            mode = int(beat["autopilot"]), int(beat["type"]), int(beat["custom_mode"]), bool(beat["base_mode"] & _ARMED)
            if mode != self._mode:
                self._mode = mode
                told.append(ModeSet(frame_index, self._autopilot_name(mode[0]), self._type_name(mode[1]), *mode[2:]))
        rows = self._rows(frames, "PARAM_VALUE")
        if len(rows):
            records = decode(buffer, frames[rows], self._dialect["PARAM_VALUE"])
            told += parameters(records, frame_indices[rows], self.autopilot)
        for state, frame_index in self._records("EXTENDED_SYS_STATE", buffer, frames, frame_indices):
            told.append(LandedSet(frame_index, _LANDED.get(int(state["landed_state"]))))
        for said, frame_index in self._records("STATUSTEXT", buffer, frames, frame_indices):
            told.append(TextSaid(frame_index, text_of(said)))
        for name, field in _FLAGS:
            rows = self._rows(frames, name)
            if len(rows):
                what = f"{name}.{field}"
                flags = decode(buffer, frames[rows], self._dialect[name])[field].astype(np.int64)
                flags = np.concatenate(([self._flags.get(what, flags[0])], flags))
                self._flags[what] = int(flags[-1])
                for at in np.flatnonzero(np.diff(flags)).tolist():
                    told.append(FlagsSet(int(frame_indices[rows[at]]), what, int(flags[at]), int(flags[at + 1])))
        return sorted(told, key=lambda statement: statement.frame_index)

    def _read_motion(self, buffer: Bytes, frames: Frames, frame_indices: Int64s) -> VelocityChange:
        """How fast the velocity changes, from one LOCAL_POSITION_NED to the next; none behind a gap of 2 s."""
        rows = self._rows(frames, "LOCAL_POSITION_NED")
        if not len(rows):
            return VelocityChange(frame_index=rows, acceleration_m_s2=np.empty(0))
        records = decode(buffer, frames[rows], self._dialect["LOCAL_POSITION_NED"])
        t_s = records["time_boot_ms"] * 1e-3
        velocity = np.stack([records[axis] for axis in ("vx", "vy", "vz")], axis=1).astype(np.float64)
        if self._velocity is None:
            self._velocity = np.nan, velocity[0]
        dt_s = np.diff(t_s, prepend=self._velocity[0])
        change = np.diff(velocity, axis=0, prepend=self._velocity[1][None])
        self._velocity = float(t_s[-1]), velocity[-1]
        usable = (dt_s > 0) & (dt_s <= _MOTION_GAP_S)
        size = np.sqrt(change[:, 0] ** 2 + change[:, 1] ** 2 + change[:, 2] ** 2)
        acceleration_m_s2 = np.where(usable, size / np.where(usable, dt_s, 1.0), np.nan)
        return VelocityChange(frame_index=frame_indices[rows], acceleration_m_s2=acceleration_m_s2)

    def _records(self, name: str, buffer: Bytes, frames: Frames, frame_indices: Int64s) -> Iterator[tuple[Any, int]]:
        """Each message of this name, and the index of its frame."""
        rows = self._rows(frames, name)
        if len(rows):
            yield from zip(decode(buffer, frames[rows], self._dialect[name]), frame_indices[rows].tolist(), strict=True)

    def _autopilot_name(self, number: int) -> str:
        return _AUTOPILOTS.get(number) or self._dialect.enum_name("MAV_AUTOPILOT", number)

    def _type_name(self, number: int) -> str:
        return self._dialect.enum_name("MAV_TYPE", number)
