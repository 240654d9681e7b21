"""Where things stand in the world of the picture, and from where it is looked at; in north-east-down, m.

A viewer writes texts at the same size however far away they are, so what lies between two of them grows with the
distance of the eye, and that with the number of vehicles. A test holds all that is written apart at 1280 by 800.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from gcs_bridge.viewer.solids import Point

__all__ = ["APART_M", "GROUND_M", "NAME_AT", "UNDONE_AT", "Eye", "WrittenPlaces", "eye_of", "written_places"]

APART_M = 3.7  # from one vehicle to the next, towards the east
GROUND_M = 1.0  # the ground lies so far below the vehicles
# Of a vehicle: above and before all that turns with it, 1.6 m about its middle.
NAME_AT: Point = (0.0, 0.0, -1.75)
UNDONE_AT: Point = (-1.75, 0.0, GROUND_M)

_LEFT_M, _RIGHT_M = (
    2.9,
    1.9,
)  # the picture's edges: west of the first vehicle, with the legend, and east of the last one
_WIDE = 1.25  # width of the picture by its height, at least, for each metre that is looked at from a metre away
_NEAR_M = 0.6  # what is nearer than the vehicles needs more
_WEST_DEG, _ABOVE_DEG = 14.0, 29.0  # from where it is looked at: from the south
_ROWS = 6
_ROW = 0.065  # from one line of the legend to the next, by the distance of the eye


class Eye(NamedTuple):
    """From where it is looked at what."""

    position: Point
    target: Point
    distance_m: float


class WrittenPlaces(NamedTuple):
    """Of the lines of the legend; of the corner of the world's axes, and how long these are."""

    legend: list[Point]
    corner: Point
    axis_m: float


def eye_of(vehicles: int) -> Eye:
    """From the south-west and above, north away from the eye; the further off the more vehicles there are."""
    more_m = max(vehicles - 1, 0) * APART_M
    distance = _NEAR_M + (_LEFT_M + _RIGHT_M + more_m) / _WIDE
    target = (0.0, (more_m + _RIGHT_M - _LEFT_M) / 2, -0.15)
    west, above = math.radians(_WEST_DEG), math.radians(_ABOVE_DEG)
    level = distance * math.cos(above)
    position = (-level * math.cos(west), target[1] - level * math.sin(west), target[2] - distance * math.sin(above))
    return Eye(position, target, distance)


def written_places(vehicles: int) -> WrittenPlaces:
    """What is written beside the first vehicle, for so many of them."""
    distance = eye_of(vehicles).distance_m
    row = _ROW * distance
    top = -0.31 * distance
    legend = [(0.0, -2.25, top + row * line) for line in range(_ROWS)]
    axis = 0.08 * distance
    return WrittenPlaces(legend, (0.0, -2.45, top + row * (_ROWS + 1.6)), axis)
