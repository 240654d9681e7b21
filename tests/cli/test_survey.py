"""`gcs-bridge survey` as people run it: what it writes, how it ends, and what it says of what it cannot use."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import pytest

from gcs_bridge.cli import main
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES, ROOT
from tests.helpers.surveyed import rows

ALARMING, GOOD = FIXTURES / "k8_stream_stops.tlog", FIXTURES / "d_tailsitter_tumble.tlog"
PATIENCE_S = 120
SIGNING_KEY = bytes(range(32))  # of g_signed


class Ended(NamedTuple):
    code: int
    out: str
    err: list[str]


@pytest.fixture
def survey(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Any:
    """Runs the command into `out`."""

    def run(*arguments: Any, output: Path = tmp_path / "out") -> Ended:
        code = main(["survey", *map(str, arguments), "--output", str(output)])
        out, err = capfd.readouterr()
        return Ended(code, out, err.splitlines())

    return run


class Links(HTMLParser):
    """Where a page leads."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.found: list[Path] = []
        self._page = page
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [self._page.parent / unquote(value or "") for name, value in attrs if name == "href"]


def test_a_fleet(survey: Any, tmp_path: Path) -> None:
    """Tables, summary and pages; ended with the worst; and the same again, without judging anything."""
    for number in range(3):
        (tmp_path / f"good {number}.tlog").write_bytes(GOOD.read_bytes()[:-1] + bytes([number]))
    shutil.copy(ALARMING, tmp_path / "alarm #1.tlog")
    (tmp_path / "broken.tlog").write_text("no telemetry")
    out = tmp_path / "out"
    ended = survey(tmp_path, "--workers", "1")
    assert ended.code == 3
    (failure,) = (line for line in ended.err if "error" in line)
    assert failure.startswith(f"gcs-bridge: error: {tmp_path}/broken.tlog: no valid MAVLink frame in 12 bytes: not a ")
    assert ended.out.splitlines()[-1].startswith("ALARM")
    summary = json.loads((out / "summary.json").read_bytes())
    assert summary["recordings"] == 4
    assert summary["verdicts"] == {"alarm": 1, "warning": 0, "no_compare": 0, "agree": 3}
    assert (summary["run"]["judged"], len(summary["failures"])) == (4, 1)
    assert {name: len(rows(out, name)) for name in ("recordings", "checks", "alarms")} == {
        "recordings": 4,
        "checks": 36,
        "alarms": 1,
    }
    (page,) = Links(out / "index.html").found
    (back,) = (link for link in Links(page).found if link.name == "index.html")
    assert back.samefile(out / "index.html")
    (tmp_path / "broken.tlog").unlink()
    again = survey(tmp_path, "--workers", "1", "-q")
    assert (again.code, len(again.out.splitlines()), again.err) == (1, 1, [])
    assert json.loads((out / "summary.json").read_bytes())["run"]["known"] == 4
    assert survey(tmp_path, "--fail-on", "never").code == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"], "give one of them"),
        (["--vehicle", "("], "no regular expression"),
        (["--scheduler", "tcp://127.0.0.1:1", "--signing-key-file", "KEY"], "a key is given to no other process"),
        (["--profile", "nix"], "unknown profile"),
        (["nix://bucket/"], "nix"),
    ],
)
def test_wrong_usage(arguments: list[str], said: str, survey: Any, tmp_path: Path) -> None:
    """One line, before anything is judged."""
    (tmp_path / "key").write_bytes(bytes(32))
    (tmp_path / "key").chmod(0o600)
    ended = survey(GOOD, *(str(tmp_path / "key") if one == "KEY" else one for one in arguments))
    assert (ended.code, ended.out, len(ended.err)) == (2, "", 1)
    assert said in ended.err[0]


@pytest.mark.slow
def test_signed_recordings(survey: Any, tmp_path: Path) -> None:
    """By the right key and by another: judged in this process, as no other is given the key."""
    key = tmp_path / "key"
    key.touch(mode=0o600)
    signed = FIXTURES / "g_signed.tlog"
    for content, code in ((bytes(32), 4), (SIGNING_KEY, 0)):
        key.write_bytes(content)
        assert survey(signed, "--signing-key-file", key, "--unsigned", "reject", "-q").code == code
    assert len(list((tmp_path / "out" / "earlier").iterdir())) == 1


@pytest.mark.slow
def test_nothing_to_judge(survey: Any, tmp_path: Path) -> None:
    """A folder without recordings, and a file that is not there, are named; there is a summary all the same."""
    (tmp_path / "bare").mkdir()
    ended = survey(tmp_path / "bare", tmp_path / "gone.tlog", "--workers", "1", "-q")
    assert ended.code == 3
    assert [("no recording in this folder" in line, "no such file" in line) for line in ended.err] == [
        (True, False),
        (False, True),
    ]
    assert json.loads((tmp_path / "out" / "summary.json").read_bytes())["verdict"] == "no_compare"


def test_a_folder_that_cannot_be_written(survey: Any, tmp_path: Path) -> None:
    """It is told before anything is judged."""
    (tmp_path / "file").touch()
    ended = survey(GOOD, output=tmp_path / "file")
    assert (ended.code, len(ended.err)) == (2, 1)
    assert f"cannot write {tmp_path}/file" in ended.err[0]
    ended = survey(GOOD, output=tmp_path / "file" / "below")
    assert (ended.code, len(ended.err)) == (2, 1)


def command(*arguments: Any) -> list[str]:
    return [sys.executable, "-m", "gcs_bridge", "survey", *map(str, arguments)]


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """Twelve recordings, no two alike."""
    folder = tmp_path / "logs"
    folder.mkdir()
    data = (FIXTURES / "k7a_gyro_bias_both.tlog").read_bytes()
    for number in range(12):
        (folder / f"{number:02d}.tlog").write_bytes(data[:-1] + bytes([number]))
    return folder


def journalled(out: Path) -> int:
    """How many recordings are written down, but in no part yet."""
    return sum(file.read_bytes().count(b"\n") for file in (out / "recordings").glob(".journal-*"))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
@pytest.mark.parametrize("sign", one_in(3, [signal.SIGKILL, signal.SIGINT, signal.SIGTERM]))
def test_ended_half_way(sign: signal.Signals, tmp_path: Path, survey: Any) -> None:
    """Gone on with, nothing is judged twice; nobody prints a traceback."""
    fleet, out, most = tmp_path / "logs", tmp_path / "out", 80  # enough that some are left, however late it is ended
    fleet.mkdir()
    data = (FIXTURES / "d_tailsitter_tumble.tlog").read_bytes()
    for number in range(most):
        (fleet / f"{number:02d}.tlog").write_bytes(data[:-1] + bytes([number]))
    # What is started in the background may ignore SIGINT, and so may these tests and all that they start.
    heeding = (
        "import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); os.execv(sys.argv[1], sys.argv[1:])"
    )
    running = [sys.executable, "-c", heeding, *command(fleet, "--output", out, "--workers", 2)]
    with subprocess.Popen(running, cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        end_s = time.monotonic() + PATIENCE_S
        while journalled(out) < 3:
            assert process.poll() is None
            assert time.monotonic() < end_s
            time.sleep(0.01)
        if sign == signal.SIGINT:  # as a terminal does
            os.killpg(process.pid, sign)
        else:
            process.send_signal(sign)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == (130 if sign == signal.SIGINT else -sign)
    assert "Traceback" not in err
    done = journalled(out) + len(rows(out, "recordings"))
    assert 3 <= done < most
    ended = survey(fleet, "--workers", "1")
    run = json.loads((out / "summary.json").read_bytes())["run"]
    assert (ended.code, run["judged"], run["known"]) == (0, most - done, done)
    contents = [row["content"] for row in rows(out, "recordings")]
    assert len(contents) == len(set(contents)) == most


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of less than a hundred kilobytes: a recording takes ten."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = shutil.which("mount")
    if mount is None or sys.platform != "linux" or os.geteuid() != 0:
        pytest.skip("only root may mount a small disk")
    mounted = subprocess.run([mount, "-t", "tmpfs", "-o", "size=96k", "tmpfs", disk], capture_output=True, check=False)
    if mounted.returncode:
        pytest.skip("no disk can be mounted here")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.slow
def test_a_full_disk(small_disk: Path, fleet: Path, survey: Any, tmp_path: Path) -> None:
    """One line; what was done is valid, and is not judged again once there is room."""
    ended = survey(fleet, "--workers", "1", "--no-pages", output=small_disk / "out")
    assert (ended.code, len(ended.err)) == (2, 1)
    assert re.match(r"gcs-bridge: error: cannot write .*: No space left on device", ended.err[0])
    shutil.copytree(small_disk / "out", tmp_path / "out")
    done = journalled(tmp_path / "out") + len(rows(tmp_path / "out", "recordings"))
    assert survey(fleet, "--workers", "1", "--no-pages").code == 1
    run = json.loads((tmp_path / "out" / "summary.json").read_bytes())["run"]
    assert (run["judged"], run["known"]) == (12 - done, done)
