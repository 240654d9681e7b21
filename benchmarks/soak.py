"""Leaves `gcs-bridge listen` alone for as long as asked, with all that it can do at once, and looks at what became.

    python -m benchmarks.soak --minutes 60                    # 2,000 messages/s
    python -m benchmarks.soak --minutes 10 --viewer stopped   # with a viewer that is stopped a quarter of the way

Thirteen copters on one UDP link, judged, recorded, served to viewers and relayed to two stations, of which one is
stopped all the while. Twelve times in an hour (once at least) the first one's body rates disagree. In the end

- nothing was lost: the recording is what was sent, byte for byte, and so is what the station got that reads;
- `check` of the recording raises the alarms that were raised live, at the same boot times (unless this machine was so
  busy that the sender stood still for two seconds: live that is known to be silence, in a recording it may be a pause);
- from the settled time on (`--settled`, when the viewer's history is full) the bridge's resident memory stayed within
  5 %, and it had as many file descriptors as before.

Linux. What was sampled lies in `samples.jsonl` of `--keep FOLDER`, with the rest.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from benchmarks.fleet import FLIGHT_S, Excursions, Fleet, Flight
from benchmarks.live import cpu_s, free_port
from benchmarks.make_recording import STAMP_BYTES
from benchmarks.send_datagrams import connected, send

VEHICLES = 13  # 2,019 messages a second
LASTS_S = 10.0  # an excursion; the time between two of them is 5 min, or less in a short run
EACH_S = 300.0
BURST_S = 0.004  # so often the sender looks at what is due: vehicles send in bursts, too
GROWS_BY = 0.05  # at most
# What looks on: nothing; a viewer; one that is stopped a quarter of the way, or killed then and started again.
VIEWERS = ("none", "watches", "stopped", "restarted")
_QUIET = {**os.environ, "CI": "1", "RUST_LOG": "error"}
# The program, with another limit of the viewer's history: no option has it.
_BRIDGE = """import sys
from gcs_bridge.viewer import served
served._HISTORY[True] = sys.argv.pop(1)
from gcs_bridge.cli import main
sys.exit(main())"""
_CHECK = "import sys; from gcs_bridge.cli import main; sys.exit(main())"
# A station that connects, and stops before it has read anything.
_STOPPED = """import os, signal, socket, sys
taken = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
os.kill(os.getpid(), signal.SIGSTOP)"""


class Asked(NamedTuple):
    """How it is to be."""

    minutes: float
    vehicles: int
    history: str
    viewer: str  # of VIEWERS
    settled: float  # share of the time, from which on memory may not grow

    def options(self) -> list[str]:
        """As the command line has it."""
        return [option for name, value in self._asdict().items() for option in (f"--{name}", str(value))]


def fleet(asked: Asked) -> Fleet:
    each_s = min(EACH_S, asked.minutes * 60 / 2)
    lasts_s = min(LASTS_S, each_s / 3)
    return Fleet(asked.vehicles, Excursions(each_ms=int(each_s * 1000), lasts_ms=int(lasts_s * 1000), vehicles=1))


def flights(asked: Asked) -> Iterator[Flight]:
    """All that is sent, some 40 s after the other."""
    flown, ends_us = fleet(asked), asked.minutes * 60e6
    for number in range(int(asked.minutes * 60 / FLIGHT_S) + 2):
        flight = flown.copies(number, 1)
        n = int(np.searchsorted(flight.due_us, ends_us))
        if not n:
            return
        yield Flight(flight.data[: flight.ends[n - 1]], flight.ends[:n], flight.due_us[:n])


def made_ahead(made: Iterator[Flight]) -> Iterator[Flight]:
    """Each made while the one before is used: a sender that stood still would be a silence of the link."""
    with ThreadPoolExecutor(1) as beside:
        following = beside.submit(next, made, None)
        while (one := following.result()) is not None:
            following = beside.submit(next, made, None)
            yield one


def send_all(asked: Asked, port: int) -> None:
    """The sender's process: each frame a datagram, each at its time."""
    count, late_s, began_s = 0, 0.0, 0.0
    with connected(port) as sender:
        for flight in made_ahead(flights(asked)):
            began_s = began_s or time.time()
            late_s = max(late_s, send(flight.data, flight.ends, began_s + flight.due_us / 1e6, sender, BURST_S))
            count += len(flight.ends)
    print(json.dumps({"count": count, "late_s": late_s, "took_s": time.time() - began_s}))


class Sample(NamedTuple):
    """Of the bridge's process, so many seconds from the start."""

    at_s: float
    rss_mb: float
    descriptors: int
    threads: int
    cpu_s: float
    recorded_mb: float


def sample(pid: int, began_s: float, recording: Path) -> Sample:
    of = Path(f"/proc/{pid}")
    rss = int((of / "statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
    descriptors, threads = (len(list((of / name).iterdir())) for name in ("fd", "task"))
    at_s = time.monotonic() - began_s
    return Sample(at_s, rss / 1e6, descriptors, threads, cpu_s(pid), recording.stat().st_size / 1e6)


class Station:
    """Another ground station, which reads all that is relayed to it."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port))
        self._hash = hashlib.sha256()
        self.bytes = 0
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while data := self._socket.recv(2**20):
            self._hash.update(data)
            self.bytes += len(data)

    def got(self) -> str:
        """What it got until the other side closed."""
        self._thread.join(20)
        self._socket.close()
        return self._hash.hexdigest()


@dataclass
class Bridge:
    """The process that is looked at."""

    asked: Asked
    folder: Path
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.port, reads, stops = free_port(socket.SOCK_DGRAM), *(free_port(socket.SOCK_STREAM) for _ in range(2))
        self.recording, self.events = self.folder / "soak.tlog", self.folder / "live.jsonl"
        command = [sys.executable, "-c", _BRIDGE, self.asked.history, "listen", f"udpin:127.0.0.1:{self.port}"]
        command += ["--viewer", "web", "--record", str(self.recording), "--events", str(self.events), "--quiet"]
        command += ["--relay", f"tcpin:127.0.0.1:{reads}", "--relay", f"tcpin:127.0.0.1:{stops}"]
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=_QUIET
        )
        self._listening = threading.Thread(target=self._listen, daemon=True)
        self._listening.start()
        self._until(lambda: self.events.exists() and "link_up" in self.events.read_text())
        self.reads = Station(reads)
        self.stops = subprocess.Popen([sys.executable, "-c", _STOPPED, str(stops)])

    def _listen(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as lines:
            for line in lines:
                self.notes.append(line.rstrip())

    def _until(self, true: Callable[[], bool]) -> None:
        while not true():
            assert self.process.poll() is None, f"the bridge has ended: {self.notes}"
            time.sleep(0.05)

    @property
    def served(self) -> str:
        """Where viewers get the data."""
        found = (re.search(r"url=(\S+?)&", note) for note in list(self.notes))
        return unquote(next(filter(None, found))[1])

    def end(self) -> int:
        """End it, once it has written what came; its exit code."""
        before = -1
        while before != (before := self.recording.stat().st_size):
            time.sleep(1.0)
        self.process.terminate()
        return self.process.wait(30)

    def __enter__(self) -> Bridge:
        return self

    def __exit__(self, *_: object) -> None:
        for process in (self.process, self.stops):
            process.kill()
            process.wait()
        self._listening.join()


class Viewer:
    """A real viewer without a window, if one is to look on."""

    def __init__(self, kind: str, url: str) -> None:
        self._kind, self._url = kind, url
        self._process: subprocess.Popen[bytes] | None = None
        if kind != "none":
            self._start()

    def _start(self) -> None:
        command = [sys.executable, "-m", "rerun_cli", "--headless", "--bind", "127.0.0.1", "--memory-limit", "500MB"]
        command += ["--port", str(free_port(socket.SOCK_STREAM)), "--window-size", "320x240", "--connect", self._url]
        self._process = subprocess.Popen(command, env=_QUIET, stderr=subprocess.DEVNULL, start_new_session=True)

    def disturb(self) -> None:
        """Do to it what is to be done."""
        if self._kind == "stopped":
            self._signal(signal.SIGSTOP)
        elif self._kind == "restarted":
            self.end()
            self._start()

    def end(self) -> None:
        """Kill it."""
        if self._process is not None:
            self._signal(signal.SIGKILL)
            self._process.wait()
            self._process = None

    def _signal(self, number: signal.Signals) -> None:
        assert self._process is not None
        os.killpg(self._process.pid, number)  # what was started starts the viewer: all of them are meant


def run(asked: Asked, folder: Path) -> tuple[Bridge, dict[str, Any], list[Sample], int]:
    """The run itself: the bridge, what the sender says, what was sampled, the bridge's exit code."""
    samples: list[Sample] = []
    command = [sys.executable, "-m", "benchmarks.soak", *asked.options()]
    with Bridge(asked, folder) as bridge, contextlib.ExitStack() as stack:
        viewer = Viewer(asked.viewer, bridge.served)
        stack.callback(viewer.end)
        began_s = time.monotonic()
        command += ["--send-to", str(bridge.port)]
        sender = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
        stack.callback(sender.kill)
        log = stack.enter_context((folder / "samples.jsonl").open("w", buffering=1))
        is_disturbed = False
        while sender.poll() is None:
            time.sleep(min(max(asked.minutes / 6, 0.5), 5.0))
            samples.append(sample(bridge.process.pid, began_s, bridge.recording))
            log.write(json.dumps(samples[-1]._asdict()) + "\n")
            if not is_disturbed and samples[-1].at_s > asked.minutes * 60 / 4:
                is_disturbed = True
                viewer.disturb()
        assert sender.stdout is not None
        with sender.stdout as out:
            said = json.loads(out.read())
        return bridge, said, samples, bridge.end()


def recorded_otherwise(recording: Path, asked: Asked) -> str | None:
    """Where a recording is not what was sent, byte for byte, in times that do not run back; None: nowhere."""
    latest_us = 0
    with recording.open("rb") as file:
        for number, flight in enumerate(flights(asked)):
            n = len(flight.ends)
            records = np.frombuffer(file.read(len(flight.data) + n * STAMP_BYTES), np.uint8)
            if len(records) < len(flight.data) + n * STAMP_BYTES:
                return f"it ends within flight {number}"
            starts = flight.ends - np.diff(flight.ends, prepend=0) + STAMP_BYTES * np.arange(n)
            is_stamp = np.zeros(len(records), np.bool_)
            at = starts[:, None] + np.arange(STAMP_BYTES)
            is_stamp[at] = True
            if not np.array_equal(records[~is_stamp], flight.data):
                return f"a frame of flight {number} is missing or another one"
            stamps_us = records[at].view(">i8")[:, 0].astype(np.int64)
            if stamps_us[0] < latest_us or (np.diff(stamps_us) < 0).any():
                return f"a time of flight {number} runs back"
            latest_us = int(stamps_us[-1])
        return "there is more in it" if file.read(1) else None


def sent_hash(asked: Asked) -> str:
    """Of all that was sent."""
    found = hashlib.sha256()
    for flight in flights(asked):
        found.update(flight.data.tobytes())
    return found.hexdigest()


def alarms(events: Path) -> list[tuple[Any, ...]]:
    """The alarms that were told, and when on the vehicle's clock."""
    told = [json.loads(line) for line in events.read_text().splitlines()]
    return [
        (event["event"], event["id"], event["boot"], event["boot_s"])
        for event in told
        if event["event"] in ("alarm_raised", "alarm_cleared")
    ]


def judged(asked: Asked, bridge: Bridge, said: dict[str, Any], samples: list[Sample], code: int) -> list[str]:
    """Print what came of it; what is wrong with it."""
    wrong = [f"the bridge ended with {code}"] if code else []
    told = [json.loads(line) for line in bridge.events.read_text().splitlines()]
    dropped = sum(event.get("dropped", 0) for event in told if event["event"] == "damage")
    print(
        f"sent: {said['count']:,} messages in {said['took_s']:.0f} s ({said['count'] / said['took_s']:,.0f}/s, at most "
        f"{said['late_s']:.2f} s late); dropped: {dropped}"
    )
    if dropped:
        wrong.append(f"{dropped} datagrams were dropped")
    if where := recorded_otherwise(bridge.recording, asked):
        wrong.append(f"recording: {where}")
    print(f"recording: {bridge.recording.stat().st_size / 1e6:.0f} MB, {where or 'what was sent, byte for byte'}")
    relayed_right = bridge.reads.got() == sent_hash(asked)
    print(
        f"relay: {bridge.reads.bytes / 1e6:.0f} MB, {'what was sent' if relayed_right else 'other than what was sent'}"
    )
    if not relayed_right:
        wrong.append("the station on the relay did not get what was sent")
    checked = bridge.folder / "checked.jsonl"
    check = [sys.executable, "-c", _CHECK, "check", "--events", str(checked), str(bridge.recording)]
    began_s = time.monotonic()
    last = subprocess.run(check, stdout=subprocess.PIPE, text=True, check=False).stdout.splitlines()[-1:]
    live, again = alarms(bridge.events), alarms(checked)
    same = live == again and len(live) > 0
    print(f"check of it, {time.monotonic() - began_s:.0f} s: {' '.join(last)}")
    print(
        f"alarms: {len(live)} raised or cleared live, {'the same' if same else f'other than the {len(again)}'} recorded"
    )
    if not same:
        wrong.append("the alarms of the recording are others")
    ends_s = samples[-1].at_s
    settled = [one for one in samples if one.at_s >= asked.settled * ends_s]
    base = float(np.median([one.rss_mb for one in settled[: max(len(settled) // 10, 1)]]))
    low, high = min(one.rss_mb for one in settled), max(one.rss_mb for one in settled)
    print(
        f"memory: {samples[0].rss_mb:.0f} MB at first, {base:.0f} MB settled at {settled[0].at_s:.0f} s, since then "
        f"{low:.0f} to {high:.0f} MB ({100 * (high / base - 1):+.1f} %), {settled[-1].rss_mb:.0f} MB at the end"
    )
    if high > base * (1 + GROWS_BY):
        wrong.append("memory grew")
    descriptors = sorted({one.descriptors for one in settled})
    print(f"descriptors: {descriptors}, threads: {sorted({one.threads for one in settled})}")
    if len(descriptors) > 1:
        wrong.append("descriptors changed")
    print(f"processor: {100 * samples[-1].cpu_s / ends_s:.0f} % of one")
    print(*(f"said: {note}" for note in [*dict.fromkeys(bridge.notes)][:8]), sep="\n")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description="gcs-bridge listen, left alone.")
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--vehicles", type=int, default=VEHICLES, help=f"155 messages a second each  [{VEHICLES}]")
    parser.add_argument("--history", default="256MiB", help="what the viewer's server keeps  [256MiB, as listen]")
    parser.add_argument("--viewer", choices=VIEWERS, default="none", help="who looks on  [none]")
    parser.add_argument(
        "--settled", type=float, default=1 / 3, help="share of the time until memory may not grow  [1/3]"
    )
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where recording, events and samples are left")
    parser.add_argument("--send-to", type=int, metavar="PORT", help=argparse.SUPPRESS)  # the sender's process
    options = parser.parse_args()
    asked = Asked(options.minutes, options.vehicles, options.history, options.viewer, options.settled)
    if options.send_to is not None:
        send_all(asked, options.send_to)
        return 0
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that what was started is ended
    with contextlib.ExitStack() as stack:
        folder = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        wrong = judged(asked, *run(asked, folder))
    print("; ".join(wrong) or "all is well")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
