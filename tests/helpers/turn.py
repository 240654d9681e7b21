"""A rotation in plain floats, for vehicles that are made tick by tick: SciPy's takes a hundred times as long for one.

Never by our own package; `tests/test_helpers.py` holds it against SciPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import asin, atan2, cos, radians, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = Sequence[float] | Array


class Turn(NamedTuple):
    """A unit quaternion. Products apply the right one first, as SciPy's do."""

    w: float = 1.0
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    @classmethod
    def from_rotvec(cls, rotvec_rad: Vector) -> Turn:
        """About a vector, by its length."""
        x, y, z = map(float, rotvec_rad)
        angle = sqrt(x * x + y * y + z * z)
        scale = sin(angle / 2) / angle if angle > 1e-12 else 0.5
        return cls(cos(angle / 2), scale * x, scale * y, scale * z)

    @classmethod
    def from_rpy_deg(cls, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Turn:
        """Yaw first, then pitch, then roll, each about the axes that the one before has turned."""
        about_z, about_y, about_x = radians(yaw) / 2, radians(pitch) / 2, radians(roll) / 2
        turned = cls(cos(about_z), z=sin(about_z)) * cls(cos(about_y), y=sin(about_y))
        return turned * cls(cos(about_x), sin(about_x))

    def __mul__(self, other: Turn) -> Turn:  # type: ignore[override] # of a tuple: repeated
        a, b, c, d = self
        e, f, g, h = other
        return tuple.__new__(  # half of what a named tuple's own takes
            Turn,
            (
                a * e - b * f - c * g - d * h,
                a * f + b * e + c * h - d * g,
                a * g - b * h + c * e + d * f,
                a * h + b * g - c * f + d * e,
            ),
        )

    def inv(self) -> Turn:
        return Turn(self.w, -self.x, -self.y, -self.z)

    def applied(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """The vector, turned: v + 2 u × (u × v + w v) of the quaternion w, u."""
        w, a, b, c = self
        p, q, r = b * z - c * y + w * x, c * x - a * z + w * y, a * y - b * x + w * z
        return x + 2 * (b * r - c * q), y + 2 * (c * p - a * r), z + 2 * (a * q - b * p)

    def apply(self, vector: Vector) -> Array:
        """The vector, turned."""
        return np.array(self.applied(*map(float, vector)))

    def rpy_rad(self) -> tuple[float, float, float]:
        w, x, y, z = self
        return (
            atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
            atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        )
