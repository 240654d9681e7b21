"""Live links: opened by pymavlink's connections, read and written to by us; written to only if somebody calls `send`.

A link is drained: one call takes everything that has arrived. The batch is one message where the link is quiet, and
grows under load. Datagrams keep their borders; a stream is cut wherever it was cut on the way.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import time
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from gcs_bridge.chunks import Chunk, Chunks, Framing
from gcs_bridge.links.datagrams import AT_ONCE, DatagramReader
from gcs_bridge.links.senders import Senders

__all__ = ["DatagramLink", "Link", "LinkDownError", "SerialLink", "SpeakingLink", "StreamLink", "TcpLink", "now_us"]
_LARGEST = 65_536  # a datagram
# Bounds what one drain takes, so that a flood cannot keep the loop from the clock, and from other links.
_BATCH_BYTES, _BATCH_CHUNKS = 2**20, 4096
_RECEIVE_BUFFER = 16 * 2**20  # asked for: some tenths of a second at the highest rates; the system may give less
_SO_RCVBUFFORCE = 33  # of Linux's asm-generic/socket.h: beyond the system's limit, for who may


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
        self._data = np.empty(_BATCH_BYTES + AT_ONCE * _LARGEST, np.uint8)  # memory is taken where it is written to
        self._ends = np.empty(_BATCH_CHUNKS + AT_ONCE, np.int64)
        self._t_rx_us = np.empty(_BATCH_CHUNKS + AT_ONCE, np.int64)
        self._count = 0

    def fileno(self) -> int | None:
        """The descriptor to wait on; None where the system has none, and the link must be asked from time to time."""
        return int(self._connection.port.fileno())

    def __iter__(self) -> Iterator[Chunk]:
        return iter(self.drain())

    def drain(self) -> Chunks:
        """Everything that has arrived and was not fetched yet, without waiting; empty if nothing has.

        Valid until the next call. Raises LinkDownError when the link has ended and all that came before its end was
        fetched.
        """
        self._count = 0
        try:
            while self._fetch() and self._count < _BATCH_CHUNKS and self._size < _BATCH_BYTES:
                pass
        except BlockingIOError:
            pass
        except OSError as error:
            if not self._count:  # else it will be found again by the next call
                raise LinkDownError(error.strerror or str(error)) from None
        count = self._count
        return Chunks(self._data[: self._size], self._ends[:count], self._t_rx_us[:count], self.framing)

    def allow_sending(self) -> None:
        """The user has asked for something that transmits: from here on `send` may be called."""
        raise NotImplementedError

    def send(self, frame: bytes, system: int) -> bool:
        """Send a whole frame towards a system (0: all of them) without waiting; whether it was taken."""
        raise NotImplementedError

    def close(self) -> None:
        """Give the port back."""
        self._connection.close()

    @property
    def _size(self) -> int:
        """Of all chunks that were fetched, in bytes."""
        return int(self._ends[self._count - 1]) if self._count else 0

    def _fetch(self) -> bool:
        """Fetch more; whether there may be still more. BlockingIOError: there is none. OSError: the link has ended."""
        raise NotImplementedError

    def _room(self) -> memoryview:
        """Where the next chunk's bytes belong."""
        return self._data.data[self._size :]

    def _add(self, size: int) -> None:
        """Note that the next chunk's bytes are there, received now."""
        self._ends[self._count] = self._size + size
        self._t_rx_us[self._count] = now_us()
        self._count += 1


class DatagramLink(Link):
    """`udpin:`. On Linux each datagram brings the time at which it arrived, and drops are counted."""

    framing = Framing.DATAGRAM

    def __init__(self, name: str, connection: Any) -> None:
        """Ask the socket for a large buffer, for times and for drops."""
        super().__init__(name, connection)
        self._socket: socket.socket = connection.port
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        if sys.platform == "linux":
            with contextlib.suppress(PermissionError):
                self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER)
        # pymavlink binds with SO_REUSEADDR; taken back, so that nobody else can bind the port and take the datagrams.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
        self._senders: Senders | None = None  # kept where something may be sent to them
        self._reader: DatagramReader | None = None
        with contextlib.suppress(OSError):
            self._reader = DatagramReader(self._socket)

    def _fetch(self) -> bool:
        if self._reader is None:
            at = self._size
            size, address = self._socket.recvfrom_into(self._room())
            if self._senders is not None:
                self._senders.heard(self._data[at : at + size], address, now_us())
            self._add(size)
            return True
        before, self._count = self._count, self._reader.read(self._data, self._ends, self._t_rx_us, self._count)
        self.dropped = self._reader.dropped
        if self._senders is not None:
            for row in range(before, self._count):
                datagram = self._data[self._ends[row - 1] if row else 0 : self._ends[row]]
                self._senders.heard(datagram, self._reader.sender(row - before), int(self._t_rx_us[row]))
        return self._count == before + AT_ONCE

    def allow_sending(self) -> None:
        """From here on who sends is remembered."""
        self._senders = Senders()

    def send(self, frame: bytes, system: int) -> bool:
        """Send to where the system was heard last. Taken, too, where nobody was heard yet: there is nobody."""
        assert self._senders is not None, "nobody has allowed it"
        taken = True
        for address in self._senders.addresses(system, now_us()):
            try:
                self._socket.sendto(frame, address)
            except OSError:  # its buffer is full, or the network has gone for now
                taken = False
        return taken


class SpeakingLink(DatagramLink):
    """`udpout:`, which hears nobody but the one to whom it sends; it is not made where nothing may be sent."""

    def __init__(self, name: str, connection: Any, to: tuple[Any, ...]) -> None:
        """Take `to` for the other end of the socket."""
        super().__init__(name, connection)
        self._socket.connect(to)

    def allow_sending(self) -> None:
        """It always is: there is one to send to, and nothing to remember."""

    def send(self, frame: bytes, system: int) -> bool:  # noqa: ARG002
        """Send to the other end, whoever is there."""
        for _ in range(2):
            try:
                self._socket.send(frame)
                return True
            except ConnectionRefusedError:  # of what was sent before, when nobody listened: this was not sent
                continue
            except OSError:
                return False
        return False

    def _fetch(self) -> bool:
        try:
            return super()._fetch()
        except ConnectionRefusedError:  # nobody listens there yet, or for now
            return True


class StreamLink(Link):
    """A link without borders."""

    framing = Framing.STREAM

    def __init__(self, name: str, connection: Any) -> None:
        """Nothing waits to be sent."""
        super().__init__(name, connection)
        self._unsent = b""  # the rest of a frame that was taken in part
        self._may_send = False

    def allow_sending(self) -> None:
        """From here on `send` does."""
        self._may_send = True

    def send(self, frame: bytes, system: int) -> bool:  # noqa: ARG002
        """Send to whoever is at the other end; not where it takes nothing now: a late command is worse than none."""
        assert self._may_send, "nobody has allowed it"
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

    def _fetch(self) -> bool:
        size: int = self._connection.port.recv_into(self._room()[:_BATCH_BYTES])
        if not size:
            raise ConnectionError("the other side has closed the connection")
        self._add(size)
        return False  # what has come meanwhile is the next batch's

    def _write(self, data: bytes) -> int:
        sent: int = self._connection.port.send(data)
        return sent


class SerialLink(StreamLink):
    """A serial device."""

    def fileno(self) -> int | None:
        """None on Windows, which has no descriptors for serial ports."""
        return None if self._connection.fd is None else int(self._connection.fd)

    def _fetch(self) -> bool:
        descriptor = self.fileno()
        size: int
        if descriptor is None:
            port = self._connection.port
            size = port.readinto(self._room()[: port.in_waiting])
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
            return int(self._connection.port.write(data))
        return os.write(descriptor, data)


def now_us() -> int:
    """The wall clock, µs since 1970."""
    return time.time_ns() // 1000
