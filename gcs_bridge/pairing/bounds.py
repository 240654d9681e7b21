"""The error bound of an interpolated attitude, and what it rests on: how far a step is from what its rates say.

Which samples are a pair is not decided here.
"""

from __future__ import annotations

from math import radians

import numpy as np

from gcs_bridge.attitude._rows import Array, Quaternion, Vector, where
from gcs_bridge.attitude.quaternion import conjugated, length, logarithm, product
from gcs_bridge.columns import Floats

# The error bound of an interpolated attitude, fitted on some 2.5 hours of flight that carry both messages.
RATE_BOUND_S = 0.001  # both stamps are whole milliseconds
KIN_MARGIN_RAD = radians(0.1)
KIN_FLOOR_RAD = radians(0.2)
KIN_PER_RATE_S = 0.002
KIN_PER_CHANGE = 0.5  # of the change of rate over the gap
KIN_PER_TURN = 0.1  # of the turn over the gap
UNREPORTED_TURN_RAD = radians(0.5)  # a step this large between rates of exactly zero: the sender reports no rates
BEYOND_GYROS_RAD_S = 40.0  # autopilots' gyros end at 2000 deg/s, 35 rad/s: larger rates are none


def turn_and_kin(q0: Floats, q1: Floats, w0: Floats, w1: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Of steps of h (...) s: the rotation vector (..., 3), and how far (...), rad, that is from what the rates say.

    `q0`, `q1` (..., 4); `w0`, `w1` (..., 3), rad/s. The second is NaN where the sender reports no rates.
    """
    phi, kin = turn_and_kin_of(_four(q0), _four(q1), _three(w0), _three(w1), h)
    return np.stack(phi, axis=-1), kin


def interpolation_bound_rad(
    w0: Floats, w1: Floats, own: Floats, w: Floats, *, kin_fast: Floats, kin_slow: Floats, h: Floats, u: Floats
) -> Floats:
    """What interpolating at the share u (...) of a gap of h (...) s may add to a disagreement, rad (...).

    Rates (..., 3): `w0`, `w1` the faster stream's at both ends, `own` the slower sample's, `w` the interpolant's.
    `kin_fast` of the step across the gap, `kin_slow` of the slower stream's last one (NaN, inf: unknown).
    """
    return interpolation_bound_of(_three(w0), _three(w1), _three(own), _three(w), kin_fast, kin_slow, h, u)


# The same of components, for kernels too.


def turn_and_kin_of(q0: Quaternion, q1: Quaternion, w0: Vector, w1: Vector, h: Array) -> tuple[Vector, Array]:
    """The step's rotation vector, and by how much the mean of the rates at its ends misses it; NaN without rates."""
    phi = logarithm(product(conjugated(q0), q1))
    half = 0.5 * h
    kin = length((phi[0] - half * (w0[0] + w1[0]), phi[1] - half * (w0[1] + w1[1]), phi[2] - half * (w0[2] + w1[2])))
    speed0, speed1 = length(w0), length(w1)
    unreported = (speed0 == 0.0) & (speed1 == 0.0) & (length(phi) > UNREPORTED_TURN_RAD)
    unreported = unreported | (speed0 > BEYOND_GYROS_RAD_S) | (speed1 > BEYOND_GYROS_RAD_S)
    return phi, where(unreported, np.nan, kin)


def interpolation_bound_of(
    w0: Vector, w1: Vector, own: Vector, w: Vector, kin_fast: Array, kin_slow: Array, h: Array, u: Array
) -> Array:
    """As `interpolation_bound_rad`."""
    # A slower stream that reports no rates has no say; without the faster one's, nothing bounds the error.
    rate = np.fmax(np.maximum(length(w0), length(w1)), length(own))
    change = length((w1[0] - w0[0], w1[1] - w0[1], w1[2] - w0[2]))
    kin = np.minimum(kin_fast, where(np.isnan(kin_slow), np.inf, kin_slow) + KIN_MARGIN_RAD)
    kin = np.minimum(kin, KIN_FLOOR_RAD + KIN_PER_RATE_S * rate + h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate))
    bow = 4.0 * u * (1.0 - u)
    known = np.isfinite(own[0]) & np.isfinite(own[1]) & np.isfinite(own[2])
    bend = where(known, length((w[0] - own[0], w[1] - own[1], w[2] - own[2])), 0.0)
    return RATE_BOUND_S * rate + 0.5 * bow * (kin + h * bend)


def _three(v: Floats) -> Vector:
    return v[..., 0], v[..., 1], v[..., 2]


def _four(q: Floats) -> Quaternion:
    return q[..., 0], q[..., 1], q[..., 2], q[..., 3]
