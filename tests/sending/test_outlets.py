"""Relays: what comes out of each kind, by real sockets of this machine, and what a consumer that stands still costs."""

import socket
import time
from collections.abc import Callable, Iterator

import pytest

from gcs_bridge.errors import SourceError, UsageError
from gcs_bridge.links.uri import NetworkUri
from gcs_bridge.sending.loops import refuse_loop
from gcs_bridge.sending.outlets import Heard, Outlet, open_outlet, parse_relay
from tests.helpers.live_links import fixture, free_port, wait_until
from tests.helpers.processor import awake_s

FRAMES = [frame.data for frame in fixture("e_two_vehicles", to_s=4)]
WHOLE = b"".join(FRAMES)


class Opened:
    """An outlet that is opened for a test, and what it told."""

    def __init__(self, kind: str, port: int) -> None:
        self.said: list[str] = []
        self.outlet: Outlet = open_outlet(NetworkUri(kind, "127.0.0.1", port), self.said.append)

    def __enter__(self) -> "Opened":
        return self

    def __exit__(self, *_: object) -> None:
        self.outlet.close()

    def heard(self, count: int = 1) -> list[Heard]:
        got: list[Heard] = []

        def enough() -> bool:
            got.extend(self.outlet.run(time.monotonic()))
            return len(got) >= count

        wait_until(enough)
        return got

    def run_until(self, true: Callable[[], bool], seconds: float = 30.0) -> None:
        def done() -> bool:
            self.outlet.run(time.monotonic())
            return true()

        wait_until(done, seconds)


@pytest.fixture
def station() -> Iterator[socket.socket]:
    """A ground station's UDP socket."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**22)
        made.settimeout(30)
        yield made


def received(station: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += station.recv(65_536)
    return data


def test_udpout(station: socket.socket) -> None:
    """Each frame is a datagram, byte for byte; what the station answers is heard, and what others send is not."""
    with Opened("udpout", station.getsockname()[1]) as relay:
        relay.outlet.send(FRAMES[:200])
        first, sender = station.recvfrom(65_536)
        assert [first, *(station.recv(65_536) for _ in range(199))] == FRAMES[:200]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"stranger", sender)
        station.sendto(b"answer", sender)
        assert [(heard.data, heard.datagram) for heard in relay.heard()] == [(b"answer", True)]


def test_udpout_before_anybody_listens() -> None:
    """Nothing fails, and the station gets everything from the moment at which it is there."""
    port = free_port()
    with Opened("udpout", port) as relay:
        for _ in range(3):
            relay.outlet.send(FRAMES[:3])
            relay.outlet.run(time.monotonic())
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.bind(("127.0.0.1", port))
            station.settimeout(30)
            relay.outlet.send(FRAMES[:20])
            assert [station.recv(65_536) for _ in range(20)] == FRAMES[:20]


def test_udpin(station: socket.socket) -> None:
    """Who has spoken gets it, each of several; who sends no MAVLink gets nothing; who is silent is forgotten."""
    port = free_port()
    with Opened("udpin", port) as relay, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        relay.outlet.send(FRAMES[:5])
        other.sendto(b"hello", ("127.0.0.1", port))
        station.sendto(FRAMES[0], ("127.0.0.1", port))
        assert [heard.data for heard in relay.heard()] == [FRAMES[0]]
        relay.outlet.send(FRAMES[:5])
        assert [station.recv(65_536) for _ in range(5)] == FRAMES[:5]
        relay.outlet.run(time.monotonic() + 100)
        relay.outlet.send(FRAMES[:5])
        for socket_ in (station, other):
            socket_.settimeout(0.1)
            with pytest.raises(TimeoutError):
                socket_.recv(65_536)


def test_tcpin() -> None:
    """Several stations connect, get all of it, answer, and go; it is told."""
    port = free_port(socket.SOCK_STREAM)
    with Opened("tcpin", port) as relay:
        stations = [socket.create_connection(("127.0.0.1", port), 5) for _ in range(2)]
        relay.run_until(lambda: len(relay.said) == 2)
        relay.outlet.send(FRAMES[:100])
        for station in stations:
            assert received(station, len(b"".join(FRAMES[:100]))) == b"".join(FRAMES[:100])
            station.send(b"answer")
        heard = relay.heard(2)
        assert [one.data for one in heard] == [b"answer"] * 2
        assert heard[0].station != heard[1].station
        for station in stations:
            station.close()
        relay.run_until(lambda: len(relay.said) == 4)
    assert relay.said[0].startswith(f"relay tcpin:127.0.0.1:{port}: 127.0.0.1 port ")
    assert relay.said[3].endswith("the other side has closed the connection")


def test_tcp_comes_back() -> None:
    """A station that is not there is tried again, told once; when it is there it gets what comes then; so once more."""
    port = free_port(socket.SOCK_STREAM)
    with Opened("tcp", port) as relay:
        now_s = time.monotonic()
        for later_s in range(20):
            relay.outlet.run(now_s + later_s / 5)
            relay.outlet.send(FRAMES[:1])
            time.sleep(0.005)
        assert relay.said == [f"relay tcp:127.0.0.1:{port}: connection refused; trying again"]
        for turn in range(2):
            with socket.create_server(("127.0.0.1", port)) as server:
                server.settimeout(30)
                begun = [time.monotonic() + 100 * (turn + 1)]

                def connected(begun: list[float] = begun) -> bool:
                    begun[0] += 1
                    relay.outlet.run(begun[0])
                    return relay.said[-1].endswith(": connected")

                wait_until(connected)
                station, _ = server.accept()
                relay.outlet.send(FRAMES[:50])
                assert received(station, len(b"".join(FRAMES[:50]))) == b"".join(FRAMES[:50])
                station.close()
            relay.run_until(lambda: relay.said[-1].endswith("trying again"))
    assert [line.rpartition(": ")[2].partition(";")[0] for line in relay.said][1::2] == ["connected"] * 2


@pytest.mark.slow  # 15 MB a case
@pytest.mark.parametrize("kind", ["tcp", "tcpin"])
def test_a_station_that_takes_nothing(kind: str) -> None:
    """The queue is bounded, nothing waits, drops are counted; when it reads again all that it gets are whole frames."""
    port = free_port(socket.SOCK_STREAM)
    with socket.create_server(("127.0.0.1", port)) if kind == "tcp" else Opened("tcpin", port) as one:
        if isinstance(one, Opened):
            relay, station = one, socket.create_connection(("127.0.0.1", port), 5)
            relay.run_until(lambda: bool(relay.said))
        else:
            relay = Opened("tcp", port)
            relay.run_until(lambda: bool(relay.said))
            station, _ = one.accept()
        sent = 0
        longest_s = 0.0
        for _ in range(600):
            began_s = awake_s()
            relay.outlet.send(FRAMES)
            longest_s = max(longest_s, awake_s() - began_s)
            sent += len(FRAMES)
        assert longest_s < 0.25
        assert sent * len(WHOLE) / len(FRAMES) > 15e6
        assert relay.outlet.dropped > sent / 2
        station.settimeout(0.5)
        data = b""
        while True:
            relay.outlet.run(time.monotonic())
            try:
                data += station.recv(2**20)
            except TimeoutError:
                break
        assert len(data) < 8e6
        station.close()
        relay.outlet.close()
    found = _split(data)
    assert b"".join(found) == data
    assert set(found) <= set(FRAMES)
    assert len(found) + relay.outlet.dropped == sent


def _split(data: bytes) -> list[bytes]:
    """Frames of MAVLink 2, without signatures, one behind the other."""
    frames, at = [], 0
    while at < len(data):
        assert data[at] == 0xFD
        size = 12 + data[at + 1]
        frames.append(data[at : at + size])
        at += size
    return frames


# --- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["", "14550", "/dev/ttyACM0", "udp:127.0.0.1:14550", "mcast:", "tcp:127.0.0.1", "tcp:x:0"]
)
def test_what_is_no_relay(text: str) -> None:
    """One line that says what is."""
    with pytest.raises(UsageError, match=r"HOST:PORT|must be as tcp:"):
        parse_relay(text)


def test_a_relay_that_cannot_be_opened() -> None:
    """One line, exit code 3."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(SourceError, match=f"relay tcpin:127.0.0.1:{port}: address already in use"):
            open_outlet(NetworkUri("tcpin", "127.0.0.1", port), pytest.fail)
    with pytest.raises(SourceError, match="unknown host"):
        open_outlet(NetworkUri("udpout", "no-such-host.invalid", 14550), pytest.fail)


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0", "localhost"])
def test_a_relay_that_leads_back_here(host: str) -> None:
    """It would be relayed for ever; elsewhere the same port is another one."""
    link = NetworkUri("udpin", "0.0.0.0", 14550)
    with pytest.raises(UsageError, match="name another port"):
        refuse_loop(NetworkUri("udpout", host, 14550), [link])
    refuse_loop(NetworkUri("udpout", host, 14551), [link])
    refuse_loop(NetworkUri("udpout", "192.0.2.7", 14550), [link])
    group = NetworkUri("mcast", "239.255.145.50", 14550)
    with pytest.raises(UsageError, match="name another port"):
        refuse_loop(NetworkUri("udpout", group.host, 14550), [group])
    refuse_loop(NetworkUri("udpout", host, 14550), [group])
