"""The mistakes that make ATTITUDE (30) and ATTITUDE_QUATERNION (31) disagree, a row each: how it is made and undone.

One table, read by whoever puts a mistake into a recording and by whoever names the mistake behind a disagreement. It is
data and pure functions: it knows neither frames on a wire nor where samples come from.

Attitudes are q_nb `[w, x, y, z]` (body FRD in NED) or roll, pitch, yaw in radians; `⊗` is the Hamilton product (M10).
A value is what the mistake added, in the unit of its row, so that undoing it subtracts. To add a cause, add a row; the
tests take every row as it comes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import TypedDict

import numpy as np

from gcs_bridge.attitude import (
    body_rates_from_euler_rates,
    conjugate,
    euler_from_quaternion,
    euler_rates_from_body_rates,
    multiply,
    quaternion_from_euler,
    quaternion_from_rotvec,
    quaternion_from_rpy,
    rpy_from_quaternion,
    wxyz_from_xyzw,
    xyzw_from_wxyz,
)
from gcs_bridge.diagnosis.mistake import Array, Cause, Change, Parameter, Value

# --- what the mistakes do ------------------------------------------------------------------------------------------

_NONE = np.array([1.0, 0.0, 0.0, 0.0])
_SWAP_XY = np.array([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0])  # M24's P: NED ↔ ENU, FRD ↔ RFU
_FLIP_YZ = np.array([0.0, 1.0, 0.0, 0.0])  # M24's D: FRD ↔ FLU, NED ↔ NWU


class _Changes(TypedDict):
    falsify: Change
    undo: Change


def _other_frames(*, world: Array = _NONE, body: Array = _NONE) -> _Changes:
    """The attitude of another body frame in another world: world ⊗ q ⊗ body."""
    return {
        "falsify": lambda q, _: multiply(multiply(world, q), body),
        "undo": lambda q, _: multiply(multiply(conjugate(world), q), conjugate(body)),
    }


def _self_inverse(change: Change) -> _Changes:
    """What is undone by being made again."""
    return {"falsify": change, "undo": change}


def _offset(change: Change) -> _Changes:
    """What is undone by the opposite value."""
    return {"falsify": change, "undo": lambda samples, value: change(samples, tuple(-number for number in value))}


def _rpy_signs(*signs: float) -> _Changes:
    return _self_inverse(lambda rpy, _: rpy * np.array(signs))


def _turn_deg(*rotvec_deg: float) -> Array:
    return quaternion_from_rotvec(np.radians(rotvec_deg))


def _xyz_from_rpy(rpy: Array, _: Value) -> Array:
    q_nb = quaternion_from_rpy(roll_rad=rpy[..., 0], pitch_rad=rpy[..., 1], yaw_rad=rpy[..., 2])
    return euler_from_quaternion(q_nb, "XYZ")


def _rpy_from_xyz(angles_rad: Array, _: Value) -> Array:
    return rpy_from_quaternion(quaternion_from_euler(angles_rad, "XYZ"))


def _as_angles_change(samples: Array, _: Value) -> Array:
    rpy, w = samples[..., :3], samples[..., 3:]
    return np.concatenate([rpy, euler_rates_from_body_rates(rpy, w)], axis=-1)


def _as_the_body_turns(samples: Array, _: Value) -> Array:
    rpy, rates = samples[..., :3], samples[..., 3:]
    return np.concatenate([rpy, body_rates_from_euler_rates(rpy, rates)], axis=-1)


def _held(samples: Array, _: Value) -> Array:
    """The first sample over and over."""
    return samples[:1].repeat(len(samples), axis=0)


# --- the table -----------------------------------------------------------------------------------------------------


def _rotation_vector(default_deg: Value) -> Parameter:
    return Parameter(unit="deg", default=default_deg, count=3, least=-180.0, most=180.0)


_ROWS = (
    Cause(
        name="quaternion_xyzw",
        message=31,
        acts_on="quaternion",
        falsify=lambda q, _: xyzw_from_wxyz(q),
        undo=lambda q, _: wxyz_from_xyzw(q),
        fix="Put the scalar first: q1, q2, q3, q4 are w, x, y, z.",
        origin="A library that keeps the scalar last (ROS, Eigen's coefficients, SciPy), copied slot by slot.",
    ),
    Cause(
        name="quaternion_conjugate",
        message=31,
        acts_on="quaternion",
        **_self_inverse(lambda q, _: conjugate(q)),
        fix="Send the conjugate of what is sent: MAVLink's quaternion takes body axes to the world, not the reverse.",
        origin="A library or paper whose quaternion goes from world to body, JPL's convention among them.",
    ),
    Cause(
        name="quaternion_unnormalised",
        message=31,
        acts_on="quaternion",
        falsify=lambda q, factor: q * factor[0],
        undo=lambda q, factor: q / factor[0],
        parameter=Parameter(default=(1.05,), least=0.001, most=1000.0),
        fix="Divide the quaternion by its norm, {value}, before it is sent.",
        origin="A filter or integrator that never normalises, or a weighted sum taken for an interpolation.",
    ),
    Cause(
        name="world_enu",
        message=31,
        acts_on="quaternion",
        **_other_frames(world=_SWAP_XY),
        fix="Convert the world from ENU to NED as well: the body is FRD already.",
        origin="A bridge from ROS (REP 103) or a game engine that converted the body's axes alone.",
    ),
    Cause(
        name="body_flu",
        message=31,
        acts_on="quaternion",
        **_other_frames(body=_FLIP_YZ),
        fix="Convert the body from FLU to FRD as well: the world is NED already.",
        origin="A bridge from ROS (REP 103) that converted the world's axes alone, or a sensor whose y points left.",
    ),
    Cause(
        name="enu_flu",
        message=31,
        acts_on="quaternion",
        **_other_frames(world=_SWAP_XY, body=_FLIP_YZ),
        fix="Convert from ENU and FLU to NED and FRD before sending.",
        origin="A ROS node (REP 103) whose attitude is sent as it stands.",
    ),
    Cause(
        name="yaw_offset",
        message=31,
        acts_on="quaternion",
        **_offset(lambda q, yaw_deg: multiply(_turn_deg(0.0, 0.0, *yaw_deg), q)),
        parameter=Parameter(unit="deg", default=(12.0,), least=-180.0, most=180.0),
        fix="Take {value} about down off the quaternion: both messages must use the same north.",
        origin="Magnetic declination applied on one side only, or a heading counted from a grid's or a camera's north.",
    ),
    Cause(
        name="mount_offset",
        message=31,
        acts_on="quaternion",
        **_offset(lambda q, rotvec_deg: multiply(q, _turn_deg(*rotvec_deg))),
        parameter=_rotation_vector((0.0, 4.0, 0.0)),
        fix="Take the turn {value} in body axes off the quaternion: both messages must mean the same body.",
        origin="A sensor or autopilot that sits askew, its alignment entered on one side only.",
    ),
    Cause(
        name="time_skew",
        message=31,
        acts_on="time",
        **_offset(lambda time_ms, skew_ms: time_ms + skew_ms[0]),
        parameter=Parameter(unit="ms", default=(150.0,), least=-60_000.0, most=60_000.0, whole=True),
        fix="Stamp the quaternion with the time at which it was measured: its time_boot_ms is off by {value}.",
        origin="A stamp set when the message is sent, behind a queue or a filter, or by another clock.",
    ),
    Cause(
        name="frozen_quaternion",
        message=31,
        acts_on="payload",
        falsify=_held,
        fix="Find why the quaternion's producer stopped: its last values are sent again and again under new times.",
        origin="A task that died or a topic that is no longer published, while the sender goes on.",
    ),
    Cause(
        name="frozen_euler",
        message=30,
        acts_on="payload",
        falsify=_held,
        fix="Find why the Euler angles' producer stopped: their last values are sent again and again under new times.",
        origin="A task that died or a topic that is no longer published, while the sender goes on.",
    ),
    Cause(
        name="euler_xyz_order",
        message=30,
        acts_on="rpy",
        falsify=_xyz_from_rpy,
        undo=_rpy_from_xyz,
        fix="Take the angles in the order yaw, pitch, roll (intrinsic Z-Y-X) from the same rotation.",
        origin="A library whose default order is X-Y-Z, or extrinsic and intrinsic sequences confused.",
    ),
    Cause(
        name="euler_degrees",
        message=30,
        acts_on="rpy",
        falsify=lambda rpy, _: np.degrees(rpy),
        undo=lambda rpy, _: np.radians(rpy),
        fix="Send radians.",
        origin="An attitude taken from a display, a log or a simulator that speaks degrees.",
    ),
    Cause(
        name="roll_pitch_swapped",
        message=30,
        acts_on="rpy",
        **_self_inverse(lambda rpy, _: rpy[..., [1, 0, 2]]),
        fix="Swap roll and pitch.",
        origin="A sensor turned by 90°, or axes numbered x right and y forward.",
    ),
    Cause(
        name="roll_sign",
        message=30,
        acts_on="rpy",
        **_rpy_signs(-1.0, 1.0, 1.0),
        fix="Turn the sign of roll: positive is right wing down.",
        origin="A left-handed frame, as of a game engine, or the x axis taken backwards.",
    ),
    Cause(
        name="pitch_sign",
        message=30,
        acts_on="rpy",
        **_rpy_signs(1.0, -1.0, 1.0),
        fix="Turn the sign of pitch: positive is nose up.",
        origin="A body whose y points left (ROS), or a library in which nose down is positive.",
    ),
    Cause(
        name="yaw_sign",
        message=30,
        acts_on="rpy",
        **_rpy_signs(1.0, 1.0, -1.0),
        fix="Turn the sign of yaw: positive is clockwise seen from above.",
        origin="A world whose z points up, where yaw counts anticlockwise.",
    ),
    Cause(
        name="euler_rates",
        message=None,
        acts_on="rates",
        falsify=_as_angles_change,
        undo=_as_the_body_turns,
        fix="Send the body's rates p, q, r, not how fast roll, pitch and yaw change.",
        origin="Angles that were differentiated, or a simulator's rates of its angles, put into the rates' fields.",
    ),
    Cause(
        name="enu_rfu",
        message=31,
        acts_on="quaternion",
        **_other_frames(world=_SWAP_XY, body=_SWAP_XY),
        fix="Convert from ENU and RFU to NED and FRD before sending.",
        origin="Inertial-navigation software that works in east-north-up with the body's x to the right.",
    ),
    Cause(
        name="nwu_flu",
        message=31,
        acts_on="quaternion",
        **_other_frames(world=_FLIP_YZ, body=_FLIP_YZ),
        fix="Convert from NWU and FLU to NED and FRD before sending.",
        origin="A simulator or a motion-capture system whose z points up, its x to the north.",
    ),
    Cause(
        name="world_nwu",
        message=31,
        acts_on="quaternion",
        **_other_frames(world=_FLIP_YZ),
        fix="Convert the world from NWU to NED as well: the body is FRD already.",
        origin="A simulator's world whose z points up, converted for the body's axes alone.",
    ),
    Cause(
        name="body_rfu",
        message=31,
        acts_on="quaternion",
        **_other_frames(body=_SWAP_XY),
        fix="Convert the body from RFU to FRD as well: the world is NED already.",
        origin="A sensor whose x points right and y forward, converted for the world's axes alone.",
    ),
    Cause(
        name="world_offset",
        message=31,
        acts_on="quaternion",
        **_offset(lambda q, rotvec_deg: multiply(_turn_deg(*rotvec_deg), q)),
        parameter=_rotation_vector((4.0, 0.0, 0.0)),
        fix="Take the turn {value} in world axes off the quaternion: both messages must mean the same world.",
        origin="A local frame that was levelled or aligned on one side only, as of a camera or motion capture.",
    ),
    Cause(
        name="estimator_reset",
        message=None,
        acts_on=None,
        fix="Nothing to convert: the estimator corrected itself, and EKF status and STATUSTEXT say why.",
        origin="A late GPS or compass fix, a lane switch, or a heading that was wrong since start-up.",
    ),
    Cause(
        name="unknown",
        message=None,
        acts_on=None,
        fix="None of the known mistakes explains it: look at how the disagreement goes with time, attitude and rate.",
        origin="Two mistakes at once, a mistake that this table lacks, or two estimators instead of one.",
    ),
)
CAUSES: Mapping[str, Cause] = MappingProxyType({cause.name: cause for cause in _ROWS})
"""Every cause by its name."""
