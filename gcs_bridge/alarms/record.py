"""An alarm as the report shows it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec.structs import asdict

from gcs_bridge.alarms.rated import Worst
from gcs_bridge.contract import Alarm, Severity, known

_NAMED_ABOVE = 0.9  # share of a turn along an axis, from which on the axis is named


class AlarmRecord(Alarm, kw_only=True):
    """One alarm while it is followed; `check`, … as `Alarm` has them."""

    @classmethod
    def new(
        cls, *, alarm_id: str, check: str, severity: Severity, boot: int, what: str, is_not: str, unit: str = "deg"
    ) -> AlarmRecord:
        """An alarm of which nothing has been seen yet."""
        return cls(
            id=alarm_id,
            check=check,
            severity=severity,
            boot=boot,
            what=what,
            is_not=is_not,
            raised_boot_s=None,
            cleared_boot_s=None,
            raised_utc=None,
            unit=unit,
            peak=0.0,
            axis=None,
            tilt=None,
            heading=None,
            rotvec_body=None,
            repeats=0,
            grouped=None,
            acknowledged=False,
            diagnosis=None,
        )

    def entry(self) -> Alarm:
        """As it is now, for the report."""
        return Alarm(**asdict(self))

    def told(self) -> dict[str, Any]:
        """As it is now: the fields of an `AlarmEvent` behind its head."""
        fields = asdict(self)
        del fields["boot"], fields["check"]  # which stand in the head
        return fields

    def show(self, worst: Worst) -> None:
        """Take the peak of the excursion, and what came with it."""
        scale = math.degrees(1.0) if self.unit.startswith("deg") else 1.0
        if worst.value * scale < self.peak:
            return
        self.peak = float(worst.value * scale)
        tilt, heading, x, y, z = np.degrees(worst.detail).tolist()
        self.tilt, self.heading = known(tilt), known(heading)
        self.rotvec_body = None if math.isnan(x) else (x, y, z)
        self.axis = axis_of(worst.detail)


def axis_of(detail: npt.NDArray[np.float64]) -> str | None:
    """Where a difference lies: its parts, tilt and heading, and the body axis that it is about, if it is about one.

    `detail` (5,) is tilt, heading, rad, and the vector in body axes. A turn about the world's down is a heading error
    even if a body axis lies along down; a turn about a pitched body's axis has both parts, so the axis is named.
    """
    tilt, heading = float(detail[0]), float(detail[1])
    size = float(np.sqrt(np.sum(detail[2:] ** 2)))
    if math.isnan(size) or size == 0.0:
        return None
    along = np.abs(detail[2:]) / size
    best = int(np.argmax(along))
    body = _BODY_AXES[best] if along[best] > _NAMED_ABOVE else None
    if math.isnan(tilt):
        return body
    share = abs(heading) if not math.isnan(heading) else 0.0
    parts = "heading" if share > _NAMED_ABOVE * size and tilt < share / 2 else "tilt"
    if parts == "heading" or body is None:
        return parts if parts == "heading" or share < tilt / 2 else "tilt and heading"
    return f"{parts if share < tilt / 2 else 'tilt and heading'}, about {body}"


_BODY_AXES = ("body x (roll)", "body y (pitch)", "body z (yaw)")
