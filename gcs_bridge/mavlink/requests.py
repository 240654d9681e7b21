"""How to make an autopilot send a message: the command to type, and what makes it last."""

from __future__ import annotations

__all__ = ["lasting_request", "request_command"]
_MSGIDS = {"ATTITUDE": 30, "ATTITUDE_QUATERNION": 31, "RAW_IMU": 27}  # MAVLink common.xml
_ON_PX4 = {"RAW_IMU": "HIGHRES_IMU"}  # what PX4 has instead
_RATE_HZ = 25


def request_command(message: str, autopilot: str = "unknown", *, px4_udp_port: int | None = None) -> tuple[str, str]:
    """Where to type, and what, so that `message` comes 25 times a second.

    PX4 must be told on which of its links: by the UDP port from which it sends, where that is known, else by the name
    that it has for the port; of USB here.

    >>> request_command("ATTITUDE_QUATERNION")
    ('MAVProxy', 'long SET_MESSAGE_INTERVAL 31 40000')
    >>> request_command("RAW_IMU", "px4", px4_udp_port=18570)
    ("PX4's shell", 'mavlink stream -u 18570 -s HIGHRES_IMU -r 25')
    """
    if autopilot != "px4":
        return "MAVProxy", f"long SET_MESSAGE_INTERVAL {_MSGIDS[message]} {1_000_000 // _RATE_HZ}"
    shell, link = "PX4's shell", f"-u {px4_udp_port}"
    if px4_udp_port is None:
        shell, link = "PX4's shell (after -d the link's port, as 'mavlink status' names it)", "-d /dev/ttyACM0"
    return shell, f"mavlink stream {link} -s {_ON_PX4.get(message, message)} -r {_RATE_HZ}"


def lasting_request(messages: list[str], autopilot: str) -> str | None:
    """What makes these messages come after each start too; None where that is not known.

    >>> lasting_request(["ATTITUDE_QUATERNION", "RAW_IMU"], "ardupilot")
    "the lines '31 40' and '27 40' in message-intervals-chanN.txt on its SD card, N the number of the link from 0"
    """
    if autopilot == "px4":
        return "the 'mavlink stream' command in etc/extras.txt on its SD card"
    if autopilot != "ardupilot":
        return None
    lines = " and ".join(f"'{_MSGIDS[one]} {1000 // _RATE_HZ}'" for one in messages)
    what = "the line" if len(messages) == 1 else "the lines"
    return f"{what} {lines} in message-intervals-chanN.txt on its SD card, N the number of the link from 0"
