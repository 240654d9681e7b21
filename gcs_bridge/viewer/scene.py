"""What is drawn and where: entity paths, the parts that never change, and the layout.

The world is north-east-down, Down drawn downwards. A vehicle is shown twice at one place: solid, as its quaternion
says, and as an outline with thin, longer axes, as its Euler angles say. While both agree they are one figure; a
disagreement is the angle that opens between them.

    /                              the world's coordinates
    axes                           north, east, down
    vehicle/1.1/body               the vehicle's place in the picture (no position is known)
    vehicle/1.1/body/quaternion    attitude by ATTITUDE_QUATERNION: parent from child, world from body
    vehicle/1.1/body/euler         attitude by ATTITUDE
    vehicle/1.1/roll/euler …       roll, pitch, yaw of both, in degrees
    vehicle/1.1/disagreement       angle and limit, and the angle's parts tilt and heading, in degrees
    vehicle/1.1/comparison         compared, not compared, alarm
    vehicle/1.1/events             text
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

__all__ = [
    "ANGLES",
    "DISAGREEMENT",
    "UTC",
    "Key",
    "Part",
    "State",
    "boot_timeline",
    "layout",
    "name_tag",
    "path_of",
    "vehicle_parts",
    "world_parts",
]

Key = tuple[int, int]  # (system, component)
Part = tuple[str, rr.AsComponents]
State = Literal["compared", "not compared", "alarm"]
Point = tuple[float, float, float]
Colour = tuple[int, int, int]

UTC = "utc"
ANGLES = ("roll", "pitch", "yaw")

_RED, _GREEN, _BLUE = (230, 70, 60), (70, 200, 80), (70, 130, 255)
_PALE = ((255, 165, 155), (165, 240, 165), (165, 200, 255))
_QUATERNION, _EULER = (90, 200, 250), (255, 175, 60)
_STATES: dict[State, tuple[str, Colour]] = {
    "compared": ("compared", (67, 160, 71)),
    "not compared": ("NO COMPARE", (255, 179, 0)),
    "alarm": ("ALARM", (229, 57, 53)),
}
_DISAGREEMENT = {  # in the order of drawing: colour and width
    "angle": ((239, 83, 80), 4.0),
    "limit": ((190, 190, 190), 1.5),
    "tilt": ((160, 140, 230), 1.0),
    "heading": ((120, 200, 170), 1.0),
}
DISAGREEMENT = tuple(_DISAGREEMENT)

_APART_M = 3.2  # from one vehicle to the next, towards the east
_GROUND_M = 1.0  # the grid lies so far below the vehicles
_ABREAST = 3  # so many vehicles' plots fit side by side
_WINDOW_S = 60  # what a live plot shows
_AROUND_US = 15_000_000  # what is shown before and after a moment that was asked for

# A paper plane in body axes (m): nose, left and right tail, notch, fin.
_NOSE, _LEFT, _RIGHT, _NOTCH, _FIN = (0.8, 0, 0), (-0.6, -0.55, 0), (-0.6, 0.55, 0), (-0.4, 0, 0), (-0.65, 0, -0.35)
_TRIANGLES = ((_NOSE, _RIGHT, _NOTCH), (_NOSE, _NOTCH, _LEFT), (_NOTCH, _FIN, _NOSE))
_SHADES = (0x8FA3B5FF, 0x8FA3B5FF, 0x6F8395FF)
_OUTLINES = ((_NOSE, _RIGHT, _NOTCH, _LEFT, _NOSE), (_NOTCH, _FIN, _NOSE))


def path_of(key: Key, *parts: str) -> str:
    """The entity of a vehicle, or of a part of it.

    >>> path_of((1, 1), "roll", "euler")
    'vehicle/1.1/roll/euler'
    """
    return "/".join(("vehicle", f"{key[0]}.{key[1]}", *parts))


def boot_timeline(boot: int) -> str:
    """The clock of a vehicle's boot, numbered from 0; one after the other they would lie over each other."""
    return f"boot_{boot}" if boot else "boot"


def world_parts() -> Iterator[Part]:
    """The world's coordinates and its labelled axes, which stand on the ground."""
    yield "/", rr.ViewCoordinates.FRD  # x forward, y right, z down: north-east-down to a camera that looks north
    corner = np.array((0.3, -2.0, _GROUND_M - 0.6))
    vectors = 0.6 * np.eye(3)
    yield "axes", rr.Arrows3D(origins=[corner] * 3, vectors=vectors, colors=[_RED, _GREEN, _BLUE], radii=0.012)
    yield "axes/labels", _labels(corner + 1.2 * vectors, ("north", "east", "down"))


def vehicle_parts(key: Key, place: int) -> Iterator[Part]:
    """All of a vehicle that never changes; it is the `place`-th, from 0."""
    body = path_of(key, "body")
    yield body, rr.Transform3D(translation=(0, place * _APART_M, 0))

    solid = f"{body}/quaternion"
    corners = [corner for triangle in _TRIANGLES for corner in triangle]
    shades = [shade for shade in _SHADES for _ in range(3)]
    yield f"{solid}/airframe", rr.Mesh3D(vertex_positions=corners, vertex_colors=shades)
    vectors = np.diag((1.15, 1.0, 0.9))
    yield f"{solid}/axes", rr.Arrows3D(vectors=vectors, colors=[_RED, _GREEN, _BLUE], radii=0.026)
    yield f"{solid}/labels", _labels(vectors * 1.1, ("forward", "right", "down"))

    outline = f"{body}/euler"
    yield f"{outline}/airframe", rr.LineStrips3D(_OUTLINES, colors=[_EULER], radii=0.012)
    yield f"{outline}/axes", rr.Arrows3D(vectors=1.35 * vectors, colors=_PALE, radii=0.009)

    for angle in ANGLES:
        yield path_of(key, angle, "euler"), rr.SeriesLines(names="Euler", colors=_EULER, widths=4.0)
        yield path_of(key, angle, "quaternion"), rr.SeriesLines(names="quaternion", colors=_QUATERNION, widths=1.5)
    colours, widths = zip(*_DISAGREEMENT.values(), strict=True)
    yield path_of(key, "disagreement"), rr.SeriesLines(names=DISAGREEMENT, colors=colours, widths=widths)
    labels, colours = zip(*_STATES.values(), strict=True)
    yield path_of(key, "comparison"), rr.StateConfiguration(values=list(_STATES), labels=labels, colors=colours)


def name_tag(key: Key, state: State) -> rr.Points3D:
    """The vehicle's name above it, and how its two attitudes compare."""
    text, colour = _STATES[state]
    return rr.Points3D(
        [(0, 0, -0.75)], labels=f"{key[0]}.{key[1]} {text}", colors=colour, radii=0.004, show_labels=True
    )


def layout(vehicles: Sequence[Key], timeline: str, *, live: bool, around_us: int | None = None) -> rrb.Blueprint:
    """Everything on one screen: bodies, comparison and events on the left, each vehicle's numbers on the right.

    `around_us`: a time on the timeline, to be shown closer.
    """
    bodies = rrb.Spatial3DView(
        name="Attitude: solid by the quaternion, outline by the Euler angles",
        origin="/",
        contents=["+ /axes/**", *(f"+ /{path_of(key, 'body')}/**" for key in vehicles)],
        background=rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=(24, 28, 34)),
        line_grid=rrb.LineGrid3D(
            spacing=0.5, plane=rr.encodings.Plane3D((0, 0, 1), _GROUND_M), color=(70, 80, 95, 160)
        ),
        eye_controls=_camera(len(vehicles)),
    )
    span = _span(live=live, around_us=around_us)
    axis = rrb.TimeAxis(link=rrb.components.LinkAxis.Independent, view_range=span)
    states = rrb.StateTimelineView(
        name="Euler angles and quaternion are …",
        contents=[f"+ /{path_of(key, 'comparison')}" for key in vehicles],
        time_view=axis,
    )
    events = rrb.TextLogView(
        name="Events",
        contents=["+ /link/events", *(f"+ /{path_of(key, 'events')}" for key in vehicles)],
        # Each line tells its time and vehicle; rerun's own columns for them are too narrow to read.
        columns=rrb.TextLogColumns(
            timeline_columns=[TimelineColumn(timeline, visible=False)],
            text_log_columns=[
                TextLogColumn("EntityPath", visible=False),
                TextLogColumn("LogLevel"),
                TextLogColumn("Body"),
            ],
        ),
    )
    left = rrb.Vertical(bodies, states, events, row_shares=[6, 0.6 + 0.5 * len(vehicles), 2.2])
    numbers = [_numbers(key, axis, named=len(vehicles) > 1) for key in vehicles]
    columns = numbers if len(numbers) <= _ABREAST else [rrb.Tabs(*numbers)]
    return rrb.Blueprint(
        rrb.Horizontal(
            left, *columns, column_shares=[6, *([5 if len(columns) <= 1 else 8 / len(columns)] * len(columns))]
        ),
        rrb.TimePanel(
            timeline=timeline,
            play_state="following" if live else "paused" if around_us else "playing",
            time_selection=None
            if around_us is None
            else rrb.components.AbsoluteTimeRange((around_us - _AROUND_US) * 1000, (around_us + _AROUND_US) * 1000),
            state="collapsed",
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _numbers(key: Key, axis: rrb.TimeAxis, *, named: bool) -> rrb.Vertical:
    prefix = f"{key[0]}.{key[1]} " if named else ""
    views = [
        rrb.TimeSeriesView(
            name=f"{prefix}{name}, degrees",
            origin=f"/{path_of(key, name)}",
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
            axis_x=axis,
        )
        for name in (*ANGLES, "disagreement")
    ]
    return rrb.Vertical(*views, row_shares=[1, 1, 1, 1.4], name=f"{key[0]}.{key[1]}")


def _span(*, live: bool, around_us: int | None) -> rr.TimeRange:
    """What the plots show: the last minute, the whole, or what lies around a moment."""
    edge = rr.TimeRangeBoundary
    if live:
        return rr.TimeRange(start=edge.cursor_relative(seconds=-_WINDOW_S), end=edge.cursor_relative())
    if around_us is None:
        return rr.TimeRange(start=edge.infinite(), end=edge.infinite())
    return rr.TimeRange(
        start=edge.absolute(nanos=(around_us - _AROUND_US) * 1000),
        end=edge.absolute(nanos=(around_us + _AROUND_US) * 1000),
    )


def _camera(vehicles: int) -> rrb.EyeControls3D:
    """From the south-west and above, north away from the eye; the further off the more vehicles there are."""
    more = max(vehicles - 1, 0)
    middle = (more * _APART_M - 0.5) / 2  # between the world's axes and the last vehicle
    back = 1 + 1.2 * more
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=(-2.4 * back, middle - 0.55 * back, -1.5 * back),
        look_target=(0, middle, 0.2),
        eye_up=(0, 0, -1),
    )


def _labels(tips: npt.NDArray[np.float64], texts: Sequence[str]) -> rr.Points3D:
    return rr.Points3D(tips, labels=texts, colors=[_RED, _GREEN, _BLUE], radii=0.004, show_labels=True)
