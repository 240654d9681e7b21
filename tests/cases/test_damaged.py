"""What noise, other dialects and text tools do to a recording: real frames are taken, and what was done is named."""

import struct
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_bridge import Monitor
from gcs_bridge.cli import main
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES

Json = dict[str, Any]
UNKNOWN_ID = 54321  # in no dialect
NOISE = 0x01_1234  # the same


@cache
def flight() -> list[tuple[int, bytes]]:
    return wire.flight(wire.Motion(21, seed=1), 20.0, euler_hz=20.0, quaternion_hz=20.0)


def unknown(payload: bytes, msgid: int = UNKNOWN_ID) -> bytes:
    """A frame of MAVLink 2 whose checksum nobody can tell."""
    return bytes([0xFD, len(payload), 0, 0, 7, 1, 1]) + msgid.to_bytes(3, "little") + payload + b"\xab\xcd"


def taken(data: bytes, *, timed: bool, size: int | None = None) -> list[bytes]:
    """The verified frames that a scanner finds, byte for byte, whole or in pieces of `size`."""
    scanner = Scanner(load_dialect(), timed=timed)
    found = []
    size = size or len(data)
    for at in range(0, len(data) + size, size):
        frames = scanner.scan(data[at : at + size], final=at >= len(data))
        for frame in frames:
            header = 10 if data[frame["offset"]] == 0xFD else 6
            found.append(data[frame["offset"] : frame["offset"] + header + frame["length"] + 2])
    return found


@pytest.mark.parametrize("lead", one_in(2, [0, 1, 3, 20]))
@pytest.mark.parametrize("hidden", [1, 2, 4])
@pytest.mark.parametrize("cut", [0, 11])
@pytest.mark.parametrize("timed", [True, False])
def test_frames_within_what_claims_to_be_a_frame_of_an_unknown_id(
    lead: int, hidden: int, cut: int, timed: bool
) -> None:
    """Noise that looks like a header, then real frames, the last one cut: as a recorder notes what it cannot check."""
    records, within = flight()[:300:3], iter(flight()[1::3])
    data, real = b"", []
    for i, (t_us, frame) in enumerate(records):
        data += (struct.pack(">Q", t_us) if timed else b"") + frame
        real.append(frame)
        if i % 5 == 4:
            inside = [next(within)[1] for _ in range(hidden)]
            cut_off = next(within)[1][:cut] if cut else b""
            frame = unknown(bytes(range(lead)) + b"".join(inside) + cut_off)
            data += (struct.pack(">Q", t_us) if timed else b"") + frame
            real += inside
    for size in (None, 37):
        assert taken(data, timed=timed, size=size) == real


def test_frames_of_another_dialect_stay_whole() -> None:
    """Without a real frame within, a frame of an unknown id is one: counted, and no damage."""
    chance = np.random.default_rng(0)
    frames = [frame for _, frame in flight()[:200]]
    mixed = [one for frame in frames for one in (frame, unknown(chance.integers(0, 0xF0, 40, np.uint8).tobytes()))]
    for timed in (True, False):
        records = [(wire.START_US + 1000 * i, one) for i, one in enumerate(mixed)]
        data = wire.tlog(records) if timed else b"".join(mixed)
        scanner = Scanner(load_dialect(), timed=timed)
        assert len(scanner.scan(data, final=True)) == 200
        assert (scanner.salvage.unverified, scanner.salvage.skipped_bytes) == (200, 0)


def entry_of(data: bytes, size: int = 1 << 20, *, timed: bool = True) -> Json:
    monitor = Monitor()
    for at in range(0, len(data), size):
        piece = data[at : at + size]
        monitor.feed_recording(piece) if timed else monitor.feed(piece, -1)
    entry: Json = monitor.close().to_dict()["files"][0]
    return entry


@pytest.mark.slow
@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("name", one_in(3, ["c_copter_4hz", "g_mavlink1", "b_copter_acro"]))
def test_line_ends_that_were_turned_into_others(name: str, timed: bool) -> None:
    """Each way; what no tool for texts touched is not named so, whatever else it suffered."""
    data = (FIXTURES / f"{name}.tlog").read_bytes()
    if not timed:
        data = b"".join(frame for _, frame in wire.records(data))
    longer = entry_of(data.replace(b"\n", b"\r\n"), timed=timed)
    assert any("a text conversion has turned LF into CR LF" in one for one in longer["salvage"]["remarks"])
    assert longer["salvage"] == entry_of(data.replace(b"\n", b"\r\n"), 1013, timed=timed)["salvage"]
    shorter = entry_of(data.replace(b"\r\n", b"\n"), timed=timed)
    if data.count(b"\r\n") >= 8:
        assert any("a text conversion has turned CR LF into LF" in one for one in shorter["salvage"]["remarks"])
    chance = np.random.default_rng(1)
    damaged = bytearray(data)
    for at in chance.integers(0, len(data), 2000):
        damaged[at] = chance.integers(0, 256)
    assert "remarks" not in entry_of(bytes(damaged), timed=timed)["salvage"]
    assert "remarks" not in entry_of(data, timed=timed)["salvage"]


def test_a_large_file_of_zeros_is_refused_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A gigabyte of nothing, as a recorder on a full disk leaves it: exit 3 in the time that it takes to read."""
    path = tmp_path / "zeros.tlog"
    with path.open("wb") as file:
        file.truncate(10**9)
    begin = time.process_time()
    assert main(["check", str(path)]) == 3
    assert time.process_time() - begin < 10.0
    assert "no valid MAVLink frame" in capsys.readouterr().err


def test_a_recording_behind_a_hole(tmp_path: Path) -> None:
    """Ten megabytes of zeros before the first frame: it is read, and the hole is a gap."""
    path = tmp_path / "hole.tlog"
    hole = 10_000_000
    path.write_bytes(bytes(hole) + wire.tlog(flight()[:400]))
    assert main(["check", "-q", str(path)]) == 0
    entry = entry_of(path.read_bytes())
    assert (entry["salvage"]["frames"], entry["salvage"]["gaps"]) == (400, [{"offset": 0, "bytes": hole}])
