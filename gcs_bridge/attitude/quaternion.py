"""Unit quaternions `[w, x, y, z]` (Hamilton, scalar first): algebra, exponential map, distance, interpolation, mean.

A quaternion q_nb takes components in b to components in n: `v_n = q * [0, v_b] * q*`. Attitudes are directions in four
dimensions: where a function wants an attitude, the quaternion's length is divided out, and its sign never matters.
Only `multiply`, `conjugate` and `continuous` leave the length alone. A stream's norm is judged before it comes here.

The first part works on components and is shared by the modules above this one; the second is the public face.
"""

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude._rows import (
    Array,
    Quaternion,
    Vector,
    join,
    numbers,
    ray,
    rowwise,
    shaped,
    unit,
    vector,
    where,
)

TINY = 1e-150
"""Stands in for a length of zero where a quotient has a limit: sin(TINY)/TINY is exactly 1, and TINY**2 is a float."""

HEADING_UNDEFINED_RAD = np.radians(150.0)
"""M17: above this tilt the heading between two attitudes means little."""


# Components


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product (M10)."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (  # the pairs make q* q exactly real, and so the distance of equal attitudes exactly zero
        aw * bw - ax * bx - (ay * by + az * bz),
        (aw * bx + ax * bw) + (ay * bz - az * by),
        (aw * by + ay * bw) + (az * bx - ax * bz),
        (aw * bz + az * bw) + (ax * by - ay * bx),
    )


def conjugated(q: Quaternion) -> Quaternion:
    """Conjugate: of a unit quaternion, the inverse."""
    w, x, y, z = q
    return w, -x, -y, -z


def cross(a: Vector, b: Vector) -> Vector:
    """Right-handed vector product."""
    ax, ay, az = a
    bx, by, bz = b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def length(v: Vector) -> Array:
    """Euclidean norm."""
    x, y, z = v
    return np.sqrt(x * x + y * y + z * z)


def turned(q: Quaternion, norm2: Array, v: Vector) -> Vector:
    """Vector v turned by a quaternion of any norm: v + w t + u x t with t = 2 u x v / |q|^2."""
    w, ux, uy, uz = q
    tx, ty, tz = cross((ux, uy, uz), v)
    double = 2.0 / norm2
    tx, ty, tz = tx * double, ty * double, tz * double
    sx, sy, sz = cross((ux, uy, uz), (tx, ty, tz))
    x, y, z = v
    return x + w * tx + sx, y + w * ty + sy, z + w * tz + sz


def exponential(v: Vector) -> Quaternion:
    """Unit quaternion of a rotation vector (M9)."""
    x, y, z = v
    half = np.maximum(0.5 * length(v), TINY)  # sin(h)/h has its limit 1 there, with all digits: no series is needed
    # sin h = 2t/(1 + t^2) and cos h = (1 - t^2)/(1 + t^2): numpy's tangent takes less than half the time of the two.
    # Up to half a turn the rotation is right to 7e-16 rad, with sine and cosine to 6e-16.
    t = np.tan(0.5 * half)
    square = t * t
    whole = 1.0 + square
    scale = t / (whole * half)
    return (1.0 - square) / whole, x * scale, y * scale, z * scale


def logarithm(q: Quaternion) -> Vector:
    """Rotation vector of a quaternion of any norm, the short way round (M9)."""
    w, x, y, z = q
    sine = np.maximum(length((x, y, z)), TINY)  # atan2(s, w)/s has its limit 1/w there
    # atan2 of both parts keeps every digit at 0 and at pi, where acos(w) and asin(s) lose half of them.
    scale = np.copysign(2.0 * np.arctan2(sine, np.abs(w)) / sine, w)
    return x * scale, y * scale, z * scale


def angle_of(q: Quaternion) -> Array:
    """Angle by which a quaternion of any norm turns, in [0, pi] (M17)."""
    w, x, y, z = q
    return 2.0 * np.arctan2(length((x, y, z)), np.abs(w))


def tilt_heading_of(difference: Quaternion) -> tuple[Array, Array]:
    """Tilt and heading of a difference b * a^-1 on the world's side, of any norm (M17)."""
    w, x, y, z = difference
    # Swing and twist of the difference: its twist about z is (w, z), and what is left turns z by the tilt.
    tilt = 2.0 * np.arctan2(np.sqrt(x * x + y * y), np.sqrt(w * w + z * z))
    heading = 2.0 * np.arctan2(where(w < 0.0, -z, z), np.abs(w))
    heading = where(heading <= -np.pi, np.pi, heading)
    return tilt, where(tilt <= HEADING_UNDEFINED_RAD, heading, np.nan)


def between(a: Quaternion, b: Quaternion, share: Array) -> Quaternion:
    """Unit quaternion at a share of the short way between two of unit norm, with a's sign (M18)."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    sign = where(aw * bw + ax * bx + ay * by + az * bz < 0.0, -1.0, 1.0)
    bw, bx, by, bz = bw * sign, bx * sign, by * sign, bz * sign
    # The angle by difference and sum (Kahan): acos of the dot product is blind below 1e-8 rad.
    apart = np.sqrt((aw - bw) ** 2 + (ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2)
    along = np.sqrt((aw + bw) ** 2 + (ax + bx) ** 2 + (ay + by) ** 2 + (az + bz) ** 2)
    angle = np.maximum(2.0 * np.arctan2(apart, along), TINY)
    sine = np.sin(angle)
    near, far = np.sin((1.0 - share) * angle) / sine, np.sin(share * angle) / sine
    return near * aw + far * bw, near * ax + far * bx, near * ay + far * by, near * az + far * bz


# Algebra


@rowwise(a=(4,), b=(4,))
def multiply(a: npt.ArrayLike, b: npt.ArrayLike) -> Array:
    """Return the Hamilton product of two quaternions: first b turns, then a (M10; Diebel 2006, section 6.3).

    Arguments are (..., 4) quaternions `[w, x, y, z]` of any norm; the result (..., 4) has the product of their norms.
    q_nc = q_nb * q_bc. A zero or non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> multiply([0, 1, 0, 0], [0, 0, 1, 0]).tolist()  # i j = k
    [0.0, 0.0, 0.0, 1.0]
    """
    return join(*product(ray(a)[0], ray(b)[0]))


@rowwise(q=(4,))
def conjugate(q: npt.ArrayLike) -> Array:
    """Return `[w, -x, -y, -z]`: of a unit quaternion q_nb the inverse, q_bn (M10).

    Takes and returns (..., 4), the norm is kept. A zero or non-finite row gives NaN. Raises ValueError for a wrong
    shape.

    >>> conjugate([1, 2, 3, 4]).tolist()
    [1.0, -2.0, -3.0, -4.0]
    """
    return join(*conjugated(ray(q)[0]))


@rowwise(q=(4,))
def normalise(q: npt.ArrayLike) -> Array:
    """Return the quaternions (..., 4) with unit norm and the same sign (M8).

    A zero or non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> normalise([0, 3, 0, 4]).round(12).tolist()
    [0.0, 0.6, 0.0, 0.8]
    """
    return join(*unit(q))


@rowwise(q=(4,), v=(3,))
def rotate(q: npt.ArrayLike, v: npt.ArrayLike) -> Array:
    """Return v turned by q: with q_nb, the components in n of a vector given in b (notation of M8 to M12).

    q is (..., 4), v (..., 3) in any unit; the result (..., 3) has v's unit. The norm of q is divided out. A zero q or a
    non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> yaw_90_deg = [0.5**0.5, 0, 0, 0.5**0.5]
    >>> rotate(yaw_90_deg, [1, 0, 0]).round(12).tolist()  # the nose points east
    [0.0, 1.0, 0.0]
    """
    return join(*turned(*ray(q), vector(v)))


# Axis, angle, rotation vector


@rowwise(v=(3,))
def quaternion_from_rotvec(v: npt.ArrayLike) -> Array:
    """Return the unit quaternions (..., 4) of rotation vectors (..., 3), axis times angle, rad (M9; Diebel, 7.1).

    Any angle is taken, precise to the last digit at zero. A non-finite row gives NaN. Raises ValueError for a wrong
    shape.

    >>> quaternion_from_rotvec([0, 0, np.pi]).round(12).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    return join(*exponential(vector(v)))


@rowwise(q=(4,))
def rotvec_from_quaternion(q: npt.ArrayLike) -> Array:
    """Return the rotation vectors (..., 3), rad, of quaternions (..., 4), the short way round (M9; Diebel, 7.1).

    The length is in [0, pi], precise at both ends; at pi either of the two axes may come out. The norm of q is divided
    out, a zero or non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> np.degrees(rotvec_from_quaternion([-1, 1, 0, 0])).round(9).tolist()  # 270 deg is 90 deg the other way
    [-90.0, 0.0, 0.0]
    """
    return join(*logarithm(ray(q)[0]))


@rowwise(axis=(3,), angle_rad=())
def quaternion_from_axis_angle(axis: npt.ArrayLike, angle_rad: npt.ArrayLike) -> Array:
    """Return the unit quaternions (..., 4) that turn by an angle, rad, (...) about an axis (..., 3) of any length (M9).

    A zero axis or a non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> quaternion_from_axis_angle([0, 0, 5], np.pi).round(12).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    x, y, z = vector(axis)
    half = 0.5 * numbers(angle_rad)
    size = length((x, y, z))
    scale = np.sin(half) / np.where(size > TINY, size, np.nan)
    return join(np.cos(half) + 0.0 * scale, x * scale, y * scale, z * scale)  # a meaningless axis spoils w too


# Distance


@rowwise(a=(4,), b=(4,))
def angle_between(a: npt.ArrayLike, b: npt.ArrayLike) -> Array:
    """Return the angle (...) of the rotation from attitude a to b, rad, in [0, pi] (M17).

    a and b are (..., 4); norms are divided out, signs do not matter. Exact to 1e-15 rad at zero too, where
    2 acos|w| loses half of the digits. A zero or non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> float(np.degrees(angle_between([1, 0, 0, 0], [1, 0, 0, -1])).round(9))
    90.0
    """
    return angle_of(product(conjugated(ray(a)[0]), ray(b)[0]))


@rowwise(a=(4,), b=(4,))
def tilt_heading_between(a: npt.ArrayLike, b: npt.ArrayLike) -> tuple[Array, Array]:
    """Split the difference of attitude b, seen from a, into tilt and heading (M17), both (...), rad.

    a and b are q_nb, (..., 4), in a world whose z is down; norms are divided out, signs do not matter. The tilt, in
    [0, pi], is the angle between the two down vectors in the body. The heading, in (-pi, pi], is the turn of the
    difference (world side) about down, positive clockwise seen from above; it is NaN where the tilt exceeds 150
    degrees. A zero or non-finite row gives NaN in both. Raises ValueError for a wrong shape.

    >>> tilt, heading = tilt_heading_between([1, 0, 0, 0], [1, 0, 0, 1])
    >>> float(tilt), float(np.degrees(heading).round(9))
    (0.0, 90.0)
    """
    return tilt_heading_of(product(ray(b)[0], conjugated(ray(a)[0])))


# Between and among attitudes


@rowwise(a=(4,), b=(4,), t=())
def slerp(a: npt.ArrayLike, b: npt.ArrayLike, t: npt.ArrayLike) -> Array:
    """Return the attitude (..., 4) at the share t of the short way from a to b, at constant rate (M18; Shoemake 1985).

    a and b are (..., 4), norms are divided out; t is (...), in [0, 1], and outside it, or not finite, the row is NaN:
    nothing is extrapolated. The result has a's sign. A zero or non-finite row gives NaN. Raises ValueError for a wrong
    shape.

    >>> slerp([1, 0, 0, 0], [0, 0, 0, 1], 1 / 3).round(6).tolist()  # 60 of 180 degrees about z
    [0.866025, 0.0, 0.0, 0.5]
    """
    share = numbers(t)
    share = np.where((share >= 0.0) & (share <= 1.0), share, np.nan)
    return join(*between(unit(a), unit(b), share))


def mean(q: npt.ArrayLike) -> Array:
    """Return the mean attitude (..., 4) of n attitudes (..., n, 4), blind to signs (M19; Markley et al. 2007).

    Norms are divided out; the result has w >= 0. Zero and non-finite rows are left out. NaN where no row is left, or
    where the attitudes lie so evenly that no mean is better than another. Raises ValueError for a wrong shape.

    >>> mean([[1, 0, 0, 0], [-1, 0, 0, -1]]).round(6).tolist()  # 0 and 90 degrees of yaw
    [0.92388, 0.0, 0.0, 0.382683]
    """
    rows = normalise(shaped("q", q, ..., "n", 4))
    rows[np.isnan(rows)] = 0.0
    values, vectors = np.linalg.eigh(np.matmul(rows.swapaxes(-1, -2), rows))
    largest = vectors[..., -1]
    clear = values[..., -1] - values[..., -2] > 1e-12 * values[..., -1]
    return np.where(clear[..., None], np.where(largest[..., :1] < 0.0, -largest, largest) + 0.0, np.nan)


def continuous(q: npt.ArrayLike) -> Array:
    """Return the stream (..., n, 4), in the order of time, with the signs that make it continuous (M16).

    The first row keeps its sign, every later one gets the sign with which it is nearer to its predecessor; norms are
    kept. Zero and non-finite rows become NaN, and the row after them looks at the last good one. Raises ValueError for
    a wrong shape.

    >>> continuous([[1, 0, 0, 0], [-0.8, 0, 0, -0.6], [-1, 0, 0, 0]])[:, 0].tolist()
    [1.0, 0.8, 1.0]
    """
    rows = join(*ray(shaped("q", q, ..., "n", 4))[0])
    good = ~np.isnan(rows[..., 0])
    index = np.arange(rows.shape[-2])
    latest = np.maximum.accumulate(np.where(good, index, 0), axis=-1)
    before = np.take_along_axis(rows, np.concatenate([latest[..., :1], latest[..., :-1]], axis=-1)[..., None], axis=-2)
    flips = np.where((rows * before).sum(axis=-1) < 0.0, -1.0, 1.0)
    return rows * np.multiply.accumulate(flips, axis=-1)[..., None]
