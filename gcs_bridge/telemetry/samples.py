"""Decoded messages → typed samples: the one place where the numbers of the wire acquire a frame and a unit.

ATTITUDE and ATTITUDE_QUATERNION turn body axes (forward-right-down) into the local north-east-down frame; their speeds
are body rates in rad/s (MAVLink common.xml). IMU messages come in three scales, told apart here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, Records
from gcs_bridge.telemetry.imu_units import Units

NORM_TOLERANCE = 0.5  # a quaternion further from unit norm has no attitude left in it
ATTITUDE = "ATTITUDE"
ATTITUDE_QUATERNION = "ATTITUDE_QUATERNION"
STREAMS = (ATTITUDE, ATTITUDE_QUATERNION)  # the two that are compared, by their index everywhere
AHRS2 = "AHRS2"
_RATES = ("rollspeed", "pitchspeed", "yawspeed")


class Stamps(NamedTuple):
    """When n samples were: µs since boot number `boot`, receive time, µs, −1 where unknown, and the index of the frame
    that brought each; (n,) each.
    """

    frame_index: Int64s
    boot: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s


@dataclass(frozen=True, kw_only=True)
class _Samples(FrameColumns):
    boot: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s


@dataclass(frozen=True, kw_only=True)
class AttitudeSamples(_Samples):
    """Attitudes of one source, in order of arrival; n samples.

    `t_boot_us` (n,) µs since boot number `boot` (n,); `t_rx_us` (n,) receive time, µs, −1 where unknown;
    `frame_index` (n,) the number of each one's frame in its link or recording, which counts verified frames from 0;
    `q_nb` (n, 4) [w, x, y, z], FRD to NED, **as sent**: never normalised; `w_nb_b_rad_s` (n, 3) body rates;
    `valid` (n,): all finite and the norm within 0.5 of 1; `rpy_rad` (n, 3) as sent, where the source sends angles;
    `repr_offset_q` (n, 4) as sent, where the source has it: the body's turn for displays alone; `source` the message's
    name.
    """

    q_nb: Floats
    w_nb_b_rad_s: Floats
    valid: Mask
    source: str
    rpy_rad: Floats | None = None
    repr_offset_q: Floats | None = None


@dataclass(frozen=True, kw_only=True)
class Ahrs2Samples(AttitudeSamples):
    """Attitudes of the second estimate, n, whose time lies between the timed messages on both sides of them.

    `frame_index` (n,) of the frame behind, by which the time was known; `gap_us` (n,) between the two.
    """

    gap_us: Int64s


@dataclass(frozen=True, kw_only=True)
class ImuSamples(_Samples):
    """Samples of one inertial source, in order of arrival; n samples, NaN where a scale or a sensor is unknown.

    `t_us` (n,) the message's own clock; `t_boot_us` the same on the vehicle's boot clock, −1 before its first time;
    `boot`, `t_rx_us` and `frame_index` as in AttitudeSamples; `f_b_m_s2` (n, 3) specific
    force, `w_b_rad_s` (n, 3) angular rate, `m_b_gauss` (n, 3) magnetic field, all in FRD body axes; `scale` names the
    units that were taken for the wire's numbers, and why.
    """

    t_us: Int64s
    f_b_m_s2: Floats
    w_b_rad_s: Floats
    m_b_gauss: Floats
    source: str
    scale: str


def attitude_samples(records: Records, stamps: Stamps) -> AttitudeSamples:
    """ATTITUDE: roll, pitch, yaw in rad, intrinsic Z-Y-X (rule M11), wider ranges than nominal included."""
    rpy = _columns(records, "roll", "pitch", "yaw")
    q = attitude.quaternion_from_rpy(roll_rad=rpy[:, 0], pitch_rad=rpy[:, 1], yaw_rad=rpy[:, 2])
    return AttitudeSamples(
        **stamps._asdict(),
        q_nb=q,
        w_nb_b_rad_s=_columns(records, *_RATES),
        valid=finite(rpy),
        source=ATTITUDE,
        rpy_rad=rpy,
    )


def attitude_quaternion_samples(records: Records, stamps: Stamps) -> AttitudeSamples:
    """ATTITUDE_QUATERNION: q1…q4 are w, x, y, z. `repr_offset_q` is for displays and not applied."""
    q = _columns(records, "q1", "q2", "q3", "q4")
    norm = np.sqrt(q[:, 0] ** 2 + q[:, 1] ** 2 + q[:, 2] ** 2 + q[:, 3] ** 2)
    valid: Mask = finite(q) & (np.abs(norm - 1.0) <= NORM_TOLERANCE)
    return AttitudeSamples(
        **stamps._asdict(),
        q_nb=q,
        w_nb_b_rad_s=_columns(records, *_RATES),
        valid=valid,
        source=ATTITUDE_QUATERNION,
        repr_offset_q=records["repr_offset_q"].astype(np.float64),
    )


def secondary_samples(records: Records, stamps: Stamps, gap_us: Int64s) -> Ahrs2Samples:
    """AHRS2: roll, pitch, yaw in rad of the second estimate; it has neither a time of its own nor rates."""
    rpy = _columns(records, "roll", "pitch", "yaw")
    q = attitude.quaternion_from_rpy(roll_rad=rpy[:, 0], pitch_rad=rpy[:, 1], yaw_rad=rpy[:, 2])
    unsaid = ~rpy.any(axis=1)  # all three exactly zero: the estimate has not started
    return Ahrs2Samples(
        **stamps._asdict(),
        q_nb=q,
        w_nb_b_rad_s=np.full_like(rpy, np.nan),
        valid=finite(rpy) & ~unsaid,
        source=AHRS2,
        rpy_rad=rpy,
        gap_us=gap_us,
    )


def no_attitudes(source: str) -> AttitudeSamples:
    """No sample at all of `source`."""
    of_quaternion = source == ATTITUDE_QUATERNION
    return AttitudeSamples(
        **_NO_STAMPS._asdict(),
        q_nb=np.empty((0, 4)),
        w_nb_b_rad_s=np.empty((0, 3)),
        valid=np.empty(0, np.bool_),
        source=source,
        rpy_rad=None if of_quaternion else np.empty((0, 3)),
        repr_offset_q=np.empty((0, 4)) if of_quaternion else None,
    )


def no_imu(source: str) -> ImuSamples:
    """No sample at all of `source`."""
    empty = np.empty((0, 3))
    return ImuSamples(
        **_NO_STAMPS._asdict(),
        t_us=np.empty(0, np.int64),
        f_b_m_s2=empty,
        w_b_rad_s=empty,
        m_b_gauss=empty,
        source=source,
        scale="unknown: none came",
    )


_NO_STAMPS = Stamps(*(np.empty(0, np.int64) for _ in Stamps._fields))
IMU_MESSAGES = ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU")


def imu_samples(source: str, records: Records, units: tuple[Units, int], stamps: Stamps) -> ImuSamples:
    """One of IMU_MESSAGES; `units` are known from a row on, and the rows before are NaN."""
    unit, known_from = units
    force = _columns(records, "xacc", "yacc", "zacc") * unit.m_s2
    rates = _columns(records, "xgyro", "ygyro", "zgyro") * unit.rad_s
    field = _columns(records, "xmag", "ymag", "zmag") * unit.gauss
    for triple in (force, rates, field):
        triple[:known_from] = np.nan
    return ImuSamples(
        **stamps._asdict(),
        t_us=clock_us(records),
        f_b_m_s2=force,
        w_b_rad_s=rates,
        m_b_gauss=field,
        source=source,
        scale=unit.scale,
    )


def clock_us(records: Records) -> Int64s:
    """The message's own clock, µs: `time_usec` (since boot or since 1970) or `time_boot_ms`."""
    if "time_usec" in (records.dtype.names or ()):
        return records["time_usec"].astype(np.int64)
    return records["time_boot_ms"].astype(np.int64) * 1000


def _columns(records: Records, *names: str) -> Floats:
    """The named fields side by side, as float64."""
    out = np.empty((len(records), len(names)))
    for column, name in enumerate(names):
        out[:, column] = records[name]
    return out


def finite(rows: Floats) -> Mask:
    """Which rows (n, k) hold numbers only."""
    known = np.isfinite(rows)
    return np.asarray(np.logical_and.reduce([known[:, column] for column in range(known.shape[1])]))
