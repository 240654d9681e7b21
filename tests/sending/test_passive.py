"""Nothing is transmitted unless asked for: by what peers receive, and by the calls that the system was given."""

import contextlib
import os
import pty
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers.everyday import one_in
from tests.helpers.flying import GroundStation
from tests.helpers.live_links import PROGRAM, Process, fixture, free_port
from tests.helpers.multicast import GROUP, Group, multicast_works

FRAMES = [frame.data for frame in fixture("e_two_vehicles", to_s=2)]
_STRACE = shutil.which("strace")
_SENDING = "sendto,sendmsg,sendmmsg,write,writev,pwrite64,pwritev,pwritev2,sendfile,splice"
_INTERFACES = "nlmsg_type=RTM_GETLINK"  # which there are: `mcast:` takes part at each of them


def _can_trace() -> bool:
    return (
        _STRACE is not None
        and subprocess.run([_STRACE, "-qq", "true"], capture_output=True, check=False).returncode == 0
    )


class Peers:
    """A vehicle at the other end of each kind of link, with what came from here."""

    def __init__(self) -> None:
        self.udp_port = free_port()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.connect(("127.0.0.1", self.udp_port))
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(60)
        self._master, self._slave = pty.openpty()
        tty.setraw(self._master)
        self.device = os.ttyname(self._slave)
        self._tcpin_port = free_port(socket.SOCK_STREAM)
        self.uris = [
            f"udpin:127.0.0.1:{self.udp_port}",
            f"tcp:127.0.0.1:{self._server.getsockname()[1]}",
            f"tcpin:127.0.0.1:{self._tcpin_port}",
            self.device,
        ]
        self._group: Group | None = None
        if multicast_works():
            self._group = Group(free_port())
            self.uris.append(f"mcast:{GROUP}:{self._group.port}")

    def __enter__(self) -> "Peers":
        return self

    def __exit__(self, *_: object) -> None:
        self._udp.close()
        self._server.close()
        if self._group is not None:
            self._group.close()
        for descriptor in (self._master, self._slave):
            os.close(descriptor)

    def fly(self) -> bytes:
        """Send a flight on every link; returns all that came back."""
        tcp, _ = self._server.accept()
        group = [] if self._group is None else [self._group]
        with tcp, socket.create_connection(("127.0.0.1", self._tcpin_port), 5) as client:
            for frame in FRAMES:
                with contextlib.suppress(ConnectionError):
                    self._udp.send(frame)
                tcp.sendall(frame)
                client.sendall(frame)
                os.write(self._master, frame)
                for one in group:
                    one.send(frame)
                time.sleep(0.001)
            time.sleep(1.1)  # longer than from one heartbeat to the next
            came = b""
            descriptors = [self._udp.fileno(), tcp.fileno(), client.fileno(), self._master]
            while readable := select.select(descriptors, [], [], 0.1)[0]:
                came += b"".join(os.read(one, 65_536) for one in readable)
            return came + b"".join(data for one in group for data in one.received())


def _of_the_program(process: Process) -> int:
    """The process id: strace, which passes no signal on, has it for a child."""
    children = Path(f"/proc/{process.process_id}/task/{process.process_id}/children")
    name = Path(f"/proc/{process.process_id}/comm")
    traced = name.exists() and name.read_text().strip() == "strace"
    return int(children.read_text().split()[0]) if traced else process.process_id


@contextlib.contextmanager
def flown(program: list[str], *options: str) -> Iterator[tuple[Peers, bytes]]:
    """`listen` on all kinds of link at once, while a vehicle flies on each; what came back, once it has ended."""
    with Peers() as peers:
        with Process("listen", *peers.uris, "--viewer", "none", *options, program=program) as process:
            process.wait_for("link up")
            came = peers.fly()
            process.wait_for("vehicle seen")
            os.kill(_of_the_program(process), signal.SIGTERM)
            assert process.ended()[0] == 0
        yield peers, came


@pytest.mark.slow
@pytest.mark.parametrize("relay", one_in(2, [False, True]))
def test_no_peer_receives_a_byte(relay: bool) -> None:
    """Of any link, from its opening to its end; a relay alone sends to its station, and nothing to the links."""
    with GroundStation() as station:
        options = [f"--relay=udpout:127.0.0.1:{station.port}"] if relay else []
        with flown(PROGRAM, *options) as (peers, came):
            assert came == b""
            links = len(peers.uris)
        assert len(station.listen().data) >= links * len(FRAMES) * relay - 5


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="strace is a program of Linux")
@pytest.mark.parametrize("options", one_in(2, [(("--act-as-gcs",),), ((),)]))
def test_the_system_was_asked_to_send_nothing(options: tuple[str, ...], tmp_path: Path) -> None:
    """No call that could write names a link's socket or device, in any thread or child; where it may, it is seen."""
    if not _can_trace():
        pytest.skip("there is no strace, or it may not trace")
    log = tmp_path / "strace"
    strace = [str(_STRACE), "-f", "-yy", "-qq", "--signal=none", "-e", f"trace={_SENDING}", "-o", str(log), *PROGRAM]
    events = tmp_path / "events.jsonl"
    with flown(strace, "--events", str(events), *options) as (peers, _):
        calls = log.read_text(errors="replace").splitlines()
        written = [call for call in calls if str(events) in call]
        asked = [call for call in calls if _INTERFACES in call]
        others = [call for call in calls if call not in asked]
        sent = [call for call in others if re.search(r"\w+\(\d+<(UDP|TCP|UDPv6|TCPv6|NETLINK|socket)", call)]
        to_device = [call for call in calls if peers.device in call]
    assert written
    assert all(re.search(r"sendto\(\d+<NETLINK:\[ROUTE.*nl_pid=0,", call) for call in asked)  # of the system itself
    assert bool(sent) == bool(to_device) == bool(options)
