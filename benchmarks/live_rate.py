"""How many messages a second `gcs-bridge listen` takes from one link, and how soon it tells what they show.

    python -m benchmarks.live_rate               # some minutes; two processors, Linux
    python -m benchmarks.live_rate --quick       # the same, roughly

Sixteen copters on one link, one frame a datagram, every check. The listener has one processor, the sender and this
process another. The flight is `b_copter_acro`; where more is sent than was flown, its clock runs faster than the
world's. Measured are

- the highest rate at which nothing is dropped and nothing is left to wait, and what its processor did meanwhile;
- from the datagram that completes an alarm (or ends it) to the line that tells it: body rates that disagree for 0.3 s
  of each second, delays of 0.1 s;
- pymavlink's `recv_match`, which only decodes, on the same stream;
- what `listen` costs at 50 Hz, without a viewer and with one (benchmarks.live).
"""

from __future__ import annotations

import argparse
import functools
import json
import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks import live
from benchmarks.fleet import Excursions, Fleet, Flight, boot_ms
from benchmarks.make_recording import Ints

VEHICLES = 16
LEAST_PER_S, MOST_PER_S = 1_000.0, 200_000.0  # of the sender
LISTENER, SENDER = 0, 1  # processors
HERE = Path(__file__).parent
# Each excursion is an alarm of its own, and told; nothing is a repeat of the one before.
SETTINGS = """[alarm]
bad_samples = 2
on_delay_s = 0.1
off_delay_s = 0.1
repeat_s = 0.0
chatter_raises = 1000
flood_raises = 1000
"""
TOLD = ("alarm_raised", "alarm_cleared")
FIRST_NS = 1_000_000_000


class Listening:
    """A listener on its processor: `gcs-bridge listen`, or the peer; each line that it tells, with when it was read."""

    def __init__(self, folder: Path, *, peer: bool = False) -> None:
        self.port = live.free_port(socket.SOCK_DGRAM)
        settings = folder / "settings.toml"
        settings.write_text(SETTINGS)
        command = [sys.executable, "-c", "from benchmarks.live_rate import listen_timed; listen_timed()", "listen"]
        command += [f"udpin:127.0.0.1:{self.port}", "--viewer", "none", "--events", "-", "--config", str(settings)]
        if peer:
            command = [sys.executable, str(HERE / "pymavlink_listens.py"), str(self.port)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        os.sched_setaffinity(self._process.pid, {LISTENER})
        self.lines: list[tuple[int, dict[str, Any]]] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        while not self.lines:
            time.sleep(0.05)
            assert self._process.poll() is None, "the listener has ended"

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append((time.time_ns(), json.loads(line)))

    def cpu_s(self) -> float:
        """Processor time that it has used."""
        return live.cpu_s(self._process.pid)

    def end(self) -> dict[str, float]:
        """End it; what `listen_timed` told, of `gcs-bridge`."""
        self._process.send_signal(signal.SIGTERM)
        assert self._process.stderr is not None
        errors = self._process.stderr.read().decode()
        self._process.wait()
        self._reader.join()
        return json.loads(errors.splitlines()[-1]) if errors.endswith("}\n") else {}


def clock(used_s: dict[str, float], name: str, owner: Any, method: str) -> None:
    """Add the processor time of a class's method to `used_s`, under this name, from now on."""
    inner = getattr(owner, method)
    used_s[name] = 0.0

    @functools.wraps(inner)
    def outer(*arguments: Any, **options: Any) -> Any:
        began_s = time.thread_time()
        try:
            return inner(*arguments, **options)
        finally:
            used_s[name] += time.thread_time() - began_s

    setattr(owner, method, outer)


def listen_timed() -> None:
    """The program with a clock at the stages of its loop; what they took is told on standard error at the end."""
    from gcs_bridge.cli import main
    from gcs_bridge.judging.monitor import Monitor
    from gcs_bridge.links import loop
    from gcs_bridge.links.link import Link
    from gcs_bridge.mavlink.scanner import Scanner

    used_s: dict[str, float] = {}
    clock(used_s, "socket", Link, "drain")
    clock(used_s, "scan", Scanner, "scan_chunks")
    clock(used_s, "take", Monitor, "take")
    clock(used_s, "all", loop, "listen")
    listen = loop.listen

    def listen_anew(*arguments: Any, **options: Any) -> Any:
        used_s.update(dict.fromkeys(used_s, 0.0))  # what was warmed up before is of no interest
        return listen(*arguments, **options)

    loop.listen = listen_anew
    code = main(sys.argv[1:])
    sys.stderr.write(json.dumps(used_s) + "\n")
    sys.exit(code)


def sent(folder: Path, frames: Flight, port: int, per_s: float) -> tuple[dict[str, float], Ints]:
    """Send a flight at a rate; what the sender says of it, and when each frame was sent, ns."""
    np.savez(folder / "frames.npz", data=frames.data, ends=frames.ends, due_us=frames.due_us)
    speed = per_s * float(np.ptp(frames.due_us)) / 1e6 / len(frames.ends)
    command = [sys.executable, "-m", "benchmarks.send_datagrams", str(folder / "frames.npz"), str(port)]
    command += ["--speed", str(speed), "--cpu", str(SENDER), "--sent", str(folder / "sent.npy")]
    said = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    return said, np.load(folder / "sent.npy")


class Trial(NamedTuple):
    """One rate, and what became of it."""

    per_s: float
    dropped: int
    waits_s: float  # of what was left in the socket at the end: in so long it came
    cpu: float  # share of the processor
    shares: dict[str, float]  # of that: the loop's stages

    @property
    def held(self) -> bool:
        """Whether all was taken, as it came."""
        return not self.dropped and self.waits_s < 0.05

    def __str__(self) -> str:
        shares = ", ".join(f"{part} {share:.0%}" for part, share in self.shares.items())
        return (
            f"{self.per_s:9,.0f}/s: {'held' if self.held else 'not held'}, {self.dropped:,} dropped, "
            f"{self.waits_s * 1000:.0f} ms wait, {self.cpu:.0%} of a processor ({shares})"
        )


def trial(folder: Path, per_s: float, seconds: float, vehicles: int = VEHICLES) -> Trial:
    """Send at a rate for some seconds, and look at what was left."""
    frames = Fleet(vehicles).first(per_s * seconds)
    listening = Listening(folder)
    began_s = listening.cpu_s()
    said, _ = sent(folder, frames, listening.port, per_s)
    queued, dropped = queue_of(listening.port)
    cpu = (listening.cpu_s() - began_s) / said["took_s"]
    used_s = listening.end()
    all_s, rate = used_s["all"], said["count"] / said["took_s"]
    used_s["judging"] = used_s["take"] - used_s["scan"]
    used_s["the rest"] = all_s - used_s["socket"] - used_s["take"]
    shares = {name: used_s[name] / all_s for name in ("socket", "scan", "judging", "the rest")}
    return Trial(rate, dropped, queued / _queued_each() / rate, cpu, shares)


def queue_of(port: int) -> tuple[int, int]:
    """(bytes of its buffer that are taken, datagrams that were dropped) of a UDP socket of this machine."""
    for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
        fields = line.split()
        if int(fields[1].rsplit(":", 1)[1], 16) == port:
            return int(fields[4].split(":")[1], 16), int(fields[-1])
    raise LookupError(port)


@functools.cache
def _queued_each() -> float:
    """The bytes of a socket's buffer that an ordinary frame takes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        for _ in range(20):
            one.sendto(bytes(45), one.getsockname())
        return queue_of(one.getsockname()[1])[0] / 20


def trials(folder: Path, seconds: float, within: float) -> Iterator[Trial]:
    """Twice the rate again and again until it is not held; then halves, as ratios, until the highest is known."""
    low, high = LEAST_PER_S, math.inf
    while high / low > within and low < MOST_PER_S:
        tried = trial(folder, 2 * low if high == math.inf else math.sqrt(low * high), seconds)
        yield tried
        if tried.held:
            low = tried.per_s
        else:
            high = tried.per_s


class Latencies(NamedTuple):
    """From the datagram that raised an alarm of the body rates, or cleared it, to the line that told it, ms.

    Those of the first second, in which every vehicle is new, stand apart.
    """

    settled: npt.NDArray[np.float64]
    first: npt.NDArray[np.float64]


def latencies(folder: Path, vehicles: int, per_s: float, seconds: float) -> Latencies:
    """Of a flight of so many seconds at this rate."""
    frames = Fleet(vehicles, Excursions(each_ms=1000, lasts_ms=300, vehicles=vehicles)).first(per_s * seconds)
    listening = Listening(folder)
    _, sent_ns = sent(folder, frames, listening.port, per_s)
    time.sleep(1.0)
    listening.end()
    starts = frames.ends - np.diff(frames.ends, prepend=0)
    attitudes = np.flatnonzero(np.isin(frames.data[starts + 7], (30, 31)))  # both messages': the later one completes
    stamps = boot_ms(frames.data, starts[attitudes]).tolist()
    senders = frames.data[starts[attitudes] + 5].tolist()
    completed_by = dict(zip(zip(senders, stamps, strict=True), attitudes.tolist(), strict=True))
    found = [
        (read_ns, sent_ns[completed_by[event["vehicle"][0], round(event["boot_s"] * 1000)]])
        for read_ns, event in listening.lines
        if event["event"] in TOLD and event["check"] == "body_rates"
    ]
    read_ns, from_ns = np.array(found).T
    is_first = from_ns < sent_ns[0] + FIRST_NS
    took_ms = (read_ns - from_ns) / 1e6
    return Latencies(took_ms[~is_first], took_ms[is_first])


def pymavlink_rate(folder: Path, seconds: float) -> float:
    """Messages a second that `recv_match` decodes where more come than it can take."""
    frames = Fleet(VEHICLES).first(50_000 * seconds)
    listening = Listening(folder, peer=True)
    sent(folder, frames, listening.port, 50_000)
    listening.end()
    counts = [(read_ns, line["count"]) for read_ns, line in listening.lines if line["count"]]
    (first_ns, first), (last_ns, last) = counts[1], counts[-2]  # without what is not a whole tenth of a second
    return float((last - first) / ((last_ns - first_ns) / 1e9))


def main() -> None:
    parser = argparse.ArgumentParser(description="The highest rate of a live link, and how soon events are told.")
    parser.add_argument("--quick", action="store_true", help="shorter, and rougher")
    parser.add_argument("--only", choices=("rate", "latency", "peer", "cost"), help="one of the measurements")
    arguments = parser.parse_args()
    seconds, within = (3.0, 1.3) if arguments.quick else (10.0, 1.06)
    os.sched_setaffinity(0, {SENDER})
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.only in (None, "rate"):
            highest = 0.0
            for one in trials(folder, seconds, within):
                print(one)
                highest = max(highest, one.per_s if one.held else 0.0)
            print(f"highest rate without loss, {VEHICLES} vehicles: {highest:,.0f} messages/s")
        if arguments.only in (None, "latency"):
            for vehicles, per_s, lasts_s in ((1, 150, 6 * seconds), (VEHICLES, 20_000, seconds)):
                found = latencies(folder, vehicles, per_s, lasts_s)
                low, high, worst = np.percentile(found.settled, [50, 99, 100])
                print(
                    f"datagram to event, {vehicles} vehicles, {per_s:,}/s: median {low:.1f} ms, p99 {high:.1f} ms, "
                    f"max {worst:.1f} ms ({len(found.settled)} events); "
                    f"in the first second, in which every vehicle is new, max {found.first.max(initial=0):.1f} ms"
                )
        if arguments.only in (None, "peer"):
            print(f"pymavlink's recv_match, which only decodes: {pymavlink_rate(folder, seconds):,.0f} messages/s")
    if arguments.only in (None, "cost"):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
        live.main()


if __name__ == "__main__":
    main()
