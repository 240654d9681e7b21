"""Where an attitude may be a while later: by its rates, and by what these may change meanwhile.

A track is a row of a quaternion q_nb, body rates in rad/s and a time in ms: (8,).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_bridge.attitude.quaternion import angle_of, conjugated, exponential, length, product
from gcs_bridge.jit import helper

__all__ = ["SHAKEN_RAD_S2", "SUDDEN_RAD_S2", "off_rad", "reach_rad", "surely_reaches", "turn_rad"]

# How far one may turn between two samples, by its rates and by what its rates may change meanwhile.
_SLACK_RAD = np.radians(2.2)  # as `kinematics` allows a step
SUDDEN_RAD_S2 = 30.0  # as far as vehicles turn suddenly of their own accord; shaken ones, far more
SHAKEN_RAD_S2 = 200.0
_SURE = 1.0 - 1e-9  # less than all, by more than is rounded


@helper
def turn_rad(track: Any, q: Any) -> Any:
    """The angle from a track's attitude to another."""
    return angle_of(product(conjugated((track[0], track[1], track[2], track[3])), q))


@helper
def off_rad(track: Any, q: Any, w: Any, ms: Any) -> Any:
    """How far an attitude is from where the rates at both ends bring the track's."""
    half_s = 0.5e-3 * (ms - track[7])
    turn = half_s * (track[4] + w[0]), half_s * (track[5] + w[1]), half_s * (track[6] + w[2])
    gone = product((track[0], track[1], track[2], track[3]), exponential(turn))
    return angle_of(product(conjugated(gone), q))


@helper
def reach_rad(track: Any, w: Any, ms: Any, sudden_rad_s2: Any) -> Any:
    """How far one may have turned from a track's attitude."""
    h_s = abs(ms - track[7]) * 1e-3
    return _SLACK_RAD + (length((track[4], track[5], track[6])) + length(w)) * h_s + 0.25 * sudden_rad_s2 * h_s * h_s


@helper
def surely_reaches(track: Any, q: Any, w: Any, ms: Any) -> Any:
    """Whether one can have turned from a track's attitude to another: no angle is larger than its tangent."""
    turn = product(conjugated((track[0], track[1], track[2], track[3])), q)
    most_rad = _SURE * reach_rad(track, w, ms, SUDDEN_RAD_S2)
    return 2.0 * length((turn[1], turn[2], turn[3])) <= most_rad * abs(turn[0])
