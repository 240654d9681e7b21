"""A vehicle's motion as lines and arrows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gcs_bridge.judging.dead_reckoning import MotionTracker
from gcs_bridge.pairing.references import ImuWithAttitude
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.rows import Rows, broken_at_wraps
from gcs_bridge.viewer.scene import DOWN_M, MOTION, path_of
from gcs_bridge.viewer.times import Times

__all__ = ["MotionLines"]


class MotionLines:
    """Follows the motion of one vehicle in one boot, and makes rows of it."""

    def __init__(self, key: VehicleId, boot: int) -> None:
        """Start with nothing drawn."""
        self.boot = boot
        self._paths = [path_of(key, "motion", name) for name in MOTION]
        self._arrow = path_of(key, "body", "down", "accelerometer")
        self._tracker = MotionTracker()
        self._heading_deg = np.nan  # the last one drawn

    def feed(self, seen: ImuWithAttitude) -> Iterator[Rows]:
        """What inertial samples add."""
        moved = self._tracker.feed(seen)
        if moved is None:
            return
        times = Times(boot=self.boot, t_boot_us=moved.t_boot_us, t_rx_us=moved.t_rx_us)
        *paths, heading = self._paths
        lines = (
            moved.a_h_m_s2,
            np.column_stack((moved.v_h_m_s, moved.v_bound_m_s, -moved.v_bound_m_s)),
            np.column_stack((moved.d_h_m, moved.d_bound_m, -moved.d_bound_m)),
            np.degrees(moved.apart_rad),
        )
        arrows = {self._arrow: DOWN_M * np.nan_to_num(moved.accelerometer_down_n)}  # none where there is free fall
        yield Rows(times, numbers=dict(zip(paths, lines, strict=True)), arrows=arrows)
        heading_deg = np.degrees(moved.heading_rad)
        broken, values = broken_at_wraps(times, heading_deg, self._heading_deg, 180.0)
        self._heading_deg = float(heading_deg[-1])
        yield Rows(broken, numbers={heading: values})
