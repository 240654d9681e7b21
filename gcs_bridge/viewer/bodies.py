"""The view of the bodies: what of the scene it shows, and from where."""

from __future__ import annotations

from collections.abc import Collection

import rerun as rr
import rerun.blueprint as rrb

from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.places import GROUND_M, eye_of
from gcs_bridge.viewer.scene import path_of

__all__ = ["BACKGROUND", "GRID", "bodies_view"]

BACKGROUND = rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=(24, 28, 34))
GRID = (70, 80, 95, 110)


def bodies_view(vehicles: Collection[VehicleId]) -> rrb.Spatial3DView:
    """All vehicles in one world; what is hidden can be shown by the eye beside it in the viewer's list of entities."""
    eye = eye_of(len(vehicles))
    unturned = [f"/{path_of(key, 'body', 'quaternion', 'unturned')}" for key in vehicles]
    return rrb.Spatial3DView(
        name="Red nose, green right, blue down",
        origin="/",
        contents=["+ /axes/**", "+ /legend", *(f"+ /{path_of(key, 'body')}/**" for key in vehicles)],
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(spacing=0.5, plane=rr.encodings.Plane3D((0, 0, 1), GROUND_M), color=GRID),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye.position, look_target=eye.target, eye_up=(0, 0, -1)
        ),
        overrides={path: rrb.EntityBehavior(visible=False) for path in unturned},
    )
