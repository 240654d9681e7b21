"""What of a heavy family of cases is for every day, what for CI alone."""

from collections.abc import Iterable, Sequence
from typing import Any

import hypothesis
import pytest

ALL_CASES = 100
"""How many cases Hypothesis tries by itself; tests/conftest.py says when it tries fewer."""


def one_in(n: int, cases: Iterable[Any], *, swept: bool = True) -> list[Any]:
    """All cases, for `parametrize`; of `n` one is for every day, the rest a sweep. A tuple is one value a parameter.

    Where each of the rest shows something else it is not `swept`, but slow alone.
    """
    rest = [pytest.mark.slow, pytest.mark.sweep] if swept else [pytest.mark.slow]
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=rest if i % n else [])
        for i, case in enumerate(cases)
    ]


def in_turns(rounds: int, *axes: Sequence[Any]) -> list[tuple[Any, ...]]:
    """Cases in which each value of each axis comes `rounds` times at least, with another of the others each time.

    Where all combinations would show little more: three axes of five values are 125 cases, in two rounds ten.
    """
    longest = max(map(len, axes))
    return list(
        dict.fromkeys(
            tuple(axis[(case + turn * place) % len(axis)] for place, axis in enumerate(axes))
            for turn in range(rounds)
            for case in range(longest)
        )
    )


def searched(cases: int, **more: Any) -> hypothesis.settings:
    """For a test of Hypothesis: so many cases where sweeps are run, elsewhere the share of them that others have."""
    share = hypothesis.settings().max_examples / ALL_CASES
    return hypothesis.settings(max_examples=max(1, round(cases * share)), **more)
