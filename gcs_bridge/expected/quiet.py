"""Passes the samples that teach a view nothing, in one compiled loop: as long as the pairs agree with what is undone.

What disagrees, or makes something known for the first time, is looked at by `view` and `vehicle`, where the rules are.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from gcs_bridge.attitude.compiled import ray_at, vector_of
from gcs_bridge.attitude.euler import quaternion_of_rpy
from gcs_bridge.attitude.quaternion import angle_of, conjugated, exponential, product
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask, Records
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


LEARNT = np.dtype(
    [
        ("agreements", "i8"),  # pairs in a row that agree
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
    """The last rows of a stream: rings by position."""

    held: Int64s  # (1,) how many there were
    frame_index: Int64s  # (room,)
    t_us: Int64s
    numbers: FloatRows  # (room, 7)


class Tails(NamedTuple):
    """What is remembered: the last samples of both streams in order, the last pairs, and one pair a second."""

    euler: Rows  # roll, pitch, yaw
    quaternion: Rows  # w, x, y, z, body rates
    recent: Rows  # roll, pitch, yaw, w, x, y, z
    sparse: Rows


class Samples(NamedTuple):
    """Samples (n,) of one stream as they came."""

    frame_index: Int64s
    t_us: Int64s
    numbers: FloatRows  # (n, 3) roll, pitch, yaw, or (n, 4) w, x, y, z, as sent
    w_b_rad_s: FloatRows
    valid: Mask


def new_tails() -> Tails:
    """With nothing in them."""
    return Tails(*(_new_rows(room) for room in (TAIL, TAIL, RECENT, RECENT)))


def _new_rows(room: int) -> Rows:
    return Rows(np.zeros(1, np.int64), np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros((room, 7)))


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
        view=np.zeros(n, np.int8),
        free=np.zeros(n, np.bool_),
    )


def quaternion_rows(rows: Rows) -> QuaternionRows:
    """The last quaternions."""
    frame_index, t_us, numbers = _in_order(rows)
    return QuaternionRows(
        frame_index=frame_index, t_us=t_us, q_nb=numbers[:, :4].copy(), w_b_rad_s=numbers[:, 4:].copy()
    )


def pair_rows(rows: Rows) -> CleanPairs:
    """The pairs that are kept."""
    frame_index, t_us, numbers = _in_order(rows)
    return CleanPairs(
        frame_index=frame_index,
        t_us=t_us,
        rpy_rad=numbers[:, :3].copy(),
        q_nb=numbers[:, 3:].copy(),
        free=np.zeros(len(t_us), np.bool_),
    )


def fill_tails(
    tails: Tails, euler: EulerRows, quaternion: QuaternionRows, recent: CleanPairs, sparse: CleanPairs
) -> None:
    """Remember these."""
    _fill(tails.euler, euler.frame_index, euler.t_us, euler.rpy_rad)
    _fill(tails.quaternion, quaternion.frame_index, quaternion.t_us, quaternion.q_nb, quaternion.w_b_rad_s)
    _fill(tails.recent, recent.frame_index, recent.t_us, recent.rpy_rad, recent.q_nb)
    _fill(tails.sparse, sparse.frame_index, sparse.t_us, sparse.rpy_rad, sparse.q_nb)


# Helpers of the kernel carry no types: numba types them anew wherever they are compiled into one.


@helper
def _latest_us(rows):  # type: ignore[no-untyped-def]  # typed by numba
    """When the last row was; −1 where there is none."""
    return rows.t_us[(rows.held[0] - 1) % rows.t_us.size] if rows.held[0] else np.int64(-1)


@helper
def _at_instant(rows, t_us):  # type: ignore[no-untyped-def]  # typed by numba
    """The place of the row at a time; −1: none."""
    room = rows.t_us.size
    for position in range(rows.held[0] - 1, max(rows.held[0] - room, 0) - 1, -1):
        at_us = rows.t_us[position % room]
        if at_us <= t_us:
            return position % room if at_us == t_us else -1
    return -1


@helper
def _next_place(rows, frame_index, t_us):  # type: ignore[no-untyped-def]  # typed by numba
    """Begin a row behind the others; where it is."""
    at = rows.held[0] % rows.t_us.size
    rows.held[0] += 1
    rows.frame_index[at], rows.t_us[at] = frame_index, t_us
    return at


@helper
def _remember(rows, samples, i, width):  # type: ignore[no-untyped-def]  # typed by numba
    """Take sample `i`, whose own numbers are `width`."""
    at = _next_place(rows, samples.frame_index[i], samples.t_us[i])
    for column in range(width):
        rows.numbers[at, column] = samples.numbers[i, column]
    for axis in range(7 - width):
        rows.numbers[at, width + axis] = samples.w_b_rad_s[i, axis] if axis < 3 else 0.0


@helper
def _remember_pair(rows, frame_index, t_us, rpy, r, q, i):  # type: ignore[no-untyped-def]  # typed by numba
    """Take the pair of row `r` of `rpy` and row `i` of `q`."""
    at = _next_place(rows, frame_index, t_us)
    for axis in range(3):
        rows.numbers[at, axis] = rpy[r, axis]
    for axis in range(4):
        rows.numbers[at, 3 + axis] = q[i, axis]


@helper
def _undone(expected, roll, pitch, yaw):  # type: ignore[no-untyped-def]  # typed by numba
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
def _take_pair(expected, tails, learnt, frame_index, t_us, rpy, r, q, i):  # type: ignore[no-untyped-def]  # typed by numba
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
                _remember(tails.quaternion, quaternion, q, 4)
            q += 1
    passed[0], passed[1] = e, q
