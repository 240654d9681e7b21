"""The times of what is drawn.

They are kept as they came: each boot of a vehicle is a clock of its own, and so a timeline of its own (`boot`,
`boot_1`, …); the receive time is `utc`, where it is known. Recordings side by side meet on one more.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Columns, Int64s, Rows, all_true, any_true, record
from gcs_bridge.events import Event
from gcs_bridge.judging.observation import Observation
from gcs_bridge.viewer.arrays import TimeColumn
from gcs_bridge.viewer.scene import UTC, boot_timeline

__all__ = ["Aligned", "Instant", "Times", "instant_of", "pair_times"]


class Instant(NamedTuple):
    """An instant on the clock of a boot and as received: µs, None and −1 where unknown."""

    boot: int
    t_boot_us: int | None
    t_rx_us: int

    def columns(self, n: int, aligned: Aligned | None = None) -> list[TimeColumn]:
        """The times of n rows of this instant, on the timeline `aligned` too; none where neither is known."""
        columns = []
        if self.t_boot_us is not None:
            columns.append(TimeColumn(boot_timeline(self.boot), np.full(n, self.t_boot_us)))
        if self.t_rx_us > 0:
            columns.append(TimeColumn(UTC, np.full(n, self.t_rx_us), since_1970=True))
        if aligned is not None and (since_us := aligned.at(self)) is not None:
            columns.append(TimeColumn(aligned.timeline, np.full(n, since_us)))
        return columns


class Aligned:
    """A timeline on which several recordings lie side by side: the time since an instant of each, its zero.

    By receive times where they are known; else by the clock of the zero's boot.
    """

    def __init__(self, timeline: str, zero: Instant | None) -> None:
        """None: what is drawn first of this recording is at zero."""
        self.timeline = timeline
        self._zero = zero

    def at(self, moment: Instant) -> int | None:
        """Where a moment lies, µs; None where it is unknown."""
        boot_us = None if moment.t_boot_us is None else np.array([moment.t_boot_us])
        since_us = self.of(moment.boot, boot_us, np.array([moment.t_rx_us]))
        return None if since_us is None else int(since_us[0])

    def of(self, boot: int, t_boot_us: Int64s | None, t_rx_us: Int64s) -> Int64s | None:
        """The same of rows of a boot, whose receive times are all known, or all unknown."""
        received = t_rx_us[0] > 0
        if self._zero is None and (received or t_boot_us is not None):
            self._zero = Instant(boot, None if t_boot_us is None else int(t_boot_us[0]), int(t_rx_us[0]))
        zero = self._zero
        if zero is not None and received and zero.t_rx_us > 0:
            return t_rx_us - zero.t_rx_us
        if zero is None or t_boot_us is None or zero.t_boot_us is None or boot != zero.boot:
            return None
        return t_boot_us - zero.t_boot_us


@record
class Times(Columns):
    """When n rows were true, in one boot: (n,) each, µs, −1 where the receive time is unknown."""

    t_boot_us: Int64s
    t_rx_us: Int64s
    boot: int

    def moment(self, row: int) -> Instant:
        """When one of them was true."""
        return Instant(self.boot, int(self.t_boot_us[row]), int(self.t_rx_us[row]))

    def parts(self) -> Iterator[tuple[Times, Rows]]:
        """The rows whose receive times are all known, and those of which none is, as far as there are any."""
        known = self.t_rx_us > 0
        if all_true(known) or not any_true(known):
            yield self, slice(None)
        else:
            for mask in (known, ~known):
                yield self[mask], mask

    def columns(self, aligned: Aligned | None = None) -> list[TimeColumn]:
        """The times of rows whose receive times are all known, or all unknown; on the timeline `aligned` too."""
        columns = [TimeColumn(boot_timeline(self.boot), self.t_boot_us)]
        if self.t_rx_us[0] > 0:
            columns.append(TimeColumn(UTC, self.t_rx_us, since_1970=True))
        if aligned is not None and (since_us := aligned.of(self.boot, self.t_boot_us, self.t_rx_us)) is not None:
            columns.append(TimeColumn(aligned.timeline, since_us))
        return columns


def instant_of(event: Event) -> Instant:
    """When an event was."""
    boot_s, utc = event.boot_s, event.utc
    received = -1 if utc is None else int(np.datetime64(utc.removesuffix("Z"), "us").astype(np.int64))
    return Instant(event.boot or 0, None if boot_s is None else round(boot_s * 1e6), received)


def pair_times(observation: Observation) -> Times:
    """When each pair was true, and known: a pair is known when the sample comes that completes it."""
    pairs = observation.pairs
    return Times(t_boot_us=pairs.t_boot_us, t_rx_us=pairs.t_rx_us, boot=observation.segment.boot)
