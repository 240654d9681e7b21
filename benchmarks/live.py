"""A vehicle at 50 Hz on a real link, watched in a real viewer: what `listen` costs, and how old the newest sample is.

    python -m benchmarks.live                  # a minute; the viewer runs without a window (Linux)
    python -m benchmarks.live --vehicles 4     # several on one link

The flight is `b_copter_acro`, sent over UDP at the speed at which it was flown. Its age is the time now less the
receive time of the newest sample that the viewer has, asked for some hundred times a second. All bodies of
a link are drawn in one piece, so it is that of each vehicle.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from benchmarks.fleet import Fleet, Flight
from benchmarks.send_datagrams import connected, send
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner

RECORDING = Path(__file__).parents[1] / "sitl_fixtures" / "b_copter_acro.tlog"
SECONDS = 30.0
_QUIET = {**os.environ, "CI": "1", "RUST_LOG": "error"}


def free_port(kind: int) -> int:
    """A port of this machine that nobody uses now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@functools.cache
def fleet(vehicles: int) -> Flight:
    """What several vehicles fly, made once: that takes seconds."""
    return Fleet(vehicles, also=("GLOBAL_POSITION_INT",)).copies(0, 1)


def fly(port: int, vehicles: int = 1) -> None:
    """Send the recording's first seconds to `port`, each frame at its time."""
    if vehicles > 1:
        flight = fleet(vehicles)
        count = int(np.searchsorted(flight.due_us, SECONDS * 1e6))
        with connected(port) as sender:
            send(flight.data, flight.ends[:count], time.time() + flight.due_us[:count] / 1e6, sender)
        return
    scanner = Scanner(load_dialect(), timed=True)
    scanner.scan(RECORDING.read_bytes(), final=True)
    began_s = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        frames = scanner.raw_frames()
        for frame in frames:
            at_s = (frame.t_rx_us - frames[0].t_rx_us) / 1e6
            if at_s > SECONDS:
                return
            time.sleep(max(began_s + at_s - time.monotonic(), 0))
            sender.sendto(frame.data, ("127.0.0.1", port))


def ages(viewer_port: int, until: threading.Event) -> list[float]:
    """The newest sample's age in the viewer, s, again and again."""
    from rerun.experimental import ViewerClient

    found: list[float] = []
    client = None
    while not until.is_set():
        with contextlib.suppress(Exception):  # not there yet
            client = client or ViewerClient.connect(f"rerun+http://127.0.0.1:{viewer_port}/proxy")
            ends = [line.end for one in client.get_state().recordings for line in one.timelines if line.name == "utc"]
            found += [time.time() - end / 1e9 for end in ends if end]
        time.sleep(0.007)
    return found


def listening(viewer: str) -> tuple[subprocess.Popen[str], int]:
    """`gcs-bridge listen` with such a viewer, and its port."""
    port = free_port(socket.SOCK_DGRAM)
    program = [sys.executable, "-c", "import sys; from gcs_bridge.cli import main; sys.exit(main())"]
    command = [*program, "listen", f"udpin:127.0.0.1:{port}", "--viewer", viewer, "--duration", str(SECONDS + 8)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=_QUIET), port


def without_a_viewer(vehicles: int) -> float:
    """The share of a processor that it takes."""
    process, port = listening("none")
    assert process.stdout is not None
    process.stdout.readline()  # the link is up
    started = cpu_s(process.pid)
    fly(port, vehicles)
    share = (cpu_s(process.pid) - started) / SECONDS
    process.terminate()
    process.communicate()
    return share


def with_a_viewer(vehicles: int) -> tuple[float, npt.NDArray[np.float64]]:
    """The same with one that looks on, and how old the newest sample is in it, ms."""
    process, port = listening("web")
    viewer_port = free_port(socket.SOCK_STREAM)
    assert process.stderr is not None
    address = next(filter(None, (re.search(r"url=(\S+?)&", line) for line in process.stderr)))[1]
    rerun = [sys.executable, "-m", "rerun_cli", "--headless", "--bind", "127.0.0.1", "--port", str(viewer_port)]
    viewer = subprocess.Popen(
        [*rerun, "--connect", unquote(address)], env=_QUIET, stderr=subprocess.DEVNULL, start_new_session=True
    )
    time.sleep(4)  # both have started by now
    started = cpu_s(process.pid)
    done = threading.Event()

    def fly_and_tell() -> None:
        try:
            fly(port, vehicles)
        finally:
            done.set()

    flight = threading.Thread(target=fly_and_tell)
    flight.start()
    measured = np.array(ages(viewer_port, done)) * 1e3
    share = (cpu_s(process.pid) - started) / SECONDS
    os.killpg(viewer.pid, signal.SIGKILL)  # what was started starts the viewer, and does not take it along
    viewer.wait()
    process.terminate()
    process.communicate()
    return share, measured[len(measured) // 5 :]


def main(vehicles: int = 1) -> None:
    """Measure, and print three lines."""
    if vehicles > 1:
        fleet(vehicles)
    of = f"{vehicles} vehicle{'s' * (vehicles > 1)} at 50 Hz"
    sys.stdout.write(f"listen without a viewer, {of}: {without_a_viewer(vehicles):.1%} of a processor\n")
    share, settled = with_a_viewer(vehicles)
    sys.stdout.write(f"listen with a viewer, {of}: {share:.1%} of a processor\n")
    low, high, worst = np.percentile(settled, [50, 95, 100])
    sys.stdout.write(f"age of the newest sample: median {low:.0f} ms, p95 {high:.0f} ms, max {worst:.0f} ms\n")


def cpu_s(pid: int) -> float:
    """Processor time that a running process has used, all its threads together."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="What `listen` costs at 50 Hz, and how old the newest sample is.")
    parser.add_argument("--vehicles", type=int, default=1, help="on one link  [1]")
    main(parser.parse_args().vehicles)
