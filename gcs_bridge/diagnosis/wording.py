"""What a diagnosis says: what to change, which motion would tell, and what the unexplained looks like.

Nothing is decided here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats
from gcs_bridge.diagnosis.hypotheses import TRIMS, Hypothesis, quaternion_of_rpy
from gcs_bridge.diagnosis.mistake import Cause, Value
from gcs_bridge.diagnosis.window import Comparison, Pairing


def amount(row: Cause, value: Value) -> str:
    """A value with its unit, as in a sentence: `12.0°`, `(0, 4.0, 0)°`, `150 ms`, `1.05`."""
    if row.unit == "deg":
        shown = [f"{number:.1f}" if abs(number) >= 0.05 else "0" for number in value]
        return f"{shown[0]}°" if len(shown) == 1 else f"({', '.join(shown)})°"
    if row.unit == "ms":
        return f"{value[0]:.0f} ms"
    return ", ".join(f"{number:.4g}" for number in value)


def advice(hypothesis: Hypothesis) -> str:
    """What to change, a sentence for each mistake."""
    sentences = [
        row.fix.replace("{value}", amount(row, value))
        for row, (_, value) in zip(hypothesis.rows, hypothesis.mistakes, strict=True)
    ]
    if {"mount_offset", "ahrs_trim"} <= set(hypothesis.causes):  # the same for every motion, about z by a little
        sentences.append("AHRS_TRIM_X may be another: beside a turned body it does not show.")
    return " ".join(sentences)


# --- which motion would tell -----------------------------------------------------------------------------------------


class _Motion(NamedTuple):
    """A turn from where the vehicle is, and then to hold still; degrees."""

    yaw: float
    roll: float
    pitch: float

    @property
    def words(self) -> str:
        lean = [f"{name} by {size:g}°" for name, size in (("roll", self.roll), ("pitch", self.pitch)) if size]
        yaw = [f"yaw by {self.yaw:g}°"] if self.yaw else []
        return " and ".join(lean + yaw) or "hold the attitude for a second"

    @property
    def effort(self) -> float:
        """Yaw is easy in a hover, a lean is not."""
        return self.yaw / 8.0 + (self.roll + self.pitch) / 2.0 + (2.0 if self.roll and self.pitch else 0.0)


_LEANS_DEG = (0.0, 2.0, 5.0, 10.0, 30.0)
_MOTIONS = sorted(
    itertools.starmap(_Motion, itertools.product((0.0, 5.0, 20.0, 45.0, 90.0), _LEANS_DEG, _LEANS_DEG)),
    key=lambda motion: motion.effort,
)
_TOLD_APART = 5  # hypotheses; of more the motion has shown next to nothing
_TELLS_DEG = 1.0  # a disagreement that any stage of this program sees, and twice what a wrong fit may hide


def telling_motion(found: Sequence[Hypothesis], pairing: Pairing) -> str:
    """The least motion from the window's last attitude after which the found hypotheses leave different residuals."""
    turns = _turns()
    separates = np.ones(len(_MOTIONS), np.bool_)
    for truth, other in itertools.permutations(found[:_TOLD_APART], 2):
        left = _left_deg(truth, other, pairing, turns)
        separates &= left.reshape(len(_MOTIONS), -1).min(axis=1) > _TELLS_DEG
    told = np.flatnonzero(separates)
    if not len(told) and any(name in TRIMS for one in found for name in one.causes):
        return "The vehicle's parameters tell: ask for them."
    if not len(told):
        return "Fly in all axes: the motion so far cannot tell them apart."
    words = _MOTIONS[int(told[0])].words
    return f"{words[0].upper()}{words[1:]}: that will tell."


def _turns() -> Floats:
    """All motions, each to both sides: roll, pitch, yaw, rad (8 a motion, 3)."""
    signs = np.array(list(itertools.product((1.0, -1.0), repeat=3)))
    sizes = np.radians([(motion.roll, motion.pitch, motion.yaw) for motion in _MOTIONS])
    return np.asarray((sizes[:, None, :] * signs).reshape(-1, 3))


def _left_deg(truth: Hypothesis, other: Hypothesis, pairing: Pairing, turns: Floats) -> Floats:
    """What `other` would leave (n,), deg, if `truth` were right and the vehicle held still after each turn (n, 3)."""
    found = pairing[np.array([len(pairing) - 1])].compare([truth])
    # As it should be, in the words of the side that `truth` holds for right.
    q_nb = attitude.multiply(
        attitude.quaternion_from_rotvec(np.stack([0 * turns[:, 2], 0 * turns[:, 2], turns[:, 2]], axis=1)),
        attitude.multiply(found.q_euler[0, 0], quaternion_of_rpy(turns * [1.0, 1.0, 0.0])),
    )
    sent_rpy = truth.apply(attitude.rpy_from_quaternion(q_nb), "rpy")
    sent_q = truth.apply(q_nb, "quaternion")
    seen = quaternion_of_rpy(other.undone(sent_rpy, "rpy")), other.undone(sent_q, "quaternion")
    return np.asarray(np.degrees(attitude.angle_between(*seen)))


# --- what the unexplained looks like ---------------------------------------------------------------------------------


def shape(pairing: Pairing, found: Comparison) -> str:
    """How the disagreement as sent goes with time, attitude and rate."""
    t_s, w = pairing.t_s, np.linalg.norm(pairing.rates(), axis=1)
    residual, bound = found.residual_rad[0], found.bound_rad[0]
    delta = attitude.multiply(found.q_quaternion[0], attitude.conjugate(found.q_euler[0]))
    rotvec_deg = np.degrees(attitude.rotvec_from_quaternion(delta))
    known = np.isfinite(residual) & np.isfinite(bound) & np.isfinite(w)
    t_s, w, residual, rotvec_deg = t_s[known], w[known], np.degrees(residual[known]), rotvec_deg[known]
    steep = np.abs(np.degrees(attitude.rpy_from_quaternion(found.q_quaternion[0])[known, 1])) > 75.0
    if len(t_s) < 5 or t_s[-1] - t_s[0] < 1.0:
        return "too short to say how it goes"
    middle = float(np.median(residual))
    if np.quantile(np.abs(residual - middle), 0.9) < 0.1 * middle:
        return f"constant in size, {middle:.3g}°, about an axis that changes" if _wanders(rotvec_deg) else "constant"
    rate_deg_min = _drift_deg_min(t_s, rotvec_deg)
    if rate_deg_min is not None:
        return f"drifting by {rate_deg_min:.3g}° a minute"
    if steep.any() and not steep.all() and np.median(residual[steep]) > 5.0 * np.median(residual[~steep]):
        return "near the poles, beyond 75° of pitch"
    fast = w > np.quantile(w, 0.75)
    slow = w < np.quantile(w, 0.25)
    both = fast.any() and slow.any() and math.degrees(float(np.ptp(w))) > 5.0
    if both and np.median(residual[fast]) > 4.0 * np.median(residual[slow]):
        return "in turns, growing with the rate"
    return "irregular"


def _wanders(rotvec_deg: Floats) -> bool:
    size = np.linalg.norm(rotvec_deg, axis=1)
    return bool(np.linalg.norm(rotvec_deg.mean(axis=0)) < 0.9 * size.mean())


def _drift_deg_min(t_s: Floats, rotvec_deg: Floats) -> float | None:
    """The rate of a disagreement that goes linearly with time, deg/min; None: it does not."""
    t = t_s - t_s.mean()
    centred = rotvec_deg - rotvec_deg.mean(axis=0)
    slope = (t[:, None] * centred).sum(axis=0) / (t * t).sum()
    left = np.square(centred - t[:, None] * slope).sum()
    if left > 0.1 * np.square(centred).sum():
        return None
    return float(60.0 * np.linalg.norm(slope))
