"""Opening a link, so that nothing of it is shared with others who would take its bytes away."""

from __future__ import annotations

import errno
import os
import socket
import struct
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from gcs_bridge.errors import SourceError
from gcs_bridge.links.link import DatagramLink, Link, MulticastLink, SpeakingLink
from gcs_bridge.links.port_owner import device_owner, is_running, port_owner
from gcs_bridge.links.stream_links import SerialLink, TcpLink, TcpServerLink, keep_alive
from gcs_bridge.links.uri import NetworkUri, SerialUri, Uri

if TYPE_CHECKING:  # loaded when a device is opened
    from serial import Serial

__all__ = ["MODEM_MANAGER", "OPENERS", "LinkRefusedError", "device_group", "open_link", "serial_devices"]
_PATIENCE_S = 5.0  # to connect; the system would try for two minutes
_SERIAL_NAMES = ("tty", "cu.", "rfcomm")  # of real ports; of a pair of terminals somebody else holds the other end


class LinkRefusedError(SourceError):
    """A link that cannot be opened: `code` is a name of why, `command` what to type next, if that is known."""

    def __init__(self, message: str, code: str, command: str | None) -> None:
        """In one line, with what to do next."""
        super().__init__(message)
        self.code = code
        self.command = command


def open_link(uri: Uri) -> Link:
    """Open the link; LinkRefusedError where it cannot be."""
    kind, open_port = OPENERS[uri.kind]

    def opened() -> Any:
        try:
            return open_port(uri)
        except (OSError, ValueError, OverflowError) as error:  # pyserial's own errors are OSErrors
            reason = _reason(uri, error)
            raise LinkRefusedError(f"{uri}: {reason.text}", reason.code, reason.command) from None

    return kind(str(uri), opened)


def _open_udpin(uri: Uri) -> socket.socket:
    assert isinstance(uri, NetworkUri)
    port = _bound(uri, socket.SOCK_DGRAM)
    port.setblocking(False)
    return port


def _open_mcast(uri: Uri) -> socket.socket:
    assert isinstance(uri, NetworkUri)
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # each who listens to a group gets all of it
        port.bind((uri.host if sys.platform != "win32" else "", uri.port))
        _join(port, socket.inet_aton(uri.host))
    except OSError:
        port.close()
        raise
    port.setblocking(False)
    return port


def _open_udpout(uri: Uri) -> socket.socket:
    """Whoever is there learns of us by what we send. Parsed only where that is allowed."""
    assert isinstance(uri, NetworkUri)
    family, *_, address = _preferred(socket.getaddrinfo(uri.host, uri.port, type=socket.SOCK_DGRAM))
    port = socket.socket(family, socket.SOCK_DGRAM)
    port.setblocking(False)
    try:
        port.connect(address)  # so that nobody else is heard
    except OSError:
        port.close()
        raise
    return port


def _open_tcp(uri: Uri) -> socket.socket:
    assert isinstance(uri, NetworkUri)
    port = socket.create_connection((uri.host, uri.port), timeout=_PATIENCE_S)
    if port.getsockname() == port.getpeername():  # tried often, a free port of this machine connects to itself
        port.close()
        raise ConnectionRefusedError(errno.ECONNREFUSED, os.strerror(errno.ECONNREFUSED))
    keep_alive(port)
    port.setblocking(False)
    return port


def _open_tcpin(uri: Uri) -> socket.socket:
    assert isinstance(uri, NetworkUri)
    port = _bound(uri, socket.SOCK_STREAM)
    port.listen(1)
    port.setblocking(False)
    return port


def _open_serial(uri: Uri) -> Serial:
    assert isinstance(uri, SerialUri)
    from serial import Serial

    if Path(os.path.realpath(uri.device)).name.startswith(_SERIAL_NAMES) and device_owner(uri.device):
        raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))  # two readers would have half of the bytes each
    return Serial(uri.device, uri.baud, timeout=0, write_timeout=0, exclusive=True)


# The kinds of link, and what opens the port of each; what they are called is in `links.uri`.
OPENERS: dict[str, tuple[type[Link], Callable[[Uri], Any]]] = {
    "udpin": (DatagramLink, _open_udpin),
    "udpout": (SpeakingLink, _open_udpout),
    "mcast": (MulticastLink, _open_mcast),
    "tcp": (TcpLink, _open_tcp),
    "tcpin": (TcpServerLink, _open_tcpin),
    "serial": (SerialLink, _open_serial),
}


_Found = tuple[socket.AddressFamily, socket.SocketKind, int, str, Any]  # what getaddrinfo gives


def _preferred(found: Sequence[_Found]) -> _Found:
    """A name that stands for both is taken for what it was before there was IPv6: vehicles send to that."""
    return min(found, key=lambda one: one[0] != socket.AF_INET)


def _bound(uri: NetworkUri, kind: socket.SocketKind) -> socket.socket:
    """A socket at the URI's address that nobody else can bind, too."""
    found = socket.getaddrinfo(uri.host, uri.port, type=kind, flags=socket.AI_PASSIVE)
    family, *_, address = _preferred(found)
    port = socket.socket(family, kind)
    try:
        if family == socket.AF_INET6:
            port.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)  # [::] takes IPv4 as well
        if kind == socket.SOCK_STREAM and os.name == "posix":  # else the port cools down for a minute behind a client
            port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if sys.platform == "win32":  # where any other program could take it away
            port.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        port.bind(address)
    except OSError:
        port.close()
        raise
    return port


def _join(port: socket.socket, group: bytes) -> None:
    """Ask for a group's datagrams at every interface that can; OSError where none can."""
    if sys.platform == "win32":  # asks where its routes say
        port.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group + bytes(4))
        return
    refused: OSError | None = OSError(errno.ENODEV, os.strerror(errno.ENODEV))
    for index, _ in socket.if_nameindex():
        try:
            port.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, struct.pack("4s4si", group, bytes(4), index))
        except OSError as error:
            refused = refused and error
        else:
            refused = None
    if refused is not None:
        raise refused


class _Reason(NamedTuple):
    """Why a link cannot be opened: a name that stays, the same in words with what to do, and what to type next."""

    code: str
    text: str
    command: str | None = None


def _reason(uri: Uri, error: Exception) -> _Reason:
    number = getattr(error, "errno", None)
    if isinstance(uri, SerialUri):
        return _serial_reason(uri, error, number)
    if isinstance(error, socket.gaierror):
        return _Reason("unknown_host", f"unknown host {uri.host!r}")
    if isinstance(error, TimeoutError):
        return _Reason("no_answer", f"no answer within {_PATIENCE_S:g} s")
    if number == errno.EADDRINUSE:
        protocol: Literal["tcp", "udp"] = "tcp" if uri.kind == "tcpin" else "udp"
        owner = port_owner(uri.port, protocol)
        by, shown_by = (f" by {owner}", None) if owner else ("", f"sudo ss -lp{protocol[0]}n sport = :{uri.port}")
        mend = "end that program, or let it forward to another port"
        return _Reason("port_in_use", f"port {uri.port} is in use{by}: {mend}", shown_by)
    if number == errno.EADDRNOTAVAIL:
        everywhere = "[::]" if ":" in uri.host else "0.0.0.0"  # noqa: S104  # named, not bound
        mend = f"{everywhere} stands for all of them"
        return _Reason("no_such_address", f"{uri.host} is no address of this machine; {mend}")
    if number == errno.ECONNREFUSED:
        return _Reason("connection_refused", "connection refused: nothing listens there")
    if number in (errno.EACCES, errno.EPERM) and uri.port < _FIRST_FREE_PORT:
        mend = f"port {uri.port} needs an administrator; choose one above {_FIRST_FREE_PORT - 1}"
        return _Reason("no_permission", f"permission refused: {mend}")
    if number == errno.ENODEV and uri.kind == "mcast":
        return _Reason("no_multicast", "no network interface takes part in multicast")
    return _Reason("cannot_open", _said(error))


_FIRST_FREE_PORT = 1024
MODEM_MANAGER = "ModemManager"
"""Takes each new serial device for a modem, and asks it."""


def _serial_reason(uri: SerialUri, error: Exception, number: int | None) -> _Reason:
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        present = serial_devices()
        there = f"there are {', '.join(present)}" if present else "there is no serial device"
        return _Reason("no_such_device", f"no such device; {there}")
    if number in (errno.EACCES, errno.EPERM):
        join = f"sudo usermod -aG {device_group(uri.device)} $USER"
        mend = f"join the device's group with '{join}', then log in again"
        return _Reason("not_in_group", f"permission refused: {mend}", join)
    if number in (errno.EBUSY, errno.EAGAIN):
        return _held(uri.device)
    if number in (errno.ENOTTY, errno.EISDIR) or "Could not configure port" in str(error):
        return _Reason("no_serial_device", "not a serial device")
    return _Reason("cannot_open", _said(error))


def _held(device: str) -> _Reason:
    owner = device_owner(device)
    if owner is None and is_running(MODEM_MANAGER):
        owner = f"another program, {MODEM_MANAGER} probably"
    if owner is None:
        ask = f"sudo fuser -v {device}"
        whose = f"'{ask}' names it: end that program"
        return _Reason("device_held", f"in use by another program (a ground station?); {whose}", ask)
    if MODEM_MANAGER in owner:
        end = f"sudo systemctl stop {MODEM_MANAGER}"
        mend = f"'{end}' ends it, 'sudo systemctl disable --now {MODEM_MANAGER}' for good"
        told = f"in use by {owner}: it lets go of what is no modem after some seconds; {mend}"
        return _Reason("held_by_modem_manager", told, end)
    return _Reason("device_held", f"in use by {owner}: end that program")


def serial_devices() -> list[str]:
    """The serial devices of this machine."""
    from serial.tools.list_ports import comports

    return sorted(port.device for port in comports())


def device_group(device: str) -> str:
    """The group whose members may use a serial device; what it usually is, where that cannot be told."""
    try:
        group = Path(device).group()
    except (OSError, KeyError, NotImplementedError):
        return "dialout"
    return group if group != "root" else "dialout"


def _said(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()
