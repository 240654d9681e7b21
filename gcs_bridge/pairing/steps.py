"""The steps of a stream from sample to sample; what a step means is not judged here."""

from __future__ import annotations

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, record
from gcs_bridge.pairing.values import StepRows


@record
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


def step_rows(n: int) -> StepRows:
    """Room for n steps of each of both streams."""
    return StepRows(
        frame_index=np.empty((2, n), np.int64),
        t0_us=np.empty((2, n), np.int64),
        t1_us=np.empty((2, n), np.int64),
        q0_nb=np.empty((2, n, 4)),
        q1_nb=np.empty((2, n, 4)),
        w0_b_rad_s=np.empty((2, n, 3)),
        w1_b_rad_s=np.empty((2, n, 3)),
        turn_b_rad=np.empty((2, n, 3)),
        rate_residual_rad=np.empty((2, n)),
        limit_rad=np.empty((2, n)),
        contradicts_rates=np.empty((2, n), np.bool_),
    )


def steps_of(rows: StepRows, stream: int, n: int) -> Steps:
    """The first n steps of one stream."""
    return Steps(**{name: of[stream, :n] for name, of in rows._asdict().items()})
