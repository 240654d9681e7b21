"""Which streams of a vehicle are alive, and for how long both forms of its attitude were: silence is not health.

A stream is stale when it has been silent for some of its own periods, and for some seconds at least, and as well when
its samples go on with one and the same time. Deadlines run on the vehicle's boot clock while any of its timed messages
comes, and where they all stop on the time in which the link was heard. Where a link was silent, and the vehicle's clock
behind that shows that less time has passed there, the receiver paused: it is nobody's silence.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.columns import FrameColumns, Int64Rows, Int64s, Records, record
from gcs_bridge.jit import helper, kernel
from gcs_bridge.settings import StreamSettings
from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock, first_beyond

OTHER = 2  # a timed message that is neither of the two attitude streams
_WHATS = ("started", "stale", "resumed", "missing", "stands", "paused")
_STARTED, _STALE, _RESUMED, _MISSING, _STANDS, _PAUSED = range(6)
_ROOM, _MOST = 16, 8  # changes that there is room for in one call; as many as one message can bring, at most
_NO_TIME = -1
_PAUSE_US = 1_000_000  # a shorter pause of the receiver is not worth a word: it delays no deadline either

_STREAM = np.dtype(
    [
        ("seen", "?"),
        ("alive", "?"),
        ("last_us", "i8"),  # the vehicle's time when it was last heard: a stream that comes late is not silent
        ("period_us", "i8"),
        ("rx_period_us", "i8"),
        ("stamp_us", "i8"),  # the time that its samples carry, and since when: by the time in which the link was heard
        ("stamped_us", "i8"),
    ]
)
_LIVENESS = np.dtype(
    [
        ("stream", _STREAM, (2,)),
        ("first_us", "i8"),
        ("latest_us", "i8"),
        ("latest_rx_us", "i8"),
        ("heard_us", "i8"),  # time in which the link was heard, up to the latest message
        ("latest_frame_index", "i8"),
        ("both_us", "i8"),  # closed stretches of time in which both were alive
        ("both_since_us", "i8"),
        ("missing_told", "?"),
        # Of the settings.
        ("shortest_us", "f8"),
        ("stale_periods", "f8"),
    ]
)


@record
class Timeline(FrameColumns):
    """A vehicle's timed messages within one boot, in order of arrival; n of them.

    `stream` (n,) 0 ATTITUDE, 1 ATTITUDE_QUATERNION, 2 any other; `t_boot_us` (n,); `t_rx_us`, `heard_us` (n,) by the
    link's clock, the former −1 where unknown; `period_us`, `rx_period_us` (n,) of the message's stream as known by
    then, −1 where not; `lost`, `received` (n,) frames of the vehicle so far.
    """

    stream: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    heard_us: Int64s
    period_us: Int64s
    rx_period_us: Int64s
    lost: Int64s
    received: Int64s


class StreamChange(NamedTuple):
    """A stream started, went stale or resumed: at `t_boot_us`, noticed with the frame `frame_index`."""

    frame_index: int
    stream: int
    what: (
        str  # "started", "stale", "resumed"; "missing": it never came at all; "stands": it is stale as its time stands
    )
    t_boot_us: int  # still; "paused": of no stream, the receiver did not listen
    ago_us: int = 0  # how long before that frame it was
    silent_us: int = 0  # of a stale one: since its last sample; how long the receiver paused

    @property
    def is_stale(self) -> bool:
        """Whether the stream tells nothing from here on."""
        return self.what in ("stale", "stands")


@helper
def _deadline_us(of: Any, period_us: Any) -> Any:
    """After how long a silence a stream of this period is stale."""
    return np.int64(np.rint(max(of.shortest_us, of.stale_periods * period_us)))


@helper
def _rx_deadline_us(of: Any, k: Any) -> Any:
    """The same on receive time."""
    stream = of.stream[k]
    return _deadline_us(of, stream.rx_period_us if stream.rx_period_us >= 0 else stream.period_us)


@helper
def _write(changes: Any, n: Any, frame_index: Any, k: Any, what: Any, t_us: Any, ago_us: Any, silent_us: Any) -> Any:
    """Put down a change; return how many there are."""
    changes[n, 0], changes[n, 1], changes[n, 2] = frame_index, k, what
    changes[n, 3], changes[n, 4], changes[n, 5] = t_us, ago_us, silent_us
    return n + 1


@helper
def _go_stale(of: Any, k: Any, what: Any, at_us: Any, frame_index: Any, ago_us: Any, changes: Any, n: Any) -> Any:
    """Stream `k` is stale from `at_us` on, or stands; looking back, it was not alive from its last sample on."""
    stream = of.stream[k]
    stream.alive = False
    if of.both_since_us != _NO_TIME:
        of.both_us += max(stream.last_us - of.both_since_us, 0)
        of.both_since_us = _NO_TIME
    return _write(changes, n, frame_index, k, what, at_us, ago_us, at_us - stream.last_us)


@helper
def _pass_silence(of: Any, first: Any, heard_us: Any, until: Any, changes: Any, n: Any) -> Any:
    """Streams whose deadline passes while the link is heard, and nothing timed of the vehicle came, are stale.

    `heard_us` of the link's frames from the index `first` on; looked at are those before row `until`.
    """
    since = max(of.latest_frame_index + 1 - first, 0)
    for k in range(2):
        stream = of.stream[k]
        if stream.alive:
            allowed_us = _rx_deadline_us(of, k)
            row = first_beyond(heard_us, since, until, of.heard_us + allowed_us)
            if row < until:
                at_us = max(stream.last_us + _deadline_us(of, stream.period_us), of.latest_us)
                ago_us = heard_us[row] - of.heard_us - allowed_us
                n = _go_stale(of, k, _STALE, at_us, first + row, ago_us, changes, n)
    return n


@helper
def _find_pause(of: Any, t_boot_us: Any, t_rx_us: Any, heard_us: Any, frame_index: Any, changes: Any, n: Any) -> Any:
    """Behind a silence of the whole link in which less time passed on the vehicle than here, the receiver paused."""
    if of.latest_rx_us < 0:
        return n
    passed_us = t_rx_us - of.latest_rx_us
    unheard_us = passed_us - (heard_us - of.heard_us)
    paused_us = passed_us - max(t_boot_us - of.latest_us, 0)
    if unheard_us > _PAUSE_US and paused_us > max(_PAUSE_US, unheard_us // 2):
        n = _write(changes, n, frame_index, 0, _PAUSED, t_boot_us, 0, paused_us)
    return n


@helper
def _pass_deadlines(of: Any, frame_index: Any, except_stream: Any, changes: Any, n: Any) -> Any:
    """Streams whose deadline has passed on the vehicle's clock are stale, or missing."""
    for k in range(2):
        stream = of.stream[k]
        deadline_us = stream.last_us + _deadline_us(of, stream.period_us)
        if stream.alive and of.latest_us > deadline_us:
            n = _go_stale(of, k, _STALE, deadline_us, frame_index, of.latest_us - deadline_us, changes, n)
        if not stream.seen and k != except_stream and not of.missing_told:
            deadline_us = of.first_us + _deadline_us(of, -1)
            if of.latest_us > deadline_us:
                of.missing_told = True
                n = _write(changes, n, frame_index, k, _MISSING, deadline_us, of.latest_us - deadline_us, 0)
    return n


@helper
def _hear(of: Any, k: Any, t_us: Any, heard_us: Any, frame_index: Any, changes: Any, n: Any) -> Any:
    """A sample of stream `k` came."""
    stream = of.stream[k]
    if t_us != stream.stamp_us:
        stream.stamp_us, stream.stamped_us = t_us, heard_us
    elif heard_us - stream.stamped_us > _rx_deadline_us(of, k):
        return _go_stale(of, k, _STANDS, of.latest_us, frame_index, 0, changes, n) if stream.alive else n
    stream.last_us = of.latest_us
    if not stream.alive:
        n = _write(changes, n, frame_index, k, _RESUMED if stream.seen else _STARTED, t_us, 0, 0)
        stream.seen = stream.alive = True
        if of.stream[1 - k].alive:
            of.both_since_us = of.latest_us
    return n


@kernel
def _take(
    liveness: Annotated[Records, _LIVENESS],
    stream: Int64s,
    t_boot_us: Int64s,
    t_rx_us: Int64s,
    heard_us: Int64s,
    frame_index: Int64s,
    period_us: Int64s,
    rx_period_us: Int64s,
    begin: int,
    first: int,
    link_heard_us: Int64s,
    changes: Int64Rows,
) -> tuple[int, int]:
    """Follow the messages from `begin` on, as long as there is room for changes.

    `link_heard_us` of the link's frames from the index `first` on. Return how far, and how many changes there are.
    """
    of, n = liveness[0], 0
    for i in range(begin, stream.size):
        if n > _ROOM - _MOST:
            return i, n
        k, at = stream[i], frame_index[i]
        if of.first_us == _NO_TIME:
            of.first_us = of.latest_us = t_boot_us[i]
        n = _pass_silence(of, first, link_heard_us, at - first + 1, changes, n)
        n = _find_pause(of, t_boot_us[i], t_rx_us[i], heard_us[i], at, changes, n)
        of.latest_us = max(of.latest_us, t_boot_us[i])
        of.latest_rx_us, of.heard_us, of.latest_frame_index = t_rx_us[i], heard_us[i], at
        n = _pass_deadlines(of, at, k, changes, n)
        if k != OTHER:
            n = _hear(of, k, t_boot_us[i], heard_us[i], at, changes, n)
            of.stream[k].period_us = period_us[i] if period_us[i] >= 0 else of.stream[k].period_us
            of.stream[k].rx_period_us = rx_period_us[i] if rx_period_us[i] >= 0 else of.stream[k].rx_period_us
    return stream.size, n


@kernel
def _wait(
    liveness: Annotated[Records, _LIVENESS], first: int, heard_us: Int64s, until: int, changes: Int64Rows
) -> tuple[int, int]:
    """Let time pass up to row `until` of the link's frames.

    Return how many changes that brings, and the time on the link from which on time alone may bring the next.
    """
    of, due_us = liveness[0], NEVER_US
    n = _pass_silence(of, first, heard_us, until, changes, 0)
    for k in range(2):
        if of.stream[k].alive:
            due_us = min(due_us, of.heard_us + _rx_deadline_us(of, k) + 1)
    return n, due_us


class Liveness:
    """Of the two attitude streams of one vehicle within one boot."""

    def __init__(self, settings: StreamSettings) -> None:
        """Start before the first message."""
        self.due_us = NEVER_US  # the time on the link, as it is heard, from which on `pass_silence` may tell more
        self._state = np.zeros(1, _LIVENESS)
        for name in ("first_us", "latest_rx_us", "latest_frame_index", "both_since_us"):
            self._state[name] = _NO_TIME
        self._state["stream"]["period_us"] = self._state["stream"]["rx_period_us"] = _NO_TIME
        self._state["stream"]["stamp_us"] = _NO_TIME
        self._state["shortest_us"] = settings.stale_after_s * 1e6
        self._state["stale_periods"] = settings.stale_periods

    @property
    def both_alive(self) -> bool:
        """Whether both streams are alive now."""
        return bool(self._state["stream"]["alive"].all())

    @property
    def both_alive_us(self) -> int:
        """Time so far in which both streams were alive."""
        both_us, since_us, latest_us = (int(self._state[name][0]) for name in ("both_us", "both_since_us", "latest_us"))
        return both_us if since_us == _NO_TIME else both_us + max(latest_us - since_us, 0)

    def take(self, line: Timeline, link: LinkClock) -> Iterator[StreamChange]:
        """Follow the next messages, and the clock of the link that brought them; yield what starts, ends or resumes."""
        done, changes = 0, np.empty((_ROOM, 6), np.int64)
        while done < len(line.stream):
            done, n = _take(
                self._state,
                line.stream,
                line.t_boot_us,
                line.t_rx_us,
                line.heard_us,
                line.frame_index,
                line.period_us,
                line.rx_period_us,
                done,
                int(link.frame_index[0]),
                link.heard_us,
                changes,
            )
            if n:
                yield from _as_changes(changes[:n])

    def pass_silence(self, link: LinkClock, until_frame_index: int | None = None) -> Iterator[StreamChange]:
        """Streams whose deadline passes while the link is heard, and nothing timed of the vehicle came, are stale."""
        first, until = int(link.frame_index[0]), len(link.frame_index)
        if until_frame_index is not None:
            until = until_frame_index + 1 - first
        changes = np.empty((_MOST, 6), np.int64)
        n, self.due_us = _wait(self._state, first, link.heard_us, until, changes)
        if n:
            yield from _as_changes(changes[:n])


def _as_changes(changes: Int64s) -> Iterator[StreamChange]:
    """In order of their frames: of two silences that end with one message the later one may have been found first."""
    for frame_index, stream, what, t_boot_us, ago_us, silent_us in sorted(changes.tolist(), key=itemgetter(0)):
        yield StreamChange(frame_index, stream, _WHATS[what], t_boot_us, ago_us, silent_us)
