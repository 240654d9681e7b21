"""What kernels follow is what the functions for whole columns tell, bit for bit."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_bridge import attitude
from gcs_bridge.attitude.compiled import is_at_rest, new_rest, vector_at
from gcs_bridge.columns import Floats, Mask, Records
from gcs_bridge.jit import kernel


@kernel
def follow_rest(rest: Records, t_s: Floats, f_b: Floats, w: Floats, may_rest: Mask, resting: Mask) -> None:
    """Fill where the vehicle is known to rest."""
    for i in range(t_s.size):
        resting[i] = is_at_rest(rest[0], t_s[i], vector_at(f_b, i), vector_at(w, i), may_rest[i])


G = attitude.G_M_S2
FORCES = [G, G, G, G + 0.29, G + 0.31, G - 0.31, 0.0, np.nan, np.inf, 1e80]
RATES = [0.0, 0.0, 0.0, np.radians(2.8), np.radians(3.0), np.nan, 1e80]
STEPS_S = [0.5, 0.5, 0.5, 1.0, 1.001, 0.0, -0.5, 7.0, np.nan]

samples = st.lists(
    st.tuples(*(st.sampled_from(of) for of in (STEPS_S, FORCES, RATES, [True, True, True, False]))), max_size=60
)


@settings(deadline=None)  # the first one compiles
@given(samples=samples, cuts=st.lists(st.integers(0, 60), max_size=6).map(sorted))
def test_rest(samples: Sequence[tuple[float, float, float, bool]], cuts: Sequence[int]) -> None:
    """A vehicle that is quiet for some time and then is not, with gaps, late samples, and such that mean nothing."""
    n, now_s = len(samples), 100.0
    t_s = np.empty(n)
    for i, (step_s, *_) in enumerate(samples):
        t_s[i] = now_s + step_s
        now_s = now_s if np.isnan(step_s) else t_s[i]
    f_b, w = np.zeros((n, 3)), np.zeros((n, 3))
    f_b[:, 2] = [-force for _, force, _, _ in samples]
    w[:, 1] = [rate for _, _, rate, _ in samples]
    may_rest = np.array([may for *_, may in samples], np.bool_)
    whole, rest, watch = np.empty(n, np.bool_), new_rest(), attitude.RestWatch()
    for begin, end in pairwise([0, *(min(cut, n) for cut in cuts), n]):
        part = slice(begin, end)
        follow_rest(rest, t_s[part], f_b[part], w[part], may_rest[part], whole[part])
        assert whole[part].tolist() == watch.feed(t_s[part], f_b[part], w[part], may_rest[part]).tolist()


def test_rest_after_three_seconds() -> None:
    """Four samples of rest within 3 s, and a fifth that is known to be one."""
    resting = np.empty(5, np.bool_)
    follow_rest(
        new_rest(), np.arange(5.0) * 0.75, np.tile([0, 0, -G], (5, 1)), np.zeros((5, 3)), np.ones(5, np.bool_), resting
    )
    assert resting.tolist() == [False] * 4 + [True]
