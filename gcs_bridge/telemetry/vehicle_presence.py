"""Whether a vehicle is there at all: lost when nothing of it came for some seconds, by the clock of its link.

A heartbeat comes once a second; a vehicle counts as lost after four to five missed ones (mavlink.io,
services/heartbeat.html).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Int64s
from gcs_bridge.telemetry.link_clock import LinkClock

LOST_AFTER_US = 5_000_000


class PresenceChange(NamedTuple):
    """The vehicle was lost, or is back: since `t_rx_us`, told by the frame `frame_index` of its link."""

    frame_index: int
    lost: bool
    t_rx_us: int


class Presence:
    """Of one vehicle on one link."""

    def __init__(self) -> None:
        """Start before its first frame."""
        self._heard_us = -1
        self._lost = False

    def take(self, frame_indices: Int64s, link: LinkClock) -> Iterator[PresenceChange]:
        """Follow the next frames of the link, of which `frame_indices` are the vehicle's; yield each change."""
        clock_us = link.latest_rx_us
        if (
            len(frame_indices)
            and not self._lost
            and clock_us[-1] - self._heard_us <= LOST_AFTER_US
            and self._heard_us >= 0
        ):
            self._heard_us = int(clock_us[frame_indices[-1] - link.frame_index[0]])  # the common case
            return
        own = frame_indices - link.frame_index[0]
        heard_us = np.concatenate(([self._heard_us], clock_us[own]))
        until = np.concatenate((own, [len(clock_us) - 1]))
        silent = (heard_us >= 0) & (clock_us[until] - heard_us > LOST_AFTER_US)
        silent[0] |= self._lost
        for row in np.flatnonzero(silent).tolist():
            if not self._lost:
                start = int(own[row - 1]) + 1 if row else 0
                passed = clock_us[start : until[row] + 1] - heard_us[row] > LOST_AFTER_US
                self._lost = True
                yield PresenceChange(
                    int(link.frame_index[start + np.argmax(passed)]), True, int(heard_us[row]) + LOST_AFTER_US
                )
            if row < len(own):
                self._lost = False
                yield PresenceChange(int(frame_indices[row]), False, int(clock_us[own[row]]))
        self._heard_us = int(heard_us[-1])
