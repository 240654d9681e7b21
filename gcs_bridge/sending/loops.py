"""Relays that would come back: frames that go round for ever."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Sequence

from gcs_bridge.errors import UsageError
from gcs_bridge.links.uri import NetworkUri
from gcs_bridge.sending.outlets import resolved

__all__ = ["refuse_loop"]
_MEET = {("udpout", "udpin"), ("udpout", "mcast"), ("tcp", "tcpin")}


def refuse_loop(relay: NetworkUri, links: Sequence[object]) -> None:
    """UsageError for a relay that would come back by a link that is listened to: it would be told for ever."""
    for link in links:
        if (
            isinstance(link, NetworkUri)
            and (relay.kind, link.kind) in _MEET
            and relay.port == link.port
            and (relay.host == link.host if link.kind == "mcast" else _is_here(relay.host))
        ):
            raise UsageError(f"relay {relay} goes to {link}, which is listened to: name another port")


def _is_here(host: str) -> bool:
    """Whether it is an address of this machine: only those can be bound."""
    with contextlib.suppress(OSError):
        family, address = resolved(NetworkUri("udpin", host, 0), socket.SOCK_DGRAM)
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind(address)
            return True
    return False
