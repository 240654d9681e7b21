"""What a pair is worth, and a step: both attitudes at one instant, what of their rates differs, and the bound of that.

Of neighbouring samples the faster stream is interpolated (rule M18); a step is held against the rates at its ends.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.attitude._rows import where
from gcs_bridge.attitude.compiled import put, unit_at, vector_of
from gcs_bridge.attitude.kinematics import interpolated
from gcs_bridge.attitude.quaternion import length, product
from gcs_bridge.columns import FloatRows, Floats, Int64Rows, Int64s, Mask, MaskRows
from gcs_bridge.jit import helper, share
from gcs_bridge.pairing.bounds import (
    KIN_PER_CHANGE,
    KIN_PER_TURN,
    interpolation_bound_of,
    turn_and_kin_of,
)
from gcs_bridge.pairing.state import (
    APPLIED,
    DENIED,
    EULER,
    EXPECTED,
    KIN,
    LATEST,
    UNSTEADY,
    Q,
    W,
    four,
    three,
)

share(turn_and_kin_of, interpolation_bound_of)


class PairRows(NamedTuple):
    """Where the pairs go: as `Pairs` of `pairing.pairs`, with room (n,)."""

    frame_index: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    same_instant: Mask
    q_euler: FloatRows
    q_quaternion: FloatRows
    q_euler_sent: FloatRows
    w_nb_b_rad_s: FloatRows
    w_differs_b_rad_s: FloatRows
    unsteady_rad_s: Floats
    bound_rad: Floats
    after_reset: Mask
    interval_id: Int64s
    duration_us: Int64s


class StepRows(NamedTuple):
    """Where the steps of both streams go: as `Steps` of `pairing.steps`, each with room (2, n)."""

    frame_index: Int64Rows
    t0_us: Int64Rows
    t1_us: Int64Rows
    q0_nb: Annotated[Floats, 3]
    q1_nb: Annotated[Floats, 3]
    w0_b_rad_s: Annotated[Floats, 3]
    w1_b_rad_s: Annotated[Floats, 3]
    turn_b_rad: Annotated[Floats, 3]
    rate_residual_rad: FloatRows
    limit_rad: FloatRows
    contradicts_rates: MaskRows


class Limits(NamedTuple):
    """Of the pairing."""

    max_gap_us: int
    same_instant_bound_rad: float
    step_rad: float
    per_rate_s: float


@helper
def step_to(state: Any, k: Any, position: Any, frame_index: Any, limits: Any, steps: Any, n: Any) -> Any:
    """Put down the step from the stream's latest sample to the one at `position`; how many steps there are then."""
    last = state.time.shape[1] - 1
    row, before = state.rows[k, position & last], state.latest[k]
    t0_us, t1_us = state.of[k, LATEST], state.time[k, position & last]
    h = (t1_us - t0_us) * 1e-6
    q0, q1 = four(before, Q), four(row, Q)
    w0, w1 = three(before, W), three(row, W)
    phi, kin = turn_and_kin_of(q0, q1, w0, w1, h)
    rate, change = np.maximum(length(w0), length(w1)), length((w1[0] - w0[0], w1[1] - w0[1], w1[2] - w0[2]))
    limit = limits.step_rad + limits.per_rate_s * rate + 1.5 * h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
    # A step that hardly turned was not a step, whatever the rates made of it.
    denied = kin > limit and length(phi) > limits.step_rad
    # Across a change of what is undone there is no step of the vehicle.
    changed = before[EXPECTED] != row[EXPECTED]
    kin, denied = where(changed, np.nan, kin), denied and not changed
    row[KIN], row[DENIED], row[UNSTEADY] = kin, denied, change + 2.0 * kin / h
    steps.frame_index[k, n], steps.t0_us[k, n], steps.t1_us[k, n] = frame_index, t0_us, t1_us
    put(q0, steps.q0_nb[k], n)
    put(q1, steps.q1_nb[k], n)
    for axis in range(3):
        steps.w0_b_rad_s[k, n, axis], steps.w1_b_rad_s[k, n, axis] = w0[axis], w1[axis]
    put(phi, steps.turn_b_rad[k], n)
    steps.rate_residual_rad[k, n], steps.limit_rad[k, n], steps.contradicts_rates[k, n] = kin, limit, denied
    return n + 1


@helper
def _begin_pair(state: Any, slower: Any, sample: Any, row: Any, pairs: Any, n: Any) -> Any:
    """What every pair has, whatever its partner: time, and the slower stream's own attitude."""
    pairs.t_boot_us[n] = state.time[slower, sample & (state.time.shape[1] - 1)]
    q = pairs.q_euler if slower == EULER else pairs.q_quaternion
    for axis in range(4):
        q[n, axis] = row[axis]


@helper
def _resend(pairs: Any, n: Any, row: Any) -> Any:
    """Put back into the Euler side what was expected of its sample."""
    put(product(four(pairs.q_euler[n], 0), four(row, APPLIED)), pairs.q_euler_sent, n)


@helper
def pair_at_once(state: Any, slower: Any, sample: Any, partner: Any, limits: Any, pairs: Any, n: Any) -> Any:
    """A pair of one instant; the rates of both are compared, unless one reports none and sends zeros."""
    last = state.time.shape[1] - 1
    row, other = state.rows[slower, sample & last], state.rows[1 - slower, partner & last]
    _begin_pair(state, slower, sample, row, pairs, n)
    q = pairs.q_quaternion if slower == EULER else pairs.q_euler
    for axis in range(4):
        q[n, axis] = other[axis]
    reported = length(three(row, W)) != 0.0 and length(three(other, W)) != 0.0
    sign = 1.0 if slower == EULER else -1.0
    for axis in range(3):
        pairs.w_nb_b_rad_s[n, axis] = other[W + axis]
        pairs.w_differs_b_rad_s[n, axis] = sign * (other[W + axis] - row[W + axis]) if reported else np.nan
    # The calmer one's: a stream whose rates are wrong finds its own step unsteady, and would excuse itself.
    pairs.unsteady_rad_s[n] = np.fmin(row[UNSTEADY], other[UNSTEADY])
    pairs.same_instant[n], pairs.after_reset[n], pairs.interval_id[n] = True, False, -1
    pairs.bound_rad[n] = limits.same_instant_bound_rad
    _resend(pairs, n, row if slower == EULER else other)


@helper
def pair_between(state: Any, slower: Any, sample: Any, before: Any, after: Any, limits: Any, pairs: Any, n: Any) -> Any:
    """A pair with the faster stream interpolated between two of its samples (rule M18), and the bound of that."""
    last = state.time.shape[1] - 1
    row, fast = state.rows[slower, sample & last], 1 - slower
    _begin_pair(state, slower, sample, row, pairs, n)
    rows = state.rows[fast]
    one, two = rows[before & last], rows[after & last]
    t0_us = state.time[fast, before & last]
    gap_us = state.time[fast, after & last] - t0_us
    u, h = (pairs.t_boot_us[n] - t0_us) / gap_us, gap_us * 1e-6
    q0, q1 = unit_at(rows, before & last), unit_at(rows, after & last)
    own, w0, w1 = three(row, W), three(one, W), three(two, W)
    q, w = interpolated(q0, q1, vector_of(w0[0], w0[1], w0[2]), vector_of(w1[0], w1[1], w1[2]), h, u)
    put(q, pairs.q_quaternion if slower == EULER else pairs.q_euler, n)
    put(w, pairs.w_nb_b_rad_s, n)
    for axis in range(3):
        pairs.w_differs_b_rad_s[n, axis] = np.nan
    pairs.unsteady_rad_s[n] = np.nan
    pairs.same_instant[n], pairs.interval_id[n] = False, after
    pairs.after_reset[n] = two[DENIED] != 0.0 and one[DENIED] == 0.0
    pairs.bound_rad[n] = limits.same_instant_bound_rad + interpolation_bound_of(
        w0, w1, own, w, two[KIN], row[KIN], h, u
    )
    _resend(pairs, n, row if slower == EULER else two)
