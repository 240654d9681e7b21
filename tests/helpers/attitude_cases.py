"""Which arguments each row-wise function takes, and random rows for them."""

from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from gcs_bridge import attitude

Array = NDArray[np.float64]
Arguments = dict[str, Any]  # by name: arrays of rows, and what is no array as it is

QUATERNION, VECTOR, MATRIX, NUMBER, SHARE = "quaternion", "vector", "matrix", "number", "share"
Q, V, M, N, S = QUATERNION, VECTOR, MATRIX, NUMBER, SHARE

CASES = {
    "acceleration_level": {"q_nb": Q, "f_b": V},
    "acceleration_ned": {"q_nb": Q, "f_b": V},
    "accelerometer_tilt": {"q_nb": Q, "f_b": V},
    "angle_between": {"a": Q, "b": Q},
    "body_down": {"q": Q},
    "body_rates_between": {"a": Q, "b": Q, "dt_s": N},
    "body_rates_from_euler_rates": {"rpy_rad": V, "rates": V},
    "conjugate": {"q": Q},
    "down_from_specific_force": {"f_b": V},
    "elementary_rotation": {"axis": "y", "angle_rad": N},
    "enu_flu_from_ned_frd": {"q": Q},
    "enu_flu_matrix_from_ned_frd": {"R": M},
    "enu_flu_rpy_from_ned_frd": {"rpy_rad": V},
    "enu_from_ned": {"v": V},
    "enu_rfu_from_ned_frd": {"q": Q},
    "enu_rfu_matrix_from_ned_frd": {"R": M},
    "enu_rfu_matrix_from_rpy": {"rpy_rad": V},
    "euler_from_matrix": {"R": M},
    "euler_from_quaternion": {"q": Q},
    "euler_rates_from_body_rates": {"rpy_rad": V, "w": V},
    "flu_from_frd": {"v": V},
    "frd_from_flu": {"v": V},
    "frd_from_rfu": {"v": V},
    "heading": {"q": Q},
    "hermite": {"q0": Q, "q1": Q, "w0": V, "w1": V, "dt_s": N, "u": S},
    "hover_thrust": {"q_nb": Q, "mass_kg": N},
    "integrate": {"q": Q, "w": V, "dt_s": N},
    "is_rotation": {"R": M},
    "level_from_ned": {"q_nb": Q, "v_n": V},
    "matrix_from_euler": {"angles_rad": V},
    "matrix_from_quaternion": {"q": Q},
    "may_stand_still": {"q_nb": Q, "f_b": V},
    "multiply": {"a": Q, "b": Q},
    "near_gimbal_lock": {"q": Q},
    "nearest_rotation": {"R": M},
    "ned_frd_from_enu_flu": {"q": Q},
    "ned_frd_from_enu_rfu": {"q": Q},
    "ned_frd_matrix_from_enu_flu": {"R": M},
    "ned_frd_matrix_from_enu_rfu": {"R": M},
    "ned_frd_rpy_from_enu_flu": {"rpy_rad": V},
    "ned_from_enu": {"v": V},
    "normalise": {"q": Q},
    "omega_matrix": {"w": V},
    "quaternion_from_axis_angle": {"axis": V, "angle_rad": N},
    "quaternion_from_euler": {"angles_rad": V, "sequence": "XZX"},
    "quaternion_from_matrix": {"R": M},
    "quaternion_from_rotvec": {"v": V},
    "quaternion_from_rpy": {"roll_rad": N, "pitch_rad": N, "yaw_rad": N},
    "quaternion_rate": {"q": Q, "w": V},
    "rfu_from_frd": {"v": V},
    "right_jacobian_inverse_times": {"phi": V, "w": V},
    "rotate": {"q": Q, "v": V},
    "rotvec_from_quaternion": {"q": Q},
    "rpy_from_enu_rfu_matrix": {"R": M},
    "rpy_from_quaternion": {"q": Q},
    "slerp": {"a": Q, "b": Q, "t": S},
    "specific_force": {"q_nb": Q, "a_n": V},
    "tilt_heading_between": {"a": Q, "b": Q},
    "wxyz_from_xyzw": {"q": Q},
    "xyzw_from_wxyz": {"q": Q},
}
TAILS = {QUATERNION: (4,), VECTOR: (3,), MATRIX: (3, 3), NUMBER: (), SHARE: ()}


def random_quaternions(rng: np.random.Generator, *lead: int) -> Array:
    """Uniform on the sphere, like every rotation equally often."""
    q = rng.normal(size=(*lead, 4))
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def random_arguments(name: str, rng: np.random.Generator, *lead: int) -> Arguments:
    """Random rows for each array argument of a function, and its other arguments as they are."""

    def rows(kind: Any) -> Any:
        if kind == QUATERNION:
            return random_quaternions(rng, *lead)
        if kind == MATRIX:
            return attitude.matrix_from_quaternion(random_quaternions(rng, *lead))
        if kind == SHARE:
            return rng.uniform(size=lead)
        return rng.normal(size=(*lead, *TAILS[kind])) if kind in TAILS else kind

    return {argument: rows(kind) for argument, kind in CASES[name].items()}


def array_arguments(name: str) -> dict[str, tuple[int, ...]]:
    """The names of the array arguments of a function, with the shape of one row."""
    return {argument: TAILS[kind] for argument, kind in CASES[name].items() if kind in TAILS}


def outputs(result: Any) -> list[NDArray[Any]]:
    """A function's results as a list of arrays."""
    return [np.asarray(part) for part in result] if isinstance(result, tuple) else [np.asarray(result)]


def turn_between(a: npt.ArrayLike, b: npt.ArrayLike) -> Array:
    """The angle between two attitudes by another formula than the package's: the chord of quaternions."""
    one, other = (np.asarray(q) / np.linalg.norm(q, axis=-1, keepdims=True) for q in (a, b))
    chord = np.minimum(np.linalg.norm(one - other, axis=-1), np.linalg.norm(one + other, axis=-1))
    return np.asarray(4.0 * np.arcsin(0.5 * chord))
