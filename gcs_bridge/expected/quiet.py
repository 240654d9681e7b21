"""Passes the samples that teach a view nothing, in one compiled loop: as long as the pairs agree with what is undone.

What disagrees, or makes something known for the first time, is looked at by `view` and `vehicle`, where the rules are.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.attitude.compiled import ray_at, unit_at, vector_of
from gcs_bridge.attitude.euler import quaternion_of_rpy
from gcs_bridge.attitude.quaternion import angle_of, conjugated, exponential, product
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, Records
from gcs_bridge.expected.between import (
    LONGEST_US,
    RARE_US,
    TELLS_RAD,
    BetweenPairs,
    between_of,
)
from gcs_bridge.expected.between_memory import KEPT
from gcs_bridge.expected.pairs import (
    BANK_RAD,
    IN_A_ROW,
    NOISE_RAD,
    RECENT,
    SPARSE_US,
    STEEP_RAD,
    TAIL,
    TOLD_APART,
    CleanPairs,
    EulerRows,
    QuaternionRows,
)
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.instants import at_instant
from gcs_bridge.pairing.state import UNKNOWN


class Expectation(NamedTuple):
    """What a view expects of the pairs, and what would be news to it."""

    pitch_rad: float  # the correction that is undone
    trim_x_rad: float
    trim_y_rad: float
    view_rad: float
    limit_rad: float  # above which a pair denies it
    settled: bool
    wants_bank: bool  # a pair in a bank would be news
    fitted: bool
    noise_between_rad: float  # of pairs of neighbouring instants, beside their bound
    counts_between: bool  # that any come would be news
    refine_us: int  # and from when on a fit is to be made anew


LEARNT = np.dtype(
    [
        ("agreements", "i8"),  # pairs in a row that agree
        ("between_agreements", "i8"),  # the same of neighbouring instants
        ("is_banked", "?"),  # both forms agreed in a bank: there is no AHRS_TRIM that shows
        ("is_confirmed", "?"),  # some pairs agreed with the correction
        ("like_mount", "?"),  # so far a fitted pitch trim may be a mount offset
        ("like_sign", "?"),  # or a wrong sign
        ("lowest_rad", "f8"),  # pitch that confirmed a fit
        ("highest_rad", "f8"),
    ]
)
"""What pairs that are no news teach a view on the way."""


class Rows(NamedTuple):
    """The last rows of a stream: rings by position, whose room is a power of two."""

    held: Int64s  # (1,) how many there were
    frame_index: Int64s  # (room,)
    t_us: Int64s
    numbers: FloatRows  # (room, 8)


class Tails(NamedTuple):
    """What is remembered: the last samples of both streams in order, the last pairs, and one pair a second."""

    euler: Rows  # roll, pitch, yaw, body rates
    quaternion: Rows  # w, x, y, z, body rates
    recent: Rows  # roll, pitch, yaw, w, x, y, z
    sparse: Rows
    between: Rows  # the same of pairs of neighbouring instants, and their bound
    sparse_between: Rows


class Samples(NamedTuple):
    """Samples (n,) of one stream as they came."""

    frame_index: Int64s
    t_us: Int64s
    numbers: FloatRows  # (n, 3) roll, pitch, yaw, or (n, 4) w, x, y, z, as sent
    w_b_rad_s: FloatRows
    valid: Mask


def new_tails() -> Tails:
    """With nothing in them."""
    return Tails(*(_new_rows(room) for room in (TAIL, TAIL, RECENT, RECENT, KEPT, KEPT)))


def _new_rows(room: int) -> Rows:
    return Rows(np.zeros(1, np.int64), np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros((room, 8)))


def _in_order(rows: Rows) -> tuple[Int64s, Int64s, Floats]:
    """Frames, times and numbers, the oldest first."""
    held, room = int(rows.held[0]), len(rows.t_us)
    at = np.arange(max(held - room, 0), held) % room
    return rows.frame_index[at], rows.t_us[at], rows.numbers[at]


def _fill(rows: Rows, frame_index: Int64s, t_us: Int64s, *numbers: Floats) -> None:
    n = len(t_us)
    rows.held[0] = n
    rows.frame_index[:n], rows.t_us[:n] = frame_index, t_us
    at = 0
    for columns in numbers:
        rows.numbers[:n, at : at + columns.shape[1]] = columns
        at += columns.shape[1]


def euler_rows(rows: Rows) -> EulerRows:
    """The last Euler samples of a vehicle with one view."""
    frame_index, t_us, numbers = _in_order(rows)
    n = len(t_us)
    return EulerRows(
        frame_index=frame_index,
        t_us=t_us,
        rpy_rad=np.ascontiguousarray(numbers[:, :3]),
        w_b_rad_s=numbers[:, 3:6].copy(),
        view=np.zeros(n, np.int8),
        free=np.zeros(n, np.bool_),
    )


def quaternion_rows(rows: Rows) -> QuaternionRows:
    """The last quaternions."""
    frame_index, t_us, numbers = _in_order(rows)
    return QuaternionRows(
        frame_index=frame_index, t_us=t_us, q_nb=numbers[:, :4].copy(), w_b_rad_s=numbers[:, 4:7].copy()
    )


def pair_rows(rows: Rows) -> CleanPairs:
    """The pairs that are kept."""
    frame_index, t_us, numbers = _in_order(rows)
    return CleanPairs(
        frame_index=frame_index,
        t_us=t_us,
        rpy_rad=numbers[:, :3].copy(),
        q_nb=numbers[:, 3:7].copy(),
        free=np.zeros(len(t_us), np.bool_),
    )


def between_rows(rows: Rows) -> BetweenPairs:
    """The pairs of neighbouring instants that are kept."""
    return BetweenPairs(**vars(pair_rows(rows)), bound_rad=_in_order(rows)[2][:, 7].copy())


def fill_tails(
    tails: Tails,
    euler: EulerRows,
    quaternion: QuaternionRows,
    pairs: tuple[CleanPairs, CleanPairs],
    between: tuple[BetweenPairs, BetweenPairs],
) -> None:
    """Remember these; of pairs the latest, and one a second."""
    _fill(tails.euler, euler.frame_index, euler.t_us, euler.rpy_rad, euler.w_b_rad_s)
    _fill(tails.quaternion, quaternion.frame_index, quaternion.t_us, quaternion.q_nb, quaternion.w_b_rad_s)
    for rows, of in zip((tails.recent, tails.sparse), pairs, strict=True):
        _fill(rows, of.frame_index, of.t_us, of.rpy_rad, of.q_nb)
    for rows, one in zip((tails.between, tails.sparse_between), between, strict=True):
        _fill(rows, one.frame_index, one.t_us, one.rpy_rad, one.q_nb, one.bound_rad[:, None])


@helper
def _latest_us(rows: Any) -> Any:
    """When the last row was; −1 where there is none."""
    return rows.t_us[(rows.held[0] - 1) % rows.t_us.size] if rows.held[0] else np.int64(-1)


@helper
def _at_instant(rows: Any, t_us: Any) -> Any:
    """The place of the row at a time; UNKNOWN: none."""
    room, held = rows.t_us.size, rows.held[0]
    position = at_instant(rows.t_us, room - 1, held, max(held - room, 0), t_us, 0)
    return position if position == UNKNOWN else position % room


@helper
def _next_place(rows: Any, frame_index: Any, t_us: Any) -> Any:
    """Begin a row behind the others; where it is."""
    at = rows.held[0] % rows.t_us.size
    rows.held[0] += 1
    rows.frame_index[at], rows.t_us[at] = frame_index, t_us
    return at


@helper
def _remember(rows: Any, samples: Any, i: Any, width: Any) -> Any:
    """Take sample `i`, whose own numbers are `width`."""
    at = _next_place(rows, samples.frame_index[i], samples.t_us[i])
    for column in range(width):
        rows.numbers[at, column] = samples.numbers[i, column]
    for axis in range(3):
        rows.numbers[at, width + axis] = samples.w_b_rad_s[i, axis]


@helper
def _remember_pair(rows: Any, frame_index: Any, t_us: Any, rpy: Any, r: Any, q: Any, i: Any) -> Any:
    """Take the pair of row `r` of `rpy` and row `i` of `q`."""
    at = _next_place(rows, frame_index, t_us)
    for axis in range(3):
        rows.numbers[at, axis] = rpy[r, axis]
    for axis in range(4):
        rows.numbers[at, 3 + axis] = q[i, axis]


@helper
def _undone(expected: Any, roll: Any, pitch: Any, yaw: Any) -> Any:
    """As `Correction.undo`."""
    if expected.trim_x_rad or expected.trim_y_rad or expected.pitch_rad:
        roll, pitch = roll + expected.trim_x_rad, pitch + (expected.trim_y_rad + expected.pitch_rad)
    q = quaternion_of_rpy(roll, pitch, yaw)
    if expected.trim_x_rad or expected.trim_y_rad:
        q = product(q, exponential(vector_of(-expected.trim_x_rad, -expected.trim_y_rad, 0.0)))
    if expected.view_rad:
        q = product(q, exponential(vector_of(0.0, expected.view_rad, 0.0)))
    return q


@helper
def _take_pair(
    expected: Any, tails: Any, learnt: Any, frame_index: Any, t_us: Any, rpy: Any, r: Any, q: Any, i: Any
) -> Any:
    """Learn from the pair of row `r` of `rpy` and row `i` of `q`; whether it was no news: else nothing is learnt."""
    roll, pitch = rpy[r, 0], rpy[r, 1]
    if abs(pitch) > STEEP_RAD:
        return True
    angle = angle_of(product(conjugated(_undone(expected, roll, pitch, rpy[r, 2])), ray_at(q, i)[0]))
    agreements = learnt.agreements + 1
    in_a_row = agreements >= IN_A_ROW
    banked = in_a_row and abs(roll) > BANK_RAD
    if angle > expected.limit_rad or (in_a_row and not expected.settled) or (banked and expected.wants_bank):
        return False
    learnt.agreements = agreements
    learnt.is_banked, learnt.is_confirmed = learnt.is_banked or banked, learnt.is_confirmed or in_a_row
    if expected.fitted:
        trim = expected.pitch_rad
        like_mount, like_sign = abs(trim * np.sin(roll)), abs(trim + 2.0 * pitch)
        learnt.like_mount = learnt.like_mount and like_mount <= TOLD_APART * NOISE_RAD
        learnt.like_sign = learnt.like_sign and like_sign <= TOLD_APART * NOISE_RAD
        learnt.lowest_rad, learnt.highest_rad = min(learnt.lowest_rad, pitch), max(learnt.highest_rad, pitch)
    last_us = _latest_us(tails.recent)
    if tails.recent.held[0] == 0 or t_us // SPARSE_US != last_us // SPARSE_US:
        _remember_pair(tails.sparse, frame_index, t_us, rpy, r, q, i)
    _remember_pair(tails.recent, frame_index, t_us, rpy, r, q, i)
    return True


@helper
def _between(tails: Any, t_us: Any) -> Any:
    """The place of the last Euler sample between the latest quaternion and one at `t_us`; −1: none that matters.

    As `pairs_between` of `expected.between`.
    """
    since_us, room = _latest_us(tails.quaternion), tails.euler.t_us.size
    if since_us < 0 or t_us - since_us > LONGEST_US:
        return -1
    held = tails.euler.held[0]
    for position in range(held - 1, max(held - room, 0) - 1, -1):
        at_us = tails.euler.t_us[position % room]
        if at_us < t_us:
            if at_us <= since_us or abs(tails.euler.numbers[position % room, 1]) > STEEP_RAD:
                return -1
            exact = tails.recent.held[0]
            often = (
                exact >= IN_A_ROW and at_us - tails.recent.t_us[(exact - IN_A_ROW) % tails.recent.t_us.size] <= RARE_US
            )
            return -1 if often else position % room
    return -1


@helper
def _seen_between(tails: Any, quaternion: Any, q: Any, at: Any) -> Any:
    """The quaternion at the time of the Euler sample at place `at`, and the bound of that; NaN: none is known."""
    rows = tails.quaternion
    last = (rows.held[0] - 1) % rows.t_us.size
    h = (quaternion.t_us[q] - rows.t_us[last]) * 1e-6
    u = (tails.euler.t_us[at] - rows.t_us[last]) * 1e-6 / h
    q0, q1 = unit_at(rows.numbers, last), unit_at(quaternion.numbers, q)
    w0 = vector_of(rows.numbers[last, 4], rows.numbers[last, 5], rows.numbers[last, 6])
    w1 = vector_of(quaternion.w_b_rad_s[q, 0], quaternion.w_b_rad_s[q, 1], quaternion.w_b_rad_s[q, 2])
    own = vector_of(tails.euler.numbers[at, 3], tails.euler.numbers[at, 4], tails.euler.numbers[at, 5])
    return between_of(q0, q1, w0, w1, own, h, u)


@helper
def _is_news(expected: Any, tails: Any, learnt: Any, at: Any, between: Any, bound: Any) -> Any:
    """Whether a pair of neighbouring instants is more than one more that agrees."""
    roll, pitch, yaw = tails.euler.numbers[at, 0], tails.euler.numbers[at, 1], tails.euler.numbers[at, 2]
    angle = angle_of(product(conjugated(_undone(expected, roll, pitch, yaw)), between))
    settles = not expected.settled and bound <= TELLS_RAD and learnt.between_agreements + 1 >= IN_A_ROW
    is_due = expected.counts_between or tails.euler.t_us[at] >= expected.refine_us
    return angle > expected.noise_between_rad + bound or settles or is_due


@helper
def _remember_between(tails: Any, learnt: Any, frame_index: Any, at: Any, between: Any, bound: Any) -> Any:
    """Take a pair of neighbouring instants that is no news."""
    if bound <= TELLS_RAD:
        learnt.between_agreements += 1
        learnt.is_confirmed = learnt.is_confirmed or learnt.between_agreements >= IN_A_ROW
    t_us, last_us = tails.euler.t_us[at], _latest_us(tails.between)
    is_first = tails.between.held[0] == 0 or t_us // SPARSE_US != last_us // SPARSE_US
    for of in range(0 if is_first else 1, 2):
        rows = tails.sparse_between if of == 0 else tails.between
        place = _next_place(rows, frame_index, t_us)
        for axis in range(3):
            rows.numbers[place, axis] = tails.euler.numbers[at, axis]
        for axis in range(4):
            rows.numbers[place, 3 + axis] = between[axis]
        rows.numbers[place, 7] = bound


@kernel
def pass_quietly(
    euler: Samples, quaternion: Samples, expected: Expectation, tails: Tails, learns: Annotated[Records, LEARNT],
    passed: Int64s,
) -> None:  # fmt: skip
    """Take samples of both streams, in order of arrival, up to the first that completes a pair which is news.

    `passed` (2,): from which sample of each stream on, and then up to which they were taken.
    """
    learnt = learns[0]
    e, q = passed[0], passed[1]
    while e < euler.t_us.size or q < quaternion.t_us.size:
        if q == quaternion.t_us.size or (e < euler.t_us.size and euler.frame_index[e] <= quaternion.frame_index[q]):
            t_us = euler.t_us[e]
            if euler.valid[e] and t_us > _latest_us(tails.euler):
                at = _at_instant(tails.quaternion, t_us)
                if at >= 0 and not _take_pair(
                    expected, tails, learnt, euler.frame_index[e], t_us, euler.numbers, e, tails.quaternion.numbers, at
                ):
                    break
                _remember(tails.euler, euler, e, 3)
            e += 1
        else:
            t_us = quaternion.t_us[q]
            if quaternion.valid[q] and t_us > _latest_us(tails.quaternion):
                near = _between(tails, t_us)
                between, bound = exponential(vector_of(0.0, 0.0, 0.0)), np.nan
                if near >= 0:
                    between, bound = _seen_between(tails, quaternion, q, near)
                    if np.isfinite(bound) and _is_news(expected, tails, learnt, near, between, bound):
                        break
                at = _at_instant(tails.euler, t_us)
                if at >= 0 and not _take_pair(
                    expected,
                    tails,
                    learnt,
                    quaternion.frame_index[q],
                    t_us,
                    tails.euler.numbers,
                    at,
                    quaternion.numbers,
                    q,
                ):
                    break
                if np.isfinite(bound):
                    _remember_between(tails, learnt, quaternion.frame_index[q], near, between, bound)
                _remember(tails.quaternion, quaternion, q, 4)
            q += 1
    passed[0], passed[1] = e, q
