"""Records of arrays, the last rows of a stream, and its running maximum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.columns import Columns, Floats, FrameColumns, Int64s, Ring, RunningMax, last_where


@dataclass(frozen=True, kw_only=True)
class Points(FrameColumns):
    """Three columns, one of which may be missing, and a name for all rows."""

    at: Floats  # (n, 2)
    source: str
    weight: Int64s | None = None


def points(*frame_index: int, source: str = "A", weighed: bool = False) -> Points:
    n = len(frame_index)
    at = np.arange(2.0 * n).reshape(n, 2) + 10 * sum(frame_index)
    weight = np.array(frame_index, np.int64) if weighed else None
    return Points(frame_index=np.array(frame_index, np.int64), at=at, source=source, weight=weight)


@pytest.mark.parametrize("rows", [slice(1, 3), np.array([True, False, True, False]), np.array([2, 0, 0])])
def test_a_part_has_its_rows_of_every_column(rows: slice | Int64s) -> None:
    """By slice, mask or indices; the name and a missing column go with it."""
    whole = points(3, 5, 8, 9)
    part = whole[rows]
    assert np.array_equal(part.frame_index, whole.frame_index[rows])
    assert np.array_equal(part.at, whole.at[rows])
    assert (part.source, part.weight, len(part)) == ("A", None, len(whole.frame_index[rows]))


def test_an_optional_column_that_is_there_is_a_column() -> None:
    """It is cut and joined like the others."""
    joined = points(1, 2, weighed=True)[1:].then(points(7, weighed=True))
    assert joined.weight is not None
    assert joined.weight.tolist() == [2, 7]


def test_joined_records_lie_one_behind_the_other() -> None:
    """In the order given; of the name the first one's holds."""
    joined = Points.joined([points(5, source="B"), points(), points(1, 2)])
    assert joined.frame_index.tolist() == [5, 1, 2]
    assert joined.at.shape == (3, 2)
    assert joined.source == "B"
    assert Points.in_arrival([points(5, 7), points(1, 6)]).frame_index.tolist() == [1, 5, 6, 7]


def test_what_certain_frames_brought() -> None:
    """From the first up to, and without, the end."""
    assert points(3, 5, 5, 8).frames(5, 8).frame_index.tolist() == [5, 5]
    assert len(points(3, 8).frames(4, 8)) == 0


def test_records_are_built_by_keyword() -> None:
    """Columns that look alike can't be swapped."""
    with pytest.raises(TypeError):
        Points(np.zeros(1, np.int64), np.zeros((1, 2)), "A")  # type: ignore[call-arg]  # which is what is tested
    assert issubclass(Points, Columns)


@given(st.lists(st.integers(0, 7), max_size=12))
def test_a_ring_keeps_the_last_rows_and_their_positions(batches: list[int]) -> None:
    """However the rows came, each of the last ones is found by how many came before it."""
    ring, came = Ring(4, points()), 0
    for n in batches:
        ring.append(points(*range(came, came + n)))
        came += n
        assert len(ring) >= min(came, 4)
        assert len(ring) <= 4 + n + max(batches)
        assert ring.rows.frame_index.tolist() == list(range(ring.first, came))


@given(st.lists(st.integers(-50, 50), max_size=20), st.lists(st.integers(0, 20)).map(sorted))
def test_a_running_maximum_does_not_depend_on_the_cuts(numbers: list[int], cuts: list[int]) -> None:
    """With each number the largest so far, and before them all the one that it starts with."""
    running = RunningMax(-7)
    found: list[int] = []
    for part in np.split(np.array(numbers, np.int64), cuts):
        before, *largest = running.feed(part).tolist()
        assert before == max([-7, *numbers[: len(found)]])
        found += largest
    assert found == [max(-7, *numbers[: at + 1]) for at in range(len(numbers))]


def test_a_running_maximum_may_start_with_the_first_number() -> None:
    """Before that there is nothing."""
    running = RunningMax()
    assert len(running.feed(np.empty(0, np.int64))) == 0
    assert running.feed(np.array([-5, -9])).tolist() == [-5, -5, -5]
    assert running.latest == -5


def test_the_last_place_at_which_something_was() -> None:
    """Up to each place; −1 where it never was."""
    assert last_where(np.array([False, True, False, False, True])).tolist() == [-1, 1, 1, 1, 4]
