"""Bytes as vehicles send and recorders write them: packed by pymavlink, turned by SciPy, never by our own package."""

import hashlib
import struct
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import all as mavlink
from pymavlink.generator.mavcrc import x25crc
from scipy.spatial.transform import Rotation, RotationSpline

Array = NDArray[np.float64]
Seconds = float | NDArray[np.floating[Any]]

START_US = 1_700_000_000_000_000  # a record time, µs since 1970: 14 November 2023
ARDUPILOT, PX4, NO_AUTOPILOT = 3, 12, 8  # MAV_AUTOPILOT
QUADROTOR, GROUND_STATION = 2, 6  # MAV_TYPE


class Packed(NamedTuple):
    """A message that is sent a thousand times: its payload, in the order of the wire, and whose it is of pymavlink's.

    It goes where pymavlink's own messages go. `tests/test_helpers.py` holds its frames against theirs.
    """

    kind: Any
    payload: bytes

    def pack(self, sender: Any, force_mavlink1: bool = False) -> bytes:
        """The frame, as pymavlink's message makes it in three times as long."""
        start = (sender.seq, sender.srcSystem, sender.srcComponent)
        if force_mavlink1:
            head = _HEAD_1.pack(0xFE, len(self.payload), *start, self.kind.id) + self.payload
        else:
            payload = self.payload.rstrip(b"\0") or self.payload[:1]  # zeros at the end are not sent
            head = _HEAD_2.pack(0xFD, len(payload), 0, 0, *start, self.kind.id & 0xFFFF, self.kind.id >> 16) + payload
        frame = head + _CRC.pack(x25crc(b"%b%c" % (head[1:], self.kind.crc_extra)).crc)
        if not sender.signing.sign_outgoing or force_mavlink1:
            return frame
        return signed(frame, sender.signing.secret_key, time=sender.signing.timestamp, link=sender.signing.link_id)


_HEAD_1, _HEAD_2, _CRC = struct.Struct("<6B"), struct.Struct("<7BHB"), struct.Struct("<H")


def pack(
    message: Any, *, seq: int = 0, sysid: int = 1, compid: int = 1, version: int = 2, key: bytes | None = None
) -> bytes:
    """The frame of one of pymavlink's messages, or of a `Packed` one, signed with `key` where one is given."""
    sender = _sender(sysid, compid) if key is None else mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    sender.seq = seq % 256
    if key is not None:
        sender.signing.secret_key, sender.signing.sign_outgoing = key, True
    return bytes(message.pack(sender, force_mavlink1=version == 1))


@lru_cache(maxsize=500)
def _sender(sysid: int, compid: int) -> Any:
    return mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)


def heartbeat(*, autopilot: int = ARDUPILOT, vehicle: int = QUADROTOR, custom_mode: int = 0, **wire: Any) -> bytes:
    """HEARTBEAT; `wire` as for `pack`, here and below."""
    return pack(mavlink.MAVLink_heartbeat_message(vehicle, autopilot, 81, custom_mode, 4, 3), **wire)


def attitude(
    time_boot_ms: int, rpy_rad: Sequence[float] | Array, rates: Sequence[float] | Array = (0, 0, 0), **wire: Any
) -> bytes:
    """ATTITUDE of roll, pitch and yaw."""
    return pack(packed(mavlink.MAVLink_attitude_message, time_boot_ms % 2**32, *rpy_rad, *rates), **wire)


def packed(kind: Any, *values: Any) -> Packed:
    """A message of these values, in the order of the wire: the widest first, otherwise as they are declared."""
    return Packed(kind, kind.unpacker.pack(*values))


def attitude_quaternion(
    time_boot_ms: int,
    wxyz: Sequence[float] | Array,
    rates: Sequence[float] | Array = (0, 0, 0),
    repr_offset_q: Sequence[float] = (0, 0, 0, 0),
    **wire: Any,
) -> bytes:
    """ATTITUDE_QUATERNION of [w, x, y, z]."""
    kind = mavlink.MAVLink_attitude_quaternion_message
    return pack(packed(kind, time_boot_ms % 2**32, *wxyz, *rates, *repr_offset_q), **wire)


def ahrs2(rpy_rad: Sequence[float] | Array, **wire: Any) -> bytes:
    """AHRS2 of roll, pitch and yaw."""
    return pack(packed(mavlink.MAVLink_ahrs2_message, *rpy_rad, 0, 0, 0), **wire)


def with_checksum(frame: bytes, crc_extra: int) -> bytes:
    """An unsigned frame with the checksum that its bytes ask for, by pymavlink's own x25crc."""
    return frame[:-2] + struct.pack("<H", x25crc(frame[1:-2] + bytes([crc_extra])).crc)


def signed(frame: bytes, key: bytes, *, time: int, link: int = 0) -> bytes:
    """An unsigned frame of MAVLink 2, signed at `time`, in units of 10 µs since 2015, as sender of a link id."""
    crc_extra = mavlink.mavlink_map[int.from_bytes(frame[7:10], "little")].crc_extra
    marked = with_checksum(frame[:2] + b"\x01" + frame[3:], crc_extra)
    whole = marked + bytes([link]) + time.to_bytes(6, "little")
    return whole + hashlib.sha256(key + whole).digest()[:6]


def record(t_us: int, frame: bytes) -> bytes:
    """One record of a .tlog."""
    return struct.pack(">Q", t_us) + frame


def tlog(records: Iterable[tuple[int, bytes]]) -> bytes:
    """A .tlog of (record time, frame)."""
    return b"".join(record(t_us, frame) for t_us, frame in records)


def wxyz(rotation: Rotation) -> Array:
    """SciPy's rotation as [w, x, y, z], shape (..., 4)."""
    q: Array = rotation.as_quat()[..., [3, 0, 1, 2]]
    return q


class Motion:
    """A vehicle that turns smoothly at random: attitude (FRD to NED) and body rates at any time up to `seconds`.

    Its body rates are continuous and so is their change; `speed_rad_s` is the typical rate.
    """

    def __init__(self, seconds: float, *, seed: int = 0, speed_rad_s: float = 0.5) -> None:
        self._spline = _spline(seconds, seed, speed_rad_s)

    def rotation(self, t_s: Seconds) -> Rotation:
        return self._spline(t_s)

    def wxyz(self, t_s: Seconds) -> Array:
        return wxyz(self._spline(t_s))

    def rpy(self, t_s: Seconds) -> Array:
        rpy: Array = self._spline(t_s).as_euler("ZYX")[..., ::-1]
        return rpy

    def rates(self, t_s: Seconds) -> Array:
        """Angular rate in body axes, rad/s."""
        w: Array = self._spline(t_s, 1)
        return w


@lru_cache(maxsize=50)
def _spline(seconds: float, seed: int, speed_rad_s: float) -> RotationSpline:
    knots = np.arange(0.0, seconds + 1.0, 0.5)
    steps = np.random.default_rng(seed).normal(0.0, 0.5 * speed_rad_s / np.sqrt(3.0), (len(knots), 3))
    turned = [Rotation.identity()]
    for step in Rotation.from_rotvec(steps[1:]):
        turned.append(turned[-1] * step)
    return RotationSpline(knots, Rotation.concatenate(turned))


def flight(
    motion: Motion,
    seconds: float,
    *,
    euler_hz: float = 25.0,
    quaternion_hz: float = 25.0,
    start_us: int = START_US,
    boot_ms: int = 10_000,
    first_seq: int = 0,
    **wire: Any,
) -> list[tuple[int, bytes]]:
    """(record time, frame) of a healthy vehicle: a heartbeat a second and both attitudes, in order of time.

    The boot clock stands at `boot_ms` where the record time is `start_us`; every stamp is a whole millisecond.
    """
    ticks: list[tuple[int, int]] = [(int(1000 * s), 0) for s in range(int(np.ceil(seconds)))]
    for kind, hz in ((1, euler_hz), (2, quaternion_hz)):
        if hz:
            ticks += [(round(1000 * i / hz), kind) for i in range(int(seconds * hz))]
    ticks.sort()
    t_s = np.array([ms for ms, _ in ticks]) / 1000.0
    rotation = motion.rotation(t_s)
    rpy, q, rates = rotation.as_euler("ZYX")[:, ::-1].tolist(), wxyz(rotation).tolist(), motion.rates(t_s).tolist()
    records = []
    for i, (ms, kind) in enumerate(ticks):
        if kind == 0:
            frame = heartbeat(seq=first_seq + i, **wire)
        elif kind == 1:
            frame = attitude(boot_ms + ms, rpy[i], rates[i], seq=first_seq + i, **wire)
        else:
            frame = attitude_quaternion(boot_ms + ms, q[i], rates[i], seq=first_seq + i, **wire)
        records.append((start_us + 1000 * ms, frame))
    return records


def records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """(record time, frame) of an undamaged recording."""
    at = 0
    while at < len(data):
        start = at + 8
        overhead = 8 if data[start] == 0xFE else 25 if data[start + 2] & 1 else 12
        stop = start + overhead + data[start + 1]
        yield struct.unpack(">Q", data[at:start])[0], data[start:stop]
        at = stop


def messages(data: bytes, *names: str) -> Iterator[tuple[int, int, Any]]:
    """(number of the record, record time, pymavlink's message) of an undamaged recording, of these names alone.

    The others are not decoded: that takes most of the time.
    """
    wanted = {getattr(mavlink, f"MAVLINK_MSG_ID_{name}") for name in names}
    parser = mavlink.MAVLink(None)
    for number, (t_us, frame) in enumerate(records(data)):
        if (frame[5] if frame[0] == 0xFE else int.from_bytes(frame[7:10], "little")) in wanted:
            yield number, t_us, parser.decode(bytearray(frame))
