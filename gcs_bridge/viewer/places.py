"""Where things stand in the world of the picture, and from where it is looked at; in north-east-down, m.

A viewer writes texts at the same size however far away they are, so what lies between two of them grows with the
distance of the eye, and that with the number of vehicles. A test holds all that is written apart at 1280 by 800.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from gcs_bridge.viewer.solids import Point

__all__ = [
    "APART_M",
    "GROUND_M",
    "NAME_AT",
    "UNDONE_AT",
    "Eye",
    "WrittenPlaces",
    "eye_of",
    "place_of",
    "written_places",
]

APART_M = 3.8  # from one vehicle to the next, towards the east,
_ABREAST = 3  # of which so many stand side by side,
_BEHIND_M = 8.5  # and the next ones so far behind them, and further apart: what is far away looks small
_WIDER = 0.45
GROUND_M = 1.0  # the ground lies so far below the vehicles
NAME_AT: Point = (0.0, 0.0, -1.75)  # above all that turns with a vehicle, 1.6 m about its middle;
_LIFT_M = 1.4  # of each second vehicle the name is so much higher
UNDONE_AT: Point = (-1.75, 1.3, GROUND_M)  # before it

_WIDE = 1.2  # the picture is so wide for each metre from the eye,
_NEAREST_M = 4.9  # and from here one vehicle, its name above and the text before it fill its height
_MARGIN_M = 0.9  # what is nearer than the vehicles looks larger
_BESIDE_M, _RIGHT_M = 2.05, 1.7  # from the first vehicle to the legend, from the last one to the edge
_LEGEND = 0.29  # the legend is so wide for each metre from the eye
_WEST_DEG, _ABOVE_DEG = 12.0, 29.0  # from where it is looked at: from the south
_ROWS = 6
_ROW = 0.083  # from one line of the legend to the next, by the distance of the eye;
_TOP = -0.42  # its first line stands so high


class Eye(NamedTuple):
    """From where it is looked at what."""

    position: Point
    target: Point
    distance_m: float


class WrittenPlaces(NamedTuple):
    """Of the lines of the legend; of the corner of the world's axes, how long these are, and of their names."""

    legend: list[Point]
    corner: Point
    axis_m: float
    tips: list[Point]


def place_of(number: int) -> Point:
    """Where a vehicle stands, by its number from 0: in rows of three, so that names of a fleet have room."""
    row, column = divmod(number, _ABREAST)
    return (row * _BEHIND_M, column * APART_M * (1 + row * _WIDER), 0.0)


def lift_of(number: int) -> Point:
    """By how much a vehicle's name is above `NAME_AT`: of neighbours it is not at one height, so both have room."""
    return (0.0, 0.0, -_LIFT_M * (number % _ABREAST % 2))


def eye_of(vehicles: int) -> Eye:
    """From the south-west and above, north away from the eye; the further off the more vehicles there are."""
    more_m = (min(max(vehicles, 1), _ABREAST) - 1) * APART_M
    wide = (_MARGIN_M * _WIDE + _BESIDE_M + more_m + _RIGHT_M) / (_WIDE - _LEGEND)
    distance = max(_NEAREST_M, wide)
    target = (0.0, (more_m + _RIGHT_M - _BESIDE_M - _LEGEND * distance) / 2, 0.15)
    west, above = math.radians(_WEST_DEG), math.radians(_ABOVE_DEG)
    level = distance * math.cos(above)
    position = (-level * math.cos(west), target[1] - level * math.sin(west), target[2] - distance * math.sin(above))
    return Eye(position, target, distance)


def written_places(vehicles: int) -> WrittenPlaces:
    """What is written beside the first vehicle, for so many of them."""
    distance = eye_of(vehicles).distance_m
    row = _ROW * distance
    top = _TOP * distance
    beside = -_BESIDE_M - _LEGEND * distance / 2
    legend = [(0.0, beside, top + row * line) for line in range(_ROWS)]
    axis = 0.08 * distance
    north, east, down = corner = (0.0, beside - 0.06 * distance, top + row * (_ROWS + 1.15))
    tips = [(north + 1.2 * axis, east, down), (north, east + 1.9 * axis, down), (north, east, down + 1.2 * axis)]
    return WrittenPlaces(legend, corner, axis, tips)
