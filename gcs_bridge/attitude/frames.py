"""Other conventions: each conversion has one name and one home here, none is guessed (M15, M24).

The default is NED (north, east, down) with FRD (forward, right, down) and scalar-first quaternions. P swaps NED with
ENU and FRD with RFU, D swaps FRD with FLU. Both are rotations by half a turn and their own inverses, so every
conversion here undoes itself: two names for one mapping, because a reader must see which way the numbers go.

    P = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]      D = diag(1, -1, -1)
    R_enu_flu = P R_ned_frd D                   R_enu_rfu = P R_ned_frd P

All functions are pure changes of coordinates: norms, units and drift are kept. A non-finite row, or a zero quaternion,
gives NaN; a wrong shape raises ValueError.
"""

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude._rows import Array, Quaternion, grid, join, matrix, ray, rowwise, vector
from gcs_bridge.attitude.euler import euler_from_matrix, matrix_from_euler, wrapped
from gcs_bridge.attitude.quaternion import conjugated, product

_HALF = np.asarray(0.5**0.5)
_ZERO, _ONE = np.asarray(0.0), np.asarray(1.0)
P: Quaternion = (_ZERO, _HALF, _HALF, _ZERO)
D: Quaternion = (_ZERO, _ONE, _ZERO, _ZERO)


# Scalar first or last


@rowwise(q=(4,))
def xyzw_from_wxyz(q: npt.ArrayLike) -> Array:
    """Return scalar-last quaternions (..., 4), for SciPy, ROS and rerun, of scalar-first ones (M15).

    >>> xyzw_from_wxyz([1, 2, 3, 4]).tolist()
    [2.0, 3.0, 4.0, 1.0]
    """
    w, x, y, z = ray(q)[0]
    return join(x, y, z, w)


@rowwise(q=(4,))
def wxyz_from_xyzw(q: npt.ArrayLike) -> Array:
    """Return scalar-first quaternions (..., 4) of scalar-last ones, from SciPy, ROS and rerun (M15).

    >>> wxyz_from_xyzw([2, 3, 4, 1]).tolist()
    [1.0, 2.0, 3.0, 4.0]
    """
    x, y, z, w = ray(q)[0]
    return join(w, x, y, z)


# Vectors


def _swap_p(v: npt.ArrayLike) -> Array:
    x, y, z = vector(v)
    return join(y, x, -z)


def _swap_d(v: npt.ArrayLike) -> Array:
    x, y, z = vector(v)
    return join(x, -y, -z)


@rowwise(v=(3,))
def enu_from_ned(v: npt.ArrayLike) -> Array:
    """Return world vectors (..., 3) as east, north, up, given north, east, down (M24).

    >>> enu_from_ned([1, 2, 3]).tolist()
    [2.0, 1.0, -3.0]
    """
    return _swap_p(v)


@rowwise(v=(3,))
def ned_from_enu(v: npt.ArrayLike) -> Array:
    """Return world vectors (..., 3) as north, east, down, given east, north, up (M24).

    >>> ned_from_enu([2, 1, -3]).tolist()
    [1.0, 2.0, 3.0]
    """
    return _swap_p(v)


@rowwise(v=(3,))
def rfu_from_frd(v: npt.ArrayLike) -> Array:
    """Return body vectors (..., 3) as right, forward, up, given forward, right, down (M24).

    >>> rfu_from_frd([1, 2, 3]).tolist()
    [2.0, 1.0, -3.0]
    """
    return _swap_p(v)


@rowwise(v=(3,))
def frd_from_rfu(v: npt.ArrayLike) -> Array:
    """Return body vectors (..., 3) as forward, right, down, given right, forward, up (M24).

    >>> frd_from_rfu([2, 1, -3]).tolist()
    [1.0, 2.0, 3.0]
    """
    return _swap_p(v)


@rowwise(v=(3,))
def flu_from_frd(v: npt.ArrayLike) -> Array:
    """Return body vectors (..., 3) as forward, left, up, given forward, right, down (M24).

    >>> flu_from_frd([1, 2, 3]).tolist()
    [1.0, -2.0, -3.0]
    """
    return _swap_d(v)


@rowwise(v=(3,))
def frd_from_flu(v: npt.ArrayLike) -> Array:
    """Return body vectors (..., 3) as forward, right, down, given forward, left, up (M24).

    >>> frd_from_flu([1, -2, -3]).tolist()
    [1.0, 2.0, 3.0]
    """
    return _swap_d(v)


# Quaternions


def _swap_flu(q: npt.ArrayLike) -> Array:
    return join(*product(product(P, ray(q)[0]), D))


def _swap_rfu(q: npt.ArrayLike) -> Array:
    return join(*product(product(P, ray(q)[0]), conjugated(P)))  # P* = -P: so that no turn stays no turn


@rowwise(q=(4,))
def enu_flu_from_ned_frd(q: npt.ArrayLike) -> Array:
    """Return attitudes (..., 4) of the body FLU in the world ENU, given those of FRD in NED (M24): q_P * q * q_D.

    >>> enu_flu_from_ned_frd([1, 0, 0, 0]).round(6).tolist()  # the nose points north: 90 deg from east, sign aside
    [-0.707107, 0.0, 0.0, -0.707107]
    """
    return _swap_flu(q)


@rowwise(q=(4,))
def ned_frd_from_enu_flu(q: npt.ArrayLike) -> Array:
    """Return attitudes (..., 4) of the body FRD in the world NED, given those of FLU in ENU (M24).

    >>> ned_frd_from_enu_flu([-1, 0, 0, -1]).round(6).tolist()
    [1.414214, 0.0, 0.0, 0.0]
    """
    return _swap_flu(q)


@rowwise(q=(4,))
def enu_rfu_from_ned_frd(q: npt.ArrayLike) -> Array:
    """Return attitudes (..., 4) of the body RFU in the world ENU, given those of FRD in NED (M24): q_P * q * q_P*.

    >>> enu_rfu_from_ned_frd([1, 0, 0, 0.5]).round(6).tolist()  # clockwise from above is negative about up
    [1.0, 0.0, 0.0, -0.5]
    """
    return _swap_rfu(q)


@rowwise(q=(4,))
def ned_frd_from_enu_rfu(q: npt.ArrayLike) -> Array:
    """Return attitudes (..., 4) of the body FRD in the world NED, given those of RFU in ENU (M24).

    >>> ned_frd_from_enu_rfu([1, 0, 0, -0.5]).round(6).tolist()
    [1.0, 0.0, 0.0, 0.5]
    """
    return _swap_rfu(q)


# Matrices


def _flu_matrix(R: npt.ArrayLike) -> Array:
    (a, b, c), (d, e, f), (g, h, i) = matrix(R)
    return grid((d, -e, -f), (a, -b, -c), (-g, h, i))


def _rfu_matrix(R: npt.ArrayLike) -> Array:
    (a, b, c), (d, e, f), (g, h, i) = matrix(R)
    return grid((e, d, -f), (b, a, -c), (-h, -g, i))


@rowwise(R=(3, 3))
def enu_flu_matrix_from_ned_frd(R: npt.ArrayLike) -> Array:
    """Return matrices (..., 3, 3) that take FLU to ENU, given those that take FRD to NED (M24): P R D.

    >>> enu_flu_matrix_from_ned_frd(np.eye(3))[:, 0].tolist()  # the nose points north
    [0.0, 1.0, 0.0]
    """
    return _flu_matrix(R)


@rowwise(R=(3, 3))
def ned_frd_matrix_from_enu_flu(R: npt.ArrayLike) -> Array:
    """Return matrices (..., 3, 3) that take FRD to NED, given those that take FLU to ENU (M24): P R D.

    >>> ned_frd_matrix_from_enu_flu(np.eye(3))[:, 0].tolist()  # the nose points east
    [0.0, 1.0, 0.0]
    """
    return _flu_matrix(R)


@rowwise(R=(3, 3))
def enu_rfu_matrix_from_ned_frd(R: npt.ArrayLike) -> Array:
    """Return matrices (..., 3, 3) that take RFU to ENU, given those that take FRD to NED (M24): P R P.

    >>> enu_rfu_matrix_from_ned_frd([[0, -1, 0], [1, 0, 0], [0, 0, 1]])[:, 1].tolist()  # the nose, RFU's y, points east
    [1.0, 0.0, 0.0]
    """
    return _rfu_matrix(R)


@rowwise(R=(3, 3))
def ned_frd_matrix_from_enu_rfu(R: npt.ArrayLike) -> Array:
    """Return matrices (..., 3, 3) that take FRD to NED, given those that take RFU to ENU (M24): P R P.

    >>> ned_frd_matrix_from_enu_rfu(np.eye(3))[:, 0].tolist()  # the nose points north
    [1.0, 0.0, 0.0]
    """
    return _rfu_matrix(R)


# Angles


def _flu_rpy(rpy_rad: npt.ArrayLike) -> Array:
    roll, pitch, yaw = vector(rpy_rad)
    return join(roll, -pitch, wrapped(0.5 * np.pi - yaw))


@rowwise(rpy_rad=(3,))
def enu_flu_rpy_from_ned_frd(rpy_rad: npt.ArrayLike) -> Array:
    """Return roll, pitch, yaw (..., 3), rad, of FLU in ENU (as in ROS), given those of FRD in NED (M24).

    Roll stays, pitch turns its sign (positive is nose down), yaw is counted from east, anticlockwise, in (-pi, pi].

    >>> np.degrees(enu_flu_rpy_from_ned_frd(np.radians([10, 20, 30]))).round(9).tolist()
    [10.0, -20.0, 60.0]
    """
    return _flu_rpy(rpy_rad)


@rowwise(rpy_rad=(3,))
def ned_frd_rpy_from_enu_flu(rpy_rad: npt.ArrayLike) -> Array:
    """Return roll, pitch, yaw (..., 3), rad, of FRD in NED, given those of FLU in ENU (as in ROS) (M24).

    >>> np.degrees(ned_frd_rpy_from_enu_flu(np.radians([10, -20, 60]))).round(9).tolist()
    [10.0, 20.0, 30.0]
    """
    return _flu_rpy(rpy_rad)


@rowwise(R=(3, 3))
def rpy_from_enu_rfu_matrix(R: npt.ArrayLike) -> Array:
    """Return roll, pitch, heading (..., 3), rad, of matrices (..., 3, 3) that take RFU to ENU (M24).

    They are the same three numbers as in NED and FRD: roll and heading in (-pi, pi], heading clockwise from north,
    pitch in [-pi/2, pi/2], with `rpy_from_quaternion`'s precision and convention at pitch +-pi/2. Away from it they
    equal atan2(-C31, C33), asin(C32) and atan2(C12, C22). What is no rotation gives NaN.

    >>> np.degrees(rpy_from_enu_rfu_matrix([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])).round(9).tolist()  # heading east
    [0.0, 0.0, 90.0]
    """
    return euler_from_matrix(ned_frd_matrix_from_enu_rfu(R))[..., ::-1]


@rowwise(rpy_rad=(3,))
def enu_rfu_matrix_from_rpy(rpy_rad: npt.ArrayLike) -> Array:
    """Return matrices (..., 3, 3) that take RFU to ENU, of roll, pitch, heading (..., 3), rad (M24).

    >>> enu_rfu_matrix_from_rpy([0, 0, np.pi / 2])[:, 1].round(12).tolist()  # heading east: so points the nose, RFU's y
    [1.0, 0.0, 0.0]
    """
    roll, pitch, yaw = vector(rpy_rad)
    return _rfu_matrix(matrix_from_euler(join(yaw, pitch, roll)))
