"""What a vehicle looks like, by the type that its HEARTBEAT names: a solid, and its outline.

Each is built so that front, back, top and bottom cannot be taken for each other: its nose is pointed and yellow,
whatever the vehicle's own colour is, its rear rotors and tails are dark, and its bottom is in the shade (`solids`).
All in body axes (forward, right, down), m.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from gcs_bridge.columns import Floats
from gcs_bridge.viewer.solids import (
    Colour,
    Mesh,
    Point,
    box,
    convex,
    disc,
    joined,
    loft,
    outline_of_disc,
    prism,
    shaded,
)

__all__ = ["NOSE", "Airframe", "airframe_of", "shape_of"]

NOSE: Colour = (250, 212, 45)
_DARK: Colour = (62, 70, 80)
_GLASS: Colour = (40, 48, 60)

_ROTORS = {  # MAV_TYPE, and how many rotors it has
    "tricopter": 3,
    "quadrotor": 4,
    "hexarotor": 6,
    "octorotor": 8,
    "decarotor": 10,
    "dodecarotor": 12,
    "generic_multirotor": 4,
}
_OTHERS = {
    "fixed_wing": "plane",
    "flapping_wing": "plane",
    "coaxial": "helicopter",
    "helicopter": "helicopter",
    "ground_rover": "rover",
    "ground_quadruped": "rover",
    "surface_boat": "boat",
    "submarine": "submarine",
}
# Names of MAV_TYPE 19, 20 and 23 in today's common.xml, and in older ones.
_TAILSITTERS = frozenset({"vtol_tailsitter_duorotor", "vtol_tailsitter_quadrotor", "vtol_tailsitter"}) | {
    "vtol_duorotor",
    "vtol_quadrotor",
}


@dataclass(frozen=True)
class Airframe:
    """Triangles `corners` (n, 3, 3) with the `colours` (n, 3) of each, 0 to 255; and lines that outline it."""

    corners: Floats
    colours: Floats
    outline: list[list[Point]]


def shape_of(vehicle_type: str) -> str:
    """Which shape stands for a type, as the report names it: "multirotor 4", "plane", …, or "other".

    >>> shape_of("hexarotor"), shape_of("vtol_tiltrotor"), shape_of("unknown")
    ('multirotor 6', 'vtol', 'other')
    """
    if rotors := _ROTORS.get(vehicle_type):
        return f"multirotor {rotors}"
    if vehicle_type in _TAILSITTERS:
        return "tailsitter"
    return "vtol" if vehicle_type.startswith("vtol_") else _OTHERS.get(vehicle_type, "other")


@cache
def airframe_of(shape: str, colour: Colour) -> Airframe:
    """The solid of a shape that `shape_of` names, in the vehicle's colour."""
    name, _, rotors = shape.partition(" ")
    parts = list(_multirotor(int(rotors), colour) if rotors else _SHAPES[name](colour))
    mesh = joined(mesh for mesh, _ in parts)
    return Airframe(mesh.corners, shaded(mesh), [line for _, lines in parts for line in lines])


Parts = Iterator[tuple[Mesh, list[list[Point]]]]


def _multirotor(rotors: int, colour: Colour) -> Parts:
    """Arms to all sides, those in front with yellow rotors; a wedge from the hub points forward."""
    rotor_m = min(0.3, 0.6 * math.sin(math.pi / rotors) * 0.9)
    yield box((0.0, 0.0, 0.0), (0.34, 0.24, 0.14), colour), []
    yield _wedge(0.17, 0.66, 0.12)
    first = math.pi if rotors % 2 else math.pi / rotors  # of an odd number one is behind
    for arm in range(rotors):
        turn = first + arm * 2 * math.pi / rotors
        along = np.array((math.cos(turn), math.sin(turn), 0.0))
        x, y, _ = (0.6 * along).tolist()
        ahead = along[0] > 0.3
        yield box((x / 2, y / 2, 0.0), (0.6, 0.06, 0.05), colour, turn), []
        hub: Point = (x, y, -0.09)
        yield disc(hub, rotor_m, NOSE if ahead else _DARK), [outline_of_disc(hub, rotor_m), [(0.0, 0.0, 0.0), hub]]
        yield box((x, y, -0.04), (0.08, 0.08, 0.1), colour), []


def _wedge(tail_m: float, tip_m: float, half_m: float, down_m: float = 0.0) -> tuple[Mesh, list[list[Point]]]:
    """A yellow point in front."""
    edge: list[Point] = [(tip_m, 0.0, down_m), (tail_m, half_m, down_m), (tail_m, -half_m, down_m)]
    return prism(edge, 0.08, NOSE), [[*edge, edge[0]]]


def _fuselage(colour: Colour) -> tuple[Mesh, list[list[Point]]]:
    sections = [(0.8, 0.005, 0.005, 0.02), (0.5, 0.09, 0.09, 0.0), (0.2, 0.11, 0.11, 0.0), (-0.75, 0.03, 0.03, -0.03)]
    return loft(sections, [NOSE, colour, colour]), []


def _plane(colour: Colour, *, tail: bool = True) -> Parts:
    """Straight wings, a tail behind them, a yellow nose."""
    yield _fuselage(colour)
    wing: list[Point] = [(0.22, 0.0, 0.0), (0.12, 0.95, 0.0), (-0.08, 0.95, 0.0), (-0.14, 0.0, 0.0)]
    yield from _both_sides(wing, colour)
    if tail:
        yield from _both_sides(
            [(-0.52, 0.0, -0.03), (-0.6, 0.34, -0.03), (-0.74, 0.34, -0.03), (-0.74, 0.0, -0.03)], _DARK
        )
    fin: list[Point] = [(-0.48, 0.0, -0.03), (-0.66, 0.0, -0.36), (-0.78, 0.0, -0.36), (-0.74, 0.0, -0.03)]
    yield prism(fin, 0.03, _DARK, (0.0, 1.0, 0.0)), [fin, [(0.8, 0.0, 0.02), (-0.75, 0.0, -0.03)]]


def _both_sides(half: list[Point], colour: Colour) -> Parts:
    """A wing: its right half, and the left one."""
    for side in (1.0, -1.0):
        edge: list[Point] = [(x, side * y, z) for x, y, z in half]
        yield prism(edge, 0.03, colour), [edge]


def _vtol(colour: Colour) -> Parts:
    """A plane with four lifting rotors on booms, the front ones yellow."""
    yield from _plane(colour)
    for y in (-0.46, 0.46):
        yield box((0.03, y, -0.03), (0.95, 0.05, 0.05), colour), []
        for x, rotor in ((0.46, NOSE), (-0.4, _DARK)):
            yield disc((x, y, -0.1), 0.2, rotor), [outline_of_disc((x, y, -0.1), 0.2)]


def _tailsitter(colour: Colour) -> Parts:
    """A flying wing that stands on its tips, and pulls itself forward by two yellow rotors."""
    sections = [(0.62, 0.01, 0.01, 0.0), (0.36, 0.12, 0.1, 0.0), (-0.4, 0.06, 0.05, 0.0)]
    yield loft(sections, [NOSE, colour]), []
    wing: list[Point] = [(0.34, 0.0, 0.0), (0.05, 0.9, 0.0), (-0.42, 0.9, 0.0), (-0.34, 0.0, 0.0)]
    yield from _both_sides(wing, colour)
    for y in (-0.45, 0.45):
        hub: Point = (0.36, y, 0.0)
        yield disc(hub, 0.27, NOSE, (1.0, 0.0, 0.0)), [outline_of_disc(hub, 0.27, (1.0, 0.0, 0.0))]
    for y in (-0.9, 0.9):
        fin: list[Point] = [(0.0, y, 0.0), (-0.3, y, -0.26), (-0.55, y, -0.26), (-0.42, y, 0.0)]
        yield prism(fin, 0.03, _DARK, (0.0, 1.0, 0.0)), [[*fin, fin[0]]]


def _helicopter(colour: Colour) -> Parts:
    """A cabin with a boom, one rotor above, a small one behind."""
    sections = [(0.85, 0.01, 0.01, 0.05), (0.5, 0.13, 0.12, 0.03), (-0.1, 0.18, 0.17, 0.0), (-0.35, 0.05, 0.05, -0.05)]
    yield loft(sections, [NOSE, colour, colour]), [[(0.85, 0.0, 0.05), (0.1, 0.18, 0.0), (-0.35, 0.0, -0.05)]]
    yield (
        box((-0.6, 0.0, -0.07), (0.6, 0.06, 0.06), colour),
        [[(0.85, 0.0, 0.05), (0.1, -0.18, 0.0), (-0.9, 0.0, -0.07)]],
    )
    yield disc((0.0, 0.0, -0.27), 0.5, _DARK), [outline_of_disc((0.0, 0.0, -0.27), 0.5)]
    yield box((0.0, 0.0, -0.2), (0.06, 0.06, 0.14), colour), []
    sideways: Point = (0.0, 1.0, 0.0)
    yield disc((-0.88, 0.05, -0.1), 0.15, _DARK, sideways), [outline_of_disc((-0.88, 0.05, -0.1), 0.15, sideways)]
    for y in (-0.18, 0.18):
        yield box((0.05, y, 0.24), (0.7, 0.04, 0.03), _DARK), []


def _rover(colour: Colour) -> Parts:
    """A car on four wheels: a cabin behind, a yellow bonnet in front."""
    base: list[Point] = [(0.32, 0.3, 0.0), (0.32, -0.3, 0.0), (-0.6, -0.3, 0.0), (-0.6, 0.3, 0.0)]
    yield prism(base, 0.2, colour), [[*base, base[0]]]
    bonnet: list[Point] = [(0.78, 0.1, 0.0), (0.78, -0.1, 0.0), (0.32, -0.3, 0.0), (0.32, 0.3, 0.0)]
    yield prism(bonnet, 0.14, NOSE), [bonnet]
    yield box((-0.2, 0.0, -0.2), (0.5, 0.46, 0.2), colour), []
    yield box((0.06, 0.0, -0.2), (0.03, 0.4, 0.14), _GLASS), []
    for x in (0.4, -0.4):
        for y in (-0.36, 0.36):
            wheel: Point = (x, y, 0.1)
            across: Point = (0.0, 1.0, 0.0)
            yield disc(wheel, 0.19, _DARK, across, 0.12), [outline_of_disc(wheel, 0.19, across)]


def _boat(colour: Colour) -> Parts:
    """A hull with a keel, pointed and yellow in front, a cabin behind."""
    deck: list[Point] = [
        (0.85, 0.0, -0.12),
        (0.3, 0.28, -0.08),
        (-0.7, 0.25, -0.08),
        (-0.7, -0.25, -0.08),
        (0.3, -0.28, -0.08),
    ]
    bow = _flat_hull([(0.85, 0.01, -0.12, -0.04), (0.3, 0.28, -0.08, 0.2)], NOSE)
    stern = _flat_hull([(0.3, 0.28, -0.08, 0.2), (-0.7, 0.25, -0.08, 0.18)], colour)
    yield joined((bow, stern)), [[*deck, deck[0]], [deck[0], (0.3, 0.0, 0.2), (-0.7, 0.0, 0.18)]]
    yield box((-0.3, 0.0, -0.2), (0.42, 0.3, 0.24), colour), []
    yield box((-0.08, 0.0, -0.22), (0.03, 0.26, 0.14), _GLASS), []
    yield box((-0.42, 0.0, -0.44), (0.03, 0.03, 0.26), _DARK), []


def _flat_hull(sections: list[tuple[float, float, float, float]], colour: Colour) -> Mesh:
    """Between triangles: where along forward, half width of the deck, the deck's and the keel's place down."""
    (x1, w1, d1, k1), (x2, w2, d2, k2) = sections
    near = [(x1, w1, d1), (x1, -w1, d1), (x1, 0.0, k1)]
    far = [(x2, w2, d2), (x2, -w2, d2), (x2, 0.0, k2)]
    faces = [
        (near[0], near[1], far[1], far[0]),  # deck
        (near[0], near[2], far[2], far[0]),
        (near[1], near[2], far[2], far[1]),
    ]
    triangles = [corners for a, b, c, d in faces for corners in ((a, b, c), (a, c, d))]
    return convex(np.array([*triangles, near, far], np.float64), colour)


def _submarine(colour: Colour) -> Parts:
    """A long hull, yellow in front, with a sail above and a cross of rudders behind."""
    sections = [
        (0.8, 0.02, 0.02, 0.0),
        (0.62, 0.16, 0.16, 0.0),
        (0.4, 0.2, 0.2, 0.0),
        (-0.3, 0.2, 0.2, 0.0),
        (-0.8, 0.03, 0.03, 0.0),
    ]
    sides: list[list[Point]] = [[(x, side * half, 0.0) for x, half, _, _ in sections] for side in (1.0, -1.0)]
    yield loft(sections, [NOSE, NOSE, colour, colour]), sides
    yield (
        box((0.1, 0.0, -0.27), (0.34, 0.1, 0.22), colour),
        [[(0.27, 0.0, -0.2), (0.27, 0.0, -0.38), (-0.07, 0.0, -0.38), (-0.07, 0.0, -0.2)]],
    )
    rudders: list[Point] = [(-0.62, -0.32, 0.0), (-0.62, 0.32, 0.0), (-0.76, 0.32, 0.0), (-0.76, -0.32, 0.0)]
    yield prism(rudders, 0.03, _DARK), [[*rudders, rudders[0]]]
    yield prism([(x, 0.0, y) for x, y, _ in rudders], 0.03, _DARK, (0.0, 1.0, 0.0)), []
    yield disc((-0.84, 0.0, 0.0), 0.14, _DARK, (1.0, 0.0, 0.0)), []


def _other(colour: Colour) -> Parts:
    """A dart with a fin and a yellow tip: nobody said what it is."""
    notch: Point = (-0.4, 0.0, 0.0)
    for side in (1.0, -1.0):
        half: list[Point] = [(0.5, side * 0.13, 0.0), (-0.6, side * 0.55, 0.0), notch, (0.5, 0.0, 0.0)]
        yield prism(half, 0.03, colour), [[(0.8, 0.0, 0.0), (-0.6, side * 0.55, 0.0), notch]]
    yield _wedge(0.5, 0.8, 0.13)
    fin: list[Point] = [(0.1, 0.0, 0.0), (-0.65, 0.0, -0.35), notch]
    yield prism(fin, 0.03, _DARK, (0.0, 1.0, 0.0)), [fin]


_SHAPES: dict[str, Callable[[Colour], Parts]] = {
    "plane": _plane,
    "vtol": _vtol,
    "tailsitter": _tailsitter,
    "helicopter": _helicopter,
    "rover": _rover,
    "boat": _boat,
    "submarine": _submarine,
    "other": _other,
}
