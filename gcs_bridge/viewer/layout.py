"""Where on the screen things are shown, and how much of time: rerun calls it a blueprint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.bodies import bodies_view
from gcs_bridge.viewer.scene import ANGLES, MOTION, path_of

__all__ = ["layout"]

_ABREAST = 3  # so many vehicles' plots fit side by side
_WINDOW_S = 60  # what a live plot shows
_AROUND_US = 15_000_000  # what is shown before and after a moment that was asked for
_TITLES = (
    "acceleration, level frame, m/s²",
    "velocity since rest ± drift, m/s; blank: no rest yet",
    "displacement since rest ± drift, m; blank: no rest yet",
    "down: accelerometer from attitude, degrees",
    "heading, degrees",
)
_WITH_LEGEND = "acceleration_h_m_s2"  # the two below it have the same colours
_AXES = {"heading_deg": rrb.ScalarAxis(range=(0.0, 360.0))}


def layout(
    vehicles: Mapping[VehicleId, bool], timeline: str, *, live: bool, around_us: int | None = None, at_end: bool = False
) -> rrb.Blueprint:
    """Everything on one screen: bodies, comparison and events on the left, each vehicle's numbers on the right.

    `vehicles`: each, and whether its motion is known. `around_us`: a time on the timeline, to be shown closer.
    `at_end`: the cursor starts at the end, not at the beginning; a layout can say no more of it (rerun 0.41).
    """
    bodies = bodies_view(vehicles)
    span = _span(live=live, around_us=around_us)
    axis = rrb.TimeAxis(link=rrb.components.LinkAxis.Independent, view_range=span)
    states = rrb.StateTimelineView(
        name="Attitude is …",
        contents=[f"+ /{path_of(key, 'state')}" for key in vehicles],
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
    columns = _columns(vehicles, axis)
    share = 5 if len(columns) <= 1 else 8 / len(columns)
    return rrb.Blueprint(
        rrb.Horizontal(left, *columns, column_shares=[6, *([share] * len(columns))]),
        rrb.TimePanel(
            timeline=timeline,
            play_state="following" if live or at_end else "paused" if around_us else "playing",
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


def _columns(vehicles: Mapping[VehicleId, bool], axis: rrb.TimeAxis) -> list[rrb.Container]:
    """One vehicle's plots side by side; of several, one behind the other, and the vehicles side by side."""
    if len(vehicles) == 1:
        ((key, moves),) = vehicles.items()
        return list(_numbers(key, axis, moves=moves))
    columns: list[rrb.Container] = []
    for key, moves in vehicles.items():
        name = key.name
        columns.append(rrb.Tabs(*_numbers(key, axis, moves=moves, prefix=f"{name} "), name=name))
    return columns if len(columns) <= _ABREAST else [rrb.Tabs(*columns)]


def _numbers(key: VehicleId, axis: rrb.TimeAxis, *, moves: bool, prefix: str = "") -> Iterator[rrb.Vertical]:
    """A vehicle's angles and, if it `moves`, its motion: a column each."""
    angles = [
        rrb.TimeSeriesView(
            name=f"{prefix}{name}, degrees",
            origin=f"/{path_of(key, name)}",
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
            axis_x=axis,
        )
        for name in (*ANGLES, "disagreement")
    ]
    yield rrb.Vertical(*angles, row_shares=[1, 1, 1, 1.4], name=f"{prefix}attitude")
    if moves:
        motion = [
            rrb.TimeSeriesView(
                name=f"{prefix}{title}",
                origin=f"/{path_of(key, 'motion', entity)}",
                plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=entity == _WITH_LEGEND),
                axis_x=axis,
                axis_y=_AXES.get(entity),
            )
            for entity, title in zip(MOTION, _TITLES, strict=True)
        ]
        yield rrb.Vertical(*motion, name=f"{prefix}motion")


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
