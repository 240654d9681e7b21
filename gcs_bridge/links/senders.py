"""Who was heard on a port, and where: what is sent to a system goes to where its datagrams came from."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from gcs_bridge.links.datagrams import address_of
from gcs_bridge.mavlink.scan import Bytes

__all__ = ["Senders"]
_FORGOTTEN_US = 60_000_000  # nothing is sent to an address from which nothing came for so long
_SYSTEM_AT = {0xFD: 5, 0xFE: 3}  # by a frame's first byte: where the sender's system stands


class Senders:
    """The address of each system, the latest; there are 255 systems, and so no more addresses than that."""

    def __init__(self) -> None:
        """Nobody was heard."""
        self._of: dict[int, tuple[Any, int]] = {}

    def heard(self, datagram: Bytes, address: Any, t_rx_us: int) -> None:
        """A datagram came, from an address as Python's sockets or as C writes it; what is no frame is passed over."""
        at = _SYSTEM_AT.get(int(datagram[0]), 0) if len(datagram) >= 8 else 0
        if at:
            self._of[int(datagram[at])] = address, t_rx_us

    def addresses(self, system: int, now_us: int) -> Iterable[tuple[Any, ...]]:
        """Where a system is, if it was heard lately; of 0, where any is."""
        heard = self._of.items() if not system else [(system, self._of[system])] if system in self._of else []
        found = {address for _, (address, t_rx_us) in heard if now_us - t_rx_us <= _FORGOTTEN_US}
        return [address_of(one) if isinstance(one, bytes) else one for one in found]
