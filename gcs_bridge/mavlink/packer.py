"""Frames of our own, packed by pymavlink: the few messages that this program sends where it was asked to.

Whether anything may be sent, and to whom, is not known here.
"""

from __future__ import annotations

import math
from typing import Any

__all__ = ["GET_MESSAGE_INTERVAL", "SET_MESSAGE_INTERVAL", "TEXT_BYTES", "Packer"]
TEXT_BYTES = 50  # of one STATUSTEXT
SET_MESSAGE_INTERVAL, GET_MESSAGE_INTERVAL = 511, 510  # MAV_CMD
_INVALID, _ONBOARD_CONTROLLER, _GCS = 8, 18, 6  # MAV_AUTOPILOT, MAV_TYPE, MAV_TYPE
_ACTIVE = 4  # MAV_STATE


class Packer:
    """Packs messages of one component for one receiver, with sequence numbers that run on from each to the next."""

    def __init__(self, system: int, component: int) -> None:
        """Begin with sequence number 0."""
        # Loaded when there is something to send. Not "all": these messages are the same in both, and it loads sooner.
        from pymavlink.dialects.v20 import common

        self._written = _Written()
        self._mav: Any = common.MAVLink(self._written, srcSystem=system, srcComponent=component)

    def heartbeat(self, *, ground_station: bool) -> bytes:
        """A HEARTBEAT of a ground station, or of an onboard controller."""
        kind = _GCS if ground_station else _ONBOARD_CONTROLLER
        self._mav.heartbeat_send(kind, _INVALID, 0, 0, _ACTIVE)
        return self._written.frame

    def set_interval(self, system: int, component: int, msgid: int, interval_us: int) -> bytes:
        """Ask a component to send a message so often."""
        return self._command(system, component, SET_MESSAGE_INTERVAL, msgid, interval_us)

    def get_interval(self, system: int, component: int, msgid: int) -> bytes:
        """Ask a component how often it sends a message: it answers with a MESSAGE_INTERVAL."""
        return self._command(system, component, GET_MESSAGE_INTERVAL, msgid, 0)

    def text(self, severity: int, text: str) -> bytes:
        """A STATUSTEXT, of `TEXT_BYTES` at most; severity as MAV_SEVERITY has it, 0 is worst."""
        self._mav.statustext_send(severity, text.encode("ascii", "replace")[:TEXT_BYTES])
        return self._written.frame

    def _command(self, system: int, component: int, command: int, *parameters: float) -> bytes:
        seven = (*map(float, parameters), *(0.0,) * (7 - len(parameters)))
        assert all(map(math.isfinite, seven))
        self._mav.command_long_send(system, component, command, 0, *seven)
        return self._written.frame


class _Written:
    """What pymavlink takes for a file."""

    frame = b""

    def write(self, frame: bytes) -> None:
        self.frame = bytes(frame)
