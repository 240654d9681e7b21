"""MAVProxy as it is, a ground station on the relay: it sees the vehicle, asks it, and stands still without harm.

It is no dependency: `python3 -m venv somewhere && somewhere/bin/pip install MAVProxy`, and the variable MAVPROXY names
its mavproxy.py (or it is found on the PATH).
"""

import contextlib
import itertools
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers.autopilot import Autopilot
from tests.helpers.flying import udp_vehicle
from tests.helpers.live_links import Process, frames_of, free_port, wait_until

MAVPROXY = os.environ.get("MAVPROXY") or shutil.which("mavproxy.py")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(MAVPROXY is None, reason="there is no MAVProxy: the variable MAVPROXY names its mavproxy.py"),
]


class MavProxy:
    """A process of it, what it says, and what is typed to it."""

    def __init__(self, folder: Path, master: str) -> None:
        self.log = folder / "mavproxy.txt"
        self._out = self.log.open("wb")
        command = [str(MAVPROXY), f"--master={master}", "--nowait", f"--state-basedir={folder}", "--mav20"]
        interpreter = str(Path(str(MAVPROXY)).with_name("python"))
        self.process = subprocess.Popen(
            [interpreter, "-u", *command] if Path(interpreter).exists() else command,
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=self._out,
            stderr=subprocess.STDOUT,
        )

    def said(self) -> str:
        return self.log.read_text(errors="replace")

    def type(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line.encode() + b"\n")
        self.process.stdin.flush()


@contextlib.contextmanager
def mavproxy(folder: Path, master: str) -> Iterator[MavProxy]:
    folder.mkdir()
    one = MavProxy(folder, master)
    try:
        yield one
    finally:
        with contextlib.suppress(ProcessLookupError):
            one.process.send_signal(signal.SIGCONT)
            one.process.kill()
        one.process.communicate()
        one._out.close()


@contextlib.contextmanager
def relayed(folder: Path, ours: str, theirs: str, kind: int, *options: str) -> Iterator[tuple[MavProxy, int, Process]]:
    """A station on a relay of `listen`, the port at which that hears vehicles, and its process."""
    port, relay_port = free_port(), free_port(kind)
    with (
        mavproxy(folder / "mavproxy", f"{theirs}:127.0.0.1:{relay_port}") as station,
        Process(
            *("listen", f"udpin:127.0.0.1:{port}", "--viewer=none", *options),
            f"--relay={ours}:127.0.0.1:{relay_port}",
        ) as process,
    ):
        process.wait_for("link up", 60)
        yield station, port, process


def _kinds() -> list[tuple[str, str, int]]:
    udp, tcp = socket.SOCK_DGRAM, socket.SOCK_STREAM
    return [("udpout", "udpin", udp), ("udpin", "udpout", udp), ("tcpin", "tcp", tcp), ("tcp", "tcpin", tcp)]


@pytest.mark.parametrize(("ours", "theirs", "kind"), _kinds())
def test_it_sees_the_vehicle_and_asks_it(ours: str, theirs: str, kind: int, tmp_path: Path) -> None:
    """By every kind of relay: it goes online; with both ways its parameter requests and its rates reach the vehicle."""
    vehicle = Autopilot()
    with relayed(tmp_path, ours, theirs, kind, "--relay-both-ways") as (station, port, _), udp_vehicle(vehicle, port):
        wait_until(lambda: "online system 1" in station.said(), 60)
        wait_until(lambda: "PARAM_REQUEST_LIST" in {one.get_type() for one in vehicle.received}, 30)
        wait_until(lambda: "HEARTBEAT" in {one.get_type() for one in vehicle.received}, 30)
        station.type("long SET_MESSAGE_INTERVAL 31 50000")
        wait_until(lambda: (31, 50_000.0) in vehicle.commands(), 30)
        wait_until(lambda: "COMMAND_ACK: SET_MESSAGE_INTERVAL: ACCEPTED" in station.said(), 30)


@pytest.mark.parametrize(("ours", "theirs", "kind"), _kinds())
def test_it_asks_in_vain_without_both_ways(ours: str, theirs: str, kind: int, tmp_path: Path) -> None:
    """It sees the vehicle, and nothing of what it sends gets through; the alarms' texts reach its operator."""
    vehicle = Autopilot()
    with relayed(tmp_path, ours, theirs, kind, "--statustext") as (station, port, _), udp_vehicle(vehicle, port):
        wait_until(lambda: "online system 1" in station.said(), 60)
        station.type("set target_component 0")  # else it shows what the autopilot itself says, and nothing else
        vehicle.rates_hz[30] = vehicle.rates_hz[31] = 20.0
        vehicle.off_deg = 25.0
        wait_until(lambda: "euler_quaternion ALARM: 25 deg" in station.said(), 30)
    assert vehicle.received == []


@pytest.mark.parametrize(("ours", "theirs", "kind"), [_kinds()[0], _kinds()[2]])
def test_it_stands_still(ours: str, theirs: str, kind: int, tmp_path: Path) -> None:
    """Stopped for seconds at 2000 messages a second: every frame is recorded as it comes."""
    vehicle = Autopilot(rates_hz={30: 700.0, 31: 700.0, 27: 600.0})
    tlog = tmp_path / "live.tlog"
    with relayed(tmp_path, ours, theirs, kind, f"--record={tlog}") as (station, port, process):
        with udp_vehicle(vehicle, port):
            wait_until(lambda: "online system 1" in station.said(), 60)
            station.process.send_signal(signal.SIGSTOP)
            time.sleep(20)
        time.sleep(1)
        process.signal(signal.SIGTERM)
        code, said = process.ended()
    frames = frames_of(tlog.read_bytes())
    numbers = [frame.data[4] for frame in frames]
    assert code == 0
    assert len(frames) > 20 * 1500
    assert all((after - before) % 256 == 1 for before, after in itertools.pairwise(numbers))
    gaps_s = [(two.t_rx_us - one.t_rx_us) / 1e6 for one, two in itertools.pairwise(frames)]
    assert max(gaps_s) < 1.0
    assert "were dropped here" not in said
