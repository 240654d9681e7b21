"""What the pairing remembers of both streams within one boot: a ring of samples each, its slots and columns.

A sample is kept by its position, the count of those before it: its place in the ring is that modulo the ring's room.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np

from gcs_bridge.attitude.compiled import unit_at
from gcs_bridge.attitude.quaternion import conjugated, product
from gcs_bridge.columns import FloatRows, Floats, Int64Rows, Int64s, Mask
from gcs_bridge.jit import helper

NumbersT = TypeVar("NumbersT", Int64s, Floats)
EULER, QUATERNION = 0, 1  # the two streams
RING = 1024  # samples of each stream that can still find a partner; a power of two
_FIRST_ROOM = 16  # samples that there is room for at first: many components send no more
BLOCK = 32  # sample intervals behind each estimate of a stream's period
INTERPOLATED, SAME_INSTANT = 1, 2  # how a sample was paired
# Slots of `PairState.of`, one row a stream.
COUNT, ORDERED, LATEST, INTERVALS, WAITING, PERIOD, RX_PERIOD, RX_START = range(8)
# Columns of `PairState.rows`: what is kept of a sample, and of the step that led to it.
Q, W = 0, 4  # four: unit quaternion; three: body rates, rad/s
KIN = 7  # rad by which the step differs from what the rates say
DENIED = 8  # whether the rates contradict it
UNSTEADY = 9  # rad/s by which the rates may be off at the sample, as the step shows them
APPLIED = 10  # four: the quaternion from expected to sent, body side
EXPECTED = 14  # which difference was undone: another number for another one
COLUMNS = 15
UNKNOWN = -1


class PairState(NamedTuple):
    """What the pairing remembers within one boot."""

    of: Int64Rows  # (2, 8) counters, see above
    slower: Int64s  # (1,)
    time: Int64Rows  # (2, room) by position; the room is a power of two and grows up to RING
    rows: Annotated[Floats, 3]  # (2, room, 15) by position
    latest: FloatRows  # (2, 15) of the latest sample in order
    paired: Int64Rows  # (2, room) by position: 0, or how it was paired
    ordered: Int64Rows  # (2, room) positions whose time is later than all before
    waiting: Int64Rows  # (2, room) positions that wait for a partner
    interval: Int64Rows  # (2, BLOCK)

    @property
    def n_waiting(self) -> int:
        """How many samples wait for a partner."""
        return int(self.of[EULER, WAITING] + self.of[QUATERNION, WAITING])

    def with_room(self, more: int) -> PairState:
        """The same with room for `more` samples of each stream, or for as many as can still find a partner."""
        room = self.time.shape[1]
        if room == RING:
            return self
        needed = min(int(self.of[:, COUNT].max()) + more, RING)
        if room >= needed:
            return self
        room = max(_FIRST_ROOM, 1 << (needed - 1).bit_length())
        # As long as there is room for all, a position is its place too.
        rings = {name: _rings(room, getattr(self, name)) for name in ("time", "paired", "ordered", "waiting")}
        return self._replace(rows=_rings(room, self.rows), **rings)


def _rings(room: int, filled: NumbersT) -> NumbersT:
    """A ring a stream (2, room, …), filled so far as `filled`."""
    rings = np.zeros((2, room, *filled.shape[2:]), filled.dtype)
    rings[:, : filled.shape[1]] = filled
    return rings


def new_pair_state() -> PairState:
    """Before a boot's first sample."""
    none = np.empty((2, 0), np.int64)
    of = np.zeros((2, 8), np.int64)
    of[:, [LATEST, PERIOD, RX_PERIOD]] = UNKNOWN
    return PairState(
        of=of,
        slower=np.full(1, UNKNOWN),
        time=none,
        rows=np.empty((2, 0, COLUMNS)),
        latest=np.zeros((2, COLUMNS)),
        paired=none,
        ordered=none,
        waiting=none,
        interval=np.zeros((2, BLOCK), np.int64),
    )


class Came(NamedTuple):
    """Samples (n,) of one stream as they came, valid or not."""

    frame_index: Int64s
    t_us: Int64s
    t_rx_us: Int64s
    q_nb: FloatRows  # (n, 4) what is expected undone
    q_sent: FloatRows  # (n, 4) as sent; (0, 4): nothing was undone
    expected: Int64s  # (n,) which difference was; (0,): the same in all samples so far
    w_b_rad_s: FloatRows  # (n, 3)
    valid: Mask


@helper
def three(row: Any, at: Any) -> Any:
    """Three numbers of a row."""
    return row[at], row[at + 1], row[at + 2]


@helper
def four(row: Any, at: Any) -> Any:
    """Four numbers of a row."""
    return row[at], row[at + 1], row[at + 2], row[at + 3]


@helper
def keep(state: Any, k: Any, position: Any, came: Any, i: Any) -> Any:
    """Remember sample `i`, of which no step is known yet."""
    at = position & (state.time.shape[1] - 1)
    row = state.rows[k, at]
    state.time[k, at] = came.t_us[i]
    state.paired[k, at] = 0
    q = unit_at(came.q_nb, i)
    for axis in range(4):
        row[Q + axis], row[APPLIED + axis] = q[axis] + 0.0, 0.0
    row[APPLIED] = 1.0
    # Where nothing was undone nothing is put back either, to the last bit: another batch may not ask.
    if came.q_sent.shape[0] and four(came.q_sent[i], 0) != four(came.q_nb[i], 0):
        applied = product(conjugated(q), four(came.q_sent[i], 0))
        for axis in range(4):
            row[APPLIED + axis] = applied[axis] + 0.0
    for axis in range(3):
        row[W + axis] = came.w_b_rad_s[i, axis]
    row[EXPECTED] = came.expected[i] if came.expected.size else 0
    row[KIN], row[DENIED], row[UNSTEADY] = np.inf, 0.0, np.nan
