"""`--signing-key-file` and `--unsigned` as people use them; and that the key is nowhere to be found afterwards."""

import base64
import os
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.cli import main
from tests.helpers import wire
from tests.helpers.paths import FIXTURES

SIGNED = FIXTURES / "g_signed.tlog"
KEY = bytes(range(32))
S = 1_000_000
SECRET = b"a key that nobody is to see ever"  # 32 bytes that are easily found


def key_file(folder: Path, content: bytes = KEY, mode: int = 0o600) -> Path:
    path = folder / "key"
    path.write_bytes(content)
    path.chmod(mode)
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: Any) -> tuple[int, str, str]:
    code = main([*map(str, arguments)])
    said = capsys.readouterr()
    return code, said.out, said.err


@pytest.mark.parametrize("content", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\r\n"], ids=len)
def test_a_signed_recording_is_verified(content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With a key of either form; the report's text says how much of it."""
    code, out, err = run(capsys, "check", SIGNED, "--signing-key-file", key_file(tmp_path, content))
    assert (code, err) == (0, "")
    # Of 3140 signed frames 30 came when the vehicle had set its clock back: see tests/mavlink/test_signing.py.
    assert "signing                 3110 of 3140 signatures verified, 30 replayed, or late," in out


def test_without_the_key_it_is_read_and_not_verified(capsys: pytest.CaptureFixture[str]) -> None:
    """Which the report says; of a recording without a signature it says nothing of the kind."""
    code, out, _ = run(capsys, "check", SIGNED)
    assert code == 0
    assert "not verified: no key was given" in out
    assert "\n  signing " not in run(capsys, "check", FIXTURES / "g_mavlink1.tlog")[1]


def test_by_another_key_nothing_is_left_to_judge(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rejected, there is no vehicle, which is exit code 4; in `replay` too."""
    options = ["--signing-key-file", key_file(tmp_path, SECRET), "--unsigned", "reject"]
    code, out, _ = run(capsys, "check", SIGNED, *options)
    assert code == 4
    assert out.splitlines()[-1].startswith("NO COMPARE")
    assert "0 of " in out
    assert run(capsys, "replay", "--viewer", "none", SIGNED, *options)[0] == 4
    assert run(capsys, "replay", "--viewer", "none", SIGNED)[0] == 0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "holds 0 bytes"),
        (SECRET[:-1], "holds 31 bytes"),
        (SECRET + b"\n", "holds 33 bytes"),
        (b"x" * 64, "holds 64 bytes, which are not all hex digits"),
        (KEY.hex().encode() + b"00", "holds 66 bytes"),
        (SECRET * 1000, "holds more than 4095 bytes"),
    ],
)
@pytest.mark.parametrize("command", [("check", SIGNED), ("replay", SIGNED), ("listen", "udpin:127.0.0.1:14550")])
def test_what_is_no_key(
    command: tuple[Any, ...], content: bytes, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit code 2, and nothing of what the file holds."""
    path = key_file(tmp_path, content)
    code, out, err = run(capsys, *command, "--signing-key-file", path)
    assert (code, out) == (2, "")
    assert err == (
        f"gcs-bridge: error: {path}: {said}: a signing key is 32 bytes, or 64 hex digits "
        "(of a pass phrase: its SHA-256)\n"
    )


def test_a_key_file_that_cannot_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Missing, or a folder: what, where, what to do."""
    code, _, err = run(capsys, "check", SIGNED, "--signing-key-file", tmp_path / "none")
    assert (code, err.count("\n")) == (2, 1)
    assert f"{tmp_path / 'none'}: no signing key can be read: no such file" in err
    code, _, err = run(capsys, "check", SIGNED, "--signing-key-file", tmp_path)
    assert (code, err.count("\n")) == (2, 1)
    assert "name the file in it" in err


@pytest.mark.skipif(os.name != "posix", reason="who may read a file is told otherwise there")
@pytest.mark.parametrize(("mode", "warned"), [(0o600, False), (0o400, False), (0o640, True), (0o604, True)])
def test_a_key_that_others_may_read(
    mode: int, warned: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Is used, with a warning of one line that says what to type."""
    path = key_file(tmp_path, mode=mode)
    code, _, err = run(capsys, "check", "-q", SIGNED, "--signing-key-file", path)
    assert code == 0
    assert err.count("\n") == warned
    assert (f"chmod 600 {path}" in err) == warned


@pytest.mark.parametrize("unsigned", ["flag", "reject"])
def test_nothing_is_flagged_without_a_key(unsigned: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A wish that cannot be met is refused."""
    code, _, err = run(capsys, "check", SIGNED, "--unsigned", unsigned)
    assert code == 2
    assert err == (
        f"gcs-bridge: error: --unsigned {unsigned} needs --signing-key-file: without a key nothing is verified\n"
    )
    assert run(capsys, "check", SIGNED, "--unsigned", "accept")[0] == 0


@pytest.mark.slow
def test_the_key_is_nowhere_afterwards(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In nothing that is printed or written, evidence of an alarm included that a SETUP_SIGNING lies within."""
    setup = mavlink.MAVLink_setup_signing_message(1, 1, list(SECRET), 1)
    records = [(wire.START_US + s * S + 5, wire.pack(setup, sysid=255, compid=190, seq=s)) for s in range(8)]
    for t_us, frame in wire.flight(wire.Motion(8, seed=3), 8, euler_hz=10.0, quaternion_hz=10.0):
        if frame[7] == mavlink.MAVLINK_MSG_ID_ATTITUDE:
            frame = wire.attitude((t_us - wire.START_US) // 1000 + 10_000, (0, 0, 2), seq=frame[4])
        records.append((t_us, frame))
    records = [
        (t_us, wire.signed(frame, SECRET, time=35_000_000_000_000 + i))
        for i, (t_us, frame) in enumerate(sorted(records))
    ]
    flight_file = tmp_path / "flight.tlog"
    flight_file.write_bytes(wire.tlog(records))
    written = tmp_path / "written"
    written.mkdir()
    options = ["--signing-key-file", key_file(tmp_path, SECRET), "--unsigned", "reject"]
    outputs = ["--evidence", written / "evidence", "--events", written / "events.jsonl"]
    code, out, err = run(capsys, "check", flight_file, "-v", *options, *outputs)
    assert code == 1
    (written / "said").write_text(out + err)
    files = [path for path in written.rglob("*") if path.is_file()]
    assert {"frames.parquet", "summary.md", "events.jsonl"} <= {path.name for path in files}
    for path in files:
        content = path.read_bytes()
        if path.suffix == ".parquet":
            content = repr(pq.read_table(path).to_pylist()).encode()
        for shown in (SECRET, SECRET.hex().encode(), base64.b64encode(SECRET), repr(list(SECRET)).encode()):
            assert shown not in content, path
        if path.name == "frames.parquet":
            assert {row["sysid"] for row in pq.read_table(path).to_pylist()} == {1}  # all else of 255 was a key


@pytest.mark.slow
def test_evidence_tells_what_was_judged_from_what_was_refused(tmp_path: Path) -> None:
    """Frames that were refused lie among the others, without a number: those of the alarm's table are of what holds."""
    flown = wire.flight(wire.Motion(8, seed=3), 8, euler_hz=10.0, quaternion_hz=10.0)
    records = []
    for i, (t_us, frame) in enumerate(flown):
        ms = (t_us - wire.START_US) // 1000 + 10_000
        if frame[7] == mavlink.MAVLINK_MSG_ID_ATTITUDE:
            frame = wire.attitude(ms, (0, 0, 2), seq=frame[4])
            records.append((t_us + 1, wire.attitude(ms, (1, 0, 0), seq=frame[4] + 1)))
        records.append((t_us, wire.signed(frame, KEY, time=35_000_000_000_000 + i)))
    (tmp_path / "flight.tlog").write_bytes(wire.tlog(sorted(records)))
    options = ["--signing-key-file", key_file(tmp_path), "--unsigned", "reject", "--evidence", tmp_path / "evidence"]
    assert main([*map(str, ["check", "-q", tmp_path / "flight.tlog", *options])]) == 1
    found = sorted((tmp_path / "evidence").rglob("frames.parquet"))
    holds = [frame for _, frame in sorted(records) if frame[2] == 1]
    for path in found:
        rows = pq.read_table(path).to_pylist()
        assert {row["bytes"][2] for row in rows if row["frame"] is None} == {0}
        assert all(row["bytes"] == holds[row["frame"]] for row in rows if row["frame"] is not None)
    assert found
