"""What each message shows by itself: its norm, a payload that stands still, its steps against its own rates.

Neither is compared with the other here.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats
from gcs_bridge.diagnosis.hypotheses import Hypothesis
from gcs_bridge.diagnosis.window import EULER, QUATERNION, Pairing, Stream
from gcs_bridge.pairing.bounds import turn_and_kin
from gcs_bridge.telemetry.samples import AttitudeSamples

_FROZEN_SHARE = 0.9
_MOVED_RAD = np.radians(1.0)
_LEAST = 5
_STEP_S = 1.0  # longer steps say nothing about rates
_TURNED_RAD = np.radians(20.0)  # before rates show what they mean
_LEFT_SHARE = 0.25  # of what the rates miss the turn by: what a mistake that explains it leaves
_NAME = {EULER: "frozen_euler", QUATERNION: "frozen_quaternion"}


def norms(samples: AttitudeSamples) -> Floats:
    """The norms of the quaternions as sent, of those that are above 0 and numbers."""
    length = np.sqrt(np.square(samples.q_nb).sum(axis=1))
    return np.asarray(length[np.isfinite(length) & (length > 0.0)])


def frozen(pairing: Pairing) -> tuple[str, bool] | None:
    """`frozen_euler` or `frozen_quaternion`, if one payload stands still while the other message's changes.

    Beside it, whether the other one's attitude moved, or only its last digits.
    """
    for side in (EULER, QUATERNION):
        stream, other = pairing.streams[side], pairing.streams[1 - side]
        if min(len(stream.t_s), len(other.t_s)) < _LEAST:
            continue
        if _unchanged(stream) >= _FROZEN_SHARE and _unchanged(other) < 1.0 - _FROZEN_SHARE:
            q = other.q_nb
            return _NAME[side], bool(attitude.angle_between(q[0], q).max() > _MOVED_RAD)
    return None


def _unchanged(stream: Stream) -> float:
    """The share of samples that repeat the one before, rates and all."""
    payload = np.hstack((stream.sent, stream.w_b_rad_s))
    return float((payload[1:] == payload[:-1]).all(axis=1).mean())


def at_fault(pairing: Pairing, hypothesis: Hypothesis) -> Literal[30, 31] | None:
    """The message whose steps its own rates deny while the other's agree with theirs; else the mistake's own.

    None where it can't be told: a constant turn of the world or a lag leaves the steps as they are.
    """
    off = [_off_rates(pairing, side) for side in (EULER, QUATERNION)]
    if None not in off:
        euler, quaternion = (float(share or 0.0) for share in off)
        if euler > 0.05 + 4.0 * quaternion:
            return 30
        if quaternion > 0.05 + 4.0 * euler:
            return 31
    messages = {row.message for row in hypothesis.rows if row.name in _ONE_SIDED}
    return messages.pop() if len(messages) == 1 and len(hypothesis.rows) == 1 else None


# What only this message can have, as it is about its numbers and not about what they mean.
_ONE_SIDED = {
    *("quaternion_xyzw", "quaternion_unnormalised", "frozen_quaternion", "frozen_euler"),
    *("euler_degrees", "euler_xyz_order", "roll_pitch_swapped", "roll_sign", "pitch_sign", "yaw_sign", "pitch_trim"),
}


def sends_euler_rates(samples: AttitudeSamples) -> bool | None:
    """Whether the angles' rates stand where the body's should: they account for the steps, and body rates do not.

    None: it came too seldom, or hardly turned, to tell.
    """
    samples = samples.where(samples.valid)
    if len(samples) < _LEAST:
        return None
    t_us, q, w = samples.t_boot_us, samples.q_nb, samples.w_nb_b_rad_s
    h_s = np.diff(t_us) * 1e-6
    body = attitude.body_rates_from_euler_rates(attitude.rpy_from_quaternion(q), w)
    turn, as_sent = turn_and_kin(q[:-1], q[1:], w[:-1], w[1:], h_s)
    _, undone = turn_and_kin(q[:-1], q[1:], body[:-1], body[1:], h_s)
    good = np.isfinite(as_sent) & np.isfinite(undone) & (h_s > 0.0) & (h_s < _STEP_S)
    if good.sum() < _LEAST or np.sqrt(np.square(turn[good]).sum(axis=1)).sum() < _TURNED_RAD:
        return None
    missed, left = as_sent[good].sum(), undone[good].sum()
    return bool(left < _LEFT_SHARE * missed)


def _off_rates(pairing: Pairing, side: int) -> float | None:
    """By what share of its turning a message's steps differ from what its rates say; None: it hardly turns."""
    stream = pairing.streams[side]
    if len(stream.t_s) < _LEAST:
        return None
    h_s = np.diff(stream.t_s)
    w = stream.w_b_rad_s
    _, kin = turn_and_kin(stream.q_nb[:-1], stream.q_nb[1:], w[:-1], w[1:], h_s)
    turned = 0.5 * h_s * np.sqrt(np.square(w[:-1] + w[1:]).sum(axis=1))
    good = np.isfinite(kin) & np.isfinite(turned) & (h_s < _STEP_S)
    # Where it turns most: at rest both are noise.
    good &= turned >= np.quantile(turned[good], 0.5) if good.any() else False
    if not good.any() or turned[good].sum() < np.radians(5.0):
        return None
    return float(np.median(kin[good] / turned[good]))
