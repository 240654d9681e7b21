"""Records links as .tlog files: before each frame its receive time, eight bytes, big-endian, µs since 1970."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_bridge.errors import UsageError
from gcs_bridge.files import refuse_unwritable
from gcs_bridge.mavlink.secrets import carries_key
from gcs_bridge.sinks.base import Plan, Sink, SinkContext
from gcs_bridge.sinks.file import LiveFile
from gcs_bridge.sinks.tlog_tail import cut_torn_record, first_time_us

if TYPE_CHECKING:
    from gcs_bridge.mavlink.scanner import RawFrame

__all__ = ["TlogLimits", "TlogRecorder"]


_RETRY_S = 60.0  # so often the next file is tried again, where it could not be begun


@dataclass(frozen=True)
class TlogLimits:
    """When a recording goes on in another file: before it is larger, or longer, than this; None: never."""

    max_bytes: float | None = None
    max_us: float | None = None

    @property
    def any(self) -> bool:
        """Whether there is one."""
        return self.max_bytes is not None or self.max_us is not None


class TlogRecorder(Sink):
    """Takes frames and writes them byte for byte, every batch at once; of several links each into a file of its own.

    A frame that brings a signing key is left out: recordings are passed on.
    """

    def __init__(self, path: Path, limits: TlogLimits, context: SinkContext) -> None:
        """Open a file for each link; UsageError where one cannot be written."""
        paths = paths_of_links(path, context.links)
        self._recordings = [_Recording(one, limits, context) for one in paths]
        if len(paths) > 1:
            context.note(f"each link is recorded in a file of its own: {', '.join(map(str, paths))}")

    @classmethod
    def plan(cls, path: str, *, max_mb: float | None = None, max_minutes: float | None = None) -> Plan:
        """A recorder that appends to the file at `path`; UsageError where it could not."""
        refuse_unwritable(Path(path), sources=[])
        limits = TlogLimits(max_mb and max_mb * 1e6, max_minutes and max_minutes * 60e6)
        return Plan(lambda context: cls(Path(path), limits, context), writes=Path(path))

    @property
    def failed(self) -> bool:
        """Whether something could not be written."""
        return any(recording.failed for recording in self._recordings)

    def frames(self, link: int | str, frames: Sequence[RawFrame]) -> None:
        """Write the frames of a link; what is no live link counts as the first."""
        records = [t_rx_us.to_bytes(8, "big") + data for t_rx_us, data in frames if not carries_key(data)]
        if records:
            self._recordings[link if isinstance(link, int) else 0].append(records)

    def reopen(self) -> None:
        """Go on in the files that have their names now."""
        for recording in self._recordings:
            recording.reopen()

    def close(self) -> None:
        """Close the files."""
        for recording in self._recordings:
            recording.close()


def paths_of_links(path: Path, links: Sequence[str]) -> list[Path]:
    """Where each of the links is recorded: one alone at `path` itself, of several each at a name with the link's.

    >>> [str(one) for one in paths_of_links(Path("a.tlog"), ["tcp:[::1]:5760", "/dev/ttyACM0"])]
    ['a_tcp-1-5760.tlog', 'a_dev-ttyACM0.tlog']
    """
    if len(links) < 2:
        return [path]
    names = [re.sub(r"[^A-Za-z0-9.]+", "-", link).strip("-.") for link in links]
    names = [f"{name}-link{number}" if names.count(name) > 1 else name for number, name in enumerate(names)]
    return [path.with_name(f"{path.stem}_{name}{path.suffix}") for name in names]


class _Recording:
    """One link's: a file, and where there are limits those that follow it, as `flight_part002.tlog`."""

    def __init__(self, path: Path, limits: TlogLimits, context: SinkContext) -> None:
        self._path = path
        self._limits = limits
        self._context = context
        self._part = self._last_part() if limits.any else 1
        self._file = self._opened(self._part)
        self._began_us = first_time_us(self._file.path)  # of the file that is written
        self._lost = False  # in a file before
        self._retry_s = -math.inf

    @property
    def failed(self) -> bool:
        return self._lost or self._file.failed

    def append(self, records: list[bytes]) -> None:
        """Write records, none of them cut in two by a limit."""
        if not self._limits.any:
            self._file.append(b"".join(records))
            return
        size, begin = self._file.size, 0
        for index, record in enumerate(records):
            t_rx_us = int.from_bytes(record[:8], "big")
            if size and self._is_full(size + len(record), t_rx_us):
                self._file.append(b"".join(records[begin:index]))
                begin = index
                if self._go_on():
                    size, self._began_us = 0, None
            if self._began_us is None:
                self._began_us = t_rx_us
            size += len(record)
        self._file.append(b"".join(records[begin:]))

    def reopen(self) -> None:
        """Go on in the file that has the name of the one that is written, or in a new one."""
        try:
            cut_torn_record(self._file.path)
        except UsageError as error:
            self._context.complain(f"{error}; going on as before")
            return
        if self._file.reopen():
            self._began_us = first_time_us(self._file.path)

    def close(self) -> None:
        self._file.close()

    def _is_full(self, size: int, t_rx_us: int) -> bool:
        """Whether a record does not belong into this file, which would grow to `size` by it."""
        limits = self._limits
        if limits.max_bytes is not None and size > limits.max_bytes:
            return True
        # A clock that is set back begins another file, too: else none would begin for as long as it was.
        return limits.max_us is not None and abs(t_rx_us - (self._began_us or t_rx_us)) >= limits.max_us

    def _go_on(self) -> bool:
        """Begin the next file. Where that cannot be done, this one is gone on with, and it is tried again later."""
        if self._file.is_ailing or time.monotonic() < self._retry_s:
            return False
        try:
            following = self._opened(self._part + 1)
        except UsageError as error:
            self._retry_s = time.monotonic() + _RETRY_S
            self._context.complain(f"{error}; going on in {self._file.path}")
            return False
        self._lost |= self._file.failed
        self._file.close()
        self._file, self._part = following, self._part + 1
        return True

    def _opened(self, part: int) -> LiveFile:
        path = self._path if part == 1 else self._path.with_name(f"{self._path.stem}_part{part:03}{self._path.suffix}")
        refuse_unwritable(path, sources=[])
        cut_torn_record(path)
        return LiveFile(path, self._context.complain, self._context.note)

    def _last_part(self) -> int:
        """The last of the files that are there, which a run before this one may have left."""
        form = re.compile(rf"{re.escape(self._path.stem)}_part(\d{{3,}}){re.escape(self._path.suffix)}")
        found = (form.fullmatch(path.name) for path in self._path.absolute().parent.iterdir())
        return max((int(match[1]) for match in found if match), default=1)
