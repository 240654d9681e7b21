"""The one attitude and the one inertial sensor of a vehicle that others are compared with.

What they are compared for is not known here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, RunningMax
from gcs_bridge.pairing.neighbours import Answers, Lookup, Track, in_order, no_track
from gcs_bridge.settings import AlignmentSettings
from gcs_bridge.telemetry.samples import AttitudeSamples, ImuSamples

ATTITUDE_WIDTH = 7  # q_nb (4), w_b (3)
_FALLBACK_US = 1_000_000  # ATTITUDE stands in for ATTITUDE_QUATERNION after so long a silence of it


def attitude_at(found: Answers) -> Floats:
    """The attitudes (n, 4) at the queries' times; along the shortest way where no rates are reported."""
    rates = [np.nan_to_num(rows[:, 4:7]) for rows in (found.before.rows, found.after.rows)]
    q0, q1 = found.before.rows[:, :4], found.after.rows[:, :4]
    moving = [(w[:, 0] != 0) | (w[:, 1] != 0) | (w[:, 2] != 0) for w in rates]
    bent = moving[0] & moving[1] & (found.gap_s > 0)
    place, gap_s = found.place, found.gap_s
    if bent.all():
        return attitude.hermite(q0, q1, rates[0], rates[1], dt_s=gap_s, u=place)[0]
    q_nb = np.empty_like(q0)
    q_nb[~bent] = attitude.slerp(q0[~bent], q1[~bent], place[~bent])
    w0, w1 = rates[0][bent], rates[1][bent]
    q_nb[bent] = attitude.hermite(q0[bent], q1[bent], w0, w1, dt_s=gap_s[bent], u=place[bent])[0]
    return q_nb


@dataclass(frozen=True, kw_only=True)
class VehicleImu(ImuSamples):
    """Samples of a vehicle's inertial sensor, with what the vehicle says of itself then.

    (n,) whether it `may_rest`, and whether it `stands` on the ground; `trim_b_rad` (n, 3) the turn from the body's axes
    to the sensor's.
    """

    may_rest: Mask
    stands: Mask
    trim_b_rad: Floats


@dataclass(frozen=True, kw_only=True)
class ImuWithAttitude(FrameColumns):
    """Inertial samples with the attitude at their times, n, in order of time; those that came late are left out.

    `t_boot_us`, `t_rx_us` (n,) of the sample; `frame_index` (n,) of the frame that completed it; `f_b_m_s2`,
    `w_b_rad_s`, `m_b_gauss` (n, 3) as measured; `trim_b_rad`, `may_rest`, `stands` as in VehicleImu; `q_nb` (n, 4)
    the attitude; `w0_b_rad_s`, `w1_b_rad_s` (n, 3) its rates on both sides, `gap_s` (n,) from one to the other, and
    `place` (n,) the share of the gap that has passed. `max_gap_us`: between attitudes further apart none is known.
    """

    max_gap_us: int
    t_boot_us: Int64s
    t_rx_us: Int64s
    f_b_m_s2: Floats
    w_b_rad_s: Floats
    m_b_gauss: Floats
    trim_b_rad: Floats
    may_rest: Mask
    stands: Mask
    q_nb: Floats
    w0_b_rad_s: Floats
    w1_b_rad_s: Floats
    gap_s: Floats
    place: Floats


class ImuLookup:
    """Finds the attitude at the times of inertial samples, within one boot."""

    def __init__(self, alignment: AlignmentSettings) -> None:
        """Start before the boot's first sample."""
        self._max_gap_us = alignment.max_gap_us
        self._lookup = Lookup(_SEEN_WIDTH, ATTITUDE_WIDTH, self._max_gap_us)
        self._latest_us = -1

    def feed(self, series: Track, imu: VehicleImu | None) -> ImuWithAttitude:
        """Take attitudes and samples as they came; return the samples whose attitude is known by now."""
        queries = no_track(_SEEN_WIDTH)
        if imu is not None:
            told = np.column_stack((imu.may_rest, imu.stands, imu.t_rx_us)).astype(np.float64)
            rows = np.hstack((imu.f_b_m_s2, imu.w_b_rad_s, imu.m_b_gauss, imu.trim_b_rad, told))
            queries = Track(frame_index=imu.frame_index, t_us=imu.t_boot_us, rows=rows)
        found = self._lookup.feed(series, queries)
        rows = found.query.rows
        picked = in_order(found.query.t_us, self._latest_us)
        if len(picked):
            self._latest_us = int(found.query.t_us[picked[-1]])
        seen = ImuWithAttitude(
            frame_index=found.frame_index,
            max_gap_us=self._max_gap_us,
            t_boot_us=found.query.t_us,
            t_rx_us=rows[:, 14].astype(np.int64),
            f_b_m_s2=rows[:, :3],
            w_b_rad_s=rows[:, 3:6],
            m_b_gauss=rows[:, 6:9],
            trim_b_rad=rows[:, 9:12],
            may_rest=rows[:, 12] != 0,
            stands=rows[:, 13] != 0,
            q_nb=attitude_at(found),
            w0_b_rad_s=found.before.rows[:, 4:],
            w1_b_rad_s=found.after.rows[:, 4:],
            gap_s=found.gap_s,
            place=found.place,
        )
        return seen if len(picked) == len(seen) else seen[picked]


_SEEN_WIDTH = 15  # of a query: force, rates, field, trim; whether it may rest, whether it stands; receive time


class ReferenceAttitude:
    """Chooses one attitude from the two streams: the quaternion, and the Euler angles while it does not come."""

    def __init__(self) -> None:
        """Start before a boot's first sample."""
        self._quaternion_us = RunningMax(-_FALLBACK_US)

    def take(self, euler: AttitudeSamples, quaternion: AttitudeSamples) -> Track:
        """The chosen samples, valid ones only, in order of arrival."""
        heard_us = self._quaternion_us.feed(quaternion.t_boot_us[quaternion.valid])
        before = np.searchsorted(quaternion.frame_index[quaternion.valid], euler.frame_index)
        stands_in = euler.valid & (euler.t_boot_us - heard_us[before] >= _FALLBACK_US)
        tracks = []
        for samples, chosen in ((euler, stands_in), (quaternion, quaternion.valid)):
            rows = np.hstack((samples.q_nb[chosen], samples.w_nb_b_rad_s[chosen]))
            track = Track(frame_index=samples.frame_index[chosen], t_us=samples.t_boot_us[chosen], rows=rows)
            tracks.append(track)
        return Track.in_arrival(tracks)


class PrimaryImu:
    """Chooses one inertial sensor: the best that was heard so far, within one boot."""

    def __init__(self) -> None:
        """Start with none heard."""
        self._best = len(_SENSORS)

    def take(self, imu: Mapping[str, ImuSamples]) -> ImuSamples | None:
        """The samples of the chosen sensor, up to where a better one is heard: from there on, that one's."""
        parts: list[ImuSamples] = []
        until = np.iinfo(np.int64).max
        for rank, name in enumerate(_SENSORS[: self._best + 1]):
            if name in imu:
                before = imu[name].frame_index < until
                if before.any():
                    parts.append(imu[name].where(before))
                    until = int(imu[name].frame_index[0])
                    self._best = min(self._best, rank)
        return ImuSamples.in_arrival(parts) if parts else None


_SENSORS = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")  # best first
