"""Samples against their limits: what an alarm is fed with."""

from __future__ import annotations

from typing import NamedTuple

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, record


class Worst(NamedTuple):
    """The largest value of an excursion, and the detail that came with it."""

    value: float
    detail: Floats


@record
class Rated(FrameColumns):
    """n samples against their limits: time, value, limit, whether bad and whether low (never both), and a detail each.

    `frame_index` (n,) is of the frame that brought each about; `detail` (n, 5) is tilt, heading and the rotation vector
    in body axes, rad, of a value that is an angle between attitudes, and NaN of any other.
    """

    t_boot_us: Int64s
    value: Floats
    limit: Floats
    bad: Mask
    low: Mask
    detail: Floats
