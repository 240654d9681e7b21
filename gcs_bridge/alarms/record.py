"""An alarm as the report shows it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gcs_bridge.alarms.rated import Worst

_NAMED_ABOVE = 0.9  # share of a turn along an axis, from which on the axis is named


@dataclass
class AlarmRecord:
    """One alarm, as the contract's report and events show it; angles in degrees, rates in degrees a second.

    `what` it says and `is_not` what it is no sign of; `axis` where the difference lies; `repeats` counts further raises
    that belong to it, `grouped` says why ("repeat", "chatter", "flood").
    """

    id: str
    check: str
    severity: str
    boot: int
    what: str
    is_not: str
    raised_boot_s: float | None = None
    cleared_boot_s: float | None = None
    raised_utc: str | None = None
    unit: str = "deg"
    peak: float = 0.0
    axis: str | None = None
    tilt: float | None = None
    heading: float | None = None
    rotvec_body: list[float] | None = None
    repeats: int = 0
    grouped: str | None = None
    acknowledged: bool = False
    diagnosis: dict[str, Any] | None = None

    def show(self, worst: Worst) -> None:
        """Take the peak of the excursion, and what came with it."""
        scale = math.degrees(1.0) if self.unit.startswith("deg") else 1.0
        if worst.value * scale < self.peak:
            return
        self.peak = worst.value * scale
        tilt, heading, *rotvec = np.degrees(worst.detail).tolist()
        self.tilt, self.heading = _known(tilt), _known(heading)
        self.rotvec_body = None if math.isnan(rotvec[0]) else rotvec
        self.axis = axis_of(worst.detail)


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


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
