"""Pairs of neighbouring instants, for links on which the two messages never carry one stamp.

The quaternion is interpolated at the time of an Euler sample, with the bound of that. On healthy flights nine of ten
such pairs are within a fifth of noise and bound together, at 4 Hz still within a third, and none beyond (measured at 4
to 25 Hz, in squares, banks, acro and a tumble). They are looked at only while pairs of one instant are rare.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude.compiled import unit_at, vector_at
from gcs_bridge.attitude.kinematics import interpolated
from gcs_bridge.attitude.quaternion import length
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, record
from gcs_bridge.expected.pairs import (
    IN_A_ROW,
    NO_CLEAN_PAIRS,
    STEEP_RAD,
    TAIL,
    CleanPairs,
    EulerRows,
    QuaternionRows,
)
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.bounds import KIN_PER_CHANGE, KIN_PER_TURN, interpolation_bound_of, turn_and_kin_of

BETWEEN_NOISE_RAD = math.radians(0.05)  # beside the bound
BETWEEN_NOISE_VIEW_RAD = math.radians(0.1)  # of a view: 0.035° by AHRS_TRIM of 2° comes to it
TELLS_RAD = math.radians(0.3)  # a wider bound agrees with anything
LONGEST_US = 1_000_000  # between two quaternions
RARE_US = 5_000_000  # where fewer than three pairs of one instant came in so long, they are rare
STAMP_BOUND_RAD = math.radians(0.02)  # stamps are whole milliseconds
STEP_RAD = math.radians(2.2)  # a step between two quaternions that misses their rates by more, and
STEP_PER_RATE_S = 0.002  # by more than so much of the rate, is none of the vehicle: nothing lies between


@record
class BetweenPairs(CleanPairs):
    """Pairs of an Euler sample and the quaternion between two others, completed by the frame of the second."""

    bound_rad: Floats  # (n,) of the interpolation

    def scale(self, noise_rad: float) -> Floats:
        """How far (n,) a healthy pair may be apart, rad."""
        return noise_rad + self.bound_rad


NO_BETWEEN_PAIRS = BetweenPairs(**vars(NO_CLEAN_PAIRS), bound_rad=np.empty(0))


def pairs_between(
    euler: EulerRows, quaternion: QuaternionRows, after: int, exact: tuple[CleanPairs, ...]
) -> tuple[BetweenPairs, npt.NDArray[np.int8]]:
    """The pairs that were completed after the frame `after`, and the view of each.

    `exact`: of each view the latest pairs of one instant.
    """
    j = np.flatnonzero(quaternion.frame_index > after)
    j = j[j > 0]
    none = NO_BETWEEN_PAIRS, np.empty(0, np.int8)
    if not len(j) or not len(euler):
        return none
    completed, t0_us, t1_us = quaternion.frame_index[j], quaternion.t_us[j - 1], quaternion.t_us[j]
    arrived = np.searchsorted(euler.frame_index, completed)
    i = np.minimum(np.searchsorted(euler.t_us, t1_us), arrived) - 1
    good = (i >= 0) & (t1_us - t0_us <= LONGEST_US) & (arrived - i <= TAIL)
    good[good] = euler.t_us[i[good]] > t0_us[good]
    good[good] = np.abs(euler.rpy_rad[i[good], 1]) <= STEEP_RAD
    good[good] &= ~_often(euler, i[good], completed[good], exact)
    i, j = i[good], j[good]
    if not len(i):
        return none
    q, bound = np.empty((len(i), 4)), np.empty(len(i))
    before, behind = (_Seen(quaternion.t_us[of], quaternion.q_nb[of], quaternion.w_b_rad_s[of]) for of in (j - 1, j))
    see_between(before, behind, euler.t_us[i], euler.w_b_rad_s[i], q, bound)
    pairs = BetweenPairs(
        frame_index=quaternion.frame_index[j],
        t_us=euler.t_us[i],
        rpy_rad=euler.rpy_rad[i],
        q_nb=q,
        free=euler.free[i],
        bound_rad=bound,
    )
    known = np.isfinite(bound)
    return pairs[known], euler.view[i][known]


class _Seen(NamedTuple):
    """Quaternions (n, 4) with their times and rates."""

    t_us: Int64s
    q_nb: FloatRows
    w_b_rad_s: FloatRows


@helper
def between_of(q0: Any, q1: Any, w0: Any, w1: Any, own: Any, h: Any, u: Any) -> Any:
    """The quaternion at the share `u` of a gap of `h` s, and the bound of that; NaN: none is known."""
    between, w = interpolated(q0, q1, w0, w1, h, u)
    _, kin = turn_and_kin_of(q0, q1, w0, w1, h)
    rate, change = np.maximum(length(w0), length(w1)), length((w1[0] - w0[0], w1[1] - w0[1], w1[2] - w0[2]))
    step = STEP_RAD + STEP_PER_RATE_S * rate + 1.5 * h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
    bound = STAMP_BOUND_RAD + interpolation_bound_of(w0, w1, own, w, kin, np.inf * h, h, u)
    return between, np.nan if kin > step or not np.isfinite(bound) else bound


@kernel
def see_between(
    before: _Seen, behind: _Seen, t_us: Int64s, own_b_rad_s: FloatRows, q_nb: FloatRows, bound_rad: Floats
) -> None:
    """Fill the quaternions (n, 4) at times between those `before` and `behind`, and their bounds (n,)."""
    for i in range(t_us.size):
        h = (behind.t_us[i] - before.t_us[i]) * 1e-6
        u = (t_us[i] - before.t_us[i]) * 1e-6 / h
        q0, q1 = unit_at(before.q_nb, i), unit_at(behind.q_nb, i)
        w0, w1 = vector_at(before.w_b_rad_s, i), vector_at(behind.w_b_rad_s, i)
        q, bound = between_of(q0, q1, w0, w1, vector_at(own_b_rad_s, i), h, u)
        bound_rad[i] = bound
        for axis in range(4):
            q_nb[i, axis] = q[axis]


def _often(euler: EulerRows, i: Int64s, completed: Int64s, exact: tuple[CleanPairs, ...]) -> Mask:
    """Whether pairs of one instant come often enough at samples `i` to say all that there is to say."""
    often = np.zeros(len(i), np.bool_)
    for view, pairs in enumerate(exact):
        if len(pairs) >= IN_A_ROW:
            before = np.searchsorted(pairs.frame_index, completed)
            since_us = euler.t_us[i] - pairs.t_us[before - IN_A_ROW]
            often |= (euler.view[i] == view) & (before >= IN_A_ROW) & (since_us <= RARE_US)
    return often
