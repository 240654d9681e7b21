"""From a link's frames to one vehicle's samples: its clock, its identity, its streams; nothing is judged here.

A vehicle is a (system, component) that an autopilot's heartbeat or a plausible run of attitudes names. Ground stations,
radios, gimbals and companions tell by their heartbeat that they are none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
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
        rows_of = [self._rows(frames, name) for name in TIMED]
        records_of = [
            decode(buffer, frames[rows], self._dialect[name]) for rows, name in zip(rows_of, TIMED, strict=True)
        ]
        rows = np.concatenate(rows_of)
        order = np.argsort(rows)
        rows = rows[order]
        message = np.repeat(np.arange(len(TIMED)), [len(of) for of in rows_of])[order]
        record = np.concatenate([np.arange(len(of)) for of in rows_of])[order]
        time_boot_ms = np.concatenate([records["time_boot_ms"] for records in records_of])[order]
        t_rx_us = frames["t_rx_us"][rows]
        times = self.clock.read(time_boot_ms, t_rx_us)
        changes = [
            ClockNotice(change, int(ordinals[rows[change.place]]), int(t_rx_us[change.place]))
            for change in times.changes
        ]

        segments = []
        usable = times.believed & in_window[rows]
        for boot in range(int(times.boot[0]), int(times.boot[-1]) + 1) if len(rows) else ():
            picked = np.flatnonzero(usable & (times.boot == boot))
            if not len(picked):
                continue
            samples = []
            for index, make in enumerate((attitude_samples, attitude_quaternion_samples)):
                mine = picked[message[picked] == index]
                samples.append(
                    make(records_of[index][record[mine]], times.boot[mine], times.t_boot_us[mine], t_rx_us[mine])
                )
            segment = Segment(
                boot,
                message[picked],
                times.t_boot_us[picked],
                t_rx_us[picked],
                ordinals[rows[picked]],
                frames["lost"][rows[picked]],
                *samples,
            )
            segments.append(segment)
        self._identify(buffer, frames, ordinals, segments)

        counted = {name: frames["t_rx_us"][of] for name in COUNTED if len(of := self._rows(frames, name, in_window))}
        imu = {}
        if self._with_imu:
            believed = np.flatnonzero(times.believed)
            for name in IMU_MESSAGES:
                of = self._rows(frames, name, in_window)
                if len(of):
                    nearest = np.searchsorted(rows[believed], of) - 1
                    boots = np.concatenate((times.boot[believed], [self._latest[0]]))[nearest]
                    latest_us = np.concatenate((times.t_boot_us[believed], [self._latest[1]]))[nearest]
                    imu[name] = self._read_imu(name, buffer, frames[of], boots, latest_us)
            if len(believed):
                self._latest = (int(times.boot[believed[-1]]), int(times.t_boot_us[believed[-1]]))
        return VehicleBatch(segments, changes, counted, imu)

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
        if not self._standing:
            signs += [sign for segment in segments for sign in _attitude_signs(segment)]
        for ordinal, t_rx_us, sign in sorted(signs, key=lambda sign: sign[0]):
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


def _attitude_signs(segment: Segment) -> Iterator[tuple[int, int, bool]]:
    """Ordinal, receive time and validity of each attitude of a segment."""
    valid = segment.valid_attitude
    for row in np.flatnonzero(segment.attitude).tolist():
        yield int(segment.ordinal[row]), int(segment.t_rx_us[row]), bool(valid[row])
