"""How attitudes and body rates belong together (M18, M20).

Body rates w are in rad/s about the body's x, y, z. Times are in seconds.
"""

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude._rows import Array, Quaternion, Vector, grid, join, numbers, ray, rowwise, unit, vector
from gcs_bridge.attitude.quaternion import TINY, conjugated, cross, exponential, length, logarithm, product

SMALL_RAD = 1e-4
"""Below it the Jacobians' second-order coefficients stand still: what they multiply is smaller than 1e-8, and they
change by 1e-10 of it, while their closed forms would lose all digits to cancellation."""


# Components


def scaled(v: Vector, factor: Array | float) -> Vector:
    """Vector times number."""
    x, y, z = v
    return x * factor, y * factor, z * factor


def added(*vectors: Vector) -> Vector:
    """Sum of vectors."""
    x, y, z = vectors[0]
    for dx, dy, dz in vectors[1:]:
        x, y, z = x + dx, y + dy, z + dz
    return x, y, z


def right_jacobian_times(phi: Vector, v: Vector) -> Vector:
    """J_r(phi) v: the body rate where the rotation vector is phi and changes at v (Chirikjian 2012, 10.86)."""
    angle = length(phi)
    half = np.maximum(0.5 * angle, TINY)
    sinc = np.sin(half) / half
    clear = np.maximum(angle, SMALL_RAD)
    once = cross(phi, v)
    return added(v, scaled(once, -0.5 * sinc * sinc), scaled(cross(phi, once), (clear - np.sin(clear)) / clear**3))


def inverse_right_jacobian_times(phi: Vector, w: Vector) -> Vector:
    """J_r(phi)^-1 w: how fast the rotation vector phi changes at the body rate w."""
    clear = np.maximum(length(phi), SMALL_RAD)
    once = cross(phi, w)
    second_order = (1.0 - 0.5 * clear / np.tan(0.5 * clear)) / (clear * clear)
    return added(w, scaled(once, 0.5), scaled(cross(phi, once), second_order))


def interpolated(
    start: Quaternion, end: Quaternion, w0: Vector, w1: Vector, dt: Array, share: Array
) -> tuple[Quaternion, Vector]:
    """Cubic Hermite in the rotation vector from `start`, of unit norm, to `end`: attitude and body rates (M18)."""
    return interpolated_along(logarithm(product(conjugated(start), end)), start, w0, w1, dt, share)


def interpolated_along(
    whole: Vector, start: Quaternion, w0: Vector, w1: Vector, dt: Array, share: Array
) -> tuple[Quaternion, Vector]:
    """The same to where the rotation vector `whole` leads."""
    slope0 = scaled(w0, dt)
    slope1 = scaled(inverse_right_jacobian_times(whole, w1), dt)
    rest = 1.0 - share
    phi = added(
        scaled(whole, share * share * (3.0 - 2.0 * share)),
        scaled(slope0, share * rest * rest),
        scaled(slope1, -share * share * rest),
    )
    slope = added(
        scaled(whole, 6.0 * share * rest),
        scaled(slope0, rest * (1.0 - 3.0 * share)),
        scaled(slope1, share * (3.0 * share - 2.0)),
    )
    x, y, z = right_jacobian_times(phi, slope)
    return product(start, exponential(phi)), (x / dt, y / dt, z / dt)


# Rates of quaternions


@rowwise(w=(3,))
def omega_matrix(w: npt.ArrayLike) -> Array:
    """Return the matrices Omega (..., 4, 4) of body rates (..., 3), rad/s: dq/dt = Omega q / 2 (M20; Titterton, 3.61).

    A non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> omega_matrix([1, 2, 3])[0].tolist()
    [0.0, -1.0, -2.0, -3.0]
    """
    p, q, r = vector(w)
    o = 0.0 * p  # NaN where the rates are
    return grid((o, -p, -q, -r), (p, o, r, -q), (q, -r, o, p), (r, q, -p, o))


@rowwise(q=(4,), w=(3,))
def quaternion_rate(q: npt.ArrayLike, w: npt.ArrayLike) -> Array:
    """Return dq/dt = q * [0, w] / 2, per second, (..., 4), of q_nb (..., 4) and body rates (..., 3), rad/s (M20).

    Linear in q, whose norm is not divided out. A zero q or a non-finite row gives NaN. Raises ValueError for a wrong
    shape.

    >>> quaternion_rate([1, 0, 0, 0], [0, 0, 2]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    x, y, z = scaled(vector(w), 0.5)
    return join(*product(ray(q)[0], (0.0 * x, x, y, z)))


@rowwise(q=(4,), w=(3,), dt_s=())
def integrate(q: npt.ArrayLike, w: npt.ArrayLike, dt_s: npt.ArrayLike) -> Array:
    """Return the unit quaternions (..., 4) after dt_s (...), s, at constant body rates (..., 3), rad/s (M20, M18).

    q * exp(w dt), exact for a constant rate; the past for a negative dt_s. The norm of q (..., 4) is divided out. A
    zero q or a non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> integrate([1, 0, 0, 0], [0, 0, np.pi], 0.5).round(6).tolist()
    [0.707107, 0.0, 0.0, 0.707107]
    """
    moved = product(unit(q), exponential(scaled(vector(w), numbers(dt_s))))
    return join(*unit(join(*moved)))


@rowwise(a=(4,), b=(4,), dt_s=())
def body_rates_between(a: npt.ArrayLike, b: npt.ArrayLike, dt_s: npt.ArrayLike) -> Array:
    """Return the constant body rates (..., 3), rad/s, that lead from attitude a to b the short way in dt_s (M17, M20).

    a and b are (..., 4), norms divided out, signs without meaning; dt_s is (...), s. The inverse of `integrate` below
    half a turn. A zero or non-finite row, or dt_s = 0, gives NaN. Raises ValueError for a wrong shape.

    >>> np.degrees(body_rates_between([1, 0, 0, 0], [1, 0, 0, 1], 0.5)).round(9).tolist()
    [0.0, 0.0, 180.0]
    """
    dt = numbers(dt_s)
    step = logarithm(product(conjugated(ray(a)[0]), ray(b)[0]))
    x, y, z = step
    dt = np.where(dt == 0.0, np.nan, dt)
    return join(x / dt, y / dt, z / dt)


# Rates of Euler angles


@rowwise(rpy_rad=(3,), w=(3,))
def euler_rates_from_body_rates(rpy_rad: npt.ArrayLike, w: npt.ArrayLike) -> Array:
    """Return the rates of roll, pitch, yaw (..., 3), rad/s, of body rates (..., 3) (M20; Titterton, 3.52).

    rpy_rad is (..., 3). They grow without bound towards pitch +-pi/2, and at it (cos pitch below 1e-15) are NaN, as in
    a non-finite row. Raises ValueError for a wrong shape.

    >>> euler_rates_from_body_rates([0, 0, 1], [1, 2, 3]).tolist()  # level: the same three axes
    [1.0, 2.0, 3.0]
    """
    roll, pitch, _ = vector(rpy_rad)  # a bad yaw has made them NaN too
    p, q, r = vector(w)
    sin_roll, cos_roll, cos_pitch = np.sin(roll), np.cos(roll), np.cos(pitch)
    cos_pitch = np.where(np.abs(cos_pitch) > 1e-15, cos_pitch, np.nan)
    yaw_rate = (q * sin_roll + r * cos_roll) / cos_pitch
    return join(p + yaw_rate * np.sin(pitch), q * cos_roll - r * sin_roll + 0.0 * yaw_rate, yaw_rate)


@rowwise(rpy_rad=(3,), rates=(3,))
def body_rates_from_euler_rates(rpy_rad: npt.ArrayLike, rates: npt.ArrayLike) -> Array:
    """Return the body rates (..., 3), rad/s, of roll, pitch, yaw and their rates (..., 3), rad/s (M20).

    rpy_rad is (..., 3). Defined at any pitch. A non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> body_rates_from_euler_rates([0, np.pi / 2, 0], [1, 0, 1]).round(12).tolist()  # nose up: yaw undoes roll
    [0.0, 0.0, 0.0]
    """
    roll, pitch, _ = vector(rpy_rad)  # a bad yaw has made them NaN too
    roll_rate, pitch_rate, yaw_rate = vector(rates)
    sin_roll, cos_roll = np.sin(roll), np.cos(roll)
    level = yaw_rate * np.cos(pitch)
    p = roll_rate - yaw_rate * np.sin(pitch)
    q = pitch_rate * cos_roll + level * sin_roll
    r = level * cos_roll - pitch_rate * sin_roll
    return join(p, q, r)


# Between two samples


@rowwise(phi=(3,), w=(3,))
def right_jacobian_inverse_times(phi: npt.ArrayLike, w: npt.ArrayLike) -> Array:
    """Return J_r(phi)^-1 w (..., 3), rad/s: how fast the rotation vector changes (Chirikjian 2012, 10.86; Bortz 1971).

    phi (..., 3), rad, shorter than a whole turn, is the rotation vector from a fixed attitude to the body, w (..., 3)
    the body rate, rad/s: d phi/dt = w + phi x w / 2 + (1 - (a/2) cot(a/2))/a^2 phi x (phi x w) with a = |phi|, precise
    at zero. A non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> right_jacobian_inverse_times([0, 0, np.pi], [1, 0, 0]).round(6).tolist()
    [0.0, 1.570796, 0.0]
    """
    return join(*inverse_right_jacobian_times(vector(phi), vector(w)))


@rowwise(q0=(4,), q1=(4,), w0=(3,), w1=(3,), dt_s=(), u=())
def hermite(
    q0: npt.ArrayLike,
    q1: npt.ArrayLike,
    w0: npt.ArrayLike,
    w1: npt.ArrayLike,
    dt_s: npt.ArrayLike,
    u: npt.ArrayLike,
) -> tuple[Array, Array]:
    """Return attitude (..., 4) and body rates (..., 3) at the share u of the way between two samples with rates (M18).

    A cubic Hermite in the rotation vector phi of q0^-1 * q(u): phi(0) = 0, phi(1) = log(q0^-1 q1) the short way, and
    slopes that are the body rates w0 and w1, rad/s, at the ends. q0 and q1 are (..., 4), norms divided out; dt_s is the
    time between them, s, u is in [0, 1], both (...). The attitude has q0's sign at u = 0 and unit norm; the rates are
    the interpolant's own, rad/s. A zero or non-finite row, dt_s = 0, or u outside [0, 1] gives NaN in both. Raises
    ValueError for a wrong shape.

    >>> from gcs_bridge.attitude import rotvec_from_quaternion
    >>> q, w = hermite([1, 0, 0, 0], [0, 0, 0, 1], [0, 0, np.pi], [0, 0, np.pi], 1.0, 0.5)  # steady: halfway at half
    >>> np.degrees(rotvec_from_quaternion(q)).round(9).tolist(), np.degrees(w).round(9).tolist()
    ([0.0, 0.0, 90.0], [0.0, 0.0, 180.0])
    """
    dt, share = numbers(dt_s), numbers(u)
    dt = np.where(dt == 0.0, np.nan, dt)
    share = np.where((share >= 0.0) & (share <= 1.0), share, np.nan)
    q, w = interpolated(unit(q0), ray(q1)[0], vector(w0), vector(w1), dt, share)
    return join(*q), join(*w)
