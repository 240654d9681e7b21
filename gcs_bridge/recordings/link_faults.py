"""Faults of the link rather than of a message: loss, disorder, noise, a file cut short."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from gcs_bridge.diagnosis.mistake import Parameter, Value
from gcs_bridge.errors import UsageError
from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Message
from gcs_bridge.recordings.edits import Edit, RecordingFrames, components

MakeEdits = Callable[[RecordingFrames, Value, str | None, np.random.Generator], Iterable[Edit]]
"""(records that may be touched, value, message of `thin`, chance) → edits."""


@dataclass(frozen=True)
class LinkFault:
    """A fault of the link rather than of a message: what its value may be, what it does, and what that looks like."""

    parameter: Parameter
    edits: MakeEdits
    became: str
    origin: str
    count: Callable[[Sequence[Edit]], int] = len


def share_count(share: float, of: int) -> int:
    """The share as a number; a fault that is asked for happens at least once."""
    return max(round(share * of), int(share > 0))


def _some(records: RecordingFrames, share: float, chance: np.random.Generator) -> list[int]:
    n = len(records.frames)
    return chance.choice(n, share_count(share, n), replace=False).tolist()  # type: ignore[no-any-return]  # untyped in numpy


def _without(records: RecordingFrames, rows: Iterable[int]) -> Iterator[Edit]:
    for row in rows:
        yield int(records.start[row]), int(records.stop[row]), b""


def _lost(records: RecordingFrames, value: Value, _message: str | None, chance: np.random.Generator) -> Iterable[Edit]:
    return _without(records, _some(records, value[0], chance))


def _duplicated(
    records: RecordingFrames, value: Value, _message: str | None, chance: np.random.Generator
) -> Iterator[Edit]:
    for row in _some(records, value[0], chance):
        begin, end = records.frame(row)
        time = int(records.frames["t_rx_us"][row]).to_bytes(8, "big")
        yield end, end, time + records.data[begin:end]


def _reordered(
    records: RecordingFrames, value: Value, _message: str | None, chance: np.random.Generator
) -> Iterator[Edit]:
    """A share of each system's frames changes places with the next one; record times stay in order."""
    systems = records.frames["sysid"]
    for system in np.unique(systems):
        rows = np.flatnonzero(systems == system)
        pairs = min(share_count(value[0], rows.size), rows.size // 2)
        # Pairs that don't touch: places among those left when each pair counts as one.
        places = np.sort(chance.choice(rows.size - pairs, pairs, replace=False)) + np.arange(pairs)
        for one, other in zip(rows[places], rows[places + 1], strict=True):
            (begin, end), (next_begin, next_end) = records.frame(one), records.frame(other)
            yield begin, end, records.data[next_begin:next_end]
            yield next_begin, next_end, records.data[begin:end]


def _corrupted(
    records: RecordingFrames, value: Value, _message: str | None, chance: np.random.Generator
) -> Iterator[Edit]:
    """A share of the bytes of frames becomes other bytes."""
    begin = records.frames["offset"]
    size = records.stop - begin
    first = np.cumsum(size) - size  # of each frame, as if frames stood end to end
    total = int(size.sum())
    hit = chance.choice(total, share_count(value[0], total), replace=False)
    row = np.searchsorted(first, hit, side="right") - 1
    places = begin[row] + hit - first[row]
    other = records.buffer[places] ^ chance.integers(1, 256, hit.size, dtype=np.uint8)
    for at, byte in zip(places.tolist(), other.tolist(), strict=True):
        yield at, at + 1, bytes([byte])


def _truncated(
    records: RecordingFrames, value: Value, _message: str | None, _chance: np.random.Generator
) -> list[Edit]:
    size, cut = len(records.data), int(value[0])
    if cut >= size:
        raise UsageError(f"truncate:{cut} would leave nothing: the recording has {size} bytes")
    return [(size - cut, size, b"")]


_REBOOT_US = 5e6  # time that falls by more: a reboot; by less: a message that came late


def _thinned(
    records: RecordingFrames, value: Value, message: str | None, _chance: np.random.Generator
) -> Iterable[Edit]:
    """One message a period of each component, by the message's own time where it has one."""
    period_us = 1e6 / value[0]
    time_us = _message_time_us(records, records.dialect[message or ""])
    dropped = []
    for rows in components(records.frames):
        # Periods are centred on the first message, so that jitter at the very rate drops nothing.
        period = np.floor((time_us[rows] - time_us[rows[0]]) / period_us + 0.5)
        kept_period = kept_us = -math.inf
        for row, now, now_us in zip(rows.tolist(), period.tolist(), time_us[rows].tolist(), strict=True):
            if now > kept_period or now_us < kept_us - _REBOOT_US:
                kept_period, kept_us = now, now_us
            else:
                dropped.append(row)
    return _without(records, dropped)


def _message_time_us(records: RecordingFrames, message: Message) -> npt.NDArray[np.float64]:
    for field, unit_us in (("time_boot_ms", 1e3), ("time_usec", 1.0)):
        if field in (message.dtype.names or ()):
            return decode(records.buffer, records.frames, message)[field] * unit_us
    return records.frames["t_rx_us"].astype(np.float64)


_SHARE = Parameter(least=0.0, most=1.0)
LINK_FAULTS: Mapping[str, LinkFault] = MappingProxyType(
    {
        "loss": LinkFault(
            _SHARE,
            _lost,
            "messages lost",
            "A share of the messages never arrives: a radio link at its edge, or a full buffer.",
        ),
        "reorder": LinkFault(
            Parameter(least=0.0, most=0.5),  # at a half, every record is in a pair
            _reordered,
            "messages moved",
            "A share of each system's messages arrives after the next one: UDP over several paths.",
        ),
        "duplicate": LinkFault(
            _SHARE,
            _duplicated,
            "messages doubled",
            "A share of the messages arrives twice: two radios, or a router with a loop.",
        ),
        "corrupt": LinkFault(
            _SHARE,
            _corrupted,
            "bytes changed",
            "A share of the bytes of messages is another byte: noise on a serial line.",
        ),
        "truncate": LinkFault(
            Parameter(unit="bytes", least=1, whole=True),
            _truncated,
            "bytes cut off",
            "The end is missing: the disk was full, or the program was killed.",
            count=lambda edits: edits[0][1] - edits[0][0],
        ),
        "thin": LinkFault(
            Parameter(unit="Hz", least=0.001, most=1000.0),
            _thinned,
            "messages left out",
            "One message comes at a lower rate than it was sent, as thin:ATTITUDE=4.",
        ),
    }
)
"""Every fault of the link by its name."""
