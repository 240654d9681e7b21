"""Which streams of a vehicle are alive, and for how long both forms of its attitude were: silence is not health.

A stream is stale when it has been silent for some of its own periods, and for some seconds at least. Deadlines run on
the vehicle's boot clock while any of its timed messages comes, and on receive time where they all stop.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import FrameColumns, Int64s, running_max
from gcs_bridge.settings import StreamSettings
from gcs_bridge.telemetry.link_clock import LinkClock

# No timed message at all for so long, although the vehicle may be heard: a rebooting autopilot speaks again before.
LONG_SILENCE_US = 10_000_000
OTHER = 2  # a timed message that is neither of the two attitude streams


@dataclass(frozen=True, kw_only=True)
class Timeline(FrameColumns):
    """A vehicle's timed messages within one boot, in order of arrival; n of them.

    `stream` (n,) 0 ATTITUDE, 1 ATTITUDE_QUATERNION, 2 any other; `t_boot_us` (n,); `t_rx_us` (n,) by the link's clock,
    −1 where unknown; `period_us`, `rx_period_us` (n,) of the message's stream as known by then, −1 where not; `lost`,
    `received` (n,) frames of the vehicle so far.
    """

    stream: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    period_us: Int64s
    rx_period_us: Int64s
    lost: Int64s
    received: Int64s

    def parts(self) -> Iterator[Timeline]:
        """The same in short pieces, so that what happens in one does not slow down the others."""
        for start in range(0, len(self.stream), _PART):
            yield self[start : start + _PART]


_PART = 256


class StreamChange(NamedTuple):
    """A stream started, went stale or resumed: at `t_boot_us`, noticed with the frame `frame_index`."""

    frame_index: int
    stream: int
    what: str  # "started", "stale", "resumed"; "missing": it never came at all; "silent": see LONG_SILENCE_US
    t_boot_us: int
    ago_us: int = 0  # how long before that frame it was
    silent_us: int = 0  # of a stale one: since its last sample


class _Stream:
    def __init__(self) -> None:
        self.seen = False
        self.alive = False
        self.last_us = 0  # the vehicle's time when it was last heard: a stream that comes late is not silent
        self.period_us = -1
        self.rx_period_us = -1
        self.silence_told = False

    def learn(self, period_us: int, rx_period_us: int) -> None:
        """Take what is known of the stream's period now; −1 changes nothing."""
        self.period_us = period_us if period_us >= 0 else self.period_us
        self.rx_period_us = rx_period_us if rx_period_us >= 0 else self.rx_period_us


def _last_known(values: Int64s) -> int:
    known = values[values >= 0]
    return int(known[-1]) if len(known) else -1


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
        self._latest_frame_index = -1
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

    def take(self, line: Timeline, link: LinkClock) -> Iterator[StreamChange]:
        """Follow the next messages, and the clock of the link that brought them; yield what starts, ends or resumes."""
        for part in (line,) if self._nothing_new(line) else line.parts():
            if self._nothing_new(part):
                self._take_at_once(part)
            else:
                yield from self._take_one_by_one(part, link)

    def _take_at_once(self, line: Timeline) -> None:
        if not len(line.stream):
            return
        latest_us = running_max(line.t_boot_us, self._latest_us)[1:]
        for k, stream in enumerate(self.streams):
            mine = np.flatnonzero(line.stream == k)
            if len(mine):
                stream.last_us = int(latest_us[mine[-1]])
                stream.learn(_last_known(line.period_us[mine]), _last_known(line.rx_period_us[mine]))
        self._latest_us = int(latest_us[-1])
        self._latest_rx_us, self._latest_frame_index = int(line.t_rx_us[-1]), int(line.frame_index[-1])

    def _take_one_by_one(self, line: Timeline, link: LinkClock) -> Iterator[StreamChange]:
        columns = (line.stream, line.t_boot_us, line.t_rx_us, line.frame_index, line.period_us, line.rx_period_us)
        for k, t_us, t_rx_us, frame_index, period_us, rx_period_us in zip(*(c.tolist() for c in columns), strict=True):
            if self._first_us is None:
                self._first_us = self._latest_us = t_us
            yield from self.pass_silence(link, frame_index)
            self._latest_us = max(self._latest_us, t_us)
            self._latest_rx_us, self._latest_frame_index = t_rx_us, frame_index
            yield from self._pass_deadlines(frame_index, except_stream=k)
            if k != OTHER:
                yield from self._hear(k, t_us, frame_index)
                self.streams[k].learn(period_us, rx_period_us)

    def pass_silence(self, link: LinkClock, until_frame_index: int | None = None) -> Iterator[StreamChange]:
        """Streams whose deadline passes on receive time, while nothing of the vehicle came, are stale."""
        if self._latest_rx_us < 0 or not len(link.frame_index):
            return
        first = int(link.frame_index[0])
        since = max(self._latest_frame_index + 1 - first, 0)
        until = len(link.frame_index) if until_frame_index is None else until_frame_index + 1 - first
        silence_us = link.latest_rx_us[since:until] - self._latest_rx_us
        if not len(silence_us) or silence_us[-1] <= self._shortest_us:
            return
        found: list[StreamChange] = []
        for k, stream in enumerate(self.streams):
            long = np.flatnonzero(silence_us > LONG_SILENCE_US)
            if stream.seen and len(long) and not stream.silence_told:
                stream.silence_told = True
                at = int(link.frame_index[since + long[0]])
                found.append(StreamChange(at, k, "silent", self._latest_us, 0, LONG_SILENCE_US))
            allowed_us = self._deadline_us(stream.rx_period_us if stream.rx_period_us >= 0 else stream.period_us)
            passed = np.flatnonzero(silence_us > allowed_us)
            if stream.alive and len(passed):
                at_us = max(stream.last_us + self._deadline_us(stream.period_us), self._latest_us)
                ago_us = int(silence_us[passed[0]]) - allowed_us
                found += self._stale(k, at_us, int(link.frame_index[since + passed[0]]), ago_us)
        yield from sorted(found, key=lambda turn: turn.frame_index)

    def _nothing_new(self, line: Timeline) -> bool:
        """Whether no stream can start, resume or go stale with these messages: the common case, told at once."""
        if not len(line.stream):
            return True
        if self._first_us is None or not (self._missing_told or all(stream.seen for stream in self.streams)):
            return False
        if np.diff(line.t_rx_us, prepend=max(self._latest_rx_us, 0)).max() > self._shortest_us:
            return False
        latest_us = running_max(line.t_boot_us, self._latest_us)[1:]
        for k, stream in enumerate(self.streams):
            heard_us = latest_us[line.stream == k]
            if not stream.alive:
                if len(heard_us):
                    return False
            elif np.diff(np.concatenate(([stream.last_us], heard_us, latest_us[-1:]))).max() > self._shortest_us:
                return False
        return True

    def _deadline_us(self, period_us: int) -> int:
        return round(max(self._shortest_us, self._settings.stale_periods * period_us))

    def _pass_deadlines(self, frame_index: int, except_stream: int) -> Iterator[StreamChange]:
        for k, stream in enumerate(self.streams):
            deadline = stream.last_us + self._deadline_us(stream.period_us)
            if stream.alive and self._latest_us > deadline:
                yield from self._stale(k, deadline, frame_index, self._latest_us - deadline)
            if not stream.seen and k != except_stream and not self._missing_told:
                deadline = (self._first_us or 0) + self._deadline_us(-1)
                if self._latest_us > deadline:
                    self._missing_told = True
                    yield StreamChange(frame_index, k, "missing", deadline, self._latest_us - deadline)

    def _hear(self, k: int, t_us: int, frame_index: int) -> Iterator[StreamChange]:
        stream = self.streams[k]
        if not stream.alive:
            turn = StreamChange(frame_index, k, "resumed" if stream.seen else "started", t_us)
            stream.seen = stream.alive = True
            stream.silence_told = False
            stream.last_us = self._latest_us
            if self.both_alive:
                self._both_since_us = self._latest_us
            yield turn
        stream.last_us = self._latest_us

    def _stale(self, k: int, at_us: int, frame_index: int, ago_us: int) -> Iterator[StreamChange]:
        """Stream `k` is stale from `at_us` on; looking back, it was not alive from its last sample on."""
        self.streams[k].alive = False
        if self._both_since_us is not None:
            self._both_us += max(self.streams[k].last_us - self._both_since_us, 0)
            self._both_since_us = None
        yield StreamChange(frame_index, k, "stale", at_us, ago_us, at_us - self.streams[k].last_us)
