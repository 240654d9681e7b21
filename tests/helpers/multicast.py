"""A vehicle in a multicast group of this machine alone."""

import contextlib
import functools
import socket
from collections.abc import Iterator

from tests.helpers.live_links import free_port

GROUP = "239.255.145.51"
_LOOPBACK = socket.inet_aton("127.0.0.1")


class Group:
    """Sends to the group, and receives what others send to it, or to where it sends from."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, _LOOPBACK)
        self._sender.bind(("", 0))
        self._member = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._member.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._member.bind((GROUP, port))
        self._member.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + _LOOPBACK)
        for one in (self._sender, self._member):
            one.setblocking(False)

    def send(self, data: bytes) -> None:
        self._sender.sendto(data, (GROUP, self.port))

    def received(self) -> Iterator[bytes]:
        """What has come by now, but for what this one has sent."""
        own_port = self._sender.getsockname()[1]
        for one in (self._sender, self._member):
            with contextlib.suppress(BlockingIOError):
                while True:
                    data, (_, port) = one.recvfrom(65_536)
                    if port != own_port:
                        yield data

    def close(self) -> None:
        self._sender.close()
        self._member.close()


@functools.cache
def multicast_works() -> bool:
    """Whether this machine's own network takes part in multicast."""
    try:
        group = Group(free_port())
    except OSError:
        return False
    with contextlib.closing(group):
        group.send(b"x")
        try:
            return group._member.recv(1) == b"x"
        except BlockingIOError:
            return False
