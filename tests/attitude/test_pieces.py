"""Rest and dead reckoning with carried state: samples that come piece by piece."""

import numpy as np
import pytest

from gcs_bridge import attitude
from tests.helpers.attitude_cases import Array
from tests.helpers.everyday import one_in

G = attitude.G_M_S2


def pieces(n: int, rng: np.random.Generator) -> list[slice]:
    """Slices that cut n rows at random, empty ones and single rows among them."""
    cuts = np.sort(rng.integers(0, n + 1, size=rng.integers(1, n)))
    return [slice(a, b) for a, b in zip([0, *cuts], [*cuts, n], strict=True)]


def flight(rng: np.random.Generator, n: int = 600) -> tuple[Array, Array, Array, Array]:
    """Rest, motion and rest again at 10 Hz or so, with doubled and late times, a gap and rows of no meaning."""
    t = np.cumsum(rng.choice([0.0, 0.05, 0.1, 0.2], size=n))
    t[5 * n // 12 :] += 1.5
    moving = (np.arange(n) // 100) % 2 == 1
    f = np.array([0, 0, -G]) + rng.normal(scale=np.where(moving, 3.0, 0.03)[:, None], size=(n, 3))
    w = rng.normal(scale=np.where(moving, 0.3, 0.003)[:, None], size=(n, 3))
    q = np.array([1.0, 0, 0, 0]) + rng.normal(scale=0.01, size=(n, 4))
    for rows in (f, w, q, t):
        rows[rng.integers(n, size=5)] = np.nan
    late = rng.integers(1, n, size=5)
    t[late] -= 0.5
    return t, q, f, w


def reckon(t: Array, q: Array, f: Array, w: Array, slices: list[slice]) -> Array:
    """Rest and motion of rows fed piece by piece, as one array."""
    watch, reckoner, rows = attitude.RestWatch(), attitude.DeadReckoner(), []
    for of in slices:
        resting = watch.feed(t[of], f[of], w[of], attitude.may_stand_still(q[of], f[of]))
        motion = reckoner.feed(t[of], q[of], f[of], resting)
        rows.append(np.column_stack((resting, *motion)))
    return np.concatenate(rows)


@pytest.mark.parametrize("seed", one_in(10, range(20)))
def test_pieces_give_what_the_whole_gives(seed: int) -> None:
    """Rest, motion and bounds are the same bit for bit, however the samples were cut."""
    rng = np.random.default_rng(seed)
    rows = flight(rng)
    whole = reckon(*rows, [slice(None)])
    cut = reckon(*rows, pieces(len(rows[0]), rng))
    assert np.array_equal(whole, cut, equal_nan=True)
    assert 0 < np.nansum(whole[:, 0]) < len(whole) - 200


def test_a_late_row_is_passed_over() -> None:
    """A row older than one before it is not known, and all the others are as if it had never come."""
    t = np.arange(60) / 10
    f, w, q = np.tile([0.1, 0, -G], (60, 1)), np.zeros((60, 3)), np.tile([1.0, 0, 0, 0], (60, 1))
    f[45:, 0] = 2.0
    without = reckon(t, q, f, w, [slice(None)])
    t, q, f, w = (np.insert(rows, 50, rows[20], axis=0) for rows in (t, q, f, w))
    found = reckon(t, q, f, w, [slice(None)])
    assert not found[50, 0]
    assert np.isnan(found[50, 1:]).all()
    assert np.array_equal(np.delete(found, 50, axis=0), without)
    assert without[44, 0] == 1  # rest before, motion after
    assert without[59, 1] == pytest.approx(0.5 * (0.1 + 2.0) * 0.1 + 14 * 0.2)


def test_rest_leaves_damage_behind() -> None:
    """An absurd force that a damaged message made is gone with the next rest: what follows has all its digits."""
    t = np.arange(90) / 10
    f, w, q = np.tile([0.0, 0, -G], (90, 1)), np.zeros((90, 3)), np.tile([1.0, 0, 0, 0], (90, 1))
    f[5] = 1e30
    f[80:, 0] = 2.0
    found = reckon(t, q, f, w, [slice(i, i + 1) for i in range(90)])
    assert found[79, 0] == 1
    assert found[89, 1] == pytest.approx(0.1 + 9 * 0.2)
    assert found[89, 7] == pytest.approx(0.3 * 1.0)
