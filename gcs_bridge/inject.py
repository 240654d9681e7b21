"""Put a known fault into a recording: a mistake of the causes' table, or a fault of the link.

A fault is a set of edits, each of which replaces some bytes; every other byte stays as it was, damage included. What a
fault may touch are the records (time and frame) whose checksum is right. Several faults are made one after the other,
each in what the one before left.

A falsified frame gets its checksum anew, and in MAVLink 2 a payload without trailing zeros, as that version demands.
Sequence numbers are never changed: what `loss` and `thin` leave out is missing there too. A signed frame can't be
signed again without the key: falsified, it loses its signature and the flag that announces it.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.causes import CAUSES, Cause, Parameter, Value
from gcs_bridge.errors import GcsBridgeError, SourceError, UsageError
from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect, Message, load_dialect
from gcs_bridge.mavlink.scan import Bytes, Frames, Scanner, frame_crc
from gcs_bridge.report.output import refuse_unwritable, write_file

__all__ = [
    "LINK_FAULTS",
    "Fault",
    "LinkFault",
    "Made",
    "StreamAbsentError",
    "inject",
    "inject_file",
    "parse_fault",
    "scope_text",
]


class StreamAbsentError(GcsBridgeError):
    """The recording is good, but what should be falsified is not in it."""

    exit_code: ClassVar[int] = 4


@dataclass(frozen=True)
class Fault:
    """A fault to be made: its name, its value in the unit of its row, and for `thin` the message.

    Raises UsageError where there is no such fault; values are looked at by `parse_fault` alone.
    """

    name: str
    value: Value
    message: str | None = None

    def __post_init__(self) -> None:
        _parameter(self.name)

    def __str__(self) -> str:
        """As `parse_fault` takes it, with the value that a default stands for.

        >>> print(parse_fault("yaw_offset"), parse_fault("thin:attitude=4"))
        yaw_offset:12 thin:ATTITUDE=4
        """
        numbers = ",".join(f"{number:.12g}" for number in self.value)
        message = f"{self.message}=" if self.message else ""
        return f"{self.name}:{message}{numbers}" if numbers else self.name


class Made(NamedTuple):
    """A fault that was made: the number of messages (or of bytes, as `became` says), and what became of them."""

    fault: Fault
    number: int
    became: str


def parse_fault(text: str) -> Fault:
    """The fault that `NAME` (with its default value), `NAME:VALUE` or `thin:MESSAGE=HZ` asks for.

    Raises UsageError for an unknown name, with the nearest right one, and for a value that is wrong or out of range.

    >>> parse_fault("mount_offset:0,4,0")
    Fault(name='mount_offset', value=(0.0, 4.0, 0.0), message=None)
    >>> parse_fault("thin:ATTITUDE=10")
    Fault(name='thin', value=(10.0,), message='ATTITUDE')
    """
    name, colon, rest = text.partition(":")
    parameter = _parameter(name)
    message = None
    if name == "thin":
        message, equals, rest = rest.partition("=")
        if not (message and equals):
            raise UsageError(f"the fault thin cannot take {text!r}: it must be as thin:ATTITUDE_QUATERNION=10")
        message = message.upper()
    return Fault(name, parameter.parse(name, rest if colon else None), message)


def inject(
    data: bytes,
    faults: Sequence[Fault],
    *,
    dialect: str = "all",
    sysid: int | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    seed: int = 0,
) -> bytes:
    """The recording `data` (a .tlog's bytes) with the faults in it, made in their order.

    `sysid` restricts them to one system. `from_s` and `to_s` are seconds after the first record's time: records in
    [from_s, to_s) are touched. `truncate` alone knows neither. What is left to chance is the same for the same `seed`.

    Several faults in one call are the same as one call each, on what the one before left; only seconds count from the
    first of all records here.

    Raises UsageError for a dialect, message or interval that can't be, SourceError where no frame is valid, and
    StreamAbsentError where there is nothing to falsify.
    """
    return _injected(data, faults, dialect=dialect, sysid=sysid, from_s=from_s, to_s=to_s, seed=seed)[0]


def _injected(
    data: bytes,
    faults: Sequence[Fault],
    *,
    dialect: str,
    sysid: int | None,
    from_s: float | None,
    to_s: float | None,
    seed: int,
) -> tuple[bytes, list[Made]]:
    """As `inject`, with what was made."""
    try:
        table = load_dialect(dialect)
    except ValueError as error:
        raise UsageError(str(error)) from None
    records = _records(data, table)
    if not len(records.frames):
        raise SourceError("not one valid MAVLink frame: this is no telemetry recording with record times (.tlog)")
    scope = _scope(records.frames, sysid=sysid, from_s=from_s, to_s=to_s)
    made = []
    for fault in faults:
        edits = sorted(_edits(records, scope, fault, np.random.default_rng(seed)))
        link = LINK_FAULTS.get(fault.name)
        made.append(Made(fault, link.count(edits) if link else len(edits), link.became if link else "messages changed"))
        data = _spliced(data, edits)
        records = _records(data, table)
    return data, made


def inject_file(
    source: Path,
    target: Path,
    faults: Sequence[Fault],
    *,
    dialect: str = "all",
    sysid: int | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    seed: int = 0,
) -> list[Made]:
    """Write a copy of the recording `source` with the faults in it to `target`, as a whole or not at all.

    The arguments and errors are those of `inject`; a `source` that can't be read is a SourceError, a `target` that
    can't be written, or is the source itself, a UsageError. Returns what was made, fault by fault.
    """
    refuse_unwritable(target, sources=[source])
    try:
        data = source.read_bytes()
    except OSError as error:
        raise SourceError(f"{source}: cannot be read: {error.strerror}") from None
    try:
        falsified, made = _injected(data, faults, dialect=dialect, sysid=sysid, from_s=from_s, to_s=to_s, seed=seed)
    except GcsBridgeError as error:
        raise type(error)(f"{source}: {error}") from None
    write_file(falsified, target)
    return made


# --- what may be touched -------------------------------------------------------------------------------------------

_LARGEST = 2**31 - 1  # bytes that a scanned piece may have


@dataclass(frozen=True)
class _Records:
    """Records of `data`, one a row: bytes [start, stop) hold the time, or what is left of it, and the frame."""

    data: bytes
    buffer: Bytes
    dialect: Dialect
    frames: Frames
    start: npt.NDArray[np.int64]
    stop: npt.NDArray[np.int64]

    def where(self, rows: npt.NDArray[Any]) -> _Records:
        """Some of the records."""
        return replace(self, frames=self.frames[rows], start=self.start[rows], stop=self.stop[rows])

    def frame(self, row: int) -> tuple[int, int]:
        """Where a frame begins and ends."""
        return int(self.frames["offset"][row]), int(self.stop[row])


def _records(data: bytes, dialect: Dialect) -> _Records:
    if len(data) > _LARGEST:
        raise SourceError(f"too large: a fault can be put into recordings of up to {_LARGEST} bytes")
    scanner = Scanner(dialect, timed=True)
    frames = scanner.scan(data, final=True)
    at = frames["offset"]
    signed = (scanner.buffer[at] == 0xFD) & (scanner.buffer[at + 2] & 1 == 1)
    stop = frames["payload"].astype(np.int64) + frames["length"] + np.where(signed, 15, 2)
    # A frame found behind damage may have lost part of its time.
    start = np.maximum(at - 8, np.concatenate([[0], stop[:-1]]))
    return _Records(data, scanner.buffer, dialect, frames, start, stop)


class _Scope(NamedTuple):
    """Which records may be touched: of one system or of any, received in [begin_us, end_us); `text` says so."""

    sysid: int | None
    begin_us: float
    end_us: float
    text: str

    def holds(self, frames: Frames) -> npt.NDArray[np.bool_]:
        t_us = frames["t_rx_us"]
        inside = (t_us >= self.begin_us) & (t_us < self.end_us)
        return inside & (frames["sysid"] == self.sysid) if self.sysid is not None else inside


def _scope(frames: Frames, *, sysid: int | None, from_s: float | None, to_s: float | None) -> _Scope:
    """The arguments as one value; seconds count from the first record, whatever a fault does to it later."""
    for name, seconds in (("from", from_s), ("to", to_s)):
        if seconds is not None and not (math.isfinite(seconds) and seconds >= 0):
            raise UsageError(f"{name} {seconds:g} s: must be seconds after the recording's start, 0 or more")
    if to_s is not None and to_s <= (from_s or 0.0):
        raise UsageError(f"to {to_s:g} s is not after from {from_s or 0.0:g} s: nothing would be falsified")
    t_us = frames["t_rx_us"]
    first_us = int(t_us[np.argmax(t_us > 0)])  # 0: damage took the time
    lasts_s = (int(t_us.max()) - first_us) / 1e6
    if from_s is not None and from_s > lasts_s:
        raise UsageError(f"from {from_s:g} s is past the end: the recording lasts {lasts_s:g} s")
    text = scope_text(sysid=sysid, from_s=from_s, to_s=to_s)
    begin_us = -math.inf if from_s is None else first_us + round(from_s * 1e6)
    end_us = math.inf if to_s is None else first_us + round(to_s * 1e6)
    return _Scope(sysid, begin_us, end_us, text)


def scope_text(*, sysid: int | None, from_s: float | None, to_s: float | None) -> str:
    """The words for which records are touched, with a space before them; none for all."""
    return "".join(
        [
            f" of system {sysid}" if sysid is not None else "",
            f" from {from_s:g} s on" if from_s is not None else "",
            f" up to {to_s:g} s" if to_s is not None else "",
        ]
    )


# --- edits ---------------------------------------------------------------------------------------------------------

_Edit = tuple[int, int, bytes]  # bytes [start, stop) are replaced; the edits of a fault don't overlap


def _spliced(data: bytes, edits: Sequence[_Edit]) -> bytes:
    """The data with the edits, which are in the order of their places."""
    pieces = []
    at = 0
    for start, stop, new in edits:
        pieces += [data[at:start], new]
        at = stop
    return b"".join([*pieces, data[at:]])


def _edits(records: _Records, scope: _Scope, fault: Fault, chance: np.random.Generator) -> Iterable[_Edit]:
    """What the fault does to the records in the scope."""
    if fault.name == "truncate":
        return _truncated(records, fault, chance)
    touched = records.where(scope.holds(records.frames))
    message = _message(fault)
    if message is not None:
        if message not in records.dialect:
            raise UsageError(f"the dialect {records.dialect.name} has no message {message!r}")
        touched = touched.where(touched.frames["msgid"] == records.dialect[message].msgid)
    if not len(touched.frames):
        raise StreamAbsentError(f"no {message or 'record'}{scope.text} in the recording: nothing to falsify")
    if fault.name in LINK_FAULTS:
        return LINK_FAULTS[fault.name].edits(touched, fault, chance)
    return _falsified(touched, records.dialect[message or ""], CAUSES[fault.name], fault.value)


def _message(fault: Fault) -> str | None:
    """The one message that the fault touches, None: all."""
    if fault.name in LINK_FAULTS:
        return fault.message
    return {30: "ATTITUDE", 31: "ATTITUDE_QUATERNION"}[CAUSES[fault.name].message or 0]


def _components(frames: Frames) -> Iterator[npt.NDArray[np.int64]]:
    """The rows of each (system, component), in the order of the recording."""
    key = frames["sysid"].astype(np.int64) << 8 | frames["compid"]
    for component in np.unique(key):
        yield np.flatnonzero(key == component)


# --- causes: payloads falsified ------------------------------------------------------------------------------------

_FIELDS = {"quaternion": ("q1", "q2", "q3", "q4"), "rpy": ("roll", "pitch", "yaw")}


def _falsified(records: _Records, message: Message, cause: Cause, value: Value) -> Iterator[_Edit]:
    """The frames of records of one message as the faulty side sends them."""
    should_be = decode(records.buffer, records.frames, message)
    sent = should_be.copy()
    for rows in _components(records.frames):
        sent[rows] = _sent(cause, value, should_be[rows])
    changed = should_be.view((np.void, should_be.itemsize)) != sent.view((np.void, sent.itemsize))
    for row in np.flatnonzero(changed).tolist():
        yield *records.frame(row), _reframed(records, row, sent[row].tobytes(), message.crc_extra)


def _sent(cause: Cause, value: Value, should_be: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The fields of one component's messages, falsified; rates stay as they are."""
    assert cause.falsify is not None  # or there were no such Fault
    if cause.acts_on == "payload":
        sent = cause.falsify(should_be, value)
        sent["time_boot_ms"] = should_be["time_boot_ms"]
        return sent
    sent = should_be.copy()
    if cause.acts_on == "time":
        sent["time_boot_ms"] = cause.falsify(should_be["time_boot_ms"].astype(np.float64), value) % 2**32
        return sent
    fields = _FIELDS[cause.acts_on or ""]
    samples = np.stack([should_be[field] for field in fields], axis=-1).astype(np.float64)
    falsified = cause.falsify(samples, value)
    falsified = np.where(np.isnan(falsified), samples, falsified)  # what is no attitude is sent as it was
    with np.errstate(over="ignore"):  # damage may be as large as a float32 can be
        for field, column in zip(fields, falsified.T, strict=True):
            sent[field] = column
    return sent


def _reframed(records: _Records, row: int, fields: bytes, crc_extra: int) -> bytes:
    """The frame in `row` with other fields: payload, length and checksum as they must be, and no signature."""
    begin, _ = records.frame(row)
    payload_at = int(records.frames["payload"][row])
    length = int(records.frames["length"][row])
    payload = fields + records.data[payload_at + len(fields) : payload_at + length]  # what a newer dialect appended
    head = bytearray(records.data[begin:payload_at])
    if head[0] == 0xFD:
        payload = payload.rstrip(b"\0") or b"\0"
        head[2] &= ~1
    else:
        payload = payload[:length]
    head[1] = len(payload)
    frame = bytes(head) + payload
    crc = frame_crc(np.frombuffer(frame, np.uint8), 1, len(frame), crc_extra)
    return frame + int(crc).to_bytes(2, "little")


# --- faults of the link --------------------------------------------------------------------------------------------

_Edits = Callable[[_Records, Fault, np.random.Generator], Iterable[_Edit]]


@dataclass(frozen=True)
class LinkFault:
    """A fault of the link rather than of a message: what its value may be, what it does, and what that looks like."""

    parameter: Parameter
    edits: _Edits
    became: str
    origin: str
    count: Callable[[Sequence[_Edit]], int] = len


def _count(share: float, of: int) -> int:
    """The share as a number; a fault that is asked for happens at least once."""
    return max(round(share * of), int(share > 0))


def _some(records: _Records, share: float, chance: np.random.Generator) -> list[int]:
    n = len(records.frames)
    return chance.choice(n, _count(share, n), replace=False).tolist()  # type: ignore[no-any-return]  # untyped in numpy


def _without(records: _Records, rows: Iterable[int]) -> Iterator[_Edit]:
    for row in rows:
        yield int(records.start[row]), int(records.stop[row]), b""


def _lost(records: _Records, fault: Fault, chance: np.random.Generator) -> Iterable[_Edit]:
    return _without(records, _some(records, fault.value[0], chance))


def _duplicated(records: _Records, fault: Fault, chance: np.random.Generator) -> Iterator[_Edit]:
    for row in _some(records, fault.value[0], chance):
        begin, end = records.frame(row)
        time = int(records.frames["t_rx_us"][row]).to_bytes(8, "big")
        yield end, end, time + records.data[begin:end]


def _reordered(records: _Records, fault: Fault, chance: np.random.Generator) -> Iterator[_Edit]:
    """A share of each system's frames changes places with the next one; record times stay in order."""
    systems = records.frames["sysid"]
    for system in np.unique(systems):
        rows = np.flatnonzero(systems == system)
        pairs = min(_count(fault.value[0], rows.size), rows.size // 2)
        # Pairs that don't touch: places among those left when each pair counts as one.
        places = np.sort(chance.choice(rows.size - pairs, pairs, replace=False)) + np.arange(pairs)
        for one, other in zip(rows[places], rows[places + 1], strict=True):
            (begin, end), (next_begin, next_end) = records.frame(one), records.frame(other)
            yield begin, end, records.data[next_begin:next_end]
            yield next_begin, next_end, records.data[begin:end]


def _corrupted(records: _Records, fault: Fault, chance: np.random.Generator) -> Iterator[_Edit]:
    """A share of the bytes of frames becomes other bytes."""
    begin = records.frames["offset"]
    size = records.stop - begin
    first = np.cumsum(size) - size  # of each frame, as if frames stood end to end
    total = int(size.sum())
    hit = chance.choice(total, _count(fault.value[0], total), replace=False)
    row = np.searchsorted(first, hit, side="right") - 1
    places = begin[row] + hit - first[row]
    other = records.buffer[places] ^ chance.integers(1, 256, hit.size, dtype=np.uint8)
    for at, byte in zip(places.tolist(), other.tolist(), strict=True):
        yield at, at + 1, bytes([byte])


def _truncated(records: _Records, fault: Fault, _: np.random.Generator) -> list[_Edit]:
    size, cut = len(records.data), int(fault.value[0])
    if cut >= size:
        raise UsageError(f"truncate:{cut} would leave nothing: the recording has {size} bytes")
    return [(size - cut, size, b"")]


_REBOOT_US = 5e6  # time that falls by more: a reboot; by less: a message that came late


def _thinned(records: _Records, fault: Fault, _: np.random.Generator) -> Iterable[_Edit]:
    """One message a period of each component, by the message's own time where it has one."""
    period_us = 1e6 / fault.value[0]
    time_us = _message_time_us(records, records.dialect[fault.message or ""])
    dropped = []
    for rows in _components(records.frames):
        # Periods are centred on the first message, so that jitter at the very rate drops nothing.
        period = np.floor((time_us[rows] - time_us[rows[0]]) / period_us + 0.5)
        kept_period = kept_us = -math.inf
        for row, now, now_us in zip(rows.tolist(), period.tolist(), time_us[rows].tolist(), strict=True):
            if now > kept_period or now_us < kept_us - _REBOOT_US:
                kept_period, kept_us = now, now_us
            else:
                dropped.append(row)
    return _without(records, dropped)


def _message_time_us(records: _Records, message: Message) -> npt.NDArray[np.float64]:
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


def _parameter(name: str) -> Parameter:
    """What the value of the fault `name` may be; UsageError where there is no such fault."""
    known = {name: fault.parameter for name, fault in LINK_FAULTS.items()}
    known |= {cause.name: cause.parameter for cause in CAUSES.values() if cause.falsify is not None}
    if name in known:
        return known[name]
    if name in CAUSES:
        raise UsageError(f"{name} can be diagnosed but not injected")
    near = difflib.get_close_matches(name.lower(), known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
    raise UsageError(f"unknown fault {name!r}; {hint}")
