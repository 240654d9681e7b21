"""The error bound of an interpolated attitude, and what it rests on: how far a step is from what its rates say.

Which samples are a pair is not decided here.
"""

from __future__ import annotations

from math import radians

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats

# The error bound of an interpolated attitude, fitted on some 2.5 hours of flight that carry both messages.
RATE_BOUND_S = 0.001  # both stamps are whole milliseconds
KIN_MARGIN_RAD = radians(0.1)
KIN_FLOOR_RAD = radians(0.2)
KIN_PER_RATE_S = 0.002
KIN_PER_CHANGE = 0.5  # of the change of rate over the gap
KIN_PER_TURN = 0.1  # of the turn over the gap
UNREPORTED_TURN_RAD = radians(0.5)  # a step this large between rates of exactly zero: the sender reports no rates


def length(v: Floats) -> Floats:
    """The lengths (...) of vectors (..., 3)."""
    return np.asarray(np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2 + v[..., 2] ** 2))


def turn_and_kin(q0: Floats, q1: Floats, w0: Floats, w1: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Of steps of h (...) s: the rotation vector (..., 3), and how far (...), rad, that is from what the rates say.

    `q0`, `q1` (..., 4); `w0`, `w1` (..., 3), rad/s. The second is NaN where the sender reports no rates.
    """
    phi = attitude.rotvec_from_quaternion(attitude.multiply(attitude.conjugate(q0), q1))
    kin = length(phi - 0.5 * h[..., None] * (w0 + w1))
    kin[(length(w0) == 0) & (length(w1) == 0) & (length(phi) > UNREPORTED_TURN_RAD)] = np.nan
    return phi, kin


def interpolation_bound_rad(
    w0: Floats, w1: Floats, own: Floats, w: Floats, *, kin_fast: Floats, kin_slow: Floats, h: Floats, u: Floats
) -> Floats:
    """What interpolating at the share u (...) of a gap of h (...) s may add to a disagreement, rad (...).

    Rates (..., 3): `w0`, `w1` the faster stream's at both ends, `own` the slower sample's, `w` the interpolant's.
    `kin_fast` of the step across the gap, `kin_slow` of the slower stream's last one (NaN, inf: unknown).
    """
    # A slower stream that reports no rates has no say; without the faster one's, nothing bounds the error.
    rate = np.fmax(np.maximum(length(w0), length(w1)), length(own))
    change = length(w1 - w0)
    kin = np.minimum(kin_fast, np.nan_to_num(kin_slow, nan=np.inf) + KIN_MARGIN_RAD)
    kin = np.minimum(kin, KIN_FLOOR_RAD + KIN_PER_RATE_S * rate + h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate))
    bow = 4.0 * u * (1.0 - u)
    bend = np.where(np.isfinite(own).all(axis=-1), length(w - own), 0.0)
    return np.asarray(RATE_BOUND_S * rate + 0.5 * bow * (kin + h * bend))
