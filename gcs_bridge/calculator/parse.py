"""One attitude as somebody wrote it down → q_nb, with notes on what was mended or looks wrong.

What is far from any rotation is refused and never repaired: more likely another form was meant.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude import (
    nearest_rotation,
    normalise,
    quaternion_from_axis_angle,
    quaternion_from_euler,
    quaternion_from_matrix,
    quaternion_from_rotvec,
    quaternion_from_rpy,
    wxyz_from_xyzw,
)
from gcs_bridge.calculator.frames import FRAMES
from gcs_bridge.errors import UsageError

__all__ = ["SEQUENCES", "Given", "given"]
SEQUENCES = ("ZYX", "ZXY", "YXZ", "YZX", "XYZ", "XZY", "ZXZ", "ZYZ", "XYX", "XZX", "YXY", "YZY")
"""All intrinsic Euler sequences (M7), aerospace's first; in lower case they are the extrinsic ones."""
_Array = npt.NDArray[np.float64]
_MOST_OFF = 0.5  # of a norm, as the quaternion_norm check has it, and of a matrix
_NOTED_OFF = 1e-6  # six digits leave no more
_SMALLEST = 1e-9  # length of an axis


@dataclass(frozen=True, kw_only=True)
class Given:
    """An attitude, and how it was given.

    `off` is how far a quaternion's norm was from 1, or a matrix from the nearest rotation (the largest change of a
    unit vector); None for the other forms, which are rotations whatever their numbers.
    """

    form: str
    frame: str
    values: tuple[float, ...]
    sequence: str | None
    q_nb: _Array
    off: float | None
    notes: tuple[str, ...]


def given(form: str, values: Sequence[float], *, frame: str = "ned_frd", sequence: str | None = None) -> Given:
    """The attitude that `values`, finite and of any sensible size, describe in this form and frame convention.

    Forms are `rpy`, `rotvec`, `axis_angle` (x, y, z, angle) and `euler` (in the order of `sequence`), each with `_deg`
    or `_rad` behind it; `quaternion` (w, x, y, z), `quaternion_xyzw` and `matrix` (row by row). Raises UsageError for
    what is no attitude.
    """
    if sequence is not None:
        _refuse_unknown(sequence)
    convention = FRAMES[frame]
    numbers = np.array(values, np.float64)
    kind, _, unit = form.rpartition("_")
    angles = numbers[3:] if kind == "axis_angle" else numbers
    if unit == "deg":
        angles *= math.pi / 180.0
    off, notes = None, _suspicions(angles, unit)
    if form.startswith("quaternion"):
        off, notes = _norm_off(numbers)
        q = normalise(wxyz_from_xyzw(numbers) if form == "quaternion_xyzw" else numbers)
    elif form == "matrix":
        nearest, off, notes = _nearest(numbers.reshape(3, 3))
        q = quaternion_from_matrix(nearest)
    elif kind == "rpy":
        roll, pitch, yaw = convention.ned_frd_from_rpy(numbers)
        q = convention.q_from_ned_frd(quaternion_from_rpy(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw))
    elif kind == "rotvec":
        q = quaternion_from_rotvec(numbers)
    elif kind == "axis_angle":
        if np.linalg.norm(numbers[:3]) < _SMALLEST:
            raise UsageError("the axis is zero: no attitude is meant by it")
        q = quaternion_from_axis_angle(numbers[:3], numbers[3])
    else:
        q = quaternion_from_euler(numbers, sequence or "ZYX")
    return Given(
        form=form,
        frame=frame,
        values=tuple(values),
        sequence=sequence,
        q_nb=convention.ned_frd_from_q(q),
        off=off,
        notes=notes,
    )


def _refuse_unknown(sequence: str) -> None:
    """Raise UsageError, with the nearest right ones, for what is no Euler sequence."""
    if sequence in SEQUENCES or (sequence.islower() and sequence.upper() in SEQUENCES):
        return
    letters = sequence.upper().translate(str.maketrans("123", "XYZ"))  # as in 3-2-1
    (near,) = difflib.get_close_matches(letters, SEQUENCES, n=1, cutoff=0.5) or ("ZYX",)
    raise UsageError(
        f"unknown Euler sequence {sequence!r}; did you mean {near!r} (intrinsic) or {near.lower()!r} (extrinsic)?"
    )


def _norm_off(q: _Array) -> tuple[float, tuple[str, ...]]:
    """How far the norm is from 1, and a note where that matters."""
    norm = float(np.linalg.norm(q))
    off = abs(norm - 1.0)
    if off > _MOST_OFF:
        raise UsageError(f"the quaternion's norm is {norm:.6g}, and 1 is right: so far off, no attitude is meant by it")
    if off <= _NOTED_OFF:
        return off, ()
    return off, (f"the quaternion's norm is {norm:.6g}: it is divided out here",)


def _nearest(R: _Array) -> tuple[_Array, float, tuple[str, ...]]:
    """The nearest rotation, how far the matrix is from it, and a note where that matters."""
    determinant = float(np.linalg.det(R))
    nearest = nearest_rotation(R)
    off = float(np.linalg.norm(R - nearest, 2)) if np.isfinite(nearest).all() else math.inf
    if determinant < 0.0 and abs(determinant + 1.0) < _MOST_OFF:
        raise UsageError(
            f"the matrix is a reflection (determinant {determinant:.4g}), not a rotation: "
            "an axis has the wrong sign, or two are swapped"
        )
    if off > _MOST_OFF:
        raise UsageError(f"the matrix is no rotation, nor near one (determinant {determinant:.4g}, 1 is right)")
    if off <= _NOTED_OFF:
        return nearest, off, ()
    return nearest, off, (f"the matrix takes a unit vector up to {off:.3g} off a rotation: the nearest one is shown",)


def _suspicions(angles_rad: _Array, unit: str) -> tuple[str, ...]:
    if unit == "rad" and (np.abs(angles_rad) > 2.0 * math.pi).any():
        return ("more than a whole turn: are these degrees?",)
    return ()
