"""What the doctor tells of recordings: the right inventory, and for what is wrong the advice of that name."""

import json
import re
import sysconfig
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import jsonschema
import msgspec
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.inspection.schema import Examination
from gcs_bridge.jit import prepare
from gcs_bridge.jit.kernels import Kernel
from gcs_bridge.mavlink.scanner import RawFrame
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.resources import json_schema
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.examined import Examined, examined, said
from tests.helpers.live_links import fixture, frames_of, tlog_of
from tests.helpers.paths import FIXTURES, ROOT

CASES = ROOT / "tests" / "data" / "cases"
ATTITUDE, QUATERNION, RAW_IMU, HIGHRES_IMU = 30, 31, 27, 105
S = 1_000_000


def msgid(frame: RawFrame) -> int:
    data = frame.data
    return data[5] if data[0] == 0xFE else int.from_bytes(data[7:10], "little")


def sysid(frame: RawFrame) -> int:
    return frame.data[3] if frame.data[0] == 0xFE else frame.data[5]


def kept(name: str, keep: Callable[[RawFrame], bool], *, to_s: float = 20.0) -> bytes:
    """A recording without some of its frames."""
    return tlog_of([frame for frame in fixture(name, to_s=to_s) if keep(frame)])


def doctor(folder: Path, recording: bytes, *options: str, name: str = "flight.tlog") -> Examined:
    file = folder / name
    file.write_bytes(recording)
    return examined(file, *options)


# Behind damage pymavlink passes over whole frames.
UNDAMAGED = [path for path in sorted(FIXTURES.glob("*.tlog")) if path.stem != "h_lossy_dirty"]


@pytest.mark.parametrize("path", one_in(7, UNDAMAGED), ids=lambda path: path.stem)
def test_the_inventory_is_pymavlink_s(path: Path) -> None:
    """Every message is somebody's, as many as pymavlink's reader found; what is told keeps to the schema."""
    facts = json.loads(path.with_suffix(".facts.json").read_text(encoding="utf-8"))
    found = examined(path)
    total: Counter[str] = Counter()
    for sender in (*found.told["vehicles"], *found.told["stations"]):
        total.update({name: message["count"] for name, message in sender["messages"].items()})
    assert sum(total.pop(name) for name in list(total) if name.startswith("UNKNOWN_")) == facts["unknown_ids"]
    assert dict(total) == facts["messages"]
    assert {f"{one['sysid']},{one['compid']}" for one in found.told["vehicles"]} == set(facts["vehicles"])
    for vehicle in found.told["vehicles"]:
        told = facts["vehicles"][f"{vehicle['sysid']},{vehicle['compid']}"]
        assert vehicle["autopilot"] == told["autopilot"]
        for name, rate_hz in told["rates_hz"].items():
            if rate_hz["typical"] is not None and name in vehicle["messages"]:
                assert vehicle["messages"][name]["rate_hz"] == pytest.approx(rate_hz["typical"], rel=0.05)
    schema = json.loads(json_schema("doctor").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema).validate(found.told)
    assert msgspec.convert(found.told, Examination).to_dict() == found.told


def test_a_flight_with_all_that_is_compared() -> None:
    """Good: nothing to mend. The loss is that of the recording, the clock is known, nothing is signed."""
    found = examined(FIXTURES / "a_copter_square.tlog")
    vehicle = found.vehicle()
    assert (found.code, found.told["finding"], found.codes) == (0, "good", [])
    assert (vehicle["autopilot"], vehicle["type"], vehicle["missing"]) == ("ardupilot", "quadrotor", [])
    assert vehicle["loss"]["share"] < 0.01
    assert (vehicle["signing"]["state"], vehicle["signing"]["verified"]) == ("unsigned", None)
    assert vehicle["clock"]["utc"].startswith("20")
    assert abs(vehicle["clock"]["utc_behind_s"]) < 60
    assert vehicle["mavlink"] == [2]
    assert all(one["age_s"] is not None for one in vehicle["messages"].values())


def test_ardupilot_without_31(tmp_path: Path) -> None:
    """The command that MAVProxy takes for it, and the exit code for what cannot be compared."""
    found = doctor(tmp_path, kept("a_copter_square", lambda frame: msgid(frame) != QUATERNION))
    assert found.code == 4
    (missing,) = found.vehicle()["missing"]
    assert missing == {
        "message": "ATTITUDE_QUATERNION",
        "command": "long SET_MESSAGE_INTERVAL 31 40000",
        "where": "MAVProxy",
    }
    assert found.advice("missing_message")["command"] == missing["command"]


def test_an_imu_that_is_missing_is_no_reason_to_fail(tmp_path: Path) -> None:
    """Both attitudes can be compared without it: it is said."""
    found = doctor(tmp_path, kept("a_copter_square", lambda frame: msgid(frame) not in (26, 27, 116, 129)))
    assert found.code == 0
    assert [one["message"] for one in found.vehicle()["missing"]] == ["RAW_IMU"]
    assert found.advice("missing_message")["level"] == "advice"


def test_px4_has_no_raw_imu(tmp_path: Path) -> None:
    """What it has instead comes: nothing is missing. Without that, the command asks for what PX4 knows."""
    found = examined(FIXTURES / "p_px4_quad_square.tlog")
    assert found.code == 0
    assert found.vehicle()["missing"] == []
    assert "HIGHRES_IMU" in found.advice("imu_instead")["text"]
    bare = doctor(tmp_path, kept("p_px4_quad_square", lambda frame: msgid(frame) in (0, ATTITUDE, QUATERNION)))
    (missing,) = bare.vehicle()["missing"]
    assert missing["message"] == "RAW_IMU"
    assert re.fullmatch(r"mavlink stream -d /dev/tty\w+ -s HIGHRES_IMU -r 25", missing["command"])
    assert "31 40" not in bare.advice("missing_message")["text"]


def test_heartbeats_alone(tmp_path: Path) -> None:
    """As before any ground station has spoken."""
    found = doctor(tmp_path, kept("a_copter_square", lambda frame: msgid(frame) == 0 and sysid(frame) == 1))
    assert (found.code, "heartbeats_only" in found.codes) == (4, True)
    assert len(found.vehicle()["missing"]) == 3


def test_a_ground_station_alone(tmp_path: Path) -> None:
    """It is no vehicle, and named."""
    found = doctor(tmp_path, kept("a_copter_square", lambda frame: sysid(frame) == 255))
    assert (found.code, found.codes, found.told["vehicles"]) == (4, ["gcs_only"], [])
    assert "255,190" in found.advice("gcs_only")["text"]


def test_a_radio_alone(tmp_path: Path) -> None:
    """A SiK radio reports of itself, as 51,68, whether or not the other one is on."""
    status = mavlink.MAVLink_radio_status_message(60, 0, 100, 30, 0, 0, 0)
    sent = [(wire.START_US + i * S, wire.pack(status, seq=i, sysid=51, compid=68)) for i in range(20)]
    found = doctor(tmp_path, wire.tlog(sent))
    assert (found.code, found.codes) == (4, ["radio_only"])


def test_a_raw_stream(tmp_path: Path) -> None:
    """Counts without times; what is not known is null."""
    raw = b"".join(frame.data for frame in fixture("a_copter_square", to_s=8))
    found = doctor(tmp_path, raw, name="flight.raw")
    assert (found.code, found.codes) == (0, ["no_times"])
    link, vehicle = found.told["links"][0], found.vehicle()
    assert (link["kind"], link["seconds"], link["frames_per_s"]) == ("stream", None, None)
    one = vehicle["messages"]["ATTITUDE"]
    assert one["count"] > 100
    assert (one["rate_hz"], one["jitter_ms"], one["age_s"]) == (None, None, None)
    assert vehicle["clock"]["utc_behind_s"] is None


def test_a_text_conversion(tmp_path: Path) -> None:
    """CR LF for each LF: what comes must not be relied on."""
    found = doctor(tmp_path, kept("a_copter_square", lambda _: True).replace(b"\n", b"\r\n"))
    assert (found.code, found.codes[0]) == (1, "text_conversion")
    assert "LF into CR LF" in found.advice("text_conversion")["text"]


def test_two_senders_of_one_identity() -> None:
    """Named, and how to part them."""
    found = examined(CASES / "two_senders_one_id.tlog")
    assert found.code == 1
    assert found.advice("two_senders")["vehicle"] == [1, 1]
    assert "MAV_SYSID" in found.advice("two_senders")["text"]


def test_every_frame_twice() -> None:
    """Counted as they come, told, and no part of the rate."""
    found = examined(CASES / "every_frame_twice.tlog")
    assert found.advice("every_frame_twice")["vehicle"] == [1, 1]
    one = found.vehicle()["messages"]["ATTITUDE"]
    assert one["count"] == 2 * one["copies"]


def test_who_asks_for_rates() -> None:
    """The station, what it asks for, of whom, and how often."""
    found = examined(CASES / "rate_request.tlog")
    (asks,) = [one["asks"] for one in found.told["stations"] if one["asks"]]
    assert asks[0]["how"] == "REQUEST_DATA_STREAM"
    assert asks[0]["rate_hz"] == 4.0


def test_stations_that_undo_each_other(tmp_path: Path) -> None:
    """Both are named."""
    flight = wire.flight(wire.Motion(12.0), 12.0)
    for i, (station, hz) in enumerate([(255, 4), (254, 10), (255, 5), (254, 10)]):
        ask = mavlink.MAVLink_request_data_stream_message(1, 1, 10, hz, 1)
        flight.append((wire.START_US + (2 + 2 * i) * S, wire.pack(ask, seq=i, sysid=station, compid=190)))
    found = doctor(tmp_path, wire.tlog(sorted(flight)))
    text = found.advice("rates_undone")["text"]
    assert "255,190" in text
    assert "254,190" in text


# --- loss ------------------------------------------------------------------------------------------------------------


def test_losses_are_measured(tmp_path: Path) -> None:
    """A fifth of the frames is taken away at random."""
    recording = inject(kept("a_copter_square", lambda frame: sysid(frame) == 1, to_s=60), [parse_fault("loss:0.2")])
    found = doctor(tmp_path, recording)
    assert found.vehicle()["loss"]["share"] == pytest.approx(0.2, abs=0.02)
    assert "lossy" in found.codes


@pytest.mark.parametrize("name", ["a_copter_square", "p_px4_quad_square"])
def test_a_router_that_leaves_messages_out_loses_none(name: str, tmp_path: Path) -> None:
    """The numbers miss what was left out, and nobody lost: it is said that this cannot be measured."""
    few = (0, ATTITUDE, QUATERNION, RAW_IMU, HIGHRES_IMU)
    found = doctor(tmp_path, kept(name, lambda frame: msgid(frame) in few))
    loss = found.vehicle()["loss"]
    assert (loss["lost"], loss["share"]) == (None, None)
    assert loss["text"].startswith("not measurable behind a router")
    assert "lossy" not in found.codes


def test_a_router_on_a_lossy_link_is_not_denied(tmp_path: Path) -> None:
    """Where what comes evenly misses as much as the numbers do, it is a loss."""
    few = (0, ATTITUDE, QUATERNION)
    every = [frame for frame in frames_of(wire.tlog(wire.flight(wire.Motion(60.0), 60.0))) if msgid(frame) in few]
    found = doctor(tmp_path, inject(tlog_of(every), [parse_fault("loss:0.3")]))
    assert found.vehicle()["loss"]["share"] == pytest.approx(0.3, abs=0.05)


def test_two_links_that_are_merged(tmp_path: Path) -> None:
    """One vehicle on two links, numbered apart on each."""
    motion = wire.Motion(30.0)
    one = wire.flight(motion, 30.0)
    other = wire.flight(motion, 30.0, start_us=wire.START_US + 9000, boot_ms=10_009, first_seq=100)
    found = doctor(tmp_path, wire.tlog(sorted(one + other)))
    loss = found.vehicle()["loss"]
    assert loss["lost"] is None
    assert "numbered apart" in loss["text"]


# --- signing ---------------------------------------------------------------------------------------------------------


def test_a_signed_link(tmp_path: Path) -> None:
    """Signed frames are counted, and never called verified; a key that came in the clear is told of."""
    found = examined(FIXTURES / "g_signed.tlog")
    facts = json.loads((FIXTURES / "g_signed.facts.json").read_text(encoding="utf-8"))
    assert found.told["links"][0]["signed"] == facts["signed"]
    assert "key_in_the_clear" in found.codes
    signing = found.vehicle()["signing"]
    assert signing["state"] == "mixed"
    assert "not verified" in signing["text"]
    signed = wire.tlog(wire.flight(wire.Motion(5.0), 5.0, key=bytes(32)))
    assert doctor(tmp_path, signed).vehicle()["signing"] == {
        "state": "signed",
        "signed": 255,
        "unsigned": 0,
        "verified": None,
        "wrong": None,
        "text": "signed, not verified",
    }


def test_signatures_are_verified_by_a_key(tmp_path: Path) -> None:
    """By the one that they were made with none is wrong, by another all are; ArduPilot set its clock back meanwhile.

    So 30 of them do not hold, as pymavlink judges too: see tests/mavlink/test_signing.py.
    """
    key_file = tmp_path / "key"
    for key, wrong, code in ((bytes(range(32)), False, 0), (bytes(32), True, 1)):
        key_file.write_bytes(key)
        key_file.chmod(0o600)
        found = examined(FIXTURES / "g_signed.tlog", "--signing-key-file", str(key_file))
        signing = found.vehicle()["signing"]
        assert signing["signed"] > 3000
        assert signing["wrong"] == (signing["signed"] if wrong else 0)
        assert signing["signed"] - signing["wrong"] - signing["verified"] == (0 if wrong else 30)
        assert [one for one in found.codes if one.endswith("_signatures")] == [
            ("wrong" if wrong else "old") + "_signatures"
        ]
        assert found.code == code


# --- what cannot be used ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        (b"", "empty"),
        (b"time,roll\n" * 500, "no valid MAVLink frame"),
        (b"ULog\x01\x12\x35\x01" + bytes(300), "pyulog"),
    ],
)
def test_a_file_that_cannot_be_used(content: bytes | None, words: str, tmp_path: Path) -> None:
    """One line with what to do, code 3; a good one beside it is examined all the same."""
    bad = tmp_path / "bad.tlog"
    if content is not None:
        bad.write_bytes(content)
    found = examined(bad, CASES / "banked_turn.tlog")
    assert found.code == 3
    assert words in found.advice("no_recording")["text"]
    assert [one["finding"] for one in found.told["links"]] == ["unusable", "good"]


def test_one_file_that_cannot_be_used(tmp_path: Path) -> None:
    """One line on standard error, as of every command, and no report of nothing; a program gets its JSON."""
    code, out, err = said(tmp_path / "missing.tlog")
    assert (code, out) == (3, "")
    assert re.fullmatch(r"gcs-bridge: error: .*missing.tlog: cannot be read: no such file.*\n", err)
    assert examined(tmp_path / "missing.tlog").codes == ["no_recording"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["udpin:nowhere"], "must be as udpin:"),
        (["udpout:127.0.0.1:14550"], "cannot receive before it has sent"),
        (["--duration", "0", "udpin:127.0.0.1:14550"], "--duration 0: must be above 0"),
        (["--dialect", "nonsuch", "udpin:127.0.0.1:14550"], "unknown dialect 'nonsuch'"),
        (["udpin:127.0.0.1:1", "udpin:127.0.0.1:1"], "is named twice"),
    ],
)
def test_wrong_usage(arguments: list[str], words: str) -> None:
    """One line and code 2, before anything is opened."""
    code, out, err = said(*arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1


def test_this_machine_alone() -> None:
    """Without a link the machine is looked at: kernels, viewer, groups."""
    prepare("gcs_bridge", "tests")  # those of other tests count too, as soon as they are imported
    found = examined()
    assert (found.code, found.told["links"]) == (0, [])
    machine = found.told["machine"]
    assert {"kernels", "viewer", "importer", "groups", "modem_manager"} <= machine.keys()
    assert machine["kernels"]["state"] == "good"
    assert machine["viewer"]["text"].startswith("rerun ")


def test_kernels_that_are_not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """How many there are, and what compiles them before they are needed."""
    monkeypatch.setattr(Kernel, "is_ready", False)
    part = examined().told["machine"]["kernels"]
    assert (part["state"], part["command"]) == ("mend", "gcs-bridge demo --viewer none --duration 3")
    assert part["text"].startswith("0 of ")


@pytest.mark.parametrize(
    ("ends_with", "state", "words"),
    [(66, "good", "rerun opens recordings by themselves"), (1, "mend", "does not work (exit code 1)")],
)
def test_the_importer_is_tried(
    ends_with: int, state: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is in order if it leaves a file that is none of ours to others."""
    program = tmp_path / "rerun-importer-tlog"
    program.write_text(f"#!/bin/sh\nexit {ends_with}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    part = examined().told["machine"]["importer"]
    assert part["state"] == state
    assert words in part["text"]


def test_an_importer_that_is_not_on_the_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it lies is told, as what to type; where it does not lie either, how it comes there."""
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setattr(sysconfig, "get_path", lambda _: str(tmp_path))
    part = examined().told["machine"]["importer"]
    assert (part["state"], "pip install" in part["command"]) == ("mend", True)
    (tmp_path / "rerun-importer-tlog").touch(0o755)
    part = examined().told["machine"]["importer"]
    assert (part["state"], part["command"]) == ("mend", f'export PATH="{tmp_path}:$PATH"')


# --- the text --------------------------------------------------------------------------------------------------------


def test_the_text_ends_with_a_line_a_link_and_the_next_command(tmp_path: Path) -> None:
    """The verdict comes first in it, lines are short enough for a terminal, and no escape from the air is obeyed."""
    file = tmp_path / "no 31.tlog"
    file.write_bytes(kept("a_copter_square", lambda frame: msgid(frame) != QUATERNION))
    code, out, err = said(file)
    assert (code, err) == (4, "")
    *above, last, following = out.splitlines()
    assert last == f"MISSING     {file}: 1 vehicle: missing_message"
    assert following == "            next: long SET_MESSAGE_INTERVAL 31 40000"
    assert "this machine" in above
    assert any(re.match(r" +ATTITUDE +\d+ +2[45]\.\d\d Hz +± \d", line) for line in above)
    assert all(len(line) <= 100 or str(file) in line for line in above)
    assert said(file, "-q")[1].splitlines() == [last, following]


def test_text_from_the_air_is_cleaned(tmp_path: Path) -> None:
    """A parameter's name that would clear the screen is spelled out, if it is shown at all."""
    evil = mavlink.MAVLink_statustext_message(6, b"ArduCopter V4.5\x1b[2J")
    setting = mavlink.MAVLink_param_set_message(1, 1, b"SR1_\x1b[2J", 25.0, 9)
    flight = wire.flight(wire.Motion(5.0), 5.0)
    flight += [(wire.START_US + S, wire.pack(evil, seq=7)), (wire.START_US + S, wire.pack(setting, sysid=255))]
    file = tmp_path / "evil.tlog"
    file.write_bytes(wire.tlog(sorted(flight)))
    assert "\x1b" not in "".join(said(file, "-v")[1:])
