"""Sending by each kind of link: to whom, and what becomes of it when the link goes and returns."""

import contextlib
import os
import pty
import socket
import tty
from pathlib import Path

import pytest

from gcs_bridge.links.link import DatagramLink, Link, LinkDownError
from gcs_bridge.links.open import open_link
from gcs_bridge.links.uri import NetworkUri, parse_uri
from tests.helpers.live_links import fixture, free_port, wait_until
from tests.helpers.multicast import GROUP, Group, multicast_works

FRAMES = [frame.data for frame in fixture("e_two_vehicles", to_s=1)]


def drained(link: Link) -> list[bytes]:
    """What has come, and that something has."""
    came: list[bytes] = []

    def has_come() -> bool:
        came.extend(bytes(chunk.data) for chunk in link)
        return bool(came)

    wait_until(has_come)
    return came


def gone(link: Link) -> None:
    """Wait until it has, and have it waited for."""

    def is_down() -> bool:
        try:
            link.drain()
        except LinkDownError:
            return True
        return False

    wait_until(is_down)
    link.wait(0.05)


@pytest.mark.slow
def test_a_tcp_link_that_returns_may_still_send() -> None:
    """Nothing is sent, nor kept, while it is down; a frame sent in part is not ended for who comes next."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link(NetworkUri("tcp", "127.0.0.1", server.getsockname()[1]))
        with contextlib.closing(link):
            link.allow_sending()
            first, _ = server.accept()
            first.settimeout(30)
            assert link.send(b"one", 1)
            assert first.recv(99) == b"one"
            while link.send(FRAMES[0], 1):
                pass
            first.close()
            gone(link)
            assert link.send(b"lost", 1)
            second, _ = server.accept()
            second.settimeout(30)
            wait_until(link.has_returned)
            assert link.send(b"two", 1)
            with second:
                assert second.recv(99) == b"two"


@pytest.mark.slow
def test_a_tcp_server_sends_to_the_client_that_is_there() -> None:
    """Before one comes, and between two, there is nobody."""
    port = free_port(socket.SOCK_STREAM)
    with contextlib.closing(open_link(NetworkUri("tcpin", "127.0.0.1", port))) as link:
        link.allow_sending()
        assert link.send(b"nobody", 1)
        with socket.create_connection(("127.0.0.1", port), 5) as client:
            client.sendall(b"one")
            assert drained(link) == [b"one"]
            assert link.send(b"to one", 1)
            assert client.recv(99) == b"to one"
            while link.send(FRAMES[0], 1):
                pass
        gone(link)
        assert link.send(b"nobody", 1)
        with socket.create_connection(("127.0.0.1", port), 5) as client:
            wait_until(link.has_returned)
            assert link.send(b"to two", 1)
            assert client.recv(99) == b"to two"


def test_a_serial_link_that_returns_may_still_send(tmp_path: Path) -> None:
    """While it is unplugged nothing is written, to no descriptor at all."""
    device = tmp_path / "ttyACM0"

    def plugged() -> tuple[int, int]:
        master, slave = pty.openpty()
        tty.setraw(master)
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(slave))
        return master, slave

    one = plugged()
    with contextlib.closing(open_link(parse_uri(str(device)))) as link:
        link.allow_sending()
        assert link.send(b"one", 1)
        assert os.read(one[0], 99) == b"one"
        device.unlink()
        for descriptor in one:
            os.close(descriptor)
        gone(link)
        assert link.send(b"lost", 1)
        other = plugged()
        wait_until(link.has_returned)
        assert link.send(b"two", 1)
        assert os.read(other[0], 99) == b"two"
    for descriptor in other:
        os.close(descriptor)


@pytest.mark.parametrize("batched", [True, False])
@pytest.mark.skipif(not multicast_works(), reason="no multicast here")
def test_a_group_is_sent_to(batched: bool) -> None:
    """Where a vehicle was heard; what was sent is not heard here, and what comes around it is whole."""
    port = free_port()
    link = open_link(parse_uri(f"mcast:{GROUP}:{port}"))
    with contextlib.closing(link), contextlib.closing(Group(port)) as vehicle:
        link.allow_sending()
        assert isinstance(link, DatagramLink)
        if not batched:
            link._reader = None
        assert link.send(b"nobody was heard yet", 0)
        vehicle.send(FRAMES[0])
        assert drained(link) == FRAMES[:1]
        for frame in FRAMES[1:6]:
            assert link.send(b"command", 0)
            vehicle.send(frame)
            assert link.send(b"another", 0)
        came: list[bytes] = []
        while len(came) < 5:
            came += drained(link)
        assert came == FRAMES[1:6]
        assert not len(link.drain())
        assert [*vehicle.received()] == [b"command", b"another"] * 5
        link.wait(0.0)
        assert link.send(b"lost", 0)
        wait_until(link.has_returned)
        assert link.send(b"again", 0)
        assert [*vehicle.received()] == [b"again"]


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6 here")
@pytest.mark.parametrize("kind", ["udpout", "udpin"])
def test_ipv6_is_answered(kind: str) -> None:
    """A vehicle at an IPv6 address is reached by both kinds of UDP."""
    vehicle = socket.socket(socket.AF_INET6, socket.SOCK_DGRAM)
    with vehicle:
        vehicle.settimeout(30)
        try:
            vehicle.bind(("::1", 0))
        except OSError as error:
            pytest.skip(f"no IPv6 here: {error}")
        port = vehicle.getsockname()[1] if kind == "udpout" else free_port()
        with contextlib.closing(open_link(parse_uri(f"{kind}:[::1]:{port}", may_send=True))) as link:
            link.allow_sending()
            if kind == "udpin":
                vehicle.sendto(FRAMES[0], ("::1", port))
                assert drained(link) == FRAMES[:1]
            assert link.send(b"here", 0)
            data, address = vehicle.recvfrom(99)
            assert data == b"here"
            vehicle.sendto(FRAMES[1], address)
            assert drained(link) == FRAMES[1:2]
