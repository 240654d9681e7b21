"""Any message of a recording as columns, in bounded memory: what nothing else here reads is there too."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s
from gcs_bridge.errors import UsageError
from gcs_bridge.judging.monitor import open_dialect
from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scanner import Scanned, Scanner
from gcs_bridge.mavlink.secrets import KEY_MESSAGES
from gcs_bridge.mavlink.signing import Signing, SigningKey, Unsigned
from gcs_bridge.recordings.ahead import scanned_ahead
from gcs_bridge.recordings.open import open_recording

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["MessageBatch", "iter_batches"]


@dataclass(frozen=True)
class MessageBatch:
    """Messages of one kind and one sender, n, in order of arrival.

    `fields` (n,) a structured array: `batch.fields["roll"]` is a column without a copy, with the name and the unit of
    MAVLink's definition. `t_rx_us` (n,) receive time in µs since 1970, −1 where unknown; `frame_index` (n,) the number
    of each one's frame in the recording.
    """

    message: str
    sysid: int
    compid: int
    t_rx_us: Int64s
    frame_index: Int64s
    fields: npt.NDArray[np.void]

    def __len__(self) -> int:
        return len(self.t_rx_us)

    def to_arrow(self) -> pa.RecordBatch:
        """The same as Arrow has it, which pandas and polars take; arrays are lists of fixed size, texts are cleaned.

        Beside the fields: sysid, compid, t_rx_us (null where unknown), frame_index; a field of such a name has `_sent`
        behind it.
        """
        from gcs_bridge.recordings.arrow import record_batch

        return record_batch(self)


def iter_batches(
    path: str | Path,
    messages: str | Iterable[str] | None = None,
    *,
    start: float | None = None,
    end: float | None = None,
    sysid: int | None = None,
    dialect: str = "all",
    signing_key: bytes | SigningKey | None = None,
    unsigned: Unsigned | None = None,
) -> Iterator[MessageBatch]:
    """The messages of a recording, a batch for each kind and sender of each piece that is read.

    `messages` by name, one or several, None: all that the dialect knows, but those that carry signing keys. `start` and
    `end` in seconds after the recording's start; `sysid` that system alone. Damage and duplicates are passed over, and
    with `unsigned="reject"` frames that no `signing_key` signed: key and `unsigned` as of a `Monitor`.
    Raises SourceError where the file cannot be used, UsageError for an unknown message or dialect, no key, and for
    times of a recording that has none.
    """
    known = open_dialect(dialect)
    wanted = None if messages is None else (messages,) if isinstance(messages, str) else tuple(messages)
    for name in wanted or ():
        if name not in known:
            raise UsageError(f"no message {name!r} in dialect {dialect}")
    return _batches(Path(path), wanted, known, start, end, sysid, Signing.of(signing_key, unsigned))


def _batches(
    path: Path,
    wanted: tuple[str, ...] | None,
    dialect: Dialect,
    start_s: float | None,
    end_s: float | None,
    sysid: int | None,
    signing: Signing | None,
) -> Iterator[MessageBatch]:
    ids = None if wanted is None else np.array([dialect[name].msgid for name in wanted], np.int32)
    secret = np.array([dialect[name].msgid for name in KEY_MESSAGES if name in dialect], np.int32)
    with open_recording(path, dialect.name, judged=False) as source:
        if start_s is not None or end_s is not None:
            source.need_times("start and end cannot select by them")
        zero_us = source.start_us or 0
        first_us = zero_us + round((start_s or 0.0) * 1e6)
        last_us = np.inf if end_s is None else zero_us + round(end_s * 1e6)
        count = 0
        for scanned in scanned_ahead(source, Scanner(dialect, timed=source.timed, signing=signing)):
            frames = scanned.frames
            frame_index = count + np.arange(len(frames))
            count += len(frames)
            chosen = frames["duplicate"] == 0
            chosen &= ~np.isin(frames["msgid"], secret) if ids is None else np.isin(frames["msgid"], ids)
            if sysid is not None:
                chosen &= frames["sysid"] == sysid
            if start_s is not None or end_s is not None:
                chosen &= (frames["t_rx_us"] >= first_us) & (frames["t_rx_us"] <= last_us)
            yield from _sorted(scanned, np.flatnonzero(chosen), frame_index, dialect)


def _sorted(scanned: Scanned, rows: Int64s, frame_index: Int64s, dialect: Dialect) -> Iterator[MessageBatch]:
    """The frames at `rows`, by message and sender, those first that came first."""
    frames = scanned.frames[rows]
    kind = (frames["msgid"].astype(np.int64) << 16) | (frames["sysid"].astype(np.int64) << 8) | frames["compid"]
    _, first, which = np.unique(kind, return_index=True, return_inverse=True)
    for group in np.argsort(first).tolist():
        of = np.flatnonzero(which == group)
        one = frames[of]
        name = dialect.name_of(int(one["msgid"][0]))
        assert name is not None  # frames of ids that are not known are no frames here
        yield MessageBatch(
            message=name,
            sysid=int(one["sysid"][0]),
            compid=int(one["compid"][0]),
            t_rx_us=np.ascontiguousarray(one["t_rx_us"]),
            frame_index=frame_index[rows[of]],
            fields=decode(scanned.buffer, one, dialect[name]),
        )
