"""The records of a recording, and edits of them: frames falsified and framed anew."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude import rpy_from_quaternion
from gcs_bridge.diagnosis.mistake import Cause, Value
from gcs_bridge.errors import SourceError, UsageError
from gcs_bridge.mavlink.checksum import frame_crc
from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect, Message
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.mavlink.scanner import Scanner, ends_of

# --- what may be touched -------------------------------------------------------------------------------------------

_LARGEST = 2**31 - 1  # bytes that a scanned piece may have


@dataclass(frozen=True)
class RecordingFrames:
    """Records of `data`, one a row: bytes [start, stop) hold the time, or what is left of it, and the frame."""

    data: bytes
    buffer: Bytes
    dialect: Dialect
    frames: Frames
    start: npt.NDArray[np.int64]
    stop: npt.NDArray[np.int64]

    def where(self, rows: npt.NDArray[Any]) -> RecordingFrames:
        """Some of the records."""
        return replace(self, frames=self.frames[rows], start=self.start[rows], stop=self.stop[rows])

    def frame(self, row: int) -> tuple[int, int]:
        """Where a frame begins and ends."""
        return int(self.frames["offset"][row]), int(self.stop[row])


def frames_in(data: bytes, dialect: Dialect) -> RecordingFrames:
    """The records of a whole recording; SourceError where it is too large."""
    if len(data) > _LARGEST:
        raise SourceError(f"too large: a fault can be put into recordings of up to {_LARGEST} bytes")
    scanner = Scanner(dialect, timed=True)
    frames = scanner.scan(data, final=True)
    stop = ends_of(frames)
    # A frame found behind damage may have lost part of its time.
    start = np.maximum(frames["offset"] - 8, np.concatenate([[0], stop[:-1]]))
    return RecordingFrames(data, scanner.buffer, dialect, frames, start, stop)


class Scope(NamedTuple):
    """Which records may be touched: of one system or of any, received in [begin_us, end_us); `text` says so."""

    sysid: int | None
    begin_us: float
    end_us: float
    text: str

    def holds(self, frames: Frames) -> npt.NDArray[np.bool_]:
        """Which of the frames are in it."""
        t_us = frames["t_rx_us"]
        inside = (t_us >= self.begin_us) & (t_us < self.end_us)
        return inside & (frames["sysid"] == self.sysid) if self.sysid is not None else inside


def scope_of(frames: Frames, *, sysid: int | None, from_s: float | None, to_s: float | None) -> Scope:
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
    return Scope(sysid, begin_us, end_us, text)


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

Edit = tuple[int, int, bytes]  # bytes [start, stop) are replaced; the edits of a fault don't overlap


def spliced(data: bytes, edits: Sequence[Edit]) -> bytes:
    """The data with the edits, which are in the order of their places."""
    pieces = []
    at = 0
    for start, stop, new in edits:
        pieces += [data[at:start], new]
        at = stop
    return b"".join([*pieces, data[at:]])


def components(frames: Frames) -> Iterator[npt.NDArray[np.int64]]:
    """The rows of each (system, component), in the order of the recording."""
    key = frames["sysid"].astype(np.int64) << 8 | frames["compid"]
    for component in np.unique(key):
        yield np.flatnonzero(key == component)


# --- causes: payloads falsified ------------------------------------------------------------------------------------

_FIELDS = {"quaternion": ("q1", "q2", "q3", "q4"), "rpy": ("roll", "pitch", "yaw")}
_RATES: Sequence[str] = ("rollspeed", "pitchspeed", "yawspeed")


def falsified(records: RecordingFrames, message: Message, cause: Cause, value: Value) -> Iterator[Edit]:
    """The frames of records of one message as the faulty side sends them."""
    should_be = decode(records.buffer, records.frames, message)
    sent = should_be.copy()
    for rows in components(records.frames):
        sent[rows] = _sent(cause, value, should_be[rows])
    changed = should_be.view((np.void, should_be.itemsize)) != sent.view((np.void, sent.itemsize))
    for row in np.flatnonzero(changed).tolist():
        yield *records.frame(row), _reframed(records, row, sent[row].tobytes(), message.crc_extra)


def _sent(cause: Cause, value: Value, should_be: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The fields of one component's messages, falsified; rates stay as they are, unless the mistake is about them."""
    assert cause.falsify is not None  # or there were no such Fault
    if cause.acts_on == "payload":
        sent = cause.falsify(should_be, value)
        sent["time_boot_ms"] = should_be["time_boot_ms"]
        return sent
    sent = should_be.copy()
    if cause.acts_on == "time":
        sent["time_boot_ms"] = cause.falsify(should_be["time_boot_ms"].astype(np.float64), value) % 2**32
        return sent
    if cause.acts_on == "rates":
        fields = _RATES
        samples = np.concatenate([_rpy(should_be), _columns(should_be, fields)], axis=-1)
        samples, falsified = samples[:, 3:], cause.falsify(samples, value)[:, 3:]
    else:
        fields = _FIELDS[cause.acts_on or ""]
        samples = _columns(should_be, fields)
        falsified = cause.falsify(samples, value)
    falsified = np.where(np.isnan(falsified), samples, falsified)  # what is no attitude is sent as it was
    with np.errstate(over="ignore"):  # damage may be as large as a float32 can be
        for field, column in zip(fields, falsified.T, strict=True):
            sent[field] = column
    return sent


def _columns(messages: npt.NDArray[np.void], fields: Sequence[str]) -> npt.NDArray[np.float64]:
    """Some fields of messages (n,), a column each."""
    return np.stack([messages[field] for field in fields], axis=-1).astype(np.float64)


def _rpy(messages: npt.NDArray[np.void]) -> npt.NDArray[np.float64]:
    """Roll, pitch and yaw (n, 3), rad, of either attitude message."""
    if "roll" in (messages.dtype.names or ()):
        return _columns(messages, _FIELDS["rpy"])
    return rpy_from_quaternion(_columns(messages, _FIELDS["quaternion"]))


def _reframed(records: RecordingFrames, row: int, fields: bytes, crc_extra: int) -> bytes:
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
    frame = head + payload
    crc = frame_crc(np.frombuffer(frame, np.uint8), 1, len(frame), crc_extra)
    return bytes(frame) + int(crc).to_bytes(2, "little")
