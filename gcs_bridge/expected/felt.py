"""The down that the accelerometer felt lately: it tells a plane on its tail from one on its wings.

No more than that: in flight it is off by tens of degrees.
"""

from __future__ import annotations

import math

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.attitude import G_M_S2
from gcs_bridge.columns import Floats, FrameColumns, Int64s, record, running_max
from gcs_bridge.expected.correction import Correction
from gcs_bridge.expected.knowledge import TAILSITTER_RAD
from gcs_bridge.expected.pairs import IN_A_ROW, run_lengths
from gcs_bridge.telemetry.samples import AttitudeSamples, ImuSamples

FELT_RAD = math.radians(30.0)  # what is felt is off by so much in flight
MEAN_US = 1_500_000  # over which the force is taken together, and after which it says nothing any more
_KEPT_US = 4_000_000
_LEAST, _MOST = 0.5 * G_M_S2, 1.5 * G_M_S2  # of a mean force that is mostly weight


@record
class Forces(FrameColumns):
    """Specific forces (n, 3) as they were measured, and by when: the latest time (n,) up to each."""

    t_us: Int64s
    f_b_m_s2: Floats


NO_FORCES = Forces(frame_index=np.empty(0, np.int64), t_us=np.empty(0, np.int64), f_b_m_s2=np.empty((0, 3)))


def forces_of(imu: ImuSamples, before: Forces) -> Forces:
    """What is kept, and the samples that are known behind it."""
    known = np.isfinite(imu.f_b_m_s2).all(axis=1)
    latest_us = int(before.t_us[-1]) if len(before) else -1
    more = Forces(
        frame_index=imu.frame_index[known],
        t_us=running_max(imu.t_boot_us[known], latest_us)[1:],
        f_b_m_s2=imu.f_b_m_s2[known],
    )
    every = before.then(more)
    if len(more):
        every = every[every.t_us >= int(more.t_us[0]) - _KEPT_US]
    return every


def down_felt(forces: Forces, frame_index: Int64s, t_us: Int64s) -> Floats:
    """The down in body axes (n, 3) that was felt up to frames and times (n,); NaN where it is not known."""
    down = np.full((len(t_us), 3), np.nan)
    if not len(forces):
        return down
    sums = np.concatenate((np.zeros((1, 3)), np.cumsum(forces.f_b_m_s2, axis=0)))
    end = np.searchsorted(forces.frame_index, frame_index)
    start = np.minimum(np.searchsorted(forces.t_us, t_us - MEAN_US), end)
    some = end > start
    mean = (sums[end[some]] - sums[start[some]]) / (end - start)[some, None]
    size = np.sqrt(np.square(mean).sum(axis=1))
    weighs = (size >= _LEAST) & (size <= _MOST)
    down[np.flatnonzero(some)[weighs]] = -mean[weighs] / size[weighs, None]
    return down


class Seat:
    """How a plane of which nothing told whether it is a tailsitter is felt to sit: on its wings, or on its tail."""

    def __init__(self) -> None:
        """Start with nothing felt."""
        self.on_wings = False  # it was felt to be as ATTITUDE says in forward flight
        self._on_tail = 0  # samples in a row in which one that hovers is felt to sit on its tail

    def feel(
        self,
        euler: AttitudeSamples,
        quaternion: AttitudeSamples,
        forces: Forces,
        forward: Correction,
        *,
        hovers: bool,
    ) -> int | None:
        """The row of the Euler samples with which a plane that hovers is felt to be a tailsitter, if any is.

        By those before the first quaternion, which tells the view. `forward`: what is undone in forward flight.
        """
        assert euler.rpy_rad is not None
        end = int(np.searchsorted(euler.frame_index, quaternion.frame_index[0])) if len(quaternion) else len(euler)
        rpy_rad = euler.rpy_rad[:end]
        felt = down_felt(forces, euler.frame_index[:end], euler.t_boot_us[:end])
        on_wings, on_tail = (
            length_of(attitude.body_down(one.undo(rpy_rad)) - felt)
            for one in (forward, Correction(view_rad=TAILSITTER_RAD))
        )
        if not hovers:
            self.on_wings |= bool(((on_wings <= FELT_RAD) & (3.0 * on_wings < on_tail)).any())
            self._on_tail = 0
            return None
        is_on_tail = (on_tail <= FELT_RAD) & (3.0 * on_tail < on_wings)
        in_a_row = run_lengths(is_on_tail, self._on_tail)
        enough = in_a_row >= IN_A_ROW
        if enough.any():
            return int(enough.argmax())
        self._on_tail = int(in_a_row[-1]) if end else self._on_tail
        return None


def length_of(v: Floats) -> Floats:
    """Of vectors (n, 3)."""
    return np.sqrt(v[:, 0] ** 2 + v[:, 1] ** 2 + v[:, 2] ** 2)
