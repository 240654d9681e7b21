"""Simple solids as coloured triangles, of which airframes are built; all in body axes (forward, right, down), m.

Shades are painted on, since a viewer lights what it draws by its own camera: tops are bright and bottoms dark, so that
a vehicle on its back looks like one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Floats

__all__ = ["Colour", "Mesh", "Point", "box", "convex", "disc", "joined", "loft", "outline_of_disc", "prism", "shaded"]

Point = tuple[float, float, float]
Colour = tuple[int, int, int]

_AROUND = 16  # corners of what is round
_DIM, _SIDE = 0.5, 0.78  # how bright a bottom, and an upright side, are beside a top


class Mesh(NamedTuple):
    """`corners` (n, 3, 3) of n triangles, and the `colours` (n, 3) of each, 0 to 255."""

    corners: Floats
    colours: Floats


def joined(parts: Iterable[Mesh]) -> Mesh:
    """All of them as one."""
    corners, colours = zip(*parts, strict=True)
    return Mesh(np.concatenate(corners), np.concatenate(colours))


def shaded(mesh: Mesh) -> Floats:
    """The colours (n, 3) by where each triangle of a convex part looks: up, aside, or down."""
    a, b, c = mesh.corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    up = -normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    light = np.where(up >= 0, _SIDE + (1.0 - _SIDE) * up, _SIDE + (_SIDE - _DIM) * up)
    shades: Floats = np.round(mesh.colours * light[:, None])
    return shades


def box(middle: Point, size: Point, colour: Colour, turned_rad: float = 0.0) -> Mesh:
    """A box of full lengths `size`, turned about its own down axis."""
    x, y, z = np.array(size) / 2
    flat = [(x, y), (-x, y), (-x, -y), (x, -y)]
    return _moved(prism([(*corner, 0.0) for corner in flat], 2 * z, colour), middle, turned_rad)


def prism(outline: Sequence[Point], thickness: float, colour: Colour, along: Point = (0.0, 0.0, 1.0)) -> Mesh:
    """A plate: a flat convex outline, made so thick to both sides along a direction."""
    corners, half = np.array(outline, np.float64), np.array(along) * thickness / 2
    return _hull([corners - half, corners + half], [colour])


def disc(middle: Point, radius: float, colour: Colour, along: Point = (0.0, 0.0, 1.0), thickness: float = 0.02) -> Mesh:
    """A flat disc, its axis along a direction: a rotor, a wheel."""
    return prism(outline_of_disc(middle, radius, along)[:-1], thickness, colour, along)


def outline_of_disc(middle: Point, radius: float, along: Point = (0.0, 0.0, 1.0)) -> list[Point]:
    """The edge of a disc, closed."""
    first = np.cross(along, (0.0, 1.0, 0.0) if abs(along[1]) < 0.9 else (0.0, 0.0, 1.0))
    second = np.cross(along, first)
    turns = np.linspace(0, 2 * np.pi, _AROUND + 1)[:, None]
    edge = np.array(middle) + radius * (np.cos(turns) * first + np.sin(turns) * second)
    return [(float(x), float(y), float(z)) for x, y, z in edge]


def loft(sections: Sequence[tuple[float, float, float, float]], colours: Sequence[Colour]) -> Mesh:
    """A hull through elliptic sections: where along forward, half width, half height, and how far down its middle is.

    `colours`: of each piece between two sections, or one for all.
    """
    turns = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    rings = [
        np.column_stack((np.full(_AROUND, x), half_y * np.cos(turns), middle + half_z * np.sin(turns)))
        for x, half_y, half_z, middle in sections
    ]
    return _hull(rings, colours)


def convex(corners: Floats, colour: Colour) -> Mesh:
    """A convex solid by its triangles (n, 3, 3): each is turned so that its corners go round as seen from outside."""
    a, b, c = corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    inward = (normals * (corners.mean(axis=1) - corners.mean(axis=(0, 1)))).sum(axis=1) < 0
    outward = np.where(inward[:, None, None], corners[:, ::-1], corners)
    solid = np.linalg.norm(normals, axis=1) > 1e-12  # a tip's pieces that have no area
    return Mesh(outward[solid], np.tile(np.array(colour, np.float64), (int(solid.sum()), 1)))


def _hull(rings: Sequence[Floats], colours: Sequence[Colour]) -> Mesh:
    """What lies between rings of as many corners, with both ends closed, piece by piece seen from outside."""
    pieces = []
    each = list(colours) * (len(rings) - 1) if len(colours) == 1 else list(colours)
    for i, colour in enumerate(each):
        near, far = rings[i], rings[i + 1]
        sides = [(near, far, np.roll(near, -1, 0)), (np.roll(near, -1, 0), far, np.roll(far, -1, 0))]
        if i == 0:
            sides.append(_lid(near))
        if i == len(each) - 1:
            sides.append(_lid(far))
        pieces.append(convex(np.concatenate([np.stack(side, axis=1) for side in sides]), colour))
    return joined(pieces)


def _lid(ring: Floats) -> tuple[Floats, Floats, Floats]:
    return np.broadcast_to(ring.mean(axis=0), ring.shape), ring, np.roll(ring, -1, 0)


def _moved(mesh: Mesh, by: Point, turned_rad: float) -> Mesh:
    c, s = np.cos(turned_rad), np.sin(turned_rad)
    turn = np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))  # of rows, about down
    return Mesh(mesh.corners @ turn + np.array(by), mesh.colours)
