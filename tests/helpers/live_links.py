"""What the tests of live links share: recorded frames, senders, and `gcs-bridge` as a process."""

import contextlib
import functools
import itertools
import json
import os
import pty
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge import events
from gcs_bridge.contract import plain
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.links import link as link_module
from gcs_bridge.links import loop
from gcs_bridge.links.link import Link
from gcs_bridge.links.loop import listen
from gcs_bridge.links.wall_clock import now_us
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import RawFrame, Scanner
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.report.schema import File
from gcs_bridge.sending.asked import Asked
from gcs_bridge.sending.station import Station
from gcs_bridge.settings import TransmitSettings
from gcs_bridge.sinks.base import SinkContext
from gcs_bridge.sinks.event_lines import event_json, link_name
from gcs_bridge.sinks.tlog import TlogRecorder
from tests.helpers.paths import FIXTURES
from tests.helpers.processes import OWN_NUMBER

Event = dict[str, Any]


def frames_of(recording: bytes) -> list[RawFrame]:
    """The frames of a .tlog."""
    scanner = Scanner(load_dialect(), timed=True)
    scanner.scan(recording, final=True)
    return scanner.raw_frames()


def tlog_of(frames: Sequence[RawFrame]) -> bytes:
    return b"".join(frame.t_rx_us.to_bytes(8, "big") + frame.data for frame in frames)


@functools.cache
def _whole(name: str) -> list[RawFrame]:
    return frames_of((FIXTURES / f"{name}.tlog").read_bytes())


@functools.cache
def fixture(name: str, *, from_s: float = 0.0, to_s: float = 1e6, fault: str | None = None) -> tuple[RawFrame, ...]:
    """The frames of a bundled recording between two times, the last third with a fault."""
    frames = _whole(name)
    first_us = frames[0].t_rx_us
    frames = [frame for frame in frames if from_s * 1e6 <= frame.t_rx_us - first_us < to_s * 1e6]
    if fault is None:
        return tuple(frames)
    lasts_s = (frames[-1].t_rx_us - frames[0].t_rx_us) / 1e6
    return tuple(frames_of(inject(tlog_of(frames), [parse_fault(fault)], from_s=lasts_s * 2 / 3)))


def recorder(
    path: Path, *, links: Sequence[str] = ("a link",), max_mb: float | None = None, max_minutes: float | None = None
) -> TlogRecorder:
    """A recorder as `listen --record` has it; what it complains of fails the test."""
    context = SinkContext(title="x", links=links, note=lambda _: None, complain=pytest.fail, stack=ExitStack())
    opened = TlogRecorder.plan(str(path), max_mb=max_mb, max_minutes=max_minutes).open(context)
    assert isinstance(opened, TlogRecorder)
    return opened


def judgement(entry: File) -> list[dict[str, Any]]:
    """What a report says of each vehicle, but for what hangs on the receive time."""
    return [
        {
            "key": (vehicle["sysid"], vehicle["compid"]),
            "verdict": vehicle["verdict"],
            "boots": [(boot["first_boot_s"], boot["last_boot_s"]) for boot in vehicle["boots"]],
            "counts": {
                name: (stream["count"], stream["lost"], stream["invalid"])
                for name, stream in vehicle["streams"].items()
            },
            "checks": [{**check, "coverage": None} for check in vehicle["checks"]],
            "alarms": [{**alarm, "raised_utc": None} for alarm in vehicle["alarms"]],
        }
        for vehicle in plain(entry)["vehicles"]
    ]


def recorded_judgement(recording: bytes) -> list[dict[str, Any]]:
    """The same of a recording, as `check` reads it."""
    monitor = Monitor()
    monitor.feed_recording(recording)
    return judgement(monitor.close().files[0])


# Between being found free and being bound a port may be taken: each process of tests has 300 of its own, one after the
# other, below those that the system gives to whoever asks for any.
_ports = itertools.cycle(range(10_000 + 300 * (OWN_NUMBER % 33), 10_300 + 300 * (OWN_NUMBER % 33)))


def free_port(kind: int = socket.SOCK_DGRAM) -> int:
    """Of this machine, that nobody else is going to take."""
    for port in _ports:
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, kind) as probe:
            probe.bind(("", port))
            return port
    raise AssertionError


@contextlib.contextmanager
def terminals() -> Iterator[tuple[int, str]]:
    """Two serial terminals that are wired to each other: the descriptor of one, the device of the other."""
    master, slave = pty.openpty()
    tty.setraw(master)
    device = os.ttyname(slave)
    try:
        yield master, device
    finally:
        for descriptor in (master, slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)


def wait_until(true: Callable[[], bool], seconds: float = 30.0) -> None:
    """Wait for something that another thread or process does; fail if it does not, however busy the machine is."""
    ends_s = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < ends_s, "waited in vain"
        time.sleep(0.005)


def hurry(monkeypatch: pytest.MonkeyPatch, times: float) -> None:
    """Let the clock that links and the loop read go so many times as fast: seconds of silence are soon over."""
    began_us = now_us()

    def hurried_us() -> int:
        return began_us + round(times * (time.time_ns() / 1000 - began_us))

    for module in (link_module, loop):
        monkeypatch.setattr(module, "now_us", hurried_us)


def paced(frames: Sequence[RawFrame], send: Callable[[bytes], Any], speed: float) -> None:
    """Send each frame at its time, `speed` times as fast as it was received."""
    began_s = time.monotonic()
    for frame in frames:
        time.sleep(max(began_s + (frame.t_rx_us - frames[0].t_rx_us) / 1e6 / speed - time.monotonic(), 0))
        send(frame.data)


@contextlib.contextmanager
def tcp_sender(
    frames: Sequence[RawFrame], speed: float, *, cut: int | None = None
) -> Iterator[tuple[int, list[bytes]]]:
    """A server that plays frames to the first who connects, cut into `cut` bytes where asked, and closes.

    Gives its port, and what it received from the other side.
    """
    received: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]

        def serve() -> None:
            peer, _ = server.accept()
            server.close()  # who comes again is refused
            with peer, contextlib.suppress(ConnectionError):
                if cut is None:
                    paced(frames, peer.sendall, speed)
                else:
                    stream = b"".join(frame.data for frame in frames)
                    for start in range(0, len(stream), cut):
                        peer.sendall(stream[start : start + cut])
                        time.sleep(0.001)
                peer.shutdown(socket.SHUT_WR)
                peer.settimeout(30)
                received.append(peer.recv(1))  # b"" once the other side has closed, too

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield port, received
        thread.join()


class Live:
    """`listen` in a thread of this process; what it told is in `events`, as its JSON lines say it.

    With what was `asked` for to be sent, it is sent, and `notes` are the lines for people. `until_down`: it ends with
    the last link, before silence is told of its vehicles, however late anyone looks.
    """

    def __init__(
        self, *links: Link, asked: Asked | None = None, until_down: bool = False, **monitor_options: Any
    ) -> None:
        self._until_down = until_down
        self.events: list[Event] = []
        self.notes: list[str] = []
        self._stations = [
            Station(one, TransmitSettings(), links, dialect="all", note=self.notes.append)
            for one in filter(None, [asked])
        ]
        for station in self._stations:
            monitor_options["on_frames"] = station.frames
        self.monitor = Monitor(doctor_waits=True, **monitor_options)
        self._links = links
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        listen(
            self._links,
            self.monitor,
            self._tell,
            stop=self._stop.is_set,
            note=self.notes.append,
            errands=self._stations,
        )

    def _tell(self, told: Sequence[events.Event]) -> None:
        for station in self._stations:
            station.events(told)
        names = [link.name for link in self._links]
        self.events += [json.loads(event_json(event, link_name(event, names))) for event in told]
        if self._until_down and self._all_down():
            self._stop.set()

    def _all_down(self) -> bool:
        return self.names().count("link_down") == len(self._links)

    @property
    def thread_id(self) -> int | None:
        """As the system calls the thread."""
        return self._thread.native_id

    def __enter__(self) -> "Live":
        self._thread.start()
        wait_until(lambda: self.names().count("link_up") == len(self._links))
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(30.0)
        for station in self._stations:
            station.close()
        assert not self._thread.is_alive()

    def wait_for_the_end(self, seconds: float = 60.0) -> None:
        """Wait until every link has gone."""
        wait_until(self._all_down, seconds)

    def names(self) -> list[str]:
        return [event["event"] for event in self.events]


PROGRAM = [sys.executable, "-c", "import sys; from gcs_bridge.cli import main; sys.exit(main())"]


class Process:
    """`gcs-bridge` with these arguments; `said` are the lines of its standard output so far."""

    def __init__(self, *arguments: str, program: Sequence[str] = PROGRAM) -> None:
        stdout, to_stdout = os.pipe()
        self._process = subprocess.Popen([*program, *arguments], stdout=to_stdout, stderr=subprocess.PIPE, text=True)
        os.close(to_stdout)
        self.said: list[str] = []
        self._unread = b""
        self._stdout = stdout
        os.set_blocking(stdout, False)

    def __enter__(self) -> "Process":
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.communicate()
        self.close_stdout()

    def close_stdout(self) -> None:
        """Read no more of it: who writes to it finds a broken pipe."""
        if self._stdout >= 0:
            os.close(self._stdout)
            self._stdout = -1

    def wait_for(self, words: str, seconds: float = 60.0) -> None:
        wait_until(lambda: any(words in line for line in self._read()), seconds)

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    @property
    def process_id(self) -> int:
        return self._process.pid

    def ended(self, seconds: float = 60.0) -> tuple[int, str]:
        """Its exit code and what it wrote to standard error, once it has ended."""
        _, errors = self._process.communicate(timeout=seconds)
        self._read()
        return self._process.returncode, errors

    def _read(self) -> list[str]:
        with contextlib.suppress(BlockingIOError):
            while self._stdout >= 0 and (data := os.read(self._stdout, 65536)):
                *lines, self._unread = (self._unread + data).split(b"\n")
                self.said += [line.decode() + "\n" for line in lines]
        return self.said
