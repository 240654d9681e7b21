"""What checks are made of: sums over the last seconds, what is usable, ratings; by hand, and however they are cut."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gcs_bridge.checks.base import Usable, along, between_attitudes, rated
from gcs_bridge.checks.windows import SlidingSums
from gcs_bridge.pairing.neighbours import in_order
from gcs_bridge.settings import AlarmSettings
from tests.helpers.wire import wxyz

# --- sums ------------------------------------------------------------------------------------------------------------


def sums(
    times_s: Sequence[float], values: Sequence[float], window_s: float = 1.0, cuts: Sequence[int] = ()
) -> list[list[float]]:
    """Per sample the sum, the count, and since when, s."""
    sliding = SlidingSums(window_s, 1)
    t_us = np.round(np.array(times_s) * 1e6).astype(np.int64)
    rows = np.array(values, np.float64)[:, None]
    edges = sorted({0, len(t_us), *(cut for cut in cuts if cut < len(t_us))})
    out: list[list[float]] = []
    for begin, end in pairwise(edges):
        total, count, since = sliding.feed(t_us[begin:end], rows[begin:end])
        out += [list(one) for one in zip(total[:, 0].tolist(), count.tolist(), (since / 1e6).tolist(), strict=True)]
    return out


def test_sums_by_hand() -> None:
    """Over the last second: a sample that is exactly a second old is out."""
    assert sums([0, 0.5, 0.9, 1.0, 1.5], [1, 2, 4, 8, 16]) == [
        [1, 1, 0],
        [3, 2, 0],
        [7, 3, 0],
        [14, 3, 0.5],
        [28, 3, 0.9],
    ]


def test_a_long_gap_leaves_the_sample_alone() -> None:
    """Behind a gap longer than the window there is but the new sample, since its own time."""
    assert sums([0, 5], [1, 2]) == [[1, 1, 0], [2, 1, 5]]


def test_an_empty_batch_of_sums() -> None:
    """No sample gives no sum and changes nothing."""
    sliding = SlidingSums(1.0, 2)
    nothing = np.empty(0, np.int64), np.empty((0, 2))
    assert all(len(part) == 0 for part in sliding.feed(*nothing))
    assert sliding.feed(np.array([5]), np.array([[1.0, 2.0]]))[0].tolist() == [[1.0, 2.0]]
    assert all(len(part) == 0 for part in sliding.feed(*nothing))
    assert sliding.feed(np.array([6]), np.array([[10.0, 20.0]]))[0].tolist() == [[11.0, 22.0]]


@given(
    samples=st.lists(st.tuples(st.integers(1, 900), st.floats(-1e3, 1e3)), min_size=1, max_size=60),
    cuts=st.lists(st.integers(1, 59), max_size=8),
)
def test_sums_are_cut_anywhere(samples: list[tuple[int, float]], cuts: list[int]) -> None:
    """The same bits however they are cut, and to rounding what a plain sum gives."""
    times_s = np.cumsum([step for step, _ in samples]) / 1e3
    values = [value for _, value in samples]
    found = sums(times_s.tolist(), values, cuts=cuts)
    assert found == sums(times_s.tolist(), values)
    t_us = np.round(times_s * 1e6).astype(np.int64)
    for i, (total, count, since_s) in enumerate(found):
        inside = [j for j in range(i + 1) if t_us[j] > t_us[i] - 1_000_000]
        assert total == pytest.approx(sum(values[j] for j in inside), abs=1e-6)
        assert (count, since_s) == (len(inside), t_us[inside[0]] / 1e6)


# --- order -----------------------------------------------------------------------------------------------------------


def test_what_comes_late_is_left_out() -> None:
    """Of samples those are in order that are later than all before them, and than the last of the batch before."""
    assert in_order(np.array([3, 5, 4, 5, 6]), -1).tolist() == [0, 1, 4]
    assert in_order(np.array([3, 5, 4, 5, 6]), 5).tolist() == [4]
    assert in_order(np.array([], np.int64), 5).tolist() == []


# --- usable ----------------------------------------------------------------------------------------------------------


def breaks(known: Sequence[bool], cuts: Sequence[int] = ()) -> list[tuple[int, bool]]:
    """At which sample a source became unusable, or usable again."""
    usable, found = Usable(), []
    edges = sorted({0, len(known), *cuts})
    for begin, end in pairwise(edges):
        rows = np.arange(begin, end)
        usable.follow(np.array(known[begin:end], np.bool_), rows * 1000, rows)
        assert all(one.t_boot_us == one.frame_index * 1000 for one in usable.breaks)
        found += [(one.frame_index, one.broken) for one in usable.breaks]
    return found


def test_two_hundred_in_a_row_are_unusable() -> None:
    """199 samples without meaning are patience, the 200th is not; one with a meaning ends it at once."""
    assert breaks([False] * 199 + [True]) == []
    assert breaks([False] * 300 + [True] + [False] * 200) == [(199, True), (300, False), (500, True)]
    assert breaks([False] * 150 + [True] + [False] * 150) == []


@given(
    runs=st.lists(st.tuples(st.booleans(), st.sampled_from([1, 150, 199, 200, 350])), max_size=6),
    cuts=st.lists(st.integers(1, 1000), max_size=6),
)
def test_usable_is_cut_anywhere(runs: list[tuple[bool, int]], cuts: list[int]) -> None:
    """The same moments however the samples are cut."""
    known = [flag for flag, count in runs for _ in range(count)]
    inside = [cut for cut in cuts if cut < len(known)]
    assert breaks(known, inside) == breaks(known)


# --- ratings ---------------------------------------------------------------------------------------------------------


def test_where_a_sample_is_bad_and_where_it_is_low() -> None:
    """Above the limit is bad, at 70 % of it or below is low, the limit itself is neither; each has its own."""
    value = np.array([1.0, 1.0 + 1e-9, 0.7, 0.7 + 1e-9, 1.0])
    limit = np.array([1.0, 1.0, 1.0, 1.0, 2.0])
    zeros = np.zeros(5, np.int64)
    found = rated(zeros, zeros, value, limit, AlarmSettings())
    assert found.bad.tolist() == [False, True, False, False, False]
    assert found.low.tolist() == [False, False, True, False, True]
    assert np.isnan(found.detail).all()


def test_a_value_that_is_no_number_is_neither() -> None:
    """NaN is neither bad nor low."""
    zeros = np.zeros(1, np.int64)
    found = rated(zeros, zeros, np.array([np.nan]), 1.0, AlarmSettings())
    assert (found.bad[0], found.low[0]) == (False, False)


def test_the_detail_of_two_attitudes() -> None:
    """What b is, seen from a: tilt, heading and the turn in a's axes; only where asked for."""
    a = Rotation.from_euler("ZYX", [30, 0, 0], degrees=True)
    b = a * Rotation.from_rotvec([10, 0, 0], degrees=True)
    q_a, q_b = np.tile(wxyz(a), (2, 1)), np.tile(wxyz(b), (2, 1))
    detail = np.degrees(between_attitudes(np.array([True, False]), q_a, q_b))
    assert detail[0] == pytest.approx([10, 0, 10, 0, 0], abs=1e-9)
    assert np.isnan(detail[1]).all()


def test_the_detail_of_a_vector() -> None:
    """A difference of rates has no tilt and no heading."""
    detail = along(np.array([[1.0, 2.0, 3.0]]))
    assert np.isnan(detail[0, :2]).all()
    assert detail[0, 2:].tolist() == [1, 2, 3]
