"""The frame conventions in which a result can be given: NED with FRD, and what each other one makes of it (M24)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude import (
    enu_flu_from_ned_frd,
    enu_flu_rpy_from_ned_frd,
    enu_from_ned,
    enu_rfu_from_ned_frd,
    flu_from_frd,
    frd_from_flu,
    frd_from_rfu,
    ned_frd_from_enu_flu,
    ned_frd_from_enu_rfu,
    ned_frd_rpy_from_enu_flu,
    rfu_from_frd,
)

__all__ = ["FRAMES", "Frame"]
_Array = npt.NDArray[np.float64]
_Convert = Callable[[npt.ArrayLike], _Array]


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A body frame in a world frame, with the conversions from NED and FRD and back; arrays as in `attitude`.

    Roll, pitch, yaw are what users of the convention mean by these words, told in `rpy_means`. `turns` says how they
    make the matrix, as a product from the left: axis, index of the angle, its sign. `rpy_signs`: of their rates,
    against those in NED and FRD.
    """

    world: str
    body: str
    world_axes: tuple[str, str, str]
    body_axes: tuple[str, str, str]
    rpy_means: str
    turns: tuple[tuple[str, int, float], ...]
    rpy_signs: tuple[float, float, float] = (1.0, 1.0, 1.0)
    q_from_ned_frd: _Convert
    ned_frd_from_q: _Convert
    rpy_from_ned_frd: _Convert
    ned_frd_from_rpy: _Convert
    world_from_ned: _Convert
    body_from_frd: _Convert
    frd_from_body: _Convert

    @property
    def name(self) -> str:
        """As in `--frame`."""
        return f"{self.world}_{self.body}"


def _same(values: npt.ArrayLike) -> _Array:
    return np.asarray(values, np.float64)


_ZYX = (("z", 2, 1.0), ("y", 1, 1.0), ("x", 0, 1.0))
_ZXY_HEADING = (("z", 2, -1.0), ("x", 1, 1.0), ("y", 0, 1.0))  # the heading stays clockwise, though z points up
_ROWS = (
    Frame(
        world="ned",
        body="frd",
        world_axes=("north", "east", "down"),
        body_axes=("forward", "right", "down"),
        rpy_means="yaw clockwise from north, pitch positive with the nose up",
        turns=_ZYX,
        q_from_ned_frd=_same,
        ned_frd_from_q=_same,
        rpy_from_ned_frd=_same,
        ned_frd_from_rpy=_same,
        world_from_ned=_same,
        body_from_frd=_same,
        frd_from_body=_same,
    ),
    Frame(
        world="enu",
        body="flu",
        world_axes=("east", "north", "up"),
        body_axes=("forward", "left", "up"),
        rpy_means="yaw anticlockwise from east, pitch positive with the nose down (as in ROS)",
        turns=_ZYX,
        rpy_signs=(1.0, -1.0, -1.0),
        q_from_ned_frd=enu_flu_from_ned_frd,
        ned_frd_from_q=ned_frd_from_enu_flu,
        rpy_from_ned_frd=enu_flu_rpy_from_ned_frd,
        ned_frd_from_rpy=ned_frd_rpy_from_enu_flu,
        world_from_ned=enu_from_ned,
        body_from_frd=flu_from_frd,
        frd_from_body=frd_from_flu,
    ),
    Frame(
        world="enu",
        body="rfu",
        world_axes=("east", "north", "up"),
        body_axes=("right", "forward", "up"),
        rpy_means="yaw clockwise from north, pitch positive with the nose up: the numbers of ned_frd",
        turns=_ZXY_HEADING,
        q_from_ned_frd=enu_rfu_from_ned_frd,
        ned_frd_from_q=ned_frd_from_enu_rfu,
        rpy_from_ned_frd=_same,  # M24: roll, pitch, heading are the same three numbers
        ned_frd_from_rpy=_same,
        world_from_ned=enu_from_ned,
        body_from_frd=rfu_from_frd,
        frd_from_body=frd_from_rfu,
    ),
)
FRAMES: Mapping[str, Frame] = MappingProxyType({frame.name: frame for frame in _ROWS})
"""Every convention by its name."""
