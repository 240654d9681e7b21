"""How a vehicle moves, by its attitude and an accelerometer: acceleration, and velocity and displacement since rest.

Each inertial sample is seen by the attitude at its own time, interpolated, so it waits for the attitude behind it. What
comes out does not depend on how the samples were cut into batches.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.checks.protocol import attitude_at, in_order
from gcs_bridge.flight import ATTITUDE_WIDTH, Flight
from gcs_bridge.lookup import Lookup, Track, no_track

Floats = npt.NDArray[np.float64]
Int64s = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

MAX_GAP_US = 1_000_000
"""Between attitudes further apart none is known; between samples further apart, what was known since a rest is lost."""

_WIDTH = 8  # of a query: force, rates, whether it stands by what the vehicle says itself, receive time


@dataclass(frozen=True)
class MotionSamples:
    """The motion at n inertial samples, in order of time; NaN where it is not known.

    `t_boot_us`, `t_rx_us` (n,) of the sample, µs, −1 where the receive time is unknown;
    `a_h_m_s2` (n, 3) acceleration in the level frame: along the nose, to the right, down;
    `v_h_m_s`, `d_h_m` (n, 3) velocity and displacement since the last rest, in the level frame of now, not known before
    there was one; `v_bound_m_s`, `d_bound_m` (n,) the bounds of their drift;
    `accelerometer_down_b`, `attitude_down_b` (n, 3) down as each of the two sees it, unit vectors in body axes;
    `apart_rad` (n,) the angle between them; `accelerometer_down_n` (n, 3) the first in NED, [0, 0, 1] if they are one;
    `heading_rad` (n,) in [0, 2π).
    """

    t_boot_us: Int64s
    t_rx_us: Int64s
    a_h_m_s2: Floats
    v_h_m_s: Floats
    d_h_m: Floats
    v_bound_m_s: Floats
    d_bound_m: Floats
    accelerometer_down_b: Floats
    attitude_down_b: Floats
    accelerometer_down_n: Floats
    apart_rad: Floats
    heading_rad: Floats

    def __len__(self) -> int:
        return len(self.t_boot_us)


class MotionTracker:
    """The motion of one vehicle within one boot."""

    def __init__(self, hold_us: int = 0) -> None:
        """Start before the boot's first sample.

        `hold_us`: let samples gather for so long before working on them; a few cost as much as a hundred.
        """
        self._hold_us = hold_us
        self._worked_us = -1
        self._series: list[Track] = []
        self._queries: list[Track] = []
        self._lookup = Lookup(_WIDTH, ATTITUDE_WIDTH, MAX_GAP_US)
        self._latest_us = -MAX_GAP_US - 1
        self._watch = attitude.RestWatch()
        self._reckoner = attitude.DeadReckoner()
        self._rested = False  # and no gap has come since

    def feed(self, flight: Flight) -> MotionSamples | None:
        """The motion at inertial samples, of this batch and before, that an attitude has come behind; None: at none.

        Samples without a meaning, or not later than one before them, are left out.
        """
        self._series.append(flight.attitude)
        if flight.imu is not None:
            samples = flight.imu.samples
            f_b = attitude.rotate(attitude.quaternion_from_rotvec(flight.trim_b_rad), samples.f_b_m_s2)
            rows = np.column_stack((f_b, samples.w_b_rad_s, flight.stands, samples.t_rx_us))
            usable = np.asarray(np.isfinite(f_b).all(axis=1))
            self._queries.append(Track(samples.t_boot_us, flight.imu.ordinal, rows)[usable])
        now_us = max((int(track.t_us[-1]) for track in (*self._series, *self._queries) if len(track)), default=-1)
        if abs(now_us - self._worked_us) < self._hold_us:
            return None
        self._worked_us = now_us
        return self.flush()

    def flush(self) -> MotionSamples | None:
        """The same for all that was held."""
        series = reduce(Track.then, self._series, no_track(ATTITUDE_WIDTH))
        queries = reduce(Track.then, self._queries, no_track(_WIDTH))
        self._series, self._queries = [], []
        found = self._lookup.feed(series, queries)
        rows = in_order(found.query.t_us, self._latest_us)
        if not len(rows):
            return None
        w_b = found.query.rows[rows, 3:6]
        measured = np.isfinite(w_b).all(axis=1, keepdims=True)
        w_b = np.where(measured, w_b, found.after.rows[rows, 4:])
        return self._moved(found.query[rows], attitude_at(found)[rows], w_b)

    def _moved(self, imu: Track, q_nb: Floats, w_b: Floats) -> MotionSamples:
        t_s, f_b = np.asarray(imu.t_us * 1e-6, np.float64), imu.rows[:, :3]
        stands = (imu.rows[:, 6] != 0) & attitude.may_stand_still(q_nb, f_b)
        resting = self._watch.feed(t_s, f_b, w_b, stands)
        reckoned = self._reckoner.feed(t_s, q_nb, f_b, resting)
        unknown = ~self._since_rest(imu.t_us, resting)
        for part in reckoned:
            part[unknown] = np.nan
        down_b = attitude.down_from_specific_force(f_b)
        return MotionSamples(
            t_boot_us=imu.t_us,
            t_rx_us=imu.rows[:, 7].astype(np.int64),
            a_h_m_s2=attitude.acceleration_level(q_nb, f_b),
            v_h_m_s=attitude.level_from_ned(q_nb, reckoned.velocity_n_m_s),
            d_h_m=attitude.level_from_ned(q_nb, reckoned.displacement_n_m),
            v_bound_m_s=reckoned.velocity_bound_m_s,
            d_bound_m=reckoned.displacement_bound_m,
            accelerometer_down_b=down_b,
            attitude_down_b=attitude.body_down(q_nb),
            accelerometer_down_n=attitude.rotate(q_nb, down_b),
            apart_rad=attitude.accelerometer_tilt(q_nb, f_b),
            heading_rad=attitude.heading(q_nb),
        )

    def _since_rest(self, t_us: Int64s, resting: Mask) -> Mask:
        """At which samples (n,) the motion is known: there was a rest, and no gap since."""
        gap = np.diff(t_us, prepend=self._latest_us) > MAX_GAP_US
        decided = np.concatenate(([True], gap | resting))
        last = np.maximum.accumulate(np.where(decided, np.arange(len(decided)), 0))
        known: Mask = np.concatenate(([self._rested], resting))[last][1:]
        self._latest_us, self._rested = int(t_us[-1]), bool(known[-1])
        return known
