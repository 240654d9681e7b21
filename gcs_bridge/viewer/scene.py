"""What is drawn: entity paths, and the parts that never change. Where on the screen, says `layout`.

The world is north-east-down, Down drawn downwards. A vehicle is shown twice at one place, as it was sent: solid, as its
quaternion says, and as an outline, as its Euler angles say. While both agree they are one figure. Where they disagree,
the Euler angles' triad stands beside the solid one as a ghost of dashes, without what the firmware makes different on
purpose; an arrow is the axis that the quaternion is turned about, and an arc the way. Once the mistake is known, a thin
triad shows the faulty side without it: it falls onto the other. Beside all hangs what the accelerometer takes for down.
Of a source that sent nothing, nothing is drawn. A viewer writes texts as large from afar as from near, over all else:
so there are few, each where no other can come, and what a colour means is said once, in the legend.

    /                              the world's coordinates
    axes                           north, east, down
    legend                         what has been drawn so far, in its colour
    vehicle/1.1/body               where it is drawn: in a row, wherever it is; where that is, is drawn by `trail`
    vehicle/1.1/body/name          its name and state
    vehicle/1.1/body/compass/…     a rose on the ground, in the vehicle's colour, and the level at its own height
    vehicle/1.1/body/quaternion    attitude by ATTITUDE_QUATERNION: parent from child, world from body
    vehicle/1.1/body/euler         attitude by ATTITUDE
    vehicle/1.1/body/ahrs2         attitude by AHRS2, the second estimate
    vehicle/1.1/body/…/airframe    turned by ATTITUDE_QUATERNION's `repr_offset_q`, which is for displays alone
    vehicle/1.1/body/…/unturned    the same without that turn, hidden until somebody switches it on
    vehicle/1.1/body/…/rates       body rates: the axis turned about by the right hand, 1 m for 1 rad/s
    vehicle/1.1/body/field         magnetic field, in north-east-down
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

from collections.abc import Collection, Iterator, Sequence
from typing import Literal

import numpy as np
import rerun as rr

from gcs_bridge.columns import Floats
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.airframes import Airframe, airframe_of, shape_of
from gcs_bridge.viewer.base import UTC
from gcs_bridge.viewer.below import FRAME
from gcs_bridge.viewer.compass import HORIZON_M, horizon, rose
from gcs_bridge.viewer.palette import ALARM, LEVEL_AXES, OK, UNKNOWN, WARNING
from gcs_bridge.viewer.palette import EULER as _EULER
from gcs_bridge.viewer.palette import QUATERNION as _QUATERNION
from gcs_bridge.viewer.places import GROUND_M, NAME_AT, UNDONE_AT, lift_of, place_of, written_places
from gcs_bridge.viewer.solids import Colour, Point

__all__ = [
    "ANGLES",
    "ARC_M",
    "AXIS_M",
    "DISAGREEMENT",
    "DOWN_M",
    "FIELD_M",
    "LEGEND",
    "MOST_RATE_M",
    "MOTION",
    "RATE_M_PER_RAD_S",
    "UTC",
    "Legend",
    "Part",
    "Source",
    "State",
    "airframe_parts",
    "boot_timeline",
    "corrected_parts",
    "field_parts",
    "ghost_parts",
    "motion_parts",
    "name_tag",
    "path_of",
    "place_airframe_parts",
    "place_parts",
    "source_parts",
    "unturned_parts",
    "vehicle_parts",
    "world_parts",
]

Part = tuple[str, rr.AsComponents]
State = Literal["compared", "not compared", "warning", "alarm"]

ANGLES = ("roll", "pitch", "yaw")

_RED, _GREEN, _BLUE = LEVEL_AXES
_PALE = ((255, 165, 155), (165, 240, 165), (165, 200, 255))
_AXIS, _CORRECTED = (255, 240, 120), (150, 255, 110)
_ACCELEROMETER, _BOUND = (190, 76, 207), (150, 150, 150)
_AHRS2, _FIELD, _RATES = (12, 163, 127), (203, 174, 117), (240, 240, 240)
_HORIZON = (125, 140, 155)

Source = Literal["quaternion", "euler"]
Legend = Literal["quaternion", "euler", "ahrs2", "down", "field", "rates"]
LEGEND: dict[Legend, tuple[str, Colour]] = {  # in the order in which it is written
    "quaternion": ("quaternion", _QUATERNION),
    "euler": ("Euler", _EULER),
    "ahrs2": ("AHRS2", _AHRS2),
    "rates": ("body rates", _RATES),
    "down": ("accelerometer", _ACCELEROMETER),
    "field": ("magnetic field", _FIELD),
}
# Of the vehicles, one after the other; told apart by people who see no red or no green, by lightness if nothing else.
_VEHICLES: tuple[Colour, ...] = (
    (155, 187, 213),
    (0, 97, 158),
    (201, 115, 153),
    (8, 149, 94),
    (242, 240, 230),
    (142, 84, 36),
)
_STATES: dict[State, tuple[str, Colour]] = {
    "compared": ("compared", OK),
    "not compared": ("NO COMPARE", UNKNOWN),
    "warning": ("WARNING", WARNING),
    "alarm": ("ALARM", ALARM),
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

_TRIAD_M = (1.15, 1.0, 0.9)  # forward, right, down
ARC_M = 0.95  # where the arc of a disagreement lies on the axes
AXIS_M = 1.9  # the length of the arrow that it turns about
DOWN_M = 1.15  # the length of the arrows that point down
FIELD_M = 1.3  # the length of the arrow of the magnetic field, whatever its strength
RATE_M_PER_RAD_S = 1.0  # the length of the arrow of the body rates,
MOST_RATE_M = 1.4  # which grows no longer than this

_CORRECTED_M = 1.55  # a triad that is to be seen wherever it falls onto another
_DASHES_A_AXIS = 8
_DASHES = [
    (1.4 * length * (dash + 0.3) / _DASHES_A_AXIS * axis, 1.4 * length * (dash + 0.9) / _DASHES_A_AXIS * axis)
    for length, axis in zip(_TRIAD_M, np.eye(3), strict=True)
    for dash in range(_DASHES_A_AXIS)
]

# Triads beside the solid one reach a little further, each with tips in its own colour: seen even where all agree.
_THIN = {"euler": (1.1, _EULER), "ahrs2": (1.22, _AHRS2)}


def path_of(key: VehicleId, *parts: str) -> str:
    """The entity of a vehicle, or of a part of it.

    >>> path_of(VehicleId(None, 1, 1), "roll", "euler")
    'vehicle/1.1/roll/euler'
    """
    return "/".join(("vehicle", key.name, *parts))


def boot_timeline(boot: int) -> str:
    """The clock of a vehicle's boot, numbered from 0; one after the other they would lie over each other."""
    return f"boot_{boot}" if boot else "boot"


def world_parts(vehicles: int = 1, names: Collection[Legend] = ()) -> Iterator[Part]:
    """The world's coordinates, its labelled axes, and the legend of what is drawn."""
    yield "/", rr.ViewCoordinates.FRD  # x forward, y right, z down: north-east-down to a camera that looks north
    places = written_places(vehicles)
    corner, length = np.array(places.corner), places.axis_m
    vectors = length * np.eye(3)
    colours = [_RED, _GREEN, _BLUE]
    yield "axes", rr.Arrows3D(origins=[corner] * 3, vectors=vectors, colors=colours, radii=0.025 * length)
    yield "axes/labels", _texts(places.tips, ("north", "east", "down"), colours)
    told = [entry for name, entry in LEGEND.items() if name in names]
    texts, colours = [text for text, _ in told], [colour for _, colour in told]
    yield "legend", _texts(places.legend[: len(told)], texts, colours, radius=length / 15)


def vehicle_parts(key: VehicleId, place: int) -> Iterator[Part]:
    """What never changes of a vehicle, whatever it sends; it is the `place`-th, from 0."""
    body = path_of(key, "body")
    yield body, rr.Transform3D(translation=place_of(place))
    lift = lift_of(place)
    yield f"{body}/name", rr.Transform3D(translation=lift)
    if lift[2]:  # a vehicle of the row behind may be nearer to it: a line leads to its own
        to_name = np.array([(0.0, 0.0, -HORIZON_M), np.add(NAME_AT, lift)])
        yield f"{body}/name/post", rr.LineStrips3D([to_name - lift], colors=[_light(place)], radii=0.005)
    for name, lines in rose(GROUND_M):
        width = rr.Radius.ui_points(0.5 if name == "degrees" else 0.8)  # as wide from afar as from near
        yield f"{body}/compass/{name}", rr.LineStrips3D(lines, colors=[_light(place)], radii=width)
    yield f"{body}/compass/horizon", rr.LineStrips3D(horizon(GROUND_M), colors=[_HORIZON], radii=0.005)
    for angle in ANGLES:
        yield path_of(key, angle, "euler"), rr.SeriesLines(names="Euler", colors=_EULER, widths=4.0)
        yield path_of(key, angle, "quaternion"), rr.SeriesLines(names="quaternion", colors=_QUATERNION, widths=1.5)
    colours, widths = zip(*_DISAGREEMENT.values(), strict=True)
    yield path_of(key, "disagreement"), rr.SeriesLines(names=DISAGREEMENT, colors=colours, widths=widths)
    labels, colours = zip(*_STATES.values(), strict=True)
    yield path_of(key, "state"), rr.StateConfiguration(values=list(_STATES), labels=labels, colors=colours)


def source_parts(key: VehicleId, source: Source | Literal["ahrs2"]) -> Iterator[Part]:
    """What turns with the attitudes of a source, from the first of them on; how the vehicle looks comes in addition."""
    path = path_of(key, "body", source)
    vectors = np.diag(_TRIAD_M)
    if source == "quaternion":
        yield f"{path}/axes", rr.Arrows3D(vectors=vectors, colors=[_RED, _GREEN, _BLUE], radii=0.026)
    else:
        reach, colour = _THIN[source]
        tips = reach * vectors
        yield (
            f"{path}/axes",
            rr.LineStrips3D([[(0, 0, 0), tip] for tip in tips], colors=[_RED, _GREEN, _BLUE], radii=0.01),
        )
        yield f"{path}/tips", rr.Points3D(tips, colors=colour, radii=0.03)
    if source != "ahrs2":  # which has no rates
        yield f"{path}/rates", rr.Arrows3D.from_fields(colors=_RATES, radii=0.018 if source == "quaternion" else 0.009)


def airframe_parts(key: VehicleId, place: int, vehicle_type: str, source: Source) -> Iterator[Part]:
    """How a vehicle of a type looks: solid by the quaternion, an outline by the Euler angles."""
    looks, path = airframe_of(shape_of(vehicle_type), _colour(place)), path_of(key, "body", source, "airframe")
    if source == "quaternion":
        yield path, _solid(looks)
    else:
        yield path, rr.LineStrips3D(looks.outline, colors=[_EULER], radii=0.012)


def unturned_parts(key: VehicleId, place: int, vehicle_type: str) -> Iterator[Part]:
    """The same by the quaternion alone, of a vehicle that asks displays to turn it."""
    looks = airframe_of(shape_of(vehicle_type), _colour(place))
    yield (
        path_of(key, "body", "quaternion", "unturned"),
        rr.LineStrips3D(looks.outline, colors=[_colour(place)], radii=0.008),
    )


def place_parts(key: VehicleId, place: int) -> Iterator[Part]:
    """What never changes of a vehicle whose place is known; the trail has its colour, on a map too."""
    colour, wide = _light(place), rr.Radius.ui_points(1.5)  # as wide from afar as from near
    yield path_of(key, "plumb"), rr.LineStrips3D.from_fields(colors=_HORIZON, radii=rr.Radius.ui_points(0.7))
    yield path_of(key, "trail"), rr.LineStrips3D.from_fields(colors=colour, radii=wide)
    yield path_of(key, "geo", "now"), rr.GeoPoints.from_fields(colors=_colour(place), radii=rr.Radius.ui_points(7.0))
    yield (
        path_of(key, "geo", "trail"),
        rr.GeoLineStrings.from_fields(colors=_colour(place), radii=rr.Radius.ui_points(3.0)),
    )


def place_airframe_parts(key: VehicleId, place: int, vehicle_type: str, scale: float) -> Iterator[Part]:
    """How a vehicle looks at its place, `scale` times as large as in the other view, and its name above it."""
    solid = path_of(key, "place", "airframe", "solid")
    yield solid, rr.Transform3D(scale=scale)
    yield solid, _solid(airframe_of(shape_of(vehicle_type), _colour(place)))
    yield path_of(key, "place", "name"), _texts([(0.0, 0.0, -1.5 * scale)], [key.name], [_light(place)])


def field_parts(key: VehicleId) -> Iterator[Part]:
    """How the magnetic field is drawn."""
    yield path_of(key, "body", "field"), rr.Arrows3D.from_fields(colors=_FIELD, radii=0.01)


def ghost_parts(path: str) -> Iterator[Part]:
    """What shows a disagreement, under `path`; its attitudes, axis and arc come at each instant."""
    yield f"{path}/ghost/axes", rr.LineStrips3D(_DASHES, colors=np.repeat(_PALE, _DASHES_A_AXIS, axis=0), radii=0.012)
    yield f"{path}/axis", rr.Arrows3D.from_fields(colors=_AXIS, radii=0.018)
    # Its text has its colour.
    colour = _as_text(_DISAGREEMENT["angle"][0])
    yield f"{path}/arc", rr.LineStrips3D.from_fields(colors=colour, radii=0.016, show_labels=True)


def corrected_parts(key: VehicleId, text: str) -> Iterator[Part]:
    """The triad of an attitude whose mistake is undone; that is said at a place of its own, whatever the attitude."""
    path = path_of(key, "body", "corrected")
    yield f"{path}/axes", rr.Arrows3D(vectors=_CORRECTED_M * np.eye(3), colors=_CORRECTED, radii=0.01)
    yield f"{path}/name", _texts([UNDONE_AT], [text], [_CORRECTED])
    yield f"{path}/name", rr.CoordinateFrame(f"{FRAME}{path_of(key, 'body')}")


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


def name_tag(key: VehicleId, state: State | None) -> rr.Points3D:
    """The vehicle's name and state above it; None: nothing is known of that yet."""
    text, colour = ("", _BOUND) if state is None else _STATES[state]
    return _texts([NAME_AT], [f"{key.name} {text}".strip()], [colour])


def _colour(place: int) -> Colour:
    return _VEHICLES[place % len(_VEHICLES)]


def _light(place: int) -> Colour:
    """The same for thin lines."""
    red, green, blue = ((3 * shade + 255) // 4 for shade in _colour(place))
    return red, green, blue


def _solid(looks: Airframe) -> rr.Mesh3D:
    colours = np.repeat(looks.colours.astype(np.uint8), 3, axis=0)
    return rr.Mesh3D(vertex_positions=looks.corners.reshape(-1, 3), vertex_colors=colours)


def _texts(
    places: Sequence[Point] | Floats, texts: Sequence[str], colours: Sequence[Colour], radius: float = 0.004
) -> rr.Points3D:
    return rr.Points3D(places, labels=texts, colors=list(map(_as_text, colours)), radii=radius, show_labels=True)


def _as_text(colour: Colour) -> Colour:
    """A colour that can be read: light, since in a viewer whose theme is light each text stands on grey."""
    red, green, blue = ((part + 255) // 2 for part in colour)
    return red, green, blue
