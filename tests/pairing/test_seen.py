"""Neighbours in time across streams: answers by hand, by a slow and plain search, and however the input is cut."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gcs_bridge.columns import FloatRows, Floats, Int64Rows, Int64s
from gcs_bridge.jit import kernel
from gcs_bridge.pairing.seen import (
    Series,
    Waiting,
    attitude_between,
    hear,
    new_series,
    new_waiting,
    reached,
    take_waiting,
    wait,
)
from tests.helpers.wire import wxyz

S = 1_000_000
GAP_US = S

Heard = tuple[str, int]  # "s" of the series or "q" a query, and its time, µs; the frame_index is the place


@kernel
def ask(
    first: int, queries: Int64s, t_us: Int64s, rows: FloatRows, series: Series, waiting: Waiting, answers: Int64Rows
) -> int:
    """Take messages (n,), queries or of the series, in frames from `first` on; fill answers (m, 4), return how many."""
    n = 0
    for i in range(t_us.size):
        if queries[i]:
            at = wait(series, waiting, first + i, t_us[i])
            if at >= 0:
                waiting.rows[at, 0] = first + i
        else:
            hear(series, first + i, t_us[i], rows, i)
        for at in range(take_waiting(waiting)):
            before, behind = reached(series, waiting, at, GAP_US)
            if behind >= 0:
                last = series.t_us.size - 1
                answers[n, 0], answers[n, 3] = np.int64(waiting.rows[at, 0]), first + i
                answers[n, 1], answers[n, 2] = series.frame_index[before & last], series.frame_index[behind & last]
                n += 1
    return n


def answers(heard: Sequence[Heard], cuts: Sequence[int] = ()) -> list[tuple[int, ...]]:
    """Frames of the query, of its neighbours before and behind, and of what completed it."""
    series, waiting, found = new_series(7), new_waiting(1), []
    edges = sorted({0, len(heard), *(cut for cut in cuts if cut < len(heard))})
    for begin, end in pairwise(edges):
        part = heard[begin:end]
        series, waiting = series.with_room(len(part)), waiting.with_room(len(part))
        room = np.empty((waiting.n + len(part), 4), np.int64)
        queries = np.array([kind == "q" for kind, _ in part], np.int64)
        t_us = np.array([t_us for _, t_us in part], np.int64)
        n = ask(begin, queries, t_us, np.zeros((len(part), 7)), series, waiting, room)
        found += [tuple(row) for row in room[:n].tolist()]
    return found


def searched(heard: Sequence[Heard]) -> list[tuple[int, ...]]:
    """The same, by looking at every pair of messages."""
    series: list[tuple[int, int]] = []  # in order of time: what comes late is nobody's neighbour
    for frame_index, (kind, t_us) in enumerate(heard):
        if kind == "s" and (not series or t_us > series[-1][1]):
            series.append((frame_index, t_us))
    found = []
    for query, (kind, t_us) in enumerate(heard):
        heard_before = [other_us for frame_index, other_us in series if frame_index < query]
        if kind == "s" or (heard_before and heard_before[-1] - t_us > S):
            continue  # too late
        behind = next(((frame_index, at_us) for frame_index, at_us in series if at_us >= t_us), None)
        if behind is None:
            continue  # not yet
        earlier = [(frame_index, at_us) for frame_index, at_us in series if at_us < behind[1]]
        before = earlier[-1] if earlier and behind[1] - earlier[-1][1] <= GAP_US else None
        if before is None and behind[1] == t_us:
            before = behind
        if before is not None:
            found.append((query, before[0], behind[0], max(query, behind[0])))
    answered: list[tuple[int, ...]] = []
    latest_us = -1  # what is not later than one that was answered is passed over
    for answer in sorted(found, key=lambda answer: (answer[3], answer[0])):
        if heard[answer[0]][1] > latest_us:
            answered.append(answer)
            latest_us = heard[answer[0]][1]
    return answered


@pytest.mark.parametrize(
    ("heard", "expected"),
    [
        ([("s", 0), ("q", 400_000), ("s", S)], [(1, 0, 2, 2)]),  # answered by what comes behind it
        ([("s", 0), ("s", S), ("q", 400_000)], [(2, 0, 1, 2)]),  # or by what was there already
        ([("s", 0), ("s", S), ("q", S)], [(2, 0, 1, 2)]),  # at a sample's very time that is the one behind
        ([("q", 0), ("s", 0)], [(0, 1, 1, 1)]),  # and both, where there is none near before it
        ([("s", 0), ("q", 2 * S), ("s", 2 * S)], [(1, 2, 2, 2)]),
        ([("q", 5), ("s", 10)], []),  # nothing before it
        ([("s", 0), ("q", 5)], []),  # nothing behind it yet
        ([("s", 0), ("q", 5), ("s", S + 1)], []),  # neighbours too far apart
        ([("s", 0), ("q", 5), ("s", S)], [(1, 0, 2, 2)]),
        ([("s", 0), ("s", 10), ("s", 5), ("q", 7)], [(3, 0, 1, 3)]),  # a late sample is no neighbour
        ([("s", 0), ("s", 5), ("s", 5), ("q", 7), ("s", 9)], [(3, 1, 4, 4)]),  # nor is one of the same time
        ([("s", 0), ("s", 500_000), ("s", S + 500_000), ("q", 499_999)], []),  # a query later than 1 s
        ([("s", 0), ("s", 500_000), ("s", S + 500_000), ("q", 500_000)], [(3, 0, 1, 3)]),
        ([("s", 0), ("q", 8), ("q", 3), ("s", 5), ("s", 9)], [(2, 0, 3, 3), (1, 3, 4, 4)]),  # as they are completed
        ([("s", 0), ("q", 3), ("q", 8), ("s", 5), ("s", 9)], [(1, 0, 3, 3), (2, 3, 4, 4)]),  # the others wait on
        ([("s", 0), ("q", 8), ("q", 3), ("s", 9)], [(1, 0, 3, 3)]),  # one behind a later one that was answered is not
    ],
)
def test_neighbours_by_hand(heard: list[Heard], expected: list[tuple[int, ...]]) -> None:
    """Each query is answered by the first sample at or behind its time and the one before that, once both are there."""
    assert answers(heard) == expected
    assert searched(heard) == expected


@kernel
def between(t_us: int, series: Series, out: Floats) -> None:
    """Put down the attitude between the two of the series, the place, the gap, and the turn across it."""
    q, turn, out[4], out[5] = attitude_between(series, 0, 1, t_us)
    for i in range(3):
        out[6 + i] = turn[i]
    for i in range(4):
        out[i] = q[i]


@pytest.mark.parametrize("rate_rad_s", [0.0, np.nan, 0.3], ids=["none", "unknown", "known"])
def test_an_attitude_between_two(rate_rad_s: float) -> None:
    """0.2 s behind the one and 0.6 s before the other is a quarter of 0.8 s: of a turn at constant rate, a quarter."""
    series, out = new_series(7).with_room(2), np.empty(9)
    for at, angle in enumerate((0.1, 0.1 + 0.3 * 0.8)):
        turned = wxyz(Rotation.from_rotvec([0, 0, angle]))
        series.t_us[at], series.rows[at] = at * 800_000, (*turned, 0.0, 0.0, rate_rad_s)
    series.heard[0] = 2
    between(200_000, series, out)
    assert out[:4] == pytest.approx(wxyz(Rotation.from_rotvec([0, 0, 0.1 + 0.3 * 0.2])), abs=1e-12)
    assert out[4:6] == pytest.approx([0.25, 0.8])
    assert out[6:] == pytest.approx([0.0, 0.0, 0.3 * 0.8], abs=1e-12)


messages = st.lists(st.tuples(st.sampled_from("sq"), st.integers(0, 60).map(lambda n: n * 100_000)), max_size=40)


@pytest.mark.slow
@given(heard=messages, cuts=st.lists(st.integers(1, 40), max_size=8))
def test_any_cutting_gives_the_same(heard: list[Heard], cuts: list[int]) -> None:
    """In whatever order times come and wherever they are cut, the answers are those of the slow search."""
    assert answers(heard, cuts) == answers(heard) == searched(heard)


@pytest.mark.slow
@given(
    steps=st.lists(st.tuples(st.sampled_from("sssq"), st.integers(-300_000, 700_000)), max_size=60),
    cuts=st.lists(st.integers(1, 60), max_size=8),
)
def test_any_cutting_of_what_comes_nearly_in_order(steps: list[tuple[str, int]], cuts: list[int]) -> None:
    """The same for streams as they come: time goes on, with a little disorder."""
    now_us, heard = 0, []
    for kind, step_us in steps:
        now_us = max(now_us + step_us, 0)
        heard.append((kind, now_us))
    assert answers(heard, cuts) == searched(heard)
