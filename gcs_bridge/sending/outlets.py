"""Where frames are passed on to: other ground stations, by UDP or TCP, waiting for them or connecting to them.

Nobody here is waited for: what a station does not take at once is kept in a bounded queue, and what does not fit in
there is dropped and counted. What a station sends comes back from `run`; what is done with it is not known here.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from gcs_bridge.errors import SourceError
from gcs_bridge.links.uri import NetworkUri, network_uri

__all__ = ["RELAYS", "Heard", "Outlet", "open_outlet", "parse_relay", "resolved"]
_QUEUE_BYTES = 256 * 1024  # a station: some seconds at the highest rates; more would be too old to look at
_SEND_BUFFER = 256 * 1024  # of the system's own, which would grow to megabytes of old frames
_STATIONS = 16  # at most that one outlet serves at once
_FORGOTTEN_S = 60.0  # a station that sent nothing for so long is not sent to any more: ground stations send each second
_RETRY_S, _LONGEST_RETRY_S = 1.0, 30.0
_LARGEST = 65_536
_READS = 64  # at most from one socket in a turn: a flood of answers does not hold up what is listened to
_MAGIC = (0xFE, 0xFD)


class Heard(NamedTuple):
    """What a station sent: a piece of a stream, or one datagram. `station`: another one has another key."""

    station: tuple[object, ...]
    data: bytes
    datagram: bool


class Outlet:
    """One relay: all stations that its URI reaches."""

    def __init__(self, uri: NetworkUri, note: Callable[[str], None]) -> None:
        """Reach nobody yet; `note` tells people one line."""
        self.name = str(uri)
        self.dropped = 0  # frames, counted once for each station that did not get them
        self._uri = uri
        self._note = note

    def send(self, frames: Sequence[bytes]) -> None:
        """Pass whole frames on to every station, without waiting."""
        raise NotImplementedError

    def descriptors(self) -> list[int]:
        """What to wait on: readable where `run` has something to do."""
        raise NotImplementedError

    def run(self, now_s: float) -> list[Heard]:
        """Do what has become due, without waiting; what stations sent. `now_s`: of a clock that never steps."""
        raise NotImplementedError

    def close(self) -> None:
        """Give the sockets back."""
        raise NotImplementedError


class _UdpOutlet(Outlet):
    """What both kinds of UDP share: one socket, which is never waited for."""

    _socket: socket.socket

    def descriptors(self) -> list[int]:
        return [self._socket.fileno()]

    def close(self) -> None:
        self._socket.close()

    def _received(self) -> Iterator[tuple[bytes, tuple[object, ...]]]:
        for _ in range(_READS):
            try:
                data, sender = self._socket.recvfrom(_LARGEST)
            except ConnectionRefusedError:  # nobody listens there yet
                continue
            except OSError:  # nothing more, or a network that has gone for now
                return
            yield data, sender


class UdpOutlet(_UdpOutlet):
    """`udpout:`, to a station that waits there: QGroundControl as it is installed, MAVProxy's `--master udpin:`."""

    def __init__(self, uri: NetworkUri, note: Callable[[str], None]) -> None:
        """Find the host. Connected, so that nobody else can answer."""
        super().__init__(uri, note)
        family, address = resolved(uri, socket.SOCK_DGRAM)
        with _closed_on_error(socket.socket(family, socket.SOCK_DGRAM)) as self._socket:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            self._socket.connect(address)

    def send(self, frames: Sequence[bytes]) -> None:
        for frame in frames:
            try:
                self._socket.send(frame)
            except ConnectionRefusedError:  # of a datagram before, to which nobody listened: this one was not sent
                with contextlib.suppress(OSError):
                    self._socket.send(frame)
            except OSError:  # its buffer is full, or the network has gone for now
                self.dropped += 1

    def run(self, now_s: float) -> list[Heard]:  # noqa: ARG002  # it has nothing to try again later
        return [Heard((), data, datagram=True) for data, _ in self._received()]


class UdpServerOutlet(_UdpOutlet):
    """`udpin:`, for stations that speak first: MAVProxy's `--master udpout:`, QGroundControl with a server address."""

    def __init__(self, uri: NetworkUri, note: Callable[[str], None]) -> None:
        """Wait on the port, which nobody else may share."""
        super().__init__(uri, note)
        family, address = resolved(uri, socket.SOCK_DGRAM)
        with _closed_on_error(socket.socket(family, socket.SOCK_DGRAM)) as self._socket:
            self._socket.setblocking(False)
            self._socket.bind(address)
        self._heard_s: dict[tuple[object, ...], float] = {}

    def send(self, frames: Sequence[bytes]) -> None:
        for station in self._heard_s:
            for frame in frames:
                try:
                    self._socket.sendto(frame, station)
                except OSError:
                    self.dropped += 1

    def run(self, now_s: float) -> list[Heard]:
        heard: list[Heard] = []
        for data, station in self._received():
            if data and data[0] in _MAGIC and self._admitted(station, now_s):
                heard.append(Heard(station, data, datagram=True))
        for station in [one for one, at_s in self._heard_s.items() if now_s - at_s > _FORGOTTEN_S]:
            del self._heard_s[station]
        return heard

    def _admitted(self, station: tuple[object, ...], now_s: float) -> bool:
        if station not in self._heard_s and len(self._heard_s) >= _STATIONS:
            return False
        self._heard_s[station] = now_s
        return True


class _Stream:
    """A connected TCP station: what it does not take waits, whole frames at a time, the oldest going first."""

    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self._waiting: deque[bytes] = deque()
        self._bytes = 0
        self._begun = False  # the first of them has been sent in part: the rest must follow
        connection.setblocking(False)
        with contextlib.suppress(OSError):  # on a connection that is being made, or has gone
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)

    def put(self, frames: Sequence[bytes]) -> int:
        """Take frames; how many, of these or of older ones, were dropped for want of room."""
        self._waiting.extend(frames)
        self._bytes += sum(map(len, frames))
        dropped = 0
        while self._bytes > _QUEUE_BYTES and len(self._waiting) > self._begun + 1:
            self._bytes -= len(self._waiting[self._begun])
            del self._waiting[self._begun]
            dropped += 1
        return dropped

    def flush(self) -> None:
        """Send what waits, as far as it is taken. OSError where the station has gone."""
        while self._waiting:
            together: list[bytes] = []
            size = 0
            for frame in self._waiting:
                together.append(frame)
                size += len(frame)
                if size > _LARGEST:
                    break
            try:
                sent = self.socket.send(b"".join(together))
            except BlockingIOError:
                return
            self._bytes -= sent
            while sent and sent >= len(self._waiting[0]):
                sent -= len(self._waiting.popleft())
                self._begun = False
            if sent:
                self._waiting[0] = self._waiting[0][sent:]
                self._begun = True

    def received(self) -> Iterator[bytes]:
        """What has come. OSError where the station has gone."""
        for _ in range(_READS):
            try:
                data = self.socket.recv(_LARGEST)
            except BlockingIOError:
                return
            if not data:
                raise ConnectionResetError(errno.ECONNRESET, "the other side has closed the connection")
            yield data


class TcpServerOutlet(Outlet):
    """`tcpin:`, for stations that connect: MAVProxy's `--master tcp:`, a TCP link of QGroundControl."""

    def __init__(self, uri: NetworkUri, note: Callable[[str], None]) -> None:
        """Wait on the port."""
        super().__init__(uri, note)
        family, address = resolved(uri, socket.SOCK_STREAM)
        with _closed_on_error(socket.socket(family, socket.SOCK_STREAM)) as self._socket:
            if os.name == "posix":  # where it means that the port may be bound again at once, and nothing else
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.setblocking(False)
            self._socket.bind(address)
            self._socket.listen(_STATIONS)
        self._stations: dict[tuple[object, ...], _Stream] = {}

    def send(self, frames: Sequence[bytes]) -> None:
        for station, stream in list(self._stations.items()):
            self.dropped += stream.put(frames)
            self._flush(station, stream)

    def descriptors(self) -> list[int]:
        return [self._socket.fileno(), *(stream.socket.fileno() for stream in self._stations.values())]

    def run(self, now_s: float) -> list[Heard]:  # noqa: ARG002  # it has nothing to try again later
        with contextlib.suppress(OSError):
            while True:
                connection, station = self._socket.accept()
                if len(self._stations) >= _STATIONS:
                    connection.close()
                else:
                    self._stations[station] = _Stream(connection)
                    self._note(f"relay {self.name}: {station[0]} port {station[1]} has connected")
        heard: list[Heard] = []
        for station, stream in list(self._stations.items()):
            try:
                heard.extend(Heard(station, data, datagram=False) for data in stream.received())
            except OSError as error:
                self._gone(station, error)
            else:
                self._flush(station, stream)
        return heard

    def close(self) -> None:
        self._socket.close()
        for stream in self._stations.values():
            stream.socket.close()

    def _flush(self, station: tuple[object, ...], stream: _Stream) -> None:
        try:
            stream.flush()
        except OSError as error:
            self._gone(station, error)

    def _gone(self, station: tuple[object, ...], error: OSError) -> None:
        self._stations.pop(station).socket.close()
        self._note(f"relay {self.name}: {station[0]} port {station[1]} has gone: {_said(error)}")


class TcpOutlet(Outlet):
    """`tcp:`, to a station that waits there: MAVProxy's `--master tcpin:`, a router. Tried as long as it takes."""

    def __init__(self, uri: NetworkUri, note: Callable[[str], None]) -> None:
        """Find the host; the connection is made by `run`."""
        super().__init__(uri, note)
        self._family, self._address = resolved(uri, socket.SOCK_STREAM)
        self._stream: _Stream | None = None
        self._connected = False
        self._due_s = -1.0
        self._retry_s = _RETRY_S
        self._told = ""
        self._turn = 0

    def send(self, frames: Sequence[bytes]) -> None:
        if self._stream is not None and self._connected:
            self.dropped += self._stream.put(frames)
            try:
                self._stream.flush()
            except OSError as error:
                self._gone(error)

    def descriptors(self) -> list[int]:
        return [self._stream.socket.fileno()] if self._stream is not None and self._connected else []

    def run(self, now_s: float) -> list[Heard]:
        if self._stream is None:
            if now_s < self._due_s:
                return []
            self._due_s = now_s + self._retry_s
            self._retry_s = min(2 * self._retry_s, _LONGEST_RETRY_S)
            self._stream = _Stream(socket.socket(self._family, socket.SOCK_STREAM))
        heard: list[Heard] = []
        try:
            if not self._connected:
                self._connect(now_s)
            if self._connected:
                heard.extend(Heard((self._turn,), data, datagram=False) for data in self._stream.received())
                self._stream.flush()
        except OSError as error:
            self._gone(error)
        return heard

    def close(self) -> None:
        if self._stream is not None:
            self._stream.socket.close()

    def _connect(self, now_s: float) -> None:
        """Begin to connect, or see how far it has come: asked again, a connection tells how it stands."""
        assert self._stream is not None
        result = self._stream.socket.connect_ex(self._address)
        if result in (0, errno.EISCONN):
            self._connected = True
            self._turn += 1
            self._retry_s = _RETRY_S
            self._tell("connected")
        elif result not in _UNDER_WAY:
            raise OSError(result, os.strerror(result))
        elif now_s > self._due_s + _LONGEST_RETRY_S:
            raise TimeoutError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))

    def _gone(self, error: OSError) -> None:
        assert self._stream is not None
        self._stream.socket.close()
        self._stream, self._connected = None, False
        self._tell(f"{_said(error)}; trying again")

    def _tell(self, what: str) -> None:
        """Once until something else happens."""
        if what != self._told:
            self._told = what
            self._note(f"relay {self.name}: {what}")


_UNDER_WAY = {errno.EINPROGRESS, errno.EALREADY, errno.EWOULDBLOCK, errno.EINTR, getattr(errno, "WSAEINVAL", -1)}
RELAYS: dict[str, type[Outlet]] = {
    "udpout": UdpOutlet,
    "tcp": TcpOutlet,
    "tcpin": TcpServerOutlet,
    "udpin": UdpServerOutlet,
}
"""What a relay's URI may begin with."""


def parse_relay(text: str) -> NetworkUri:
    """The relay that `text` names; UsageError where it is none."""
    return network_uri(text, tuple(RELAYS), what="a relay")


def open_outlet(uri: NetworkUri, note: Callable[[str], None]) -> Outlet:
    """Open a relay; SourceError in one line where it cannot be."""
    try:
        return RELAYS[uri.kind](uri, note)
    except socket.gaierror:
        raise SourceError(f"relay {uri}: unknown host {uri.host!r}") from None
    except OSError as error:
        hint = f": end the program that has port {uri.port}" if error.errno == errno.EADDRINUSE else ""
        raise SourceError(f"relay {uri}: {_said(error)}{hint}") from None


@contextlib.contextmanager
def _closed_on_error(opened: socket.socket) -> Iterator[socket.socket]:
    try:
        yield opened
    except OSError:
        opened.close()
        raise


def resolved(uri: NetworkUri, kind: int) -> tuple[socket.AddressFamily, tuple[object, ...]]:
    """Family and address of a URI, for sockets of this kind."""
    family, _, _, _, address = socket.getaddrinfo(uri.host, uri.port, type=kind)[0]
    return family, address


def _said(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
