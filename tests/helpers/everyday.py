"""What of a heavy family of cases is for every day, and what for the whole run alone."""

from collections.abc import Iterable
from typing import Any

import pytest


def one_in(n: int, cases: Iterable[Any]) -> list[Any]:
    """All cases, for `parametrize`; one of `n` is not slow. A tuple is one value a parameter."""
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=[pytest.mark.slow] if i % n else [])
        for i, case in enumerate(cases)
    ]
