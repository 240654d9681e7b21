"""Samples against their limits: what an alarm is fed with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt


class Worst(NamedTuple):
    """The largest value of an excursion, and the detail that came with it."""

    value: float
    detail: npt.NDArray[np.float64]


@dataclass(frozen=True)
class Rated:
    """n samples against their limits: time, value, whether bad and whether low (never both), and a detail a sample.

    `frame_index` (n,) is of the frame that brought each about; `detail` (n, 5) is tilt, heading and the rotation vector
    in body axes, rad, of a value that is an angle between attitudes, and NaN of any other.
    """

    t_boot_us: npt.NDArray[np.int64]
    frame_index: npt.NDArray[np.int64]
    value: npt.NDArray[np.float64]
    bad: npt.NDArray[np.bool_]
    low: npt.NDArray[np.bool_]
    detail: npt.NDArray[np.float64]

    def __getitem__(self, rows: slice) -> Rated:
        """The samples of a slice."""
        return Rated(
            self.t_boot_us[rows],
            self.frame_index[rows],
            self.value[rows],
            self.bad[rows],
            self.low[rows],
            self.detail[rows],
        )
