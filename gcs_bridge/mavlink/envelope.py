"""What stands outside on a single frame: who sent it, which message it is, for whom it is meant.

For the few frames that are looked at one by one, as those that are passed on; judging reads whole batches (`scan`).
"""

from __future__ import annotations

from typing import NamedTuple

from gcs_bridge.mavlink.decode import place_of
from gcs_bridge.mavlink.dialect import Dialect

__all__ = ["Addresses", "Envelope", "envelope"]
_V1 = 0xFE


class Envelope(NamedTuple):
    """Of one frame; the payload is as it came, with its trailing zeros cut off or not."""

    system: int
    component: int
    msgid: int
    payload: bytes


def envelope(frame: bytes) -> Envelope:
    """Of a whole frame, MAVLink 1 or 2.

    >>> envelope(bytes.fromhex("fd 02 00 00 07 01 be 1e 00 00 aa bb 00 00"))
    Envelope(system=1, component=190, msgid=30, payload=b'\\xaa\\xbb')
    """
    if frame[0] == _V1:
        return Envelope(frame[3], frame[4], frame[5], frame[6 : 6 + frame[1]])
    msgid = frame[7] | frame[8] << 8 | frame[9] << 16
    return Envelope(frame[5], frame[6], msgid, frame[10 : 10 + frame[1]])


class Addresses:
    """Whom frames are meant for, by the dialect's own field `target_system`."""

    def __init__(self, dialect: Dialect) -> None:
        """Look each message up when its first frame comes."""
        self._dialect = dialect
        self._places: dict[int, int | None] = {}

    def target_system(self, msgid: int, payload: bytes) -> int:
        """The system that a message is meant for; 0: everybody, as of messages that name nobody."""
        if msgid not in self._places:
            if len(self._places) > _KNOWN_IDS:  # unknown ids may be any of 16 million
                self._places.clear()
            self._places[msgid] = self._place(msgid)
        place = self._places[msgid]
        return payload[place] if place is not None and place < len(payload) else 0

    def _place(self, msgid: int) -> int | None:
        name = self._dialect.name_of(msgid)
        if name is None:
            return None
        message = self._dialect[name]
        return place_of(message, "target_system")[0] if "target_system" in (message.dtype.names or ()) else None


_KNOWN_IDS = 1000
