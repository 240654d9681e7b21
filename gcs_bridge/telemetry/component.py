"""From a link's frames to one vehicle's samples: its clock, its identity, its streams; nothing is judged here.

Which (system, component) is a vehicle is said in `stations`; here it is followed from frame to frame.
"""

from __future__ import annotations

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
from gcs_bridge.telemetry.known import NOTHING_KNOWN, Known
from gcs_bridge.telemetry.messages import IMU_KINDS, KIND
from gcs_bridge.telemetry.positions import NO_POSITIONS, PositionReader
from gcs_bridge.telemetry.samples import AHRS2, IMU_MESSAGES, AttitudeSamples, ImuSamples
from gcs_bridge.telemetry.secondary import Ahrs2Reader
from gcs_bridge.telemetry.senders import Senders
from gcs_bridge.telemetry.sorting import Share, SortedFrames
from gcs_bridge.telemetry.statement_reader import StatementReader, autopilot_name, type_name
from gcs_bridge.telemetry.stations import Heartbeats, Majority, is_vehicle
from gcs_bridge.telemetry.velocity import VelocityReader

_ARDUPILOT = "ardupilot"
_AHRS2_KIND = KIND[AHRS2]
_IMU_KINDS = [(name, KIND[name]) for name in IMU_MESSAGES]


class VehicleReader:
    """Reads one (system, component) of a link."""

    def __init__(
        self,
        vehicle: VehicleId,
        dialect: Dialect,
        settings: VehicleSettings,
        *,
        positions: bool = False,
        senders: bool = True,
    ) -> None:
        """Start with nothing heard; `positions`, `senders`: somebody wants to know where it is, or who sends it."""
        self.vehicle = vehicle
        self._autopilot, self._type = NOTHING_KNOWN.autopilot, NOTHING_KNOWN.type
        self._received = self._lost = 0
        self._heard_rx_us = NOTHING_KNOWN.heard_rx_us
        self._dialect = dialect
        self._settings = settings
        self._seen: tuple[int, int] | None = None
        self._standing: tuple[tuple[int, bool], ...] = ()
        self._heartbeats = Heartbeats(dialect)
        self._senders = Senders(dialect) if senders else None
        self._said: Majority | None = None  # what most of its heartbeats say
        self._ardupilot_frame_index: int | None = None  # since when its IMU's numbers are ArduPilot's
        self._run = 0  # plausible attitudes in a row, as long as there are not enough of them
        self._looked_at = -1  # the frame of the last of them
        self._clock = BootClock(dialect)
        self._attitudes = AttitudeReader(dialect)
        self._imu: dict[str, ImuReader] = {}
        self._secondary = Ahrs2Reader(dialect)
        self._velocity = VelocityReader(dialect)
        self._statements = StatementReader(dialect)
        self._positions = PositionReader(dialect) if positions else None

    @property
    def known(self) -> Known:
        """What is known of it by what was read so far."""
        return Known(
            autopilot=self._autopilot,
            type=self._type,
            received=self._received,
            lost=self._lost,
            heard_rx_us=self._heard_rx_us,
            unbelieved=self._clock.unbelieved,
            seen=self._seen,
            standing=self._standing,
            is_decided=bool(self._standing) or self.vehicle.sysid == 0,
        )

    def read(self, batch: SortedFrames, share: Share) -> VehicleBatch:
        """Take this component's share of the next frames.

        Samples outside the window are left out; the clock and the identity are followed there too.
        """
        timed, changes = self._clock.read(batch, share, self._received)
        self._received += share.end - share.start
        self._lost, self._heard_rx_us = share.lost, share.heard_us
        euler, quaternion = self._attitudes.read(batch, share, timed)
        segments = _segments(batch, timed, euler, quaternion)
        self._identify(self._heartbeats.read(batch, share), segments)
        imu = self._read_imu(batch, share, timed) if share.has_any(IMU_KINDS) else {}
        counted = {name: samples.t_rx_us for name, samples in imu.items()}
        if share.counts[_AHRS2_KIND]:
            rows = batch.rows(share, _AHRS2_KIND)
            counted[AHRS2] = batch.frames["t_rx_us"][rows[batch.in_window[rows]]]
        return VehicleBatch(
            known=self.known,
            frame_index=batch.frame_indices(share),
            heard=heard_frames(batch, share, timed.restarting),
            timed=timed.columns,
            senders=self._senders.read(batch, share) if self._senders else [],
            segments=segments,
            clock_changes=changes,
            counted=counted,
            imu=imu,
            secondary=self._secondary.read(batch, share, timed),
            statements=self._statements.read(batch, share, self._autopilot),
            motion=self._velocity.read(batch, share),
            positions=self._positions.read(batch, share, timed) if self._positions else NO_POSITIONS,
        )

    def _read_imu(self, batch: SortedFrames, share: Share, timed: TimedMessages) -> dict[str, ImuSamples]:
        """The samples of each IMU message that came."""
        imu = {}
        autopilot, since = self._autopilot, 0
        if self._ardupilot_frame_index is not None:
            autopilot, since = _ARDUPILOT, self._ardupilot_frame_index
        for name, kind in _IMU_KINDS:
            if share.counts[kind]:
                reader = self._imu.get(name) or self._imu.setdefault(name, ImuReader(name, self._dialect))
                samples = reader.read(batch, share, timed, autopilot, since)
                if len(samples):
                    imu[name] = samples
        return imu

    def _identify(self, changes: list[Majority], segments: list[BootSegment]) -> None:
        """Follow what the heartbeats and the attitudes say of it, in their order of arrival."""
        if self.vehicle.sysid == 0:  # nobody's
            return
        for said in changes:
            self._follow_run(segments, said.frame_index)
            self._said = said
            self._autopilot = autopilot_name(self._dialect, said.autopilot)
            self._type = type_name(self._dialect, said.type)
            if self._autopilot == _ARDUPILOT and self._ardupilot_frame_index is None:
                self._ardupilot_frame_index = said.frame_index
            self._decide(said.frame_index, said.t_rx_us)
        self._follow_run(segments, None)

    def _follow_run(self, segments: list[BootSegment], until: int | None) -> None:
        """Count the plausible attitudes in a row that came before the frame `until`, as far as there are enough."""
        least = self._settings.attitude_run
        if self._run >= least:
            return
        for segment in segments:
            frame_index = segment.frame_index
            valid = segment.valid_attitude
            for row in np.flatnonzero(segment.attitude & (frame_index > self._looked_at)).tolist():
                at = int(frame_index[row])
                if until is not None and at > until:
                    return
                self._looked_at = at
                self._run = self._run + 1 if valid[row] else 0
                if self._run >= least:
                    self._decide(at, int(segment.t_rx_us[row]))
                    return

    def _decide(self, frame_index: int, t_rx_us: int) -> None:
        """Take in, with a frame, what is known of it by now."""
        is_one = is_vehicle(self.vehicle.compid, self._said, sends_attitude=self._run >= self._settings.attitude_run)
        if is_one is not None or self._standing:
            self._stand(frame_index, t_rx_us, is_one=bool(is_one))

    def _stand(self, frame_index: int, t_rx_us: int, *, is_one: bool) -> None:
        if not self._standing or self._standing[-1][1] != is_one:
            self._standing += ((frame_index, is_one),)
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
