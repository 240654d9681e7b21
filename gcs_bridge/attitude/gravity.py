"""What an accelerometer says about attitude and motion (M21 to M23).

World NED, body FRD. Specific force f_b is what an ideal accelerometer reads, m/s^2: at rest and level [0, 0, -g].
"""

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude._rows import Array, Mask, Quaternion, Vector, join, numbers, ray, rowwise, vector, where
from gcs_bridge.attitude.euler import angles_of, parsed
from gcs_bridge.attitude.quaternion import TINY, conjugated, cross, length, turned

G_M_S2 = 9.80665
"""Standard gravity."""

REST_TILT_RAD = np.radians(5.0)
"""An attitude may be wrong by this much at rest, and then seems to accelerate at g sin(5 deg) = 0.85 m/s^2."""


# Components


def down_of(q: Quaternion, norm2: Array) -> Vector:
    """The world's down seen from the body, a unit vector, of a quaternion of any norm (M17): R_bn z."""
    w, x, y, z = q
    double = 2.0 / norm2
    return double * (x * z - w * y), double * (y * z + w * x), 1.0 - double * (x * x + y * y)


def down_felt(f: Vector) -> Vector:
    """The down that an accelerometer at rest sees, a unit vector (M23): -f/|f|."""
    x, y, z = f
    size = length(f)
    size = where(size > TINY, -size, np.nan)
    return x / size, y / size, z / size


def tilt_felt(q: Quaternion, norm2: Array, f: Vector) -> Array:
    """Angle between the accelerometer's down and the attitude's (M23)."""
    zero = 0.0 * norm2
    down = turned(conjugated(q), norm2, (zero, zero, zero + 1.0))
    angle = np.arctan2(length(cross(down, f)), -(down[0] * f[0] + down[1] * f[1] + down[2] * f[2]))
    return where(length(f) > TINY, angle, np.nan)


# Specific force and acceleration


@rowwise(q=(4,))
def body_down(q: npt.ArrayLike) -> Array:
    """Return the world's down seen from the body (..., 3), a unit vector, of q_nb (..., 4) (M17, M23): R_bn z.

    The norm of q is divided out, a zero or non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> body_down([1, 1, 0, 0]).round(12).tolist()  # rolled right by 90 degrees: down is to the right
    [0.0, 1.0, 0.0]
    """
    return join(*down_of(*ray(q)))


@rowwise(f_b=(3,))
def down_from_specific_force(f_b: npt.ArrayLike) -> Array:
    """Return the down that an accelerometer at rest sees (..., 3), a unit vector in b, of f_b (..., 3) (M23): -f/|f|.

    Free fall shows no down: a zero row gives NaN, as does a non-finite one. Raises ValueError for a wrong shape.

    >>> down_from_specific_force([0, 0, -9.8]).tolist()
    [0.0, 0.0, 1.0]
    """
    return join(*down_felt(vector(f_b)))


@rowwise(q_nb=(4,), f_b=(3,))
def accelerometer_tilt(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Array:
    """Return the angle (...), rad, in [0, pi], between the accelerometer's down and the attitude's (M23).

    At rest it is the error of one of them; in accelerated flight it is not. q_nb is (..., 4), f_b (..., 3) in any unit.
    Free fall, a zero q or a non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> float(np.degrees(accelerometer_tilt([1, 0, 0, 0], [0, -9.8, -9.8])).round(9))
    45.0
    """
    return tilt_felt(*ray(q_nb), vector(f_b))


@rowwise(q_nb=(4,), a_n=(3,))
def specific_force(q_nb: npt.ArrayLike, a_n: npt.ArrayLike) -> Array:
    """Return the specific force f_b (..., 3), m/s^2, at the acceleration a_n (..., 3) (M21; Titterton, 3.2).

    f_b = R_bn (a_n - g_n): every force but gravity. q_nb is (..., 4), its norm is divided out. A zero q or a non-finite
    row gives NaN. Raises ValueError for a wrong shape.

    >>> specific_force([1, 0, 0, 0], [0, 0, 0]).tolist()  # at rest and level
    [0.0, 0.0, -9.80665]
    """
    q, norm2 = ray(q_nb)
    x, y, z = vector(a_n)
    return join(*turned(conjugated(q), norm2, (x, y, z - G_M_S2)))


@rowwise(q_nb=(4,), f_b=(3,))
def acceleration_ned(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Array:
    """Return the acceleration a_n (..., 3), m/s^2, NED, of the specific force f_b (..., 3) (M22): R_nb f_b + g_n.

    q_nb is (..., 4), its norm is divided out. A zero q or a non-finite row gives NaN. Raises ValueError for a wrong
    shape.

    >>> acceleration_ned([1, 0, 0, 0], [0, 0, 0]).tolist()  # free fall
    [0.0, 0.0, 9.80665]
    """
    return join(*_acceleration(q_nb, f_b))


@rowwise(q_nb=(4,), f_b=(3,))
def acceleration_level(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Array:
    """Return the acceleration a_h (..., 3), m/s^2, in the level frame: along the nose, to the right, down (M22).

    a_h = Ry(pitch) Rx(roll) f_b + [0, 0, g]. q_nb is (..., 4), its norm is divided out; f_b is (..., 3), m/s^2. A zero
    q or a non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> acceleration_level([1, 0, 0, 1], [2, 0, -9.80665]).round(9).tolist()  # forward stays forward at any yaw
    [2.0, 0.0, 0.0]
    """
    return _level(q_nb, _acceleration(q_nb, f_b))


@rowwise(q_nb=(4,), v_n=(3,))
def level_from_ned(q_nb: npt.ArrayLike, v_n: npt.ArrayLike) -> Array:
    """Return the level-frame components R_hn v_n (..., 3) of a vector v_n (..., 3): NED turned by the yaw alone (M22).

    q_nb is (..., 4), v_n in any unit. At pitch +-pi/2 the yaw is M5's. A zero q or a non-finite row gives NaN. Raises
    ValueError for a wrong shape.

    >>> level_from_ned([1, 0, 0, 1], [0, 5, 1]).round(12).tolist()  # flying east with the nose east
    [5.0, 0.0, 1.0]
    """
    return _level(q_nb, vector(v_n))


def _acceleration(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Vector:
    x, y, z = turned(*ray(q_nb), vector(f_b))
    return x, y, z + G_M_S2


def _level(q_nb: npt.ArrayLike, v_n: Vector) -> Array:
    yaw = angles_of(ray(q_nb)[0], parsed("ZYX"))[0]
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = v_n
    return join(c * x + s * y, c * y - s * x, z + 0.0 * c)


@rowwise(q_nb=(4,), mass_kg=())
def hover_thrust(q_nb: npt.ArrayLike, mass_kg: npt.ArrayLike) -> Array:
    """Return the thrust T (...), N, along -z of the body that carries the weight at an attitude (M23): m g / R33.

    It solves the vertical part of m a_n = R_nb [0, 0, -T] + m g_n = 0, m (...), kg. Level, T = m g: a result of -m g or
    0 there means that a sign or a frame is wrong. Beyond 90 degrees of tilt T is negative. No thrust carries the weight
    where the body's z lies level (R33 = 0): NaN, as in a zero or non-finite row. Raises ValueError for a wrong shape.

    >>> float(hover_thrust([1, 0, 0, 0], 2.0))
    19.6133
    """
    (_, x, y, _), norm2 = ray(q_nb)
    vertical = 1.0 - 2.0 / norm2 * (x * x + y * y)
    return numbers(mass_kg) * G_M_S2 / np.where(np.abs(vertical) > 1e-15, vertical, np.nan)


@rowwise(q_nb=(4,), f_b=(3,))
def may_stand_still(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Mask:
    """Return where (...) the acceleration is no larger than an attitude wrong by 5 degrees would feign at rest.

    q_nb is (..., 4), f_b (..., 3), m/s^2. A zero q or a non-finite row gives False. Raises ValueError for a wrong
    shape.

    >>> may_stand_still([1, 0, 0, 0], [[0, 0, -9.8], [2, 0, -9.8]]).tolist()
    [True, False]
    """
    return np.asarray(length(_acceleration(q_nb, f_b)) < G_M_S2 * np.sin(REST_TILT_RAD))
