"""Decoded messages → typed samples: the one place where the numbers of the wire acquire a frame and a unit.

ATTITUDE and ATTITUDE_QUATERNION turn body axes (forward-right-down) into the local north-east-down frame; their speeds
are body rates in rad/s (MAVLink common.xml). IMU messages come in three scales, told apart here.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, Int64s, Mask, Records
from gcs_bridge.telemetry.imu_units import Units

NORM_TOLERANCE = 0.5  # a quaternion further from unit norm has no attitude left in it
ATTITUDE = "ATTITUDE"
ATTITUDE_QUATERNION = "ATTITUDE_QUATERNION"
AHRS2 = "AHRS2"
_RATES = ("rollspeed", "pitchspeed", "yawspeed")


@dataclass(frozen=True)
class _Samples:
    def __len__(self) -> int:
        return len(self.t_boot_us)

    t_boot_us: Int64s
    boot: Int64s
    t_rx_us: Int64s

    def __getitem__(self, rows: Any) -> Self:
        """The samples of a slice, mask or index array."""
        picked = {f.name: getattr(self, f.name) for f in fields(self)}
        return type(self)(**{k: v[rows] if isinstance(v, np.ndarray) else v for k, v in picked.items()})

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """All of `parts`, one or more, one behind the other."""
        first = parts[0]
        return type(first)(
            **{
                f.name: np.concatenate([getattr(part, f.name) for part in parts])
                if isinstance(getattr(first, f.name), np.ndarray)
                else getattr(first, f.name)
                for f in fields(first)
            }
        )


@dataclass(frozen=True)
class AttitudeSamples(_Samples):
    """Attitudes of one source, in order of arrival; n samples.

    `t_boot_us` (n,) µs since boot number `boot` (n,); `t_rx_us` (n,) receive time, µs, −1 where unknown;
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


@dataclass(frozen=True)
class ImuSamples(_Samples):
    """Inertial samples of one source, in order of arrival; n samples, NaN where a scale or a sensor is unknown.

    `t_us` (n,) the message's own clock; `t_boot_us` the same on the vehicle's boot clock; `f_b_m_s2` (n, 3) specific
    force, `w_b_rad_s` (n, 3) angular rate, `m_b_gauss` (n, 3) magnetic field, all in FRD body axes; `scale` names the
    units that were taken for the wire's numbers, and why.
    """

    t_us: Int64s
    f_b_m_s2: Floats
    w_b_rad_s: Floats
    m_b_gauss: Floats
    source: str
    scale: str


def attitude_samples(records: Records, boot: Int64s, t_boot_us: Int64s, t_rx_us: Int64s) -> AttitudeSamples:
    """ATTITUDE: roll, pitch, yaw in rad, intrinsic Z-Y-X (rule M11), wider ranges than nominal included."""
    rpy = _columns(records, "roll", "pitch", "yaw")
    q = attitude.quaternion_from_rpy(roll_rad=rpy[:, 0], pitch_rad=rpy[:, 1], yaw_rad=rpy[:, 2])
    return AttitudeSamples(t_boot_us, boot, t_rx_us, q, _columns(records, *_RATES), finite(rpy), ATTITUDE, rpy)


def attitude_quaternion_samples(records: Records, boot: Int64s, t_boot_us: Int64s, t_rx_us: Int64s) -> AttitudeSamples:
    """ATTITUDE_QUATERNION: q1…q4 are w, x, y, z. `repr_offset_q` is for displays and not applied."""
    q = _columns(records, "q1", "q2", "q3", "q4")
    norm = np.sqrt(q[:, 0] ** 2 + q[:, 1] ** 2 + q[:, 2] ** 2 + q[:, 3] ** 2)
    valid: Mask = finite(q) & (np.abs(norm - 1.0) <= NORM_TOLERANCE)
    offset = records["repr_offset_q"].astype(np.float64)
    rates = _columns(records, *_RATES)
    return AttitudeSamples(t_boot_us, boot, t_rx_us, q, rates, valid, ATTITUDE_QUATERNION, repr_offset_q=offset)


def secondary_samples(records: Records, boot: Int64s, t_boot_us: Int64s, t_rx_us: Int64s) -> AttitudeSamples:
    """AHRS2: roll, pitch, yaw in rad of the second estimate; it has neither a time of its own nor rates."""
    rpy = _columns(records, "roll", "pitch", "yaw")
    q = attitude.quaternion_from_rpy(roll_rad=rpy[:, 0], pitch_rad=rpy[:, 1], yaw_rad=rpy[:, 2])
    unsaid = ~rpy.any(axis=1)  # all three exactly zero: the estimate has not started
    return AttitudeSamples(t_boot_us, boot, t_rx_us, q, np.full_like(rpy, np.nan), finite(rpy) & ~unsaid, AHRS2, rpy)


def no_attitudes(source: str) -> AttitudeSamples:
    """No sample at all of `source`."""
    none = np.empty(0, np.int64)
    q, w, valid = np.empty((0, 4)), np.empty((0, 3)), np.empty(0, np.bool_)
    if source == ATTITUDE_QUATERNION:
        return AttitudeSamples(none, none, none, q, w, valid, source, repr_offset_q=q)
    return AttitudeSamples(none, none, none, q, w, valid, source, np.empty((0, 3)))


def no_imu(source: str) -> ImuSamples:
    """No sample at all of `source`."""
    none, empty = np.empty(0, np.int64), np.empty((0, 3))
    return ImuSamples(none, none, none, none, empty, empty, empty, source, "unknown: none came")


IMU_MESSAGES = ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU")


def imu_samples(
    source: str, records: Records, units: tuple[Units, int], boot: Int64s, t_boot_us: Int64s, t_rx_us: Int64s
) -> ImuSamples:
    """One of IMU_MESSAGES; `units` are known from a row on, and the rows before are NaN."""
    unit, known_from = units
    force = _columns(records, "xacc", "yacc", "zacc") * unit.m_s2
    rates = _columns(records, "xgyro", "ygyro", "zgyro") * unit.rad_s
    field = _columns(records, "xmag", "ymag", "zmag") * unit.gauss
    for triple in (force, rates, field):
        triple[:known_from] = np.nan
    return ImuSamples(t_boot_us, boot, t_rx_us, clock_us(records), force, rates, field, source, unit.scale)


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
