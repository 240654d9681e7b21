"""How often each stream comes, and so which is the slower one: each of its samples is worth one pair."""

from __future__ import annotations

from typing import Any

from gcs_bridge.jit import helper
from gcs_bridge.pairing.state import BLOCK, EULER, INTERVALS, LATEST, PERIOD, QUATERNION, RX_PERIOD, RX_START, UNKNOWN

_FIRST_BLOCK = 8
_FASTER = 1.25  # ratio of periods from which a stream counts as the slower one


@helper
def _median(values: Any, n: Any) -> Any:
    """The lower median of the first `n` values, which it sorts: they are few."""
    for i in range(1, n):
        value = values[i]
        j = i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return values[(n - 1) // 2]


@helper
def follow_period(state: Any, k: Any, t: Any, t_rx: Any) -> Any:
    """Take the interval before a sample into the running estimate of its stream's period: the median of a block."""
    of = state.of[k]
    if of[LATEST] == UNKNOWN:
        of[RX_START] = t_rx
        return
    n = of[INTERVALS]
    state.interval[k, n] = t - of[LATEST]
    n += 1
    if n == BLOCK or (n == _FIRST_BLOCK and of[PERIOD] == UNKNOWN):
        of[PERIOD] = _median(state.interval[k], n)
    if n == BLOCK:
        if t_rx >= 0:
            of[RX_PERIOD] = max((t_rx - of[RX_START]) // n, 0)
        of[RX_START] = t_rx
        n = 0
    of[INTERVALS] = n


@helper
def decide_slower(state: Any) -> Any:
    """Which stream is the slower one, once both periods are known; it changes only with a clear ratio."""
    euler, quaternion = state.of[0, PERIOD], state.of[1, PERIOD]
    if euler == UNKNOWN or quaternion == UNKNOWN:
        return
    if euler > _FASTER * quaternion:
        state.slower[0] = EULER
    elif quaternion > _FASTER * euler or state.slower[0] == UNKNOWN:
        # At equal rates firmwares send ATTITUDE first, so its partner is there when the quaternion comes.
        state.slower[0] = QUATERNION
