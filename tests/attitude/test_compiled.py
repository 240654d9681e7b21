"""What kernels follow is what the functions for whole columns tell, bit for bit."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from gcs_bridge import attitude
from gcs_bridge.attitude.compiled import REST, is_at_rest, new_rest, vector_at
from gcs_bridge.columns import FloatRows, Floats, Mask, Records
from gcs_bridge.jit import kernel


@kernel
def follow_rest(
    rest: Annotated[Records, REST], t_s: Floats, f_b: FloatRows, w: FloatRows, may_rest: Mask, resting: Mask
) -> None:
    """Fill where the vehicle is known to rest."""
    for i in range(t_s.size):
        resting[i] = is_at_rest(rest[0], t_s[i], vector_at(f_b, i), vector_at(w, i), may_rest[i])


G = attitude.G_M_S2
QUIET = (0.5, G, 0.0, True)  # the time since the sample before, s; force, m/s²; rate, rad/s; whether it may rest
OTHERS = [
    (0.5, G + 0.29, np.radians(2.8), True),
    *((0.5, force, 0.0, True) for force in (G + 0.31, G - 0.31, 0.0, np.nan, np.inf, 1e80)),
    *((0.5, G, rate, True) for rate in (np.radians(3.0), np.nan, 1e80)),
    (0.5, G, 0.0, False),
    *((step_s, G, 0.0, True) for step_s in (1.0, 1.001, 0.0, -0.5, 7.0, np.nan)),
]
runs = st.lists(
    st.one_of(st.integers(1, 12).map(lambda n: [QUIET] * n), st.sampled_from(OTHERS).map(lambda one: [one])),
    max_size=20,
)


@example(runs=[[QUIET] * 12, [(-0.5, G, 0.0, True)], [QUIET]], cuts=[])
@example(runs=[[QUIET] * 12, [(1.001, G, 0.0, True)], [QUIET] * 8, [(0.5, G, 0.0, False)], [QUIET]], cuts=[12, 16])
@given(runs=runs, cuts=st.lists(st.integers(0, 100), max_size=6).map(sorted))
def test_rest(runs: Sequence[Sequence[tuple[float, float, float, bool]]], cuts: Sequence[int]) -> None:
    """A vehicle that is quiet for some time and then is not, with gaps, late samples, and such that mean nothing."""
    samples, now_s = [one for run in runs for one in run], 100.0
    n = len(samples)
    t_s = np.empty(n)
    for i, (step_s, *_) in enumerate(samples):
        t_s[i] = now_s + step_s
        now_s = now_s if np.isnan(step_s) else t_s[i]
    f_b, w = np.zeros((n, 3)), np.zeros((n, 3))
    f_b[:, 2] = [-force for _, force, _, _ in samples]
    w[:, 1] = [rate for _, _, rate, _ in samples]
    may_rest = np.array([may for *_, may in samples], np.bool_)
    found, rest, watch = np.empty(n, np.bool_), new_rest(), attitude.RestWatch()
    for begin, end in pairwise([0, *(min(cut, n) for cut in cuts), n]):
        part = slice(begin, end)
        follow_rest(rest, t_s[part], f_b[part], w[part], may_rest[part], found[part])
        assert found[part].tolist() == watch.feed(t_s[part], f_b[part], w[part], may_rest[part]).tolist()


def test_rest_after_three_seconds() -> None:
    """Four samples of rest within 3 s, and a fifth that is known to be one."""
    resting = np.empty(5, np.bool_)
    follow_rest(
        new_rest(), np.arange(5.0) * 0.75, np.tile([0, 0, -G], (5, 1)), np.zeros((5, 3)), np.ones(5, np.bool_), resting
    )
    assert resting.tolist() == [False] * 4 + [True]
