"""What the firmware may have done, fitted to pairs of neighbouring instants, each weighted by its bound.

A fit must leave what such pairs leave on healthy flights, and no more. Whether the motion has told it from a mistake of
the same shape is asked by what that mistake, with its own best numbers, would leave of the same pairs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats
from gcs_bridge.expected.between import BetweenPairs
from gcs_bridge.expected.correction import Correction
from gcs_bridge.expected.pairs import MOST_TRIM_RAD, pitch_axis

MOST_PITCH_RAD = math.radians(15.0)  # a larger one is not fitted
_P90, _P97 = 0.5, 1.0  # of what is left, in noises and bounds: with a right fit less than half of either
LEAVES_IN_HOVER = 3.0  # tailsitters hover in oscillations that are faster than their samples: up to the bounds
_LEAST, _LEAST_TRIMS = 4, 6  # pairs for one number, and for two
_SURE_RAD, _SURE_VIEW_RAD = math.radians(0.3), math.radians(2.0)  # a number that is known no better is none yet
_APART, _APART_LEAST = 3.0, 0.3  # a mistake must leave so many times more, and more than this: root mean squares
_PRIOR_RAD = math.radians(10.0)  # what trims are like: AHRS_TRIM_X hardly shows, and stays near 0 until it does
_STEP_RAD = 1e-6  # for slopes
_STEPS = 5


class Fitted(NamedTuple):
    """A correction, how well it is known, and which mistakes the pairs could still be instead of it.

    `information`: the inverse of the covariance of (pitch or view, AHRS_TRIM_X, AHRS_TRIM_Y), rad, (3, 3).
    """

    correction: Correction
    information: Floats
    like_mount: bool
    like_sign: bool = False

    def moves(self, other: Correction) -> float:
        """How far the other correction is from this one, in standard deviations."""
        of = [
            np.array([one.pitch_rad + one.view_rad, one.trim_x_rad, one.trim_y_rad]) for one in (other, self.correction)
        ]
        by = of[0] - of[1]
        return math.sqrt(float(by @ self.information @ by))


def fit_pitch(pairs: BetweenPairs, base: Correction, noise_rad: float) -> Fitted | None:
    """A pitch trim beside `base`; None unless the pairs say it."""
    if len(pairs) < _LEAST:
        return None
    scale = pairs.scale(noise_rad)
    axis = pitch_axis(pairs, base)
    turn = (pairs.apart(base) * axis).sum(axis=1)
    pitch_rad = _mean_known(turn, scale)
    if pitch_rad is None or abs(pitch_rad) > MOST_PITCH_RAD:
        return None
    correction = base._replace(pitch_rad=pitch_rad)
    if not explains(pairs, correction, noise_rad):
        return None
    left = pairs.residual(correction) / scale
    mount = _off_mean(pairs.apart(base), scale, about_y=True)
    mirrored = pairs.rpy_rad * (1.0, -1.0, 1.0)
    sign = attitude.angle_between(base.undo(mirrored), pairs.q_nb) / scale
    return Fitted(correction, _known(scale), not _worse(mount, left), not _worse(sign, left))


def fit_view(pairs: BetweenPairs, noise_rad: float) -> Fitted | None:
    """A view: the angle about the body's y axis; None unless the pairs say one."""
    if len(pairs) < _LEAST:
        return None
    view_rad = _mean_known(pairs.apart(Correction())[:, 1], pairs.scale(noise_rad), _SURE_VIEW_RAD)
    if view_rad is None or not explains(pairs, Correction(view_rad=view_rad), noise_rad, leaves=LEAVES_IN_HOVER):
        return None
    return Fitted(Correction(view_rad=view_rad), _known(pairs.scale(noise_rad)), like_mount=True)


def fit_trims(pairs: BetweenPairs, since: int, start: Correction, noise_rad: float) -> tuple[Fitted | None, bool]:
    """AHRS_TRIM beside the pitch trim of `start`, from where it begins; None unless the pairs say it.

    Any turn, of the body or of the world, may have come up at pair `since`: it must fail on the pairs from there on.
    Beside it whether the pairs deny every such trim.
    """
    if len(pairs) < _LEAST_TRIMS:
        return None, False
    scale = pairs.scale(noise_rad)
    correction, information = _trims(pairs, start, 1.0 / np.square(scale))
    if not explains(pairs, correction, noise_rad) or not explains(pairs[since:], correction, noise_rad):
        return None, True
    late, scale = pairs[since:], scale[since:]
    if len(late) < _LEAST:
        return None, False
    left, of_body = late.residual(correction) / scale, late.apart(Correction(start.pitch_rad))
    of_world = attitude.rotate(late.q_nb, of_body)
    if not all(_worse(_off_mean(turn, scale), left) for turn in (of_body, of_world)):
        return None, False
    return Fitted(correction, information, like_mount=False), False


def refit_trims(pairs: BetweenPairs, start: Correction, noise_rad: float) -> Fitted | None:
    """AHRS_TRIM that was fitted before, by more pairs."""
    if len(pairs) < _LEAST_TRIMS:
        return None
    correction, information = _trims(pairs, start, 1.0 / np.square(pairs.scale(noise_rad)))
    return Fitted(correction, information, like_mount=False) if explains(pairs, correction, noise_rad) else None


def explains(pairs: BetweenPairs, correction: Correction, noise_rad: float, *, leaves: float = 1.0) -> bool:
    """Whether a correction leaves what pairs leave in which nothing differs; `leaves`: or so many times that."""
    if not len(pairs):
        return True
    left = np.sort(pairs.residual(correction) / pairs.scale(noise_rad))
    last = len(left) - 1
    return bool(left[math.floor(0.9 * last)] <= leaves * _P90 and left[math.floor(0.97 * last)] <= leaves * _P97)


def _trims(pairs: BetweenPairs, start: Correction, weight: Floats) -> tuple[Correction, Floats]:
    """The two numbers by Gauss and Newton, from a linear start where there is none yet, and how well they are known."""
    pitch_rad, trims = start.pitch_rad, np.array([start.trim_x_rad, start.trim_y_rad])
    prior = np.eye(2) / _PRIOR_RAD**2
    if not trims.any():
        # At the roll φ, about y and z: τy (cos φ − 1, −sin φ) + τy τx/2 (0, −1).
        rotvec, roll = pairs.apart(Correction(pitch_rad)), pairs.rpy_rad[:, 0]
        of_y = np.concatenate((np.cos(roll) - 1.0, -np.sin(roll)))
        of_product = np.concatenate((np.zeros(len(roll)), -np.ones(len(roll))))
        columns, seen = np.stack((of_y, of_product)), np.concatenate((rotvec[:, 1], rotvec[:, 2]))
        weighted = columns * np.concatenate((weight, weight))
        normal = _products(weighted, columns) + prior * [[1.0, 0.0], [0.0, 400.0]]
        trim_y, product = np.linalg.solve(normal, _products(weighted, seen[None])[:, 0])
        trims = np.array([2.0 * product / trim_y if abs(trim_y) > 1e-3 else 0.0, trim_y or 1e-3])
    weights = np.repeat(weight, 3)
    for _ in range(_STEPS):
        trims = np.clip(trims, -MOST_TRIM_RAD, MOST_TRIM_RAD)
        at = pairs.apart(Correction(pitch_rad, *trims.tolist())).ravel()
        nearby = (trims + step for step in _STEP_RAD * np.eye(2))
        slopes = np.stack(
            [(pairs.apart(Correction(pitch_rad, *one.tolist())).ravel() - at) / _STEP_RAD for one in nearby]
        )
        weighted = slopes * weights
        normal = _products(weighted, slopes) + prior
        trims = trims - np.linalg.solve(normal, _products(weighted, at[None])[:, 0] + prior.diagonal() * trims)
    x, y = np.clip(trims, -MOST_TRIM_RAD, MOST_TRIM_RAD).tolist()
    information = np.zeros((3, 3))
    information[1:, 1:] = normal
    return Correction(pitch_rad, x, y), information


def _products(one: Floats, other: Floats) -> Floats:
    """The sums of products of rows (m, n) and (k, n): (m, k), the same however the arrays lie in memory."""
    return np.asarray((one[:, None] * other[None]).sum(axis=2))


def _known(scale: Floats) -> Floats:
    """The information of one number, the first, from turns with these scales (n,)."""
    return np.diag([float((1.0 / np.square(scale)).sum()), 0.0, 0.0])


def _mean_known(turn: Floats, scale: Floats, sure_rad: float = _SURE_RAD) -> float | None:
    """The mean of turns (n,), rad, by weights; None while it is not known well enough."""
    weight = 1.0 / np.square(scale)
    total = float(weight.sum())
    return float((weight * turn).sum()) / total if total * sure_rad**2 >= 1.0 else None


def _off_mean(turn: Floats, scale: Floats, *, about_y: bool = False) -> Floats:
    """How far turns (n, 3), rad, are from their mean by weights, or from the part about y alone, in scales (n,)."""
    weight = 1.0 / np.square(scale)
    mean = (turn * weight[:, None]).sum(axis=0) / weight.sum()
    if about_y:
        mean = mean * (0.0, 1.0, 0.0)
    return np.asarray(np.sqrt(np.square(turn - mean).sum(axis=1)) / scale)


def _worse(other: Floats, left: Floats) -> bool:
    """Whether another explanation leaves clearly more than the fit, but for the worst pairs of both."""
    kept = len(left) - max(1, len(left) // 10)
    root_mean_square = [math.sqrt(float(np.square(np.sort(of)[:kept]).mean())) for of in (other, left)]
    return root_mean_square[0] > max(_APART * root_mean_square[1], _APART_LEAST)
