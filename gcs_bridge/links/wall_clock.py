"""The wall clock, by which receive times are told, and whether somebody has set it.

People look for a recording by its date, so receive times follow the wall clock, also where it is set while the program
runs: a companion computer learns the time minutes after its start. How much time has passed is known by the monotonic
clock, which nobody sets, and which stands still while the machine is suspended.
"""

from __future__ import annotations

import time

__all__ = ["WallClock", "now_us"]

# What the two clocks go apart between two looks; less is the look's own doing, or a clock that is nudged.
_STEP_US = 100_000
_AT_ONCE_NS = 1_000_000  # so long a look at both may take, to be one


def now_us() -> int:
    """The wall clock, µs since 1970."""
    return time.time_ns() // 1000


class WallClock:
    """Looks whether the wall clock was set."""

    def __init__(self) -> None:
        """Look for the first time."""
        self._ahead_us = _ahead_us()

    def step_us(self) -> int:
        """By how much it was set forward, or back where negative, since the last look, µs; 0: it was not."""
        before, self._ahead_us = self._ahead_us, _ahead_us()
        step_us = self._ahead_us - before
        return step_us if abs(step_us) > _STEP_US else 0


def _ahead_us() -> int:
    """By how much the wall clock is ahead of the monotonic one, µs."""
    for _ in range(10):
        before_ns, wall_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if after_ns - before_ns < _AT_ONCE_NS:  # else others had the processor in between
            break
    return (wall_ns - (before_ns + after_ns) // 2) // 1000
