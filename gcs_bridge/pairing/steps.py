"""The steps of a stream from sample to sample, and its last samples, in which partners are looked for.

What a step means is not judged here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Columns, Floats, FrameColumns, Int64s, Mask, Ring
from gcs_bridge.pairing.bounds import KIN_PER_CHANGE, KIN_PER_TURN, length, turn_and_kin
from gcs_bridge.pairing.kernel import RING
from gcs_bridge.pairing.neighbours import in_order
from gcs_bridge.settings import ResetSettings
from gcs_bridge.telemetry.samples import AttitudeSamples

CHANGE_RAD = radians(0.5)  # by which what is expected may change between two samples, trims in turns included
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class RecentSamples(Columns):
    """n samples of one stream, and for each the step that led to it.

    `t_us` (n,) since boot; `q` (n, 4), `w` (n, 3), rad/s; `kin` (n,) rad by which the step differs from what the rates
    say; `contradicts_rates` (n,); `unsteady` (n,) rad/s by which the rates may be off at the sample, as its step shows
    them; `applied_correction` (n, 4) from expected to sent, body side; None: there was no difference yet.
    """

    t_us: Int64s
    q: Floats
    w: Floats
    kin: Floats
    contradicts_rates: Mask
    unsteady: Floats
    applied_correction: Floats | None = None


class StreamSteps:
    """Follows one stream since the boot from sample to sample; `recent` are its last samples."""

    def __init__(self, reset: ResetSettings) -> None:
        """Start before the boot's first sample."""
        number = np.empty(0)
        none = RecentSamples(
            t_us=np.empty(0, np.int64),
            q=np.empty((0, 4)),
            w=np.empty((0, 3)),
            kin=number,
            contradicts_rates=np.empty(0, np.bool_),
            unsteady=number,
        )
        self.recent = Ring(RING, none)
        self._reset = reset
        self._applied_correction_last: Floats = _IDENTITY[None]
        self._last: tuple[int, Floats, Floats] | None = None  # the latest in order: t_us, q (1, 4), w (1, 3)

    def append(self, samples: AttitudeSamples, q: Floats, q_sent: Floats | None) -> Steps:
        """Add samples in order of arrival, and return the steps between them; those that come late have none.

        `q` (n, 4) are their attitudes, normalised; `q_sent` (n, 4) as they were sent, where `q` has been relieved of an
        expected difference.
        """
        n, t_us, w = len(samples), samples.t_boot_us, samples.w_nb_b_rad_s
        later = in_order(t_us, -1 if self._last is None else self._last[0])
        kin, denied, unsteady = np.full(n, np.inf), np.zeros(n, np.bool_), np.full(n, np.nan)
        steps = NO_STEPS
        applied_correction: Floats | None = None
        if q_sent is not None:
            applied_correction = attitude.multiply(attitude.conjugate(q), q_sent)
        elif self.recent.rows.applied_correction is not None:
            applied_correction = np.broadcast_to(_IDENTITY, (n, 4))
        if len(later):
            t, q_in, w_in = t_us[later], q[later], w[later]
            if self._last is not None:
                t = np.concatenate(([self._last[0]], t))
                q_in = np.concatenate((self._last[1], q_in))
                w_in = np.concatenate((self._last[2], w_in))
            if len(t) > 1:
                row = later[1 - len(t) :]
                steps = _steps(samples.frame_index[row], t, q_in, w_in, self._reset)
                if applied_correction is not None:
                    steps = _without_changes(
                        steps, np.concatenate((self._applied_correction_last, applied_correction[later]))[-len(t) :]
                    )
                kin[row], denied[row] = steps.rate_residual_rad, steps.contradicts_rates
                unsteady[row] = length(steps.w1_b_rad_s - steps.w0_b_rad_s) + 2.0 * steps.rate_residual_rad / steps.h_s
            self._last = (int(t[-1]), q_in[-1:], w_in[-1:])
            self._applied_correction_last = (
                _IDENTITY[None] if applied_correction is None else applied_correction[later[-1:]]
            )
        before = self.recent.rows
        if applied_correction is not None and before.applied_correction is None:
            identity = np.broadcast_to(_IDENTITY, (len(before), 4))
            self.recent.rows = replace(before, applied_correction=identity)
        self.recent.append(
            RecentSamples(
                t_us=t_us,
                q=q,
                w=w,
                kin=kin,
                contradicts_rates=denied,
                unsteady=unsteady,
                applied_correction=applied_correction,
            )
        )
        return steps


@dataclass(frozen=True, kw_only=True)
class Steps(FrameColumns):
    """n steps of one stream, from each sample to the next one in order.

    `frame_index` (n,) of the later sample; `t0_us`, `t1_us` (n,) boot times; `q0_nb`, `q1_nb` (n, 4);
    `w0_b_rad_s`, `w1_b_rad_s` (n, 3); `turn_b_rad` (n, 3) rotation vector of the step, body axes; `rate_residual_rad`
    (n,) how far that is from what the rates say, NaN where the sender reports no rates; `limit_rad` (n,) what is still
    no contradiction; `contradicts_rates` (n,) whether the rates deny the step.
    """

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

    @property
    def h_s(self) -> Floats:
        """How long each step took, s."""
        return np.asarray((self.t1_us - self.t0_us) * 1e-6)


def _no_steps() -> Steps:
    none, q, v, numbers = np.empty(0, np.int64), np.empty((0, 4)), np.empty((0, 3)), np.empty(0)
    return Steps(
        frame_index=none,
        t0_us=none,
        t1_us=none,
        q0_nb=q,
        q1_nb=q,
        w0_b_rad_s=v,
        w1_b_rad_s=v,
        turn_b_rad=v,
        rate_residual_rad=numbers,
        limit_rad=numbers,
        contradicts_rates=np.empty(0, np.bool_),
    )


NO_STEPS = _no_steps()


def _steps(frame_index: Int64s, t_us: Int64s, q: Floats, w: Floats, reset: ResetSettings) -> Steps:
    """The steps between consecutive samples."""
    h: Floats = np.asarray((t_us[1:] - t_us[:-1]) * 1e-6)
    w0, w1 = w[:-1], w[1:]
    phi, kin = turn_and_kin(q[:-1], q[1:], w0, w1, h)
    rate, change = np.maximum(length(w0), length(w1)), length(w1 - w0)
    limit = reset.step_rad + reset.per_rate_s * rate + 1.5 * h * (KIN_PER_CHANGE * change + KIN_PER_TURN * rate)
    # A step that hardly turned was not a step, whatever the rates made of it.
    denied = (kin > limit) & (length(phi) > reset.step_rad)
    return Steps(
        frame_index=frame_index,
        t0_us=t_us[:-1],
        t1_us=t_us[1:],
        q0_nb=q[:-1],
        q1_nb=q[1:],
        w0_b_rad_s=w0,
        w1_b_rad_s=w1,
        turn_b_rad=phi,
        rate_residual_rad=kin,
        limit_rad=limit,
        contradicts_rates=denied,
    )


def _without_changes(steps: Steps, applied_correction: Floats) -> Steps:
    """The steps without those across which another difference was undone: these are none of the vehicle."""
    changed = attitude.angle_between(applied_correction[:-1], applied_correction[1:]) > CHANGE_RAD
    kin = np.where(changed, np.nan, steps.rate_residual_rad)
    return replace(steps, rate_residual_rad=kin, contradicts_rates=steps.contradicts_rates & ~changed)
