"""`gcs-bridge check` as people run it, on what it cannot use: one clear line, its exit code, nothing half-written."""

import contextlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from gcs_bridge.cli import main
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.paths import FIXTURES as SITL

GOOD = SITL / "c_copter_4hz.tlog"
ALARMING = SITL / "k8_stream_stops.tlog"
EXPLAINED = SITL / "d_plane_pitchtrim3.tlog"
TWO = SITL / "e_two_vehicles.tlog"

NOTHING, ALARM, USAGE, SOURCE, NO_COMPARE = 0, 1, 2, 3, 4


class Ended(NamedTuple):
    code: int
    out: str
    err: list[str]


def check(*arguments: Any, folder: Path | None = None) -> Ended:
    """Run the command in this process: what the installed one does beside is another's matter."""
    said, err = io.BytesIO(), io.StringIO()
    out = io.TextIOWrapper(said, encoding="utf-8", write_through=True)
    with contextlib.chdir(folder or "."), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["check", *map(str, arguments)])
    return Ended(code, said.getvalue().decode(), err.getvalue().splitlines())


def check_installed(*arguments: Any, folder: Path | None = None, prefix: Iterable[str] = ()) -> Ended:
    """Run the installed command."""
    command = [*prefix, str(Path(sys.executable).with_name("gcs-bridge")), "check", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=folder, check=False)
    assert "Traceback" not in done.stderr + done.stdout
    return Ended(done.returncode, done.stdout, done.stderr.splitlines())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of files that are no recordings, each for a reason of its own."""
    made = tmp_path_factory.mktemp("bad input")
    (made / "empty.tlog").touch()
    (made / "text.tlog").write_text("time,roll,pitch,yaw\n" * 1000)
    (made / "noise.tlog").write_bytes(np.random.default_rng(0).bytes(100_000))
    (made / "fragment.tlog").write_bytes(GOOD.read_bytes()[:25])
    (made / "log.bin").write_bytes(b"\xa3\x95\x80\x80\x59FMT\0BBnNZ" + bytes(500))
    (made / "log.ulg").write_bytes(b"ULog\x01\x12\x35\x01" + bytes(500))
    (made / "log.px4log").write_bytes(b"\xa3\x95\x80" + bytes(500))
    (made / "packed.tlog.gz").write_bytes(b"\x1f\x8b\x08\0" + bytes(500))
    (made / "bare").mkdir()
    (made / "bare" / "readme.txt").write_text("no recording")
    return made


# --- sources that cannot be used -------------------------------------------------------------------------------------

# Each is one line on stderr; `said` is what it must tell about the file.
SOURCES = [
    ("missing.tlog", "no such file"),
    ("bare", "no recording"),
    ("empty.tlog", "empty"),
    ("text.tlog", "not a telemetry recording"),
    ("noise.tlog", "not a telemetry recording"),
    ("fragment.tlog", "not a telemetry recording"),
    ("log.bin", "MAVExplorer"),
    ("log.ulg", "pyulog"),
    ("log.px4log", "on-board log"),
    ("packed.tlog.gz", "nothing of it can be unpacked"),
]


@pytest.mark.parametrize("name", ["missing.tlog", "bare", "noise.tlog"])
def test_one_source_that_cannot_be_used(name: str, folder: Path) -> None:
    """It ends with 3 and one line that names the file; there is no report."""
    ended = check(folder / name, "--format", "json", "--output", folder / "report.json")
    assert ended.code == SOURCE
    assert ended.out == ""
    (line,) = ended.err
    assert str(folder / name) in line
    assert dict(SOURCES)[name] in line
    assert not (folder / "report.json").exists()


@pytest.mark.slow
def test_many_sources_that_cannot_be_used(folder: Path) -> None:
    """Several of them are one line each, in the order given; the good one among them is judged; the exit code is 3."""
    names = [name for name, _ in SOURCES]
    ended = check_installed(*names[:5], GOOD, *names[5:], folder=folder)
    assert ended.code == SOURCE
    assert len(ended.err) == len(SOURCES)
    assert all(line.startswith("gcs-bridge: error: ") for line in ended.err)
    for name, said in SOURCES:
        (line,) = [line for line in ended.err if f" {name}:" in line]
        assert said in line
    assert ended.out.splitlines()[-1].startswith("AGREE")


def test_never_fails_on_a_bad_source_too(folder: Path) -> None:
    """`--fail-on never` turns neither 3 nor 2 into 0."""
    assert check(folder / "noise.tlog", "--fail-on", "never").code == SOURCE
    assert check(GOOD, "--fail-on", "never", "--profile", "nonsuch").code == USAGE


# Root may read everything; without two of his capabilities (Linux: PR_CAPBSET_DROP, CAP_DAC_*) what others may.
AS_OTHERS = """
import ctypes, os, sys
for capability in (1, 2):
    ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""


@pytest.mark.slow
def test_no_permission(tmp_path: Path) -> None:
    """A file that may not be read is a source that cannot be used, with the reason; another one beside it is judged."""
    locked = tmp_path / "locked.tlog"
    locked.write_bytes(GOOD.read_bytes())
    locked.chmod(0)
    prefix: list[str] = []
    if os.access(locked, os.R_OK):
        prefix = [sys.executable, "-c", AS_OTHERS]
        if subprocess.run([*prefix, "/bin/cat", locked], capture_output=True, check=False).returncode == 0:
            pytest.skip("runs as root, whose privileges cannot be dropped here: every file can be read")
    ended = check_installed(locked, GOOD, prefix=prefix)
    assert ended.code == SOURCE
    (line,) = ended.err
    assert str(locked) in line
    assert "permission" in line
    assert ended.out.splitlines()[-1].startswith("AGREE")


def test_a_truncated_recording_is_judged(tmp_path: Path) -> None:
    """A last record that is cut off, anywhere, costs that record alone: the rest is judged, and it ends with 0."""
    data = GOOD.read_bytes()
    cuts = []
    for missing in (1, 5, 40):
        cuts.append(tmp_path / f"cut_{missing}.tlog")
        cuts[-1].write_bytes(data[:-missing])
    ended = check(*cuts, "--format", "json")
    assert ended.code == NOTHING
    assert ended.err == []
    for entry in json.loads(ended.out)["files"]:
        assert entry["verdict"] == "agree"
        assert 0 < entry["salvage"]["skipped_bytes"] < 320
        assert entry["salvage"]["gap_count"] == 1
        assert entry["salvage"]["frames"] >= 3790


def test_a_report_that_is_no_recording_s_fault(folder: Path) -> None:
    """stdout carries the result alone: JSON stays JSON beside a file that cannot be used."""
    ended = check(folder / "empty.tlog", GOOD, "--format", "json")
    assert ended.code == SOURCE
    assert len(ended.err) == 1
    report = json.loads(ended.out)
    assert report["schema"] == "gcs-bridge/report/1"
    assert [Path(entry["path"]).name for entry in report["files"]] == [GOOD.name]


# --- usage and configuration -----------------------------------------------------------------------------------------

CONFIGS = {
    "key.toml": ("[euler_quaternion]\nlimt_deg = 1.0\n", ["limt_deg", "limit_deg"]),
    "section.toml": ("[euler_quaternions]\nlimit_deg = 1.0\n", ["euler_quaternions", "euler_quaternion"]),
    "value.toml": ("[euler_quaternion]\nlimit_deg = -1\n", ["limit_deg", "above 0"]),
    "kind.toml": ('[stream]\nstale_after_s = "soon"\n', ["stale_after_s", "number"]),
    "syntax.toml": ("[euler_quaternion\nlimit_deg = 1.0\n", ["line 1", "not TOML"]),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_a_wrong_configuration(name: str, tmp_path: Path) -> None:
    """A wrong key, section, value, kind or syntax ends with 2 and one line: the file, the place, and what is right."""
    text, said = CONFIGS[name]
    (tmp_path / name).write_text(text)
    ended = check(GOOD, "--config", tmp_path / name)
    assert ended.code == USAGE
    assert ended.out == ""
    (line,) = ended.err
    assert str(tmp_path / name) in line
    assert [words for words in said if words in line] == said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--profile", "defualt"], "'default'"),
        (["--config", "nowhere.toml"], "nowhere.toml"),
        (["--dialect", "nonsuch"], "'nonsuch'"),
        (["--dialect", "minimal"], "ATTITUDE"),
        (["--from", "1000"], "--from"),
        (["--output", "nowhere/report.json"], "nowhere"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_wrong_usage(arguments: list[str], said: str, tmp_path: Path) -> None:
    """An unknown name, a time past the end or an output without a folder: 2, one line, no report, nothing written."""
    ended = check(GOOD, *arguments, folder=tmp_path)
    assert ended.code == USAGE
    assert ended.out == ""
    (line,) = ended.err
    assert line.startswith("gcs-bridge: error: ")
    assert said in line
    assert list(tmp_path.iterdir()) == []


def test_past_the_end_says_where_the_end_is() -> None:
    """`--from` past the end names the recording and how long it is, 32.8 s by its first and its last record time."""
    (line,) = check(GOOD, "--from", "34").err
    assert str(GOOD) in line
    assert "32.8 s" in line


def test_a_wrong_output_does_not_touch_what_is_there(tmp_path: Path) -> None:
    """An earlier report stays as it is when the source cannot be used; with a good one it is replaced as a whole."""
    report = tmp_path / "report.json"
    report.write_text("before")
    assert check(tmp_path / "missing.tlog", "--format", "json", "--output", report).code == SOURCE
    assert report.read_text() == "before"
    ended = check(GOOD, "--format", "json", "--output", report, "--quiet")
    assert (ended.code, ended.out, ended.err) == (NOTHING, "", [])
    assert json.loads(report.read_text())["verdict"] == "agree"
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]


# --- exit codes ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def no_quaternion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A healthy recording without ATTITUDE_QUATERNION, as most are."""
    path = tmp_path_factory.mktemp("recordings") / "no_quaternion.tlog"
    path.write_bytes(wire.tlog(wire.flight(wire.Motion(8), 6, quaternion_hz=0)))
    return path


@pytest.fixture(scope="module")
def nothing_beside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Angles alone, without the other form, body rates or a sensor: nothing to compare them with."""
    motion = wire.Motion(8)
    frames = [(n, wire.attitude(10_000 + 40 * n, motion.rpy(0.04 * n), seq=n)) for n in range(150)]
    path = tmp_path_factory.mktemp("recordings") / "nothing_beside.tlog"
    path.write_bytes(wire.tlog((wire.START_US + 40_000 * n, frame) for n, frame in frames))
    return path


@pytest.mark.parametrize(
    ("names", "code"),
    [
        (["good", "explained"], NOTHING),
        (["alarm"], ALARM),
        (["good", "none"], NO_COMPARE),
        (["none", "alarm", "good"], ALARM),
        (["missing", "alarm", "none", "good"], SOURCE),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else str(value),
)
def test_the_worst_of_several(names: list[str], code: int, nothing_beside: Path) -> None:
    """Several files end with the worst: 3 before 1 before 4 before 0; each has its last line, verdict first."""
    files = {"good": GOOD, "explained": EXPLAINED, "alarm": ALARMING, "none": nothing_beside}
    ended = check(*[files.get(name, f"{name}.tlog") for name in names], "--quiet")
    assert ended.code == code
    verdicts = {"good": "AGREE", "explained": "AGREE", "alarm": "ALARM", "none": "NO COMPARE"}
    lines = [line for line in ended.out.splitlines() if line.startswith(tuple(verdicts.values()))]
    assert [line.split("  ")[0].strip() for line in lines] == [verdicts[name] for name in names if name != "missing"]
    assert len(ended.err) == names.count("missing")


def test_never_fail(nothing_beside: Path) -> None:
    """`--fail-on never` turns an alarm and a NO COMPARE into 0; the verdicts stay."""
    ended = check(ALARMING, nothing_beside, "--fail-on", "never", "--format", "json")
    assert ended.code == NOTHING
    report = json.loads(ended.out)
    assert report["verdict"] == "alarm"
    assert [entry["verdict"] for entry in report["files"]] == ["alarm", "no_compare"]


def test_what_to_type_next(no_quaternion: Path, nothing_beside: Path) -> None:
    """Without the quaternion the text says that it is missing and ends with the command that gets it: the angles may
    have been judged by their own rates, or by nothing.
    """
    for path, code in ((no_quaternion, NOTHING), (nothing_beside, NO_COMPARE)):
        ended = check(path)
        assert ended.code == code
        assert "ATTITUDE_QUATERNION was never received" in " ".join(ended.out.split())
        assert "SET_MESSAGE_INTERVAL 31" in ended.out.splitlines()[-1]


@pytest.mark.slow
def test_one_system(tmp_path: Path) -> None:
    """With `--sysid` the file has the verdict of that system alone; one that is not there was not compared: 4."""
    faulty = tmp_path / "two.tlog"
    faulty.write_bytes(inject(TWO.read_bytes(), [parse_fault("yaw_offset:25")], sysid=2))
    assert check(faulty).code == ALARM
    alone = {sysid: check(faulty, "--sysid", sysid, "--format", "json") for sysid in (1, 2, 3)}
    assert {sysid: ended.code for sysid, ended in alone.items()} == {1: NOTHING, 2: ALARM, 3: NO_COMPARE}
    for sysid, ended in alone.items():
        (entry,) = json.loads(ended.out)["files"]
        assert [vehicle["sysid"] for vehicle in entry["vehicles"]] == ([sysid] if sysid < 3 else [])
        assert entry["salvage"]["frames"] == 3140  # what was read of the file does not depend on it


def test_a_window(tmp_path: Path) -> None:
    """Between `--from` and `--to` alone is judged: a fault in 12…20 s shows in 10…25, not in 0…11 or 23…33."""
    faulty = tmp_path / "window.tlog"
    faulty.write_bytes(inject(GOOD.read_bytes(), [parse_fault("yaw_offset:25")], from_s=12, to_s=20))
    code = {
        (begin, end): check(faulty, "--from", begin, "--to", end, "--format", "json")
        for begin, end in ((0, 11), (10, 25), (23, 33))
    }
    assert [ended.code for ended in code.values()] == [NOTHING, ALARM, NOTHING]
    for (begin, end), ended in code.items():
        (entry,) = json.loads(ended.out)["files"]
        (vehicle,) = entry["vehicles"]
        assert vehicle["streams"]["ATTITUDE"]["count"] == pytest.approx(4 * (end - begin), abs=2)
        (boot,) = vehicle["boots"]
        assert boot["last_boot_s"] - boot["first_boot_s"] == pytest.approx(end - begin, abs=0.6)
        assert vehicle["autopilot"] == "ardupilot"


def test_a_stream_without_times(tmp_path: Path) -> None:
    """A .raw stream has no times to select by: 2, saying so; whole it is judged as any recording."""
    raw = tmp_path / "link.raw"
    raw.write_bytes(b"".join(frame for _, frame in wire.flight(wire.Motion(8), 6)))
    (line,) = (ended := check(raw, "--from", "2")).err
    assert ended.code == USAGE
    assert "no record times" in line
    assert check(raw, "--quiet").code == NOTHING
