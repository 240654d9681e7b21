"""What a vehicle's attitude is read against: a compass rose on the ground below it, and its horizon.

The rose is written in lines that lie on the ground, since texts of a viewer are as large from afar as from near, and of
several vehicles would cover each other. All in north-east-down about the vehicle, m.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gcs_bridge.columns import Floats

__all__ = ["HORIZON_M", "POINTS", "ROSE_M", "horizon", "rose", "written"]

POINTS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")  # clockwise, 45° from one to the next

ROSE_M = 1.3  # radius; its writing goes on to 1.75
HORIZON_M = 1.2
_NAMES_M, _NAME_HIGH_M, _MAIN_HIGH_M = 1.53, 0.2, 0.3
_DEGREES_M, _DEGREES_HIGH_M = 1.05, 0.15
_ADVANCE = 0.9  # from one sign to the next, of its height

# Strokes of signs that are 1 high and 0.6 wide, from the lower left: points (right, up).
_W, _H = 0.6, 0.5
_STROKES: dict[str, list[list[tuple[float, float]]]] = {
    "N": [[(0, 0), (0, 1), (_W, 0), (_W, 1)]],
    "E": [[(_W, 0), (0, 0), (0, 1), (_W, 1)], [(0, _H), (0.5, _H)]],
    "S": [[(0, 0), (_W, 0), (_W, _H), (0, _H), (0, 1), (_W, 1)]],
    "W": [[(0, 1), (0.15, 0), (0.3, 0.7), (0.45, 0), (_W, 1)]],
    "0": [[(0, 0), (_W, 0), (_W, 1), (0, 1), (0, 0)]],
    "1": [[(0.1, 0.75), (0.35, 1), (0.35, 0)]],
    "2": [[(0, 1), (_W, 1), (_W, _H), (0, _H), (0, 0), (_W, 0)]],
    "3": [[(0, 1), (_W, 1), (_W, 0), (0, 0)], [(0.1, _H), (_W, _H)]],
    "4": [[(0, 1), (0, _H), (_W, _H)], [(_W, 1), (_W, 0)]],
    "5": [[(_W, 1), (0, 1), (0, _H), (_W, _H), (_W, 0), (0, 0)]],
    "7": [[(0, 1), (_W, 1), (0.2, 0)]],
    "8": [[(0, 0), (_W, 0), (_W, 1), (0, 1), (0, 0)], [(0, _H), (_W, _H)]],
    "9": [[(_W, _H), (0, _H), (0, 1), (_W, 1), (_W, 0), (0, 0)]],
}


def rose(ground_m: float) -> Iterator[tuple[str, list[Floats]]]:
    """Lines of a rose that lies so far below the vehicle, by name: its `ring`, `points` and `degrees`."""
    ticks = [
        _spoke(bearing, ROSE_M, ROSE_M - (0.14 if bearing % 45 == 0 else 0.07), ground_m)
        for bearing in range(0, 360, 15)
    ]
    yield "ring", [_circle(ROSE_M, ground_m), *ticks]
    points, degrees = [], []
    for i, name in enumerate(POINTS):
        high = _NAME_HIGH_M if i % 2 else _MAIN_HIGH_M
        points += written(name, _at(45.0 * i, _NAMES_M), high, ground_m)
        degrees += written(str(45 * i), _at(45.0 * i, _DEGREES_M), _DEGREES_HIGH_M, ground_m)
    yield "points", points
    yield "degrees", degrees


def horizon(ground_m: float) -> list[Floats]:
    """The level at the vehicle's own height, and the plumb line from it to the ground."""
    return [_circle(HORIZON_M, 0.0), np.array([(0.0, 0.0, 0.0), (0.0, 0.0, ground_m)])]


def written(text: str, middle: tuple[float, float], high_m: float, down_m: float) -> list[Floats]:
    """Lines (points, 3) of a text lying on the ground about a place (north, east), to be read looking north."""
    wide = (_ADVANCE * (len(text) - 1) + _W) * high_m
    north, east = middle[0] - high_m / 2, middle[1] - wide / 2
    return [
        np.array([(north + high_m * up, east + high_m * (_ADVANCE * i + right), down_m) for right, up in stroke])
        for i, sign in enumerate(text)
        for stroke in _STROKES[sign]
    ]


def _at(bearing_deg: float, radius: float) -> tuple[float, float]:
    bearing = np.radians(bearing_deg)
    return float(radius * np.cos(bearing)), float(radius * np.sin(bearing))


def _spoke(bearing_deg: float, outer: float, inner: float, down_m: float) -> Floats:
    return np.array([(*_at(bearing_deg, outer), down_m), (*_at(bearing_deg, inner), down_m)])


def _circle(radius: float, down_m: float) -> Floats:
    return np.array([(*_at(bearing, radius), down_m) for bearing in np.linspace(0, 360, 73)])
