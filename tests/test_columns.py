"""Records of arrays, the last rows of a stream, and its running maximum."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_bridge.columns import Columns, Floats, FrameColumns, Int64s, all_true, any_true, last_where, record


@record
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


def test_the_last_place_at_which_something_was() -> None:
    """Up to each place; −1 where it never was."""
    assert last_where(np.array([False, True, False, False, True])).tolist() == [-1, 1, 1, 1, 4]


@pytest.mark.parametrize("mask", [[], [True], [False], [False, True], [True, True], [False, False]])
def test_masks_of_some_rows(mask: list[bool]) -> None:
    """Whether any row is true, and whether all are: as Python says it."""
    rows = np.array(mask, np.bool_)
    assert (any_true(rows), all_true(rows)) == (any(mask), all(mask))
    every_other = np.repeat(rows, 2)[::2]
    assert (any_true(every_other), all_true(every_other)) == (any(mask), all(mask))
