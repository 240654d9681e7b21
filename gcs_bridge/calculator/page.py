"""One attitude in every documented form and frame convention, what it means, and what each common mistake would show.

The page is a dict in JSON's own types. Its keys name frame and unit: `ned_frd` is the body frame FRD in the world NED,
`ned` are the world's axes and `frd` the body's. Quaternions are given with w ≥ 0; what is undefined is None.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from gcs_bridge._version import __version__
from gcs_bridge.attitude import (
    acceleration_level,
    acceleration_ned,
    accelerometer_tilt,
    angle_between,
    body_down,
    elementary_rotation,
    euler_from_quaternion,
    euler_rates_from_body_rates,
    heading,
    hover_thrust,
    integrate,
    matrix_from_quaternion,
    near_gimbal_lock,
    quaternion_from_rpy,
    quaternion_rate,
    rotate,
    rotvec_from_quaternion,
    rpy_from_quaternion,
    specific_force,
    tilt_heading_between,
    xyzw_from_wxyz,
)
from gcs_bridge.calculator.frames import FRAMES, Frame
from gcs_bridge.calculator.parse import SEQUENCES, Given
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.diagnosis.mistake import Cause, Change

__all__ = ["SCHEMA", "attitude_page"]
SCHEMA = "gcs-bridge/attitude/1"
_Array = npt.NDArray[np.float64]
_Vector = tuple[float, float, float]
_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
_BODY_PARTS = {"nose": (1.0, 0.0, 0.0), "right_wing": (0.0, 1.0, 0.0), "belly": (0.0, 0.0, 1.0)}  # FRD
_SAME_DEG = 0.01  # attitudes that are nearer to each other show no mistake


def attitude_page(
    given: Given, *, rates_deg_s: _Vector | None = None, accelerometer_m_s2: _Vector | None = None
) -> dict[str, Any]:
    """The page of an attitude; body rates and the accelerometer's reading are in the body axes of `given.frame`."""
    q_nb = _positive(given.q_nb)
    frd_from_body = FRAMES[given.frame].frd_from_body
    return {
        "schema": SCHEMA,
        "version": __version__,
        "input": {
            "form": given.form,
            "frame": given.frame,
            "values": list(given.values),
            "sequence": given.sequence,
            "off": given.off,
            "notes": list(given.notes),
        },
        "heading_deg": _number(np.degrees(heading(q_nb))),
        "tilt_deg": _number(np.degrees(tilt_heading_between(_LEVEL, q_nb)[0])),
        "hover_thrust_n_per_kg": _number(hover_thrust(q_nb, 1.0)),
        "pointing": {part: _pointing(rotate(q_nb, axis)) for part, axis in _BODY_PARTS.items()},
        "frames": {frame.name: _forms(q_nb, frame) for frame in FRAMES.values()},
        "rates": None if rates_deg_s is None else _turning(q_nb, np.radians(frd_from_body(rates_deg_s))),
        "accelerometer": None if accelerometer_m_s2 is None else _pushed(q_nb, frd_from_body(accelerometer_m_s2)),
        "near_misses": [_near_miss(q_nb, *mistake) for mistake in _mistakes()],
    }


# --- the forms -----------------------------------------------------------------------------------------------------


def _forms(q_nb: _Array, frame: Frame) -> dict[str, Any]:
    """The attitude in one frame convention."""
    name = frame.name
    q = _positive(frame.q_from_ned_frd(q_nb))
    rpy_rad = frame.rpy_from_ned_frd(rpy_from_quaternion(q_nb))
    rotvec_rad = rotvec_from_quaternion(q)
    angle_rad = float(np.linalg.norm(rotvec_rad))
    sequences = [*SEQUENCES, *map(str.lower, SEQUENCES)]
    return {
        f"q_{name}_wxyz": _numbers(q),
        f"q_{name}_xyzw": _numbers(xyzw_from_wxyz(q)),
        f"q_{name}_wxyz_negated": _numbers(-q),
        f"rpy_{name}_deg": _numbers(np.degrees(rpy_rad)),
        f"rpy_{name}_rad": _numbers(rpy_rad),
        f"rpy_{name}_near_gimbal_lock": bool(near_gimbal_lock(q_nb)),
        f"R_{name}": _numbers(matrix_from_quaternion(q)),
        f"R_{name}_factors": {
            f"R{axis}({'-' if sign < 0 else ''}{('roll', 'pitch', 'yaw')[i]})": _numbers(
                elementary_rotation(axis, sign * rpy_rad[i])
            )
            for axis, i, sign in frame.turns
        },
        f"rotvec_{name}_deg": _numbers(np.degrees(rotvec_rad)),
        f"rotvec_{name}_rad": _numbers(rotvec_rad),
        f"axis_{name}": _numbers(rotvec_rad / angle_rad) if angle_rad > 0.0 else None,
        f"angle_{name}_deg": math.degrees(angle_rad),
        f"euler_{name}_deg": {s: _numbers(np.degrees(euler_from_quaternion(q, s))) for s in sequences},
        f"euler_{name}_near_gimbal_lock": [s for s in sequences if near_gimbal_lock(q, sequence=s)],
        **{
            f"{part}_{frame.world}": _numbers(frame.world_from_ned(rotate(q_nb, axis)))
            for part, axis in _BODY_PARTS.items()
        },
        f"down_{frame.body}": _numbers(frame.body_from_frd(body_down(q_nb))),
        f"accelerometer_at_rest_{frame.body}_m_s2": _numbers(
            frame.body_from_frd(specific_force(q_nb, [0.0, 0.0, 0.0]))
        ),
    }


def _pointing(v_n: _Array) -> str:
    """Where a unit vector in NED points, in words.

    >>> _pointing(np.array([0.75**0.5, 0.5, 0.0]))
    '30.0° right of north, level'
    >>> _pointing(np.array([0.0, 0.0, -1.0]))
    'straight up'
    """
    north, east, down = v_n
    across = math.hypot(north, east)
    upward_deg = round(math.degrees(math.atan2(-down, across)), 1)
    if abs(upward_deg) == 90.0:
        return "straight up" if upward_deg > 0 else "straight down"
    bearing_deg = round(math.degrees(math.atan2(east, north)), 1)
    quarter = round(bearing_deg / 90.0)
    aside_deg = bearing_deg - 90.0 * quarter
    where = ("north", "east", "south", "west")[quarter % 4]
    if abs(aside_deg) >= 0.05:
        where = f"{abs(aside_deg):.1f}° {'right' if aside_deg > 0 else 'left'} of {where}"
    if upward_deg == 0.0:
        return f"{where}, level"
    return f"{where}, {abs(upward_deg):.1f}° {'up' if upward_deg > 0 else 'down'}"


# --- in motion -----------------------------------------------------------------------------------------------------


def _turning(q_nb: _Array, w_frd_rad_s: _Array) -> dict[str, Any]:
    """What body rates do to the attitude, in every frame convention."""
    rpy_rate_rad_s = euler_rates_from_body_rates(rpy_from_quaternion(q_nb), w_frd_rad_s)
    after = integrate(q_nb, w_frd_rad_s, 1.0)
    told: dict[str, Any] = {}
    for frame in FRAMES.values():
        name = frame.name
        w_body = frame.body_from_frd(w_frd_rad_s)
        told |= {
            f"w_{frame.body}_deg_s": _numbers(np.degrees(w_body)),
            f"w_{frame.world}_deg_s": _numbers(np.degrees(frame.world_from_ned(rotate(q_nb, w_frd_rad_s)))),
            f"rpy_rate_{name}_deg_s": _numbers(np.degrees(frame.rpy_signs * rpy_rate_rad_s)),
            f"q_rate_{name}_wxyz_per_s": _numbers(quaternion_rate(_positive(frame.q_from_ned_frd(q_nb)), w_body)),
            f"q_after_1_s_{name}_wxyz": _numbers(_positive(frame.q_from_ned_frd(after))),
            f"rpy_after_1_s_{name}_deg": _numbers(np.degrees(frame.rpy_from_ned_frd(rpy_from_quaternion(after)))),
        }
    return told


def _pushed(q_nb: _Array, f_frd_m_s2: _Array) -> dict[str, Any]:
    """What an accelerometer's reading says at this attitude."""
    a_n = acceleration_ned(q_nb, f_frd_m_s2)
    told: dict[str, Any] = {}
    for frame in FRAMES.values():
        told[f"f_{frame.body}_m_s2"] = _numbers(frame.body_from_frd(f_frd_m_s2))
        told[f"a_{frame.world}_m_s2"] = _numbers(frame.world_from_ned(a_n))
    told["a_level_forward_right_down_m_s2"] = _numbers(acceleration_level(q_nb, f_frd_m_s2))
    told["tilt_error_if_at_rest_deg"] = _number(np.degrees(accelerometer_tilt(q_nb, f_frd_m_s2)))
    return told


# --- near-misses ---------------------------------------------------------------------------------------------------


def _mistakes() -> Iterator[tuple[Cause, bool, Change]]:
    """Each mistake without a value: its cause, whether it is made the other way round, and what it does.

    Reading what was sent rightly by the mistaken convention is the cause undone; for most it is the same mistake.
    """
    sample = {"quaternion": np.array([0.5, 0.1, 0.3, 0.8]), "rpy": np.array([0.1, 0.2, 0.3])}
    for cause in CAUSES.values():
        if cause.parameter.count or cause.acts_on not in sample or cause.falsify is None or cause.undo is None:
            continue
        yield cause, False, cause.falsify
        forth, back = (_read(cause, change(sample[cause.acts_on], ())) for change in (cause.falsify, cause.undo))
        if angle_between(forth, back) > 1e-6:
            yield cause, True, cause.undo


def _near_miss(q_nb: _Array, cause: Cause, reverse: bool, change: Change) -> dict[str, Any]:
    """What the mistake makes of the attitude, and how far that is from it, seen from the right one (M17)."""
    sent = change(q_nb if cause.acts_on == "quaternion" else rpy_from_quaternion(q_nb), ())
    seen = _read(cause, sent)
    rpy_rad = sent if cause.acts_on == "rpy" else rpy_from_quaternion(sent)
    angle_deg = float(np.degrees(angle_between(q_nb, seen)))
    tilt, turn = tilt_heading_between(q_nb, seen)
    return {
        "cause": cause.name,
        "reverse": reverse,
        "rpy_ned_frd_deg": _numbers(np.degrees(rpy_rad)),
        "angle_deg": angle_deg,
        "tilt_deg": _number(np.degrees(tilt)),
        "heading_deg": _number(np.degrees(turn)),
        "distinguishable": angle_deg >= _SAME_DEG,
        "fix": cause.fix,
    }


def _read(cause: Cause, sent: _Array) -> _Array:
    """The attitude that a reader sees in what was sent."""
    if cause.acts_on == "quaternion":
        return sent
    return quaternion_from_rpy(roll_rad=sent[0], pitch_rad=sent[1], yaw_rad=sent[2])


# --- numbers -------------------------------------------------------------------------------------------------------


def _positive(q: _Array) -> _Array:
    """The one of q and -q whose first component that is not zero is positive."""
    return -q if q[np.flatnonzero(q)[0]] < 0.0 else q


def _numbers(array: _Array) -> list[Any] | None:
    """An array as lists; None where it is undefined."""
    return (array + 0.0).tolist() if np.isfinite(array).all() else None  # + 0.0: no negative zero


def _number(value: npt.ArrayLike) -> float | None:
    number = float(np.asarray(value)) + 0.0
    return number if math.isfinite(number) else None
