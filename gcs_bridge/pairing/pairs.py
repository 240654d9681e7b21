"""Two sampled descriptions of one attitude → pairs at one instant, each with a bound on the error of its alignment.

Samples of the same `time_boot_ms` are a pair. Any other sample of the slower stream is compared with the faster one,
interpolated at its time: a cubic Hermite in the rotation vector, which uses the body rates at both ends. (The other
way round, or latest against latest, shows tens of degrees on healthy aircraft.) Nothing is interpolated across a
reboot, a gap that is too long, or a step that the stream's own rates deny.

`pair_kernel` decides it, one sample after the other in order of arrival.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, record
from gcs_bridge.pairing.kernel import pair_kernel
from gcs_bridge.pairing.state import EULER, QUATERNION, Came, new_pair_state
from gcs_bridge.pairing.steps import Steps, step_rows, steps_of
from gcs_bridge.pairing.values import Limits, PairRows
from gcs_bridge.settings import AlignmentSettings, ResetSettings
from gcs_bridge.telemetry.samples import AttitudeSamples


@record
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


@record
class Aligned:
    """A batch's pairs and steps, and with each message its stream's period by then, in boot and receive time, µs.

    −1 where it is not known, and with any other message.
    """

    pairs: Pairs
    period_us: Int64s
    rx_period_us: Int64s
    steps: tuple[Steps, Steps]  # of ATTITUDE and of ATTITUDE_QUATERNION


class Aligner:
    """Pairs ATTITUDE and ATTITUDE_QUATERNION of one vehicle within one boot."""

    def __init__(self, alignment: AlignmentSettings, reset: ResetSettings) -> None:
        """Start before a boot's first sample."""
        self._limits = Limits(
            max_gap_us=alignment.max_gap_us,
            same_instant_bound_rad=alignment.same_instant_bound_rad,
            step_rad=reset.step_rad,
            per_rate_s=reset.per_rate_s,
        )
        self._state = new_pair_state()
        self._undone = False  # whether anything was expected of a sample so far

    def pair(
        self,
        euler: AttitudeSamples,
        quaternion: AttitudeSamples,
        stream: Int64s,
        q_euler_sent: Floats | None = None,
        expected: Int64s | None = None,
    ) -> Aligned:
        """The pairs that these samples complete; those that are not valid are passed over.

        `stream` (n,): the messages in order of arrival, 0 and 1 the next sample of `euler` and `quaternion`, any other
        none of both. `q_euler_sent` are ATTITUDE's own, where `euler` differs from them, and
        `expected` (n,) which difference was undone, a number for each; None: none ever.
        """
        n, longest = len(stream), max(len(euler), len(quaternion))
        self._undone |= q_euler_sent is not None
        self._state = self._state.with_room(longest)
        pairs, steps = self._pair_rows(len(euler) + len(quaternion) + self._state.n_waiting), step_rows(longest)
        periods, counts = np.empty((2, n), np.int64), np.empty(5, np.int64)
        pair_kernel(
            stream,
            _came(euler, q_euler_sent, expected),
            _came(quaternion, None, None),
            self._limits,
            self._state,
            pairs,
            steps,
            periods,
            counts,
        )
        of_euler, of_quaternion, n_pairs = counts[:3].tolist()
        return Aligned(
            pairs=Pairs(**_first(pairs, n_pairs)),
            period_us=periods[0],
            rx_period_us=periods[1],
            steps=(steps_of(steps, EULER, of_euler), steps_of(steps, QUATERNION, of_quaternion)),
        )

    def _pair_rows(self, n: int) -> PairRows:
        """Room for n pairs."""
        q_euler = np.empty((n, 4))
        return PairRows(
            frame_index=np.empty(n, np.int64),
            t_boot_us=np.empty(n, np.int64),
            t_rx_us=np.empty(n, np.int64),
            same_instant=np.empty(n, np.bool_),
            q_euler=q_euler,
            q_quaternion=np.empty((n, 4)),
            q_euler_sent=np.empty((n, 4)) if self._undone else q_euler,
            w_nb_b_rad_s=np.empty((n, 3)),
            w_differs_b_rad_s=np.empty((n, 3)),
            unsteady_rad_s=np.empty(n),
            bound_rad=np.empty(n),
            after_reset=np.empty(n, np.bool_),
            interval_id=np.empty(n, np.int64),
            duration_us=np.empty(n, np.int64),
        )


def _first(pairs: PairRows, n: int) -> dict[str, Any]:
    """The columns' first n rows: of their own where there was room for many more, which would be kept with them."""
    columns = pairs._asdict()
    if 2 * n >= len(pairs.t_boot_us) or len(pairs.t_boot_us) < _MUCH_ROOM:
        return {name: of[:n] for name, of in columns.items()}
    q_euler = pairs.q_euler[:n].copy()
    return {name: q_euler if of is pairs.q_euler else of[:n].copy() for name, of in columns.items()}


def _came(samples: AttitudeSamples, q_sent: Floats | None, expected: Int64s | None) -> Came:
    return Came(
        frame_index=samples.frame_index,
        t_us=samples.t_boot_us,
        t_rx_us=samples.t_rx_us,
        q_nb=samples.q_nb,
        q_sent=_NOTHING_UNDONE if q_sent is None else q_sent,
        expected=_NEVER if expected is None else expected,
        w_b_rad_s=samples.w_nb_b_rad_s,
        valid=samples.valid,
    )


_MUCH_ROOM = 64  # rows
_NOTHING_UNDONE, _NEVER = np.empty((0, 4)), np.empty(0, np.int64)
