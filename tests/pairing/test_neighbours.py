"""Neighbours in time across streams: answers by hand, by a slow and plain search, and however the input is cut."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.pairing.neighbours import Answers, Lookup, Track

S = 1_000_000
GAP_US = S

Heard = tuple[str, int]  # "s" of the series or "q" a query, and its time, µs; the frame_index is the place


def track(heard: Sequence[tuple[int, Heard]], kind: str) -> Track:
    """The messages of one kind; each row holds its own frame_index."""
    mine = [(frame_index, t_us) for frame_index, (name, t_us) in heard if name == kind]
    frame_indices = np.array([frame_index for frame_index, _ in mine], np.int64)
    t_us = np.array([t_us for _, t_us in mine], np.int64)
    return Track(frame_index=frame_indices, t_us=t_us, rows=frame_indices[:, None].astype(np.float64))


def asked(heard: Sequence[Heard], cuts: Sequence[int] = ()) -> list[Answers]:
    lookup = Lookup(1, 1, GAP_US)
    numbered = list(enumerate(heard))
    edges = sorted({0, len(heard), *(cut for cut in cuts if cut < len(heard))})
    parts = [numbered[begin:end] for begin, end in pairwise(edges)]
    return [lookup.feed(track(part, "s"), track(part, "q")) for part in parts]


def answers(heard: Sequence[Heard], cuts: Sequence[int] = ()) -> list[tuple[int, int, int, int]]:
    """Ordinals of the query, of its neighbours before and behind, and of the frame that completed it."""
    return [
        (int(query), int(before), int(after), int(frame_index))
        for found in asked(heard, cuts)
        for query, before, after, frame_index in zip(
            found.query.frame_index, found.before.frame_index, found.after.frame_index, found.frame_index, strict=True
        )
    ]


def searched(heard: Sequence[Heard]) -> list[tuple[int, int, int, int]]:
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
    return sorted(found, key=lambda answer: (answer[3], answer[0]))


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
    ],
)
def test_neighbours_by_hand(heard: list[Heard], expected: list[tuple[int, int, int, int]]) -> None:
    """Each query is answered by the first sample at or behind its time and the one before that, once both are there."""
    assert answers(heard) == expected
    assert searched(heard) == expected


def test_place_and_gap() -> None:
    """A query 0.2 s behind the one and 0.6 s before the other lies at a quarter of 0.8 s; an exact one at 0."""
    (found,) = asked([("s", 0), ("q", 200_000), ("s", 800_000)])
    assert found.place.tolist() == [0.25]
    assert found.gap_s.tolist() == pytest.approx([0.8])
    (exact,) = asked([("q", 7), ("s", 7)])
    assert (exact.place.tolist(), exact.gap_s.tolist()) == ([0.0], [0.0])


def test_the_rows_come_with_the_neighbours() -> None:
    """Query and neighbours bring their own rows."""
    (found,) = asked([("s", 0), ("q", 3), ("s", 5)])
    assert (found.before.rows.item(), found.query.rows.item(), found.after.rows.item()) == (0.0, 1.0, 2.0)


messages = st.lists(st.tuples(st.sampled_from("sq"), st.integers(0, 60).map(lambda n: n * 100_000)), max_size=40)


@given(heard=messages, cuts=st.lists(st.integers(1, 40), max_size=8))
def test_any_cutting_gives_the_same(heard: list[Heard], cuts: list[int]) -> None:
    """In whatever order times come and wherever they are cut, the answers are those of the slow search."""
    assert answers(heard, cuts) == answers(heard) == searched(heard)


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
