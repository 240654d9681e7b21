"""What an alarm says, in words: the same in a report and as it happens."""

from __future__ import annotations

import math

from gcs_bridge.contract import Alarm
from gcs_bridge.events import AlarmEvent

__all__ = ["UNITS", "difference", "largest", "quantity"]
UNITS = {"deg": "°", "deg/s": " °/s", "": "", "1": ""}
"""How a unit is written behind its number, where that is not a space and its name."""


def difference(alarm: Alarm | AlarmEvent) -> str:
    """What it says, how large it grew, and where the difference lies."""
    said = ": ".join(filter(None, (alarm.what, largest(alarm))))
    axis = alarm.axis or ""
    if alarm.tilt is not None:
        said += f", tilt {quantity(alarm.tilt, 'deg')}, heading {quantity(alarm.heading, 'deg')}"
        axis = axis[axis.find("about") :] if "about" in axis else ""
    if axis:
        said += f", {axis}"
    if alarm.grouped in ("chatter", "flood"):
        said += f"; {alarm.grouped}"
    return said


def largest(alarm: Alarm | AlarmEvent) -> str:
    """How large it grew; nothing where it either is or is not, and its unit is empty."""
    return quantity(alarm.peak, alarm.unit) if alarm.unit else ""


def quantity(value: float | None, unit: str) -> str:
    """A number in hundredths of a degree, what is smaller being nothing to act on; else with three digits."""
    if value is None or math.isnan(value):
        return "unknown"
    number = f"{value:.2f}" if unit == "deg" else f"{value:.3g}"
    return number + UNITS.get(unit, f" {unit}")
