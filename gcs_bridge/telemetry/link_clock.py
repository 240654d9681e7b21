"""The receive time of a link, frame by frame: it does not run back with single record times. It knows no vehicle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Int64s


class LinkClock(NamedTuple):
    """The receive time of a link, frame by frame: consecutive indices (n,), and the latest receive time (n,), µs."""

    frame_index: Int64s
    latest_rx_us: Int64s

    def at(self, frame_index: int) -> int:
        """The receive time at a frame of this batch."""
        return int(self.latest_rx_us[frame_index - int(self.frame_index[0])])


def latest_rx(t_rx_us: Int64s, latest_us: int) -> Int64s:
    """The receive time so far, µs: record times that run back a little don't turn it back, a clock set back does."""
    latest = np.maximum(np.maximum.accumulate(t_rx_us), latest_us)
    for restart in np.flatnonzero(latest - t_rx_us > SET_BACK_US):
        if latest[restart] - t_rx_us[restart] > SET_BACK_US:
            latest[restart:] = np.maximum.accumulate(t_rx_us[restart:])
    return latest


SET_BACK_US = 10_000_000
