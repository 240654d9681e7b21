"""Which streams of a vehicle are alive, and for how long both forms of its attitude were: silence is not health.

A stream is stale when it has been silent for some of its own periods, and for some seconds at least. Deadlines run on
the vehicle's boot clock while any of its timed messages comes, and on receive time where they all stop.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.settings import StreamSettings

Int64s = npt.NDArray[np.int64]

OTHER = 2  # a timed message that is neither of the two attitude streams


@dataclass(frozen=True)
class Timeline:
    """A vehicle's timed messages within one boot, in order of arrival; n of them.

    `stream` (n,) 0 ATTITUDE, 1 ATTITUDE_QUATERNION, 2 any other; `t_boot_us`, `t_rx_us` (n,), −1 for an unknown receive
    time; `ordinal` (n,) of the frame in its link; `period_us`, `rx_period_us` (n,) of the message's stream as known by
    then, −1 where not.
    """

    stream: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    ordinal: Int64s
    period_us: Int64s
    rx_period_us: Int64s


class LinkClock(NamedTuple):
    """The receive time of a link, frame by frame: `ordinal` (n,) and the latest receive time so far (n,), µs."""

    ordinal: Int64s
    latest_rx_us: Int64s


class Turn(NamedTuple):
    """A stream started, went stale or resumed: at `t_boot_us`, noticed with the frame `ordinal`."""

    ordinal: int
    stream: int
    what: str  # "started", "stale", "resumed", or "missing": it never came at all
    t_boot_us: int


class _Stream:
    def __init__(self) -> None:
        self.seen = False
        self.alive = False
        self.last_us = 0
        self.period_us = -1
        self.rx_period_us = -1

    def learn(self, period_us: int, rx_period_us: int) -> None:
        self.period_us = max(period_us, self.period_us) if period_us < 0 else period_us
        self.rx_period_us = max(rx_period_us, self.rx_period_us) if rx_period_us < 0 else rx_period_us


class Liveness:
    """Of the two attitude streams of one vehicle within one boot."""

    def __init__(self, settings: StreamSettings) -> None:
        """Start before the first message."""
        self.streams = (_Stream(), _Stream())
        self._settings = settings
        self._shortest_us = settings.stale_after_s * 1e6
        self._first_us: int | None = None
        self._latest_us = 0
        self._latest_rx_us = -1
        self._both_us = 0  # closed stretches of time in which both were alive
        self._both_since_us: int | None = None
        self._missing_told = False

    @property
    def both_alive(self) -> bool:
        """Whether both streams are alive now."""
        return self.streams[0].alive and self.streams[1].alive

    @property
    def both_alive_us(self) -> int:
        """Time so far in which both streams were alive."""
        open_us = 0 if self._both_since_us is None else max(self._latest_us - self._both_since_us, 0)
        return self._both_us + open_us

    def take(self, line: Timeline, link: LinkClock) -> Iterator[Turn]:
        """Follow the next messages, and the clock of the link that brought them; yield what starts, ends or resumes."""
        if self._nothing_new(line):
            for k, stream in enumerate(self.streams):
                mine = np.flatnonzero(line.stream == k)
                if len(mine):
                    stream.last_us = max(stream.last_us, int(line.t_boot_us[mine].max()))
                    for period, rx_period in zip(line.period_us[mine], line.rx_period_us[mine], strict=True):
                        stream.learn(int(period), int(rx_period))
            self._latest_us = max(self._latest_us, int(line.t_boot_us.max()))
            self._latest_rx_us = max(self._latest_rx_us, int(line.t_rx_us.max()))
            return
        columns = (line.stream, line.t_boot_us, line.t_rx_us, line.ordinal, line.period_us, line.rx_period_us)
        for k, t_us, t_rx_us, ordinal, period_us, rx_period_us in zip(*(c.tolist() for c in columns), strict=True):
            if self._first_us is None:
                self._first_us = self._latest_us = t_us
            yield from self.pass_silence(link, ordinal)
            self._latest_us = max(self._latest_us, t_us)
            self._latest_rx_us = max(self._latest_rx_us, t_rx_us)
            yield from self._pass_deadlines(ordinal, except_stream=k)
            if k != OTHER:
                yield from self._hear(k, t_us, ordinal)
                self.streams[k].learn(period_us, rx_period_us)

    def pass_silence(self, link: LinkClock, until_ordinal: int | None = None) -> Iterator[Turn]:
        """Streams whose deadline passes on receive time, while nothing of the vehicle came, are stale."""
        if self._latest_rx_us < 0 or not len(link.ordinal):
            return
        if link.latest_rx_us[-1] - self._latest_rx_us <= self._shortest_us:
            return
        for k, stream in enumerate(self.streams):
            if not stream.alive:
                continue
            deadline_rx_us = self._latest_rx_us + self._deadline_us(stream.rx_period_us)
            index = int(np.searchsorted(link.latest_rx_us, deadline_rx_us, side="right"))
            if index == len(link.ordinal) or (until_ordinal is not None and link.ordinal[index] > until_ordinal):
                continue
            at_us = max(stream.last_us + self._deadline_us(stream.period_us), self._latest_us)
            yield from self._stale(k, at_us, int(link.ordinal[index]))

    def _nothing_new(self, line: Timeline) -> bool:
        """Whether no stream can start, resume or go stale with these messages: the common case, told at once."""
        if not len(line.stream):
            return True
        if self._first_us is None or not (self._missing_told or all(stream.seen for stream in self.streams)):
            return False
        if np.diff(line.t_rx_us, prepend=max(self._latest_rx_us, 0)).max() > self._shortest_us:
            return False
        latest = max(int(line.t_boot_us.max()), self._latest_us)
        for k, stream in enumerate(self.streams):
            times = line.t_boot_us[line.stream == k]
            if not stream.alive:
                if len(times):
                    return False
            elif np.diff(np.concatenate(([stream.last_us], times, [latest]))).max() > self._shortest_us:
                return False
        return True

    def _deadline_us(self, period_us: int) -> int:
        return round(max(self._shortest_us, self._settings.stale_periods * period_us))

    def _pass_deadlines(self, ordinal: int, except_stream: int) -> Iterator[Turn]:
        for k, stream in enumerate(self.streams):
            deadline = stream.last_us + self._deadline_us(stream.period_us)
            if stream.alive and self._latest_us > deadline:
                yield from self._stale(k, deadline, ordinal)
            if not stream.seen and k != except_stream and not self._missing_told:
                deadline = (self._first_us or 0) + self._deadline_us(-1)
                if self._latest_us > deadline:
                    self._missing_told = True
                    yield Turn(ordinal, k, "missing", deadline)

    def _hear(self, k: int, t_us: int, ordinal: int) -> Iterator[Turn]:
        stream = self.streams[k]
        if not stream.alive:
            turn = Turn(ordinal, k, "resumed" if stream.seen else "started", t_us)
            stream.seen = stream.alive = True
            stream.last_us = t_us
            if self.both_alive:
                self._both_since_us = t_us
            yield turn
        stream.last_us = max(stream.last_us, t_us)

    def _stale(self, k: int, at_us: int, ordinal: int) -> Iterator[Turn]:
        """Stream `k` is stale from `at_us` on; looking back, it was not alive from its last sample on."""
        self.streams[k].alive = False
        if self._both_since_us is not None:
            self._both_us += max(self.streams[k].last_us - self._both_since_us, 0)
            self._both_since_us = None
        yield Turn(ordinal, k, "stale", at_us)
