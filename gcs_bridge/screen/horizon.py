"""An artificial horizon in characters: the world as it is seen from the vehicle, along its nose.

The vehicle stands still and the world turns: where it banks to the right, right wing down, the horizon turns
anticlockwise, and falls towards the left of the picture. A place of the picture is sky where the direction that is seen
there points above the level: no angle is needed for that, and nothing happens at the poles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs_bridge.screen.canvas import DEGREE, Region, Role

__all__ = ["draw_heading", "draw_horizon"]

_HALF_VIEW_DEG = 30.0  # from the middle of the picture to its upper border
_WIDE = 0.5  # a character is half as wide as it is high
_MARKS_DEG = (-60, -50, -40, -30, -20, -10, 10, 20, 30, 40, 50, 60)
_MARK = 3  # characters to either side of the middle, of a level mark
_LEVEL_DEG, _STEEP_DEG = 45.0, 70.0  # of bank: from here on a mark is drawn as rising, and as upright
_CRAFT = "━━┛·┗━━"
_GROUND = "░"
_EDGES = " ▁▂▃▄▅▆▇█"  # filled from the lower end, ever more
_LEVEL, _RISING, _FALLING, _UPRIGHT = "─╱╲│"
_STEP_DEG = 2.5  # of the heading, from one character to the next


class _Seen(NamedTuple):
    """Of the place x to the right and y above the middle, in rows: sky where ahead + right·x + up·y > 0."""

    ahead: float
    right: float
    up: float
    per_row: float  # tangent of the angle that a row spans in the middle


def draw_horizon(region: Region, q_nb: tuple[float, float, float, float]) -> None:
    """Draw what a vehicle of attitude `q_nb` sees: w, x, y, z, body (FRD) to world (NED), of any norm but zero."""
    if region.width < 3 or region.height < 1:
        return
    seen = _seen(q_nb, math.tan(math.radians(_HALF_VIEW_DEG)) / max(region.height / 2, 1))
    _draw_world(region, seen)
    _draw_marks(region, seen)
    region.put((region.width - len(_CRAFT)) // 2, _middle_row(region), _CRAFT, Role.CRAFT)


def draw_heading(region: Region, heading_deg: float) -> None:
    """Draw a row with the headings that lie ahead, and the vehicle's own in its middle."""
    middle = region.width // 2
    for tens in range(36):
        off_deg = (10 * tens - heading_deg + 180.0) % 360.0 - 180.0
        x = middle + round(off_deg / _STEP_DEG)
        name = {0: "N", 9: "E", 18: "S", 27: "W"}.get(tens, f"{10 * tens:03}")
        if tens % 3 == 0:
            region.put(x - len(name) // 2, 0, name, Role.FAINT)
        else:
            region.put(x, 0, ".", Role.FAINT)
    region.put(middle - 3, 0, f" {round(heading_deg) % 360:03}{DEGREE} ", Role.STRONG)


def _seen(q_nb: tuple[float, float, float, float], per_row: float) -> _Seen:
    """Where up is, in body axes: minus the last row of the rotation matrix of `q_nb`."""
    norm = math.sqrt(math.fsum(part * part for part in q_nb))
    w, x, y, z = (part / norm for part in q_nb)
    up = 2 * (w * y - x * z), -2 * (w * x + y * z), 2 * (x * x + y * y) - 1
    # The picture's right is the body's y, its upper side against the body's z.
    return _Seen(up[0], up[1] * per_row, -up[2] * per_row, per_row)


def _middle_row(region: Region) -> int:
    return (region.height - 1) // 2


def _draw_world(region: Region, seen: _Seen) -> None:
    """Fill each place with sky, ground, or the edge between them at the height at which it crosses it."""
    x = (np.arange(region.width) - (region.width - 1) / 2) * _WIDE
    y = _middle_row(region) - np.arange(region.height)
    middle = seen.ahead + seen.right * x[None, :] + seen.up * y[:, None]
    # From the middle of a place to its upper border it changes by half of `up`: the share that is sky, by proportion.
    sky = np.clip(0.5 + middle / max(abs(seen.up), 1e-9), 0.0, 1.0)
    upside_down = seen.up < 0
    filled = np.rint((sky if upside_down else 1.0 - sky) * (len(_EDGES) - 1)).astype(int)
    whole = len(_EDGES) - 1
    edge = Role.EDGE_UPSIDE_DOWN if upside_down else Role.EDGE
    full, empty = (Role.SKY, Role.GROUND) if upside_down else (Role.GROUND, Role.SKY)
    signs = {Role.SKY: " ", Role.GROUND: _GROUND}
    for row, cells in enumerate(filled.tolist()):
        roles = [full if cell == whole else empty if cell == 0 else edge for cell in cells]
        top, left = region.top + row, region.left
        region.canvas.signs[top][left : left + region.width] = [
            _EDGES[cell] if role is edge else signs[role] for cell, role in zip(cells, roles, strict=True)
        ]
        region.canvas.roles[top][left : left + region.width] = roles


def _draw_marks(region: Region, seen: _Seen) -> None:
    """A short line each ten degrees above and below the horizon, above one another through the middle."""
    length = math.hypot(seen.right, seen.up)
    if length < 1e-6 * seen.per_row:  # straight up or down: the horizon is nowhere
        return
    up_x, up_y = seen.right / length, seen.up / length
    pitch_deg = math.degrees(math.asin(max(min(seen.ahead, 1.0), -1.0)))
    slope_deg = math.degrees(math.atan2(-up_x, up_y))  # of the horizon, to the right: above zero it rises
    sign = _sign_of(slope_deg)
    for mark_deg in _MARKS_DEG:
        off_deg = mark_deg - pitch_deg
        if abs(off_deg) >= 80:
            continue
        along = math.tan(math.radians(off_deg)) / seen.per_row
        x, y = along * up_x, along * up_y
        for step in range(-_MARK, _MARK + 1):
            _put_sign(region, x + step * _WIDE * up_y, y - step * _WIDE * up_x, sign)
        label = f"{abs(mark_deg)}"
        at_x, at_y = x + (_MARK + 2) * _WIDE * up_y, y - (_MARK + 2) * _WIDE * up_x
        for place, digit in enumerate(label):
            _put_sign(region, at_x + place * _WIDE, at_y, digit)


def _sign_of(slope_deg: float) -> str:
    steep = abs((slope_deg + 90) % 180 - 90)
    if steep < _LEVEL_DEG:
        return _LEVEL
    if steep > _STEEP_DEG:
        return _UPRIGHT
    return _RISING if (slope_deg + 90) % 180 - 90 > 0 else _FALLING


def _put_sign(region: Region, x: float, y: float, sign: str) -> None:
    """Write over sky or ground, whose role stays; what is at the edge stays visible."""
    column = round(x / _WIDE + (region.width - 1) / 2)
    row = round(_middle_row(region) - y)
    if 0 <= column < region.width and 0 <= row < region.height:
        signs, roles = region.canvas.signs, region.canvas.roles
        if roles[region.top + row][region.left + column] in (Role.SKY, Role.GROUND):
            signs[region.top + row][region.left + column] = sign
