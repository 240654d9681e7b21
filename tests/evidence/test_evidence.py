"""`check --evidence`: what it writes against pymavlink's and SciPy's reading of the same bytes, and what it refuses."""

import errno
import json
import math
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge.cli import main
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.paths import FIXTURES as SITL
from tests.helpers.wire import records

Row = dict[str, Any]


def faulty(name: str, fault: str, from_s: float, target: Path, *more: str) -> Path:
    """A recording with faults in it."""
    faults = [parse_fault(one) for one in (fault, *more)]
    target.write_bytes(inject((SITL / f"{name}.tlog").read_bytes(), faults, from_s=from_s))
    return target


def rows_of(path: Path) -> list[Row]:
    rows: list[Row] = pq.read_table(path).to_pylist()
    return rows


def numbers(rows: list[Row], *names: str) -> Any:
    return np.array([[row[name] for name in names] for row in rows], np.float64)


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A plane whose firmware takes 3° off ATTITUDE's pitch, with 5° of true yaw error: recording, and its evidence."""
    folder = tmp_path_factory.mktemp("plane")
    recording = faulty("d_plane_pitchtrim3", "yaw_offset:5", 15.0, folder / "plane.tlog")
    assert main(["check", str(recording), "--evidence", str(folder / "evidence"), "-q"]) == 1
    return recording, folder / "evidence" / "plane"


def parsed(data: bytes) -> Any:
    """A frame as pymavlink reads it."""
    return mavlink.MAVLink(None).parse_char(data)


@pytest.mark.slow
def test_every_frame_is_there_with_its_place(plane: tuple[Path, Path]) -> None:
    """The bytes at each offset of the file are the frame's; from the first to the last none is missing."""
    recording, evidence = plane
    data = recording.read_bytes()
    rows = rows_of(evidence / "1.1-euler_quaternion-0-1" / "frames.parquet")
    assert len(rows) > 2000
    begins = []
    at = 0
    for t_us, frame in records(data):
        begins.append((at + 8, t_us, frame))
        at += 8 + len(frame)
    (start,) = [i for i, (offset, _, _) in enumerate(begins) if offset == rows[0]["offset"]]
    for number, (row, (offset, t_us, frame)) in enumerate(zip(rows, begins[start:], strict=False), start):
        assert (row["frame"], row["offset"], row["bytes"]) == (number, offset, frame)
        assert row["t_rx_utc"].timestamp() * 1e6 == pytest.approx(t_us, abs=1)
        message = parsed(frame)
        assert row["message"] == message.get_type()
        assert row["msgid"] == message.get_msgId()
        assert (row["sysid"], row["compid"]) == (message.get_srcSystem(), message.get_srcComponent())
        assert row["seq"] == message.get_seq()


@pytest.mark.slow
def test_no_attitude_of_the_ten_seconds_on_both_sides_is_missing(plane: tuple[Path, Path]) -> None:
    """Both messages as pymavlink reads the whole file, cut to 10 s around the alarm: the same rows."""
    recording, evidence = plane
    (alarm,) = json.loads((evidence / "evidence.json").read_text())["alarms"]
    raised_ms = 1000 * alarm["raised_boot_s"]
    every = [parsed(frame) for _, frame in records(recording.read_bytes())]
    folder = evidence / alarm["folder"]
    for name, fields, columns in (
        ("ATTITUDE", ("roll", "pitch", "yaw"), ("roll_rad", "pitch_rad", "yaw_rad")),
        ("ATTITUDE_QUATERNION", ("q1", "q2", "q3", "q4"), ("q_nb_w", "q_nb_x", "q_nb_y", "q_nb_z")),
    ):
        sent = [m for m in every if m.get_type() == name and abs(m.time_boot_ms - raised_ms) <= 10_000]
        rows = rows_of(folder / f"{name.lower()}.parquet")
        assert [row["t_boot_s"] for row in rows] == [m.time_boot_ms / 1000 for m in sent]
        assert np.array_equal(numbers(rows, *columns), [[getattr(m, field) for field in fields] for m in sent])
        rates = numbers(rows, "w_nb_b_rad_s_x", "w_nb_b_rad_s_y", "w_nb_b_rad_s_z")
        assert np.array_equal(rates, [[m.rollspeed, m.pitchspeed, m.yawspeed] for m in sent])
        in_frames = {row["frame"]: parsed(row["bytes"]) for row in rows_of(folder / "frames.parquet")}
        assert [in_frames[row["frame"]].time_boot_ms for row in rows] == [m.time_boot_ms for m in sent]


def test_what_the_firmware_does_on_purpose_is_undone(plane: tuple[Path, Path]) -> None:
    """PTCH_TRIM_DEG is 3: `q_nb_undone` is the rotation of pitch + 3°, and what is left to differ is 5° of heading."""
    _, evidence = plane
    folder = evidence / "1.1-euler_quaternion-0-1"
    rows = rows_of(folder / "attitude.parquet")
    roll, pitch, yaw = numbers(rows, "roll_rad", "pitch_rad", "yaw_rad").T
    meant = Rotation.from_euler("ZYX", np.column_stack((yaw, pitch + math.radians(3.0), roll)))
    undone = numbers(rows, "q_nb_undone_x", "q_nb_undone_y", "q_nb_undone_z", "q_nb_undone_w")
    assert np.degrees((meant.inv() * Rotation.from_quat(undone)).magnitude()).max() < 1e-4
    as_sent = numbers(rows, "q_nb_x", "q_nb_y", "q_nb_z", "q_nb_w")
    assert np.degrees((meant.inv() * Rotation.from_quat(as_sent)).magnitude()) == pytest.approx(3.0, abs=1e-4)
    pairs = [row for row in rows_of(folder / "pairs.parquet") if row["residual_deg"] > 1.0]
    assert numbers(pairs, "residual_deg") == pytest.approx(5.0, abs=1e-3)
    assert numbers(pairs, "tilt_deg") == pytest.approx(0.0, abs=1e-3)
    assert numbers(pairs, "heading_deg") == pytest.approx(5.0, abs=1e-3)
    euler, quaternion = (
        Rotation.from_quat(numbers(pairs, *(f"q_nb_{name}_{part}" for part in "xyzw")))
        for name in ("euler", "quaternion")
    )
    raw = np.degrees((euler.inv() * quaternion).magnitude())
    assert numbers(pairs, "raw_deg")[:, 0] == pytest.approx(raw, abs=1e-4)
    assert 5.5 < raw.mean() < 6.0  # √(5² + 3²) where level
    assert all(row["limit_deg"] == pytest.approx(0.5 + row["bound_deg"]) for row in pairs)


def test_parameters_and_texts_in_force(plane: tuple[Path, Path]) -> None:
    """The trim was told before the alarm's ten seconds began: pymavlink's own values, and the mode."""
    recording, evidence = plane
    folder = evidence / "1.1-euler_quaternion-0-1"
    rows = {row["name"]: row for row in rows_of(folder / "parameters.parquet") if row["in_force"]}
    told = [m for m in (parsed(frame) for _, frame in records(recording.read_bytes())) if m.get_type() == "PARAM_VALUE"]
    assert told
    assert {name: row["value"] for name, row in rows.items()} == {m.param_id: m.param_value for m in told}
    said = rows_of(folder / "said.parquet")
    assert any(row["what"] == "HEARTBEAT" and row["text"].startswith("ardupilot fixed_wing") for row in said)


def test_the_summary_says_what_and_what_to_do(plane: tuple[Path, Path]) -> None:
    """What, how much, which axis, since when, why, what it is not; and each file beside it with its rows."""
    _, evidence = plane
    folder = evidence / "1.1-euler_quaternion-0-1"
    page = (folder / "summary.md").read_text()
    (alarm,) = json.loads((evidence / "evidence.json").read_text())["alarms"]
    assert page.startswith("# ALARM: ATTITUDE and ATTITUDE_QUATERNION are not one rotation: 5.00°")
    for words in (
        "**where**: heading",
        "yaw_offset 5.00°",
        alarm["diagnosis"]["fix"],
        alarm["is_not"],
        f"raised at {alarm['raised_boot_s']:.2f} s of boot 0",
        "pitch_trim 3.00°",
        "plane.tlog",
        "rerun moment.rrd",
    ):
        assert words in page
    for path in folder.glob("*.parquet"):
        assert f"| `{path.name}` | {pq.read_metadata(path).num_rows} |" in page
    assert {path.suffix for path in folder.iterdir()} == {".md", ".parquet", ".rrd"}


@pytest.mark.slow
def test_a_damaged_recording_and_two_more(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Offsets hold across damage; a good recording leaves nothing; one that cannot be used ends with 3, as without."""
    dirty = faulty("h_lossy_dirty", "yaw_offset:25", 15.0, tmp_path / "dirty.tlog")
    good = shutil.copy(SITL / "c_copter_4hz.tlog", tmp_path / "good.tlog")
    (tmp_path / "empty.tlog").touch()
    target = tmp_path / "deep" / "evidence"
    assert main(["check", str(tmp_path), "--evidence", str(target)]) == 3
    assert [path.name for path in target.iterdir()] == ["dirty"]
    data = dirty.read_bytes()
    for alarm in (target / "dirty").glob("*/frames.parquet"):
        rows = rows_of(alarm)
        assert len(rows) > 100
        for row in rows:
            assert data[row["offset"] : row["offset"] + len(row["bytes"])] == row["bytes"]
            if row["frame"] is None:  # an id that no dialect knows
                assert row["message"] is None
        known = [row["frame"] for row in rows if row["frame"] is not None]
        assert known == list(range(known[0], known[0] + len(known)))
    said = capsys.readouterr().err
    assert f"{good}: nothing was raised, so there is no evidence of it" in said
    assert "dirty.tlog: evidence of" in said


def test_without_an_alarm_nothing_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A healthy flight: exit code 0, a note on stderr, the report alone on stdout, and not even the folder."""
    arguments = ["check", str(SITL / "c_copter_4hz.tlog")]
    assert main(arguments) == 0
    without = capsys.readouterr().out
    assert main([*arguments, "--evidence", str(tmp_path / "evidence")]) == 0
    shown = capsys.readouterr()
    assert shown.out == without
    assert "nothing was raised" in shown.err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_stream_without_times(tmp_path: Path) -> None:
    """Frames one behind the other: receive times are unknown, and all else is there."""
    data = inject((SITL / "c_copter_4hz.tlog").read_bytes(), [parse_fault("yaw_offset:25")], from_s=15.0)
    stream = b"".join(frame for _, frame in list(records(data))[:2500])
    (tmp_path / "a.raw").write_bytes(stream)
    assert main(["check", str(tmp_path / "a.raw"), "--evidence", str(tmp_path / "e"), "-q"]) == 1
    (frames,) = (tmp_path / "e" / "a").glob("*euler_quaternion-0-1/frames.parquet")
    rows = rows_of(frames)
    assert b"".join(row["bytes"] for row in rows) == stream[rows[0]["offset"] :][: sum(len(r["bytes"]) for r in rows)]
    assert all(row["t_rx_utc"] is None for row in rows)
    assert all(row["t_rx_utc"] is None for row in rows_of(frames.with_name("attitude.parquet")))


@pytest.fixture
def alarming(tmp_path: Path) -> Path:
    """A short recording with an alarm."""
    flight = wire.flight(wire.Motion(14), 12)
    turned = wire.tlog(flight)
    (tmp_path / "a.tlog").write_bytes(inject(turned, [parse_fault("yaw_offset:25")], from_s=4.0))
    return tmp_path / "a.tlog"


@pytest.mark.slow
def test_earlier_evidence_is_replaced_whole(alarming: Path, tmp_path: Path) -> None:
    """What an earlier run left of an alarm that is not raised any more goes, and so does all beside it."""
    target = tmp_path / "e"
    assert main(["check", str(alarming), "--evidence", str(target), "-q"]) == 1
    (target / "a" / "1.1-gone-0-1").mkdir()
    assert main(["check", str(alarming), "--evidence", str(target), "-q"]) == 1
    index = json.loads((target / "a" / "evidence.json").read_text())
    assert {path.name for path in (target / "a").iterdir()} == {
        "evidence.json",
        *(alarm["folder"] for alarm in index["alarms"]),
    }
    assert [path.name for path in target.iterdir()] == ["a"]


def test_a_folder_that_is_no_evidence_is_left_alone(
    alarming: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """DIR/a exists and holds somebody's notes: exit code 2 and one line, before anything is judged."""
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "notes.txt").touch()
    assert main(["check", str(alarming), "--evidence", str(tmp_path)]) == 2
    shown = capsys.readouterr()
    assert shown.err.splitlines() == [
        f"gcs-bridge: error: cannot write {tmp_path / 'a'}: it is there, and no evidence: name another folder"
    ]
    assert not shown.out
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("where", ["a.tlog", "a.tlog/below", "locked/below", "\udcff"])
def test_a_folder_that_cannot_be_made(
    where: str, alarming: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file in its place or above it, no permission, or a name that is no UTF-8: exit code 2 and one line."""
    (tmp_path / "locked").mkdir(mode=0o500)
    if where.startswith("locked") and os.access(tmp_path / "locked", os.W_OK):
        pytest.skip("root may write anywhere")
    assert main(["check", str(alarming), "--evidence", str(tmp_path / where)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    shown = str(tmp_path / where).replace("\udcff", r"\udcff")
    assert line.startswith(f"gcs-bridge: error: cannot write {shown}: ")


def test_a_disk_that_fills_up(alarming: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit code 2, and nothing is left that is not whole."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pq, "write_table", full)
    assert main(["check", str(alarming), "--evidence", str(tmp_path / "e")]) == 2
    assert not list((tmp_path / "e").iterdir())


@pytest.mark.slow
def test_names_that_are_none_or_the_same(alarming: Path, tmp_path: Path) -> None:
    """A name that is no UTF-8 becomes one that is; of two recordings of one name the second is numbered."""
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        shutil.copy(alarming, tmp_path / folder / "flight.tlog")
    odd = os.fsencode(tmp_path / "one") + b"/\xff\n.tlog"
    shutil.copy(os.fsencode(alarming), odd)
    target = tmp_path / "e"
    paths = [str(tmp_path / "one"), str(tmp_path / "two")]
    assert main(["check", *paths, "--evidence", str(target), "-q"]) == 1
    assert sorted(path.name for path in target.iterdir()) == ["__", "flight", "flight-2"]
    page = next((target / "__").glob("*euler*/summary.md")).read_text()
    assert r"\xff" in page
    sources = [
        json.loads((target / name / "evidence.json").read_text())["recording"] for name in ("flight", "flight-2")
    ]
    assert sources == [str(tmp_path / "one" / "flight.tlog"), str(tmp_path / "two" / "flight.tlog")]


@pytest.mark.slow
def test_too_many_alarms_are_left_out(
    alarming: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With room for one alarm in the run, the second recording has none, and the line about it says so."""
    monkeypatch.setattr("gcs_bridge.evidence.place._MOST_OF_ALL", 1)
    shutil.copy(alarming, tmp_path / "b.tlog")
    assert main(["check", str(tmp_path), "--evidence", str(tmp_path / "e")]) == 1
    assert [path.name for path in (tmp_path / "e").iterdir()] == ["a"]
    assert len(json.loads((tmp_path / "e" / "a" / "evidence.json").read_text())["alarms"]) == 1
    assert "b.tlog: no room for" in capsys.readouterr().err
