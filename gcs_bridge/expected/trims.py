"""AHRS_TRIM in force at each frame: as it is told, and as it shows in ATTITUDE where it is not.

An inertial sensor's axes are the body's before the trim: whoever compares both must turn by it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.expected.corrected import Corrected
from gcs_bridge.expected.correction import TRIM_FITTED
from gcs_bridge.expected.knowledge import is_possible
from gcs_bridge.telemetry.statements import ParameterSet, Statement, StepSignal

_NAMES = ("AHRS_TRIM_X", "AHRS_TRIM_Y")


class TrimsInForce:
    """Of one vehicle; values that were told count from their frame on."""

    def __init__(self) -> None:
        """Start untrimmed."""
        self._told: list[ParameterSet] = []  # that are not in force yet
        self._in_force = {name: StepSignal(0.0) for name in _NAMES}
        self._undone_rad = np.zeros(3)  # as it was undone last
        self._names: set[str] = set()  # of the parameters that were told
        self._fitted = False
        self.open = StepSignal(1.0)  # 1 while it is neither told nor fitted: it may be anything

    def hear(self, statements: Iterable[Statement]) -> None:
        """Take what the vehicle said of itself."""
        for say in statements:
            if isinstance(say, ParameterSet) and say.name in _NAMES and is_possible(say):
                self._told.append(say)
                self._names.add(say.name)
                if len(self._names) == len(_NAMES) and self.open.latest:
                    self.open.put(np.array([say.frame_index]), np.zeros(1))

    def follow(self, corrected: Corrected) -> None:
        """Take what was undone in the next samples of ATTITUDE."""
        self._follow_fit(corrected)
        if not self._told and not corrected.undoes and not self._undone_rad.any():
            return
        undone = np.vstack((self._undone_rad, corrected.trim_b_rad))
        changes = np.flatnonzero((np.diff(undone, axis=0) != 0).any(axis=1))
        self._undone_rad = undone[-1]
        news = [(say.frame_index, say.name, say.value) for say in self._told]
        self._told.clear()
        for row in changes.tolist():
            news += [
                (int(corrected.frame_index[row]), name, value)
                for name, value in zip(_NAMES, undone[row + 1], strict=False)
            ]
        for frame_index, name, value in sorted(news):
            self._in_force[name].put(np.array([frame_index]), np.array([value]))

    def _follow_fit(self, corrected: Corrected) -> None:
        """It is open no more while it is fitted."""
        if len(self._names) == len(_NAMES) or not len(corrected):
            return
        bits = corrected.open_in_all
        if bits is not None and bool(bits & TRIM_FITTED) == self._fitted:
            return
        fitted = corrected.trim_fitted
        changes = np.flatnonzero(np.diff(fitted, prepend=self._fitted))
        self._fitted = bool(fitted[-1])
        self.open.put(corrected.frame_index[changes], (~fitted[changes]).astype(np.float64))

    def at(self, frame_indices: Int64s) -> Floats:
        """The turn (n, 3), rad, from the body's axes to the sensor's, at the frames (n,)."""
        turn_b_rad = np.zeros((len(frame_indices), 3))
        for axis, trim in enumerate(self._in_force.values()):
            if not trim.is_always(0.0):
                turn_b_rad[:, axis] = trim.at(frame_indices)
        return turn_b_rad

    def forget(self, frame_index: int) -> None:
        """Nothing will be asked about frames before this one."""
        for trim in (*self._in_force.values(), self.open):
            trim.forget(frame_index)
