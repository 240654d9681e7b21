"""An attitude indicator as pilots know it: the vehicle stands still, and the world turns behind it.

x is right and y down, one unit a degree of pitch. In a bank to the right, right wing down, the horizon turns
anticlockwise: its right end rises. Nose up, it sinks. The white ladder is the quaternion's, the orange line that of the
Euler angles, as both were sent. The needle through the ladder's middle points at the bank on the scale above.

    vehicle/1.1/horizon/scale …      what stands still: bank scale and the vehicle's own mark
    vehicle/1.1/horizon/quaternion   how its horizon lies: the turn by −roll, and where its middle is then
    vehicle/1.1/horizon/euler        the same
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from gcs_bridge.columns import Floats
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.palette import EULER, Colour
from gcs_bridge.viewer.rows import Rows
from gcs_bridge.viewer.scene import Part, path_of
from gcs_bridge.viewer.times import Times

__all__ = ["HALF_HEIGHT_DEG", "Horizon", "horizon_parts", "horizon_poses"]

HALF_HEIGHT_DEG = 38.0  # of the picture
_BANKS_DEG = (-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60)
_SCALE_DEG = 31.0  # the radius of the bank scale
_FAR_DEG = 400.0  # beyond the picture, however the world is turned
_STEP_DEG = 0.2  # what turns by less is not drawn anew
_SKY: Colour = (38, 84, 148)
_GROUND: Colour = (104, 74, 44)
_WHITE: Colour = (240, 240, 240)
_CRAFT: Colour = (255, 235, 60)
_PITCHES_DEG = (-80, -60, -40, -20, 20, 40, 60, 80)  # that are written beside their marks


def horizon_poses(roll_deg: Floats, pitch_deg: Floats) -> Floats:
    """Where horizons lie (n, 7): their middle [x, y, 0], and the turn [w, x, y, z] about the axis into the picture.

    >>> horizon_poses(np.array([90.0]), np.array([10.0])).round(3).tolist()
    [[10.0, 0.0, 0.0, 0.707, 0.0, 0.0, -0.707]]
    """
    roll_rad = np.radians(roll_deg)
    none = np.zeros(len(roll_rad))
    half = -roll_rad / 2
    middle = pitch_deg * np.sin(roll_rad), pitch_deg * np.cos(roll_rad), none
    return np.column_stack((*middle, np.cos(half), none, none, np.sin(half)))


def horizon_parts(key: VehicleId) -> Iterator[Part]:
    """All of it that never changes."""
    path = path_of(key, "horizon")
    world = f"{path}/quaternion"
    for name, y, colour, order in (("sky", -_FAR_DEG, _SKY, -20.0), ("ground", _FAR_DEG, _GROUND, -19.0)):
        across = [(-_FAR_DEG, y), (_FAR_DEG, y)]
        yield f"{world}/{name}", rr.LineStrips2D([across], colors=colour, radii=_FAR_DEG, draw_order=order)
    level = [(-_FAR_DEG, 0.0), (_FAR_DEG, 0.0)]
    needle = [(0.0, -_FAR_DEG), (0.0, _FAR_DEG)]
    lines: list[list[tuple[float, float]]] = [level]
    lines += [[(-_reach(p), -float(p)), (_reach(p), -float(p))] for p in range(-85, 90, 5) if p]
    yield f"{world}/ladder", rr.LineStrips2D(lines, colors=_WHITE, radii=[0.35, *[0.2] * (len(lines) - 1)])
    yield f"{world}/needle", rr.LineStrips2D([needle], colors=(*_WHITE, 110), radii=0.15, draw_order=31.0)
    ends = [(14.0, -float(pitch)) for pitch in _PITCHES_DEG]
    texts = [str(pitch) for pitch in _PITCHES_DEG]
    yield f"{world}/degrees", rr.Points2D(ends, labels=texts, colors=_WHITE, radii=0.01, show_labels=True)

    euler = [[(side * 17.0, 0.0), (side * 44.0, 0.0)] for side in (-1, 1)]
    yield f"{path}/euler/level", rr.LineStrips2D(euler, colors=EULER, radii=0.6, draw_order=32.0)

    banks = np.radians(_BANKS_DEG)
    out = np.column_stack((np.sin(banks), -np.cos(banks)))
    long = np.where(np.isin(_BANKS_DEG, (0, -30, 30, -60, 60)), 4.0, 2.5)
    marks = np.stack((_SCALE_DEG * out, (_SCALE_DEG + long[:, None]) * out), axis=1)
    yield f"{path}/scale", rr.LineStrips2D(list(marks), colors=_WHITE, radii=0.3, draw_order=33.0)
    wings = [[(side * 14.0, 0.0), (side * 6.0, 0.0), (side * 6.0, 2.5)] for side in (-1, 1)]
    dot = [(-0.5, 0.0), (0.5, 0.0)]
    yield f"{path}/craft", rr.LineStrips2D([*wings, dot], colors=_CRAFT, radii=0.6, draw_order=34.0)


class Horizon:
    """Follows roll and pitch of one vehicle; what turned by less than the eye sees is not drawn anew."""

    def __init__(self, key: VehicleId) -> None:
        """Start with nothing drawn."""
        self._path = path_of(key, "horizon")
        self._steps: dict[str, Floats] = {}  # of each source: roll and pitch as last seen, in steps

    def feed(self, source: str, times: Times, rpy_deg: Floats) -> Iterator[Rows]:
        """What samples of `source`, "euler" or "quaternion", add: `rpy_deg` (n, 3)."""
        steps = np.round(rpy_deg[:, :2] / _STEP_DEG)
        before = self._steps.get(source, np.full(2, np.nan))
        self._steps[source] = steps[-1]
        rows = np.flatnonzero((np.diff(steps, axis=0, prepend=before[None]) != 0).any(axis=1))
        if len(rows):
            poses = horizon_poses(rpy_deg[rows, 0], rpy_deg[rows, 1])
            yield Rows(times[rows], poses={f"{self._path}/{source}": poses})


def _reach(pitch_deg: int) -> float:
    """Half the width of a mark of the ladder."""
    return 10.0 if pitch_deg % 10 == 0 else 4.0
