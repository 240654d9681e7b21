"""The frames in which attitudes can be written, and how the columns of each are named (CONVENTIONS.md, M20 to M24)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats

__all__ = ["CONVENTIONS", "Convention"]


def _as_it_is(rows: Floats) -> Floats:
    return rows


def _rpy_from_enu_rfu(q: Floats) -> Floats:
    return np.asarray(attitude.rpy_from_enu_rfu_matrix(attitude.matrix_from_quaternion(q)))


@dataclass(frozen=True)
class Convention:
    """A world and a body frame; what takes attitudes (n, 4) and vectors of the body (n, 3) there from NED and FRD."""

    name: str
    q: str  # how an attitude's columns begin
    body: str  # how the body's frame is named in a vector's columns
    world: str
    attitude: Callable[[Floats], Floats]
    vector: Callable[[Floats], Floats]
    rpy_rad: Callable[[Floats], Floats]
    meaning: str


CONVENTIONS = {
    one.name: one
    for one in (
        Convention(
            name="ned_frd",
            q="q_nb",
            body="b",
            world="ned",
            attitude=_as_it_is,
            vector=_as_it_is,
            rpy_rad=attitude.rpy_from_quaternion,
            meaning="forward-right-down body axes to north-east-down, as MAVLink sends it; yaw from north to the east",
        ),
        Convention(
            name="enu_flu",
            q="q_enu_flu",
            body="flu",
            world="enu",
            attitude=attitude.enu_flu_from_ned_frd,
            vector=attitude.flu_from_frd,
            rpy_rad=attitude.rpy_from_quaternion,
            meaning="forward-left-up body axes to east-north-up, as ROS has it (REP 103); yaw from east to the north",
        ),
        Convention(
            name="enu_rfu",
            q="q_enu_rfu",
            body="rfu",
            world="enu",
            attitude=attitude.enu_rfu_from_ned_frd,
            vector=attitude.rfu_from_frd,
            rpy_rad=_rpy_from_enu_rfu,
            meaning="right-forward-up body axes to east-north-up; yaw is the heading from north to the east",
        ),
    )
}
