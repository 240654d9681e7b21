"""Recordings: files read in pieces, and told apart."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from gcs_bridge.chunks import Chunk, Framing
from gcs_bridge.errors import SourceError, UsageError
from gcs_bridge.files import file_of
from gcs_bridge.jit import prepare
from gcs_bridge.judging.monitor import open_dialect
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scanner import MARKERS, Scanner
from gcs_bridge.recordings.packed import STANDARD_INPUT, standard_input, unpacked

_CHUNK = 3 * 2**19  # bytes read at a time: bounds the memory, and is large enough that its cost vanishes
_WHOLE = 0.99  # of the bytes read as records: no stream need be looked for
_PROBE = 2**18  # bytes by which a recording is told from a stream without times
# Other files that people may take for telemetry, by their first bytes, each with the tool that reads it.
FOREIGN = {
    b"\xa3\x95": "an on-board log (ArduPilot .bin, PX4 .px4log), not telemetry: use MAVExplorer or pymavlink",
    b"ULog\x01\x12\x35": "a PX4 .ulg on-board log, not telemetry: open it with pyulog or Flight Review",
    b"\x89MCAP0\r\n": "an MCAP file, not telemetry: open it with Foxglove",
    b"RRF": "a rerun recording, not telemetry: open it with `rerun`",
    b"#ROSBAG": "a ROS bag, not telemetry: open it with `rosbag` or Foxglove",
    b"SQLite format 3": "a database, maybe a ROS 2 bag, not telemetry: open it with `ros2 bag` or Foxglove",
    b"PAR1": "a Parquet table, not telemetry: open it with pandas or DuckDB",
    b"\xfd7zXZ\x00": "compressed: unpack it with unxz first",
    b"\x28\xb5\x2f\xfd": "compressed: unpack it with unzstd first",
    b"BZh": "compressed: unpack it with bunzip2 first",
    b"7z\xbc\xaf\x27\x1c": "a 7z archive: unpack it first",
    b"Rar!": "a rar archive: unpack it first",
}


class Source:
    """A recording that is being read: an iterable of its bytes in chunks, all of them each time."""

    def __init__(self, file: BinaryIO, path: Path, start_us: int | None, remarks: Sequence[str] = ()) -> None:
        """Read from `file`; `start_us`: its first record's time, µs since 1970, None for a stream without times.

        `remarks`: what there is to say of how it was unpacked.
        """
        self.start_us = start_us
        self.remarks = tuple(remarks)
        self.timed = start_us is not None
        self.size = file.seek(0, 2)
        self._file = file
        self._path = path

    def need_times(self, so_that: str) -> None:
        """Raise UsageError, with what is impossible, if there are no record times."""
        if not self.timed:
            raise UsageError(f"{self._path}: has no record times, so {so_that}")

    def __iter__(self) -> Iterator[Chunk]:
        return self.chunks()

    def chunks(self, length: Callable[[], int] = lambda: _CHUNK) -> Iterator[Chunk]:
        """All its bytes from the first, each chunk as long as `length` says when it is read."""
        framing = Framing.RECORDS if self.timed else Framing.STREAM
        self._file.seek(0)
        while data := self._file.read(length()):
            yield Chunk(data, -1, framing)


@contextmanager
def open_telemetry(path: Path, dialect: str, *, judged: bool) -> Iterator[Source]:
    """The recording of a link, open; SourceError where it cannot be used, also later while it is read."""
    remarks: list[str] = []
    with opened(path, remarks) as file:
        prepare(*(("gcs_bridge",) if judged else ("gcs_bridge.mavlink", "gcs_bridge.telemetry")))
        yield Source(file, path, start_us_of(file, open_dialect(dialect), path), remarks)


_ADVICE = {
    FileNotFoundError: ": look at the path, or name the folder that it is in",
    PermissionError: ": ask its owner, or copy it to where you may read it",
    IsADirectoryError: ": name a file in it",
}


@contextmanager
def opened(path: Path, remarks: list[str]) -> Iterator[BinaryIO]:
    """The recording in the file, open for reading; SourceError in one line for whatever keeps it from being read."""
    try:
        holds, inside = file_of(path)
        if holds == STANDARD_INPUT:
            with unpacked(standard_input(), holds, inside, remarks) as recording:
                yield recording
            return
        if not holds.is_dir() and not stat.S_ISREG(holds.stat().st_mode):
            raise SourceError(f"{path}: a pipe or device, not a file: pipe it in, and name it -")
        with holds.open("rb") as file, unpacked(file, holds, inside, remarks) as recording:
            yield recording
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise SourceError(f"{path}: cannot be read: {what}{_ADVICE.get(type(error), '')}") from None


def _pass_hole(file: BinaryIO) -> None:
    """Go on behind what was never written, where the file system tells; else it is read as what it is, zeros."""
    try:
        file.seek(os.lseek(file.fileno(), file.tell(), os.SEEK_DATA))
    except OSError as error:
        if error.errno == errno.ENXIO:  # nothing was
            file.seek(0, os.SEEK_END)
    except AttributeError:  # it does not tell
        pass


def start_us_of(file: BinaryIO, dialect: Dialect, path: Path) -> int | None:
    """The first record's time of a .tlog, None for a stream without times.

    They are told apart by which reading finds the frames in the file's beginning. Read as a stream, a .tlog shows its
    frames too, so the reading with times wins unless it misses most of them.
    Raises SourceError for a file that is empty, another format, or without a frame.
    """
    file.seek(0)
    line_feeds = behind_returns = 0
    while probe := file.read(_PROBE):
        line_feeds, behind_returns = line_feeds + probe.count(b"\n"), behind_returns + probe.count(b"\r\n")
        for magic, what in FOREIGN.items():
            if file.tell() == len(probe) and probe.startswith(magic):
                raise SourceError(f"{path}: {what}")
        if not any(marker in probe for marker in MARKERS):
            _pass_hole(file)
            continue
        records = Scanner(dialect, timed=True)
        timed, stream = records.scan(probe, final=True), 0
        if (records.salvage.read_fraction or 0.0) < _WHOLE:
            stream = len(Scanner(dialect, timed=False).scan(probe, final=True))
        if len(timed) or stream:
            known_us = timed["t_rx_us"][timed["t_rx_us"] > 0]  # a damaged time reads as 0
            return int(next(iter(known_us), 0)) if len(timed) * 2 > stream else None
    if not file.tell():
        raise SourceError(f"{path}: the file is empty: copy or record it again")
    turned = "; every LF in it stands behind a CR: if it was one, a text conversion (LF into CR LF) has broken it"
    raise SourceError(
        f"{path}: no valid MAVLink frame in {file.tell()} bytes: not a telemetry recording; "
        f"a ground station's .tlog, .raw or .rlog is one{turned if line_feeds == behind_returns > 9 else ''}"
    )
