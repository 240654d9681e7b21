"""Euler angles of all 12 sequences, intrinsic and extrinsic, by one general method; roll, pitch, yaw named after it.

A sequence is three letters, as in SciPy: upper case intrinsic (each turn about the axes as turned so far), lower case
extrinsic (about fixed axes). An extrinsic sequence is the intrinsic one read backwards, with the angles reversed.
Angles are listed in the order of the letters.

With the axes i, j, k in the order of the intrinsic turns and s = +1 where i, j, k runs like x, y, z, else -1, the
half-angle products of q = e_i(first) * e_j(second) * e_k(third) combine into two complex numbers (Bernardes and
Viollet, PLOS ONE 2022),

    Tait-Bryan   low = (w - q_j) + i (q_i - s q_k)      high = (w + q_j) + i (q_i + s q_k)
    proper       low =  w        + i  q_i               high =  q_j      + i  s q_k      (k is the axis left over)

whose arguments are half the difference and half the sum of the outer angles and whose lengths give the middle one. No
asin or acos is taken, so nothing is lost near a singularity: there one of the lengths vanishes, and with it the
argument.
For Z-Y-X this is M14's exact form, A being the argument of `high` and B that of `low`.
"""

import functools
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude._rows import Array, Mask, Quaternion, Vector, join, numbers, ray, rowwise, vector
from gcs_bridge.attitude.matrix import matrix_from_quaternion, quaternion_from_matrix

TURN = 2.0 * np.pi

LOCKED = 1e-15
"""M5: from here on, 2e-15 rad from a singularity, rounding alone decides what an outer angle would be."""


class Sequence(NamedTuple):
    """An Euler sequence: axes as indices into `[w, x, y, z]`, in the order of the intrinsic turns."""

    i: int
    j: int
    k: int
    handedness: int
    proper: bool
    intrinsic: bool


@functools.cache
def parsed(letters: str) -> Sequence:
    """Read the letters of a sequence, or raise ValueError."""
    axes = ["xyz".find(letter) + 1 for letter in letters.lower()]
    well_formed = len(axes) == 3 and 0 not in axes and axes[0] != axes[1] != axes[2]
    if not well_formed or letters not in (letters.upper(), letters.lower()):
        raise ValueError(
            f"sequence is {letters!r}, expected three axes, no two neighbours alike: 'ZYX' intrinsic, 'zyx' extrinsic"
        )
    i, j, k = axes if letters.isupper() else axes[::-1]
    proper = i == k
    if proper:
        k = 6 - i - j
    return Sequence(i, j, k, 1 if (j - i) % 3 == 1 else -1, proper, letters.isupper())


def sequence_of(letters: str) -> Sequence:
    """Read the letters of a sequence, or raise ValueError for anything else."""
    if not isinstance(letters, str):
        raise ValueError(f"sequence is {letters!r}, expected a string such as 'ZYX'")
    return parsed(letters)


def split(q: Quaternion, sequence: Sequence) -> tuple[Array, Array, Array, Array]:
    """Return `low` and `high` of the method as real and imaginary parts."""
    w, q_i, q_j, q_k = q[0], q[sequence.i], q[sequence.j], sequence.handedness * q[sequence.k]
    if sequence.proper:
        return w, q_i, q_j, q_k
    return w - q_j, q_i - q_k, w + q_j, q_i + q_k


def wrapped(angle: Array) -> Array:
    """Bring an angle into (-pi, pi]."""
    near = angle - TURN * np.rint(angle / TURN)
    return np.where(near <= -np.pi, np.pi, np.minimum(near, np.pi))  # rounding may leave it a float outside


def angles_of(q: Quaternion, sequence: Sequence) -> tuple[Array, Array, Array]:
    """Return the three angles in the order of the letters, of a quaternion of any norm."""
    low_re, low_im, high_re, high_im = split(q, sequence)
    low, high = np.arctan2(low_im, low_re), np.arctan2(high_im, high_re)
    low_size = np.sqrt(low_re * low_re + low_im * low_im)
    high_size = np.sqrt(high_re * high_re + high_im * high_im)
    middle = 2.0 * np.arctan2(high_size, low_size)
    locked = np.minimum(low_size, high_size) <= LOCKED * np.maximum(low_size, high_size)
    if np.logical_or.reduce(locked, axis=None):
        # The argument that vanished is free: it is set so that the angle listed last is zero (M5).
        mirror = 1.0 if sequence.intrinsic else -1.0
        free_low = locked & (low_size < high_size)
        free_high = locked & ~free_low
        low, high = np.where(free_low, mirror * high, low), np.where(free_high, mirror * low, high)
    first, third = wrapped(low + high), low - high
    if not sequence.proper:
        middle = middle - 0.5 * np.pi
        third = -sequence.handedness * third
    third = wrapped(third)
    return (first, middle, third) if sequence.intrinsic else (third, middle, first)


def quaternion_of(angles: Vector, sequence: Sequence) -> Quaternion:
    """Return the unit quaternion of three angles in the order of the letters."""
    i, j, k, handedness, proper, intrinsic = sequence
    first, middle, third = (0.5 * angle for angle in (angles if intrinsic else angles[::-1]))
    c1, s1, c2, s2, c3, s3 = np.cos(first), np.sin(first), np.cos(middle), np.sin(middle), np.cos(third), np.sin(third)
    cc, cs, sc, ss = c1 * c3, c1 * s3, s1 * c3, s1 * s3
    if proper:
        w, q_i, q_j, q_k = c2 * (cc - ss), c2 * (sc + cs), s2 * (cc + ss), s2 * handedness * (sc - cs)
    else:
        c2_s, s2_s = c2 * handedness, s2 * handedness
        w, q_i, q_j, q_k = c2 * cc - s2_s * ss, c2 * sc + s2_s * cs, s2 * cc - c2_s * ss, c2 * cs + s2_s * sc
    parts = {i: q_i, j: q_j, k: q_k}
    return w, parts[1], parts[2], parts[3]


def quaternion_of_rpy(roll: Array, pitch: Array, yaw: Array) -> Quaternion:
    """The same for Z-Y-X, written out (M11)."""
    c1, s1 = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    c2, s2 = np.cos(0.5 * pitch), np.sin(0.5 * pitch)
    c3, s3 = np.cos(0.5 * roll), np.sin(0.5 * roll)
    cc, cs, sc, ss = c1 * c3, c1 * s3, s1 * c3, s1 * s3
    return c2 * cc + s2 * ss, c2 * cs - s2 * sc, s2 * cc + c2 * ss, c2 * sc - s2 * cs


@rowwise(angles_rad=(3,))
def quaternion_from_euler(angles_rad: npt.ArrayLike, sequence: str = "ZYX") -> Array:
    """Return the unit quaternions (..., 4) of Euler angles (..., 3), rad, in the sequence's order (M7, M10, M11).

    Any finite angles are taken; a non-finite row gives NaN. Raises ValueError for a wrong shape or an unknown sequence.

    >>> quaternion_from_euler([np.pi / 2, 0, 0]).round(6).tolist()  # Z-Y-X: yaw comes first
    [0.707107, 0.0, 0.0, 0.707107]
    """
    return join(*quaternion_of(vector(angles_rad), sequence_of(sequence)))


@rowwise(q=(4,))
def euler_from_quaternion(q: npt.ArrayLike, sequence: str = "ZYX") -> Array:
    """Return the Euler angles (..., 3), rad, of quaternions (..., 4), in the sequence's order (M7, M14).

    The outer angles are in (-pi, pi]; the middle one is in [-pi/2, pi/2] for three different axes, in [0, pi] where the
    first axis comes back. As a rotation they are exact to 1e-15 rad everywhere. At a singularity (`near_gimbal_lock`)
    the angle listed last is 0 and the first takes the whole turn: for Z-Y-X, roll is 0 (M5). The norm of q is divided
    out, a zero or non-finite row gives NaN. Raises ValueError for a wrong shape or an unknown sequence.

    >>> np.degrees(euler_from_quaternion([1, 0, 0, 1])).round(9).tolist()
    [90.0, 0.0, 0.0]
    >>> np.degrees(euler_from_quaternion([1, 0, 0, 1], "XYZ")).round(9).tolist()
    [0.0, 0.0, 90.0]
    """
    return join(*angles_of(ray(q)[0], sequence_of(sequence)))


def matrix_from_euler(angles_rad: npt.ArrayLike, sequence: str = "ZYX") -> Array:
    """Return the rotation matrices (..., 3, 3) of Euler angles (..., 3), rad, in the sequence's order (M3, M7).

    For "ZYX", Rz(yaw) Ry(pitch) Rx(roll). A non-finite row gives NaN. Raises ValueError for a wrong shape or an unknown
    sequence.

    >>> matrix_from_euler([0, np.pi / 2, 0])[:, 0].round(12).tolist()  # pitch 90 degrees: the nose points up, -z
    [0.0, 0.0, -1.0]
    """
    return matrix_from_quaternion(quaternion_from_euler(angles_rad, sequence))


def euler_from_matrix(R: npt.ArrayLike, sequence: str = "ZYX") -> Array:
    """Return the Euler angles (..., 3), rad, of rotation matrices (..., 3, 3), in the sequence's order (M4, M7).

    Ranges, singularities and precision are those of `euler_from_quaternion`; what is no rotation, those of
    `quaternion_from_matrix`: NaN. Raises ValueError for a wrong shape or an unknown sequence.

    >>> np.degrees(euler_from_matrix([[0, -1, 0], [1, 0, 0], [0, 0, 1]])).round(9).tolist()
    [90.0, 0.0, 0.0]
    """
    return euler_from_quaternion(quaternion_from_matrix(R), sequence)


@rowwise(roll_rad=(), pitch_rad=(), yaw_rad=())
def quaternion_from_rpy(*, roll_rad: npt.ArrayLike, pitch_rad: npt.ArrayLike, yaw_rad: npt.ArrayLike) -> Array:
    """Return the unit quaternions q_nb (..., 4) of roll, pitch and yaw (...), rad, NED and FRD (M11; Diebel, 8.2).

    Yaw turns first, then pitch, then roll: q_z(yaw) * q_y(pitch) * q_x(roll). Any finite angles are taken, a non-finite
    row gives NaN. Raises ValueError where the shapes do not broadcast.

    >>> quaternion_from_rpy(roll_rad=0, pitch_rad=0, yaw_rad=np.pi).round(12).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    return join(*quaternion_of_rpy(numbers(roll_rad), numbers(pitch_rad), numbers(yaw_rad)))


@rowwise(q=(4,))
def rpy_from_quaternion(q: npt.ArrayLike) -> Array:
    """Return roll, pitch, yaw (..., 3), rad, of quaternions q_nb (..., 4), NED and FRD (M14 in its exact form).

    Roll and yaw are in (-pi, pi], pitch in [-pi/2, pi/2]. At pitch +-pi/2 roll is 0 and yaw takes the whole turn (M5).
    The norm of q is divided out, a zero or non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> np.degrees(rpy_from_quaternion([1, 1, 0, 0])).round(9).tolist()
    [90.0, 0.0, 0.0]
    """
    yaw, pitch, roll = angles_of(ray(q)[0], parsed("ZYX"))
    return join(roll, pitch, yaw)


@rowwise(q=(4,))
def heading(q: npt.ArrayLike) -> Array:
    """Return the heading (...) of quaternions q_nb (..., 4), rad, in [0, 2 pi), clockwise from north (M6).

    It is the yaw of `rpy_from_quaternion`, at pitch +-pi/2 too. The norm of q is divided out, a zero or non-finite row
    gives NaN. Raises ValueError for a wrong shape.

    >>> float(np.degrees(heading([1, 0, 0, -1])).round(9))  # 90 degrees to the left is west
    270.0
    """
    yaw = angles_of(ray(q)[0], parsed("ZYX"))[0]
    positive = np.where(yaw < 0.0, yaw + TURN, yaw)
    return np.where(positive >= TURN, 0.0, positive)  # a hair west of north rounds to a whole turn


@rowwise(q=(4,))
def near_gimbal_lock(q: npt.ArrayLike, tolerance_rad: float = 1e-3, sequence: str = "ZYX") -> Mask:
    """Return where the middle angle is within `tolerance_rad` of a singularity of the sequence (M5).

    q is (..., 4), the mask (...). For three different axes the singularities are at +-pi/2, else at 0 and pi. There
    only the sum or the difference of the outer angles means anything. A zero or non-finite row gives False. Raises
    ValueError for a wrong shape or an unknown sequence.

    >>> near_gimbal_lock([[1, 0, 0, 0], [1, 0, 1, 0]]).tolist()
    [False, True]
    """
    low_re, low_im, high_re, high_im = split(ray(q)[0], sequence_of(sequence))
    low = np.sqrt(low_re * low_re + low_im * low_im)
    high = np.sqrt(high_re * high_re + high_im * high_im)
    return np.asarray(2.0 * np.arctan2(np.minimum(low, high), np.maximum(low, high)) <= tolerance_rad)
