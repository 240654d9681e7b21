"""The frames of moments, byte for byte and each with its place in the recording, by reading that once more."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from gcs_bridge.evidence.tables import utc
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import FRAME, Frames
from gcs_bridge.mavlink.scanner import Scanner
from gcs_bridge.mavlink.secrets import carries_key
from gcs_bridge.mavlink.signing import Signing
from gcs_bridge.recordings.source import Source

__all__ = ["frames_of"]


class _Part(NamedTuple):
    """Frames of one piece: n, their indices, and their bytes."""

    frames: Frames
    frame_index: npt.NDArray[np.int64]
    data: list[bytes]


_NOTHING = _Part(np.empty(0, FRAME), np.empty(0, np.int64), [])


def frames_of(
    source: Source, ranges: Sequence[tuple[int, int]], dialect: Dialect, signing: Signing | None = None
) -> Iterator[tuple[int, pa.Table]]:
    """The index of each range of frames (first, end), and its frames; a range is given out when it has been read.

    Frames of unknown ids are no vehicle's, those that `signing` refuses are not judged: they have no index, and are
    given where they lie, before the next that has. What brings a signing key is left out: evidence is passed on.
    """
    scanner = Scanner(dialect, timed=source.timed, signing=signing)
    waiting: dict[int, list[_Part]] = {index: [] for index in range(len(ranges))}
    count = 0
    for chunk in chain(source, (None,)):
        scanner.scan(b"" if chunk is None else chunk.data, final=chunk is None)
        frames, raw = scanner.all_frames, None
        verified = frames["verified"] == 1
        frame_index = count + np.cumsum(verified) - verified
        count += int(verified.sum())
        for index, parts in list(waiting.items()):
            first, end = ranges[index]
            rows = np.flatnonzero((frame_index >= first) & (frame_index < end))
            if len(rows):
                raw = raw or scanner.raw_frames()
                rows = np.array([row for row in rows.tolist() if not carries_key(raw[row].data)], np.int64)
                parts.append(_Part(frames[rows], frame_index[rows], [raw[row].data for row in rows.tolist()]))
            if count >= end or chunk is None:
                yield index, pa.concat_tables([_table(part, dialect) for part in waiting.pop(index) or [_NOTHING]])


def _table(part: _Part, dialect: Dialect) -> pa.Table:
    frames = part.frames
    return pa.table(
        {
            "frame": pa.array(part.frame_index, pa.int64(), mask=frames["verified"] == 0),
            "offset": pa.array(frames["offset"], pa.int64()),
            "t_rx_utc": utc(frames["t_rx_us"]),
            "message": pa.array([dialect.name_of(msgid) for msgid in frames["msgid"].tolist()], pa.string()),
            "msgid": pa.array(frames["msgid"], pa.int32()),
            "sysid": pa.array(frames["sysid"], pa.uint8()),
            "compid": pa.array(frames["compid"], pa.uint8()),
            "seq": pa.array(frames["seq"], pa.uint8()),
            "duplicate": pa.array(frames["duplicate"] == 1),
            "bytes": pa.array(part.data, pa.binary()),
        }
    )
