"""What a link's URI says: pymavlink's own forms, told apart and checked before anything is opened."""

from __future__ import annotations

import difflib
import ipaddress
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from gcs_bridge.errors import UsageError

__all__ = ["SCHEMES", "SPEAK_FIRST", "NetworkUri", "SerialUri", "Uri", "network_uri", "parse_uri"]


@dataclass(frozen=True)
class NetworkUri:
    """A host's port: of `SCHEMES` the `kind`, of an IPv6 address without its brackets the `host`."""

    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}:{host}:{self.port}"


@dataclass(frozen=True)
class SerialUri:
    """A serial device (`/dev/ttyACM0`, `COM3`) and its speed in bits a second."""

    kind: ClassVar[str] = "serial"  # of which no URI begins: a device is known by its path
    device: str
    baud: int

    def __str__(self) -> str:
        return self.device


Uri = NetworkUri | SerialUri
# What a URI may begin with, and its form behind that; `links.open.OPENERS` opens it.
SCHEMES = {"udpin": "HOST:PORT", "tcp": "HOST:PORT", "tcpin": "HOST:PORT", "mcast": "[GROUP:PORT]"}
SPEAK_FIRST = ("udpout",)
"""What hears nothing before it has sent."""
_GROUP, _GROUP_PORT = "239.255.145.50", 14550  # pymavlink's, and so what ArduPilot's simulator sends to
_REFUSED = {
    "udpout": (
        "udpout: cannot receive before it has sent, and sending is not enabled: "
        "let the vehicle send here, and listen to it with udpin:0.0.0.0:PORT, or give a flag that transmits"
    ),
    "udpbcast": "udpbcast: cannot receive before it has sent, and sending is not enabled",
}
_KNOWN = (*SCHEMES, *_REFUSED)
_NEAREST = {"udp": "udpin", "udpi": "udpin", "upd": "udpin", "serial": "/dev/ttyACM0"}


def network_uri(text: str, kinds: Sequence[str], *, what: str) -> NetworkUri:
    """The host and port that `text` names, of one of some kinds; UsageError where it is not `what` it should be."""
    kind, colon, rest = text.partition(":")
    if not colon or kind not in kinds:
        raise UsageError(f"{text!r} is not {what}: that is written {', '.join(f'{one}:HOST:PORT' for one in kinds)}")
    return NetworkUri(kind, *_address(text, rest))


def parse_uri(text: str, *, baud: int = 115200, may_send: bool = False) -> Uri:
    """The link that `text` names; a serial device without a speed of its own (`/dev/ttyACM0,57600`) gets `baud`.

    `may_send`: something was asked for that transmits, so that a link may be opened that must speak first.

    Raises UsageError for a scheme that is unknown, not supported yet or would have to send, and for a malformed one.

    >>> parse_uri("udpin:0.0.0.0:14550")
    NetworkUri(kind='udpin', host='0.0.0.0', port=14550)
    >>> parse_uri("/dev/ttyACM0", baud=57600)
    SerialUri(device='/dev/ttyACM0', baud=57600)
    >>> str(parse_uri("mcast:"))
    'mcast:239.255.145.50:14550'
    """
    if _is_path(text):
        return _serial(text, baud)
    scheme, colon, rest = text.partition(":")
    if not colon:
        hint = f": it is a recording, judge it with 'gcs-bridge check {text}'" if os.path.isfile(text) else _forms()
        raise UsageError(f"{text!r} is no link{hint}")
    if scheme in SPEAK_FIRST and may_send:
        return NetworkUri(scheme, *_address(text, rest))
    if scheme in _REFUSED:
        raise UsageError(_REFUSED[scheme])
    if scheme == "mcast":
        return _multicast(text, rest)
    if scheme in SCHEMES:
        return NetworkUri(scheme, *_address(text, rest))
    raise UsageError(f"unknown kind of link {scheme + ':'!r}{_hint(scheme, rest)}")


def _is_path(text: str) -> bool:
    return text.startswith(("/", "./", "../", "\\\\.\\")) or re.fullmatch(r"(?i)COM\d+(,\d+)?", text) is not None


def _serial(text: str, baud: int) -> SerialUri:
    if os.path.isfile(text):
        raise UsageError(f"{text} is a file, no link: judge a recording with 'gcs-bridge check {text}'")
    device, comma, own_baud = text.rpartition(",")
    if comma and own_baud.isdecimal() and int(own_baud) > 0 and not Path(text).exists():
        return SerialUri(device, int(own_baud))
    return SerialUri(text, baud)


def _address(text: str, rest: str) -> tuple[str, int]:
    host, _, port = rest.rpartition(":")
    form = f"{text!r} must be as {text.partition(':')[0]}:127.0.0.1:14550"
    if host.startswith("[") and host.endswith("]"):
        host = _inner(host[1:-1], form)
    elif ":" in host:
        raise UsageError(f"{form}, an IPv6 address in brackets: [::1]")
    if not host:
        raise UsageError(form)
    return host, _port(port, form)


def _inner(host: str, form: str) -> str:
    """The IPv6 address that stood in brackets."""
    try:
        return str(ipaddress.IPv6Address(host))
    except ValueError:
        raise UsageError(f"{form}: {host!r} is no IPv6 address") from None


def _port(port: str, form: str) -> int:
    if not (port.isdecimal() and port.isascii() and 1 <= int(port) <= 65535):
        raise UsageError(f"{form}: the port must be from 1 to 65535")
    return int(port)


def _multicast(text: str, rest: str) -> NetworkUri:
    """`mcast:`, `mcast:PORT` or `mcast:GROUP:PORT`, as pymavlink has them."""
    group, _, port = rest.rpartition(":")
    form = f"{text!r} must be as mcast:{_GROUP}:{_GROUP_PORT}"
    try:
        if group and not ipaddress.IPv4Address(group).is_multicast:
            raise ValueError
    except ValueError:
        raise UsageError(f"{form}: groups are the IPv4 addresses from 224.0.0.0 to 239.255.255.255") from None
    return NetworkUri("mcast", group or _GROUP, _port(port, form) if rest else _GROUP_PORT)


def _hint(scheme: str, rest: str) -> str:
    if rest.isdecimal():  # HOST:PORT, which pymavlink takes for UDP
        return f"; did you mean 'udpin:{scheme}:{rest}'?"
    near = _NEAREST.get(scheme.lower()) or next(iter(difflib.get_close_matches(scheme.lower(), _KNOWN, n=1)), None)
    if near is None:
        return _forms()
    return f"; did you mean {near + ':' + rest if near in _KNOWN else near!r}?"


def _forms() -> str:
    schemes = ", ".join(f"{scheme}:{form}" for scheme, form in SCHEMES.items())
    return f"; links are {schemes} and serial devices as /dev/ttyACM0"
