"""Whether a vehicle may be at rest, by what it says of itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_bridge.columns import Floats, Int64s, Mask
from gcs_bridge.jit import helper, kernel
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
        may_rest, stands = np.empty(len(frame_indices), np.bool_), np.empty(len(frame_indices), np.bool_)
        told = (*self._armed.steps, *self._landed.steps, *self._acceleration.steps)
        rest_at(frame_indices, *told, self._settings.still_below_m_s2, may_rest, stands)
        return may_rest, stands


@kernel
def rest_at(
    frame_index: Int64s, armed_from: Int64s, armed: Floats, landed_from: Int64s, landed: Floats,
    acceleration_from: Int64s, acceleration_m_s2: Floats, still_below_m_s2: float, may_rest: Mask, stands: Mask,
) -> None:  # fmt: skip
    """Fill what holds at frames (n,), in their order, by what was told: each value (k,) from its frame (k,) on."""
    a = b = c = 0
    for i in range(frame_index.size):
        a, b = _holds(armed_from, frame_index[i], a), _holds(landed_from, frame_index[i], b)
        c = _holds(acceleration_from, frame_index[i], c)
        unknown = np.isnan(armed[a]) and np.isnan(landed[b])
        on_ground = armed[a] == 0.0 or landed[b] == 1.0
        stands[i] = on_ground or unknown
        steady = acceleration_m_s2[c] < still_below_m_s2
        may_rest[i] = on_ground or steady or (unknown and np.isnan(acceleration_m_s2[c]))


@helper
def _holds(since: Any, frame_index: Any, at: Any) -> Any:
    """Which value holds when a frame comes: the one at place `at`, or a later one."""
    while at + 1 < since.size and since[at + 1] <= frame_index:
        at += 1
    return at
