"""How a vehicle moves, by its attitude and an accelerometer: acceleration, and velocity and displacement since rest.

Each inertial sample is seen by the attitude at its own time, interpolated, so it waits for the attitude behind it. What
comes out does not depend on how the samples were cut into batches.
"""

from __future__ import annotations

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Columns, Floats, Int64s, Mask, last_where, record
from gcs_bridge.pairing.references import ImuWithAttitude


@record
class MotionSamples(Columns):
    """The motion at n inertial samples, in order of time; NaN where it is not known.

    `t_boot_us`, `t_rx_us` (n,) of the sample, µs, −1 where the receive time is unknown;
    `a_h_m_s2` (n, 3) acceleration in the level frame: along the nose, to the right, down;
    `v_h_m_s`, `d_h_m` (n, 3) velocity and displacement since the last rest, in the level frame of now, not known before
    there was one; `v_bound_m_s`, `d_bound_m` (n,) the bounds of their drift;
    `accelerometer_down_n` (n, 3) down as the accelerometer sees it, a unit vector in NED: [0, 0, 1] where the attitude
    sees the same; `apart_rad` (n,) the angle between the two;
    `heading_rad` (n,) in [0, 2π).
    """

    t_boot_us: Int64s
    t_rx_us: Int64s
    a_h_m_s2: Floats
    v_h_m_s: Floats
    d_h_m: Floats
    v_bound_m_s: Floats
    d_bound_m: Floats
    accelerometer_down_n: Floats
    apart_rad: Floats
    heading_rad: Floats


class MotionTracker:
    """The motion of one vehicle within one boot."""

    def __init__(self) -> None:
        """Start before the boot's first sample."""
        self._latest_us: int | None = None
        self._watch = attitude.RestWatch()
        self._reckoner = attitude.DeadReckoner()
        self._rested = False  # and no gap has come since

    def feed(self, seen: ImuWithAttitude) -> MotionSamples | None:
        """The motion at the next inertial samples; None: at none.

        Samples without a meaning, or not later than one before them, are left out.
        """
        if not len(seen):
            return None
        f_b = attitude.rotate(attitude.quaternion_from_rotvec(seen.trim_b_rad), seen.f_b_m_s2)
        usable = np.isfinite(f_b).all(axis=1)
        return self._moved(seen[usable], f_b[usable]) if usable.any() else None

    def _moved(self, seen: ImuWithAttitude, f_b: Floats) -> MotionSamples:
        t_s, q_nb = np.asarray(seen.t_boot_us * 1e-6, np.float64), seen.q_nb
        measured = np.isfinite(seen.w_b_rad_s).all(axis=1, keepdims=True)
        w_b = np.where(measured, seen.w_b_rad_s, seen.w1_b_rad_s)
        stands = seen.stands & attitude.may_stand_still(q_nb, f_b)
        resting = self._watch.feed(t_s, f_b, w_b, stands)
        reckoned = self._reckoner.feed(t_s, q_nb, f_b, resting)
        unknown = ~self._since_rest(seen, resting)
        for part in reckoned:
            part[unknown] = np.nan
        return MotionSamples(
            t_boot_us=seen.t_boot_us,
            t_rx_us=seen.t_rx_us,
            a_h_m_s2=attitude.acceleration_level(q_nb, f_b),
            v_h_m_s=attitude.level_from_ned(q_nb, reckoned.velocity_n_m_s),
            d_h_m=attitude.level_from_ned(q_nb, reckoned.displacement_n_m),
            v_bound_m_s=reckoned.velocity_bound_m_s,
            d_bound_m=reckoned.displacement_bound_m,
            accelerometer_down_n=attitude.rotate(q_nb, attitude.down_from_specific_force(f_b)),
            apart_rad=attitude.accelerometer_tilt(q_nb, f_b),
            heading_rad=attitude.heading(q_nb),
        )

    def _since_rest(self, seen: ImuWithAttitude, resting: Mask) -> Mask:
        """At which samples (n,) the motion is known: there was a rest, and no gap since."""
        t_us = seen.t_boot_us
        gap = np.diff(t_us, prepend=t_us[0] if self._latest_us is None else self._latest_us) > seen.max_gap_us
        decided = np.concatenate(([True], gap | resting))
        last = last_where(decided)
        known: Mask = np.concatenate(([self._rested], resting))[last][1:]
        self._latest_us, self._rested = int(t_us[-1]), bool(known[-1])
        return known
