"""Quantiles in bounded memory, against sorting the numbers."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.checks.quantiles import Quantiles
from tests.helpers.everyday import searched


def nearest_rank(values: np.ndarray, share: float) -> float:
    """The value that `share` of the numbers do not exceed, by sorting."""
    return float(np.sort(values)[max(math.ceil(share * len(values)), 1) - 1])


def collected(values: np.ndarray, cuts: list[int] | None = None) -> Quantiles:
    quantiles = Quantiles()
    for part in np.split(values, sorted(cuts or [])):
        quantiles.add(part)
    return quantiles


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 180.0, 9000.0])
@pytest.mark.parametrize("shape", ["uniform", "lognormal"])
def test_quantiles_are_within_a_thousandth_of_a_number_that_came(scale: float, shape: str) -> None:
    """From nanoradians to thousands of degrees: median, p95 and p99 of 5000 numbers, and the largest exactly."""
    dice = np.random.default_rng(3)
    values = scale * (dice.random(5000) if shape == "uniform" else np.clip(dice.lognormal(-7, 2, 5000), 0, 1))
    summary = collected(values).summary()
    for name, share in (("median", 0.5), ("p95", 0.95), ("p99", 0.99)):
        assert summary[name] == pytest.approx(nearest_rank(values, share), rel=1.1e-3)
    assert summary["max"] == values.max()


def test_a_few_numbers_have_the_quantiles_that_one_counts_on_fingers() -> None:
    """Of 1, 2, 3, 4: the median (nearest rank) is 2, p95 and p99 are 4; of one number it is that number."""
    assert collected(np.array([4.0, 1.0, 3.0, 2.0])).summary() == pytest.approx(
        {"median": 2, "p95": 4, "p99": 4, "max": 4}, rel=1e-3
    )
    assert collected(np.array([0.25])).summary() == {"median": 0.25, "p95": 0.25, "p99": 0.25, "max": 0.25}


def test_exact_agreement_is_an_exact_zero() -> None:
    """A residual of zero is shown as zero, not as the smallest bin."""
    assert collected(np.zeros(100)).summary() == {"median": 0, "p95": 0, "p99": 0, "max": 0}
    assert collected(np.array([0.0] * 96 + [1.0] * 4)).summary() == {"median": 0, "p95": 0, "p99": 1, "max": 1}


def test_nothing_has_no_quantiles() -> None:
    """NaN, never 0, for what was not measured; headings without a meaning are not counted."""
    for nothing in (np.empty(0), np.full(5, np.nan)):
        quantiles = collected(nothing)
        assert quantiles.count == 0
        assert all(math.isnan(value) for value in quantiles.summary().values())
    mixed = collected(np.array([np.nan, 2.0, np.nan]))
    assert (mixed.count, mixed.max, mixed.quantile(0.5)) == (1, 2.0, 2.0)


def test_a_summary_in_another_unit_is_scaled() -> None:
    """Radians in, degrees out."""
    assert collected(np.full(9, math.pi)).summary(math.degrees(1.0))["median"] == pytest.approx(180.0, rel=1e-12)


@pytest.mark.slow
@searched(100)
@given(
    st.lists(st.floats(0, 1e4, allow_nan=False) | st.just(math.nan), max_size=50),
    st.lists(st.integers(0, 50), max_size=8),
)
def test_the_cut_changes_no_bit(numbers: list[float], cuts: list[int]) -> None:
    """The same numbers in any pieces give the same summary, bit for bit, and quantiles in order, up to the maximum."""
    values = np.array(numbers, np.float64)
    whole, pieces = collected(values), collected(values, cuts)
    assert np.array(list(whole.summary().values())).tobytes() == np.array(list(pieces.summary().values())).tobytes()
    if whole.count:
        at = [whole.quantile(share) for share in (0.1, 0.5, 0.9, 1.0)]
        assert all(a <= b for a, b in zip([*at], [*at[1:], whole.max], strict=True))


def test_bins_are_kept_as_they_are_needed() -> None:
    """A number or two take some kB, and not the 590 kB of all bins; numbers everywhere find them all."""
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    few = collected(np.array([1e-6, 0.3]))
    used = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert few.max == 0.3
    assert used < 20_000
    everywhere = np.concatenate((np.logspace(-12, 4, 5000)[::-1], [0.0], np.logspace(-3, 0, 5000)))
    for share in (0.0, 0.2, 0.5, 0.999, 1.0):
        assert collected(everywhere).quantile(share) == pytest.approx(nearest_rank(everywhere, share), rel=1.1e-3)
