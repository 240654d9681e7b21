"""Which view each sample of ATTITUDE shows: that of the mode, but for a while around a change of it.

The mode may be told up to a second late, and a tailsitter turns seconds behind it. There the samples say which view it
is, by the latest quaternion, or by the down that was felt. Beyond, a view without its mode is a fault.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, Int64s, Mask, last_where
from gcs_bridge.expected.felt import FELT_RAD, Forces, down_felt, length_of
from gcs_bridge.expected.knowledge import FORWARD, HOVER, FirmwareConfig
from gcs_bridge.expected.pairs import (
    QuaternionRows,
)
from gcs_bridge.expected.view import View
from gcs_bridge.telemetry.samples import AttitudeSamples

_MODE_LAG_US = 10_000_000  # a tailsitter changes its view when it has turned, seconds after the mode; 3.5 s were seen
_AHEAD_US = 1_000_000  # heartbeats come once a second: the view may change before the mode is told
_QUATERNION_AGE_S = 1.0
_VIEW_MATCH_RAD = math.radians(2.0)  # the latest quaternion, brought to the sample's time by its rates, may be off by
_VIEW_MATCH_SHARE = 0.25  # so much, or by this share of what is between the views
_FELT_APART = 2.0 * math.sin(math.radians(60.0) / 2.0)  # between views whose downs are this far from each other


class ShownView:
    """Which view one vehicle shows, followed through its batches and boots."""

    def __init__(self) -> None:
        """Start before the first sample."""
        self._mode_since_us: int | None = None  # None: counted from the next sample
        self._latest: int | None = None  # the view of the latest sample, None: that of the mode
        self._astray_since_us = -1  # since when it is not that of the mode, −1 if it is

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        self._mode_since_us, self._latest, self._astray_since_us = None, None, -1

    def change_mode(self, t_us: int | None) -> None:
        """The mode says another view, or another firmware has it, from `t_us` on; None: from the next sample on."""
        self._mode_since_us, self._astray_since_us = t_us, -1

    def forget_latest(self) -> None:
        """What was seen before says nothing: it is that of the mode."""
        self._latest = None

    def follow(self, view: int, astray_since_us: int) -> None:
        """Take what was chosen for the last sample that was looked at."""
        self._latest, self._astray_since_us = view, astray_since_us

    def choose(
        self,
        euler: AttitudeSamples,
        quaternions: QuaternionRows,
        forces: Forces,
        told: FirmwareConfig,
        views: tuple[View, View],
    ) -> tuple[npt.NDArray[np.int8], Mask, Int64s]:
        """The view that each of n Euler samples shows, whether it may change there, since when it is not the mode's.

        The mode says which view it is. Around a change of mode the latest quaternion says it, brought to the sample's
        time by the body rates of both (which are the body's in every view). Only the down vectors are compared: yaw,
        and its resets, have no part in it.
        """
        assert euler.rpy_rad is not None
        rpy_rad, t_us, n = euler.rpy_rad, euler.t_boot_us, len(euler)
        mode_view, hover = told.view, views[HOVER]
        usual = FORWARD if mode_view is None else mode_view
        view = np.full(n, usual, np.int8)
        free, astray_since_us = np.zeros(n, np.bool_), np.full(n, -1)
        if not told.can_hover or not n:
            return view, free, astray_since_us
        if self._mode_since_us is None:
            self._mode_since_us = int(t_us[0])
        free[:] = True if mode_view is None else t_us - self._mode_since_us <= _MODE_LAG_US
        unknown = told.open_view and not hover.fitted
        if (unknown and len(quaternions)) or hover.correction == views[FORWARD].correction:
            return view, free, astray_since_us
        downs = [attitude.body_down(one.correction.undo(rpy_rad)) for one in views]
        is_usual, astray = _seen_as(usual, euler, downs, quaternions, forces)
        decided = last_where(is_usual | astray)
        undecided = usual if self._latest is None else self._latest
        shown = np.where(decided >= 0, np.where(astray[decided], 1 - usual, usual), undecided)
        before = np.concatenate(([self._astray_since_us >= 0], astray[:-1]))
        begins = last_where(astray & ~before)
        astray_since_us = np.where(begins >= 0, t_us[begins], self._astray_since_us)
        astray_since_us[~astray] = -1
        ahead = astray & (t_us - astray_since_us <= _AHEAD_US)
        view[:] = np.where(free | ahead, shown, usual)
        return view, free, astray_since_us


def _seen_as(
    usual: int, euler: AttitudeSamples, downs: list[Floats], quaternions: QuaternionRows, forces: Forces
) -> tuple[Mask, Mask]:
    """Which Euler samples (n,) are seen to show the usual view, and which the other; `downs` (n, 3) of each view.

    By the latest quaternion; where there is none, by the accelerometer, if the views are so far from each other.
    """
    t_us, n = euler.t_boot_us, len(euler)
    down, off_most = np.full((n, 3), np.nan), np.full(n, _VIEW_MATCH_RAD)
    apart = length_of(downs[0] - downs[1])
    if len(quaternions):
        latest = np.searchsorted(quaternions.frame_index, euler.frame_index) - 1
        since_s = (t_us - quaternions.t_us[latest]) * 1e-6
        turn = 0.5 * (quaternions.w_b_rad_s[latest] + euler.w_nb_b_rad_s) * since_s[:, None]
        q_now = attitude.multiply(quaternions.q_nb[latest], attitude.quaternion_from_rotvec(turn))
        known = (latest >= 0) & (np.abs(since_s) <= _QUATERNION_AGE_S)
        down[known] = attitude.body_down(q_now)[known]
        off_most = np.maximum(_VIEW_MATCH_RAD, _VIEW_MATCH_SHARE * apart)
    unknown = np.isnan(down[:, 0]) & (apart >= _FELT_APART)
    if unknown.any() and len(forces):
        down[unknown] = down_felt(forces, euler.frame_index[unknown], t_us[unknown])
        off_most[unknown] = FELT_RAD
    off = [length_of(one - down) for one in downs]
    known = np.minimum(*off) <= off_most
    is_usual, astray = (known & (3.0 * off[one] < off[1 - one]) for one in (usual, 1 - usual))
    return is_usual, astray
