"""What is exported, read back by other libraries and held against what pymavlink reads from the recording."""

import csv
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from pymavlink import mavutil
from scipy.spatial.transform import Rotation

from gcs_bridge.cli import export as command
from gcs_bridge.cli import main
from gcs_bridge.exporting.conventions import CONVENTIONS
from gcs_bridge.exporting.writers import WRITERS
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES, ROOT

SQUARE = FIXTURES / "a_copter_square.tlog"
TWO = FIXTURES / "e_two_vehicles.tlog"
SHORT = ["--from", "60", "--to", "70"]
WXYZ = ("w", "x", "y", "z")
NED_TO_ENU = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FRD_TO_FLU = Rotation.from_matrix(np.diag([1, -1, -1]))


def export(path: Path, output: Path, *options: str) -> int:
    return main(["export", str(path), "--output", str(output), "-q", *options])


def sent(path: Path, message: str) -> list[Any]:
    """All messages of a kind, as pymavlink reads them."""
    with closing(mavutil.mavlink_connection(str(path))) as log:
        return list(iter(lambda: log.recv_match(type=message), None))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of a copter's flight, as Parquet."""
    output = tmp_path_factory.mktemp("export") / "square"
    assert export(SQUARE, output) == 0
    return output


@pytest.mark.slow
def test_both_attitudes_are_as_pymavlink_reads_them(folder: Path) -> None:
    """Every sample, to the last bit, with its vehicle and its times."""
    table, euler = pq.read_table(folder / "attitude.parquet"), sent(SQUARE, "ATTITUDE")
    for column, field in (
        ("roll_rad", "roll"),
        ("pitch_rad", "pitch"),
        ("yaw_rad", "yaw"),
        ("w_nb_b_rad_s_x", "rollspeed"),
    ):
        np.testing.assert_array_equal(table[column], [getattr(one, field) for one in euler])
    np.testing.assert_array_equal(table["t_boot_us"], [one.time_boot_ms * 1000 for one in euler])
    np.testing.assert_allclose(table["t_rx_us"], [one._timestamp * 1e6 for one in euler], atol=1)
    assert set(table["sysid"].to_pylist()) == {euler[0].get_srcSystem()}
    table, quaternion = pq.read_table(folder / "attitude_quaternion.parquet"), sent(SQUARE, "ATTITUDE_QUATERNION")
    for part, field in zip(WXYZ, ("q1", "q2", "q3", "q4"), strict=True):
        np.testing.assert_array_equal(table[f"q_nb_{part}"], [getattr(one, field) for one in quaternion])


def test_pairs_and_imu_mean_what_their_columns_say(folder: Path) -> None:
    """The angle between both attitudes by SciPy; the accelerometer's milli-g."""
    pairs = pq.read_table(folder / "pairs.parquet").to_pydict()
    q = [
        Rotation.from_quat(np.column_stack([pairs[f"q_nb_{of}_{part}"] for part in "xyzw"]))
        for of in ("euler", "quaternion")
    ]
    np.testing.assert_allclose(np.degrees((q[0].inv() * q[1]).magnitude()), pairs["angle_deg"], atol=1e-6)
    assert max(pairs["angle_deg"]) < min(pairs["limit_deg"])
    imu, raw = pq.read_table(folder / "imu.parquet"), sent(SQUARE, "RAW_IMU")
    np.testing.assert_allclose(imu["f_b_m_s2_z"], [one.zacc * 9.80665e-3 for one in raw])
    assert imu["t_sensor_us"].to_pylist() == [one.time_usec for one in raw]


def test_the_command_offers_what_there_is() -> None:
    """Its help names formats and frames without loading what writes them."""
    assert list(command._FORMATS) == [*WRITERS, "rrd"]
    assert list(command._FRAMES) == list(CONVENTIONS)


def test_columns_tell_unit_and_meaning(folder: Path) -> None:
    """In each field's metadata; and of which recording they are, in the file's."""
    schema = pq.read_schema(folder / "pairs.parquet")
    for field in schema:
        assert set(field.metadata) == {b"unit", b"description"}, field.name
    assert schema.field("angle_deg").metadata[b"unit"] == b"deg"
    assert schema.metadata[b"source"] == b"a_copter_square.tlog"
    assert schema.metadata[b"frame"] == b"ned_frd"


def test_csv_has_the_same_numbers(tmp_path: Path) -> None:
    """Every digit of them; events too."""
    assert export(TWO, tmp_path / "csv", "--format", "csv") == 0
    assert export(TWO, tmp_path / "parquet") == 0
    for name in ("attitude", "pairs", "events"):
        with (tmp_path / "csv" / f"{name}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        table = pq.read_table(tmp_path / "parquet" / f"{name}.parquet")
        assert len(rows) == len(table) > 0
        for column in table.column_names:
            for text, value in zip((row[column] for row in rows), table[column].to_pylist(), strict=True):
                assert text == "" if value is None else type(value)(text if text != "false" else "") == value, column
    assert {(row["sysid"], row["compid"]) for row in rows if row["sysid"]} == {("1", "1"), ("2", "1")}


@pytest.mark.parametrize(("frame", "name"), [("enu_flu", "q_enu_flu"), ("enu_rfu", "q_enu_rfu")])
def test_other_frames_are_what_scipy_makes_of_them(frame: str, name: str, folder: Path, tmp_path: Path) -> None:
    """R' = W R Bᵀ; a body's vector is B v. Angles are those of the turned attitude."""
    assert export(SQUARE, tmp_path / "there", "--frame", frame, *SHORT) == 0
    there = pq.read_table(tmp_path / "there" / "attitude_quaternion.parquet").to_pydict()
    here = pq.read_table(folder / "attitude_quaternion.parquet").to_pydict()
    first = here["frame_index"].index(there["frame_index"][0])
    rows = slice(first, first + len(there["frame_index"]))
    body = FRD_TO_FLU if frame == "enu_flu" else Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    ned = Rotation.from_quat(np.column_stack([here[f"q_nb_{part}"][rows] for part in "xyzw"]))
    turned = Rotation.from_quat(np.column_stack([there[f"{name}_{part}"] for part in "xyzw"]))
    np.testing.assert_allclose((NED_TO_ENU * ned * body.inv() * turned.inv()).magnitude(), 0, atol=1e-6)
    axes = "flu" if frame == "enu_flu" else "rfu"
    w = np.column_stack([here[f"w_nb_b_rad_s_{part}"][rows] for part in "xyz"])
    np.testing.assert_allclose([there[f"w_{axes}_rad_s_{part}"] for part in "xyz"], body.apply(w).T, atol=1e-12)
    if frame == "enu_flu":
        zyx = turned.as_euler("ZYX")
        np.testing.assert_allclose(
            np.column_stack([there[f"{of}_rad"] for of in ("yaw", "pitch", "roll")]), zyx, atol=1e-6
        )


def messages(path: Path) -> Iterator[tuple[str, str, int, dict[str, Any]]]:
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            yield channel.topic, schema.name, message.log_time, json.loads(message.data)


def test_mcap_turns_the_body_as_scipy_does(tmp_path: Path) -> None:
    """Frame transforms of Foxglove's schema, in the frames of ROS: one for each sample, at its receive time."""
    assert export(SQUARE, tmp_path / "a.mcap", "--format", "mcap", "--frame", "enu_flu", *SHORT) == 0
    assert export(SQUARE, tmp_path / "tables", *SHORT) == 0
    told = [one for one in messages(tmp_path / "a.mcap") if one[0] == "/1.1/attitude/transform"]
    table = pq.read_table(tmp_path / "tables" / "attitude.parquet").to_pydict()
    assert {schema for _, schema, _, _ in told} == {"foxglove.FrameTransform"}
    assert [t_ns for _, _, t_ns, _ in told] == [1000 * t_us for t_us in table["t_rx_us"]]
    (first, *_) = told
    assert (first[3]["parent_frame_id"], first[3]["child_frame_id"]) == ("enu", "1.1/attitude")
    assert first[3]["timestamp"]["sec"] * 10**9 + first[3]["timestamp"]["nsec"] == first[2]
    angles = [table[f"{of}_rad"] for of in ("yaw", "pitch", "roll")]
    ned = Rotation.from_euler("ZYX", np.column_stack(angles))
    sent = Rotation.from_quat([[one[3]["rotation"][part] for part in "xyzw"] for one in told])
    np.testing.assert_allclose((NED_TO_ENU * ned * FRD_TO_FLU.inv() * sent.inv()).magnitude(), 0, atol=1e-9)


@pytest.mark.slow
def test_mcap_has_every_table_and_the_events(tmp_path: Path) -> None:
    """Of each vehicle by its own topics; an alarm is an error of the log."""
    flight = FIXTURES / "k7a_gyro_bias_both.tlog"
    assert export(flight, tmp_path / "a.mcap", "--format", "mcap") == 0
    told = list(messages(tmp_path / "a.mcap"))
    topics = {topic for topic, *_ in told}
    assert topics >= {"/1.1/attitude", "/1.1/attitude_quaternion", "/1.1/imu", "/1.1/pairs", "/events"}
    alarms = [said for topic, _, _, said in told if topic == "/events" and said["level"] == 4]
    assert any("accelerometer's down is far" in said["message"] for said in alarms)
    assert all(said["name"] == "1.1" for said in alarms)


def test_rrd_is_the_viewer_s_scene(tmp_path: Path) -> None:
    """As replay saves it."""
    assert export(SQUARE, tmp_path / "a.rrd", "--format", "rrd", *SHORT) == 0
    assert (tmp_path / "a.rrd").read_bytes()[:4] == b"RRF2"


def test_nothing_comes_of_a_recording_without_an_attitude(tmp_path: Path) -> None:
    """4, and the tables are there without a row."""
    recording = tmp_path / "still.tlog"
    from gcs_bridge.recordings.faults import parse_fault
    from gcs_bridge.recordings.inject import inject

    data = inject((FIXTURES / "c_copter_4hz.tlog").read_bytes(), [parse_fault("truncate:2000")])
    recording.write_bytes(data)
    code = export(recording, tmp_path / "out")
    table = pq.read_table(tmp_path / "out" / "attitude.parquet")
    assert code == (0 if len(table) else 4)
    assert "q_nb_w" in table.column_names


@pytest.mark.parametrize("form", ["parquet", "csv", "mcap"])
def test_what_cannot_be_written_leaves_nothing_behind(
    form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit code 2, no half file: a folder where the file should be, a file where the folder should be."""
    taken = tmp_path / "taken"
    if form == "mcap":
        taken.mkdir()
    else:
        taken.write_text("mine")
    assert export(SQUARE, taken, "--format", form) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "taken" in said
    assert [path.name for path in tmp_path.rglob("*")] == ["taken"]


def test_a_source_that_is_none_leaves_nothing_behind(tmp_path: Path) -> None:
    """3, and no file under any name."""
    (tmp_path / "noise.tlog").write_bytes(b"no frame in here" * 100)
    assert export(tmp_path / "noise.tlog", tmp_path / "out") == 3
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("form", one_in(3, ["parquet", "csv", "mcap"]))
def test_a_full_disk_is_told_in_one_line(form: str, tmp_path: Path) -> None:
    """A real one: a file may not grow beyond 100 kB here. Nothing is left of it, and nothing else is said."""
    arguments = ["export", str(SQUARE), "--format", form, "-q"]
    code = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000));"
    code += f"from gcs_bridge.cli import main; raise SystemExit(main({arguments}))"
    ended = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    assert "File too large" in ended.stderr
    assert ended.stderr.count("\n") == 1
    assert not [path for path in tmp_path.rglob("*") if path.is_file() and path.name.startswith(".")]


@pytest.mark.slow
def test_every_other_message_has_a_table_of_its_own(tmp_path: Path) -> None:
    """As it was sent, in each format: pymavlink counts as many, and reads the same."""
    assert export(TWO, tmp_path / "tables", "--all") == 0
    table = pq.read_table(tmp_path / "tables" / "HEARTBEAT.parquet").sort_by("frame_index")
    heartbeats = sent(TWO, "HEARTBEAT")
    assert table["custom_mode"].to_pylist() == [one.custom_mode for one in heartbeats]
    assert table["sysid"].to_pylist() == [one.get_srcSystem() for one in heartbeats]
    assert export(TWO, tmp_path / "a.mcap", "--format", "mcap", "--all") == 0
    told = [said for topic, schema, _, said in messages(tmp_path / "a.mcap") if schema == "mavlink.HEARTBEAT"]
    assert sorted(one["frame_index"] for one in told) == sorted(table["frame_index"].to_pylist())


@pytest.mark.slow
def test_csv_has_a_column_for_each_place_of_an_array(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As pymavlink reads it; and no two tables that a file system without upper case would take for one."""
    assert export(SQUARE, tmp_path, "--all", "--format", "csv", *SHORT) == 0
    first_us = next(iter(sent(SQUARE, "HEARTBEAT")))._timestamp * 1e6
    with (tmp_path / "EKF_STATUS_REPORT.csv").open() as file:
        assert len(list(csv.DictReader(file))) > 10
    with (tmp_path / "BATTERY_STATUS.csv").open() as file:
        rows = {int(row["t_rx_us"]): row for row in csv.DictReader(file)}
    flown = [one for one in sent(SQUARE, "BATTERY_STATUS") if 60e6 < one._timestamp * 1e6 - first_us < 69e6]
    assert flown
    for one in flown:
        row = rows[round(one._timestamp * 1e6)]
        assert [int(row[f"voltages_{at}"]) for at in range(10)] == one.voltages
    assert capsys.readouterr().err == ""
    assert main(["export", str(SQUARE), "--output", str(tmp_path), "--format", "csv", *SHORT]) == 0
    names = [path.name for path in tmp_path.iterdir()]
    left = sorted(name for name in names if name[0].isupper())
    told = capsys.readouterr().err
    assert f"not of this recording: {', '.join(left[:5])} and {len(left) - 5} more" in told
    assert len({name.lower() for name in names}) == len(names)
    assert {"attitude.csv", "ATTITUDE_sent.csv"} < set(names)


def test_no_text_from_the_air_is_a_formula(tmp_path: Path) -> None:
    """A spreadsheet computes what begins with =, +, - or @: there is a quote before it."""
    texts = (b"=cmd|'/c calc'!A1", b"+1", b"-1", b"@SUM(1)", b"a=1")
    flight = [
        (10**15 + at, wire.pack(mavutil.mavlink.MAVLink_statustext_message(6, text))) for at, text in enumerate(texts)
    ]
    (tmp_path / "a.tlog").write_bytes(wire.tlog(flight))
    assert export(tmp_path / "a.tlog", tmp_path / "csv", "--all", "--format", "csv") == 4
    with (tmp_path / "csv" / "STATUSTEXT.csv").open() as file:
        assert [row["text"] for row in csv.DictReader(file)] == ["'=cmd|'/c calc'!A1", "'+1", "'-1", "'@SUM(1)", "a=1"]


@pytest.mark.slow
def test_mcap_says_null_where_nothing_is_known(tmp_path: Path) -> None:
    """JSON knows no NaN: of a quaternion of NaN its rows say null, and there is no transform."""
    data = (FIXTURES / "c_copter_4hz.tlog").read_bytes()
    (tmp_path / "nan.tlog").write_bytes(with_nan_quaternion(data))
    assert export(tmp_path / "nan.tlog", tmp_path / "a.mcap", "--format", "mcap") == 0
    told = list(messages(tmp_path / "a.mcap"))
    rows = [said for topic, _, _, said in told if topic == "/1.1/attitude_quaternion"]
    assert [said["q_nb_w"] for said in rows if not said["valid"]] == [None]
    turns = [said for topic, _, _, said in told if topic == "/1.1/attitude_quaternion/transform"]
    assert len(turns) == len(rows) - 1


@pytest.mark.slow
def test_a_damaged_time_does_not_draw_the_timeline_out(tmp_path: Path) -> None:
    """Ten records without a time among those of a minute: the file still lasts a minute, not since 1970."""
    flight = list(wire.records((FIXTURES / "c_copter_4hz.tlog").read_bytes()))
    for at in range(300, 310):
        flight[at] = 0, flight[at][1]
    (tmp_path / "a.tlog").write_bytes(wire.tlog(flight))
    assert export(tmp_path / "a.tlog", tmp_path / "a.mcap", "--format", "mcap", "--all") == 0
    with (tmp_path / "a.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_start_time >= flight[0][0] * 1000
    assert summary.statistics.message_end_time <= flight[-1][0] * 1000


@pytest.mark.slow
def test_mcap_of_a_stream_without_times_is_on_the_vehicle_s_clock(tmp_path: Path) -> None:
    """Messages that nothing here judges too, where they carry it."""
    frames = [frame for _, frame in wire.records(SQUARE.read_bytes())]
    (tmp_path / "a.raw").write_bytes(b"".join(frames[: len(frames) // 8]))
    assert export(tmp_path / "a.raw", tmp_path / "a.mcap", "--format", "mcap", "--all") == 0
    told = {
        said["time_boot_ms"]: t_ns
        for topic, _, t_ns, said in messages(tmp_path / "a.mcap")
        if topic == "/1.1/GLOBAL_POSITION_INT"
    }
    assert len(told) > 10
    assert all(t_ns == ms * 1_000_000 for ms, t_ns in told.items())


def with_nan_quaternion(data: bytes) -> bytes:
    """The recording with NaN for w in one ATTITUDE_QUATERNION, its checksum made anew by pymavlink."""
    with tempfile.NamedTemporaryFile(suffix=".tlog") as file:
        file.write(data)
        file.flush()
        with closing(mavutil.mavlink_connection(file.name)) as log:
            for _ in range(20):
                one = log.recv_match(type="ATTITUDE_QUATERNION")
    raw = bytes(one.get_msgbuf())
    one.q1 = float("nan")
    sender = mavutil.mavlink.MAVLink(None, one.get_srcSystem(), one.get_srcComponent())
    sender.seq = one.get_seq()
    return data.replace(raw, bytes(one.pack(sender)), 1)
