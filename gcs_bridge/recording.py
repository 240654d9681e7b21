"""Recordings: files read in pieces, told apart, and judged or turned into samples."""

from __future__ import annotations

import stat
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np

from gcs_bridge.align import match_kernel
from gcs_bridge.errors import SourceError, UsageError
from gcs_bridge.events import Event
from gcs_bridge.judge import Observation
from gcs_bridge.mavlink.decode import gather
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.jit import needs_compiling
from gcs_bridge.mavlink.scan import Salvage, Scanner, scan_kernel
from gcs_bridge.monitor import Monitor, open_dialect
from gcs_bridge.report import Report
from gcs_bridge.samples import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    IMU_MESSAGES,
    AttitudeSamples,
    ImuSamples,
    no_attitudes,
    no_imu,
)
from gcs_bridge.settings import Settings, VehicleSettings, load_settings
from gcs_bridge.vehicles import VehicleReader

Progress = Callable[[int, int], None]


class Witness(Protocol):
    """Whoever wants to see how a recording is judged."""

    def observe(self, observation: Observation) -> None:
        """Take what was judged: before the events that came of it."""

    def take(self, events: list[Event]) -> None:
        """Take the events of a piece of the recording, none included."""


_PIECE = 3 * 2**19  # bytes read at a time: bounds the memory, and is large enough that its cost vanishes
_PROBE = 2**18  # bytes by which a recording is told from a stream without times

# Other flight logs by their first bytes, each with the tool that reads it.
_FOREIGN = (
    (
        b"\xa3\x95",
        "an on-board log (ArduPilot .bin, PX4 .px4log), not telemetry: use MAVExplorer or pymavlink",
    ),
    (b"ULog\x01\x12\x35", "a PX4 .ulg on-board log, not telemetry: open it with pyulog or Flight Review"),
    (b"\x89MCAP0\r\n", "an MCAP file, not telemetry: open it with Foxglove"),
    (b"RRF", "a rerun recording, not telemetry: open it with `rerun`"),
    (b"\x1f\x8b", "compressed: unpack it with gunzip first"),
    (b"PK\x03\x04", "a zip archive: unpack it first"),
)


@dataclass(frozen=True)
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
    with _opened(path) as file:
        _announce(scan_kernel, gather)
        scanner = Scanner(tables, timed=_start_us(file, tables, path) is not None)
        gathered: dict[int, _Gathered] = {}
        n_frames = 0
        for piece, last in _pieces(file):
            frames = scanner.scan(piece, t_rx_us=-1, final=last)
            ordinals = np.arange(n_frames, n_frames + len(frames))
            n_frames += len(frames)
            component = frames["sysid"].astype(np.int64) * 256 + frames["compid"]
            for key in np.unique(component).tolist():
                rows = np.flatnonzero((component == key) & (frames["duplicate"] == 0))
                source = gathered.get(key) or gathered.setdefault(key, _Gathered(key // 256, key % 256, tables))
                source.take(scanner, frames[rows], ordinals[rows])
    vehicles = {
        source.reader.key: source.samples() for _, source in sorted(gathered.items()) if source.reader.is_vehicle
    }
    return Recording(path, vehicles, scanner.salvage)


def check(
    path: str | Path, profile: str = "default", *, settings: Settings | None = None, dialect: str = "all"
) -> Report:
    """Judge one recording; `report.to_dict()` is the contract's JSON.

    Raises SourceError where the file cannot be used, UsageError for an unknown profile or dialect.
    """
    return Report((check_file(Path(path), settings or load_settings(profile), dialect=dialect),))


def check_file(
    path: Path,
    settings: Settings,
    *,
    dialect: str = "all",
    sysid: int | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    progress: Progress | None = None,
    witness: Witness | None = None,
) -> dict[str, Any]:
    """Judge one recording and return its entry in the report.

    `progress` is told bytes done and bytes in all, `witness` is shown how it is judged. Raises SourceError where the
    file cannot be used, UsageError where `from_s` is past its end or the file has no times to select by.
    """
    observer = None if witness is None else witness.observe
    monitor = Monitor(settings=settings, dialect=dialect, sysid=sysid, from_s=from_s, to_s=to_s, observer=observer)
    with open_recording(path, dialect) as source:
        if from_s is not None or to_s is not None:
            source.need_times("--from and --to cannot select by them")
        done = 0
        for piece in source.pieces():
            events = source.feed(monitor, piece)
            if witness is not None:
                witness.take(events)
            done += len(piece)
            if progress is not None:
                progress(done, source.size)
    if witness is not None:
        witness.take(monitor.finish())
    return closing_entry(monitor, path)


class Source:
    """A recording that is being read: its bytes in pieces, to be fed to a monitor as what they are."""

    def __init__(self, file: BinaryIO, path: Path, start_us: int | None) -> None:
        """Read from `file`; `start_us`: its first record's time, µs since 1970, None for a stream without times."""
        self.start_us = start_us
        self.timed = start_us is not None
        self.size = file.seek(0, 2)
        self._file = file
        self._path = path

    def need_times(self, so_that: str) -> None:
        """Raise UsageError, with what is impossible, if there are no record times."""
        if not self.timed:
            raise UsageError(f"{self._path}: has no record times, so {so_that}")

    def pieces(self, length: Callable[[], int] = lambda: _PIECE) -> Iterator[bytes]:
        """All its bytes from the first, each piece as long as `length` says when it is read."""
        self._file.seek(0)
        while piece := self._file.read(length()):
            yield piece

    def feed(self, monitor: Monitor, piece: bytes) -> list[Event]:
        """Give a piece to `monitor`; the events that it brought about."""
        return monitor.feed_recording(piece) if self.timed else monitor.feed(piece, -1)


@contextmanager
def open_recording(path: Path, dialect: str = "all", *, judged: bool = True) -> Iterator[Source]:
    """The recording, open; SourceError where it cannot be used, also later while it is read."""
    with _opened(path) as file:
        _announce(scan_kernel, *([gather, match_kernel] if judged else []))
        yield Source(file, path, _start_us(file, open_dialect(dialect), path))


def closing_entry(monitor: Monitor, path: Path) -> dict[str, Any]:
    """The report's entry of a recording that has been fed to `monitor` as a whole.

    Raises UsageError where nothing was recorded in the times to judge.
    """
    report = monitor.close()
    if monitor.window_is_empty:
        raise UsageError(f"{path}: nothing was recorded between --from and --to: {monitor.span_s:.1f} s in all")
    return {**report.files[0], "path": str(path)}


class _Gathered:
    """The samples of one (system, component), piece by piece."""

    def __init__(self, sysid: int, compid: int, dialect: Dialect) -> None:
        self.reader = VehicleReader(sysid, compid, dialect, VehicleSettings())
        self._attitude = [no_attitudes(ATTITUDE)]
        self._quaternion = [no_attitudes(ATTITUDE_QUATERNION)]
        self._imu: dict[str, list[ImuSamples]] = {}

    def take(self, scanner: Scanner, frames: np.ndarray[Any, np.dtype[np.void]], ordinals: Any) -> None:
        batch = self.reader.read(scanner.buffer, frames, ordinals, np.ones(len(frames), np.bool_))
        self._attitude += [segment.euler for segment in batch.segments]
        self._quaternion += [segment.quaternion for segment in batch.segments]
        for name, inertial in batch.imu.items():
            self._imu.setdefault(name, []).append(inertial.samples)

    def samples(self) -> VehicleSamples:
        return VehicleSamples(
            self.reader.autopilot,
            self.reader.type,
            AttitudeSamples.joined(self._attitude),
            AttitudeSamples.joined(self._quaternion),
            *(ImuSamples.joined(self._imu.get(name) or [no_imu(name)]) for name in IMU_MESSAGES),
        )


def _announce(*kernels: Any) -> None:
    """Say before the wait that the kernels are compiled now: it happens once on a machine, and takes seconds."""
    if needs_compiling(*kernels):
        sys.stderr.write("gcs-bridge: compiling its kernels, once on this machine (some seconds)\n")
        sys.stderr.flush()


_ADVICE = {
    FileNotFoundError: ": look at the path, or name the folder that it is in",
    PermissionError: ": ask its owner, or copy it to where you may read it",
    IsADirectoryError: ": name a file in it",
}


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    """The file, open for reading; SourceError in one line for whatever keeps it from being read."""
    try:
        if not path.is_dir() and not stat.S_ISREG(path.stat().st_mode):
            raise SourceError(f"{path}: a pipe or device, not a file: save what comes from it to a file first")
        with path.open("rb") as file:
            yield file
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise SourceError(f"{path}: cannot be read: {what}{_ADVICE.get(type(error), '')}") from None


def _pieces(file: BinaryIO) -> Iterator[tuple[bytes, bool]]:
    """The file's bytes, and with each piece whether it is the last."""
    file.seek(0)
    piece = file.read(_PIECE)
    while piece:
        following = file.read(_PIECE)
        yield piece, not following
        piece = following


def _start_us(file: BinaryIO, dialect: Dialect, path: Path) -> int | None:
    """The first record's time of a .tlog, None for a stream without times.

    They are told apart by which reading finds the frames in the file's beginning. Read as a stream, a .tlog shows its
    frames too, so the reading with times wins unless it misses most of them.
    Raises SourceError for a file that is empty, another format, or without a frame.
    """
    file.seek(0)
    while probe := file.read(_PROBE):
        for magic, what in _FOREIGN:
            if file.tell() == len(probe) and probe.startswith(magic):
                raise SourceError(f"{path}: {what}")
        timed = Scanner(dialect, timed=True).scan(probe, final=True)
        stream = Scanner(dialect, timed=False).scan(probe, final=True)
        if len(timed) or len(stream):
            known_us = timed["t_rx_us"][timed["t_rx_us"] > 0]  # a damaged time reads as 0
            return int(next(iter(known_us), 0)) if len(timed) * 2 > len(stream) else None
    if not file.tell():
        raise SourceError(f"{path}: the file is empty: copy or record it again")
    raise SourceError(
        f"{path}: no valid MAVLink frame in {file.tell()} bytes: not a telemetry recording; "
        "a ground station's .tlog, .raw or .rlog is one"
    )
