"""The one attitude and the one inertial sensor of a vehicle that others are compared with.

What they are compared for is not known here.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, record
from gcs_bridge.pairing.neighbours import Track
from gcs_bridge.pairing.seen import (
    ATTITUDE_WIDTH,
    FALLBACK_US,
    QUERY_WIDTH,
    Attitudes,
    Inertial,
    SeenRows,
    choose_reference,
    hear_all,
    new_series,
    new_waiting,
    see_kernel,
)
from gcs_bridge.settings import AlignmentSettings
from gcs_bridge.telemetry.samples import AttitudeSamples, ImuSamples


@record
class VehicleImu(ImuSamples):
    """Samples of a vehicle's inertial sensor, with what the vehicle says of itself then.

    (n,) whether it `may_rest`, and whether it `stands` on the ground; `trim_b_rad` (n, 3) the turn from the body's axes
    to the sensor's.
    """

    may_rest: Mask
    stands: Mask
    trim_b_rad: Floats


@record
class ImuWithAttitude(FrameColumns):
    """Inertial samples with the attitude at their times, n, in order of time; those that came late are left out.

    `t_boot_us`, `t_rx_us` (n,) of the sample; `frame_index` (n,) of the frame that completed it; `f_b_m_s2`,
    `w_b_rad_s`, `m_b_gauss` (n, 3) as measured; `trim_b_rad`, `may_rest`, `stands` as in VehicleImu; `q_nb` (n, 4)
    the attitude; `w0_b_rad_s`, `w1_b_rad_s` (n, 3) its rates on both sides, `gap_s` (n,) from one to the other,
    `turn_b_rad` (n, 3) its turn meanwhile, and `place` (n,) the share of the gap that has passed. `max_gap_us`: between
    attitudes further apart none is known.
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
    turn_b_rad: Floats
    gap_s: Floats
    place: Floats


class References:
    """The one attitude of a vehicle, and its inertial samples with the attitude at their times, within one boot."""

    def __init__(self, alignment: AlignmentSettings) -> None:
        """Start before the boot's first sample."""
        self._max_gap_us = alignment.max_gap_us
        self._reference = np.full(1, -FALLBACK_US)
        self._series = new_series(ATTITUDE_WIDTH)
        self._waiting = new_waiting(QUERY_WIDTH)

    def take(
        self, stream: Int64s, euler: AttitudeSamples, quaternion: AttitudeSamples, imu: VehicleImu | None
    ) -> tuple[Track, ImuWithAttitude]:
        """The attitudes that others are compared with, valid ones in order of arrival; and what is known by now of
        inertial samples, of this batch or before.

        `stream` (n,): the messages in order of arrival, 0 and 1 the next sample of `euler` and `quaternion`.
        """
        n, asked = len(euler) + len(quaternion), 0 if imu is None else len(imu)
        track = Track(frame_index=np.empty(n, np.int64), t_us=np.empty(n, np.int64), rows=np.empty((n, ATTITUDE_WIDTH)))
        self._series = self._series.with_room(n)
        self._waiting = self._waiting.with_room(asked)
        seen = _seen_rows(self._waiting.n + asked)
        counts = np.zeros(4, np.int64)
        of_track = track.frame_index, track.t_us, track.rows
        choose_reference(stream, _attitudes(euler), _attitudes(quaternion), self._reference, *of_track, counts)
        chosen = int(counts[2])
        if chosen < n:
            track = track[:chosen]
            of_track = track.frame_index, track.t_us, track.rows
        came = _NO_INERTIAL if imu is None else _inertial(imu)
        if asked or self._waiting.n:
            see_kernel(*of_track, came, self._max_gap_us, self._series, self._waiting, seen, counts)
        elif chosen:
            hear_all(*of_track, self._series)
        found = int(counts[3])
        return track, ImuWithAttitude(
            max_gap_us=self._max_gap_us, **{name: of[:found] for name, of in seen._asdict().items()}
        )


def _attitudes(samples: AttitudeSamples) -> Attitudes:
    return Attitudes(
        frame_index=samples.frame_index,
        t_us=samples.t_boot_us,
        q_nb=samples.q_nb,
        w_b_rad_s=samples.w_nb_b_rad_s,
        valid=samples.valid,
    )


def _inertial(imu: VehicleImu) -> Inertial:
    return Inertial(
        frame_index=imu.frame_index,
        t_us=imu.t_boot_us,
        t_rx_us=imu.t_rx_us,
        f_b_m_s2=imu.f_b_m_s2,
        w_b_rad_s=imu.w_b_rad_s,
        m_b_gauss=imu.m_b_gauss,
        trim_b_rad=imu.trim_b_rad,
        may_rest=imu.may_rest,
        stands=imu.stands,
    )


_INTS, _VECTORS, _MASK = np.empty(0, np.int64), np.empty((0, 3)), np.empty(0, np.bool_)
_NO_INERTIAL = Inertial(_INTS, _INTS, _INTS, _VECTORS, _VECTORS, _VECTORS, _VECTORS, _MASK, _MASK)


def _seen_rows(n: int) -> SeenRows:
    """Room for n samples."""
    return SeenRows(
        frame_index=np.empty(n, np.int64),
        t_boot_us=np.empty(n, np.int64),
        t_rx_us=np.empty(n, np.int64),
        f_b_m_s2=np.empty((n, 3)),
        w_b_rad_s=np.empty((n, 3)),
        m_b_gauss=np.empty((n, 3)),
        trim_b_rad=np.empty((n, 3)),
        may_rest=np.empty(n, np.bool_),
        stands=np.empty(n, np.bool_),
        q_nb=np.empty((n, 4)),
        w0_b_rad_s=np.empty((n, 3)),
        w1_b_rad_s=np.empty((n, 3)),
        turn_b_rad=np.empty((n, 3)),
        gap_s=np.empty(n),
        place=np.empty(n),
    )


class PrimaryImu:
    """Chooses one inertial sensor: the best that was heard so far, within one boot."""

    def __init__(self) -> None:
        """Start with none heard."""
        self._best = len(_SENSORS)

    def take(self, imu: Mapping[str, ImuSamples]) -> ImuSamples | None:
        """The samples of the chosen sensor, up to where a better one is heard: from there on, that one's."""
        if len(imu) == 1:
            ((name, samples),) = imu.items()
            rank = _SENSORS.index(name)
            self._best = min(self._best, rank)
            return samples if rank == self._best and len(samples) else None
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
