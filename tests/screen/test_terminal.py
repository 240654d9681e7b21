"""The terminal is given back whatever happens, and never holds up who listens."""

import contextlib
import fcntl
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

if sys.platform == "win32":
    pytest.skip("there are no terminals of this kind", allow_module_level=True)

import pty
import termios

from gcs_bridge.screen.stray import StrayLines
from gcs_bridge.screen.terminal import Terminal
from tests.helpers.live_links import PROGRAM, fixture, free_port, wait_until

FRAMES = fixture("a_copter_square", from_s=75, to_s=80)
LEFT = b"\x1b[?25h\x1b[?7h\x1b[?1049l"


class Pair:
    """A terminal of this process's own making: what is written to it comes out of `outside`."""

    def __init__(self) -> None:
        self.outside, self.inside = pty.openpty()
        self.attributes = termios.tcgetattr(self.inside)

    def terminal(self) -> Terminal:
        return Terminal(os.open(os.ttyname(self.inside), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))

    def written(self) -> bytes:
        data = b""
        while select.select([self.outside], [], [], 0.05)[0]:
            data += os.read(self.outside, 65536)
        return data


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pair]:
    monkeypatch.setattr(Terminal, "_is_ours", lambda self: True)  # it is no terminal that tests are started from
    made = Pair()
    yield made
    for descriptor in (made.outside, made.inside):
        os.close(descriptor)


def test_it_is_given_back_as_it_was(pair: Pair) -> None:
    """Keys come at once and unseen while it is taken; its attributes and its screen are the old ones afterwards."""
    with pair.terminal() as terminal:
        assert terminal.is_taken
        assert not termios.tcgetattr(pair.inside)[3] & (termios.ECHO | termios.ICANON)
        assert termios.tcgetattr(pair.inside)[3] & termios.ISIG  # Ctrl-C is a signal as before
        os.write(pair.outside, b"aq")
        wait_until(lambda: bool(select.select([pair.inside], [], [], 0)[0]))
        assert terminal.read() == b"aq"
        assert terminal.read() == b""
    assert termios.tcgetattr(pair.inside) == pair.attributes
    assert pair.written().endswith(LEFT)


def test_it_is_given_back_on_an_exception(pair: Pair) -> None:
    """In whatever was done meanwhile."""
    with pytest.raises(ZeroDivisionError), pair.terminal():
        divmod(1, 0)
    assert termios.tcgetattr(pair.inside) == pair.attributes
    assert pair.written().endswith(LEFT)


def test_one_that_takes_nothing_is_not_waited_for(pair: Pair) -> None:
    """What does not fit is kept; in the end it is tried for half a second, no longer."""
    with pair.terminal() as terminal:
        for _ in range(100):
            terminal.write(b"x" * 10_000)
        assert not terminal.takes_more
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 30
    assert termios.tcgetattr(pair.inside) == pair.attributes


def test_one_that_goes_is_left_alone(pair: Pair) -> None:
    """Its other end closes: it is not touched again, and nothing is raised."""
    with pair.terminal() as terminal:
        os.close(pair.outside)
        terminal.read()
        assert terminal.has_gone
        terminal.write(b"x")
        assert terminal.size()
        assert not terminal.resume()
    pair.outside = os.open(os.devnull, os.O_RDWR)


def test_its_size(pair: Pair) -> None:
    """As it is by now; one that does not know is a usual one."""
    with pair.terminal() as terminal:
        assert terminal.size() == (80, 24)
        fcntl.ioctl(pair.inside, termios.TIOCSWINSZ, struct.pack("HHHH", 5, 20, 0, 0))
        assert terminal.size() == (20, 5)


def test_what_would_go_across_the_picture_comes_afterwards(pair: Pair) -> None:
    """Of this process and of the programs that it starts: shown as lines meanwhile, and written in the end."""
    real = os.dup(2)
    os.dup2(pair.inside, 2)
    try:
        stray = StrayLines()
        stray.catch()
        os.write(2, b"one\ntw")
        subprocess.run(["sh", "-c", "echo o >&2; echo three >&2"], check=True)
        assert stray.read() == ["one", "two", "three"]
        assert stray.read() == []
        assert pair.written() == b""
        stray.release()
        os.write(2, b"four")
    finally:
        os.dup2(real, 2)
        os.close(real)
    assert pair.written().replace(b"\r", b"") == b"one\ntwo\nthree\nfour"


class Started:
    """`gcs-bridge listen` on a terminal of its own, whose other end is `outside`; its errors and code are in files."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.port, self.errors = free_port(), folder / "errors"
        self.events = folder / "events.jsonl"
        arguments = ["listen", f"udpin:127.0.0.1:{self.port}", "--viewer=none", "--events", str(self.events), *options]
        self.process, self.outside = pty.fork()
        if not self.process:
            os.dup2(os.open(self.errors, os.O_WRONLY | os.O_CREAT), 2)
            os.execve(PROGRAM[0], [*PROGRAM, *arguments], {**os.environ, "TERM": "xterm-256color"})
        wait_until(lambda: "link_up" in self.told(), 30.0)

    def told(self) -> list[str]:
        return (
            [json.loads(line)["event"] for line in self.events.read_text().splitlines()] if self.events.exists() else []
        )

    def ended(self, *, reads: bool = False) -> int:
        """Its exit code; meanwhile what it writes is read, if so."""
        ends_s = time.monotonic() + 30
        while not (done := os.waitpid(self.process, os.WNOHANG))[0]:
            if time.monotonic() > ends_s:
                os.kill(self.process, signal.SIGKILL)
                pytest.fail("it did not end")
            if reads and select.select([self.outside], [], [], 0)[0]:
                with contextlib.suppress(OSError):
                    os.read(self.outside, 65536)
            time.sleep(0.002)
        return os.waitstatus_to_exitcode(done[1])


@pytest.mark.slow
def test_a_terminal_that_is_closed(tmp_path: Path) -> None:
    """Its program ends as it would on a signal, and says nothing of a failure."""
    started = Started(tmp_path)
    os.close(started.outside)
    assert started.ended() == 129  # as shells report SIGHUP
    assert started.errors.read_text() == ""


@pytest.mark.slow
def test_a_terminal_that_takes_nothing(tmp_path: Path) -> None:
    """Nobody reads what is drawn, as on a stalled SSH connection: it goes on listening, and ends when it is told to."""
    started = Started(tmp_path)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for _ in range(8):  # of two seconds, with a picture of 200 × 60 each quarter
            fcntl.ioctl(started.outside, termios.TIOCSWINSZ, struct.pack("HHHH", 60, 200, 0, 0))
            time.sleep(0.25)
        for frame in FRAMES[:60]:
            sender.sendto(frame.data, ("127.0.0.1", started.port))
    wait_until(lambda: "stream_started" in started.told(), 10.0)
    os.kill(started.process, signal.SIGTERM)
    assert started.ended(reads=True) == 0
    os.close(started.outside)
