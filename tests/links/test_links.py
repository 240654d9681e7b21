"""Links as the system has them: real sockets, a real pair of serial terminals."""

import contextlib
import errno
import os
import random
import select
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gcs_bridge.chunks import Chunk, Framing
from gcs_bridge.errors import SourceError
from gcs_bridge.links.datagrams import DatagramReader
from gcs_bridge.links.link import Link, LinkDownError
from gcs_bridge.links.open import open_link
from gcs_bridge.links.port_owner import port_owner
from gcs_bridge.links.stream_links import SerialLink
from gcs_bridge.links.uri import NetworkUri, SerialUri
from gcs_bridge.links.wall_clock import now_us
from tests.helpers.live_links import Live, fixture, free_port, tcp_sender, terminals, wait_until


def fetched(link: Link, size: int) -> list[Chunk]:
    """Chunks until `size` bytes have come."""
    pieces: list[Chunk] = []

    def enough() -> bool:
        pieces.extend(link.drain())
        return sum(len(piece.data) for piece in pieces) >= size

    wait_until(enough)
    return pieces


@contextlib.contextmanager
def udp() -> Iterator[tuple[Link, socket.socket]]:
    """A link, and the socket of one who sends to it."""
    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    link = open_link(uri)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", uri.port))
        try:
            yield link, sender
        finally:
            link.close()


def needs_room(link: Link, size: int) -> None:
    """Skip the test where the system allows small buffers alone."""
    with socket.socket(fileno=os.dup(link.fileno() or -1)) as same:
        if same.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) < size:
            pytest.skip("the system allows small buffers alone")


def test_datagrams_keep_their_borders_and_times() -> None:
    """Each comes alone, with the time at which it arrived, however late it is fetched."""
    with udp() as (link, sender):
        assert link.framing is Framing.DATAGRAM
        spans_us: list[tuple[int, int]] = []

        def sent(*several: bytes) -> list[Chunk]:
            spans_us.clear()
            for data in several:
                before_us = time.time_ns() // 1000
                sender.send(data)
                spans_us.append((before_us, time.time_ns() // 1000))
                time.sleep(0.03)
            return list(link.drain())

        def on_time(pieces: list[Chunk]) -> bool:
            # The times are of the kernel's clock, which it reads in the call that sends.
            return all(a - 1000 <= one.t_rx_us <= b + 1000 for one, (a, b) in zip(pieces, spans_us, strict=True))

        if sys.platform == "linux":  # where the kernel tells, from a moment behind the wish on
            wait_until(lambda: on_time(sent(b"first")))
        pieces = sent(b"one", b"", b"three" * 300)
        assert [piece.data for piece in pieces] == [b"one", b"", b"three" * 300]
        assert on_time(pieces) or sys.platform != "linux"


@pytest.mark.parametrize("many_at_once", [True, False])
def test_many_datagrams_of_all_sizes(many_at_once: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of them, in order, to the byte: some hundred at once, the largest too; also one by one, as elsewhere."""
    if not many_at_once:
        monkeypatch.setattr(sys, "platform", "another")
    dice = random.Random(1)
    sent = [dice.randbytes(dice.choice((0, 1, 40, 280, 1400, 9000, 65_507))) for _ in range(300)]
    with udp() as (link, sender):
        needs_room(link, 2**23)
        before_us = now_us()
        for data in sent:
            sender.send(data)
        chunks: list[Chunk] = []

        def all_came() -> bool:
            chunks.extend(link.drain())
            return len(chunks) >= len(sent)

        wait_until(all_came)  # a busy system hands them over a moment later
    times_us = [chunk.t_rx_us for chunk in chunks]
    assert [chunk.data for chunk in chunks] == sent
    assert before_us - 10_000 <= times_us[0] <= times_us[-1] <= now_us() + 1000  # of the kernel's clock
    assert times_us == sorted(times_us)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells when each arrived")
def test_no_datagram_arrived_after_the_one_behind_it() -> None:
    """Linux tells the time of reading for one that came before it began to stamp: later than what was stamped since."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        port.bind(("127.0.0.1", 0))
        sender.connect(port.getsockname())
        reader = DatagramReader(port)
        sender.send(b"stamped")
        ends, t_rx_us = np.array([3, 0]), np.array([now_us() + 60_000_000, 0])
        assert reader.read(np.zeros(100, np.uint8), ends, t_rx_us, 1) == 2
        assert ends.tolist() == [3, 10]
        assert t_rx_us[0] == t_rx_us[1] <= now_us()


def test_a_flood_of_datagrams_does_not_hold_the_loop() -> None:
    """One drain takes some thousand, and leaves the rest for the next."""
    with udp() as (link, sender):
        needs_room(link, 2**23)
        for index in range(6000):
            sender.send(index.to_bytes(2, "big"))
        first, second = len(link.drain()), len(link.drain())
    assert 4000 < first < 4500
    assert first + second == 6000


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts what it dropped")
def test_what_the_system_drops_is_counted() -> None:
    """A buffer that is not fetched in time overflows: the link knows by how many, once the next one comes."""
    with udp() as (link, sender):
        with socket.socket(fileno=os.dup(link.fileno() or -1)) as same:
            same.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**21)
        for _ in range(20_000):
            sender.send(bytes(200))
        taken = 0
        while some := len(link.drain()):
            taken += some
        sender.send(b"next")
        fetched(link, 4)
        assert 1000 < taken < 20_000
        assert link.dropped == 20_000 - taken


@pytest.mark.skipif(sys.platform != "linux", reason="the granted size is told differently elsewhere")
def test_a_large_buffer_is_asked_for() -> None:
    """As large as the system allows: Linux grants twice its rmem_max, or all that was asked for; all of it to root."""
    with udp() as (link, _), socket.socket(fileno=os.dup(link.fileno() or -1)) as same:
        allowed = int(Path("/proc/sys/net/core/rmem_max").read_text())
        granted = same.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        assert granted in (2 * min(allowed, 16 * 2**20), 2 * 16 * 2**20)


def test_a_flood_does_not_hold_the_loop() -> None:
    """One drain takes a megabyte or so, and leaves the rest for the next."""
    with tcp_sender(fixture("a_copter_square") * 4, 1e9) as (port, _):
        link = open_link(NetworkUri("tcp", "127.0.0.1", port))
        time.sleep(0.5)
        assert link.drain().data.size <= 2**20 + 65536
        link.close()


def test_a_stream_ends_behind_its_last_byte() -> None:
    """Everything that the other side sent before it closed is fetched, then the link is down."""
    frames = fixture("e_two_vehicles", to_s=3)
    with tcp_sender(frames, 1e9) as (port, _):
        link = open_link(NetworkUri("tcp", "127.0.0.1", port))
        assert link.framing is Framing.STREAM
        size = sum(len(frame.data) for frame in frames)
        assert b"".join(piece.data for piece in fetched(link, size)) == b"".join(frame.data for frame in frames)
        with pytest.raises(LinkDownError, match="the other side has closed"):
            wait_until(lambda: len(link.drain()) > 0)
        link.close()


def test_serial() -> None:
    """Bytes of a device come in order; nothing there is an empty list; a device that goes is told."""
    with terminals() as (master, device):
        link = open_link(SerialUri(device, 115200))
        assert list(link.drain()) == []
        data = bytes(range(256)) * 8
        os.write(master, data)
        assert b"".join(piece.data for piece in fetched(link, len(data))) == data
        assert list(link.drain()) == []
        os.close(master)
        with pytest.raises(LinkDownError):
            wait_until(lambda: len(link.drain()) > 0)
        link.close()


# --- passive ---------------------------------------------------------------------------------------------------------


def test_nothing_is_sent_over_udp() -> None:
    """Whoever sends to the link hears nothing."""
    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle, Live(open_link(uri)) as live:
        vehicle.bind(("127.0.0.1", 0))
        for frame in fixture("e_two_vehicles", to_s=3):
            vehicle.sendto(frame.data, ("127.0.0.1", uri.port))
            time.sleep(0.0002)
        wait_until(lambda: live.names().count("vehicle_seen") == 2)
        time.sleep(0.5)
        vehicle.setblocking(False)
        with pytest.raises(BlockingIOError):
            vehicle.recv(1)


def test_nothing_is_sent_over_tcp() -> None:
    """From opening to closing, the server receives no byte."""
    with tcp_sender(fixture("e_two_vehicles", to_s=3), 20) as (port, received):
        with Live(open_link(NetworkUri("tcp", "127.0.0.1", port))) as live:
            live.wait_for_the_end()
            assert live.names().count("vehicle_seen") == 2
        wait_until(lambda: bool(received))
    assert received == [b""]


def test_nothing_is_sent_over_serial() -> None:
    """Neither opening nor listening nor closing writes to the device."""
    with terminals() as (master, device):
        with Live(open_link(SerialUri(device, 57600))) as live:
            for frame in fixture("e_two_vehicles", to_s=3):
                os.write(master, frame.data)
                time.sleep(0.0005)
            wait_until(lambda: live.names().count("vehicle_seen") == 2)
        assert select.select([master], [], [], 0.2)[0] == []


# --- what cannot be opened -------------------------------------------------------------------------------------------


def refusal(uri: NetworkUri | SerialUri) -> str:
    with pytest.raises(SourceError) as refused:
        open_link(uri)
    assert refused.value.exit_code == 3
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize("reuse", [0, 1])
def test_port_in_use(reuse: int) -> None:
    """By whom is told too, where the system tells, and also if the other would share it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, reuse)
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        said = refusal(NetworkUri("udpin", "0.0.0.0", port))
        assert f"port {port} is in use" in said
        if sys.platform == "linux":
            assert f"(process {os.getpid()})" in said
    assert port_owner(port, "udp") is None


def test_nobody_takes_the_port_away() -> None:
    """A port is shared where all ask for it; our link does not."""
    uri = NetworkUri("udpin", "127.0.0.1", free_port())
    link = open_link(uri)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
        thief.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with pytest.raises(OSError, match=os.strerror(errno.EADDRINUSE)):
            thief.bind((uri.host, uri.port))
    link.close()


@pytest.mark.parametrize(
    ("uri", "said"),
    [
        (NetworkUri("tcp", "127.0.0.1", 9), "connection refused: nothing listens there"),
        (NetworkUri("tcp", "no-such-host.invalid", 5760), "unknown host 'no-such-host.invalid'"),
        (NetworkUri("udpin", "no-such-host.invalid", 14550), "unknown host 'no-such-host.invalid'"),
        (NetworkUri("udpin", "192.0.2.7", 14550), "192.0.2.7 is no address of this machine; 0.0.0.0 stands for all"),
        (SerialUri("/dev/ttyNONE0", 57600), "no such device; there "),
        (SerialUri("/dev/null", 57600), "not a serial device"),
        (SerialUri("/dev", 57600), "not a serial device"),
    ],
)
def test_refusals(uri: NetworkUri | SerialUri, said: str) -> None:
    """Each says what it was and, where something can be done, what."""
    assert said in refusal(uri)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open every device and port")
def test_no_permission() -> None:
    """A device of another group names the group to join; a low port, that it needs an administrator."""
    with terminals() as (_, device):
        Path(device).chmod(0)
        assert "join the device's group" in refusal(SerialUri(device, 57600))
    if int(Path("/proc/sys/net/ipv4/ip_unprivileged_port_start").read_text()) > 1:
        assert "needs an administrator" in refusal(NetworkUri("udpin", "127.0.0.1", 1))


def test_permission_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same where the system's refusal is made up, since whoever runs this may be root."""
    import gcs_bridge.links.open as opening

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setitem(opening.OPENERS, "serial", (SerialLink, refuse))
    assert "'sudo usermod -aG dialout $USER'" in refusal(SerialUri("/dev/ttyNONE0", 57600))


@pytest.fixture
def all_are_serial(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of a pair is taken for a real port, which nobody else may have opened."""
    import gcs_bridge.links.open as opening

    monkeypatch.setattr(opening, "_SERIAL_NAMES", ("",))


@contextlib.contextmanager
def running(folder: Path, name: str, device: str | None = None) -> Iterator[int]:
    """A program of this name, which holds `device`; its process."""
    program = folder / name
    shutil.copy(shutil.which("sleep") or "/bin/sleep", program)
    holding = open(device) if device else contextlib.nullcontext()  # noqa: PTH123, SIM115  # a device by its name, closed by `with`
    with holding as stdin, subprocess.Popen([program, "60"], stdin=stdin or subprocess.DEVNULL) as process:
        try:
            comm = Path(f"/proc/{process.pid}/comm")
            wait_until(lambda: comm.read_text().strip() == name[:15])
            yield process.pid
        finally:
            process.kill()


@pytest.mark.skipif(sys.platform != "linux", reason="told by /proc alone")
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("minicom", "end that program"),
        ("ModemManager", "'sudo systemctl stop ModemManager' ends it, 'sudo systemctl disable --now ModemManager' for"),
    ],
)
@pytest.mark.usefixtures("all_are_serial")
def test_a_device_that_somebody_holds(name: str, said: str, tmp_path: Path) -> None:
    """Refused although it could be opened: each of two readers would get half of the bytes. Who it is is told."""
    with terminals() as (_, device), running(tmp_path, name, device) as process:
        told = refusal(SerialUri(device, 57600))
    assert f"in use by {name} (process {process}): " in told
    assert said in told


def test_a_device_that_is_locked() -> None:
    """Who has locked the device, as pyserial's programs may, is in the way as well; nothing is known of whom."""
    with terminals() as (_, device):
        first = open_link(SerialUri(device, 57600))
        assert f"in use by another program (a ground station?); 'sudo fuser -v {device}' names it" in refusal(
            SerialUri(device, 57600)
        )
        first.close()
        open_link(SerialUri(device, 57600)).close()


@pytest.mark.skipif(sys.platform != "linux", reason="told by /proc alone")
def test_a_modem_manager_of_another_user_is_guessed(tmp_path: Path) -> None:
    """What root's programs hold is not told to others; that this one runs is."""
    with terminals() as (_, device), running(tmp_path, "ModemManager"):
        first = open_link(SerialUri(device, 57600))
        told = refusal(SerialUri(device, 57600))
        first.close()
    assert "in use by another program, ModemManager probably: it lets go" in told


def test_nobody_listens_twice() -> None:
    """A port of `tcpin:` that is taken names who has it; one that cools down behind a client is free."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        said = refusal(NetworkUri("tcpin", "127.0.0.1", port))
        assert f"port {port} is in use" in said
        if sys.platform == "linux":
            assert f"(process {os.getpid()})" in said
    uri = NetworkUri("tcpin", "127.0.0.1", free_port(socket.SOCK_STREAM))
    for _ in range(2):
        link = open_link(uri)
        with socket.create_connection((uri.host, uri.port)) as client:
            client.send(b"x")
            fetched(link, 1)
            link.close()  # before the client: this side's port cools down


def test_nothing_is_sent_to_a_client() -> None:
    """From connecting to the end, the client of `tcpin:` hears nothing."""
    uri = NetworkUri("tcpin", "127.0.0.1", free_port(socket.SOCK_STREAM))
    with Live(open_link(uri)) as live, socket.create_connection((uri.host, uri.port)) as client:
        for frame in fixture("e_two_vehicles", to_s=8):
            client.sendall(frame.data)
        wait_until(lambda: live.names().count("vehicle_seen") == 2)
        client.shutdown(socket.SHUT_WR)
        client.settimeout(30)
        assert client.recv(1) == b""  # it has closed, and said nothing
