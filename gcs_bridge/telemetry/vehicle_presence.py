"""Whether a vehicle is there at all: lost when nothing of it came for some seconds in which its link was heard.

A heartbeat comes once a second; a vehicle counts as lost after four to five missed ones (mavlink.io,
services/heartbeat.html). Where the link was silent altogether, the vehicle's own clock tells, with its next timed
message, whether the vehicle was away for so long, or its receiver paused.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.columns import Int64Rows, Int64s, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.telemetry.clocks import BOOT, FRAME_INDEX, NO_TIMES, T_BOOT_US
from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock, first_beyond

LOST_AFTER_US = 5_000_000
_ROOM, _MOST = 16, 5  # changes that there is room for in one call; as many as one frame can bring, at most


class PresenceChange(NamedTuple):
    """The vehicle was lost, or is back: since `t_rx_us`, told by the frame `frame_index` of its link."""

    frame_index: int
    lost: bool
    t_rx_us: int


_PRESENCE = np.dtype(
    [
        ("rx_us", "i8"),  # when its last frame came, −1: none yet
        ("heard_us", "i8"),  # and the time on the link as it is heard
        ("lost", "?"),
        # Its last timed message.
        ("boot", "i8"),
        ("t_boot_us", "i8"),  # −1: none yet
        # A silence of the whole link that nothing has told from a pause of the receiver yet.
        ("away_us", "i8"),  # since when, receive time, −1: there is none
        ("back_us", "i8"),
        ("back_heard_us", "i8"),
    ]
)


@helper
def _write(changes: Any, n: Any, frame_index: Any, lost: Any, t_rx_us: Any) -> Any:
    """Put down a change; return how many there are."""
    changes[n, 0], changes[n, 1], changes[n, 2] = frame_index, lost, t_rx_us
    return n + 1


@helper
def _was_away(of: Any, boot: Any, t_boot_us: Any) -> Any:
    """Whether the vehicle's clock has gone on for so long that it was lost; one that began anew does not tell."""
    if of.t_boot_us < 0 or of.boot != boot:
        return True
    return t_boot_us - of.t_boot_us > LOST_AFTER_US


@helper
def _tell_away(of: Any, frame_index: Any, changes: Any, n: Any) -> Any:
    """It was lost in the silence of the link, and came back with it."""
    n = _write(changes, n, frame_index, 1, of.away_us + LOST_AFTER_US)
    n = _write(changes, n, frame_index, 0, of.back_us)
    of.away_us = -1
    return n


@kernel
def _take(
    presence: Annotated[Records, _PRESENCE],
    own: Int64s,
    timed: Int64Rows,
    begin: int,
    begin_timed: int,
    first: int,
    latest_rx_us: Int64s,
    heard_us: Int64s,
    changes: Int64Rows,
) -> tuple[int, int, int]:
    """Follow the vehicle's frames `own` from `begin` on, and the link's to their end, as long as there is room.

    `timed`: its timed messages, looked at from `begin_timed` on; `latest_rx_us`, `heard_us` of the link's frames from
    the index `first` on. Return how far in both, and how many changes there are.
    """
    of, n, told = presence[0], 0, begin_timed
    since = own[begin - 1] + 1 - first if begin else 0
    for i in range(begin, own.size + 1):
        if n > _ROOM - _MOST:
            return i, told, n
        until = own[i] + 1 - first if i < own.size else heard_us.size
        if of.rx_us >= 0 and not of.lost:
            row = first_beyond(heard_us, since, until, of.heard_us + LOST_AFTER_US)
            if row < until:
                of.lost = True
                ago_us = heard_us[row] - of.heard_us - LOST_AFTER_US
                n = _write(changes, n, first + row, 1, latest_rx_us[row] - ago_us)
        since = until
        if i == own.size:
            break
        at_us, link_us = latest_rx_us[until - 1], heard_us[until - 1]
        if of.lost:
            of.lost = False
            n = _write(changes, n, own[i], 0, at_us)
        elif of.rx_us >= 0 and at_us - of.rx_us > LOST_AFTER_US and of.away_us < 0:
            of.away_us, of.back_us, of.back_heard_us = of.rx_us, at_us, link_us
        of.rx_us, of.heard_us = at_us, link_us
        while told < timed.shape[1] and timed[FRAME_INDEX, told] <= own[i]:
            boot, t_boot_us = timed[BOOT, told], timed[T_BOOT_US, told]
            if of.away_us >= 0:
                if _was_away(of, boot, t_boot_us):
                    n = _tell_away(of, own[i], changes, n)
                of.away_us = -1
            of.t_boot_us = max(of.t_boot_us, t_boot_us) if boot == of.boot else t_boot_us
            of.boot = boot
            told += 1
        if of.away_us >= 0 and link_us - of.back_heard_us > LOST_AFTER_US:  # nothing timed came: it cannot be told
            n = _tell_away(of, own[i], changes, n)
    return own.size + 1, told, n


class Presence:
    """Of one vehicle on one link."""

    def __init__(self) -> None:
        """Start before its first frame."""
        self._state = np.zeros(1, _PRESENCE)
        for name in ("rx_us", "t_boot_us", "away_us"):
            self._state[name] = -1

    @property
    def is_lost(self) -> bool:
        """Whether nothing of it came for too long."""
        return bool(self._state.item(0)[2])

    @property
    def due_us(self) -> int:
        """The time on the link, as it is heard, from which on it is lost, if nothing of it comes."""
        rx_us, heard_us, lost, *_ = self._state.item(0)
        return NEVER_US if rx_us < 0 or lost else heard_us + LOST_AFTER_US + 1

    def take(self, frame_indices: Int64s, link: LinkClock, timed: Int64Rows = NO_TIMES) -> Iterator[PresenceChange]:
        """Follow the next frames of the link, of which `frame_indices` are the vehicle's; yield each change.

        `timed`: columns of its `TimedMessages` that were believed with these frames.
        """
        done, told, changes = 0, 0, np.empty((_ROOM, 3), np.int64)
        while done <= len(frame_indices):
            done, told, n = _take(
                self._state,
                frame_indices,
                timed,
                done,
                told,
                int(link.frame_index[0]),
                link.latest_rx_us,
                link.heard_us,
                changes,
            )
            if n:
                for frame_index, lost, t_rx_us in changes[:n].tolist():
                    yield PresenceChange(frame_index, bool(lost), t_rx_us)
