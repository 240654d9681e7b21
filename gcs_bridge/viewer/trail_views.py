"""The views of where vehicles are: their trails in the world, and a map.

A map's tiles come from the internet, by whoever draws them: so the map lies behind a tab that says so, and nothing is
asked for before somebody opens it (rerun 0.41 draws no view that is hidden, and has no map without tiles).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping

import rerun as rr
import rerun.blueprint as rrb

from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.bodies import BACKGROUND, GRID
from gcs_bridge.viewer.earth import Ned
from gcs_bridge.viewer.scene import UTC, boot_timeline, path_of
from gcs_bridge.viewer.trail import Reach

__all__ = ["trail_views"]

_NEAREST_M = 25.0
_FARTHER = 1.3  # of how far the vehicles have come
_FINEST_GRID_M = 5.0
_SQUARES = 8  # of the grid, from one end of the trail to the other
_LIVE_S = 1800
_BOOTS = 16  # whose trails are shown piece by piece
_WEST_DEG, _ABOVE_DEG = 20.0, 32.0  # from where it is looked at: from the south


def trail_views(reaches: Mapping[VehicleId, Reach], *, live: bool) -> list[rrb.View]:
    """The world and the map of vehicles whose places are known, of one at least: between which corners each has been.

    `live`: of the trails the last half hour is shown, else all up to the cursor.
    """
    middle, size_m = _middle(list(reaches.values()))
    so_far = _so_far(live=live)
    distance_m = max(_NEAREST_M, _FARTHER * size_m)
    west, above = math.radians(_WEST_DEG), math.radians(_ABOVE_DEG)
    level_m = distance_m * math.cos(above)
    alone = next(iter(reaches)) if len(reaches) == 1 else None
    square_m = _round(size_m / _SQUARES)
    world = rrb.Spatial3DView(
        name=f"Trail, {square_m:g} m grid",
        origin="/",
        contents=[f"+ /{path_of(key, part)}/**" for key in reaches for part in ("place", "plumb", "trail")],
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(spacing=square_m, plane=rr.encodings.Plane3D((0, 0, 1), 0.0), color=GRID),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(
                middle[0] - level_m * math.cos(west),
                middle[1] - level_m * math.sin(west),
                middle[2] - distance_m * math.sin(above),
            ),
            look_target=middle,
            eye_up=(0, 0, -1),
            # One vehicle is followed; of several all are seen.
            tracking_entity=None if alone is None else f"/{path_of(alone, 'place', 'airframe', 'solid')}",
        ),
        overrides={f"/{path_of(key, 'trail')}": so_far for key in reaches},
    )
    chart = rrb.MapView(
        name="Web map",
        origin="/",
        contents=[f"+ /{path_of(key, 'geo')}/**" for key in reaches],
        background=rrb.MapProvider.OpenStreetMap,
        overrides={f"/{path_of(key, 'geo', 'trail')}": so_far for key in reaches},
    )
    return [world, chart]


def _so_far(*, live: bool) -> rrb.VisibleTimeRanges:
    """Of a trail, what lies before the cursor: all, or of a live link what is not too long ago."""
    edge = rr.TimeRangeBoundary
    start = edge.cursor_relative(seconds=-_LIVE_S) if live else edge.infinite()
    return rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(timeline, start=start, end=edge.cursor_relative())
            for timeline in (UTC, *map(boot_timeline, range(_BOOTS)))
        ]
    )


def _middle(reaches: Collection[Reach]) -> tuple[Ned, float]:
    """The middle of where all have been, and how far that reaches."""
    first, *others = reaches
    whole = first
    for reach in others:
        whole = whole.with_(reach.low).with_(reach.high)
    north, east, down = ((low + high) / 2 for low, high in zip(whole.low, whole.high, strict=True))
    return (north, east, down), whole.size_m


def _round(least_m: float) -> float:
    """The first of 5, 10, 20, 50, 100 … m that is not less."""
    size_m = _FINEST_GRID_M
    for factor in itertools.cycle((2.0, 2.0, 2.5)):
        if size_m >= least_m:
            break
        size_m *= factor
    return size_m
