"""Whether bytes look like MAVLink, told without tables."""

import os
from pathlib import Path

import pytest
from pymavlink.dialects.v10 import ardupilotmega as mavlink1

from gcs_bridge.mavlink.likeness import looks_like_mavlink
from tests.helpers import wire
from tests.helpers.paths import FIXTURES, ROOT

FLIGHT = wire.flight(wire.Motion(1.0), 1.0)


@pytest.mark.parametrize("path", sorted(FIXTURES.glob("*.tlog")), ids=lambda path: path.stem)
def test_recordings_of_autopilots_do(path: Path) -> None:
    """MAVLink 1 and 2, signed or not, damaged or not, cut off anywhere."""
    data = path.read_bytes()
    assert looks_like_mavlink(data[:65_536])
    assert looks_like_mavlink(data[1_003:20_000])


def test_so_does_a_stream_without_times() -> None:
    """And one that begins in the middle of a frame."""
    stream = b"".join(frame for _, frame in FLIGHT)
    assert looks_like_mavlink(stream)
    assert looks_like_mavlink(stream[5:])


def test_so_does_what_another_library_packs() -> None:
    """MAVLink 1, by pymavlink."""
    mav = mavlink1.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = [mavlink1.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3).pack(mav) for _ in range(4)]
    assert looks_like_mavlink(b"".join(frames))


def test_checksums_are_looked_at() -> None:
    """One bit turned in each frame, and none holds any more."""
    turned = [(t_us, frame[:-1] + bytes([frame[-1] ^ 1])) for t_us, frame in FLIGHT]
    assert not looks_like_mavlink(wire.tlog(turned))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xfd",
        b"\xfe" * 65_536,
        b"\xfd" * 65_536,
        bytes(65_536),
        b"\xfe\xfd" * 30_000,
        (ROOT / "docs" / "pictures" / "copter.webp").read_bytes()[:65_536],
        (ROOT / "README.md").read_bytes(),
        b"\xa3\x95" * 5_000,
    ],
    ids=["nothing", "one", "FE", "FD", "zeros", "both", "picture", "text", "log"],
)
def test_others_do_not(data: bytes) -> None:
    """Not even what is full of the bytes by which frames begin."""
    assert not looks_like_mavlink(data)


def test_noise_does_not() -> None:
    """A mebibyte of it, in pieces as long as are looked at."""
    assert not any(looks_like_mavlink(os.urandom(65_536)) for _ in range(16))
