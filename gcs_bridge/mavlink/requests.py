"""How to make an autopilot send a message: the command to type."""

from __future__ import annotations

_MSGIDS = {"ATTITUDE": 30, "ATTITUDE_QUATERNION": 31}  # MAVLink common.xml
_RATE_HZ = 25


def request_command(message: str, autopilot: str = "unknown") -> tuple[str, str]:
    """Where to type, and what, so that `message` comes 25 times a second.

    >>> request_command("ATTITUDE_QUATERNION")
    ('MAVProxy', 'long SET_MESSAGE_INTERVAL 31 40000')
    """
    if autopilot == "px4":
        return "PX4's shell", f"mavlink stream -r {_RATE_HZ} -s {message}"
    return "MAVProxy", f"long SET_MESSAGE_INTERVAL {_MSGIDS[message]} {1_000_000 // _RATE_HZ}"
