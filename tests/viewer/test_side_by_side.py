"""Several recordings in one scene: each under its name, all on one timeline."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs_bridge.cli import main, replay_run
from gcs_bridge.cli.replay_run import labels_of
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.viewer.processes import free_port
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.viewer_tools import HEADLESS_PORT, Drawn, can_draw, eventually, headless, time_panel, verify

S = 1_000_000
SECONDS = 9.0
MOTIONS = {"before": wire.Motion(SECONDS, seed=1), "after": wire.Motion(SECONDS, seed=2)}
STARTS_US = {"before": wire.START_US, "after": wire.START_US + 86_400 * S}  # a day later
BOOTS_MS = {"before": 10_000, "after": 500_000}
TURN = "Transform3D:quaternion"


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Two flights of a day between them; in each the quaternion is false from a second of its own on."""
    folder = tmp_path_factory.mktemp("flights")
    found = {}
    for name, from_s in (("before", 3.0), ("after", 4.0)):
        records = wire.flight(MOTIONS[name], SECONDS, start_us=STARTS_US[name], boot_ms=BOOTS_MS[name])
        found[name] = folder / f"{name}.tlog"
        found[name].write_bytes(inject(wire.tlog(records), [parse_fault("yaw_offset:25")], from_s=from_s))
    return found


def replayed(flights: dict[str, Path], folder: Path, *options: str) -> Drawn:
    path = folder / "a.rrd"
    assert main(["replay", *map(str, flights.values()), "--viewer", f"save:{path}", "-q", *options]) == 0
    return Drawn(path)


@pytest.fixture(scope="module")
def started(flights: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both, as they are shown if nothing else is asked for."""
    path = tmp_path_factory.mktemp("started") / "a.rrd"
    assert main(["replay", *map(str, flights.values()), "--viewer", f"save:{path}", "-q"]) == 0
    verify(path)
    assert [entry.name for entry in path.parent.iterdir()] == ["a.rrd"]
    return path


def raised_us(path: Path, folder: Path) -> int:
    """When the first alarm of a recording was raised, µs of boot time, by the report."""
    report = folder / "report.json"
    assert main(["check", str(path), "-q", "--format", "json", "--output", str(report)]) == 1
    alarms = json.loads(report.read_text())["files"][0]["vehicles"][0]["alarms"]
    report.unlink()
    first_s: float = min(alarm["raised_boot_s"] for alarm in alarms if alarm["severity"] == "alarm")
    return round(1e6 * first_s)


@pytest.mark.slow
def test_both_start_at_zero(started: Path) -> None:
    """Every attitude lies where it was received after its recording's start, and is the one that SciPy gives there."""
    drawn = Drawn(started)
    assert drawn.names == ["gcs-bridge-before-tlog-after-tlog"]
    assert drawn.timelines() == {"boot", "utc", "since_start"}
    for name, motion in MOTIONS.items():
        at_us, xyzw = drawn.numbers(f"/vehicle/{name}-1.1/body/euler", TURN, "since_start")
        assert at_us.tolist() == [40_000 * i for i in range(225)]
        turned = Rotation.from_quat(xyzw).inv() * motion.rotation(at_us / 1e6)
        assert turned.magnitude().max() < 1e-6
        boot_us, _ = drawn.numbers(f"/vehicle/{name}-1.1/body/euler", TURN)
        assert boot_us.tolist() == (at_us + 1000 * BOOTS_MS[name]).tolist()
        rx_us, _ = drawn.numbers(f"/vehicle/{name}-1.1/body/euler", TURN, "utc")
        assert rx_us.tolist() == (at_us + STARTS_US[name]).tolist()
    assert {"/vehicle/before-1.1/body", "/vehicle/after-1.1/body", "/", "/axes"} <= drawn.static()


@pytest.mark.slow
def test_each_is_named_and_has_its_place(started: Path) -> None:
    """Names above the bodies and before the lines of the log; two places in the picture."""
    drawn = Drawn(started)
    places = []
    for name in MOTIONS:
        _, tags = drawn.rows(f"/vehicle/{name}-1.1/body/name", "Points3D:labels", "since_start")
        assert tags[-1] == [f"{name}-1.1 ALARM"]
        _, texts = drawn.rows(f"/vehicle/{name}-1.1/events", "TextLog:text", "since_start")
        assert texts[0][0].startswith(f"{name}  ")
        places += [tuple(row[0]) for row in drawn.fixed(f"/vehicle/{name}-1.1/body", "Transform3D:translation")]
    assert len(set(places)) == 2


@pytest.mark.slow
def test_both_alarms_lie_at_zero(flights: dict[str, Path], tmp_path: Path) -> None:
    """What was before its alarm lies before zero; and it can open there."""
    (tmp_path / "drawn").mkdir()
    drawn = replayed(flights, tmp_path / "drawn", "--align", "alarm", "--at", "alarm")
    assert opened_at(tmp_path / "drawn" / "a.rrd") == ("since_alarm", 0.0)
    for name, path in flights.items():
        entity = f"/vehicle/{name}-1.1/body/euler"
        (at_us, _), (boot_us, _) = drawn.rows(entity, TURN, "since_alarm"), drawn.rows(entity, TURN)
        assert at_us[0] < -3 * S
        assert set((boot_us - at_us).tolist()) == {raised_us(path, tmp_path)}


@pytest.mark.slow
def test_by_receive_time_nothing_is_moved(flights: dict[str, Path], tmp_path: Path) -> None:
    """The timeline is the one that is there already; a stream without times has no place on it, and that is told."""
    assert replayed(flights, tmp_path, "--align", "utc").timelines() == {"boot", "utc"}


@pytest.mark.slow
def test_streams_without_times_start_at_zero_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By their boot clocks; but they have no place among receive times."""
    files = {}
    for name in ("one", "two"):
        frames = [frame for _, frame in wire.flight(wire.Motion(3.0), 3.0, boot_ms=BOOTS_MS["after"])]
        files[name] = tmp_path / f"{name}.raw"
        files[name].write_bytes(b"".join(frames))
    (tmp_path / "drawn").mkdir()
    drawn = replayed(files, tmp_path / "drawn")
    assert drawn.timelines() == {"boot", "since_start"}
    at_us, _ = drawn.rows("/vehicle/two-1.1/body/euler", TURN, "since_start")
    assert at_us.tolist() == [40_000 * i for i in range(75)]
    assert main(["replay", *map(str, files.values()), "--viewer", "none", "--align", "utc"]) == 2
    assert "no record times, so --align utc" in capsys.readouterr().err


@pytest.mark.slow
def test_a_recording_without_an_alarm_cannot_be_aligned_at_one(
    flights: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and one line that says what to do; no file is left."""
    healthy = tmp_path / "healthy.tlog"
    healthy.write_bytes(wire.tlog(wire.flight(MOTIONS["before"], 5.0)))
    arguments = [str(flights["after"]), str(healthy), "--align", "alarm", "--viewer", f"save:{tmp_path / 'a.rrd'}"]
    assert main(["replay", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "healthy.tlog: no alarm" in line
    assert "--align start" in line
    assert not list(tmp_path.glob("*.rrd"))


@pytest.mark.slow
def test_one_that_cannot_be_read_leaves_the_others(
    flights: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is named, and the exit code is its own; the others are shown as if it had not been given."""
    path = tmp_path / "a.rrd"
    files = [str(flights["before"]), str(tmp_path / "missing.tlog"), str(flights["after"])]
    assert main(["replay", *files, "--viewer", f"save:{path}", "-q"]) == 3
    assert "missing.tlog" in capsys.readouterr().err
    assert len(Drawn(path).rows("/vehicle/after-1.1/body/euler", TURN, "since_start")[0]) == 225


@pytest.mark.slow
def test_paced_all_play_at_once(flights: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their events come in the order of the timeline, not one recording after the other."""
    monkeypatch.setattr(replay_run, "_PACED_BYTES", (64, 512))  # however slow this machine is
    events = tmp_path / "events.jsonl"
    arguments = [*map(str, flights.values()), "--speed", "1e6", "--viewer", "none", "-q", "--events", str(events)]
    assert main(["replay", *arguments]) == 0
    told = [json.loads(line) for line in events.read_text().splitlines()]
    came_s = [
        (event["boot_s"] - BOOTS_MS[name] / 1000, name)
        for event in told
        for name in [Path(event["link"]).stem]
        if event["boot_s"] is not None and event["event"] == "alarm_raised"
    ]
    assert [name for _, name in came_s] == ["before", "after"]
    links = [Path(event["link"]).stem for event in told]
    assert links != sorted(links, key=list(flights).index)


@pytest.mark.parametrize(
    ("at", "words"),
    one_in(
        2,
        [
            ("1.1-euler_quaternion-0-9", "no such alarm: there are 1.1-euler_quaternion-0-1"),
            ("gravity", "no alarm of gravity was raised"),
        ],
        swept=False,
    ),
)
def test_an_alarm_that_is_not_there(
    at: str, words: str, flights: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A wrong id is refused, with those that there are; of a check without an alarm it is told, as of all checks."""
    path = tmp_path / "a.rrd"
    code = main(["replay", str(flights["after"]), "--at", at, "--viewer", f"save:{path}", "-q"])
    assert code == (2 if at[0] == "1" else 0)
    assert words in capsys.readouterr().err


def opened_at(path: Path) -> tuple[str, float]:
    """The timeline by which a file opens, and the middle of what its plots show, s."""
    panel = time_panel(path)
    assert panel["play_state"] == 1  # paused
    bounds = panel["time_selection"]
    return panel["timeline"], (bounds["min"] + bounds["max"]) / 2e9


@pytest.mark.slow
@pytest.mark.parametrize("at", one_in(2, ["alarm", "1.1-euler_quaternion-0-1"]))
def test_it_opens_around_the_alarm(at: str, flights: dict[str, Path], tmp_path: Path) -> None:
    """Of several the first file's in which there is one; on the common timeline."""
    path = tmp_path / "a.rrd"
    assert main(["replay", *map(str, flights.values()), "--at", at, "--viewer", f"save:{path}", "-q"]) == 0
    timeline, at_s = opened_at(path)
    assert timeline == "since_start"
    assert at_s == pytest.approx(raised_us(flights["before"], tmp_path) / 1e6 - 10, abs=1e-3)


@pytest.mark.slow
def test_it_opens_around_a_second(flights: dict[str, Path], tmp_path: Path) -> None:
    """Counted from the first recording's start, whatever they are aligned by."""
    path = tmp_path / "a.rrd"
    options = ["--align", "utc", "--at", "7.25", "--viewer", f"save:{path}", "-q"]
    assert main(["replay", *map(str, flights.values()), *options]) == 0
    timeline, at_s = opened_at(path)
    assert timeline == "utc"
    assert at_s == pytest.approx(wire.START_US / 1e6 + 7.25, abs=1e-3)


@pytest.mark.slow
def test_the_second_may_be_past_the_end_of_one_of_them(flights: dict[str, Path], tmp_path: Path) -> None:
    """As long as another lasts until then."""
    short, path = tmp_path / "short.tlog", tmp_path / "a.rrd"
    short.write_bytes(wire.tlog(wire.flight(MOTIONS["before"], 3.0)))
    assert main(["replay", str(short), str(flights["after"]), "--at", "6", "--viewer", f"save:{path}", "-q"]) == 0
    assert opened_at(path)[1] == pytest.approx(6.0, abs=1e-3)
    assert main(["replay", str(short), str(flights["after"]), "--at", "10", "--viewer", f"save:{path}", "-q"]) == 2


def test_names_are_short_and_no_two_are_the_same() -> None:
    """Signs that paths of the viewer cannot hold are left out; the end of a long name tells more than its beginning."""
    names = ["a/f.tlog", "b/f.tlog", "b/f.tlog", "2026-11-22 00-45-53 flight test.tlog", "ü.tlog", "-.tlog"]
    assert labels_of([Path(name) for name in names]) == [
        "a_f",
        "b_f",
        "b_f-2",
        "00-45-53_flight_test",
        "recording",
        "recording-2",
    ]


@pytest.mark.slow
@can_draw
def test_the_viewer_turns_all_of_them_as_scipy_does(started: Path) -> None:
    """At one instant of the common timeline, each by its own motion; nothing is complained of."""
    with headless(started, free_port(HEADLESS_PORT)) as viewer:
        viewer.wait_for("since_start", 8_900_000)
        viewer.go_to(7_000_000, "since_start")
        for name, motion in MOTIONS.items():
            seen = viewer.matrix(f"/vehicle/{name}-1.1/body/euler")
            assert seen == pytest.approx(motion.rotation(7.0).as_matrix(), abs=1e-6)
        assert eventually(lambda: viewer.views().count("3D") == 1)
        assert viewer.errors() == []
        assert np.allclose(np.array(viewer.edge("/vehicle/before-1.1/body")["source"]["parent_from_child"])[:3, 3], 0)
