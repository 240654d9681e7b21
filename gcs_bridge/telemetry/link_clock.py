"""The receive time of a link, frame by frame: it does not run back with single record times. It knows no vehicle.

Beside it runs the time in which the link was heard. Where nothing at all comes, of nobody, it may be that nobody
spoke, or that nobody listened: a suspended receiver looks the same. So a silence of everything counts for little, and
what the vehicles' own clocks say of it decides. Time that is known to have passed, as on a live link that is waited
for, counts whole.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from gcs_bridge.columns import Int64s
from gcs_bridge.jit import helper

SET_BACK_US = 10_000_000
NEVER_US = 2**62  # a deadline that does not come
# So much of a silence of everything counts as heard: more than lies between the heartbeats of one vehicle or station
# that sends nothing else, and less than makes a stream stale where a receiver was suspended.
HEARD_US = 1_500_000


class LinkClock(NamedTuple):
    """The receive time of a link, frame by frame.

    Consecutive indices (n,); the latest receive time (n,), µs; the time in which the link was heard (n,), µs, which
    runs as receive time does and stands still where nothing comes.
    """

    frame_index: Int64s
    latest_rx_us: Int64s
    heard_us: Int64s

    def at(self, frame_index: int) -> int:
        """The receive time at a frame of this batch."""
        return int(self.latest_rx_us[frame_index - int(self.frame_index[0])])


@helper
def pass_time(latest_us: Any, t_rx_us: Any) -> Any:
    """The receive time so far: record times that run back a little don't turn it back, a clock set back does."""
    return t_rx_us if latest_us - t_rx_us > SET_BACK_US else max(latest_us, t_rx_us)


@helper
def heard_between(latest_us: Any, t_rx_us: Any) -> Any:
    """How long the link was heard from one receive time to the next."""
    return min(max(t_rx_us - latest_us, 0), HEARD_US) if latest_us >= 0 else 0


@helper
def first_beyond(times_us: Any, since: Any, until: Any, limit_us: Any) -> Any:
    """The first of the rows from `since` up to, and without, `until` whose time is beyond a limit; `until`: none is."""
    if until <= since or times_us[until - 1] <= limit_us:
        return until
    row = since
    while times_us[row] <= limit_us:
        row += 1
    return row
