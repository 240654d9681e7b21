"""`Autopilot`s that fly in real time at the other end of a link, and ground stations that listen to a relay."""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator

from pymavlink.dialects.v20 import common as mavlink

from tests.helpers.autopilot import Autopilot


@contextlib.contextmanager
def flying(vehicle: Autopilot, send: Callable[[bytes], object], receive: Callable[[], bytes]) -> Iterator[None]:
    """The vehicle sends and receives while the block runs; `receive` gives what has come, b"" where nothing has."""
    ended = threading.Event()

    def fly() -> None:
        began_s = time.monotonic()
        while not ended.wait(0.005):
            with contextlib.suppress(ConnectionError):
                while data := receive():
                    vehicle.take(data)
                for frame in vehicle.due(time.monotonic() - began_s):
                    send(frame)

    thread = threading.Thread(target=fly, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextlib.contextmanager
def udp_vehicle(vehicle: Autopilot, port: int) -> Iterator[None]:
    """It sends to a UDP port of this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.connect(("127.0.0.1", port))
        own.setblocking(False)
        with flying(vehicle, own.send, lambda: _received(own)):
            yield


@contextlib.contextmanager
def udp_server_vehicle(vehicle: Autopilot) -> Iterator[int]:
    """It waits on a UDP port, and sends to whoever has sent to it; gives the port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        own.setblocking(False)
        peers: list[tuple[str, int]] = []

        def receive() -> bytes:
            with contextlib.suppress(BlockingIOError):
                data, peer = own.recvfrom(65_536)
                peers[:] = [peer]
                return data
            return b""

        with flying(vehicle, lambda frame: [own.sendto(frame, peer) for peer in peers], receive):
            yield own.getsockname()[1]


class GroundStation:
    """Listens on a UDP port to what a relay sends, and answers; `messages` are all that came, by pymavlink."""

    def __init__(self, system: int = 255) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2**22)
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]
        self.data: list[bytes] = []
        self.messages: list[mavlink.MAVLink_message] = []
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self.mav.robust_parsing = True
        self._peer: tuple[str, int] | None = None

    def __enter__(self) -> "GroundStation":
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def listen(self) -> "GroundStation":
        """Take what has come by now."""
        with contextlib.suppress(BlockingIOError):
            while True:
                data, self._peer = self.socket.recvfrom(65_536)
                self.data.append(data)
                self.messages += self.mav.parse_buffer(data) or ()
        return self

    def of(self, kind: str) -> list[mavlink.MAVLink_message]:
        """All messages of this name by now."""
        return [message for message in self.listen().messages if message.get_type() == kind]

    def send(self, frame: bytes) -> None:
        """Answer."""
        assert self._peer is not None
        self.socket.sendto(frame, self._peer)


def _received(own: socket.socket) -> bytes:
    try:
        return own.recv(65_536)
    except BlockingIOError:
        return b""
