"""The live loop: what has arrived on the links goes to the monitor, what the monitor tells goes to the sinks.

All time and all I/O of a live run is here and in the links; the monitor is given bytes and receive times.
"""

from __future__ import annotations

import selectors
import signal
import time
from collections.abc import Callable, Sequence
from types import FrameType, TracebackType
from typing import Any

from gcs_bridge.contract import readable
from gcs_bridge.events import Damage, Event, LinkDown, LinkUp, utc
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.links.link import Link, LinkDownError, now_us

__all__ = ["Stop", "link_name", "listen"]
_TICK_S = 0.25  # so often time passes for the monitor where nothing comes, and a wish to stop is looked for
# The least time from batch to batch: judging one costs the same whether it holds one message or ten. Where a viewer
# looks on, the newest is to be there within 0.1 s.
_BATCH_S, _WATCHED_BATCH_S = 0.1, 0.055


class Stop:
    """Turns SIGINT and SIGTERM into a wish to end.

    While the loop runs (`patient`) the first signal is a wish, which the loop grants between two batches; before, and
    the second time, it is a KeyboardInterrupt.
    """

    def __init__(self) -> None:
        """Start with nothing wished."""
        self.asked = False
        self.patient = False
        self._before: list[tuple[int, Any]] = []

    def __enter__(self) -> Stop:
        self._before = [(number, signal.signal(number, self._on_signal)) for number in (signal.SIGINT, signal.SIGTERM)]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        if self.asked or not self.patient:
            raise KeyboardInterrupt
        self.asked = True


def listen(
    links: Sequence[Link],
    monitor: Monitor,
    tell: Callable[[Event], None],
    *,
    stop: Callable[[], bool] = lambda: False,
    duration_s: float | None = None,
    watched: bool = False,
) -> bool:
    """Feed `monitor` from the links and `tell` every event, until `stop` says so or `duration_s` is over.

    Link number n is the monitor's link n; in an event of the link itself, `link` is its name. Returns False if it
    ended because every link had. `watched`: a viewer shows what comes, so it is taken more often.
    """
    batch_s = _WATCHED_BATCH_S if watched else _BATCH_S
    ends_s = None if duration_s is None else time.monotonic() + duration_s
    with _Waiter() as waiter:
        listened = [_Listened(number, link, monitor, tell) for number, link in enumerate(links)]
        for one in listened:
            waiter.add(one)
            one.say(LinkUp)
        ticked_s = time.monotonic()
        while not all(one.ended for one in listened):
            now_s = time.monotonic()
            if stop() or (ends_s is not None and now_s >= ends_s):
                return True
            ready = waiter.wait(_TICK_S if ends_s is None else min(_TICK_S, ends_s - now_s))
            taken_s = time.monotonic()
            heard = [one for one in ready if one.take()]
            if taken_s - ticked_s >= _TICK_S:
                ticked_s = taken_s
                for one in listened:
                    if one not in heard:  # there may be more to come that waited while this process was held up
                        one.advance()
            for one in [one for one in ready if one.ended]:
                waiter.remove(one)
                one.link.close()
            if ready:
                time.sleep(max(batch_s - (time.monotonic() - taken_s), 0))
    return False


def link_name(event: Event, links: Sequence[Link]) -> str:
    """The name of the link, one of those that are listened to, that an event is about."""
    return event.link if isinstance(event.link, str) else links[event.link or 0].name


class _Listened:
    """One link while it is listened to."""

    def __init__(self, number: int, link: Link, monitor: Monitor, tell: Callable[[Event], None]) -> None:
        self.link = link
        self.ended = False
        self._number = number
        self._monitor = monitor
        self._tell = tell
        self._dropped = 0
        monitor.open_link(number, datagrams=link.datagrams)

    def take(self) -> bool:
        """Judge everything that has arrived; whether there was anything."""
        try:
            pieces = self.link.drain()
        except LinkDownError as end:
            self.ended = True
            self._pass_on(self._monitor.close_link(self._number, now_us()))
            self.say(LinkDown, reason=readable(str(end)))
            return False
        if self.link.datagrams:
            self._pass_on(self._monitor.feed_datagrams(pieces, self._number))
        elif pieces:
            self._pass_on(
                self._monitor.feed(b"".join(piece.data for piece in pieces), pieces[-1].t_rx_us, self._number)
            )
        if self.link.dropped != self._dropped:
            lost, self._dropped = self.link.dropped - self._dropped, self.link.dropped
            self.say(Damage, reason=f"{lost} datagrams were dropped here: this machine is too slow", dropped=lost)
        return bool(pieces)

    def advance(self) -> None:
        """Nothing has come: let time pass."""
        self._pass_on(self._monitor.advance(now_us(), self._number))

    def say(self, kind: type[Event], **more: Any) -> None:
        """Tell an event of the link itself."""
        at = utc(now_us())
        self._tell(
            kind(vehicle=None, boot=None, boot_s=None, utc=at, check=None, link=readable(self.link.name), **more)
        )

    def _pass_on(self, events: list[Event]) -> None:
        for event in events:
            self._tell(event)


class _Waiter:
    """Waits until something has come on any link; those without a descriptor are looked at from time to time."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._without: list[_Listened] = []

    def __enter__(self) -> _Waiter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._selector.close()

    def add(self, one: _Listened) -> None:
        descriptor = one.link.fileno()
        if descriptor is None:
            self._without.append(one)
        else:
            self._selector.register(descriptor, selectors.EVENT_READ, one)

    def remove(self, one: _Listened) -> None:
        if one in self._without:
            self._without.remove(one)
        else:
            descriptor = one.link.fileno()
            assert descriptor is not None
            self._selector.unregister(descriptor)

    def wait(self, seconds: float) -> list[_Listened]:
        if self._without:
            seconds = min(seconds, _WATCHED_BATCH_S)
        if not self._selector.get_map():
            time.sleep(seconds)
            return list(self._without)
        return [key.data for key, _ in self._selector.select(seconds)] + self._without
