"""Rotation matrices R_nb: `v_n = R_nb @ v_b`; the columns are the body's axes seen in n.

This module knows matrices and quaternions, and nothing of Euler angles or frames.
"""

from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude._rows import Array, Mask, Vector, grid, join, matrix, numbers, ray, rowwise, shaped


def determinant(lines: tuple[Vector, Vector, Vector]) -> Array:
    """Determinant by the first line."""
    (a, b, c), (d, e, f), (g, h, i) = lines
    return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)


@rowwise(angle_rad=())
def elementary_rotation(axis: str, angle_rad: npt.ArrayLike, passive: bool = False) -> Array:
    """Return the rotations (..., 3, 3) by angles (...), rad, about "x", "y" or "z", right-handed (M1).

    Active: turns the vector and keeps the axes. Passive: keeps the vector and turns the axes, the transpose. A
    non-finite angle gives a NaN matrix. Raises ValueError for another axis.

    >>> elementary_rotation("z", np.pi / 2).round(12).tolist()  # x goes to y
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    if axis not in ("x", "y", "z", "X", "Y", "Z"):
        raise ValueError(f"axis is {axis!r}, expected 'x', 'y' or 'z'")
    angle = -numbers(angle_rad) if passive else numbers(angle_rad)
    c, s = np.cos(angle), np.sin(angle)
    zero = 0.0 * c  # NaN where the angle is
    one = zero + 1.0
    if axis in "xX":
        return grid((one, zero, zero), (zero, c, -s), (zero, s, c))
    if axis in "yY":
        return grid((c, zero, s), (zero, one, zero), (-s, zero, c))
    return grid((c, -s, zero), (s, c, zero), (zero, zero, one))


@rowwise(q=(4,))
def matrix_from_quaternion(q: npt.ArrayLike) -> Array:
    """Return the rotation matrices R_nb (..., 3, 3) of quaternions q_nb (..., 4) (M12; Diebel, 6.4).

    The norm of q is divided out, so that the result is a rotation for any norm. A zero or non-finite row gives NaN.
    Raises ValueError for a wrong shape.

    >>> matrix_from_quaternion([1, 0, 0, 1]).round(12).tolist()  # yaw 90 degrees: the nose, column 1, points east
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    (w, x, y, z), norm2 = ray(q)
    double = 2.0 / norm2
    dx, dy, dz = double * x, double * y, double * z
    wx, wy, wz = w * dx, w * dy, w * dz
    xx, xy, xz = x * dx, x * dy, x * dz
    yy, yz, zz = y * dy, y * dz, z * dz
    return grid(
        (1.0 - (yy + zz), xy - wz, xz + wy),
        (xy + wz, 1.0 - (xx + zz), yz - wx),
        (xz - wy, yz + wx, 1.0 - (xx + yy)),
    )


@rowwise(R=(3, 3))
def quaternion_from_matrix(R: npt.ArrayLike) -> Array:
    """Return the unit quaternions (..., 4), w >= 0, of rotation matrices (..., 3, 3) (M13; Markley 2008).

    By the largest of the four candidates: the trace alone loses all digits near half a turn. The matrix is taken as it
    is; bring a drifted one back with `nearest_rotation` first. A non-finite row, or one whose determinant is not
    positive (no rotation is near it), gives NaN. Raises ValueError for a wrong shape.

    >>> quaternion_from_matrix([[1, 0, 0], [0, -1, 0], [0, 0, -1]]).tolist()  # half a turn about x
    [0.0, 1.0, 0.0, 0.0]
    """
    lines = matrix(R)
    (a, b, c), (d, e, f), (g, h, i) = lines
    # The lines of 4 q q^T: each is q times four times one of its components.
    x, y, z = h - f, c - g, d - b
    xy, xz, yz = b + d, c + g, f + h
    ww, xx, yy, zz = 1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i
    by_w, by_y = ww >= xx, yy >= zz
    by_first = np.maximum(ww, xx) >= np.maximum(yy, zz)
    parts = [
        np.where(by_first, np.where(by_w, from_w, from_x), np.where(by_y, from_y, from_z))
        for from_w, from_x, from_y, from_z in ((ww, x, y, z), (x, xx, xy, xz), (y, xy, yy, yz), (z, xz, yz, zz))
    ]
    norm = np.sqrt(sum(part * part for part in parts))
    norm = np.where(determinant(lines) > 0.0, np.copysign(norm, parts[0]), np.nan)
    return join(*(part / norm for part in parts))


def nearest_rotation(R: npt.ArrayLike) -> Array:
    """Return the rotations (..., 3, 3) nearest to matrices (..., 3, 3), in the sum of squares (M2; Kabsch 1978).

    By SVD, with the sign of the determinant repaired: a reflection gives one of the rotations nearest to it. A
    non-finite row, or one of rank below two, for which no rotation is the nearest, gives NaN. Raises ValueError for a
    wrong shape.

    >>> nearest_rotation([[0, -2, 0], [2, 0, 0], [0, 0, 2]]).round(12).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    lines = grid(*matrix(shaped("R", R, ..., 3, 3)))
    good = np.isfinite(lines).all(axis=(-1, -2), keepdims=True)
    u, sizes, vt = np.linalg.svd(np.where(good, lines, 0.0))  # a single NaN would make LAPACK refuse the whole stack
    u[..., 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[..., None]
    unique = sizes[..., 1:2, None] > 1e-15 * sizes[..., :1, None]
    return np.where(unique, np.matmul(u, vt) + 0.0, np.nan)


@rowwise(R=(3, 3))
def is_rotation(R: npt.ArrayLike, tolerance: float = 1e-6) -> Mask:
    """Return where matrices (..., 3, 3) are rotations: R^T R = 1 within `tolerance` by element, and det R > 0 (M2).

    The mask (...) is False for non-finite rows. Raises ValueError for a wrong shape.

    >>> is_rotation([np.eye(3), -np.eye(3)]).tolist()
    [True, False]
    """
    lines = matrix(R)
    pairs = combinations_with_replacement(zip(*lines, strict=True), 2)  # of columns
    errors = [np.abs(p[0] * q[0] + p[1] * q[1] + p[2] * q[2] - (p is q)) for p, q in pairs]
    return np.asarray((np.maximum.reduce(errors) <= tolerance) & (determinant(lines) > 0.0))
