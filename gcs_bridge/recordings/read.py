"""A recording as arrays: all attitude and inertial samples of each vehicle in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import record
from gcs_bridge.judging.monitor import open_dialect
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scanner import Salvage, Scanner
from gcs_bridge.recordings.ahead import ahead, scanned
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
from gcs_bridge.telemetry.sorting import FrameSorter, Share, SortedFrames


@record
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
        scanner, sorter = Scanner(tables, timed=recording.timed), FrameSorter(tables)
        gathered: dict[tuple[int, int], _Gathered] = {}
        pieces = scanned(recording, scanner)
        for batch, done in ahead((sorter.sort(one.buffer, one.frames), one.done) for one in pieces if len(one.frames)):
            for share in batch.shares:
                source = gathered.get(share.address) or gathered.setdefault(
                    share.address, _Gathered(VehicleId(None, *share.address), tables)
                )
                source.take(batch, share, recording.size / done)
    vehicles = {
        address: source.samples() for address, source in sorted(gathered.items()) if source.reader.known.is_vehicle
    }
    return Recording(path, vehicles, scanner.salvage)


class _Gathered:
    """The samples of one (system, component), piece by piece."""

    def __init__(self, vehicle: VehicleId, dialect: Dialect) -> None:
        self.reader = VehicleReader(vehicle, dialect, VehicleSettings(), senders=False)
        self._attitude = _Table(no_attitudes(ATTITUDE))
        self._quaternion = _Table(no_attitudes(ATTITUDE_QUATERNION))
        self._imu = {name: _Table(no_imu(name)) for name in IMU_MESSAGES}

    def take(self, batch: SortedFrames, share: Share, whole: float) -> None:
        """Take its share of a piece; all pieces together are `whole` times as large as those so far."""
        brought = self.reader.read(batch, share)
        for segment in brought.segments:
            self._attitude.append(segment.euler, whole)
            self._quaternion.append(segment.quaternion, whole)
        for name, samples in brought.imu.items():
            self._imu[name].append(samples, whole)

    def samples(self) -> VehicleSamples:
        """All of them; nothing may be taken any more."""
        known = self.reader.known
        imu = {name.lower(): table.finished() for name, table in self._imu.items()}
        return VehicleSamples(
            autopilot=known.autopilot,
            type=known.type,
            attitude=self._attitude.finished(),
            attitude_quaternion=self._quaternion.finished(),
            **imu,
        )


SamplesT = TypeVar("SamplesT", AttitudeSamples, ImuSamples)
_MORE = 1.02  # room for so many times as many rows as the recording so far lets expect


class _Table(Generic[SamplesT]):
    """Rows of one message, in arrays that grow where they are: memory that no row has touched yet costs nothing."""

    def __init__(self, none: SamplesT) -> None:
        self._last: SamplesT = none  # what came last: of its values that are no arrays, the present ones
        self._columns: dict[str, npt.NDArray[Any]] = {}
        self._n = self._room = 0

    def append(self, more: SamplesT, whole: float) -> None:
        """Take the next rows; of the recording so much was read that it is `whole` times as long."""
        if not len(more):
            return
        first, self._n = self._n, self._n + len(more)
        if self._n > self._room:
            self._room = int(_MORE * whole * self._n) + 1
            self._resize(self._room)
            like: Any
            for name, like in vars(more).items():
                if isinstance(like, np.ndarray) and name not in self._columns:
                    self._columns[name] = np.empty((self._room, *like.shape[1:]), like.dtype)
        for name, column in self._columns.items():
            column[first : self._n] = vars(more)[name]
        self._last = more

    def finished(self) -> SamplesT:
        """All rows, and no room beyond them."""
        self._resize(self._n)
        columns: dict[str, Any] = self._columns
        whole: SamplesT = replace(self._last, **columns)
        return whole

    def _resize(self, room: int) -> None:
        column: npt.NDArray[Any]
        for column in self._columns.values():
            column.resize((room, *column.shape[1:]), refcheck=False)
