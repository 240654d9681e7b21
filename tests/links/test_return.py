"""Links that go and return: told, waited for, and judged as if they had only been silent."""

import contextlib
import itertools
import os
import pty
import random
import socket
import struct
import threading
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge import Monitor
from gcs_bridge.errors import SourceError
from gcs_bridge.links import loop, reopening
from gcs_bridge.links.open import open_link
from gcs_bridge.links.reopening import Reopening
from gcs_bridge.links.stream_links import TcpLink
from gcs_bridge.links.uri import NetworkUri, parse_uri
from gcs_bridge.mavlink.scanner import RawFrame
from gcs_bridge.sinks.tlog import TlogRecorder
from tests.helpers.everyday import one_in
from tests.helpers.live_links import Event, Live, fixture, frames_of, free_port, hurry, paced, recorder, wait_until
from tests.helpers.wire import GROUND_STATION, NO_AUTOPILOT, heartbeat

SPEED = 15.0


def has_told(live: Live, name: str, times: int) -> bool:
    """Whether an event has come so often."""
    return live.names().count(name) == times


def alarms(events: Sequence[Event]) -> list[tuple[Any, ...]]:
    told = ("alarm_raised", "alarm_cleared")
    return [(event["event"], event["id"], event["boot_s"]) for event in events if event["event"] in told]


def recorded_alarms(path: Path) -> list[tuple[Any, ...]]:
    return alarms(Monitor().feed_recording(path.read_bytes()))


def ups_and_downs(live: Live) -> list[str]:
    return [name for name in live.names() if name.startswith("link_")]


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What has gone is looked for soon, and it is soon told why it does not return."""
    monkeypatch.setattr(loop, "FIRST_DELAY_S", 0.02)
    monkeypatch.setattr(reopening, "_TOLD_S", 0.3)


class Server:
    """A TCP server of this machine that is there or not, always at the same port."""

    def __init__(self) -> None:
        self.port = free_port(socket.SOCK_STREAM)

    def serve(self, frames: Sequence[RawFrame], speed: float) -> None:
        """Be there, play the frames to whoever connects, and be gone."""
        self._play(socket.create_server(("127.0.0.1", self.port)), frames, speed)

    def serving(self, frames: Sequence[RawFrame], speed: float) -> threading.Thread:
        """The same in a thread: it is there now."""
        server = socket.create_server(("127.0.0.1", self.port))
        thread = threading.Thread(target=self._play, args=(server, frames, speed))
        thread.start()
        return thread

    def _play(self, server: socket.socket, frames: Sequence[RawFrame], speed: float) -> None:
        with server:
            server.settimeout(30)
            peer, _ = server.accept()
            with peer:
                paced(frames, peer.sendall, speed)


def client_of(port: int, frames: Sequence[RawFrame], speed: float) -> None:
    """Connect, send the frames, and go."""
    with socket.create_connection(("127.0.0.1", port)) as client:
        paced(frames, client.sendall, speed)


def parts(frames: Sequence[RawFrame], count: int) -> list[Sequence[RawFrame]]:
    size = -(-len(frames) // count)
    return [frames[start : start + size] for start in range(0, len(frames), size)]


@pytest.mark.slow
@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("kind", ["tcp", "tcpin"])
def test_a_link_that_goes_and_returns_twenty_times(kind: str, tmp_path: Path) -> None:
    """Each time it is told; every frame is judged and recorded, and no descriptor is left behind."""
    frames = fixture("a_copter_square", from_s=75, to_s=84, fault="yaw_offset:25")
    pieces = parts(frames, 21)
    server = Server()
    path = tmp_path / "live.tlog"
    record = recorder(path)
    first = server.serving(pieces[0], SPEED) if kind == "tcp" else None
    link = open_link(NetworkUri(kind, "127.0.0.1", server.port))
    with Live(link, on_frames=record.frames) as live:
        if first is not None:
            first.join()
        else:
            client_of(server.port, pieces[0], SPEED)
        wait_until(lambda: "link_down" in live.names())
        before = open_files()
        for count, piece in enumerate(pieces[1:], 2):
            if kind == "tcp":
                server.serve(piece, SPEED)
            else:
                client_of(server.port, piece, SPEED)
            wait_until(partial(has_told, live, "link_down", count))
        assert abs(open_files() - before) <= 1
    record.close()
    assert ups_and_downs(live) == ["link_up", "link_down"] * 21
    assert [frame.data for frame in frames_of(path.read_bytes())] == [frame.data for frame in frames]
    raised = alarms(live.events)
    assert [name for name, *_ in raised] == ["alarm_raised"]
    assert recorded_alarms(path) == raised


@pytest.mark.slow
@pytest.mark.usefixtures("at_once")
def test_a_server_that_is_gone_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    """The vehicle is stale and lost in time, and seen again; why the link does not return is told once."""
    frames = fixture("a_copter_square", from_s=75, to_s=81)
    early, late = parts(frames, 2)
    hurry(monkeypatch, 4.0)
    server = Server()
    serving = server.serving(early, SPEED)
    with Live(open_link(NetworkUri("tcp", "127.0.0.1", server.port))) as live:
        serving.join()
        wait_until(lambda: "vehicle_lost" in live.names())
        names = live.names()
        assert names.index("link_down") < names.index("stream_stale") < names.index("vehicle_lost")
        server.serve(late, SPEED)
        wait_until(lambda: live.names().count("link_down") == 2)
        told = live.names()[len(names) :]
    assert told.index("link_up") < told.index("vehicle_seen") < told.index("stream_resumed")
    (note,) = live.notes
    assert note.startswith(f"a link has gone, and is tried again and again: tcp:127.0.0.1:{server.port}: ")
    assert note.endswith(": connection refused: nothing listens there")


def test_another_client_waits_until_the_first_has_gone() -> None:
    """What it sends meanwhile is not lost, and comes behind what the first one sent."""
    uri = NetworkUri("tcpin", "127.0.0.1", free_port(socket.SOCK_STREAM))
    frames = fixture("e_two_vehicles", to_s=1)
    seen = Seen()
    with Live(open_link(uri), on_frames=seen.take) as live:
        with socket.create_connection(("127.0.0.1", uri.port)) as first:
            first.sendall(frames[0].data)
            wait_until(lambda: len(seen.data) == 1)
            second = socket.create_connection(("127.0.0.1", uri.port))
            second.sendall(frames[1].data)
            time.sleep(0.3)
            first.sendall(frames[2].data)
            wait_until(lambda: len(seen.data) == 2)
        with second:
            wait_until(lambda: len(seen.data) == 3)
            second.settimeout(0.2)
            with pytest.raises(TimeoutError):  # nothing is sent back
                second.recv(1)
    assert seen.data == [frames[0].data, frames[2].data, frames[1].data]
    assert ups_and_downs(live)[:3] == ["link_up", "link_down", "link_up"]


class Seen:
    """Keeps the frames that came, and records them if asked."""

    def __init__(self, recorder: TlogRecorder | None = None) -> None:
        self.data: list[bytes] = []
        self._recorder = recorder

    def take(self, link: int | str, frames: Sequence[RawFrame]) -> None:
        if self._recorder is not None:
            self._recorder.frames(link, frames)
        self.data += [frame.data for frame in frames]

    def has(self, count: int) -> bool:
        """Whether so many have come."""
        return len(self.data) == count


@contextlib.contextmanager
def plugged_in(device: Path) -> Iterator[int]:
    """A serial device at a path of its own, as a cable gives it: gone at the end. The descriptor of the other end."""
    master, slave = pty.openpty()
    tty.setraw(master)
    device.symlink_to(os.ttyname(slave))
    try:
        yield master
    finally:
        device.unlink()
        os.close(slave)
        os.close(master)


@pytest.mark.slow
@pytest.mark.usefixtures("at_once")
def test_a_serial_device_that_is_unplugged_and_back(tmp_path: Path) -> None:
    """Three times: what comes afterwards is judged, and recorded as it came."""
    frames = fixture("a_copter_square", from_s=75, to_s=84, fault="yaw_offset:25")
    device, path = tmp_path / "ttyACM0", tmp_path / "live.tlog"
    record = recorder(path)
    seen, came = Seen(record), 0
    with contextlib.ExitStack() as stack:
        master = stack.enter_context(plugged_in(device))
        live = Live(open_link(parse_uri(str(device), baud=57600)), on_frames=seen.take)
        with live:
            for number, piece in enumerate(parts(frames, 4)):
                paced(piece, partial(os.write, master), SPEED)
                came += len(piece)
                wait_until(partial(seen.has, came))
                stack.close()
                wait_until(partial(has_told, live, "link_down", number + 1))
                master = stack.enter_context(plugged_in(device))
                wait_until(partial(has_told, live, "link_up", number + 2))
    record.close()
    assert [frame.data for frame in frames_of(path.read_bytes())] == [frame.data for frame in frames]
    assert [name for name, *_ in alarms(live.events)] == ["alarm_raised"]
    assert recorded_alarms(path) == alarms(live.events)


@pytest.mark.slow
def test_a_sender_that_restarts(tmp_path: Path) -> None:
    """Over UDP it comes from another port, after a pause: the link stays up, and nothing is lost."""
    frames = fixture("a_copter_square", from_s=75, to_s=84, fault="yaw_offset:25")
    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    path = tmp_path / "live.tlog"
    record = recorder(path)
    seen = Seen(record)
    with Live(open_link(uri), on_frames=seen.take) as live:
        for piece in parts(frames, 5):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                paced(piece, lambda data: sender.sendto(data, (uri.host, uri.port)), SPEED)
            time.sleep(0.1)
        wait_until(partial(seen.has, len(frames)))
    record.close()
    assert ups_and_downs(live) == ["link_up"]
    assert [frame.data for frame in frames_of(path.read_bytes())] == [frame.data for frame in frames]
    assert len(alarms(live.events)) == 1
    assert recorded_alarms(path) == alarms(live.events)


def shaken(frames: Sequence[RawFrame], dice: random.Random) -> list[bytes]:
    """What a bad radio makes of them: 5 % lost, 1 % with a wrong byte, some twice, some late by up to four."""
    sent: list[tuple[float, bytes]] = []
    for place, frame in enumerate(frames):
        if dice.random() < 0.05:
            continue
        data = bytearray(frame.data)
        if dice.random() < 0.01:
            data[dice.randrange(len(data))] ^= 1 + dice.randrange(255)
        times = 2 if dice.random() < 0.02 else 1
        sent += [(place + (dice.uniform(1, 4) if dice.random() < 0.03 else 0), bytes(data)) for _ in range(times)]
    return [data for _, data in sorted(sent, key=lambda one: one[0])]


@pytest.mark.slow
@pytest.mark.parametrize("seed", one_in(2, [1, 2]))
def test_a_bad_radio(seed: int, tmp_path: Path) -> None:
    """Loss, damage, duplicates and disorder: the true alarm and no other; and the recording gives it again."""
    frames = fixture("a_copter_square", from_s=70, to_s=88, fault="yaw_offset:25")
    last = heartbeat(autopilot=NO_AUTOPILOT, vehicle=GROUND_STATION, sysid=255, compid=190)
    sent = [*shaken(frames, random.Random(seed)), last]
    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    path = tmp_path / "live.tlog"
    record = recorder(path)
    seen = Seen(record)
    with Live(open_link(uri), on_frames=seen.take) as live, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to:
        for data in sent:
            to.sendto(data, (uri.host, uri.port))
            time.sleep(18 / len(frames) / SPEED)
        wait_until(lambda: last in seen.data)
    record.close()
    (raised,) = alarms(live.events)
    assert raised[0] == "alarm_raised"
    assert recorded_alarms(path) == [raised]


# --- what else can be listened to ------------------------------------------------------------------------------------


def test_ipv6(tmp_path: Path) -> None:
    """`[::]` takes both; `[::1]` takes its own."""
    frames = fixture("e_two_vehicles", to_s=1)
    if not socket.has_ipv6 or not Path("/proc/net/if_inet6").read_text().strip():
        pytest.skip("this machine has no IPv6")
    for text, families in (
        ("udpin:[::]:{}", (socket.AF_INET, socket.AF_INET6)),
        ("udpin:[::1]:{}", (socket.AF_INET6,)),
    ):
        uri = parse_uri(text.format(free_port()))
        assert isinstance(uri, NetworkUri)
        came = Seen()
        with Live(open_link(uri), on_frames=came.take):
            for number, family in enumerate(families):
                with socket.socket(family, socket.SOCK_DGRAM) as sender:
                    sender.sendto(frames[number].data, ("::1" if family == socket.AF_INET6 else "127.0.0.1", uri.port))
                wait_until(partial(came.has, number + 1))
    server = socket.create_server(("::1", 0), family=socket.AF_INET6)
    with server:
        link = open_link(parse_uri(f"tcp:[::1]:{server.getsockname()[1]}"))
        link.close()


def test_multicast() -> None:
    """Two who listen to one group both get what is sent to it, and nothing that is sent to another one."""
    uri = parse_uri(f"mcast:239.255.145.50:{free_port()}")
    assert isinstance(uri, NetworkUri)
    frames = fixture("e_two_vehicles", to_s=1)
    seen = Seen(), Seen()
    try:
        links = open_link(uri), open_link(uri)
    except SourceError as error:
        pytest.skip(str(error))
    with Live(links[0], on_frames=seen[0].take), Live(links[1], on_frames=seen[1].take):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
            sender.sendto(frames[0].data, ("239.255.145.51", uri.port))
            sender.sendto(frames[1].data, (uri.host, uri.port))
        wait_until(lambda: all(one.data for one in seen))
    assert seen[0].data == seen[1].data == [frames[1].data]


def test_pymavlink_s_multicast_is_heard() -> None:
    """What pymavlink sends by `mcast:` comes here by the same words."""
    from pymavlink import mavutil

    port = free_port()
    seen = Seen()
    try:
        link = open_link(parse_uri(f"mcast:{port}"))
        sender = mavutil.mavlink_connection(f"mcast:{port}")
    except (SourceError, OSError) as error:
        pytest.skip(f"no multicast here: {error}")
    with Live(link, on_frames=seen.take), contextlib.closing(sender):
        sender.write(fixture("e_two_vehicles", to_s=1)[0].data)
        wait_until(lambda: len(seen.data) == 1)


# --- how it is tried again -------------------------------------------------------------------------------------------


def test_delays_double_up_to_five_seconds() -> None:
    """Half a second first, and never longer than five."""
    delays = list(itertools.accumulate(range(6), lambda before, _: reopening.longer(before), initial=0.5))
    assert delays == [0.5, 1, 2, 4, 5, 5, 5]


class Port:
    closed = False

    def close(self) -> None:
        self.closed = True


def test_what_is_opened_too_late_is_closed() -> None:
    """Who gives up while the port is being opened leaves nothing open."""
    port, opening, go_on = Port(), threading.Event(), threading.Event()

    def slow() -> Port:
        opening.set()
        go_on.wait(5)
        return port

    waiting = Reopening(slow, 0.0)
    assert opening.wait(5)
    waiting.close()
    go_on.set()
    wait_until(lambda: port.closed)


def test_a_port_that_connects_to_itself_is_no_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tried often enough, the system connects a free port of this machine to itself: that is nobody."""

    def to_itself(address: tuple[str, int], timeout: float) -> socket.socket:
        both = socket.socket()
        both.bind(("127.0.0.1", 0))
        both.connect(both.getsockname())
        return both

    monkeypatch.setattr(socket, "create_connection", to_itself)
    with pytest.raises(SourceError, match="connection refused"):
        open_link(NetworkUri("tcp", "127.0.0.1", 40000))


@pytest.mark.parametrize("kind", ["tcp", "tcpin"])
def test_a_pulled_cable_is_noticed(kind: str) -> None:
    """The system asks after some seconds of silence whether the other side is there: no connection stays for ever."""
    with contextlib.ExitStack() as stack:
        if kind == "tcp":
            server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            link = open_link(NetworkUri("tcp", "127.0.0.1", server.getsockname()[1]))
        else:
            link = open_link(NetworkUri("tcpin", "127.0.0.1", free_port(socket.SOCK_STREAM)))
            port = link._port.getsockname()[1]
            stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            assert not len(link.drain())
        stack.callback(link.close)
        assert isinstance(link, TcpLink)
        same = stack.enter_context(socket.socket(fileno=os.dup(link.fileno() or -1)))
        assert same.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        waits_s = sum(
            same.getsockopt(socket.IPPROTO_TCP, option) * times
            for option, times in ((socket.TCP_KEEPIDLE, 1), (socket.TCP_KEEPINTVL, 3))
        )
        assert waits_s <= 15


@pytest.mark.slow  # it waits for longer and longer
def test_who_leaves_at_once_is_not_asked_for_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A server that takes each connection and closes it is tried less and less often, as one that is not there."""
    monkeypatch.setattr(loop, "FIRST_DELAY_S", 0.05)
    accepted: list[float] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.1)
        ended = threading.Event()

        def serve() -> None:
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    peer, _ = server.accept()
                    accepted.append(time.monotonic())
                    ended.wait(0.3 if len(accepted) == 1 else 0.0)  # it must be open before it can be lost
                    # A reset, so that no port of this machine has to cool down.
                    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    peer.close()

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            with Live(open_link(NetworkUri("tcp", "127.0.0.1", server.getsockname()[1]))) as live:
                wait_until(lambda: len(accepted) == 6)
        finally:
            ended.set()
            thread.join()
    # 0.05 s that double are 0.75 s, and 0.2 s if they did not; either end may be held up on a busy machine.
    assert accepted[-1] - accepted[1] > 0.45
    assert "Connection reset by peer" in {event.get("reason") for event in live.events}


# --- bytes, and no frame ---------------------------------------------------------------------------------------------


def noise(dice: random.Random) -> bytes:
    return dice.randbytes(40)


@pytest.mark.slow  # it listens for seconds
@pytest.mark.parametrize("kind", ["serial", "udpin"])
def test_bytes_without_a_frame_are_told_once(kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of a serial device with the speeds to try; again only if there were frames in between."""
    monkeypatch.setattr(loop, "_NO_FRAME_S", 0.3)
    dice = random.Random(3)
    frames = fixture("e_two_vehicles", to_s=3)

    def damaged(live: Live) -> list[str]:
        return [event["reason"] for event in live.events if event["event"] == "damage"]

    with contextlib.ExitStack() as stack:
        send: Callable[[bytes], Any]
        if kind == "serial":
            master = stack.enter_context(plugged_in(tmp_path / "ttyACM0"))
            link = open_link(parse_uri(f"{tmp_path}/ttyACM0", baud=57600))
            send = lambda data: os.write(master, data)
        else:
            uri = NetworkUri("udpin", "127.0.0.1", free_port())
            link = open_link(uri)
            sender = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            send = lambda data: sender.sendto(data, ("127.0.0.1", uri.port))
        live = stack.enter_context(Live(link))

        def play(seconds: float) -> None:
            ends_s = time.monotonic() + seconds
            while time.monotonic() < ends_s:
                send(noise(dice))
                time.sleep(0.01)

        def told(times: int) -> bool:
            play(0.01)
            return len(damaged(live)) == times

        play(0.06)  # a boot loader's greeting is not worth a word
        time.sleep(0.4)
        assert damaged(live) == []
        wait_until(lambda: told(1))
        play(0.7)
        assert len(damaged(live)) == 1
        for frame in frames[:10]:
            send(frame.data)
        wait_until(lambda: "vehicle_seen" in live.names())
        wait_until(lambda: told(2))
    first, again = damaged(live)
    assert first == again
    assert first.startswith("bytes come, but no MAVLink frame: ")
    if kind == "serial":
        assert "--baud 57600" in first
        assert "try --baud 115200, 921600, " in first


@pytest.mark.slow
def test_a_healthy_link_is_not_called_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither with a heartbeat now and then, nor with damage among frames, nor of what only a ground station sends."""
    monkeypatch.setattr(loop, "_NO_FRAME_S", 0.6)
    dice = random.Random(4)
    beats = [frame.data for frame in fixture("e_two_vehicles") if frame.data[7:10] == b"\0\0\0"]
    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    with Live(open_link(uri)) as live, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for beat in beats[:6]:
            for _ in range(10):
                sender.sendto(noise(dice), (uri.host, uri.port))
                time.sleep(0.02)
            sender.sendto(beat, (uri.host, uri.port))
    assert "damage" not in live.names()
