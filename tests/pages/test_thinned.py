"""Curves of bounded length: no peak is lost, whatever the length and however they came."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from gcs_bridge.pages.thinned import Thinned
from tests.helpers.everyday import searched


def test_few_rows_stay_as_they_are() -> None:
    """To the last bit."""
    t_us, values = np.arange(500) * 20_000, np.random.default_rng(1).normal(size=(500, 3))
    curves = Thinned(3)
    curves.take(t_us, values)
    np.testing.assert_array_equal(curves.rows()[0], t_us)
    np.testing.assert_array_equal(curves.rows()[1], values)


@pytest.mark.slow
@searched(20)
@given(st.integers(0, 2**32), st.integers(20_000, 200_000), st.integers(100, 20_000))
def test_no_peak_is_lost_and_the_length_is_bounded(seed: int, n: int, piece: int) -> None:
    """Beside each row that is left out, within a 300th of the time, stay one that is as high and one that is as low."""
    random = np.random.default_rng(seed)
    values = random.normal(size=(n, 2)) ** 3
    t_us = np.arange(n) * 20_000
    curves = Thinned(2)
    for start in range(0, n, piece):
        curves.take(t_us[start : start + piece], values[start : start + piece])
    kept_us, kept = curves.rows()
    assert len(kept_us) <= 15_000
    assert (np.diff(kept_us) > 0).all()
    rows = np.searchsorted(t_us, kept_us)
    np.testing.assert_array_equal(kept, values[rows])  # each is one that came, with its own time
    least, most, beside = np.full((n, 2), np.inf), np.full((n, 2), -np.inf), 2 * (n // 300) + 1
    least[rows] = most[rows] = kept
    assert (minimum_filter1d(least, beside, axis=0) <= values).all()
    assert (maximum_filter1d(most, beside, axis=0) >= values).all()


def test_a_spike_of_one_sample_in_an_hour_is_there() -> None:
    """One of 180,000 rows."""
    values = np.zeros((180_000, 4))
    values[123_456, 2] = 90.0
    curves = Thinned(4)
    curves.take(np.arange(180_000) * 20_000, values)
    t_us, kept = curves.rows()
    assert t_us[np.argmax(kept[:, 2])] == 123_456 * 20_000
    assert kept[:, 2].max() == 90.0


def test_a_gap_is_one_however_thin_the_curve_is() -> None:
    """A row of nothing stands before what comes behind it."""
    t_us = np.concatenate((np.arange(90_000) * 20_000, 3_600_000_000 + np.arange(90_000) * 20_000))
    curves = Thinned(1)
    curves.take(t_us, np.ones((len(t_us), 1)))
    kept_us, kept = curves.rows()
    (at,) = np.flatnonzero(np.isnan(kept[:, 0]))
    assert kept_us[at + 1] == 3_600_000_000


def test_times_that_go_back_are_left_out() -> None:
    """A curve cannot be drawn backwards."""
    curves = Thinned(1)
    curves.take(np.array([10, 20, 15, 30]), np.array([[1.0], [2.0], [3.0], [4.0]]))
    curves.take(np.array([25, 40]), np.array([[5.0], [6.0]]))
    assert curves.rows()[0].tolist() == [10, 20, 30, 40]


@pytest.mark.parametrize("n", [0, 1])
def test_nothing_and_hardly_anything(n: int) -> None:
    """No row, and one."""
    curves = Thinned(2)
    curves.take(np.arange(n), np.ones((n, 2)))
    assert len(curves.rows()[0]) == n
