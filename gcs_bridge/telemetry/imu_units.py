"""What the numbers of an inertial message mean: RAW_IMU defines no unit, and firmwares differ.

It looks at numbers alone, and knows no vehicle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Floats

STANDARD_GRAVITY = 9.80665  # m/s², ISO 80000-3


class Units(NamedTuple):
    """What one count of the wire means, in m/s², rad/s, gauss (NaN: unknown), and how that is known."""

    m_s2: float
    rad_s: float
    gauss: float
    scale: str


SI = Units(1.0, 1.0, 1.0, "defined: m/s², rad/s, gauss")
MILLI = Units(STANDARD_GRAVITY * 1e-3, 1e-3, 1e-3, "defined: mG, mrad/s, mgauss")
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
        self.units = SI if source == "HIGHRES_IMU" else MILLI if source != "RAW_IMU" else None  # as far as known
        self._forces: list[float] = []
        self._tries = 0

    def resolve(self, force: Floats, autopilot: str, since: int) -> tuple[Units, int]:
        """The units of the next samples, and the first row for which they are known.

        `force` (n, 3) as on the wire; `autopilot` is known from row `since` on.
        """
        if self.units is not None:
            return self.units, 0
        known = autopilot == "ardupilot"
        untold = force[:since] if known else force
        lengths = np.sqrt(untold[:, 0] ** 2 + untold[:, 1] ** 2 + untold[:, 2] ** 2)
        for row, length in enumerate(lengths.tolist()):
            self._forces.append(length)
            if len(self._forces) == _STEADY_SAMPLES:
                units = self._decided(np.array(self._forces))
                self._forces.clear()
                if units is not None:
                    self.units = units
                    return units, row + 1
        if known and since < len(force):
            self.units = MILLI._replace(scale="assumed of ArduPilot: mG, mrad/s, mgauss")
            return self.units, since
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
                    return MILLI._replace(scale=f"{scale}: mG, mrad/s, mgauss")
                scale += f": {per_g} a g; gyro and compass unknown"
                return Units(STANDARD_GRAVITY / per_g, np.nan, np.nan, scale)
        self._tries += 1
        return None
