"""Samples of both streams, the clean pairs of one instant among them, and fits to such pairs.

Equal instants agree to 1.6e-5° on simulated aircraft and to 4e-5° on real ones, once the differences are undone and
away from the poles, where float32 angles lose digits: a noise so small that a fit to it has no room for a fault.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, last_where, record, running_max
from gcs_bridge.expected.correction import Correction
from gcs_bridge.pairing.instants import Stamps, same_instants
from gcs_bridge.telemetry.samples import AttitudeSamples

NOISE_RAD = math.radians(1e-4)
VIEW_NOISE_RAD = math.radians(0.05)  # hovering, AHRS_TRIM turns view and quaternion by two formulas: 0.035° at 2°
TOLD_APART = 5.0  # noises by which an alternative must fail before it is ruled out
IN_A_ROW = 3  # pairs that must fit, or deny
BANK_RAD = math.radians(5.0)  # what shows less than the noise here shows nowhere
RECENT = 32  # pairs kept for fitting,
SPARSE_US = 1_000_000  # and one pair a second, as many, for what changes slowly

SECOND_ORDER = 0.2  # of what AHRS_TRIM does, at 10°
TRIM_PAIRS = 4  # two numbers want more
MOST_TRIM_RAD = math.radians(10.0)  # the firmware's own limit
_ALIKE = 1e12  # condition number of two columns that say the same
_STEP_RAD = 1e-6  # for slopes
STEEP_RAD = math.radians(80.0)  # pairs beyond this pitch of ATTITUDE are not clean
TAIL = 256  # samples of each stream that can still find their partner


@record
class _Rows(FrameColumns):
    t_us: Int64s  # since boot


@record
class EulerRows(_Rows):
    """Samples of ATTITUDE."""

    rpy_rad: Floats  # (n, 3) as sent
    w_b_rad_s: Floats  # (n, 3)
    view: npt.NDArray[np.int8]  # (n,) FORWARD or HOVER
    free: Mask  # (n,) the view may change here


@record
class QuaternionRows(_Rows):
    """Samples of ATTITUDE_QUATERNION."""

    q_nb: Floats  # (n, 4) as sent
    w_b_rad_s: Floats  # (n, 3)


@record
class CleanPairs(_Rows):
    """Clean pairs of one instant, in the order in which they were completed, by the frame `frame_index`."""

    rpy_rad: Floats  # (n, 3) as sent
    q_nb: Floats  # (n, 4) as sent
    free: Mask  # (n,) the view may change here

    def apart(self, correction: Correction) -> Floats:
        """The rotation vectors (n, 3), rad, from the corrected Euler angles to the quaternion."""
        q_euler = correction.undo(self.rpy_rad)
        return attitude.rotvec_from_quaternion(attitude.multiply(attitude.conjugate(q_euler), self.q_nb))

    def residual(self, correction: Correction) -> Floats:
        """The angles (n,) between the two, rad."""
        return attitude.angle_between(correction.undo(self.rpy_rad), self.q_nb)


_INTS, _MASK = np.empty(0, np.int64), np.empty(0, np.bool_)
NO_EULER = EulerRows(
    frame_index=_INTS,
    t_us=_INTS,
    rpy_rad=np.empty((0, 3)),
    w_b_rad_s=np.empty((0, 3)),
    view=np.empty(0, np.int8),
    free=_MASK,
)
NO_QUATERNION = QuaternionRows(frame_index=_INTS, t_us=_INTS, q_nb=np.empty((0, 4)), w_b_rad_s=np.empty((0, 3)))
NO_CLEAN_PAIRS = CleanPairs(frame_index=_INTS, t_us=_INTS, rpy_rad=np.empty((0, 3)), q_nb=np.empty((0, 4)), free=_MASK)


def in_order(samples: AttitudeSamples, before: EulerRows | QuaternionRows) -> Mask:
    """Which samples (n,) are valid and later than all valid ones before them."""
    latest = int(before.t_us[-1]) if len(before) else -1
    t_us = np.where(samples.valid, samples.t_boot_us, -1)
    return t_us > running_max(t_us, latest)[:-1]


def match(euler: EulerRows, quaternion: QuaternionRows, after: int) -> tuple[CleanPairs, npt.NDArray[np.int8]]:
    """The clean pairs of one instant that were completed after the frame `after`, and the view of each."""
    if not len(euler) or not len(quaternion):
        return NO_CLEAN_PAIRS, NO_EULER.view
    a, b = (Stamps(of.frame_index, of.t_us) for of in (euler, quaternion))
    i, j = same_instants(a, b, after, TAIL)
    clean = np.abs(euler.rpy_rad[i, 1]) <= STEEP_RAD
    i, j = i[clean], j[clean]
    pairs = CleanPairs(
        frame_index=np.maximum(euler.frame_index[i], quaternion.frame_index[j]),
        t_us=euler.t_us[i],
        rpy_rad=euler.rpy_rad[i],
        q_nb=quaternion.q_nb[j],
        free=euler.free[i],
    )
    return pairs, euler.view[i]


def run_lengths(mask: Mask, before: int) -> Int64s:
    """For each place, how many in a row are true up to it; `before` were true before the first."""
    place, last_false = np.arange(len(mask)), last_where(~mask)
    return np.where(mask, place - last_false + np.where(last_false < 0, before, 0), 0)


def in_a_row(mask: Mask) -> Mask:
    """Where it is true of three in a row, up to that place."""
    return run_lengths(mask, 0) >= IN_A_ROW


def turn_about(rotvec: Floats, axis: Floats, noise_rad: float) -> tuple[Floats, Mask]:
    """Turns (n,) about unit axes (n, 3), and where that is the whole rotation, and the same for three in a row."""
    turn = rotvec[:, 0] * axis[:, 0] + rotvec[:, 1] * axis[:, 1] + rotvec[:, 2] * axis[:, 2]
    beside = rotvec - turn[:, None] * axis
    whole = beside[:, 0] ** 2 + beside[:, 1] ** 2 + beside[:, 2] ** 2 <= noise_rad**2
    same = np.zeros(len(turn), np.bool_)
    same[2:] = (np.abs(turn[2:] - turn[1:-1]) <= noise_rad) & (np.abs(turn[2:] - turn[:-2]) <= noise_rad)
    return turn, in_a_row(whole) & same


def pitch_axis(pairs: CleanPairs, base: Correction) -> Floats:
    """The body axes (n, 3) about which a pitch trim turns the attitude, if `base` is undone already."""
    roll = pairs.rpy_rad[:, 0] + base.trim_x_rad
    level_right = np.column_stack((np.zeros(len(roll)), np.cos(roll), -np.sin(roll)))
    if not (base.trim_x_rad or base.trim_y_rad):
        return level_right
    return attitude.rotate(attitude.quaternion_from_rotvec((base.trim_x_rad, base.trim_y_rad, 0.0)), level_right)


def like_mount(pairs: CleanPairs, pitch_rad: float | Floats) -> Mask:
    """Pairs (n,) in which a mount offset about the body's y axis would show the same as a pitch trim: no bank."""
    return np.asarray(np.abs(pitch_rad * np.sin(pairs.rpy_rad[:, 0])) <= TOLD_APART * NOISE_RAD)


def like_sign(pairs: CleanPairs, pitch_rad: float) -> Mask:
    """Pairs (n,) in which a wrong sign of pitch would show the same as a pitch trim."""
    return np.asarray(np.abs(pitch_rad + 2.0 * pairs.rpy_rad[:, 1]) <= TOLD_APART * NOISE_RAD)


def fit_trims(pairs: CleanPairs, rotvec: Floats, pitch_rad: float) -> Correction | None:
    """Fit TRIM_X and TRIM_Y (τx, τy), beside a pitch trim that was told; None unless all pairs say it.

    `rotvec` (n, 3) is what is left of the pairs without them. To first order in τy it is, at the roll φ and about the
    body's y and z axes, τy (cos φ − 1, −sin φ) + τy τx/2 (0, −1): linear, and a start for Gauss and Newton. A pitch
    trim is never fitted beside them: with p = −τy it would be a mount offset about y, whatever the motion.
    """
    if len(rotvec) < TRIM_PAIRS or np.ptp(rotvec, axis=0).max() < 2.0 * TOLD_APART * NOISE_RAD:
        return None  # two numbers can make any constant about y and z
    cos, sin = np.cos(pairs.rpy_rad[:, 0]), np.sin(pairs.rpy_rad[:, 0])
    none = np.zeros(len(cos))
    columns = [np.concatenate((cos - 1.0, -sin)), np.concatenate((none, none - 1.0))]
    seen = np.concatenate((rotvec[:, 1], rotvec[:, 2]))
    solved = _least_squares(columns, seen)
    if solved is None or solved[0] == 0.0:
        return None
    trim_y, product = solved
    missed = np.abs(seen - trim_y * columns[0] - product * columns[1]).max()
    if missed > SECOND_ORDER * np.abs(rotvec).max() + NOISE_RAD:
        return None
    trims = [2.0 * product / trim_y, trim_y]
    for _ in range(4):
        if max(map(abs, trims)) > 1.5 * MOST_TRIM_RAD:
            return None
        at = pairs.apart(Correction(pitch_rad, *trims)).ravel()
        nearby = (Correction(pitch_rad, trims[0] + x, trims[1] + y) for x, y in ((_STEP_RAD, 0.0), (0.0, _STEP_RAD)))
        solved = _least_squares([(pairs.apart(one).ravel() - at) / _STEP_RAD for one in nearby], at)
        if solved is None:
            return None
        trims = [trim - change for trim, change in zip(trims, solved, strict=True)]
    fitted = Correction(pitch_rad, *trims)
    return fitted if max(map(abs, trims)) <= MOST_TRIM_RAD and pairs.residual(fitted).max() <= NOISE_RAD else None


def _least_squares(columns: list[Floats], seen: Floats) -> list[float] | None:
    """The numbers by which the columns make what was seen; None where the columns are too much alike to tell."""
    normal = np.array([[float((a * b).sum()) for b in columns] for a in columns])
    scale = np.sqrt(np.diag(normal))
    if scale.min() <= 0.0 or np.linalg.cond(normal / np.outer(scale, scale)) > _ALIKE:
        return None
    solution: list[float] = np.linalg.solve(normal, [float((a * seen).sum()) for a in columns]).tolist()
    return solution
