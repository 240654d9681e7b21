"""Where on the screen things are shown, and how much of time: rerun calls it a blueprint."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.bodies import BACKGROUND, bodies_view
from gcs_bridge.viewer.horizon import HALF_HEIGHT_DEG
from gcs_bridge.viewer.panels import LEAST_POWER
from gcs_bridge.viewer.scene import ANGLES, path_of
from gcs_bridge.viewer.trail import Reach
from gcs_bridge.viewer.trail_views import trail_views

__all__ = ["layout"]

_ABREAST = 3  # so many vehicles' plots fit side by side
_WINDOW_S = 60  # what a live plot shows
_AROUND_US = 15_000_000  # what is shown before and after a moment that was asked for
_MORE = {  # the tabs beside the angles: their plots, entities and titles
    "motion": {
        "motion/acceleration_h_m_s2": "m/s²: red forward, green right, blue down",
        "motion/velocity_h_m_s": "velocity since rest, m/s",
        "motion/displacement_h_m": "displacement since rest, m",
    },
    "down, heading, rates": {
        "motion/down_apart_deg": "accelerometer's down, degrees off",
        "motion/heading_deg": "heading, degrees",
        "rates_deg_s": "rates, °/s: gyro; pale: attitude",
    },
    "streams": {
        "streams/rate_hz": "messages a second",
        "streams/age_s": "age of the newest, s, at most",
        "streams/lost_percent": "frames lost, percent",
    },
}
_STREAMS = "streams"
_ANGLES = {
    "roll": "roll: orange Euler, blue quaternion",
    "pitch": "pitch, degrees",
    "yaw": "yaw; grey bar below: near the pole",
}
_DISAGREEMENT = (
    "disagreement, degrees: 10ʸ (−2: 0.01°, 0: 1°, 2: 100°): red angle, grey limit, yellow tilt, blue heading"
)
_MOST_DEG = 180.0
_AXES = {"motion/heading_deg": rrb.ScalarAxis(range=(0.0, 360.0))}
_Part = rrb.View | rrb.Container
_HIDDEN = rrb.PlotLegend(visible=False)  # it would cover the curves: the titles tell what is what


def layout(
    vehicles: Mapping[VehicleId, bool],
    timeline: str,
    *,
    live: bool,
    reaches: Mapping[VehicleId, Reach] | None = None,
    around_us: int | None = None,
    at_end: bool = False,
) -> rrb.Blueprint:
    """Everything on one screen: bodies and what the checks say of them on the left, the numbers on the right.

    One vehicle has the screen to itself, with indicator and alarms; of several the numbers are one column each.
    `vehicles`: each, and whether its motion is known. `live`: the last minute is shown, and how the streams arrive.
    `reaches`: where those have been whose places are known: trails and a map are tabs beside the bodies.
    `around_us`: a time on the timeline, to be shown closer: that of an alarm, so its text has more room.
    `at_end`: the cursor starts at the end, not at the beginning; a layout can say no more of it (rerun 0.41).
    """
    span = _span(live=live, around_us=around_us)
    axis = rrb.TimeAxis(link=rrb.components.LinkAxis.Independent, view_range=span)
    plots = _Plots(axis, live=live)
    scene: _Part = bodies_view(vehicles)
    if reaches:
        scene = rrb.Tabs(scene, *trail_views(reaches, live=live), active_tab=0)
    if len(vehicles) == 1:
        ((key, moves),) = vehicles.items()
        page = _alone(key, timeline, plots, scene, moves=moves, alarmed=around_us is not None or at_end)
    else:
        page = _fleet(vehicles, timeline, plots, scene)
    return rrb.Blueprint(
        page,
        rrb.TimePanel(
            timeline=timeline,
            play_state="following" if live or at_end else "playing" if around_us is None else "paused",
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


def _alone(key: VehicleId, timeline: str, plots: _Plots, scene: _Part, *, moves: bool, alarmed: bool) -> rrb.Container:
    beside = rrb.Horizontal(_indicator(key), _alarms(key), column_shares=[1.0, 1.55])
    lanes = ("state", "mode", "verdict/**")
    states = plots.states([f"+ /{path_of(key, lane)}" for lane in lanes])
    left = rrb.Vertical(scene, beside, states, row_shares=[5.2, 3.8 if alarmed else 2.9, 3.3])
    columns = [plots.angles(key), plots.more(key, moves=moves)]
    right = rrb.Vertical(
        rrb.Horizontal(*columns),
        plots.disagreement(key),
        _events([key], timeline),
        row_shares=[5.2, 2.6, 2.8],
    )
    return rrb.Horizontal(left, right, column_shares=[5, 7])


def _fleet(vehicles: Mapping[VehicleId, bool], timeline: str, plots: _Plots, scene: _Part) -> rrb.Container:
    """None, or several: what each comes to on the left, its numbers in a column of its own."""
    states = plots.states([f"+ /{path_of(key, 'state')}" for key in vehicles], "Attitude is …")
    share = 0.7 + 0.5 * min(len(vehicles), 6)
    left = rrb.Vertical(scene, states, _events(list(vehicles), timeline), row_shares=[5.6, share, 2.4])
    columns: list[rrb.Container] = []
    for key, moves in vehicles.items():
        prefix = f"{key.name} "
        beside = rrb.Horizontal(_indicator(key, prefix), _alarms(key, prefix))
        verdicts = plots.states([f"+ /{path_of(key, lane)}" for lane in ("mode", "verdict/**")], f"{prefix}checks")
        numbers = rrb.Tabs(plots.angles(key, prefix), plots.more(key, prefix, moves=moves), verdicts)
        columns.append(
            rrb.Vertical(beside, plots.disagreement(key, prefix), numbers, row_shares=[2.4, 1.8, 5], name=key.name)
        )
    if len(columns) > _ABREAST:
        columns = [rrb.Tabs(*columns)]
    share = 5 if len(columns) <= 1 else 8 / len(columns)
    return rrb.Horizontal(left, *columns, column_shares=[6, *([share] * len(columns))])


def _indicator(key: VehicleId, prefix: str = "") -> rrb.View:
    half = HALF_HEIGHT_DEG
    return rrb.Spatial2DView(
        name=f"{prefix}Horizon",
        origin=f"/{path_of(key, 'horizon')}",
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=(-half, half), y_range=(-half, half)),
    )


def _alarms(key: VehicleId, prefix: str = "") -> rrb.View:
    return rrb.TextDocumentView(name=f"{prefix}Alarms", origin=f"/{path_of(key, 'alarms')}")


def _events(vehicles: Sequence[VehicleId], timeline: str) -> rrb.View:
    return rrb.TextLogView(
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


class _Plots:
    """Plots on one axis of time."""

    def __init__(self, axis: rrb.TimeAxis, *, live: bool) -> None:
        self._axis = axis
        self._live = live

    def states(self, contents: list[str], name: str = "Attitude is …; each check") -> rrb.View:
        return rrb.StateTimelineView(name=name, contents=contents, time_view=self._axis)

    def angles(self, key: VehicleId, prefix: str = "") -> rrb.Container:
        views = [self._plot(f"{prefix}{_ANGLES[angle]}", path_of(key, angle)) for angle in ANGLES]
        return rrb.Vertical(*views, name=f"{prefix}attitude")

    def disagreement(self, key: VehicleId, prefix: str = "") -> rrb.View:
        reach = rrb.ScalarAxis(range=(LEAST_POWER, math.log10(_MOST_DEG) + 0.1), zoom_lock=True)
        return self._plot(f"{prefix}{_DISAGREEMENT}", path_of(key, "disagreement_power"), reach)

    def more(self, key: VehicleId, prefix: str = "", *, moves: bool) -> rrb.Container:
        """Motion, if it is known, and how the streams arrive: the latter first while they do."""
        tabs = _MORE if moves else {_STREAMS: _MORE[_STREAMS]}
        shown = list(tabs).index(_STREAMS) if self._live else 0
        columns = [
            rrb.Vertical(
                *(self._plot(f"{prefix}{title}", path_of(key, path), _AXES.get(path)) for path, title in plots.items()),
                name=name,
            )
            for name, plots in tabs.items()
        ]
        return rrb.Tabs(*columns, active_tab=shown, name=f"{prefix}motion and streams")

    def _plot(self, name: str, path: str, reach: rrb.ScalarAxis | None = None) -> rrb.View:
        return rrb.TimeSeriesView(name=name, origin=f"/{path}", plot_legend=_HIDDEN, axis_x=self._axis, axis_y=reach)


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
