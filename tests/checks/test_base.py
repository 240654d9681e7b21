"""What checks are made of: sums over the last seconds, what is usable; by hand, and however they are cut."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.checks.base import Usable
from gcs_bridge.checks.windows import SlidingSums, new_turning, slide_in, told_by_rates
from gcs_bridge.pairing.neighbours import in_order

# --- sums ------------------------------------------------------------------------------------------------------------


def sums(
    times_s: Sequence[float], values: Sequence[float], window_s: float = 1.0, cuts: Sequence[int] = ()
) -> list[list[float]]:
    """Per sample the sum, the count, and since when, s."""
    sliding = SlidingSums(window_s, 2)
    edges = sorted({0, len(times_s), *(cut for cut in cuts if cut < len(times_s))})
    out: list[list[float]] = []
    for begin, end in pairwise(edges):
        room = sliding.room(end - begin)
        for t_s, value in zip(times_s[begin:end], values[begin:end], strict=True):
            count, since_us = slide_in(room, round(t_s * 1e6), (1.0 * value, -2.0 * value))
            assert room.sums[1] == -2.0 * room.sums[0]
            out.append([float(room.sums[0]), count, since_us / 1e6])
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


def test_room_is_made_for_what_the_window_holds() -> None:
    """However long a flight is, there is no more than some times what the last second holds, or one batch brings."""
    sliding = SlidingSums(1.0, 1)
    for t_ms in range(0, 100_000, 10):
        room = sliding.room(1)
        assert slide_in(room, 1000 * t_ms, (1.0,))[0] == min(t_ms // 10 + 1, 100) == room.sums[0]
    assert len(room.t_us) <= 400
    assert len(sliding.room(5000).t_us) <= 5400


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


# --- turning ---------------------------------------------------------------------------------------------------------


def told(speeds_deg_s: Sequence[float], gap_s: float) -> list[bool]:
    """Whether each gap between samples with these rates is told by them."""
    turning = new_turning()
    return [told_by_rates(turning, np.radians(a), np.radians(b), gap_s) for a, b in pairwise(speeds_deg_s)]


def test_a_gap_that_may_turn_far_is_not_told_by_rates() -> None:
    """At 5 Hz 20° a gap is 100 °/s, at either end of it; at 10 Hz and above 45° may be, which is 450 °/s."""
    assert told([0, 99, 101, 101], 0.2) == [True, False, False]
    assert told([0, 449, 451], 0.1) == [True, False]
    assert told([0, 101, 0], 0.2) == [False, False]


def test_a_fast_turn_is_remembered_for_four_gaps() -> None:
    """It ends with the second gap: the four behind that one may still hide one, the fifth does not."""
    assert told([0, 300, 0, 0, 0, 0, 0, 0], 0.2) == [False] * 6 + [True]


def test_unknown_rates_tell_nothing() -> None:
    """One end that is known is enough; with none of both known nothing is told, for four more gaps."""
    nan = np.nan
    assert told([1, nan, 1], 0.2) == [True, True]
    assert told([1, nan, nan, 1, 1, 1, 1, 1], 0.2) == [True] + [False] * 5 + [True]


# --- order -----------------------------------------------------------------------------------------------------------


def test_what_comes_late_is_left_out() -> None:
    """Of samples those are in order that are later than all before them, and than the last of the batch before."""
    assert in_order(np.array([3, 5, 4, 5, 6]), -1).tolist() == [0, 1, 4]
    assert in_order(np.array([3, 5, 4, 5, 6]), 5).tolist() == [4]
    assert in_order(np.array([], np.int64), 5).tolist() == []


# --- usable ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("zeros", "broken"), [(50, True), (49, False)])
def test_an_imu_of_zeros_is_unusable(zeros: int, broken: bool) -> None:
    """Fifty samples in a row that are zeros, the force included; a gyro of zeros beside a force is one at rest."""
    usable, rows = Usable(), np.arange(zeros)
    usable.follow(np.zeros((zeros, 3)), np.full((zeros, 3), 9.8), rows, rows)
    assert not usable.breaks
    usable.follow(np.zeros((zeros, 3)), np.zeros((zeros, 3)), rows, rows)
    assert usable.broken is broken
    usable.follow(np.ones((1, 3)), np.ones((1, 3)), rows[:1], rows[:1])
    assert not usable.broken


def breaks(known: Sequence[bool], cuts: Sequence[int] = ()) -> list[tuple[int, bool]]:
    """At which sample a source became unusable, or usable again."""
    usable, found = Usable(), []
    edges = sorted({0, len(known), *cuts})
    for begin, end in pairwise(edges):
        rows = np.arange(begin, end)
        numbers = np.where(np.array(known[begin:end], np.bool_), 1.0, np.nan)[:, None]
        usable.follow(numbers, np.ones((len(rows), 3)), rows * 1000, rows)
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
