"""Pairs of neighbouring instants, for links on which the two messages never carry one stamp.

The quaternion is interpolated at the time of an Euler sample, with the bound of that. On healthy flights nine of ten
such pairs are within a fifth of noise and bound together, at 4 Hz still within a third, and none beyond (measured at 4
to 25 Hz, in squares, banks, acro and a tumble). They are looked at only while pairs of one instant are rare.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, Int64s, Mask, record
from gcs_bridge.expected.pairs import (
    IN_A_ROW,
    NO_CLEAN_PAIRS,
    STEEP_RAD,
    TAIL,
    CleanPairs,
    EulerRows,
    QuaternionRows,
)
from gcs_bridge.pairing.bounds import KIN_PER_CHANGE, KIN_PER_TURN, interpolation_bound_rad, turn_and_kin

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
    q0, q1 = (attitude.normalise(quaternion.q_nb[of]) for of in (j - 1, j))
    w0, w1, own = quaternion.w_b_rad_s[j - 1], quaternion.w_b_rad_s[j], euler.w_b_rad_s[i]
    h_s = (quaternion.t_us[j] - quaternion.t_us[j - 1]) * 1e-6
    u = (euler.t_us[i] - quaternion.t_us[j - 1]) * 1e-6 / h_s
    q, w = attitude.hermite(q0, q1, w0, w1, dt_s=h_s, u=u)
    _, kin = turn_and_kin(q0, q1, w0, w1, h_s)
    rate = np.maximum(*(np.sqrt(np.square(of).sum(axis=1)) for of in (w0, w1)))
    change = np.sqrt(np.square(w1 - w0).sum(axis=1))
    step = STEP_RAD + STEP_PER_RATE_S * rate + 1.5 * h_s * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
    unknown = np.full(len(i), np.inf)
    bound = STAMP_BOUND_RAD + interpolation_bound_rad(w0, w1, own, w, kin_fast=kin, kin_slow=unknown, h=h_s, u=u)
    known = np.isfinite(bound) & ~(kin > step)
    pairs = BetweenPairs(
        frame_index=quaternion.frame_index[j],
        t_us=euler.t_us[i],
        rpy_rad=euler.rpy_rad[i],
        q_nb=q,
        free=euler.free[i],
        bound_rad=bound,
    )
    return pairs[known], euler.view[i][known]


def _often(euler: EulerRows, i: Int64s, completed: Int64s, exact: tuple[CleanPairs, ...]) -> Mask:
    """Whether pairs of one instant come often enough at samples `i` to say all that there is to say."""
    often = np.zeros(len(i), np.bool_)
    for view, pairs in enumerate(exact):
        if len(pairs) >= IN_A_ROW:
            before = np.searchsorted(pairs.frame_index, completed)
            since_us = euler.t_us[i] - pairs.t_us[before - IN_A_ROW]
            often |= (euler.view[i] == view) & (before >= IN_A_ROW) & (since_us <= RARE_US)
    return often
