"""Payloads to fields, against pymavlink's own unpacking: every message, every field, truncated or not."""

import math
import random
import struct
from collections import defaultdict
from functools import cache
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES

USED = [
    "HEARTBEAT",
    "SYSTEM_TIME",
    "PARAM_VALUE",
    "RAW_IMU",
    "SCALED_IMU",
    "SCALED_IMU2",
    "SCALED_IMU3",
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "HIGHRES_IMU",
    "AHRS2",
    "STATUSTEXT",
]
EVERY = sorted(message.msgname for message in mavlink.mavlink_map.values())
CLASS = {message.msgname: message for message in mavlink.mavlink_map.values()}


def decoded(data: bytes, name: str, *, timed: bool = False) -> np.ndarray:
    """All messages `name` in `data`, by the package."""
    scanner = Scanner(load_dialect(), timed=timed)
    frames = scanner.scan(data, final=True)
    message = load_dialect()[name]
    return decode(scanner.buffer, frames[frames["msgid"] == message.msgid], message)


def theirs(message: Any, name: str) -> Any:
    """A field of pymavlink's message as a plain value: text as bytes without the zeros behind it."""
    value = getattr(message, name)
    return value.encode("latin-1") if isinstance(value, str) else value


def assert_same(row: np.void, message: Any) -> None:
    """Field for field; floats bit for bit, as both read the same four bytes."""
    assert set(row.dtype.names or ()) == set(message.fieldnames)
    for name in message.fieldnames:
        ours, expected = row[name], theirs(message, name)
        if isinstance(expected, bytes):
            assert bytes(ours) == expected.rstrip(b"\0"), name
        else:
            kind = np.asarray(ours).dtype
            assert np.asarray(ours).tobytes() == np.asarray(expected, kind).tobytes(), name


@cache
def messages(name: str) -> dict[str, list[Any]]:
    """A fixture's messages by name, read by pymavlink."""
    data = (FIXTURES / f"{name}.tlog").read_bytes()
    parser = mavlink.MAVLink(None)
    by_name = defaultdict(list)
    at = 0
    while at < len(data):
        size = (12 + 13 * (data[at + 10] & 1) if data[at + 8] == 0xFD else 8) + data[at + 9]
        message = parser.decode(bytearray(data[at + 8 : at + 8 + size]))
        by_name[message.get_type()].append(message)
        at += 8 + size
    return by_name


@pytest.mark.parametrize("name", USED)
@pytest.mark.parametrize(
    "fixture", one_in(2, ["k1_copter_trim", "p_px4_quad_square", "g_mavlink1", "g_signed"], swept=False)
)
def test_recorded_messages_have_pymavlinks_values(fixture: str, name: str) -> None:
    """Every used message of real autopilots, PX4's and ArduPilot's, MAVLink 1, 2 and signed."""
    rows = decoded((FIXTURES / f"{fixture}.tlog").read_bytes(), name, timed=True)
    expected = messages(fixture)[name]
    assert len(rows) == len(expected)
    for row, message in zip(rows, expected, strict=True):
        assert_same(row, message)


def random_value(dice: random.Random, wire_type: str) -> Any:
    if wire_type == "char":
        return bytes([dice.randrange(33, 127)])
    if wire_type in ("float", "double"):
        return struct.unpack("<f", struct.pack("<f", dice.uniform(-1e6, 1e6)))[0]
    bits = 8 * struct.calcsize({"8": "b", "16": "h", "32": "i", "64": "q"}[wire_type.strip("uint_")])
    return dice.randrange(2**bits) if wire_type.startswith("u") else dice.randrange(-(2 ** (bits - 1)), 2 ** (bits - 1))


def random_message(dice: random.Random, name: str) -> Any:
    """pymavlink's message with random values in all fields."""
    message = CLASS[name]
    counts = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    values: list[Any] = []
    for field, wire_type in zip(message.fieldnames, message.fieldtypes, strict=True):
        count = counts[field]
        if wire_type == "char":
            values.append(b"".join(random_value(dice, wire_type) for _ in range(max(count, 1))))
        elif count:
            values.append([random_value(dice, wire_type) for _ in range(count)])
        else:
            values.append(random_value(dice, wire_type))
    return message(*values)


@pytest.mark.parametrize("first", range(0, len(EVERY), 60))
def test_every_message_of_the_dialect_has_pymavlinks_layout(first: int) -> None:
    """Packed by pymavlink with random values, each message has the same value in the same field, extensions too."""
    for name in EVERY[first : first + 60]:
        message = random_message(random.Random(name), name)
        (row,) = decoded(wire.pack(message), name)
        for field in message.fieldnames:
            expected = getattr(message, field)
            if isinstance(expected, bytes):
                assert bytes(row[field]) == expected, f"{name}.{field}"
            else:
                kind = np.asarray(row[field]).dtype
                assert np.asarray(row[field]).tobytes() == np.asarray(expected, kind).tobytes(), f"{name}.{field}"


def test_the_dialect_knows_every_message_and_no_other() -> None:
    """Ids, checksum seeds and lengths are pymavlink's."""
    tables = load_dialect().tables
    known = {msgid for msgid in range(len(tables.row_of_id)) if tables.row_of_id[msgid] >= 0}
    assert known == set(mavlink.mavlink_map)
    for msgid, message in mavlink.mavlink_map.items():
        ours = load_dialect()[message.msgname]
        assert (ours.msgid, ours.crc_extra, ours.dtype.itemsize) == (msgid, message.crc_extra, message.unpacker.size)
        assert tables.crc_extra[tables.row_of_id[msgid]] == message.crc_extra


@pytest.mark.parametrize("name", ["minimal", "common", "ardupilotmega"])
def test_another_dialect_is_read_from_its_own_tables(name: str) -> None:
    """A smaller dialect knows fewer messages; ATTITUDE is no part of `minimal`."""
    dialect = load_dialect(name)
    assert "HEARTBEAT" in dialect
    assert ("ATTITUDE" in dialect) == (name != "minimal")


@pytest.mark.parametrize("name", ["nonsense", "__init__", "", "../common", "common.x"])
def test_an_unknown_dialect_is_a_value_error(name: str) -> None:
    """Whatever a user may type: pymavlink has no such dialect, and the error says so."""
    with pytest.raises(ValueError, match="unknown dialect"):
        load_dialect(name)


@pytest.mark.parametrize("name", USED)
def test_what_the_wire_cut_off_is_zero(name: str) -> None:
    """MAVLink 2 cuts trailing zero bytes wherever they begin, in the middle of a field too."""
    message = CLASS[name]
    dice = random.Random(name)
    for kept in range(1, message.unpacker.size + 1):
        payload = bytes(dice.choices(range(1, 256), k=kept))
        head = struct.pack("<BBBBBBB", 0xFD, kept, 0, 0, 0, 1, 1) + message.id.to_bytes(3, "little")
        (row,) = decoded(wire.with_checksum(head + payload + b"\0\0", message.crc_extra), name)
        assert row.tobytes() == payload.ljust(message.unpacker.size, b"\0")


def test_the_identity_attitude_at_rest_is_eight_bytes() -> None:
    """q = (1, 0, 0, 0) at boot time 513 ms: all behind q1 is cut off, and is zero again."""
    frame = wire.attitude_quaternion(513, (1, 0, 0, 0))
    assert frame[1] == 8
    (row,) = decoded(frame, "ATTITUDE_QUATERNION")
    assert row["time_boot_ms"] == 513
    assert [row[f"q{i}"] for i in (1, 2, 3, 4)] == [1, 0, 0, 0]
    assert [row[f"{axis}speed"] for axis in ("roll", "pitch", "yaw")] == [0, 0, 0]
    assert row["repr_offset_q"].tolist() == [0, 0, 0, 0]


def test_zeros_that_were_not_cut_off_change_nothing() -> None:
    """A sender may leave its trailing zeros: the same values."""
    short = wire.attitude_quaternion(513, (1, 0, 0, 0))
    long = wire.with_checksum(bytes([0xFD, 48]) + short[2:18] + bytes(40) + b"\0\0", 246)
    assert decoded(long, "ATTITUDE_QUATERNION").tobytes() == decoded(short, "ATTITUDE_QUATERNION").tobytes()


def test_numbers_that_are_none_stay_what_they_are() -> None:
    """NaN and both infinities come through: judging them is not the decoder's work."""
    (row,) = decoded(wire.attitude(1, (math.nan, math.inf, -math.inf)), "ATTITUDE")
    assert math.isnan(row["roll"])
    assert (row["pitch"], row["yaw"]) == (math.inf, -math.inf)


def test_the_quaternions_slots_are_w_x_y_z() -> None:
    """q1 is w at byte 4: the eight bytes of the identity say so, and common.xml."""
    (row,) = decoded(wire.attitude_quaternion(1, (0.1, 0.2, 0.3, 0.4)), "ATTITUDE_QUATERNION")
    assert row.tobytes()[4:20] == struct.pack("<4f", 0.1, 0.2, 0.3, 0.4)
    assert [row[f"q{i}"] for i in (1, 2, 3, 4)] == [np.float32(v) for v in (0.1, 0.2, 0.3, 0.4)]
