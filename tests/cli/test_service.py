"""As a service: what systemd is told, what signals do, and the files that are shipped for it."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_bridge.cli.service import Hangup, Notifier
from gcs_bridge.resources import config_folder
from gcs_bridge.sinks.file import LiveFile
from tests.helpers.live_links import PROGRAM, Process, fixture, frames_of, free_port, tlog_of, wait_until
from tests.helpers.paths import ROOT
from tests.helpers.processor import awake_s

FRAMES = fixture("e_two_vehicles", to_s=6)
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="services of systemd, and their signals")


class Manager:
    """systemd's end of NOTIFY_SOCKET."""

    def __init__(self, path: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(path)
        self.socket.settimeout(30)

    def told(self) -> str:
        return self.socket.recv(4096).decode()


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Manager]:
    path = str(tmp_path / "notify")
    made = Manager(path)
    monkeypatch.setenv("NOTIFY_SOCKET", path)
    with made.socket:
        yield made


def test_notices(manager: Manager, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ready, alive twice within the watchdog's time, stopping; and programs that are started from here know nothing."""
    monkeypatch.setenv("WATCHDOG_USEC", "200000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
    notifier = Notifier()
    assert not {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"} & set(os.environ)
    notifier.ready()
    for _ in range(50):
        notifier.run()
        time.sleep(0.01)
    notifier.stopping()
    told = [manager.told() for _ in range(7)]
    assert told[0] == "READY=1"
    assert told[1:6] == ["WATCHDOG=1"] * 5
    assert told[6] in ("WATCHDOG=1", "STOPPING=1")


@pytest.mark.parametrize("of", [{}, {"WATCHDOG_USEC": "200000", "WATCHDOG_PID": "1"}, {"WATCHDOG_USEC": "x"}])
def test_no_watchdog_was_asked_for(of: dict[str, str], manager: Manager, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not at all, by another process, or not in numbers: nothing is said."""
    for name, value in of.items():
        monkeypatch.setenv(name, value)
    Notifier().run()
    manager.socket.settimeout(0.05)
    with pytest.raises(TimeoutError):
        manager.told()


def test_nobody_to_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run by hand, or by a manager that has gone: nothing happens."""
    Notifier().ready()
    monkeypatch.setenv("NOTIFY_SOCKET", "/nonexistent/notify")
    Notifier().ready()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has sockets without a file")
def test_a_socket_without_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its name begins with @."""
    name = f"gcs-bridge-test-{os.getpid()}"
    manager = Manager("\0" + name)
    with manager.socket:
        monkeypatch.setenv("NOTIFY_SOCKET", "@" + name)
        Notifier().ready()
        assert manager.told() == "READY=1"


def test_a_manager_that_takes_nothing_holds_nothing_up(manager: Manager) -> None:
    """Its queue is full: what it is not told is lost."""
    notifier = Notifier()
    began_s = awake_s()
    for _ in range(2000):
        notifier.ready()
    assert awake_s() - began_s < 5


@pytest.mark.slow
def test_listen_as_a_service(manager: Manager, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Ready once it listens, alive while it does, SIGHUP goes on in new files, SIGTERM ends with 0; plain lines."""
    monkeypatch.setenv("WATCHDOG_USEC", "1000000")
    port, tlog, events = free_port(), tmp_path / "live.tlog", tmp_path / "events.jsonl"
    sent = 0

    def send(count: int) -> None:
        nonlocal sent
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for frame in FRAMES[sent : sent + count]:
                sender.sendto(frame.data, ("127.0.0.1", port))
                time.sleep(0.001)
        sent += count

    def recorded(path: Path) -> int:
        return len(frames_of(path.read_bytes())) if path.exists() else 0

    with Process(
        "listen", f"udpin:127.0.0.1:{port}", "--viewer=none", f"--record={tlog}", f"--events={events}"
    ) as process:
        assert manager.told() == "READY=1"
        send(300)
        wait_until(lambda: recorded(tlog) == 300)
        tlog.rename(tmp_path / "live.1.tlog")
        events.rename(tmp_path / "events.1.jsonl")
        process.signal(signal.SIGHUP)
        wait_until(tlog.exists)
        send(300)
        wait_until(lambda: recorded(tlog) == 300)
        assert manager.told() == manager.told() == "WATCHDOG=1"
        process.signal(signal.SIGTERM)
        code, said = process.ended()
    assert (code, said) == (0, "")
    manager.socket.settimeout(30)
    while (told := manager.told()) == "WATCHDOG=1":
        pass
    assert told == "STOPPING=1"
    both = (tmp_path / "live.1.tlog").read_bytes() + tlog.read_bytes()
    assert [frame.data for frame in frames_of(both)] == [frame.data for frame in FRAMES[:600]]
    assert tlog_of(frames_of(both)) == both
    lines = [json.loads(line) for line in (tmp_path / "events.1.jsonl").read_text().splitlines()]
    assert lines[0]["event"] == "link_up"
    assert events.exists()
    assert all("\x1b" not in line and "\r" not in line for line in process.said)


def test_a_file_that_cannot_be_opened_anew(tmp_path: Path) -> None:
    """Its folder has gone: it is said, and the old file is gone on with."""
    folder = tmp_path / "logs"
    folder.mkdir()
    said: list[str] = []
    file = LiveFile(folder / "a", said.append)
    file.append(b"one")
    folder.rename(tmp_path / "moved")
    file.reopen()
    file.append(b"two")
    file.close()
    file.reopen()
    assert (tmp_path / "moved" / "a").read_bytes() == b"onetwo"
    assert said == [f"cannot open {folder / 'a'} anew: No such file or directory; going on as before"]
    assert not file.failed


def test_a_disk_that_has_room_again(tmp_path: Path) -> None:
    """After a write that failed, a new file is written to; that one failed is still known in the end."""
    full = tmp_path / "full"
    full.symlink_to("/dev/full")
    said: list[str] = []
    file = LiveFile(full, said.append)
    file.append(b"lost")
    full.unlink()
    file.reopen()
    file.append(b"kept")
    file.close()
    assert full.read_bytes() == b"kept"
    assert file.failed
    assert len(said) == 1


def test_a_terminal_that_has_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody has closed the window: it ends; where there never was a terminal, the same signal opens files anew."""
    done: list[str] = []
    terminal = [True]
    monkeypatch.setattr("gcs_bridge.cli.service._has_terminal", lambda: terminal[0])
    for had, has in ((True, False), (True, True), (False, False)):
        terminal[0] = had
        with Hangup(lambda: done.append("reopen"), lambda: done.append("end")) as hangup:
            terminal[0] = has
            hangup.run()
            os.kill(os.getpid(), signal.SIGHUP)
            hangup.run()
            hangup.run()
    assert done == ["end", "reopen", "reopen"]


# --- what is shipped -------------------------------------------------------------------------------------------------

UNIT = config_folder() / "gcs-bridge.service"


def test_the_unit_says_what_the_program_does() -> None:
    """It notifies, is watched, is told to reload by SIGHUP, does not start again what was configured wrongly."""
    unit = dict(re.findall(r"^(\w+)=(.*)$", UNIT.read_text(), re.MULTILINE))
    assert unit["Type"] == "notify"
    assert unit["NotifyAccess"] == "main"
    assert unit["ExecReload"] == "/bin/kill -HUP $MAINPID"
    assert unit["Restart"] == "on-failure"
    assert unit["RestartPreventExitStatus"] == "2"
    assert int(unit["WatchdogSec"]) >= 10
    assert int(unit["TimeoutStartSec"]) >= 120
    words = unit["ExecStart"].split()
    assert words[1] == "listen"
    assert words[2:4] == ["--viewer", "none"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd-analyze")
def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    """But for the program, which is not installed where the unit looks for it."""
    unit = tmp_path / "gcs-bridge.service"
    unit.write_text(UNIT.read_text().replace("/opt/gcs-bridge/bin/gcs-bridge", "/bin/true"))
    done = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False)
    if "System has not been booted" in done.stderr or "Failed to initialize manager" in done.stderr:
        pytest.skip("systemd-analyze does not work here")
    assert [line for line in done.stderr.splitlines() if "gcs-bridge.service" in line] == []


@pytest.mark.slow
def test_the_options_in_the_shipped_files_exist() -> None:
    """What the unit and the container type is understood."""
    said = subprocess.run([*PROGRAM, "listen", "--help"], capture_output=True, text=True, check=True).stdout
    for path in (UNIT, config_folder() / "Containerfile"):
        text = "\n".join(line for line in path.read_text().splitlines() if not line.startswith("#"))
        for option in re.findall(r"(?<![\w-])--[a-z-]+", re.sub(r"^RUN(.*\\\n)*.*$", "", text, flags=re.MULTILINE)):
            assert option in said, (path.name, option)


def test_the_containerfile_copies_what_there_is() -> None:
    """Each path that it copies is at the top of the checkout, and the package needs no other."""
    text = (config_folder() / "Containerfile").read_text()
    copied = re.findall(r"^COPY (.*) \S+$", text, re.MULTILINE)
    assert len(copied) >= 4
    assert all((ROOT / name).exists() for line in copied for name in line.split())
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert all(
        any(need.startswith(name) for line in copied for name in line.split()) for need in needed["force-include"]
    )
