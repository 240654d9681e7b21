"""The steps of a stream from sample to sample, and its last samples, in which partners are looked for.

What a step means is not judged here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, Int64s, Mask
from gcs_bridge.pairing.bounds import KIN_PER_CHANGE, KIN_PER_TURN, length, turn_and_kin
from gcs_bridge.pairing.kernel import RING
from gcs_bridge.settings import ResetSettings

CHANGE_RAD = radians(0.5)  # by which what is expected may change between two samples, trims in turns included
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


class RecentSamples:
    """The last samples of one stream since the boot, and for each the step that led to it."""

    def __init__(self) -> None:
        self.first = 0  # position of the first sample kept
        self.t_us: Int64s = np.empty(0, np.int64)
        self.q: Floats = np.empty((0, 4))
        self.w: Floats = np.empty((0, 3))
        self.kin: Floats = np.empty(0)  # rad by which the step differs from what the rates say
        self.contradicts_rates: Mask = np.empty(0, np.bool_)
        self.unsteady: Floats = np.empty(0)  # rad/s by which the rates may be off at the sample, as its step shows them
        self.applied_correction: Floats | None = (
            None  # (n, 4) from expected to sent, body side; None: there was no difference yet
        )
        self._applied_correction_last: Floats = _IDENTITY[None]
        self._last: tuple[int, Floats, Floats] | None = None  # the latest in order: t_us, q (1, 4), w (1, 3)

    def append(self, t_us: Int64s, q: Floats, w: Floats, reset: ResetSettings, q_sent: Floats | None) -> Steps:
        """Add samples in order of arrival, and return the steps between them; those that come late have none.

        `q_sent` (n, 4) is the attitude as it was sent, where `q` has been relieved of an expected difference.
        """
        n = len(t_us)
        latest = np.maximum.accumulate(np.concatenate(([-1 if self._last is None else self._last[0]], t_us)))
        in_order = np.flatnonzero(t_us > latest[:-1])
        kin, denied, unsteady = np.full(n, np.inf), np.zeros(n, np.bool_), np.full(n, np.nan)
        steps = NO_STEPS
        applied_correction: Floats | None = None
        if q_sent is not None:
            applied_correction = attitude.multiply(attitude.conjugate(q), q_sent)
        elif self.applied_correction is not None:
            applied_correction = np.broadcast_to(_IDENTITY, (n, 4))
        if len(in_order):
            t, q_in, w_in = t_us[in_order], q[in_order], w[in_order]
            if self._last is not None:
                t = np.concatenate(([self._last[0]], t))
                q_in = np.concatenate((self._last[1], q_in))
                w_in = np.concatenate((self._last[2], w_in))
            if len(t) > 1:
                steps = _steps(in_order[1 - len(t) :], t, q_in, w_in, reset)
                if applied_correction is not None:
                    steps = _without_changes(
                        steps, np.concatenate((self._applied_correction_last, applied_correction[in_order]))[-len(t) :]
                    )
                kin[steps.row], denied[steps.row] = steps.rate_residual_rad, steps.contradicts_rates
                unsteady[steps.row] = (
                    length(steps.w1_b_rad_s - steps.w0_b_rad_s) + 2.0 * steps.rate_residual_rad / steps.h_s
                )
            self._last = (int(t[-1]), q_in[-1:], w_in[-1:])
            self._applied_correction_last = (
                _IDENTITY[None] if applied_correction is None else applied_correction[in_order[-1:]]
            )
        surplus = max(len(self.t_us) - RING, 0)
        self.first += surplus
        self.t_us = np.concatenate((self.t_us[surplus:], t_us))
        self.q = np.concatenate((self.q[surplus:], q))
        self.w = np.concatenate((self.w[surplus:], w))
        self.kin = np.concatenate((self.kin[surplus:], kin))
        self.contradicts_rates = np.concatenate((self.contradicts_rates[surplus:], denied))
        self.unsteady = np.concatenate((self.unsteady[surplus:], unsteady))
        if applied_correction is not None:
            before = (
                np.broadcast_to(_IDENTITY, (len(self.t_us) - n, 4))
                if self.applied_correction is None
                else self.applied_correction[surplus:]
            )
            self.applied_correction = np.concatenate((before, applied_correction))
        return steps


@dataclass(frozen=True)
class Steps:
    """n steps of one stream, from each sample to the next one in order.

    `row` (n,) of the later sample in the batch; `t0_us`, `t1_us` (n,) boot times; `q0_nb`, `q1_nb` (n, 4);
    `w0_b_rad_s`, `w1_b_rad_s` (n, 3); `turn_b_rad` (n, 3) rotation vector of the step, body axes; `rate_residual_rad`
    (n,) how far that is from what the rates say, NaN where the sender reports no rates; `limit_rad` (n,) what is still
    no contradiction; `contradicts_rates` (n,) whether the rates deny the step.
    """

    row: Int64s
    t0_us: Int64s
    t1_us: Int64s
    q0_nb: Floats
    q1_nb: Floats
    w0_b_rad_s: Floats
    w1_b_rad_s: Floats
    turn_b_rad: Floats
    rate_residual_rad: Floats
    limit_rad: Floats
    contradicts_rates: Mask

    def __len__(self) -> int:
        return len(self.row)

    @property
    def h_s(self) -> Floats:
        """How long each step took, s."""
        return np.asarray((self.t1_us - self.t0_us) * 1e-6)


def _no_steps() -> Steps:
    none, q, v, numbers = np.empty(0, np.int64), np.empty((0, 4)), np.empty((0, 3)), np.empty(0)
    return Steps(none, none, none, q, q, v, v, v, numbers, numbers, np.empty(0, np.bool_))


NO_STEPS = _no_steps()


def _steps(row: Int64s, t_us: Int64s, q: Floats, w: Floats, reset: ResetSettings) -> Steps:
    """The steps between consecutive samples."""
    h: Floats = np.asarray((t_us[1:] - t_us[:-1]) * 1e-6)
    w0, w1 = w[:-1], w[1:]
    phi, kin = turn_and_kin(q[:-1], q[1:], w0, w1, h)
    rate, change = np.maximum(length(w0), length(w1)), length(w1 - w0)
    limit = reset.step_rad + reset.per_rate_s * rate + 1.5 * h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
    # A step that hardly turned was not a step, whatever the rates made of it.
    denied = (kin > limit) & (length(phi) > reset.step_rad)
    return Steps(row, t_us[:-1], t_us[1:], q[:-1], q[1:], w0, w1, phi, kin, limit, denied)


def _without_changes(steps: Steps, applied_correction: Floats) -> Steps:
    """The steps without those across which another difference was undone: these are none of the vehicle."""
    changed = attitude.angle_between(applied_correction[:-1], applied_correction[1:]) > CHANGE_RAD
    kin = np.where(changed, np.nan, steps.rate_residual_rad)
    return replace(steps, rate_residual_rad=kin, contradicts_rates=steps.contradicts_rates & ~changed)
