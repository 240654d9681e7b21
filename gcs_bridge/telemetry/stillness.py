"""Whether a vehicle may be at rest, by what it says of itself."""

from __future__ import annotations

import numpy as np

from gcs_bridge.columns import Int64s, Mask
from gcs_bridge.settings import GravitySettings
from gcs_bridge.telemetry.batches import VelocityChange
from gcs_bridge.telemetry.statements import LandedSet, ModeSet, Statement, StepSignal


class Stillness:
    """Where a vehicle may be at rest by what it says itself: disarmed, landed or not accelerating."""

    def __init__(self, settings: GravitySettings) -> None:
        """Start with nothing told."""
        self._settings = settings
        self._armed, self._landed, self._acceleration = StepSignal(), StepSignal(), StepSignal()

    def told(self, told: list[Statement], motion: VelocityChange) -> None:
        """Take what the vehicle said in this batch."""
        for latest, values in (
            (self._armed, [(say.frame_index, float(say.armed)) for say in told if isinstance(say, ModeSet)]),
            (
                self._landed,
                [
                    (say.frame_index, np.nan if say.landed is None else float(say.landed))
                    for say in told
                    if isinstance(say, LandedSet)
                ],
            ),
        ):
            if values:
                latest.put(np.array([at for at, _ in values]), np.array([value for _, value in values]))
        self._acceleration.put(motion.frame_index, motion.acceleration_m_s2)

    def forget(self, frame_index: int) -> None:
        """Nothing will be asked about frames before this one."""
        for latest in (self._armed, self._landed, self._acceleration):
            latest.forget(frame_index)

    def at(self, frame_indices: Int64s) -> tuple[Mask, Mask]:
        """Whether it may rest, and whether it stands on the ground, at the frames `frame_indices` (n,).

        Something must say so, or nothing be known at all. In a steady climb it rests by this, and does not stand.
        """
        armed, landed = self._armed.at(frame_indices), self._landed.at(frame_indices)
        acceleration = self._acceleration.at(frame_indices)
        unknown = np.isnan(armed) & np.isnan(landed)
        stands = (armed == 0) | (landed == 1)
        rests = stands | (acceleration < self._settings.still_below_m_s2)
        return rests | (unknown & np.isnan(acceleration)), stands | unknown
