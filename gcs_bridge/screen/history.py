"""How far the two attitudes of a vehicle lay apart, second by second, against the limit of that time."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from gcs_bridge.judging.snapshot import AlarmNow, VehicleNow

__all__ = ["History", "Second", "disagreement_of"]

_LONGEST_S = 600


class Second(NamedTuple):
    """The largest difference that was seen in a second, in degrees, with its limit."""

    value: float
    limit: float


class History:
    """The last ten minutes of a vehicle; None where nothing was compared."""

    def __init__(self) -> None:
        """Start with nothing seen."""
        self._seconds: deque[Second | None] = deque(maxlen=_LONGEST_S)
        self._last = 0  # the second that is the last one
        self._t_boot_s: float | None = None  # of the latest pair

    def look(self, vehicle: VehicleNow, now_s: float) -> None:
        """Take what is known of it now, by a clock that never goes back; what was seen before counts no second time."""
        second = math.floor(now_s)
        missed = second - self._last if self._seconds else 1
        self._seconds.extend([None] * min(missed, _LONGEST_S))
        self._last = second
        now = disagreement_of(vehicle)
        if now is None or now.t_boot_s == self._t_boot_s or now.value is None or now.limit is None:
            return
        self._t_boot_s = now.t_boot_s
        before = self._seconds[-1]
        if not (math.isfinite(now.value) and math.isfinite(now.limit)):
            return
        if before is None or now.value - now.limit > before.value - before.limit:
            self._seconds[-1] = Second(now.value, now.limit)

    def last(self, seconds: int) -> list[Second | None]:
        """So many of the last seconds, or as many as there are; the latest is the last one."""
        return list(self._seconds)[-seconds:] if seconds > 0 else []


def disagreement_of(vehicle: VehicleNow) -> AlarmNow | None:
    """ATTITUDE against ATTITUDE_QUATERNION: the latest pair against its limit; None before the first one."""
    for check in vehicle.checks:
        if check.name == "euler_quaternion":
            for alarm in check.alarms:
                if alarm.name == "pairs":
                    return None if alarm.value is None else alarm
    return None
