"""The command line around `check`: arguments, outputs and exit codes; what is judged is made up here."""

import json
import os
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge._version import __version__
from gcs_bridge.cli import main
from gcs_bridge.cli.check import find_recordings
from gcs_bridge.errors import SourceError, UsageError
from gcs_bridge.report.schema import File
from tests.helpers.everyday import one_in
from tests.helpers.paths import ROOT
from tests.helpers.report_entries import file, vehicle, without_quaternion

Judge = Callable[..., File]


def judged_by_name(path: Path, settings: Any, **asked: Any) -> File:
    """What the made-up judge finds depends on the file's name."""
    asked["progress"](1, 1)
    name = path.name.split(".")[0]
    if name.startswith("broken"):
        raise SourceError(f"{path}: without one valid frame")
    if name.startswith("short"):
        raise UsageError(f"{path}: --from 99 is past the end")
    if name.startswith("bug"):
        raise ZeroDivisionError
    one = without_quaternion() if name == "no_compare" else vehicle(name)
    return file(one, verdict=name, path=str(path))


@pytest.fixture
def judge(monkeypatch: pytest.MonkeyPatch) -> Callable[[Judge], None]:
    """Puts a made-up judge in the place of the real one."""

    def replace(check_file: Judge) -> None:
        stand_in = types.ModuleType("gcs_bridge.recordings.check")
        stand_in.check_file = check_file  # type: ignore[attr-defined]  # a module made by hand
        monkeypatch.setitem(sys.modules, "gcs_bridge.recordings.check", stand_in)

    return replace


@pytest.fixture
def folder(tmp_path: Path, judge: Callable[[Judge], None], monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with recordings that are judged by their names."""
    judge(judged_by_name)
    for name in ("agree", "alarm", "warning", "no_compare", "broken", "short", "bug"):
        (tmp_path / f"{name}.tlog").write_bytes(b"x")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def python(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=False, timeout=60, **options
    )


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    """--version prints the package's version on stdout and ends well."""
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"gcs-bridge {__version__}\n"


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], ["check", "--help"]])
def test_help(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Help goes to stdout and tells the exit codes."""
    assert main(arguments) == 0
    shown = capsys.readouterr()
    assert "Exit codes: 0 good" in shown.out
    assert not shown.err


@pytest.mark.parametrize(
    "arguments",
    one_in(3, [["--help"], ["check", "--help"], ["--version"], ["check", "none", "--profile", "x"]], swept=False),
)
def test_nothing_heavy_is_imported_to_help_or_refuse(arguments: list[str]) -> None:
    """Help, version and refusals load no numerics, no viewer and no MAVLink tables."""
    heavy = {"numpy", "numba", "rerun", "pymavlink", "scipy", "rich.progress"}
    program = (
        f"import sys; from gcs_bridge.cli import main; main({arguments!r}); "
        f"print(sorted({heavy!r} & set(sys.modules)), file=sys.stderr)"
    )
    assert python("-c", program).stderr.splitlines()[-1] == "[]"


@pytest.mark.slow
def test_help_is_quick() -> None:
    """--help takes less than 0.4 s of a processor, in a fresh process, at its best of three."""

    def cpu_s() -> float:
        before = os.times()
        python("-c", "from gcs_bridge.cli import main; main(['--help'])")
        after = os.times()
        return after.children_user - before.children_user + after.children_system - before.children_system

    assert min(cpu_s() for _ in range(3)) < 0.4


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux lists a process's threads where a test can count them")
def test_numpy_begins_no_thread_that_nothing_is_given_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """On each processor one would look for work for a while, beside the threads that have some."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    recording = str(ROOT / "sitl_fixtures" / "e_two_vehicles.tlog")
    program = (
        f"import os; from gcs_bridge.cli import main; main(['check', '-q', {recording!r}]); "
        "print(len(os.listdir('/proc/self/task')))"
    )
    assert python("-c", program).stdout.split()[-1] == "1"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "a command is missing"),
        (["chek"], "No such command"),
        (["check"], "Missing argument"),
        (["check", "agree.tlog", "--frmo", "3"], "No such option"),
        (["check", "agree.tlog", "--sysid", "0"], "--sysid"),
        (["check", "agree.tlog", "--sysid", "256"], "--sysid"),
        (["check", "agree.tlog", "--format", "yaml"], "--format"),
        (["check", "agree.tlog", "--fail-on", "always"], "--fail-on"),
        (["check", "agree.tlog", "--from", "-1"], "--from -1"),
        (["check", "agree.tlog", "--to", "nan"], "--to nan"),
        (["check", "agree.tlog", "--from", "5", "--to", "5"], "--to 5 is not after --from 5"),
        (["check", "agree.tlog", "--to", "0"], "--to 0 is not after --from 0"),
        (["check", "agree.tlog", "--profile", "cii"], "unknown profile 'cii'; did you mean 'ci'?"),
        (["check", "agree.tlog", "--config", "none.toml"], "none.toml: cannot be read"),
        (["check", "agree.tlog", "--output", "none/report.json"], "there is no folder"),
        (["check", "agree.tlog", "--output", "."], "it is a folder"),
        (["check", "agree.tlog", "--output", "agree.tlog"], "one of the recordings"),
        (["check", ".", "--output", "alarm.tlog"], "one of the recordings"),
        (["check", "short.tlog"], "past the end"),
        (["check", "agree.tlog", "short.tlog"], "past the end"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_wrong_usage_is_one_line_and_2(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A mistake of the user is one line on stderr, nothing on stdout, and exit code 2."""
    assert main(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("gcs-bridge: error: ")
    assert said in shown.err
    assert shown.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["agree.tlog"], 0),
        (["alarm.tlog"], 1),
        (["warning.tlog"], 0),
        (["warning.tlog", "--fail-on", "warning"], 1),
        (["warning.tlog", "--profile", "ci"], 1),
        (["warning.tlog", "--profile", "ci", "--fail-on", "alarm"], 0),
        (["no_compare.tlog"], 4),
        (["no_compare.tlog", "alarm.tlog"], 1),
        (["no_compare.tlog", "agree.tlog"], 4),
        (["broken.tlog"], 3),
        (["alarm.tlog", "broken.tlog", "agree.tlog"], 3),
        (["alarm.tlog", "no_compare.tlog", "--fail-on", "never"], 0),
        (["broken.tlog", "alarm.tlog", "--fail-on", "never"], 3),
    ],
)
@pytest.mark.usefixtures("folder")
def test_exit_code_is_the_worst_found(arguments: list[str], code: int) -> None:
    """3 before 1 before 4 before 0; --fail-on decides about 1 and 4 only."""
    assert main(["check", *arguments]) == code


@pytest.mark.usefixtures("folder")
def test_a_broken_file_does_not_hide_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    """Its line goes to stderr, and the others are judged into one report."""
    assert main(["check", "broken.tlog", "agree.tlog", "alarm.tlog", "--format", "json"]) == 3
    shown = capsys.readouterr()
    assert shown.err == "gcs-bridge: error: broken.tlog: without one valid frame\n"
    report = json.loads(shown.out)
    assert [file["path"] for file in report["files"]] == ["agree.tlog", "alarm.tlog"]
    assert report["verdict"] == "alarm"


@pytest.mark.usefixtures("folder")
def test_without_any_usable_file_there_is_no_report(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing judged: stdout stays empty and no output is written."""
    assert main(["check", "broken.tlog", "--output", "report.txt"]) == 3
    assert capsys.readouterr().out == ""
    assert not Path("report.txt").exists()


@pytest.mark.usefixtures("folder")
def test_a_mistake_of_the_program_is_no_alarm(capsys: pytest.CaptureFixture[str]) -> None:
    """An unforeseen exception shows its traceback and ends with 70, which no verdict uses."""
    assert main(["check", "bug.tlog"]) == 70
    shown = capsys.readouterr().err
    assert "ZeroDivisionError" in shown
    assert "please report" in shown.splitlines()[-1]


def test_the_judge_is_asked_as_the_user_asked(judge: Callable[[Judge], None], tmp_path: Path) -> None:
    """Dialect, system, times and settings reach the judge."""
    asked: dict[str, Any] = {}

    def note(path: Path, settings: Any, **options: Any) -> File:
        asked.update(options, path=path, settings=settings)
        return file(vehicle())

    judge(note)
    own = tmp_path / "own.toml"
    own.write_text("[vehicle]\nattitude_run = 3")
    options = ["--sysid", "7", "--from", "1.5", "--to", "20", "--dialect", "common", "--config", str(own)]
    assert main(["check", "some.tlog", *options]) == 0
    assert asked["path"] == Path("some.tlog")
    assert (asked["sysid"], asked["from_s"], asked["to_s"], asked["dialect"]) == (7, 1.5, 20.0, "common")
    assert asked["settings"].vehicle.attitude_run == 3


def test_interrupted(judge: Callable[[Judge], None], capsys: pytest.CaptureFixture[str]) -> None:
    """Ctrl-C ends with 130 and one line."""

    def interrupt(*_: Any, **__: Any) -> File:
        raise KeyboardInterrupt

    judge(interrupt)
    assert main(["check", "some.tlog"]) == 130
    assert capsys.readouterr() == ("", "gcs-bridge: error: interrupted\n")


@pytest.mark.usefixtures("folder")
def test_output_holds_the_report_and_stdout_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    """--output takes the whole report and replaces an old one; the last lines are shown on stderr."""
    Path("report.json").write_text("old")
    assert main(["check", "alarm.tlog", "--format", "json", "--output", "report.json"]) == 1
    assert json.loads(Path("report.json").read_bytes())["verdict"] == "alarm"
    last = "ALARM       alarm.tlog: 1 vehicle, 1 alarm: euler_quaternion at 12.4 s\n"
    assert capsys.readouterr() == ("", last)
    assert not list(Path().glob(".*.tmp"))


def test_nothing_half_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If writing fails, the old report is untouched, no temporary file stays, and the exit code is 2."""

    def full(self: Path, *_: Any, **__: Any) -> None:
        self.touch()
        raise OSError(28, "No space left on device")

    (folder / "report.json").write_bytes(b"old")
    before = sorted(folder.iterdir())
    monkeypatch.setattr(Path, "write_bytes", full)
    assert main(["check", "agree.tlog", "--output", "report.json"]) == 2
    assert sorted(folder.iterdir()) == before
    assert (folder / "report.json").read_bytes() == b"old"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with a name")
def test_a_pipe_is_written_to_and_not_replaced(folder: Path) -> None:
    """--output to what is no file, through a link: it gets the report, and both are there afterwards."""
    # A pipe of our own stands for /dev/null: were the code wrong, the test would replace the machine's device.
    pipe, link = folder / "pipe", folder / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        assert main(["check", "agree.tlog", "-q", "--output", "link"]) == 0
        assert os.read(reader, 1000) == b"AGREE       agree.tlog: 1 vehicle, no alarm\n"
    finally:
        os.close(reader)
    assert link.is_symlink()
    assert pipe.is_fifo()


def test_folders_are_searched(tmp_path: Path) -> None:
    """Recordings at any depth and in any case, in order, each once; other files are left alone."""
    wanted = ["B.TLOG", "a/x.rlog", "a/y.tlog.raw", "c.tlog"]
    for name in [*wanted, "a/z.bin", "notes.txt", "tlog"]:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found, failures = find_recordings([tmp_path, tmp_path / "c.tlog"])
    assert [path.relative_to(tmp_path).as_posix() for path in found] == wanted
    assert not failures


def test_a_folder_without_recordings(tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is a source that cannot be used: 3, in one line that tells what was looked for."""
    (tmp_path / "empty").mkdir()
    assert main(["check", "empty"]) == 3
    assert capsys.readouterr().err.startswith("gcs-bridge: error: empty: no recording in this folder (looked for .tlog")
    assert main(["check", "empty", str(folder / "agree.tlog")]) == 3
    assert "AGREE" in capsys.readouterr().out


@pytest.mark.usefixtures("folder")
def test_text_that_is_not_for_a_terminal_is_plain(capsys: pytest.CaptureFixture[str]) -> None:
    """Neither colours nor a progress bar where nobody looks."""
    assert main(["check", "agree.tlog", "alarm.tlog"]) == 1
    shown = capsys.readouterr()
    assert "\x1b" not in shown.out + shown.err
    assert not shown.err


@pytest.mark.parametrize(("options", "coloured"), [([], True), (["--no-color"], False)])
@pytest.mark.usefixtures("folder")
def test_colours_on_a_terminal(
    options: list[str], coloured: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A terminal gets coloured verdicts, unless told not to, and the same words."""
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert main(["check", "-q", "agree.tlog", *options]) == 0
    shown = capsys.readouterr().out
    assert ("\x1b[" in shown) == coloured
    assert "agree.tlog: 1 vehicle" in shown


WITHOUT_CORE = """
import sys, types
sys.path.insert(0, {root!r})
from tests.helpers.report_entries import file, vehicle
core = sys.modules["gcs_bridge.recordings.check"] = types.ModuleType("gcs_bridge.recordings.source")
core.check_file = lambda path, *_, **__: file(*[vehicle()] * {vehicles}, path=str(path))
from gcs_bridge.cli import main
sys.exit(main(["check", "flight ° \\udcff.tlog", "--format", {form!r}]))
"""


def program(*, form: str = "text", vehicles: int = 1) -> str:
    return WITHOUT_CORE.format(root=str(ROOT), form=form, vehicles=vehicles)


@pytest.mark.slow
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_goes_away_is_no_error(unbuffered: str) -> None:
    """`gcs-bridge check … | head -1`: no traceback, and no code that reads as a verdict."""
    command = [sys.executable, "-c", program(vehicles=2000)]
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(30) == 141


@pytest.mark.slow
@pytest.mark.parametrize("form", ["text", "json"])
def test_a_terminal_s_encoding_is_no_reason_to_fail(form: str) -> None:
    """The result is UTF-8 even where Python would write ASCII, undecodable file names included."""
    shown = python("-c", program(form=form), env={**os.environ, "PYTHONIOENCODING": "ascii"}, encoding="utf-8")
    assert shown.returncode == 0
    assert not shown.stderr
    assert "flight ° " in shown.stdout


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no full device")
def test_a_full_disk_behind_stdout_is_told() -> None:
    """A result that cannot be written is exit 2 and one line, not silence."""
    with Path("/dev/full").open("w") as full:
        shown = subprocess.run(
            [sys.executable, "-c", program()], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert shown.returncode == 2
    assert shown.stderr == "gcs-bridge: error: cannot write to standard output: No space left on device\n"
