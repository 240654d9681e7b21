"""Finds the attitude at the times of other samples, one sample after the other in order of arrival.

A question is answered by the first attitude at or behind its time, so an answer rests on what had arrived by then and
never on how the samples were cut into batches.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs_bridge.attitude._rows import where
from gcs_bridge.attitude.compiled import put, unit_at, vector_of
from gcs_bridge.attitude.kinematics import interpolated_along
from gcs_bridge.attitude.quaternion import between, conjugated, logarithm, product
from gcs_bridge.columns import FloatRows, Floats, Int64s, Mask
from gcs_bridge.jit import helper, kernel
from gcs_bridge.pairing.bounds import BEYOND_GYROS_RAD_S

ATTITUDE_WIDTH = 7  # of a row of the series: q_nb (4), w_b (3)
QUERY_WIDTH = 15  # of a question: force, rates, field, trim; whether it may rest, whether it stands; receive time
FALLBACK_US = 1_000_000  # ATTITUDE stands in for ATTITUDE_QUATERNION after so long a silence of it
_LATE_US = 1_000_000  # a question this much older than the series, when it comes, is not answered
_KEPT = 2048  # attitudes in which neighbours are looked for; a power of two
_PENDING = 1024  # questions that can wait
_FIRST_ROOM = 16


class Series(NamedTuple):
    """The latest attitudes, each later than all before: rings by position, whose room is a power of two."""

    heard: Int64s  # (1,) how many there were
    frame_index: Int64s  # (room,)
    t_us: Int64s
    rows: FloatRows  # (room, width)

    def with_room(self, more: int) -> Series:
        """The same with room for `more`, or for as many as are kept."""
        needed, room = min(int(self.heard[0]) + more, _KEPT), len(self.t_us)
        if room >= needed:
            return self
        # As long as there is room for all, a position is its place too.
        larger = new_series(self.rows.shape[1], max(_FIRST_ROOM, 1 << (needed - 1).bit_length()))
        for new, old in zip(larger, self, strict=True):
            new[: len(old)] = old
        return larger


def new_series(width: int, room: int = 0) -> Series:
    """Before the first attitude."""
    return Series(np.zeros(1, np.int64), np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros((room, width)))


class Waiting(NamedTuple):
    """Questions that no attitude has answered yet, in order of arrival."""

    left: Int64s  # (1,) how many wait
    latest_us: Int64s  # (1,) of the time of those that were answered
    frame_index: Int64s  # (room,)
    t_us: Int64s
    rows: FloatRows  # (room, width)

    @property
    def n(self) -> int:
        """How many wait."""
        return int(self.left[0])

    def with_room(self, more: int) -> Waiting:
        """The same with room for `more`, or for as many as may wait."""
        needed = min(self.n + more, _PENDING)
        if len(self.t_us) >= needed:
            return self
        larger = new_waiting(self.rows.shape[1], max(_FIRST_ROOM, 2 * needed))
        for new, old in zip(larger, self, strict=True):
            new[: len(old)] = old
        return larger


def new_waiting(width: int, room: int = 0) -> Waiting:
    """With none."""
    return Waiting(
        left=np.zeros(1, np.int64),
        latest_us=np.full(1, -1),
        frame_index=np.zeros(room, np.int64),
        t_us=np.zeros(room, np.int64),
        rows=np.zeros((room, width)),
    )


class Attitudes(NamedTuple):
    """Samples (n,) of one stream as they came, valid or not."""

    frame_index: Int64s
    t_us: Int64s
    q_nb: FloatRows
    w_b_rad_s: FloatRows
    valid: Mask


class Inertial(NamedTuple):
    """Samples (n,) of an inertial sensor as they came: as in `VehicleImu` of `pairing.references`."""

    frame_index: Int64s
    t_us: Int64s
    t_rx_us: Int64s
    f_b_m_s2: FloatRows
    w_b_rad_s: FloatRows
    m_b_gauss: FloatRows
    trim_b_rad: FloatRows
    may_rest: Mask
    stands: Mask


class SeenRows(NamedTuple):
    """Where inertial samples go whose attitude is known: as `ImuWithAttitude` of `pairing.references`, room for n."""

    frame_index: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    f_b_m_s2: FloatRows
    w_b_rad_s: FloatRows
    m_b_gauss: FloatRows
    trim_b_rad: FloatRows
    may_rest: Mask
    stands: Mask
    q_nb: FloatRows
    w0_b_rad_s: FloatRows
    w1_b_rad_s: FloatRows
    turn_b_rad: FloatRows
    gap_s: Floats
    place: Floats


@helper
def hear(series: Any, frame_index: Any, t_us: Any, rows: Any, i: Any) -> Any:
    """Take the next attitude, row `i` of `rows`; whether it is later than all before: another is nobody's neighbour."""
    last = series.t_us.size - 1
    n = series.heard[0]
    if n and t_us <= series.t_us[(n - 1) & last]:
        return False
    series.frame_index[n & last], series.t_us[n & last] = frame_index, t_us
    for column in range(rows.shape[1]):
        series.rows[n & last, column] = rows[i, column]
    series.heard[0] = n + 1
    return True


@helper
def neighbours(series: Any, t_us: Any, max_gap_us: Any) -> Any:
    """Positions of the attitudes before and at or behind a time, which one has reached; −1: none near is kept.

    One at the very time is the one behind; where nothing is near before it, it is both.
    """
    last = series.t_us.size - 1
    first = max(series.heard[0] - _KEPT, 0)
    behind = series.heard[0] - 1
    while behind > first and series.t_us[(behind - 1) & last] >= t_us:
        behind -= 1
    at_us = series.t_us[behind & last]
    if behind > first and at_us - series.t_us[(behind - 1) & last] <= max_gap_us:
        return behind - 1, behind
    return (behind, behind) if at_us == t_us else (-1, -1)


@helper
def attitude_between(series: Any, before: Any, behind: Any, t_us: Any) -> Any:
    """Attitude at a time between two positions (rule M18); the turn across the gap, the gap's share that has passed, s.

    Along the shortest way where no rates are reported.
    """
    last = series.t_us.size - 1
    one, two = before & last, behind & last
    gap_us = series.t_us[two] - series.t_us[one]
    place, gap_s = (t_us - series.t_us[one]) / max(gap_us, 1), gap_us * 1e-6
    w0, w1 = rates_at(series.rows, one), rates_at(series.rows, two)
    q0, q1 = unit_at(series.rows, one), unit_at(series.rows, two)
    turn = logarithm(product(conjugated(q0), q1))
    if gap_us > 0 and (w0[0] != 0 or w0[1] != 0 or w0[2] != 0) and (w1[0] != 0 or w1[1] != 0 or w1[2] != 0):
        w0, w1 = vector_of(w0[0], w0[1], w0[2]), vector_of(w1[0], w1[1], w1[2])
        q = interpolated_along(turn, q0, w0, w1, gap_s, place)[0]
    else:
        q = between(q0, q1, place)
    return q, turn, place, gap_s


@helper
def rates_at(rows: Any, at: Any) -> Any:
    """The rates of an attitude, as `rates_of`."""
    return rates_of(rows[at, 4], rows[at, 5], rows[at, 6])


@helper
def rates_of(x: Any, y: Any, z: Any) -> Any:
    """Rates as they are; as none those that are no number, or beyond any gyro."""
    most = BEYOND_GYROS_RAD_S
    return where(abs(x) <= most, x, 0.0), where(abs(y) <= most, y, 0.0), where(abs(z) <= most, z, 0.0)


@kernel
def choose_reference(
    stream: Int64s, euler: Attitudes, quaternion: Attitudes, heard_us: Int64s,
    frame_index: Int64s, t_us: Int64s, rows: FloatRows, counts: Int64s,
) -> None:  # fmt: skip
    """Put the valid quaternions down in order of arrival, and the valid Euler angles while no quaternion comes.

    `counts` (3,): samples passed of both streams, and those put down. `heard_us` (1,): the latest quaternion.
    """
    for k in stream:
        if k > 1:
            continue
        i = counts[k]
        counts[k] += 1
        if k == 0:
            if euler.valid[i] and euler.t_us[i] - heard_us[0] >= FALLBACK_US:
                _put_down(euler, i, frame_index, t_us, rows, counts)
        elif quaternion.valid[i]:
            heard_us[0] = max(heard_us[0], quaternion.t_us[i])
            _put_down(quaternion, i, frame_index, t_us, rows, counts)


@helper
def _put_down(samples: Any, i: Any, frame_index: Any, t_us: Any, rows: Any, counts: Any) -> Any:
    """Take sample `i`."""
    n = counts[2]
    counts[2] += 1
    frame_index[n], t_us[n] = samples.frame_index[i], samples.t_us[i]
    for column in range(4):
        rows[n, column] = samples.q_nb[i, column]
    for column in range(3):
        rows[n, 4 + column] = samples.w_b_rad_s[i, column]


@kernel
def hear_all(frame_index: Int64s, t_us: Int64s, rows: FloatRows, series: Series) -> None:
    """Take attitudes (n,) about which nothing is asked."""
    for i in range(t_us.size):
        hear(series, frame_index[i], t_us[i], rows, i)


@kernel
def see_kernel(
    frame_index: Int64s, t_us: Int64s, rows: FloatRows, imu: Inertial, max_gap_us: int,
    series: Series, waiting: Waiting, seen: SeenRows, counts: Int64s,
) -> None:  # fmt: skip
    """Take attitudes (n,) and inertial samples in order of arrival; put down samples as their attitude gets known.

    `counts[3]` is how many; those that are not later than one before them are left out.
    """
    asked = 0
    for i in range(t_us.size + 1):
        at_end = i == t_us.size
        while asked < imu.t_us.size and (at_end or imu.frame_index[asked] < frame_index[i]):
            _ask(series, waiting, imu, asked, max_gap_us, seen, counts)
            asked += 1
        if not at_end and hear(series, frame_index[i], t_us[i], rows, i):
            _answer_waiting(series, waiting, frame_index[i], max_gap_us, seen, counts)


@helper
def _ask(series: Any, waiting: Any, imu: Any, i: Any, max_gap_us: Any, seen: Any, counts: Any) -> Any:
    """Ask about an inertial sample."""
    at = wait(series, waiting, imu.frame_index[i], imu.t_us[i])
    if at < 0:
        return
    row = waiting.rows[at]
    for axis in range(3):
        row[axis], row[3 + axis] = imu.f_b_m_s2[i, axis], imu.w_b_rad_s[i, axis]
        row[6 + axis], row[9 + axis] = imu.m_b_gauss[i, axis], imu.trim_b_rad[i, axis]
    row[12], row[13], row[14] = imu.may_rest[i], imu.stands[i], imu.t_rx_us[i]
    if latest_us(series) >= imu.t_us[i]:
        _answer_waiting(series, waiting, imu.frame_index[i], max_gap_us, seen, counts)


@helper
def latest_us(series: Any) -> Any:
    """When the latest attitude was, −1: there was none yet."""
    n = series.heard[0]
    return series.t_us[(n - 1) & (series.t_us.size - 1)] if n else np.int64(-1)


@helper
def wait(series: Any, waiting: Any, frame_index: Any, t_us: Any) -> Any:
    """Let a question wait: its place, at which the caller puts its row down, or −1 where it came too late."""
    if latest_us(series) - t_us > _LATE_US:
        return -1
    if waiting.left[0] == _PENDING:
        _drop_first(waiting)
    at = waiting.left[0]
    waiting.left[0] += 1
    waiting.frame_index[at], waiting.t_us[at] = frame_index, t_us
    return at


@helper
def _drop_first(waiting: Any) -> Any:
    """Give up the oldest question."""
    waiting.left[0] -= 1
    for at in range(waiting.left[0]):
        _move(waiting, at + 1, at)


@helper
def _move(waiting: Any, at: Any, to: Any) -> Any:
    """Put a question in another place."""
    waiting.frame_index[to], waiting.t_us[to] = waiting.frame_index[at], waiting.t_us[at]
    for column in range(waiting.rows.shape[1]):
        waiting.rows[to, column] = waiting.rows[at, column]


@helper
def take_waiting(waiting: Any) -> Any:
    """How many questions wait: each is to be given to `reached`, in turn, which lets it wait on or not."""
    n = waiting.left[0]
    waiting.left[0] = 0
    return n


@helper
def reached(series: Any, waiting: Any, at: Any, max_gap_us: Any) -> Any:
    """Positions of the neighbours of a question that the latest attitude has reached; −1: of another, which waits on.

    −1 too where none is near, and where one that is as late, or later, was answered before.
    """
    t_us = waiting.t_us[at]
    if t_us > latest_us(series):
        left = waiting.left[0]
        if left < at:
            _move(waiting, at, left)
        waiting.left[0] = left + 1
        return -1, -1
    before, behind = neighbours(series, t_us, max_gap_us)
    if behind < 0 or t_us <= waiting.latest_us[0]:
        return -1, -1
    waiting.latest_us[0] = t_us
    return before, behind


@helper
def _answer_waiting(series: Any, waiting: Any, frame_index: Any, max_gap_us: Any, seen: Any, counts: Any) -> Any:
    """Put the samples down whose attitude is known with the frame `frame_index`."""
    for at in range(take_waiting(waiting)):
        before, behind = reached(series, waiting, at, max_gap_us)
        if behind >= 0:
            _see(series, before, behind, waiting, at, frame_index, seen, counts)


@helper
def _see(series: Any, before: Any, behind: Any, waiting: Any, at: Any, frame_index: Any, seen: Any, counts: Any) -> Any:
    """Put a sample down, with the attitude at its time."""
    t_us, n, row = waiting.t_us[at], counts[3], waiting.rows[at]
    last = series.t_us.size - 1
    q, turn, place, gap_s = attitude_between(series, before, behind, t_us)
    put(q, seen.q_nb, n)
    seen.place[n], seen.gap_s[n] = place, gap_s
    seen.turn_b_rad[n, 0], seen.turn_b_rad[n, 1], seen.turn_b_rad[n, 2] = turn
    for axis in range(3):
        seen.w0_b_rad_s[n, axis] = series.rows[before & last, 4 + axis]
        seen.w1_b_rad_s[n, axis] = series.rows[behind & last, 4 + axis]
        seen.f_b_m_s2[n, axis], seen.w_b_rad_s[n, axis] = row[axis], row[3 + axis]
        seen.m_b_gauss[n, axis], seen.trim_b_rad[n, axis] = row[6 + axis], row[9 + axis]
    seen.may_rest[n], seen.stands[n], seen.t_rx_us[n] = row[12] != 0, row[13] != 0, row[14]
    seen.frame_index[n], seen.t_boot_us[n] = frame_index, t_us
    counts[3] = n + 1
