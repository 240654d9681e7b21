"""How many times slower than usual a stream comes: by the median of its own windows without a silence or what slows it.

A rate that somebody asked for is the usual one from then on.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_bridge.checks.stream_silence import is_slowed
from gcs_bridge.jit import helper

WINDOWS = 24  # of the own rate, whose median is the usual one
_LEAST_WINDOWS = 3


@helper
def take_request(stream: Any, vehicle: Any, rate_hz: Any) -> Any:
    """Somebody asked for another rate, NaN: it is not known which; what was usual is learned anew."""
    usual = _usual(stream) if stream.windows >= _LEAST_WINDOWS else stream.asked_count
    asked = rate_hz * vehicle.slow_after_us * 1e-6
    stream.asked_count = asked if 0.0 < asked < usual else 0.0
    stream.asked_period_us = 1e6 / rate_hz if rate_hz > 0.0 else 0.0
    stream.windows = stream.count = stream.silent = 0
    stream.window_us, stream.slowed = stream.latest_us, is_slowed(vehicle)


@helper
def _usual(stream: Any) -> Any:
    """The median of the last windows' counts."""
    n = min(stream.windows, WINDOWS)
    total = 0
    for one in range(n):
        below = 0  # how many come before it in ascending order
        for other in range(n):
            less = stream.counts[other] < stream.counts[one]
            below += less or (stream.counts[other] == stream.counts[one] and other < one)
        if below == (n - 1) // 2:
            total += stream.counts[one]
        if below == n // 2:
            total += stream.counts[one]
    return 0.5 * total


@helper
def times_slower(stream: Any, vehicle: Any, t_us: Any) -> Any:
    """At the end of a window without a silence, how many times slower than usual the stream came; else NaN."""
    if stream.frame_index < 0:
        stream.latest_us = stream.window_us = t_us
    silent = t_us - stream.latest_us > vehicle.stale_after_us
    stream.latest_us = max(stream.latest_us, t_us)
    stream.silent |= silent
    slower = np.nan
    if stream.latest_us >= stream.window_us + vehicle.slow_after_us:
        if not stream.silent and not stream.slowed:
            usual = _usual(stream) if stream.windows >= _LEAST_WINDOWS else stream.asked_count
            if usual > 0.0:
                slower = 1.0 / max(stream.count / max(usual, 1.0), 1e-3)
            stream.counts[stream.windows % WINDOWS] = stream.count
            stream.windows += 1
        stream.window_us, stream.count, stream.slowed = stream.latest_us, 0, is_slowed(vehicle)
        stream.silent = silent
    stream.count += 1
    return slower
