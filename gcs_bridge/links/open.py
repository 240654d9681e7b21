"""Opening a link: by pymavlink's connections, with everything off by which they would send, wait or try again."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gcs_bridge.errors import SourceError
from gcs_bridge.links.link import DatagramLink, Link, SerialLink, SpeakingLink, TcpLink
from gcs_bridge.links.udp_owner import udp_port_owner
from gcs_bridge.links.uri import NetworkUri, SerialUri, Uri

__all__ = ["OPENERS", "open_link"]
# Nothing is sent by it, but pymavlink wants to know as whom; its default component 0 is invalid (mavlink.io,
# guide/routing.html). Not 255: an autopilot may take that system for its ground station.
_SYSTEM = 254
_COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
_PATIENCE_S = 5.0


def open_link(uri: Uri, *, dialect: str = "all") -> Link:
    """Open the link; SourceError in one line, with what to do next, where it cannot be."""
    try:
        return OPENERS[uri.kind](uri, dialect)
    except (OSError, ValueError, OverflowError) as error:  # pyserial's own errors are OSErrors
        raise SourceError(f"{uri}: {_reason(uri, error)}") from None


def _open_datagrams(uri: Uri, dialect: str) -> Link:
    assert isinstance(uri, NetworkUri)
    _refuse_taken(uri)
    return DatagramLink(str(uri), _connected(str(uri), dialect))


def _open_speaking(uri: Uri, dialect: str) -> Link:
    """`udpout:`: whoever is there learns of us by what we send. Parsed only where that is allowed."""
    assert isinstance(uri, NetworkUri)
    to = socket.getaddrinfo(uri.host, uri.port, socket.AF_INET, socket.SOCK_DGRAM)[0][4]
    return SpeakingLink(str(uri), _connected(str(uri), dialect), to)


def _open_tcp(uri: Uri, dialect: str) -> Link:
    with _bounded_wait():
        return TcpLink(str(uri), _connected(str(uri), dialect))


def _open_serial(uri: Uri, dialect: str) -> Link:
    assert isinstance(uri, SerialUri)
    return SerialLink(str(uri), _connected(uri.device, dialect, baud=uri.baud))


# The kinds of link; what they are called is in `links.uri`.
OPENERS: dict[str, Callable[[Uri, str], Link]] = {
    "udpin": _open_datagrams,
    "udpout": _open_speaking,
    "tcp": _open_tcp,
    "serial": _open_serial,
}


def _connected(device: str, dialect: str, *, baud: int = 115200) -> Any:
    os.environ.setdefault("MAVLINK20", "1")  # how pymavlink is told to speak version 2; it reads this on import
    from pymavlink import mavutil

    return mavutil.mavlink_connection(
        device,
        baud=baud,
        dialect=dialect,
        source_system=_SYSTEM,
        source_component=_COMPONENT,
        autoreconnect=False,
        retries=1,
    )


@contextmanager
def _bounded_wait() -> Iterator[None]:
    """Connect for some seconds at most: pymavlink leaves it to the system, which tries for two minutes."""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(_PATIENCE_S)
    try:
        yield
    finally:
        socket.setdefaulttimeout(before)


def _refuse_taken(uri: NetworkUri) -> None:
    """Fail where the port is in use: pymavlink binds with SO_REUSEADDR, and would take it from another who did."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((uri.host, uri.port))


def _reason(uri: Uri, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if isinstance(uri, SerialUri):
        return _serial_reason(uri, error, number)
    if isinstance(error, socket.gaierror):
        return f"unknown host {uri.host!r}"
    if isinstance(error, TimeoutError):
        return f"no answer within {_PATIENCE_S:g} s"
    if number == errno.EADDRINUSE:
        owner = udp_port_owner(uri.port)
        by = f" by {owner}" if owner else ""
        return f"port {uri.port} is in use{by}: end that program, or let it forward to another port"
    if number == errno.EADDRNOTAVAIL:
        return f"{uri.host} is no address of this machine; 0.0.0.0 stands for all of them"
    if number == errno.ECONNREFUSED:
        return "connection refused: nothing listens there"
    if number in (errno.EACCES, errno.EPERM):
        return f"permission refused: port {uri.port} needs an administrator; choose one above 1023"
    return _said(error)


def _serial_reason(uri: SerialUri, error: Exception, number: int | None) -> str:
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        present = _serial_devices()
        return "no such device; " + (f"there are {', '.join(present)}" if present else "there is no serial device")
    if number in (errno.EACCES, errno.EPERM):
        return (
            f"permission refused: join the device's group with 'sudo usermod -aG {_group(uri.device)} $USER', "
            "then log in again"
        )
    if number == errno.EBUSY:
        return "in use by another program (a ground station, ModemManager?): end that program"
    if number in (errno.ENOTTY, errno.EISDIR) or "Could not configure port" in str(error):
        return "not a serial device"
    return _said(error)


def _serial_devices() -> list[str]:
    from serial.tools.list_ports import comports

    return sorted(port.device for port in comports())


def _group(device: str) -> str:
    try:
        group = Path(device).group()
    except (OSError, KeyError, NotImplementedError):
        return "dialout"
    return group if group != "root" else "dialout"


def _said(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()
