"""Live links: opened by pymavlink's connections, read by us from the descriptor, never written to.

A link is drained: one call takes everything that has arrived. The batch is one message where the link is quiet, and
grows under load. Datagrams keep their borders; of a stream one chunk comes, cut wherever it was cut on the way.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import sys
import time
from collections.abc import Iterator
from typing import Any, ClassVar

from gcs_bridge.chunks import Chunk, Framing

__all__ = ["DatagramLink", "Link", "LinkDownError", "SerialLink", "StreamLink", "TcpLink", "now_us"]
_READ = 65536  # the largest datagram, and a serial link's worth of some seconds
_BATCH_BYTES = 2**20  # bounds what one drain takes, so that a flood cannot keep the loop from the clock
_RECEIVE_BUFFER = 4 * 2**20  # asked for; the system may give less
# Numbers of Linux's asm-generic/socket.h that Python does not name: when each datagram arrived, and how many did not
# fit into the buffer since the socket was opened.
_SO_TIMESTAMPNS, _SO_RXQ_OVFL = 35, 40


class LinkDownError(Exception):
    """The link has ended; the text tells why."""


class Link:
    """What all links share; made by `gcs_bridge.links.open.open_link`. Iterating one gives what has come by now."""

    framing: ClassVar[Framing]

    def __init__(self, name: str, connection: Any) -> None:
        """Take one of pymavlink's connections; `name` is its URI."""
        self.name = name
        self.dropped = 0  # datagrams that the system dropped because they were not fetched in time
        self._connection = connection

    def fileno(self) -> int | None:
        """The descriptor to wait on; None where the system has none, and the link must be asked from time to time."""
        return int(self._connection.port.fileno())

    def __iter__(self) -> Iterator[Chunk]:
        return iter(self.drain())

    def drain(self) -> list[Chunk]:
        """Everything that has arrived and was not fetched yet, without waiting; empty if nothing has.

        Raises LinkDownError when the link has ended and all that came before its end was fetched.
        """
        chunks: list[Chunk] = []
        taken = 0
        while taken < _BATCH_BYTES:
            try:
                chunk = self._read()
            except BlockingIOError:
                break
            except OSError as error:
                if chunks:
                    break  # it will be found again by the next call
                raise LinkDownError(error.strerror or str(error)) from None
            except LinkDownError:
                if chunks:
                    break
                raise
            if chunk is None:
                break
            chunks.append(chunk)
            taken += len(chunk.data)
        return chunks

    def close(self) -> None:
        """Give the port back."""
        self._connection.close()

    def _read(self) -> Chunk | None:
        """The next chunk; None or BlockingIOError if there is none now."""
        raise NotImplementedError


class DatagramLink(Link):
    """`udpin:`. On Linux each datagram brings the time at which it arrived, and drops are counted."""

    framing = Framing.DATAGRAM

    def __init__(self, name: str, connection: Any) -> None:
        """Ask the socket for a large buffer, for times and for drops."""
        super().__init__(name, connection)
        self._socket: socket.socket = connection.port
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        # pymavlink binds with SO_REUSEADDR; taken back, so that nobody else can bind the port and take the datagrams.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
        self._ancillary = 0
        if sys.platform == "linux":
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            self._ancillary = socket.CMSG_SPACE(struct.calcsize("@ll")) + socket.CMSG_SPACE(4)

    def _read(self) -> Chunk:
        if not self._ancillary:
            return Chunk(self._socket.recv(_READ), now_us(), self.framing)
        data, ancillary, _, _ = self._socket.recvmsg(_READ, self._ancillary)
        t_rx_us = -1
        for _, kind, value in ancillary:
            if kind == _SO_TIMESTAMPNS and len(value) == struct.calcsize("@ll"):
                seconds, nanoseconds = struct.unpack("@ll", value)
                t_rx_us = seconds * 1_000_000 + nanoseconds // 1000
            elif kind == _SO_RXQ_OVFL:
                (self.dropped,) = struct.unpack("@I", value)
        return Chunk(data, t_rx_us if t_rx_us > 0 else now_us(), self.framing)


class StreamLink(Link):
    """A link without borders: all that has arrived is one chunk, received when its last bytes were fetched."""

    framing = Framing.STREAM

    def drain(self) -> list[Chunk]:
        """As every link's; one chunk at most."""
        chunks = super().drain()
        if len(chunks) < 2:
            return chunks
        return [Chunk(b"".join(chunk.data for chunk in chunks), chunks[-1].t_rx_us, self.framing)]


class TcpLink(StreamLink):
    """`tcp:`, connected."""

    def _read(self) -> Chunk:
        data = self._connection.port.recv(_READ)
        if not data:
            raise LinkDownError("the other side has closed the connection")
        return Chunk(data, now_us(), self.framing)


class SerialLink(StreamLink):
    """A serial device."""

    def fileno(self) -> int | None:
        """None on Windows, which has no descriptors for serial ports."""
        return None if self._connection.fd is None else int(self._connection.fd)

    def _read(self) -> Chunk | None:
        descriptor = self.fileno()
        if descriptor is None:
            port = self._connection.port
            data = port.read(port.in_waiting)
            return Chunk(data, now_us(), self.framing) if data else None
        readable = bool(select.select([descriptor], [], [], 0)[0])
        data = os.read(descriptor, _READ) if readable else b""
        if readable and not data:  # a terminal that has nothing is not readable; one that has gone always is
            raise LinkDownError("the device has gone")
        return Chunk(data, now_us(), self.framing) if data else None


def now_us() -> int:
    """The wall clock, µs since 1970."""
    return time.time_ns() // 1000
