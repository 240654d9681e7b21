"""Whether a vehicle is there at all: lost when nothing of it came for some seconds, by the clock of its link.

A heartbeat comes once a second; a vehicle counts as lost after four to five missed ones (mavlink.io,
services/heartbeat.html).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s
from gcs_bridge.jit import kernel
from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock, first_beyond

LOST_AFTER_US = 5_000_000
_ROOM = 16  # changes that there is room for in one call


class PresenceChange(NamedTuple):
    """The vehicle was lost, or is back: since `t_rx_us`, told by the frame `frame_index` of its link."""

    frame_index: int
    lost: bool
    t_rx_us: int


_PRESENCE = np.dtype([("heard_us", "i8"), ("lost", "?")])


@kernel
def _take(
    presence: npt.NDArray[np.void], own: Int64s, begin: int, first: int, latest_rx_us: Int64s, changes: Int64s
) -> tuple[int, int]:
    """Follow the vehicle's frames `own` from `begin` on, and the link's to their end, as long as there is room.

    `latest_rx_us` of the link's frames from the index `first` on. Return how far, and how many changes there are.
    """
    of, n = presence[0], 0
    since = own[begin - 1] + 1 - first if begin else 0
    for i in range(begin, own.size + 1):
        if n > _ROOM - 2:
            return i, n
        until = own[i] + 1 - first if i < own.size else latest_rx_us.size
        if of.heard_us >= 0 and not of.lost:
            row = first_beyond(latest_rx_us, since, until, of.heard_us + LOST_AFTER_US)
            if row < until:
                of.lost = True
                changes[n, 0], changes[n, 1], changes[n, 2] = first + row, 1, of.heard_us + LOST_AFTER_US
                n += 1
        if i < own.size:
            of.heard_us = latest_rx_us[until - 1]
            if of.lost:
                of.lost = False
                changes[n, 0], changes[n, 1], changes[n, 2] = own[i], 0, of.heard_us
                n += 1
        since = until
    return own.size + 1, n


class Presence:
    """Of one vehicle on one link."""

    def __init__(self) -> None:
        """Start before its first frame."""
        self._state = np.zeros(1, _PRESENCE)
        self._state["heard_us"] = -1

    @property
    def due_us(self) -> int:
        """The receive time of the link from which on it is lost, if nothing of it comes."""
        heard_us = int(self._state["heard_us"][0])
        return NEVER_US if heard_us < 0 or self._state["lost"][0] else heard_us + LOST_AFTER_US + 1

    def take(self, frame_indices: Int64s, link: LinkClock) -> Iterator[PresenceChange]:
        """Follow the next frames of the link, of which `frame_indices` are the vehicle's; yield each change."""
        done, changes = 0, np.empty((_ROOM, 3), np.int64)
        while done <= len(frame_indices):
            done, n = _take(self._state, frame_indices, done, int(link.frame_index[0]), link.latest_rx_us, changes)
            if n:
                for frame_index, lost, t_rx_us in changes[:n].tolist():
                    yield PresenceChange(frame_index, bool(lost), t_rx_us)
