"""From a link's frames to one vehicle's samples: its clock, its identity, its streams; nothing is judged here.

A vehicle is a (system, component) that an autopilot's heartbeat or a plausible run of attitudes names. Ground stations,
radios, gimbals and companions tell by their heartbeat that they are none.
"""

from __future__ import annotations

from collections.abc import Iterator
from heapq import merge

import numpy as np

from gcs_bridge.columns import Int64s
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.settings import VehicleSettings
from gcs_bridge.telemetry.attitudes import AttitudeReader
from gcs_bridge.telemetry.batches import BootSegment, VehicleBatch
from gcs_bridge.telemetry.clocks import BOOT, BootClock, TimedMessages
from gcs_bridge.telemetry.heard import heard_frames
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.inertial import ImuReader
from gcs_bridge.telemetry.messages import IMU_KINDS, KIND
from gcs_bridge.telemetry.samples import AHRS2, IMU_MESSAGES, AttitudeSamples, ImuSamples
from gcs_bridge.telemetry.secondary import Ahrs2Reader
from gcs_bridge.telemetry.sorting import Share, SortedFrames
from gcs_bridge.telemetry.statement_reader import Beat, StatementReader, autopilot_name, type_name
from gcs_bridge.telemetry.velocity import VelocityReader

_AUTOPILOT_INVALID = 8  # MAV_AUTOPILOT_INVALID: not a flight controller
_TYPE_GCS = 6  # MAV_TYPE_GCS


class VehicleReader:
    """Reads one (system, component) of a link."""

    def __init__(self, vehicle: VehicleId, dialect: Dialect, settings: VehicleSettings) -> None:
        """Start with nothing heard."""
        self.vehicle = vehicle
        self.autopilot = "unknown"
        self.type = "unknown"
        self.received = self.lost = 0  # frames that came, and that the sequence numbers miss
        self.heard_rx_us = -1  # when the last frame came
        self._dialect = dialect
        self._settings = settings
        self._seen: tuple[int, int] | None = None
        self._standing: list[tuple[int, bool]] = []  # from which frame on it is a vehicle, or is none
        self._is_autopilot = False
        self._autopilot_frame_index = 0
        self._run = 0
        self._clock = BootClock(dialect)
        self._attitudes = AttitudeReader(dialect)
        self._imu: dict[str, ImuReader] = {}
        self._secondary = Ahrs2Reader(dialect)
        self._velocity = VelocityReader(dialect)
        self._statements = StatementReader(dialect)

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
    def unbelieved(self) -> tuple[int, int]:
        """How many messages of each of the two streams carried a time that was not believed."""
        return self._clock.unbelieved

    @property
    def seen(self) -> tuple[int, int] | None:
        """Index and receive time of the frame that first made it a vehicle."""
        return self._seen

    def read(self, batch: SortedFrames, share: Share) -> VehicleBatch:
        """Take this component's share of the next frames.

        Samples outside the window are left out; the clock and the identity are followed there too.
        """
        timed, changes = self._clock.read(batch, share, self.received)
        self.received += share.end - share.start
        self.lost, self.heard_rx_us = share.lost, share.heard_us
        euler, quaternion = self._attitudes.read(batch, share, timed)
        segments = _segments(batch, timed, euler, quaternion)
        beats = self._statements.beats(batch, share)
        self._identify(beats, segments)
        imu = self._read_imu(batch, share, timed) if share.has_any(IMU_KINDS) else {}
        counted = {name: samples.t_rx_us for name, samples in imu.items()}
        if share.count(KIND[AHRS2]):
            rows = batch.rows(share, KIND[AHRS2])
            counted[AHRS2] = batch.frames["t_rx_us"][rows[batch.in_window[rows]]]
        return VehicleBatch(
            frame_index=batch.frame_indices(share),
            heard=heard_frames(batch, share, timed.restarting),
            timed=timed.columns,
            segments=segments,
            clock_changes=changes,
            counted=counted,
            imu=imu,
            secondary=self._secondary.read(batch, share, timed),
            statements=self._statements.read(batch, share, beats, self.autopilot),
            motion=self._velocity.read(batch, share),
        )

    def _read_imu(self, batch: SortedFrames, share: Share, timed: TimedMessages) -> dict[str, ImuSamples]:
        """The samples of each IMU message that came."""
        imu = {}
        for name in IMU_MESSAGES:
            if share.count(KIND[name]):
                reader = self._imu.get(name) or self._imu.setdefault(name, ImuReader(name, self._dialect))
                samples = reader.read(batch, share, timed, self.autopilot, self._autopilot_frame_index)
                if len(samples):
                    imu[name] = samples
        return imu

    def _identify(self, beats: list[Beat], segments: list[BootSegment]) -> None:
        """Follow what the heartbeats and, without them, the attitudes say of it, in their order of arrival."""
        if self._is_autopilot or self.vehicle.sysid == 0:  # an autopilot is one for good; system 0 is nobody's
            return
        if self._standing and not beats:
            return
        signs: Iterator[tuple[int, int, Beat | bool]] = ((beat.frame_index, beat.t_rx_us, beat) for beat in beats)
        for frame_index, t_rx_us, sign in merge(signs, self._attitude_signs(segments), key=lambda sign: sign[0]):
            if isinstance(sign, bool):
                self._run = self._run + 1 if sign else 0
                if self._run >= self._settings.attitude_run and not self._standing:
                    self._stand(frame_index, t_rx_us, is_one=True)
            elif sign.autopilot == _AUTOPILOT_INVALID or sign.type == _TYPE_GCS:
                self._stand(frame_index, t_rx_us, is_one=False)
            else:
                self._is_autopilot = True
                self._autopilot_frame_index = frame_index
                self.autopilot = autopilot_name(self._dialect, sign.autopilot)
                self.type = type_name(self._dialect, sign.type)
                self._stand(frame_index, t_rx_us, is_one=True)
                return

    def _attitude_signs(self, segments: list[BootSegment]) -> Iterator[tuple[int, int, bool]]:
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


def _segments(
    batch: SortedFrames, timed: TimedMessages, euler: AttitudeSamples, quaternion: AttitudeSamples
) -> list[BootSegment]:
    """The timed messages in the window, and the attitudes among them, boot by boot."""
    columns = timed.columns
    if not batch.all_in_window or len(timed.held):
        columns = np.ascontiguousarray(columns[:, timed.in_window])
    if not columns.shape[1]:
        return []
    first, last = int(columns[BOOT, 0]), int(columns[BOOT, -1])
    if first == last:
        return [_segment(first, columns, euler, quaternion)]
    segments = []
    for boot in np.unique(columns[BOOT]).tolist():
        start, end = np.searchsorted(columns[BOOT], (boot, boot + 1))
        of = (samples.where(samples.boot == boot) for samples in (euler, quaternion))
        segments.append(_segment(boot, columns[:, start:end], *of))
    return segments


def _segment(boot: int, columns: Int64s, euler: AttitudeSamples, quaternion: AttitudeSamples) -> BootSegment:
    frame_index, message, _, _, t_boot_us, t_rx_us, lost, received = columns
    return BootSegment(
        frame_index=frame_index,
        boot=boot,
        message=message,
        t_boot_us=t_boot_us,
        t_rx_us=t_rx_us,
        lost=lost,
        received=received,
        euler=euler,
        quaternion=quaternion,
    )
