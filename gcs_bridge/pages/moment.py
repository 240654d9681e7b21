"""Where the body pointed, drawn: both forms of an attitude in a north-east-down world, seen from the south-east."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats

__all__ = ["Drawn", "Line", "drawn"]

_SIZE, _SCALE = 220.0, 72.0  # of the picture, and of one unit in it
_AZIMUTH, _ELEVATION = np.radians(-35.0), np.radians(28.0)  # of the eye: from south towards east, above the horizon
# A glider's outline in FRD: nose, right wing, tail, left wing; the fin stands up.
_OUTLINE = np.array([[1.0, 0, 0], [-0.2, 0.8, 0], [-0.6, 0, 0], [-0.2, -0.8, 0], [1.0, 0, 0]])
_FIN = np.array([[-0.6, 0, 0], [-0.6, 0, -0.4], [-0.1, 0, 0]])


class Line(NamedTuple):
    """A line of the picture: its class, its points as SVG has them, and a text at its end."""

    kind: str
    points: str
    label: str = ""
    at: tuple[float, float] = (0.0, 0.0)


class Drawn(NamedTuple):
    """The picture: its size in px, and its lines from the back to the front."""

    size: float
    lines: tuple[Line, ...]


def drawn(q_euler: Floats | None, q_quaternion: Floats | None) -> Drawn | None:
    """The bodies of both forms, q_nb (4,), those that there are; None without any."""
    bodies = [(kind, q) for kind, q in (("euler", q_euler), ("quaternion", q_quaternion)) if q is not None]
    bodies = [(kind, q) for kind, q in bodies if np.isfinite(q).all() and np.linalg.norm(q) > 0]
    if not bodies:
        return None
    lines = [
        _line("world", np.array([[0.0, 0, 0], axis]), name) for axis, name in zip(np.eye(3) * 1.25, "NED", strict=True)
    ]
    circle = np.linspace(0, 2 * np.pi, 49)
    lines.append(_line("horizon", np.column_stack((np.cos(circle), np.sin(circle), np.zeros(49)))))
    for kind, q in bodies:
        q_nb = attitude.normalise(q)
        lines.append(_line(f"body {kind}", attitude.rotate(q_nb, _OUTLINE)))
        lines.append(_line(f"body {kind}", attitude.rotate(q_nb, _FIN)))
        lines.append(_line(f"nose {kind}", attitude.rotate(q_nb, np.array([[0.0, 0, 0], [1.25, 0, 0]]))))
    return Drawn(_SIZE, tuple(lines))


def _line(kind: str, points_ned: Floats, label: str = "") -> Line:
    xy = projected(points_ned)
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in xy)
    x, y = xy[-1]
    return Line(kind, text, label, (round(float(x), 1), round(float(y), 1)))


def projected(points_ned: Floats) -> Floats:
    """Points (n, 3) of the world in the picture (n, 2): x to the right, y down, px."""
    north, east, down = np.asarray(points_ned, np.float64).T
    right = east * np.cos(_AZIMUTH) - north * np.sin(_AZIMUTH)
    away = north * np.cos(_AZIMUTH) + east * np.sin(_AZIMUTH)
    y = down * np.cos(_ELEVATION) - away * np.sin(_ELEVATION)
    return np.column_stack((_SIZE / 2 + _SCALE * right, _SIZE / 2 + _SCALE * y))
