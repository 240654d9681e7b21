"""The receive time of a link, frame by frame: it does not run back with single record times. It knows no vehicle."""

from __future__ import annotations

from typing import NamedTuple

from gcs_bridge.columns import Int64s
from gcs_bridge.jit import helper

SET_BACK_US = 10_000_000
NEVER_US = 2**62  # a deadline that does not come


class LinkClock(NamedTuple):
    """The receive time of a link, frame by frame: consecutive indices (n,), and the latest receive time (n,), µs."""

    frame_index: Int64s
    latest_rx_us: Int64s

    def at(self, frame_index: int) -> int:
        """The receive time at a frame of this batch."""
        return int(self.latest_rx_us[frame_index - int(self.frame_index[0])])


@helper
def pass_time(latest_us, t_rx_us):  # type: ignore[no-untyped-def]  # typed by numba
    """The receive time so far: record times that run back a little don't turn it back, a clock set back does."""
    return t_rx_us if latest_us - t_rx_us > SET_BACK_US else max(latest_us, t_rx_us)


@helper
def first_beyond(latest_rx_us, since, until, limit_us):  # type: ignore[no-untyped-def]  # typed by numba
    """The first of the rows from `since` up to, and without, `until` whose time is beyond a limit; `until`: none is."""
    if until <= since or latest_rx_us[until - 1] <= limit_us:
        return until
    row = since
    while latest_rx_us[row] <= limit_us:
        row += 1
    return row
