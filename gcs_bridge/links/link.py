"""Live links: sockets and serial ports that are read, and written to only if somebody calls `send`.

A link is drained: one call takes everything that has arrived. The batch is one message where the link is quiet, and
grows under load. Datagrams keep their borders; a stream is cut wherever it was cut on the way. A link that has gone is
waited for.
"""

from __future__ import annotations

import contextlib
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar

import numpy as np

from gcs_bridge.chunks import Chunk, Chunks, Framing
from gcs_bridge.links.datagrams import AT_ONCE, DatagramReader, address_of
from gcs_bridge.links.reopening import Reopening
from gcs_bridge.links.senders import Senders
from gcs_bridge.links.wall_clock import now_us

__all__ = ["DatagramLink", "Link", "LinkDownError", "MulticastLink", "SpeakingLink"]
_LARGEST = 65_536  # a datagram
# Bounds what one drain takes, so that a flood cannot keep the loop from the clock, and from other links.
BATCH_BYTES, _BATCH_CHUNKS = 2**20, 4096
_RECEIVE_BUFFER = 16 * 2**20  # asked for: some tenths of a second at the highest rates; the system may give less
_SO_RCVBUFFORCE = 33  # of Linux's asm-generic/socket.h: beyond the system's limit, for who may


class LinkDownError(Exception):
    """The link has ended; the text tells why."""


class Link:
    """What all links share; made by `gcs_bridge.links.open.open_link`. Iterating one gives what has come by now."""

    framing: ClassVar[Framing]
    tells_arrival: bool = False
    """Whether the system says when each chunk arrived: one that is fetched late has the same time as at once."""

    def __init__(self, name: str, open_port: Callable[[], Any]) -> None:
        """Open the port, now and whenever it has gone; `name` is the link's URI."""
        self.name = name
        self.dropped = 0  # datagrams that the system dropped because they were not fetched in time
        self._open_port = open_port
        self._reopening: Reopening | None = None
        self._may_send = False  # whatever becomes of the port
        self._data = np.empty(BATCH_BYTES + AT_ONCE * _LARGEST, np.uint8)  # memory is taken where it is written to
        self._ends = np.empty(_BATCH_CHUNKS + AT_ONCE, np.int64)
        self._t_rx_us = np.empty(_BATCH_CHUNKS + AT_ONCE, np.int64)
        self._count = 0
        self._begin(open_port())

    def _begin(self, port: Any) -> None:
        """The port is open, for the first time or anew."""
        self._port = port

    @property
    def unreadable(self) -> str:
        """What it may be where bytes come and no frame is found in them, and what to do."""
        return "bytes come, but no MAVLink frame: something else sends here, or in a dialect that --dialect names"

    def fileno(self) -> int | None:
        """The descriptor to wait on; None where the system has none, and the link must be asked from time to time.

        Of a link that has gone it can be read when that `has_returned`.
        """
        return int((self._reopening or self._port).fileno())

    def __iter__(self) -> Iterator[Chunk]:
        return iter(self.drain())

    def drain(self) -> Chunks:
        """Everything that has arrived and was not fetched yet, without waiting; empty if nothing has.

        Valid until the next call. Raises LinkDownError when the link has ended and all that came before its end was
        fetched.
        """
        self._count = 0
        try:
            while self._fetch() and self._count < _BATCH_CHUNKS and self._size < BATCH_BYTES:
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
        self._may_send = True

    def send(self, frame: bytes, system: int) -> bool:
        """Send a whole frame towards a system (0: all of them) without waiting; False where it was not taken.

        Where nobody is there, as on a link that has gone, nothing is sent, now or later: that is True, too.
        """
        assert self._may_send, "nobody has allowed it"
        return not self._is_there or self._send(frame, system)

    def close(self) -> None:
        """Give the port back; a second call does nothing."""
        self._port.close()
        if self._reopening is not None:
            self._reopening.close()
            self._reopening = None

    def wait(self, delay_s: float) -> None:
        """It has gone, by LinkDownError: wait for its return; `delay_s` before the first try."""
        self.close()
        self._reopening = Reopening(self._open_port, delay_s)

    def has_returned(self) -> bool:
        """Whether a link that had gone is there again; from then on it is drained as before."""
        port = None if self._reopening is None else self._reopening.take()
        if port is None:
            return False
        self._reopening = None
        self._begin(port)
        return True

    def why_not(self) -> str | None:
        """Why it has not returned yet, once that has lasted, and each reason once; None: nothing new."""
        return None if self._reopening is None else self._reopening.why()

    @property
    def _is_there(self) -> bool:
        """Whether there is a port that could be written to."""
        return self._reopening is None

    def _send(self, frame: bytes, system: int) -> bool:
        """As `send`; it is allowed, and the port is open."""
        raise NotImplementedError

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
    _port: socket.socket
    _senders: Senders | None = None  # kept where something may be sent to them

    def _begin(self, port: socket.socket) -> None:
        """Ask the socket for a large buffer, for times and for drops."""
        super()._begin(port)
        self.dropped = 0
        port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        if sys.platform == "linux":
            with contextlib.suppress(PermissionError):
                port.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER)
        self._reader: DatagramReader | None = None
        with contextlib.suppress(OSError):
            self._reader = DatagramReader(port)
        self.tells_arrival = self._reader is not None

    def remember_senders(self) -> None:
        """From here on who sends is remembered, also when the link has gone and returned."""
        self._senders = Senders()

    def addresses_of(self, system: int) -> list[tuple[str, int]]:
        """Host and port from which a system was heard lately; none where senders are not remembered."""
        found = () if self._senders is None else self._senders.addresses(system, now_us())
        return sorted((str(host), int(port)) for host, port, *_ in found)

    def allow_sending(self) -> None:
        """From here on something may be sent to who is remembered."""
        super().allow_sending()
        self.remember_senders()

    def _fetch(self) -> bool:
        first = self._count
        if self._reader is None:
            size, address = self._port.recvfrom_into(self._room())
            self._add(size)
            if self._senders is not None:
                self._heard(first, [address])
            return True
        self._count = self._reader.read(self._data, self._ends, self._t_rx_us, first)
        self.dropped = self._reader.dropped
        fetched = self._count - first
        if self._senders is not None:
            self._heard(first, [self._reader.sender(index) for index in range(fetched)])
        return fetched == AT_ONCE

    def _heard(self, first: int, addresses: Sequence[Any]) -> None:
        """Remember whence the datagrams from number `first` on came."""
        assert self._senders is not None
        for row, address in enumerate(addresses, first):
            self._senders.heard(self._data[self._start(row) : self._ends[row]], address, int(self._t_rx_us[row]))

    def _start(self, row: int) -> int:
        """Where a datagram's bytes begin."""
        return int(self._ends[row - 1]) if row else 0

    def _send(self, frame: bytes, system: int) -> bool:
        """To where the system was heard last."""
        assert self._senders is not None
        taken = True
        for address in self._senders.addresses(system, now_us()):
            try:
                self._port.sendto(frame, address)
            except OSError:  # its buffer is full, or the network has gone for now
                taken = False
        return taken


class SpeakingLink(DatagramLink):
    """`udpout:`, which hears nobody but the one to whom it sends; it is not made where nothing may be sent."""

    def _send(self, frame: bytes, system: int) -> bool:  # noqa: ARG002  # there is one other end
        """To the other end, whoever is there."""
        for _ in range(2):
            try:
                self._port.send(frame)
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


class MulticastLink(DatagramLink):
    """`mcast:`. What is sent goes to the group, as vehicles there listen to nothing else, and comes back: left out."""

    _own: socket.socket | None = None  # what sends: the port itself is bound to the group, and that is no sender

    def __init__(self, name: str, open_port: Callable[[], Any]) -> None:
        """Send nothing yet."""
        self._own_addresses: set[tuple[Any, ...]] = set()
        super().__init__(name, open_port)

    def _begin(self, port: socket.socket) -> None:
        """Where something may be sent, with a socket for it."""
        super()._begin(port)
        if self._may_send:
            self._open_own()

    def allow_sending(self) -> None:
        """Open the socket that sends."""
        super().allow_sending()
        self._open_own()

    def close(self) -> None:
        """Give both sockets back."""
        super().close()
        if self._own is not None:
            self._own.close()
            self._own = None

    def _open_own(self) -> None:
        self._own_addresses.clear()
        self._own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._own.setblocking(False)
        self._own.bind(("", 0))

    def _send(self, frame: bytes, system: int) -> bool:
        """To the group, at each network interface behind which the system was heard last."""
        assert self._senders is not None
        assert self._own is not None
        _, group, port = self.name.split(":")
        try:
            for local in {_local_address(address) for address in self._senders.addresses(system, now_us())}:
                self._own_addresses.add((local, self._own.getsockname()[1]))
                self._own.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(local))
                self._own.sendto(frame, (group, int(port)))
        except OSError:  # its buffer is full, or the network has gone for now
            return False
        return True

    def _heard(self, first: int, addresses: Sequence[Any]) -> None:
        """Without what was sent from here."""
        others = []
        for row, address in reversed([*enumerate(addresses, first)]):
            if (address_of(address) if isinstance(address, bytes) else address) in self._own_addresses:
                self._leave_out(row)
            else:
                others.append(address)
        super()._heard(first, others[::-1])

    def _leave_out(self, row: int) -> None:
        """Forget a datagram that was fetched."""
        start, end, size = self._start(row), int(self._ends[row]), self._size
        self._data[start : size - (end - start)] = self._data[end:size].copy()
        last = self._count - 1
        self._ends[row:last] = self._ends[row + 1 : self._count] - (end - start)
        self._t_rx_us[row:last] = self._t_rx_us[row + 1 : self._count].copy()
        self._count = last


def _local_address(towards: tuple[Any, ...]) -> str:
    """This machine's own address on the way to another one. OSError where there is no way."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(towards)  # sends nothing
        address: str = probe.getsockname()[0]
        return address
