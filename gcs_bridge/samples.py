"""Decoded messages → typed samples: the one place where the numbers of the wire acquire a frame and a unit.

ATTITUDE and ATTITUDE_QUATERNION turn body axes (forward-right-down) into the local north-east-down frame; their speeds
are body rates in rad/s (MAVLink common.xml). IMU messages come in three scales, told apart here.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude

Floats = npt.NDArray[np.float64]
Int64s = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
Records = npt.NDArray[np.void]

STANDARD_GRAVITY = 9.80665  # m/s², ISO 80000-3
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


class Units(NamedTuple):
    """What one count of the wire means, in m/s², rad/s, gauss (NaN: unknown), and how that is known."""

    m_s2: float
    rad_s: float
    gauss: float
    scale: str


_SI = Units(1.0, 1.0, 1.0, "defined: m/s², rad/s, gauss")
_MILLI = Units(STANDARD_GRAVITY * 1e-3, 1e-3, 1e-3, "defined: mG, mrad/s, mgauss")
_COUNTS_PER_G = (1000, 512, 2048, 4096, 8192, 16384)  # 1000: mG; the others: accelerometers of ±64 g to ±2 g, 16 bits
_STEADY_SAMPLES = 50  # of which the length of the specific force is taken for g
_STEADY_SHARE = 0.03  # and may differ by no more, from its mean or from a known scale


class UnitResolver:
    """Decides what the numbers of one IMU message mean, for one vehicle.

    SCALED_IMU* and HIGHRES_IMU have units by definition, RAW_IMU has none. ArduPilot sends RAW_IMU calibrated, in mG,
    mrad/s and mGauss (GCS_Common.cpp, send_raw_imu). From another autopilot its numbers get a unit once the force was
    steady for a while, and so 1 g, and that is so many counts as a known scale has; only mG tells the others' units.
    """

    def __init__(self, source: str) -> None:
        """Start undecided, if `source` defines no unit."""
        self._units = _SI if source == "HIGHRES_IMU" else _MILLI if source != "RAW_IMU" else None
        self._forces: list[float] = []
        self._tries = 0

    def resolve(self, records: Records, autopilot: str, since: int) -> tuple[Units, int]:
        """The units of `records`, and the first row for which they are known; `autopilot` is, from row `since` on."""
        if self._units is not None:
            return self._units, 0
        known = autopilot == "ardupilot"
        untold = records[:since] if known else records
        force = np.sqrt(sum(untold[axis].astype(np.float64) ** 2 for axis in ("xacc", "yacc", "zacc")))
        for row, length in enumerate(force.tolist()):
            self._forces.append(length)
            if len(self._forces) == _STEADY_SAMPLES:
                units = self._decided(np.array(self._forces))
                self._forces.clear()
                if units is not None:
                    self._units = units
                    return units, row + 1
        if known and since < len(records):
            self._units = _MILLI._replace(scale="assumed of ArduPilot: mG, mrad/s, mgauss")
            return self._units, since
        why = f"unknown: RAW_IMU has no unit, none is known for autopilot {autopilot}"
        tried = ", and at no time was the force steady at 1 g of a known scale" if self._tries else ""
        return Units(np.nan, np.nan, np.nan, why + tried), 0

    def _decided(self, counts: Floats) -> Units | None:
        mean = float(counts.mean())
        if mean <= 0 or np.abs(counts - mean).max() > _STEADY_SHARE * mean:
            self._tries += 1
            return None
        for per_g in _COUNTS_PER_G:
            if abs(mean / per_g - 1) <= _STEADY_SHARE:
                scale = f"assumed, since {mean:.0f} counts are 1 g at rest"
                if per_g == _COUNTS_PER_G[0]:
                    return _MILLI._replace(scale=f"{scale}: mG, mrad/s, mgauss")
                scale += f": {per_g} a g; gyro and compass unknown"
                return Units(STANDARD_GRAVITY / per_g, np.nan, np.nan, scale)
        self._tries += 1
        return None


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
