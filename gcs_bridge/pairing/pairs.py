"""Two sampled descriptions of one attitude → pairs at one instant, each with a bound on the error of its alignment.

Samples of the same `time_boot_ms` are a pair. Any other sample of the slower stream is compared with the faster one,
interpolated at its time: a cubic Hermite in the rotation vector, which uses the body rates at both ends. (The other
way round, or latest against latest, shows tens of degrees on healthy aircraft.) Nothing is interpolated across a
reboot, a gap that is too long, or a step that the stream's own rates deny.

`match_kernel` decides which samples form a pair, one sample after the other in order of arrival, so it cannot depend
on how they were cut into batches. What a pair is worth is computed for all of a batch's pairs at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, Ring
from gcs_bridge.pairing.bounds import interpolation_bound_rad, length
from gcs_bridge.pairing.kernel import EULER, MATCH, QUATERNION, match_kernel, new_match_state
from gcs_bridge.pairing.steps import NO_STEPS, RecentSamples, Steps, StreamSteps
from gcs_bridge.settings import AlignmentSettings, ResetSettings
from gcs_bridge.telemetry.samples import AttitudeSamples


@dataclass(frozen=True, kw_only=True)
class Pairs(FrameColumns):
    """n pairs of attitudes at one instant each, in the order in which they were completed.

    `t_boot_us` (n,); `frame_index`, `t_rx_us` (n,) of the sample that completed it; `same_instant` (n,);
    `q_euler`, `q_quaternion` (n, 4) unit [w, x, y, z], FRD to NED, `q_euler_sent` (n, 4) with the differences that are
    expected still in it; `w_nb_b_rad_s` (n, 3) body rates at that instant; `w_differs_b_rad_s` (n, 3) the quaternion's
    rates minus the Euler angles', NaN where the instants differ or rates are not reported, and `unsteady_rad_s` (n,)
    what of it the motion explains;
    `bound_rad` (n,) what the alignment alone may make of a perfect agreement, NaN where it can't be told;
    `after_reset` (n,) the faster stream stepped there, alone, against its own rates;
    `interval_id` (n,) equal for pairs that rest on the same step of the faster stream, −1 for the same instant;
    `duration_us` (n,) the time each pair judges.
    """

    t_boot_us: Int64s
    t_rx_us: Int64s
    same_instant: Mask
    q_euler: Floats
    q_quaternion: Floats
    q_euler_sent: Floats
    w_nb_b_rad_s: Floats
    w_differs_b_rad_s: Floats
    unsteady_rad_s: Floats
    bound_rad: Floats
    after_reset: Mask
    interval_id: Int64s
    duration_us: Int64s


@dataclass(frozen=True, kw_only=True)
class Aligned:
    """A batch's pairs and steps, and per sample its stream's period by then, in boot and receive time (µs, −1)."""

    pairs: Pairs
    period_us: Int64s
    rx_period_us: Int64s
    steps: tuple[Steps, Steps]  # of ATTITUDE and of ATTITUDE_QUATERNION


class Aligner:
    """Pairs ATTITUDE and ATTITUDE_QUATERNION of one vehicle within one boot."""

    def __init__(self, alignment: AlignmentSettings, reset: ResetSettings) -> None:
        """Start before a boot's first sample."""
        self._alignment = alignment
        self._state = new_match_state()
        self._streams = (StreamSteps(reset), StreamSteps(reset))

    def pair(
        self,
        euler: AttitudeSamples,
        quaternion: AttitudeSamples,
        order: Int64s,
        q_euler_sent: Floats | None = None,
    ) -> Aligned:
        """The pairs that these samples complete.

        `order` (n,) sorts the two streams' samples, ATTITUDE's first, into their order of arrival, in which periods are
        returned too. `q_euler_sent` are ATTITUDE's own, where `euler` differs from them.
        """
        stream = np.repeat(np.array([EULER, QUATERNION]), [len(euler), len(quaternion)])[order]
        t_us = np.concatenate((euler.t_boot_us, quaternion.t_boot_us))[order]
        t_rx_us = np.concatenate((euler.t_rx_us, quaternion.t_rx_us))[order]
        steps = [NO_STEPS, NO_STEPS]
        for k, (stream_steps, samples) in enumerate(zip(self._streams, (euler, quaternion), strict=True)):
            if len(samples):
                q = attitude.normalise(samples.q_nb)
                with np.errstate(invalid="ignore"):  # rates that are no numbers: they explain no step
                    sent = q_euler_sent if k == EULER else None
                    steps[k] = stream_steps.append(samples, q, sent)
        self._state = self._state.with_room(len(stream))
        matches = np.empty(len(stream) + self._state.n_waiting + 1, MATCH)
        periods = np.empty((len(stream), 2), np.int64)
        n = match_kernel(stream, t_us, t_rx_us, self._alignment.max_gap_us, self._state, matches, periods)
        with np.errstate(invalid="ignore"):  # rates that are no numbers: the bound is none then
            by = matches["completed_by"][:n]
            frame_index = np.concatenate((euler.frame_index, quaternion.frame_index))[order]
            pairs = self._evaluated(matches[:n], frame_index[by], t_rx_us[by])
        return Aligned(
            pairs=pairs, period_us=periods[:, 0], rx_period_us=periods[:, 1], steps=(steps[EULER], steps[QUATERNION])
        )

    def _evaluated(self, matches: npt.NDArray[np.void], frame_index: Int64s, t_rx_us: Int64s) -> Pairs:
        """The matched samples as pairs, the faster stream interpolated where the instants differ."""
        n = len(matches)
        q_euler = np.empty((n, 4))
        as_sent = self._streams[EULER].recent.rows.applied_correction is None
        pairs = Pairs(
            frame_index=frame_index,
            t_boot_us=np.empty(n, np.int64),
            t_rx_us=t_rx_us,
            same_instant=matches["same"] == 1,
            q_euler=q_euler,
            q_quaternion=np.empty((n, 4)),
            q_euler_sent=q_euler if as_sent else np.empty((n, 4)),
            w_nb_b_rad_s=np.empty((n, 3)),
            w_differs_b_rad_s=np.full((n, 3), np.nan),
            unsteady_rad_s=np.full(n, np.nan),
            bound_rad=np.full(n, self._alignment.same_instant_bound_rad),
            after_reset=np.zeros(n, np.bool_),
            interval_id=np.where(matches["same"] == 1, -1, matches["after"]),
            duration_us=matches["duration_us"].copy(),
        )
        for slower in (EULER, QUATERNION):
            for same in (True, False):
                rows = np.flatnonzero((matches["slower"] == slower) & (pairs.same_instant == same))
                if len(rows):
                    self._evaluate(pairs, rows, matches[rows], slower, same)
        return pairs

    def _evaluate(self, pairs: Pairs, rows: Int64s, matches: npt.NDArray[np.void], slower: int, same: bool) -> None:
        rings: list[Ring[RecentSamples]] = [self._streams[k].recent for k in (slower, 1 - slower)]
        slow, fast = (ring.rows for ring in rings)
        at = matches["sample"] - rings[0].first
        before, after = matches["before"] - rings[1].first, matches["after"] - rings[1].first
        q_of = (pairs.q_euler, pairs.q_quaternion)
        pairs.t_boot_us[rows] = slow.t_us[at]
        q_of[slower][rows] = slow.q[at]
        if same:
            q_of[1 - slower][rows] = fast.q[after]
            pairs.w_nb_b_rad_s[rows] = fast.w[after]
            self._compare_rates(pairs, rows, slow, at, fast, after, 1 if slower == EULER else -1)
            self._resend(pairs, rows, at if slower == EULER else after)
            return
        gap_us = fast.t_us[after] - fast.t_us[before]
        u = (slow.t_us[at] - fast.t_us[before]) / gap_us
        h = gap_us * 1e-6
        w0, w1, own = fast.w[before], fast.w[after], slow.w[at]
        q, w = attitude.hermite(fast.q[before], fast.q[after], w0, w1, dt_s=h, u=u)
        q_of[1 - slower][rows] = q
        pairs.w_nb_b_rad_s[rows] = w
        pairs.after_reset[rows] = fast.contradicts_rates[after] & ~fast.contradicts_rates[before]
        pairs.bound_rad[rows] += interpolation_bound_rad(
            w0, w1, own, w, kin_fast=fast.kin[after], kin_slow=slow.kin[at], h=h, u=u
        )
        self._resend(pairs, rows, at if slower == EULER else after)

    def _compare_rates(
        self, pairs: Pairs, rows: Int64s, slow: RecentSamples, at: Int64s, fast: RecentSamples, there: Int64s, sign: int
    ) -> None:
        """The rates of both messages at one instant; a firmware that reports none sends zeros."""
        one, other = slow.w[at], fast.w[there]
        unreported = (length(one) == 0) | (length(other) == 0)
        pairs.w_differs_b_rad_s[rows] = np.where(unreported[:, None], np.nan, sign * (other - one))
        # The calmer one's: a stream whose rates are wrong finds its own step unsteady, and would excuse itself.
        pairs.unsteady_rad_s[rows] = np.fmin(slow.unsteady[at], fast.unsteady[there])

    def _resend(self, pairs: Pairs, rows: Int64s, at: Int64s) -> None:
        """Put back into the Euler side what was expected of its sample `at`."""
        applied_correction = self._streams[EULER].recent.rows.applied_correction
        if applied_correction is not None:
            pairs.q_euler_sent[rows] = attitude.multiply(pairs.q_euler[rows], applied_correction[at])
