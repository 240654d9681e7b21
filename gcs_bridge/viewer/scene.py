"""What is drawn: entity paths, and the parts that never change. Where on the screen, says `layout`.

The world is north-east-down, Down drawn downwards. A vehicle is shown twice at one place, as it was sent: solid, as its
quaternion says, and as an outline, as its Euler angles say. While both agree they are one figure. Where they disagree,
the Euler angles' triad stands beside the solid one as a ghost of dashes, without what the firmware makes different on
purpose; an arrow is the axis that the quaternion is turned about, and an arc the way. Once the mistake is known, a thin
triad shows the faulty side without it: it falls onto the other. Beside all hangs what the accelerometer takes for down.

    /                              the world's coordinates
    axes                           north, east, down
    vehicle/1.1/body               the vehicle's place in the picture (no position is known)
    vehicle/1.1/body/quaternion    attitude by ATTITUDE_QUATERNION: parent from child, world from body
    vehicle/1.1/body/euler         attitude by ATTITUDE
    vehicle/1.1/body/…/airframe    turned by ATTITUDE_QUATERNION's `repr_offset_q`, which is for displays alone
    vehicle/1.1/body/apart/…       ghost, axis and arc (in north-east-down), while apart by more than the limit
    vehicle/1.1/body/corrected     attitude without the mistake, once it is known and while its alarm stands
    vehicle/1.1/roll/euler …       roll, pitch, yaw of both, in degrees
    vehicle/1.1/disagreement       angle and limit, and the angle's parts tilt and heading, in degrees
    vehicle/1.1/state              Euler angles and quaternion are compared, or not; a check's warning or alarm
    vehicle/1.1/body/down/…        down by the attitude and by the accelerometer, in north-east-down
    vehicle/1.1/motion/…           of the inertial samples: see `MOTION`; _h is the level frame
    vehicle/1.1/events             text

Where several links are listened to, a vehicle of another than the first is `vehicle/link2-1.1`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
import rerun as rr

from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.palette import EULER as _EULER
from gcs_bridge.viewer.palette import QUATERNION as _QUATERNION

__all__ = [
    "ANGLES",
    "APART_M",
    "ARC_M",
    "AXIS_M",
    "DISAGREEMENT",
    "DOWN_M",
    "GROUND_M",
    "MOTION",
    "UTC",
    "Part",
    "State",
    "boot_timeline",
    "corrected_parts",
    "ghost_parts",
    "motion_parts",
    "name_tag",
    "path_of",
    "vehicle_parts",
    "world_parts",
]

Part = tuple[str, rr.AsComponents]
State = Literal["compared", "not compared", "warning", "alarm"]
Point = tuple[float, float, float]
Colour = tuple[int, int, int]

UTC = "utc"
ANGLES = ("roll", "pitch", "yaw")

_RED, _GREEN, _BLUE = (230, 70, 60), (70, 200, 80), (70, 130, 255)
_PALE = ((255, 165, 155), (165, 240, 165), (165, 200, 255))
_AXIS, _CORRECTED = (255, 240, 120), (150, 255, 110)
_ACCELEROMETER, _BOUND = (235, 110, 235), (150, 150, 150)
_STATES: dict[State, tuple[str, Colour]] = {
    "compared": ("compared", (67, 160, 71)),
    "not compared": ("NO COMPARE", (255, 179, 0)),
    "warning": ("WARNING", (245, 124, 0)),
    "alarm": ("ALARM", (229, 57, 53)),
}
_DISAGREEMENT = {  # in the order of drawing: colour and width
    "angle": ((239, 83, 80), 4.0),
    "limit": ((190, 190, 190), 1.5),
    "tilt": ((160, 140, 230), 1.0),
    "heading": ((120, 200, 170), 1.0),
}
DISAGREEMENT = tuple(_DISAGREEMENT)

_LEVEL = {"forward": _RED, "right": _GREEN, "down": _BLUE}
_DRIFT = {"+ drift bound": _BOUND, "− drift bound": _BOUND}
_MOTION = {  # entity, its lines and their colours
    "acceleration_h_m_s2": _LEVEL,
    "velocity_h_m_s": _LEVEL | _DRIFT,
    "displacement_h_m": _LEVEL | _DRIFT,
    "down_apart_deg": {"accelerometer's from attitude's": _ACCELEROMETER},
    "heading_deg": {"heading": _QUATERNION},
}
MOTION = tuple(_MOTION)

APART_M = 3.2  # from one vehicle to the next, towards the east
_TRIAD_M = (1.15, 1.0, 0.9)  # forward, right, down
ARC_M = 0.95  # where the arc of a disagreement lies on the axes
AXIS_M = 1.9  # the length of the arrow that it turns about
DOWN_M = 1.15  # the length of the arrows that point down
GROUND_M = 1.0  # the grid lies so far below the vehicles

_CORRECTED_M = 1.55  # a triad that is to be seen wherever it falls onto another
_DASHES_A_AXIS = 8
_DASHES = [
    (1.4 * length * (dash + 0.3) / _DASHES_A_AXIS * axis, 1.4 * length * (dash + 0.9) / _DASHES_A_AXIS * axis)
    for length, axis in zip(_TRIAD_M, np.eye(3), strict=True)
    for dash in range(_DASHES_A_AXIS)
]

# A paper plane in body axes (m): nose, left and right tail, notch, fin.
_NOSE, _LEFT, _RIGHT, _NOTCH, _FIN = (0.8, 0, 0), (-0.6, -0.55, 0), (-0.6, 0.55, 0), (-0.4, 0, 0), (-0.65, 0, -0.35)
_TRIANGLES = ((_NOSE, _RIGHT, _NOTCH), (_NOSE, _NOTCH, _LEFT), (_NOTCH, _FIN, _NOSE))
_SHADES = (0x8FA3B5FF, 0x8FA3B5FF, 0x6F8395FF)
_OUTLINES = ((_NOSE, _RIGHT, _NOTCH, _LEFT, _NOSE), (_NOTCH, _FIN, _NOSE))


def path_of(key: VehicleId, *parts: str) -> str:
    """The entity of a vehicle, or of a part of it.

    >>> path_of(VehicleId(None, 1, 1), "roll", "euler")
    'vehicle/1.1/roll/euler'
    """
    return "/".join(("vehicle", key.name, *parts))


def boot_timeline(boot: int) -> str:
    """The clock of a vehicle's boot, numbered from 0; one after the other they would lie over each other."""
    return f"boot_{boot}" if boot else "boot"


def world_parts() -> Iterator[Part]:
    """The world's coordinates and its labelled axes, which stand on the ground."""
    yield "/", rr.ViewCoordinates.FRD  # x forward, y right, z down: north-east-down to a camera that looks north
    corner = np.array((0.3, -2.0, GROUND_M - 0.6))
    vectors = 0.6 * np.eye(3)
    yield "axes", rr.Arrows3D(origins=[corner] * 3, vectors=vectors, colors=[_RED, _GREEN, _BLUE], radii=0.012)
    yield "axes/labels", _labels(corner + 1.2 * vectors, ("north", "east", "down"))


def vehicle_parts(key: VehicleId, place: int) -> Iterator[Part]:
    """All of a vehicle that never changes; it is the `place`-th, from 0."""
    body = path_of(key, "body")
    yield body, rr.Transform3D(translation=(0, place * APART_M, 0))

    solid = f"{body}/quaternion"
    corners = [corner for triangle in _TRIANGLES for corner in triangle]
    shades = [shade for shade in _SHADES for _ in range(3)]
    yield f"{solid}/airframe", rr.Mesh3D(vertex_positions=corners, vertex_colors=shades)
    vectors = np.diag(_TRIAD_M)
    yield f"{solid}/axes", rr.Arrows3D(vectors=vectors, colors=[_RED, _GREEN, _BLUE], radii=0.026)
    yield f"{solid}/labels", _labels(vectors * 1.1, ("forward", "right", "down"))

    yield f"{body}/euler/airframe", rr.LineStrips3D(_OUTLINES, colors=[_EULER], radii=0.012)

    for angle in ANGLES:
        yield path_of(key, angle, "euler"), rr.SeriesLines(names="Euler", colors=_EULER, widths=4.0)
        yield path_of(key, angle, "quaternion"), rr.SeriesLines(names="quaternion", colors=_QUATERNION, widths=1.5)
    colours, widths = zip(*_DISAGREEMENT.values(), strict=True)
    yield path_of(key, "disagreement"), rr.SeriesLines(names=DISAGREEMENT, colors=colours, widths=widths)
    labels, colours = zip(*_STATES.values(), strict=True)
    yield path_of(key, "state"), rr.StateConfiguration(values=list(_STATES), labels=labels, colors=colours)


def ghost_parts(path: str) -> Iterator[Part]:
    """What shows a disagreement, under `path`; its attitudes, axis and arc come at each instant."""
    yield f"{path}/ghost/axes", rr.LineStrips3D(_DASHES, colors=np.repeat(_PALE, _DASHES_A_AXIS, axis=0), radii=0.012)
    yield f"{path}/axis", rr.Arrows3D.from_fields(colors=_AXIS, radii=0.012)
    yield f"{path}/arc", rr.LineStrips3D.from_fields(colors=_DISAGREEMENT["angle"][0], radii=0.016, show_labels=True)


def corrected_parts(path: str, text: str) -> Iterator[Part]:
    """The triad of an attitude whose mistake is undone, with that said at its right; it is turned by `path`."""
    vectors = _CORRECTED_M * np.eye(3)
    yield f"{path}/axes", rr.Arrows3D(vectors=vectors, colors=_CORRECTED, radii=0.007)
    yield f"{path}/name", rr.Points3D(vectors[1:2], labels=text, colors=_CORRECTED, radii=0.004, show_labels=True)


def motion_parts(key: VehicleId) -> Iterator[Part]:
    """What never changes of a vehicle whose motion is known."""
    down = path_of(key, "body", "down")
    yield f"{down}/attitude", rr.Arrows3D(vectors=[(0, 0, DOWN_M)], colors=_QUATERNION, radii=0.007)
    yield f"{down}/accelerometer", rr.Arrows3D.from_fields(colors=_ACCELEROMETER, radii=0.014)
    for name, lines in _MOTION.items():
        widths = [1.0 if colour == _BOUND else 1.5 for colour in lines.values()]
        yield (
            path_of(key, "motion", name),
            rr.SeriesLines(names=list(lines), colors=list(lines.values()), widths=widths),
        )


def name_tag(key: VehicleId, state: State) -> rr.Points3D:
    """The vehicle's name and state above it."""
    text, colour = _STATES[state]
    return rr.Points3D([(0, 0, -0.75)], labels=f"{key.name} {text}", colors=colour, radii=0.004, show_labels=True)


def _labels(tips: npt.NDArray[np.float64], texts: Sequence[str]) -> rr.Points3D:
    return rr.Points3D(tips, labels=texts, colors=[_RED, _GREEN, _BLUE], radii=0.004, show_labels=True)
