"""Samples of a vehicle: what their numbers mean, and room for them.

How they are read from the wire stands in `attitudes`, `inertial` and `secondary`.
"""

from __future__ import annotations

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, record

ATTITUDE = "ATTITUDE"
ATTITUDE_QUATERNION = "ATTITUDE_QUATERNION"
STREAMS = (ATTITUDE, ATTITUDE_QUATERNION)  # the two that are compared, by their index everywhere
AHRS2 = "AHRS2"
IMU_MESSAGES = ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU")


@record
class _Samples(FrameColumns):
    boot: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s


@record
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


@record
class Ahrs2Samples(AttitudeSamples):
    """Attitudes of the second estimate, n, whose time lies between the timed messages on both sides of them.

    `frame_index` (n,) of the frame behind, by which the time was known; `gap_us` (n,) between the two.
    """

    gap_us: Int64s


@record
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


def room_for_attitudes(source: str, n: int) -> AttitudeSamples:
    """Room for n samples of `source`, one of STREAMS, to be filled."""
    of_quaternion = source == ATTITUDE_QUATERNION
    return AttitudeSamples(
        frame_index=np.empty(n, np.int64),
        boot=np.empty(n, np.int64),
        t_boot_us=np.empty(n, np.int64),
        t_rx_us=np.empty(n, np.int64),
        q_nb=np.empty((n, 4)),
        w_nb_b_rad_s=np.empty((n, 3)),
        valid=np.empty(n, np.bool_),
        source=source,
        rpy_rad=None if of_quaternion else np.empty((n, 3)),
        repr_offset_q=np.empty((n, 4)) if of_quaternion else None,
    )


def room_for_ahrs2(n: int) -> Ahrs2Samples:
    """Room for n samples of the second estimate; their rates are NaN, as it has none."""
    return Ahrs2Samples(
        frame_index=np.empty(n, np.int64),
        boot=np.empty(n, np.int64),
        t_boot_us=np.empty(n, np.int64),
        t_rx_us=np.empty(n, np.int64),
        q_nb=np.empty((n, 4)),
        w_nb_b_rad_s=np.full((n, 3), np.nan),
        valid=np.empty(n, np.bool_),
        source=AHRS2,
        rpy_rad=np.empty((n, 3)),
        repr_offset_q=None,
        gap_us=np.empty(n, np.int64),
    )


def no_attitudes(source: str) -> AttitudeSamples:
    """No sample at all of `source`."""
    return room_for_attitudes(source, 0)


def no_imu(source: str) -> ImuSamples:
    """No sample at all of `source`."""
    none, no_rows = np.empty(0, np.int64), np.empty((0, 3))
    return ImuSamples(
        frame_index=none,
        boot=none,
        t_boot_us=none,
        t_rx_us=none,
        t_us=none,
        f_b_m_s2=no_rows,
        w_b_rad_s=no_rows,
        m_b_gauss=no_rows,
        source=source,
        scale="unknown: none came",
    )


def finite(rows: Floats) -> Mask:
    """Which rows (n, k) hold numbers only."""
    known = np.isfinite(rows)
    return np.asarray(np.logical_and.reduce([known[:, column] for column in range(known.shape[1])]))
