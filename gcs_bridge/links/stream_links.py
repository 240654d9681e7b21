"""Links without borders: TCP connections, servers that wait for one, serial devices."""

from __future__ import annotations

import os
import select
import socket
from typing import TYPE_CHECKING, Any

from gcs_bridge.chunks import Framing
from gcs_bridge.links.link import BATCH_BYTES, Link

if TYPE_CHECKING:  # loaded when a device is opened
    from serial import Serial

__all__ = ["SerialLink", "StreamLink", "TcpLink", "TcpServerLink", "keep_alive"]
# After so many seconds of silence, each so many seconds, so many times in vain: a connection without another side ends
# some ten seconds after its last byte. macOS calls the first by its second name.
_KEEP_ALIVE = {("TCP_KEEPIDLE", "TCP_KEEPALIVE"): 5, ("TCP_KEEPINTVL",): 2, ("TCP_KEEPCNT",): 3}
_USUAL_BAUD = (57600, 115200, 921600, 230400, 460800, 500000, 38400, 9600)  # telemetry radios first


class StreamLink(Link):
    """A link without borders."""

    framing = Framing.STREAM

    def _begin(self, port: Any) -> None:
        """Nothing waits to be sent: what is left of a frame is nothing for who is there now."""
        super()._begin(port)
        self._unsent = b""  # the rest of a frame that was taken in part

    def _send(self, frame: bytes, system: int) -> bool:  # noqa: ARG002  # there is one other end
        """To whoever is at the other end; not where it takes nothing now: a late command is worse than none."""
        try:
            while self._unsent:
                self._unsent = self._unsent[self._write(self._unsent) :]
            self._unsent = frame[self._write(frame) :]
        except OSError:  # it takes nothing now, or has ended: then `drain` will tell
            return False
        return True

    def _write(self, data: bytes) -> int:
        """Hand over what is taken without waiting, in bytes. BlockingIOError: nothing is."""
        raise NotImplementedError


class TcpLink(StreamLink):
    """`tcp:`, connected."""

    _port: socket.socket

    def _fetch(self) -> bool:
        return self._receive(self._port)

    def _receive(self, connection: socket.socket) -> bool:
        size = connection.recv_into(self._room()[:BATCH_BYTES])
        if not size:
            raise ConnectionError("the other side has closed the connection")
        self._add(size)
        return False  # what has come meanwhile is the next batch's

    def _write(self, data: bytes) -> int:
        return self._port.send(data)


class TcpServerLink(TcpLink):
    """`tcpin:`, to which one client at a time connects; another one waits, with what it sends, until that has gone."""

    _client: socket.socket | None = None

    def fileno(self) -> int | None:
        """The client's, while there is one."""
        return (self._client or self._port).fileno()

    def close(self) -> None:
        """Let the client go, and give the port back."""
        self._dismiss()
        super().close()

    def wait(self, delay_s: float) -> None:  # noqa: ARG002  # who listens has nothing to try again
        """The client has gone: wait for another, and go on listening."""
        self._dismiss()

    def has_returned(self) -> bool:
        """Whether another client has come."""
        return self._accept()

    def _dismiss(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
            self._unsent = b""  # of a frame that began for who has gone

    def _accept(self) -> bool:
        """Take a client who has come; whether one had."""
        try:
            client, _ = self._port.accept()
        except OSError:  # none, or one that has gone already
            return False
        keep_alive(client)
        client.setblocking(False)
        self._client = client
        return True

    def _fetch(self) -> bool:
        if self._client is None and not self._accept():
            return False
        assert self._client is not None
        return self._receive(self._client)

    @property
    def _is_there(self) -> bool:
        return self._client is not None

    def _write(self, data: bytes) -> int:
        assert self._client is not None
        return self._client.send(data)


class SerialLink(StreamLink):
    """A serial device."""

    _port: Serial

    @property
    def unreadable(self) -> str:
        """The speed is wrong, most likely: that makes noise of frames."""
        others = [str(rate) for rate in _USUAL_BAUD if rate != self._port.baudrate]
        return (
            f"bytes come, but no MAVLink frame: the device is read at --baud {self._port.baudrate}, and sends at "
            f"another speed, it seems; try --baud {', '.join(others[:-1])} or {others[-1]}"
        )

    def fileno(self) -> int | None:
        """None on Windows, which has no descriptors for serial ports."""
        return super().fileno() if os.name == "posix" else None

    def _fetch(self) -> bool:
        descriptor = self.fileno()
        if descriptor is None:
            size = self._port.readinto(self._room()[: self._port.in_waiting]) or 0
        elif not select.select([descriptor], [], [], 0)[0]:
            return False
        elif not (size := os.readv(descriptor, [self._room()])):
            # A terminal that has nothing is not readable; one that has gone always is.
            raise ConnectionError("the device has gone")
        if size:
            self._add(size)
        return size > 0

    def _write(self, data: bytes) -> int:
        descriptor = self.fileno()
        if descriptor is None:
            return int(self._port.write(data) or 0)
        return os.write(descriptor, data)


def keep_alive(connection: socket.socket) -> None:
    """Have the system ask whether the other side is there: a cable that was pulled ends no connection by itself.

    It asks with empty packets; no byte of ours is in them.
    """
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for names, seconds in _KEEP_ALIVE.items():
        for name in names:
            if hasattr(socket, name):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), seconds)
