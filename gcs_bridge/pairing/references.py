"""The one attitude and the one inertial sensor of a vehicle that others are compared with.

What they are compared for is not known here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, Int64s, Mask
from gcs_bridge.pairing.neighbours import Answers, Lookup, Track, in_order, no_track
from gcs_bridge.telemetry.batches import ImuBatch
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


@dataclass(frozen=True)
class ImuWithAttitude:
    """Inertial samples with the attitude at their times, n, in order of time; those that came late are left out.

    `t_boot_us`, `t_rx_us` (n,) of the sample; `frame_index` (n,) of the frame that completed it; `f_b_m_s2`,
    `w_b_rad_s`, `m_b_gauss` (n, 3) as measured; `trim_b_rad`, `may_rest`, `stands` as in a CheckBatch; `q_nb` (n, 4)
    the attitude; `w0_b_rad_s`, `w1_b_rad_s` (n, 3) its rates on both sides, `gap_s` (n,) from one to the other, and
    `place` (n,) the share of the gap that has passed.
    """

    t_boot_us: Int64s
    t_rx_us: Int64s
    frame_index: Int64s
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

    def __len__(self) -> int:
        return len(self.t_boot_us)

    def __getitem__(self, rows: Any) -> ImuWithAttitude:
        """The samples of a slice, mask or index array."""
        return ImuWithAttitude(**{column.name: getattr(self, column.name)[rows] for column in fields(self)})

    def where(self, picked: Mask) -> ImuWithAttitude:
        """The samples that are `picked` (n,)."""
        return self if picked.all() else self[picked]

    @classmethod
    def joined(cls, parts: Sequence[ImuWithAttitude]) -> ImuWithAttitude:
        """All of `parts`, one or more, one behind the other."""
        return cls(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)})


class ImuLookup:
    """Finds the attitude at the times of inertial samples, within one boot."""

    def __init__(self) -> None:
        """Start before the boot's first sample."""
        self._lookup = Lookup(_SEEN_WIDTH, ATTITUDE_WIDTH, MAX_GAP_US)
        self._latest_us = -1

    def feed(
        self, series: Track, imu: ImuBatch | None, trim_b_rad: Floats, may_rest: Mask, stands: Mask
    ) -> ImuWithAttitude:
        """Take attitudes and samples as they came; return the samples whose attitude is known by now."""
        queries = no_track(_SEEN_WIDTH)
        if imu is not None:
            of = imu.samples
            told = np.column_stack((may_rest, stands, of.t_rx_us)).astype(np.float64)
            rows = np.hstack((of.f_b_m_s2, of.w_b_rad_s, of.m_b_gauss, trim_b_rad, told))
            queries = Track(of.t_boot_us, imu.frame_index, rows)
        found = self._lookup.feed(series, queries)
        rows = found.query.rows
        picked = in_order(found.query.t_us, self._latest_us)
        if len(picked):
            self._latest_us = int(found.query.t_us[picked[-1]])
        seen = ImuWithAttitude(
            found.query.t_us,
            rows[:, 14].astype(np.int64),
            found.frame_index,
            rows[:, :3],
            rows[:, 3:6],
            rows[:, 6:9],
            rows[:, 9:12],
            rows[:, 12] != 0,
            rows[:, 13] != 0,
            attitude_at(found),
            found.before.rows[:, 4:],
            found.after.rows[:, 4:],
            found.gap_s,
            found.place,
        )
        return seen if len(picked) == len(seen) else seen[picked]


MAX_GAP_US = 1_000_000
"""Between attitudes further apart none is known."""
_SEEN_WIDTH = 15  # of a query: force, rates, field, trim; whether it may rest, whether it stands; receive time


class ReferenceAttitude:
    """Chooses one attitude from the two streams: the quaternion, and the Euler angles while it does not come."""

    def __init__(self) -> None:
        """Start before a boot's first sample."""
        self._quaternion_us = -_FALLBACK_US

    def take(
        self,
        euler: AttitudeSamples,
        euler_frame_index: Int64s,
        quaternion: AttitudeSamples,
        quaternion_frame_index: Int64s,
    ) -> Track:
        """The chosen samples, valid ones only, in order of arrival."""
        heard_us = np.concatenate(([self._quaternion_us], quaternion.t_boot_us[quaternion.valid]))
        heard_us = np.maximum.accumulate(heard_us)
        self._quaternion_us = int(heard_us[-1])
        before = np.searchsorted(quaternion_frame_index[quaternion.valid], euler_frame_index)
        stands_in = euler.valid & (euler.t_boot_us - heard_us[before] >= _FALLBACK_US)
        tracks = []
        for samples, frame_index, chosen in (
            (euler, euler_frame_index, stands_in),
            (quaternion, quaternion_frame_index, quaternion.valid),
        ):
            rows = np.hstack((samples.q_nb[chosen], samples.w_nb_b_rad_s[chosen]))
            tracks.append(Track(samples.t_boot_us[chosen], frame_index[chosen], rows))
        both = tracks[0].then(tracks[1])
        return both[np.argsort(both.frame_index, kind="stable")]


class PrimaryImu:
    """Chooses one inertial sensor: the best that was heard so far, within one boot."""

    def __init__(self) -> None:
        """Start with none heard."""
        self._best = len(_SENSORS)

    def take(self, imu: Mapping[str, ImuBatch]) -> ImuBatch | None:
        """The samples of the chosen sensor, up to where a better one is heard: from there on, that one's."""
        parts: list[ImuBatch] = []
        until = np.iinfo(np.int64).max
        for rank, name in enumerate(_SENSORS[: self._best + 1]):
            if name in imu:
                samples, frame_index = imu[name]
                rows = frame_index < until
                if rows.any():
                    parts.append(ImuBatch(samples[rows], frame_index[rows]))
                    until = int(frame_index[0])
                    self._best = min(self._best, rank)
        if len(parts) < 2:
            return parts[0] if parts else None
        joined = ImuSamples.joined([part.samples for part in parts])
        frame_indices = np.concatenate([part.frame_index for part in parts])
        order = np.argsort(frame_indices, kind="stable")
        return ImuBatch(joined[order], frame_indices[order])


_SENSORS = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")  # best first
