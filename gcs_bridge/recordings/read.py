"""A recording as arrays: all attitude and inertial samples of each vehicle in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from gcs_bridge.judging.monitor import open_dialect
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scanner import Salvage, Scanner
from gcs_bridge.recordings.open import open_recording
from gcs_bridge.settings import VehicleSettings
from gcs_bridge.telemetry.component import VehicleReader
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.samples import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    IMU_MESSAGES,
    AttitudeSamples,
    ImuSamples,
    no_attitudes,
    no_imu,
)


@dataclass(frozen=True, kw_only=True)
class VehicleSamples:
    """What a recording holds of one vehicle; a message that never came is an empty array."""

    autopilot: str
    type: str
    attitude: AttitudeSamples
    attitude_quaternion: AttitudeSamples
    raw_imu: ImuSamples
    scaled_imu: ImuSamples
    scaled_imu2: ImuSamples
    scaled_imu3: ImuSamples
    highres_imu: ImuSamples


@dataclass(frozen=True)
class Recording:
    """A recording's samples by vehicle, keyed (system, component), and what was read of the file."""

    path: Path
    vehicles: Mapping[tuple[int, int], VehicleSamples]
    salvage: Salvage


def read(path: str | Path, *, dialect: str = "all") -> Recording:
    """All attitude and inertial samples of a recording (.tlog, or a stream without times), as arrays.

    Raises SourceError where the file cannot be used, UsageError for an unknown dialect.
    """
    path = Path(path)
    tables = open_dialect(dialect)
    with open_recording(path, dialect, judged=False) as recording:
        scanner = Scanner(tables, timed=recording.timed)
        gathered: dict[int, _Gathered] = {}
        n_frames = 0
        for chunk in chain(recording, (None,)):
            frames = scanner.scan(b"" if chunk is None else chunk.data, final=chunk is None)
            frame_indices = np.arange(n_frames, n_frames + len(frames))
            n_frames += len(frames)
            component = frames["sysid"].astype(np.int64) * 256 + frames["compid"]
            for key in np.unique(component).tolist():
                rows = np.flatnonzero((component == key) & (frames["duplicate"] == 0))
                source = gathered.get(key) or gathered.setdefault(
                    key, _Gathered(VehicleId(None, *divmod(key, 256)), tables)
                )
                source.take(scanner, frames[rows], frame_indices[rows])
    vehicles = {
        source.reader.vehicle.address: source.samples()
        for _, source in sorted(gathered.items())
        if source.reader.is_vehicle
    }
    return Recording(path, vehicles, scanner.salvage)


class _Gathered:
    """The samples of one (system, component), piece by piece."""

    def __init__(self, vehicle: VehicleId, dialect: Dialect) -> None:
        self.reader = VehicleReader(vehicle, dialect, VehicleSettings())
        self._attitude = [no_attitudes(ATTITUDE)]
        self._quaternion = [no_attitudes(ATTITUDE_QUATERNION)]
        self._imu: dict[str, list[ImuSamples]] = {}

    def take(self, scanner: Scanner, frames: np.ndarray[Any, np.dtype[np.void]], frame_indices: Any) -> None:
        batch = self.reader.read(scanner.buffer, frames, frame_indices, np.ones(len(frames), np.bool_))
        self._attitude += [segment.euler for segment in batch.segments]
        self._quaternion += [segment.quaternion for segment in batch.segments]
        for name, inertial in batch.imu.items():
            self._imu.setdefault(name, []).append(inertial)

    def samples(self) -> VehicleSamples:
        imu = {name.lower(): ImuSamples.joined(self._imu.get(name) or [no_imu(name)]) for name in IMU_MESSAGES}
        return VehicleSamples(
            autopilot=self.reader.autopilot,
            type=self.reader.type,
            attitude=AttitudeSamples.joined(self._attitude),
            attitude_quaternion=AttitudeSamples.joined(self._quaternion),
            **imu,
        )
