"""How to make an autopilot send a message: the command to type."""

from __future__ import annotations

__all__ = ["request_command"]
_MSGIDS = {"ATTITUDE": 30, "ATTITUDE_QUATERNION": 31, "RAW_IMU": 27, "SCALED_IMU": 26, "HIGHRES_IMU": 105}  # common.xml
_ON_PX4 = {"RAW_IMU": "HIGHRES_IMU"}  # what PX4 has instead
_RATE_HZ = 25
_USB = "-d /dev/ttyACM0"  # as PX4 calls its USB port, on most boards


def request_command(message: str, autopilot: str = "unknown", *, px4_udp_port: int | None = None) -> tuple[str, str]:
    """Where to type, and what, so that `message` comes 25 times a second.

    PX4 must be told on which of its links: by the UDP port of its own from which it sends, where that is known.

    >>> request_command("ATTITUDE_QUATERNION")
    ('MAVProxy', 'long SET_MESSAGE_INTERVAL 31 40000')
    >>> request_command("RAW_IMU", "px4", px4_udp_port=18570)
    ("PX4's shell", 'mavlink stream -u 18570 -s HIGHRES_IMU -r 25')
    """
    if autopilot == "px4":
        message = _ON_PX4.get(message, message)
        if px4_udp_port is not None:
            return "PX4's shell", f"mavlink stream -u {px4_udp_port} -s {message} -r {_RATE_HZ}"
        shell = "PX4's shell (another port than USB as 'mavlink status' there calls it)"
        return shell, f"mavlink stream {_USB} -s {message} -r {_RATE_HZ}"
    return "MAVProxy", f"long SET_MESSAGE_INTERVAL {_MSGIDS[message]} {1_000_000 // _RATE_HZ}"
