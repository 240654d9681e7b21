"""The numbers behind a disagreement: a constant turn of the world or of the body, and a lag."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, Mask
from gcs_bridge.diagnosis.hypotheses import TRIMS, Hypothesis
from gcs_bridge.diagnosis.window import QUATERNION, Comparison, Pairing, set_back
from gcs_bridge.settings import AlignmentSettings

MAX_SKEW_S = 0.6
_SKEW_STEP_S = 0.02
_REWEIGHTED, _REFINED = 2, 4  # times; it stands still sooner where there is one lag
_TRIM_STEPS, _TRIM_STEP_DEG, _TRIM_SLOPE_DEG = 3, 5.0, 1e-4  # steps of either kind; of a number at a time
_TRIM_LEAVES_RAD = np.radians(2.0)  # after the first steps, where it may explain
_NOISE_RAD = np.radians(0.05)  # of a pair at one instant, for the weights


def scale_rad(bound_rad: Floats) -> Floats:
    """How far a pair may be off under the right hypothesis, rad: what a residual is measured by."""
    return np.asarray(_NOISE_RAD + 3.0 * bound_rad)


# --- constant turns --------------------------------------------------------------------------------------------------


class ConstantRotation(NamedTuple):
    """A kind of constant turn: the mistake's name, of body or world axes, about any of them (0) or x, y, z (1…3)."""

    name: str
    of_body: bool
    about: int


YAW = ConstantRotation("yaw_offset", of_body=False, about=3)
MOUNT_ABOUT_ONE = tuple(ConstantRotation("mount_offset", of_body=True, about=axis) for axis in (1, 2, 3))
MOUNT = ConstantRotation("mount_offset", of_body=True, about=0)
WORLD = ConstantRotation("world_offset", of_body=False, about=0)


def turned(pairing: Pairing, bases: Sequence[Hypothesis], turns: Sequence[ConstantRotation]) -> list[Hypothesis]:
    """Each base with each turn that explains its rest best, one base after the other."""
    found = pairing.compare(bases)
    of_body, of_world = _deltas(found)
    plain = _weights(found)
    best = [_fitted_deg(of_body if turn.of_body else of_world, plain, turn.about) for turn in turns]
    if pairing.slower != QUATERNION and not pairing.same.all():
        # An interpolated quaternion is turned back before it is interpolated: what the first fit missed shows then.
        for i, turn in enumerate(turns):
            if turn.of_body:
                undone = [base.and_then(turn.name, *v) for base, v in zip(bases, best[i], strict=True)]
                again = pairing.compare(undone)
                rest = _fitted_deg(_deltas(again)[0], _weights(again), turn.about)
                best[i] = _composed_deg(rest, best[i])
    return [
        base.and_then(turn.name, *(v[row, 2:] if turn is YAW else v[row]).tolist())
        for row, base in enumerate(bases)
        for turn, v in zip(turns, best, strict=True)
    ]


def trimmed(pairing: Pairing, bases: Sequence[Hypothesis], trim: str) -> list[Hypothesis]:
    """The bases that may explain with that trim, all numbers but a lag fitted together, the trim from either sign."""
    allowed = TRIMS[trim].parameter
    starts = [(*(0.0,) * (allowed.count - 1), sign) for sign in (1.0, -1.0)]  # at zero, AHRS_TRIM_X shows nothing
    found = [base.and_then(trim, *start) for base in bases for start in starts]
    for _ in range(_TRIM_STEPS if found else 0):
        found, left_rad = _stepped(pairing, found, robust=False)
    if found:
        better = np.argmin(left_rad.reshape(-1, len(starts)), axis=1) + len(starts) * np.arange(len(bases))
        found = [found[place] for place in better.tolist() if left_rad[place] < _TRIM_LEAVES_RAD]
    for _ in range(_TRIM_STEPS if found else 0):
        found, _ = _stepped(pairing, found, robust=True)
    return [one for one in found if max(map(abs, one.mistakes[-1][1])) <= allowed.most]


def _stepped(pairing: Pairing, hypotheses: Sequence[Hypothesis], *, robust: bool) -> tuple[list[Hypothesis], Floats]:
    """One step of Gauss and Newton for the numbers of each hypothesis; beside it what each had left, a mean, rad."""
    nearby = [_nearby(hypothesis) for hypothesis in hypotheses]
    every = pairing.compare([one for around in nearby for one in around])
    # Pairs of which something is unknown have no weight, and no numbers.
    rotvec, weight = np.nan_to_num(attitude.rotvec_from_quaternion(_deltas(every)[0])), _weights(every)
    counts = np.array([len(around) for around in nearby])
    first = np.cumsum(counts) - counts
    number = np.arange(1, counts.max())
    beside = first[:, None] + np.where(number < counts[:, None], number, 0)  # a number too many has no slope
    now, weight = rotvec[first], weight[first]
    slopes = ((rotvec[beside] - now[:, None]) / _TRIM_SLOPE_DEG).reshape(*beside.shape, -1)
    size2 = np.square(now).sum(axis=-1)
    left_rad = np.sqrt((weight * size2).sum(axis=-1) / np.maximum(weight.sum(axis=-1), 1e-30))
    if robust:
        weight = weight / (1.0 + size2 * weight)
    weighted = slopes * np.repeat(weight, 3, axis=-1)[:, None]
    inverse = np.linalg.pinv(weighted @ np.swapaxes(slopes, 1, 2), rcond=1e-9, hermitian=True)
    step_deg = -(inverse @ (weighted @ now.reshape(len(now), -1, 1)))[..., 0]
    step_deg = np.clip(step_deg, -_TRIM_STEP_DEG, _TRIM_STEP_DEG)
    return [one.moved(step[: one.free]) for one, step in zip(hypotheses, step_deg.tolist(), strict=True)], left_rad


def _nearby(hypothesis: Hypothesis) -> list[Hypothesis]:
    """The hypothesis, and the same with each of its numbers a little larger."""
    steps = np.vstack((np.zeros(hypothesis.free), _TRIM_SLOPE_DEG * np.eye(hypothesis.free)))
    return [hypothesis.moved(step) for step in steps.tolist()]


def _deltas(found: Comparison) -> tuple[Floats, Floats]:
    """The quaternion seen from the angles, in body and in world axes (m, k, 4); zeros where one is unknown."""
    forth, back = found.q_quaternion, attitude.conjugate(found.q_euler)
    of_body, of_world = attitude.multiply(back, forth), attitude.multiply(forth, back)
    return np.nan_to_num(of_body), np.nan_to_num(of_world)


def _weights(found: Comparison) -> Floats:
    known = np.isfinite(found.residual_rad) & np.isfinite(found.bound_rad)
    return np.where(known, 1.0 / np.square(scale_rad(np.where(known, found.bound_rad, 0.0))), 0.0)


def _fitted_deg(delta: Floats, plain: Floats, about: int) -> Floats:
    """The turns (m, 3), deg, that are the mean of (m, k, 4) by weights (m, k), from which outliers lose theirs."""
    weight = plain
    for _ in range(_REWEIGHTED):
        mean = _mean(delta, weight, about)
        cosine = np.abs((delta * mean[:, None, :]).sum(axis=-1))
        off2 = 8.0 * np.maximum(1.0 - cosine, 0.0)  # the square of the angle between, near enough for a weight
        weight = plain / (1.0 + off2 * plain)
    return np.asarray(np.degrees(attitude.rotvec_from_quaternion(_mean(delta, weight, about))))


def _mean(delta: Floats, weight: Floats, about: int) -> Floats:
    """The mean (m, 4) of turns (m, k, 4), about any axis (0) or about x, y, z (1, 2, 3) alone (M19)."""
    moments = np.swapaxes(delta * weight[..., None], 1, 2) @ delta
    if about == 0:
        return np.asarray(np.linalg.eigh(moments)[1][:, :, -1])
    half = 0.5 * np.arctan2(2.0 * moments[:, 0, about], moments[:, 0, 0] - moments[:, about, about])
    mean = np.zeros((len(half), 4))
    mean[:, 0], mean[:, about] = np.cos(half), np.sin(half)
    return mean


def _composed_deg(first: Floats, second: Floats) -> Floats:
    """Rotation vectors (m, 3), deg: first ⊗ second."""
    a, b = (attitude.quaternion_from_rotvec(np.radians(v)) for v in (first, second))
    return np.asarray(np.degrees(attitude.rotvec_from_quaternion(attitude.multiply(a, b))))


# --- lag -------------------------------------------------------------------------------------------------------------


def _skews() -> Floats:
    """Where the search begins: in a step the fastest acro turns by 10°, which the refinement still finds back."""
    return np.arange(-MAX_SKEW_S, MAX_SKEW_S + 0.5 * _SKEW_STEP_S, _SKEW_STEP_S)


def skew_by_rates(pairing: Pairing) -> float | None:
    """By how much the quaternion's stamps are late, s, as the two messages' body rates tell, which no mistake turns."""
    slow, fast = pairing.streams[pairing.slower], pairing.streams[1 - pairing.slower]
    own = slow.w_b_rad_s[pairing.sample]
    sign = -1.0 if pairing.slower == QUATERNION else 1.0

    def off(skews_s: Floats) -> tuple[Floats, Mask]:
        """The differences of the rates (n, k, 3) for skews (n,), and where there are any (n, k)."""
        at = pairing.t_s + sign * skews_s[:, None]
        there = np.stack([np.interp(at, fast.t_s, fast.w_b_rad_s[:, axis]) for axis in range(3)], axis=-1)
        inside = (at >= fast.t_s[0]) & (at <= fast.t_s[-1]) & np.isfinite(there - own).all(axis=-1)
        return there - own, np.asarray(inside)

    skews_s = _skews()
    differ, inside = off(skews_s)
    count = inside.sum(axis=1)
    mean = np.where(inside, np.sqrt(np.square(differ).sum(axis=-1)), 0.0).sum(axis=1) / np.maximum(count, 1)
    usable = count >= max(3, len(pairing) // 3)
    if not usable.any() or float(mean[usable].max()) == 0.0:
        return None
    skew_s = float(skews_s[np.argmin(np.where(usable, mean, np.inf))])
    for _ in range(4):  # regression on the change of rate, over a step to both sides
        differ, inside = off(np.array([skew_s - 0.5 * _SKEW_STEP_S, skew_s, skew_s + 0.5 * _SKEW_STEP_S]))
        slope = np.where(np.all(inside, axis=0)[:, None], (differ[2] - differ[0]) / _SKEW_STEP_S, 0.0)
        power = float(np.square(slope).sum())
        step_s = -float((slope * np.nan_to_num(differ[1])).sum()) / power if power else 0.0
        skew_s += float(np.clip(step_s, -_SKEW_STEP_S, _SKEW_STEP_S))
    return float(np.clip(skew_s, -MAX_SKEW_S, MAX_SKEW_S))


def skew_by_attitude(pairing: Pairing, alignment: AlignmentSettings, base: Hypothesis) -> float:
    """The same, s, as the attitudes under `base` tell: the best of a search, not yet refined."""
    skews = _skews()
    shifted, which = set_back(pairing, skews, alignment)
    off = np.nan_to_num(shifted.compare([base]).residual_rad[0], nan=np.pi)
    count = np.bincount(which, minlength=len(skews))
    mean = np.bincount(which, weights=off, minlength=len(skews)) / np.maximum(count, 1)
    mean[count < max(3, len(pairing) // 3)] = np.inf
    return float(skews[int(np.argmin(mean))])


def refined_skew(pairing: Pairing, alignment: AlignmentSettings, base: Hypothesis, skew_s: float) -> float:
    """A skew brought nearer by regression of what is left on the rates, until it stands still."""
    for _ in range(_REFINED):
        shifted, _ = set_back(pairing, np.array([skew_s]), alignment)
        if len(shifted) < 3:
            return skew_s
        found = shifted.compare([base])
        delta = attitude.multiply(attitude.conjugate(found.q_euler[0]), found.q_quaternion[0])
        rho, w = attitude.rotvec_from_quaternion(delta), shifted.rates()
        scale = scale_rad(found.bound_rad[0])
        off = np.sqrt(np.square(rho).sum(axis=1)) / scale
        weight = 1.0 / (np.square(scale) * (1.0 + np.square(off / max(float(np.nanmedian(off)), 1.0))))
        good = np.isfinite(weight) & np.isfinite(w).all(axis=1)
        moved = float((weight[:, None] * w * rho)[good].sum())
        power = float((weight[:, None] * w * w)[good].sum())
        if power == 0.0:
            return skew_s
        step_s = -moved / power
        skew_s = float(np.clip(skew_s + np.clip(step_s, -_SKEW_STEP_S, _SKEW_STEP_S), -MAX_SKEW_S, MAX_SKEW_S))
        if abs(step_s) < 2e-5:
            break
    return skew_s
