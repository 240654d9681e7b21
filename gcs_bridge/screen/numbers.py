"""The attitude as numbers: both messages in both forms, rates and ages, and what the checks come to."""

from __future__ import annotations

import math
from collections import Counter

from gcs_bridge.attitude import rpy_from_quaternion
from gcs_bridge.judging.snapshot import AlarmNow, AttitudeNow, CheckNow, VehicleNow
from gcs_bridge.report.wording import UNITS
from gcs_bridge.screen.canvas import Region, Role

__all__ = ["CHECKS_WIDTH", "NUMBERS_WIDTH", "brief_attitude", "draw_checks", "draw_numbers", "heading_deg", "measured"]

NUMBERS_WIDTH, CHECKS_WIDTH = 44, 50
_LABEL, _NUMBER = 11, 9
_VERDICTS = {
    "agree": Role.GOOD,
    "explained": Role.GOOD,
    "warning": Role.CAUTION_SEEN,
    "alarm": Role.WARNING_SEEN,
    "no_compare": Role.ADVISORY,
    "inop": Role.ADVISORY,
}


def draw_numbers(region: Region, vehicle: VehicleNow) -> None:
    """Draw both messages: roll, pitch and yaw in degrees with their ages, quaternions, body rates in °/s."""
    both = (("Euler", vehicle.attitude), ("quaternion", vehicle.attitude_quaternion))
    _heads(region, 0, "degrees", "roll", "pitch", "yaw")
    region.put_right(NUMBERS_WIDTH - 1, 0, "age", Role.FAINT)
    for y, (name, attitude) in enumerate(both, 1):
        region.put(0, y, name, Role.FAINT)
        _numbers(region, y, _rpy_deg(attitude), "{:+.2f}")
        _draw_age(region, y, attitude)
    _heads(region, 3, "q (NED)", "w", "x", "y", "z", width=_NUMBER - 1)
    for y, (name, attitude) in enumerate(both, 4):
        region.put(0, y, name, Role.FAINT)
        _numbers(region, y, None if attitude is None else attitude.q_nb, "{:+.4f}", width=_NUMBER - 1)
    _heads(region, 6, "rates/s", "p", "q", "r")
    for y, (name, attitude) in enumerate(both, 7):
        region.put(0, y, name, Role.FAINT)
        rates = None if attitude is None else tuple(map(math.degrees, attitude.w_nb_b_rad_s))
        _numbers(region, y, rates, "{:+.2f}")


def brief_attitude(vehicle: VehicleNow) -> str:
    """Roll, pitch and yaw in one short text, of the quaternion if there is one.

    The message that it is of is left out: who has room for more draws the numbers.
    """
    rpy = _rpy_deg(vehicle.attitude_quaternion or vehicle.attitude)
    return "no attitude" if rpy is None else "R{:+.1f} P{:+.1f} Y{:+.1f}".format(*rpy)


def heading_deg(attitude: AttitudeNow) -> float | None:
    """The yaw of an attitude, as it would be shown; None where it has none."""
    rpy = _rpy_deg(attitude)
    return None if rpy is None or not math.isfinite(rpy[2]) else rpy[2]


def draw_checks(region: Region, vehicle: VehicleNow) -> None:
    """Draw a row a check: its verdict so far, its latest value and limit; in one row, how many there are of each."""
    if region.height < len(vehicle.checks):
        if region.height:
            counts = Counter(check.verdict for check in vehicle.checks)
            said = ", ".join(f"{count} {_words(verdict)}" for verdict, count in counts.items())
            region.put_cut(0, 0, f"{len(vehicle.checks)} checks: {said}", Role.FAINT)
        return
    for y, check in enumerate(vehicle.checks):
        region.put(0, y, check.name, Role.FAINT)
        region.put(20, y, _words(check.verdict), _VERDICTS[check.verdict])
        nearest = _nearest_to_its_limit(check)
        if nearest is not None:
            region.put_cut(32, y, measured(nearest))


def measured(alarm: AlarmNow) -> str:
    """The latest value of an alarm and its limit, in few characters.

    What is too small to matter beside its limit is shown as 0.
    """
    if alarm.value is None or alarm.limit is None:
        return ""
    unit = UNITS.get(alarm.unit, f" {alarm.unit}")
    return f"{_short(alarm.value, alarm.limit)}/{_short(alarm.limit, alarm.limit)}{unit}"


def _short(value: float, beside: float) -> str:
    if not math.isfinite(value):
        return "?"
    return f"{value:.2f}" if 0.095 < beside < 100 else f"{value:.2g}"


def _nearest_to_its_limit(check: CheckNow) -> AlarmNow | None:
    rated = [alarm for alarm in check.alarms if alarm.value is not None and alarm.limit]
    return max(rated, key=lambda alarm: (alarm.value or 0.0) / (alarm.limit or 1.0), default=None)


def _words(verdict: str) -> str:
    return verdict.replace("_", " ").upper()


def _heads(region: Region, y: int, label: str, *heads: str, width: int = _NUMBER) -> None:
    region.put(0, y, label, Role.FAINT)
    for place, head in enumerate(heads, 1):
        region.put_right(_LABEL + place * width, y, head, Role.FAINT)


def _numbers(region: Region, y: int, numbers: tuple[float, ...] | None, form: str, *, width: int = _NUMBER) -> None:
    """Numbers in columns; what is not known is a dash, never 0."""
    if numbers is None:
        region.put_right(_LABEL + width, y, "-", Role.FAINT)
        return
    for place, number in enumerate(numbers, 1):
        region.put_right(_LABEL + place * width, y, form.format(number) if math.isfinite(number) else "?")


def _draw_age(region: Region, y: int, attitude: AttitudeNow | None) -> None:
    if attitude is None:
        region.put_right(NUMBERS_WIDTH - 1, y, "never", Role.ADVISORY)
        return
    age = "?" if attitude.age_s is None else f"{attitude.age_s:.1f} s" if attitude.age_s < 100 else "long"
    if not attitude.alive:
        age = "SILENT"
    elif not attitude.valid:
        age = "BAD"
    region.put_right(NUMBERS_WIDTH, y, age, Role.PLAIN if attitude.alive and attitude.valid else Role.ADVISORY)


def _rpy_deg(attitude: AttitudeNow | None) -> tuple[float, ...] | None:
    """As sent where it was sent so, else of the quaternion."""
    if attitude is None:
        return None
    rpy_rad = attitude.rpy_rad or rpy_from_quaternion(attitude.q_nb).tolist()
    return tuple(map(math.degrees, rpy_rad))
