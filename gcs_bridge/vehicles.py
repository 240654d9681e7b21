"""From a link's frames to one vehicle's samples: its clock, its identity, its streams; nothing is judged here.

A vehicle is a (system, component) that an autopilot's heartbeat or a plausible run of attitudes names. Ground stations,
radios, gimbals and companions tell by their heartbeat that they are none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import merge
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.clocks import BootClock, ClockChange
from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.samples import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    IMU_MESSAGES,
    AttitudeSamples,
    ImuSamples,
    Records,
    attitude_quaternion_samples,
    attitude_samples,
    clock_us,
    imu_samples,
)
from gcs_bridge.settings import VehicleSettings

Int64s = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

# Messages whose time_boot_ms keeps the clock; the first two are the streams that are compared.
TIMED = (ATTITUDE, ATTITUDE_QUATERNION, "SYSTEM_TIME", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")
COUNTED = (*IMU_MESSAGES, "AHRS2")  # of the others, the ones whose coming is reported

_AUTOPILOT_INVALID = 8  # MAV_AUTOPILOT_INVALID: not a flight controller
_TYPE_GCS = 6  # MAV_TYPE_GCS
_AUTOPILOTS = {3: "ardupilot"}  # MAV_AUTOPILOT_ARDUPILOTMEGA, as everybody calls it; others by MAVLink's own name


@dataclass(frozen=True)
class Segment:
    """What one batch brought of one vehicle within one boot.

    n messages with a believed boot time, in order of arrival: `message` (n,) index into TIMED, `t_boot_us`, `t_rx_us`,
    `ordinal` (n,) of the frame in its link, `lost` (n,) frames of the vehicle that were missing so far. Of them the
    attitudes are `euler` and `quaternion`, samples in the same order.
    """

    boot: int
    message: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    ordinal: Int64s
    lost: Int64s
    euler: AttitudeSamples
    quaternion: AttitudeSamples

    @property
    def attitude(self) -> Mask:
        """Which messages (n,) are attitudes of the two streams."""
        return self.message < 2

    @property
    def valid_attitude(self) -> Mask:
        """Which messages (n,) are valid attitudes."""
        valid = np.zeros(len(self.message), np.bool_)
        valid[self.message == 0], valid[self.message == 1] = self.euler.valid, self.quaternion.valid
        return valid


class ClockNotice(NamedTuple):
    """A clock's change and the frame that showed it."""

    change: ClockChange
    ordinal: int
    t_rx_us: int


@dataclass(frozen=True)
class VehicleBatch:
    """What one batch brought of one vehicle: its boots in turn, clock changes, and messages that are only counted."""

    segments: list[Segment]
    clock_changes: list[ClockNotice]
    counted: dict[str, Int64s]  # receive times, µs
    imu: dict[str, ImuSamples]


class _Timed(NamedTuple):
    """Messages with a boot time, n of any name in order of arrival; `record` (n,) is each one's row in `records`."""

    message: Int64s  # index into TIMED
    record: Int64s
    time_boot_ms: npt.NDArray[np.uint32]
    t_rx_us: Int64s
    ordinal: Int64s
    lost: Int64s
    in_window: Mask
    records: list[Records]  # one array a name in TIMED

    def last(self) -> _Timed:
        """The last message alone."""
        kind, row = int(self.message[-1]), int(self.record[-1])
        return _Timed(
            self.message[-1:],
            np.zeros(1, np.int64),
            self.time_boot_ms[-1:],
            self.t_rx_us[-1:],
            self.ordinal[-1:],
            self.lost[-1:],
            self.in_window[-1:],
            [of[row : row + 1] if name == kind else of[:0] for name, of in enumerate(self.records)],
        )

    def followed_by(self, then: _Timed) -> _Timed:
        """These messages, and `then` those."""
        before = np.array([len(of) for of in self.records])
        return _Timed(
            np.concatenate((self.message, then.message)),
            np.concatenate((self.record, then.record + before[then.message])),
            np.concatenate((self.time_boot_ms, then.time_boot_ms)),
            np.concatenate((self.t_rx_us, then.t_rx_us)),
            np.concatenate((self.ordinal, then.ordinal)),
            np.concatenate((self.lost, then.lost)),
            np.concatenate((self.in_window, then.in_window)),
            [np.concatenate(both) for both in zip(self.records, then.records, strict=True)],
        )


class VehicleReader:
    """Reads one (system, component) of a link."""

    def __init__(
        self, sysid: int, compid: int, dialect: Dialect, settings: VehicleSettings, *, with_imu: bool = False
    ) -> None:
        """Start with nothing heard; inertial samples are made only `with_imu`."""
        self.key = (sysid, compid)
        self.autopilot = "unknown"
        self.type = "unknown"
        self.clock = BootClock()
        self._dialect = dialect
        self._settings = settings
        self._with_imu = with_imu
        self._seen: tuple[int, int] | None = None
        self._standing: list[tuple[int, bool]] = []  # from which frame on it is a vehicle, or is none
        self._is_autopilot = False
        self._run = 0
        self._held: _Timed | None = None  # the message that the clock doubts
        self._latest = (0, -1)  # boot and boot time last believed
        self._imu_offset_us: dict[tuple[str, int], int] = {}

    @property
    def is_vehicle(self) -> bool:
        """Whether it is known to be a vehicle by now."""
        return bool(self._standing) and self._standing[-1][1]

    def is_vehicle_at(self, ordinal: int) -> bool:
        """Whether it was known to be a vehicle once the frame `ordinal` had come."""
        known = [is_one for since, is_one in self._standing if since <= ordinal]
        return bool(known) and known[-1]

    @property
    def seen(self) -> tuple[int, int] | None:
        """Ordinal and receive time of the frame that first made it a vehicle."""
        return self._seen

    def read(self, buffer: Bytes, frames: Frames, ordinals: Int64s, in_window: Mask) -> VehicleBatch:
        """Take this component's next frames, in order of arrival, without duplicates.

        Samples outside the window are left out; the clock and the identity are followed there too.
        """
        timed = self._read_timed(buffer, frames, ordinals, in_window)
        times = self.clock.read(timed.time_boot_ms, timed.t_rx_us)
        changes = [
            ClockNotice(change, int(timed.ordinal[change.place]), int(timed.t_rx_us[change.place]))
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
            timed.ordinal[at] = timed.ordinal[at + 1]  # it counts from when it was believed
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
                samples.append(make(records, boot[mine], t_boot_us[mine], timed.t_rx_us[mine]))
            columns = (timed.t_rx_us[picked], timed.ordinal[picked], timed.lost[picked])
            segments.append(Segment(index, timed.message[picked], t_boot_us[picked], *columns, *samples))
        self._identify(buffer, frames, ordinals, segments)

        counted = {name: frames["t_rx_us"][of] for name in COUNTED if len(of := self._rows(frames, name, in_window))}
        imu = {}
        if self._with_imu:
            for name in IMU_MESSAGES:
                of = self._rows(frames, name, in_window)
                if len(of):
                    nearest = np.searchsorted(timed.ordinal[believed], ordinals[of]) - 1
                    boots = np.concatenate((boot[believed], [self._latest[0]]))[nearest]
                    latest_us = np.concatenate((t_boot_us[believed], [self._latest[1]]))[nearest]
                    imu[name] = self._read_imu(name, buffer, frames[of], boots, latest_us)
            if believed.any():
                self._latest = (int(boot[believed][-1]), int(t_boot_us[believed][-1]))
        return VehicleBatch(segments, changes, counted, imu)

    def _read_timed(self, buffer: Bytes, frames: Frames, ordinals: Int64s, in_window: Mask) -> _Timed:
        rows_of = [self._rows(frames, name) for name in TIMED]
        records = [
            decode(buffer, np.take(frames, rows), self._dialect[name])
            for rows, name in zip(rows_of, TIMED, strict=True)
        ]
        rows = np.concatenate(rows_of)
        order = np.argsort(rows)
        rows = rows[order]
        return _Timed(
            np.repeat(np.arange(len(TIMED)), [len(of) for of in rows_of])[order],
            np.concatenate([np.arange(len(of)) for of in rows_of])[order],
            np.concatenate([of["time_boot_ms"] for of in records])[order],
            frames["t_rx_us"][rows],
            ordinals[rows],
            frames["lost"][rows],
            in_window[rows],
            records,
        )

    def _rows(self, frames: Frames, name: str, also: Mask | None = None) -> Int64s:
        if name not in self._dialect:
            return np.empty(0, np.int64)
        mine = frames["msgid"] == self._dialect[name].msgid
        return np.flatnonzero(mine if also is None else mine & also)

    def _identify(self, buffer: Bytes, frames: Frames, ordinals: Int64s, segments: list[Segment]) -> None:
        """Follow what the heartbeats and, without them, the attitudes say of it, in their order of arrival."""
        if self._is_autopilot or self.key[0] == 0:  # an autopilot is one for good; system 0 is nobody's
            return
        rows = self._rows(frames, "HEARTBEAT")
        beats = decode(buffer, frames[rows], self._dialect["HEARTBEAT"])
        signs: list[tuple[int, int, Any]] = [
            (int(ordinal), int(t_rx_us), beat)
            for ordinal, t_rx_us, beat in zip(ordinals[rows], frames["t_rx_us"][rows], beats, strict=True)
        ]
        for ordinal, t_rx_us, sign in merge(signs, self._attitude_signs(segments), key=lambda sign: sign[0]):
            if isinstance(sign, bool):
                self._run = self._run + 1 if sign else 0
                if self._run >= self._settings.attitude_run and not self._standing:
                    self._stand(ordinal, t_rx_us, is_one=True)
            elif int(sign["autopilot"]) == _AUTOPILOT_INVALID or int(sign["type"]) == _TYPE_GCS:
                self._stand(ordinal, t_rx_us, is_one=False)
            else:
                self._is_autopilot = True
                self.autopilot = _AUTOPILOTS.get(int(sign["autopilot"])) or self._dialect.enum_name(
                    "MAV_AUTOPILOT", int(sign["autopilot"])
                )
                self.type = self._dialect.enum_name("MAV_TYPE", int(sign["type"]))
                self._stand(ordinal, t_rx_us, is_one=True)
                return

    def _attitude_signs(self, segments: list[Segment]) -> Iterator[tuple[int, int, Any]]:
        """Ordinal, receive time and validity of each attitude, while it is not known whether this is a vehicle."""
        for segment in segments:
            valid = segment.valid_attitude
            for row in np.flatnonzero(segment.attitude).tolist():
                if self._standing:
                    return
                yield int(segment.ordinal[row]), int(segment.t_rx_us[row]), bool(valid[row])

    def _stand(self, ordinal: int, t_rx_us: int, *, is_one: bool) -> None:
        if not self._standing or self._standing[-1][1] != is_one:
            self._standing.append((ordinal, is_one))
        if is_one and self._seen is None:
            self._seen = (ordinal, t_rx_us)

    def _read_imu(self, name: str, buffer: Bytes, frames: Frames, boots: Int64s, latest_us: Int64s) -> ImuSamples:
        """IMU samples; their own clock is mapped by the running minimum of its offset to the boot time last heard.

        A message is never heard before it was stamped, so the smallest offset is the nearest to the true one. Before
        the first boot time there is no offset: the boot time is −1.
        """
        records = decode(buffer, frames, self._dialect[name])
        t_us = clock_us(records)
        t_boot_us = np.full(len(t_us), -1)
        for boot in np.unique(boots):
            mine = np.flatnonzero((boots == boot) & (latest_us >= 0))
            if len(mine):
                largest = np.iinfo(np.int64).max
                known = self._imu_offset_us.get((name, int(boot)), largest)
                offset = np.minimum.accumulate(np.concatenate(([known], t_us[mine] - latest_us[mine])))[1:]
                self._imu_offset_us[name, int(boot)] = int(offset[-1])
                t_boot_us[mine] = t_us[mine] - offset
        return imu_samples(name, records, self.autopilot, boots, t_boot_us, frames["t_rx_us"].copy())
