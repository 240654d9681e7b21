"""What of a heavy family of cases is for every day, and what for the whole run alone."""

from collections.abc import Iterable
from typing import Any

import pytest


def one_in(n: int, cases: Iterable[Any]) -> list[Any]:
    """All cases, for `parametrize`; one of `n` is not slow."""
    slow = pytest.mark.slow
    return [
        case if i % n == 0 else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=slow)
        for i, case in enumerate(cases)
    ]
