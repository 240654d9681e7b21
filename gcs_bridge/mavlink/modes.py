"""Names of flight modes, as their firmware calls them."""

from __future__ import annotations

from gcs_bridge.mavlink.dialect import load_dialect

__all__ = ["mode_name"]

_ARDUPILOT = {  # how MAVLink names the modes of a type of vehicle
    "fixed_wing": "PLANE_MODE",
    "ground_rover": "ROVER_MODE",
    "surface_boat": "ROVER_MODE",
    "submarine": "SUB_MODE",
    "antenna_tracker": "TRACKER_MODE",
}
_COPTERS = ("rotor", "copter", "coaxial")
_PX4 = ("", "manual", "altctl", "posctl", "auto", "acro", "offboard", "stabilized", "rattitude")
_PX4_AUTO = ("", "ready", "takeoff", "loiter", "mission", "rtl", "land", "", "follow", "precland")


def mode_name(autopilot: str, vehicle_type: str, custom_mode: int) -> str:
    """What the firmware calls its mode; "mode N" where that is not known.

    `autopilot` and `vehicle_type` as in the report, `custom_mode` as in HEARTBEAT.

    >>> mode_name("ardupilot", "quadrotor", 5), mode_name("px4", "quadrotor", 4 << 16 | 4 << 24)
    ('loiter', 'auto mission')
    """
    name = "unknown"
    if autopilot == "ardupilot":
        enum = _ARDUPILOT.get(vehicle_type)
        if enum is None and vehicle_type.startswith("vtol"):
            enum = "PLANE_MODE"
        if enum is None and vehicle_type.endswith(_COPTERS):
            enum = "COPTER_MODE"
        name = load_dialect().enum_name(enum, custom_mode) if enum else name
    elif autopilot == "px4":
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        parts = (_named(_PX4, main), _named(_PX4_AUTO, sub) if main == _PX4.index("auto") else "")
        name = " ".join(filter(None, parts)) or name
    return f"mode {custom_mode}" if name == "unknown" else name.replace("_", " ")


def _named(names: tuple[str, ...], number: int) -> str:
    return names[number] if number < len(names) else ""
