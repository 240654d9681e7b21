"""The live loop: what has arrived on the links goes to the monitor, what the monitor tells goes to the sinks.

All time and all I/O of a live run is here and in the links; the monitor is given bytes and receive times.
"""

from __future__ import annotations

import math
import select
import signal
import time
from collections.abc import Callable, Sequence
from types import FrameType, TracebackType
from typing import Any, Protocol

from gcs_bridge.chunks import Framing
from gcs_bridge.contract import readable
from gcs_bridge.events import Damage, Event, LinkDown, LinkUp, utc
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.links.link import Link, LinkDownError
from gcs_bridge.links.reopening import FIRST_DELAY_S, longer
from gcs_bridge.links.wall_clock import WallClock, now_us

__all__ = ["Errand", "Stop", "listen"]
_TICK_S = 0.25  # so often time passes for the monitor where nothing comes, and a wish to stop is looked for
# So long what comes first waits for what comes with it: a vehicle sends its messages in bursts, and judging one costs
# nearly the same whether it holds one message or ten. The first is for bursts of up to _BURST messages, as one vehicle
# sends them. What came while the last batch was judged waits twice as long as that took, so that half of a processor is
# enough where it costs much, as of many vehicles.
_SHORT_S, _GATHER_S, _LONGEST_S = 0.001, 0.002, 0.01
_BURST = 8
# As long as nothing is on its way with any vehicle it may wait longer: an alarm is pending before it is raised, and is
# judged without that wait from there on. So long must the delay be at the least, in such waits: a vehicle's clock may
# run faster than this one's, as where a flight is played.
_CALM_SHARE = 4
_FEW = 256  # chunks that may gather: as many have room where a system gives the least
_AT_ONCE_S = 0.0001  # what was there already is told within this time
_POLL_S = 0.01  # so often a link is asked that cannot be waited for


class Errand(Protocol):
    """What else is done in the loop's thread, between two batches: it waits for nobody."""

    def descriptors(self) -> Sequence[int]:
        """What to wait on beside the links: readable where there is something to do."""

    def run(self) -> None:
        """Do it; called each time the loop comes round, some times a second at least."""


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

    def ask(self) -> None:
        """Wish it."""
        self.asked = True

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


# So long bytes come, and so many, before it is told that there is no frame among them. A heartbeat a second would be a
# frame by then; what is left of a damaged one is less.
_NO_FRAME_S, _NO_FRAME_BYTES = 5.0, 200


def listen(
    links: Sequence[Link],
    monitor: Monitor,
    tell: Callable[[list[Event]], None],
    *,
    stop: Callable[[], bool] = lambda: False,
    duration_s: float | None = None,
    note: Callable[[str], None] = lambda _: None,
    errands: Sequence[Errand] = (),
    patience_s: float = 0.0,
) -> None:
    """Feed `monitor` from the links and `tell` each batch's events, until `stop` says so or `duration_s` is over.

    A batch is what has arrived: one burst where the link is quiet, more where this machine falls behind. Link number n
    is the monitor's link n; in an event of the link itself, `link` is its name. A link that has gone is waited for, and
    `note` is told in a line why it does not return, and that this machine's clock was set. All links are closed in the
    end. `patience_s`: while no alarm is on its way a batch may be all that comes in that time, where the system says
    when each came.
    """
    ends_s = math.inf if duration_s is None else time.monotonic() + duration_s
    listened = [_Listened(number, link, monitor, tell, note) for number, link in enumerate(links)]
    clock = WallClock()
    try:
        for one in listened:
            one.say(LinkUp)
        taken_s = ticked_s = time.monotonic()
        judged_s = calm_s = 0.0
        chunks = 0  # that were taken the last time
        while not stop() and (asked_s := time.monotonic()) < ends_s:
            beside = [descriptor for errand in errands for descriptor in errand.descriptors()]
            _wait(links, 0.0 if monitor.is_asked else min(_TICK_S, ends_s - asked_s), beside)
            came_s, gather_s = time.monotonic(), _SHORT_S if chunks <= _BURST else _GATHER_S
            if came_s - asked_s < _AT_ONCE_S:  # it came while the last batch was judged, and has waited since
                came_s, gather_s = taken_s, min(max(_GATHER_S, 2 * judged_s), _LONGEST_S)
            gather_s = max(gather_s, calm_s)
            _pass(min(came_s + gather_s, ends_s) - time.monotonic(), beside)
            before_s, taken_s = taken_s, time.monotonic()
            if step_us := clock.step_us():
                monitor.set_clock(now_us())
                note(_clock_was_set(step_us / 1e6))
            counts = [one.take() for one in listened]
            judged_s, chunks = time.monotonic() - taken_s, sum(counts)
            if monitor.is_asked:  # one question a round: what comes meanwhile waits for one answer, and not for all
                tell(monitor.answer())
            few = chunks * patience_s <= _FEW * (taken_s - before_s)
            may_wait = few and not monitor.is_asked and all(link.tells_arrival for link in links)
            calm_s = min(patience_s, monitor.calm_s() / _CALM_SHARE) if may_wait else 0.0
            for errand in errands:
                errand.run()
            if taken_s - ticked_s >= _TICK_S:
                ticked_s = taken_s
                for one, count in zip(listened, counts, strict=True):
                    one.look()
                    if not count:  # there may be more to come that waited while this process was held up
                        one.advance()
        while monitor.is_asked:
            tell(monitor.answer())
    finally:
        for link in links:
            link.close()


def _clock_was_set(step_s: float) -> str:
    way = "back" if step_s < 0 else "forward, or it slept,"
    return f"this machine's clock was set {way} by {abs(step_s):.1f} s: receive times follow it"


def _wait(links: Sequence[Link], seconds: float, beside: Sequence[int]) -> None:
    """Until something has come on any of them; not long where there is one that cannot be waited for."""
    of_links = [descriptor for link in links if (descriptor := link.fileno()) is not None]
    descriptors = [*of_links, *beside]
    if len(of_links) < len(links):
        seconds = min(seconds, _POLL_S)
    if descriptors:
        select.select(descriptors, [], [], seconds)
    else:  # Windows' select takes no empty lists
        time.sleep(seconds)


def _pass(seconds: float, beside: Sequence[int]) -> None:
    """Let time pass, unless there is something else to do."""
    if beside and seconds > 0:
        select.select(beside, [], [], seconds)
    else:
        time.sleep(max(seconds, 0))


class _Listened:
    """One link while it is listened to, there or not."""

    def __init__(
        self,
        number: int,
        link: Link,
        monitor: Monitor,
        tell: Callable[[list[Event]], None],
        note: Callable[[str], None],
    ) -> None:
        self._link = link
        self._is_up = True
        self._delay_s = FIRST_DELAY_S
        self._number = number
        self._monitor = monitor
        self._tell = tell
        self._note = note
        self._begin()

    def _begin(self) -> None:
        """The link is there."""
        self._dropped = 0
        self._noise = _Noise(self._monitor.frames_of(self._number))
        self._monitor.open_link(self._number, datagrams=self._link.framing is Framing.DATAGRAM)

    def take(self) -> int:
        """Judge everything that has arrived; how many chunks that was."""
        if not self._is_up:
            if not self._link.has_returned():
                return 0
            self._is_up = True
            self._begin()
            self.say(LinkUp)
        try:
            chunks = self._link.drain()
        except LinkDownError as end:
            self._tell(self._monitor.close_link(self._number, now_us()))
            self.say(LinkDown, reason=readable(str(end)))
            self._is_up = False
            self._link.wait(self._delay_s)
            self._delay_s = longer(self._delay_s)  # unless it brings something next time
            return 0
        if len(chunks):
            self._delay_s = FIRST_DELAY_S
            self._noise.add(chunks.data.size)
            self._tell(self._monitor.take(chunks, self._number))
        if self._link.dropped != self._dropped:
            lost, self._dropped = self._link.dropped - self._dropped, self._link.dropped
            self.say(Damage, reason=f"{lost} datagrams were dropped here: this machine is too slow", dropped=lost)
        return len(chunks)

    def look(self) -> None:
        """Tell what is wrong with the link, if something has been for a while."""
        if why := self._link.why_not():
            self._note(f"a link has gone, and is tried again and again: {why}")
        if self._is_up and self._noise.is_news(self._monitor.frames_of(self._number)):
            self.say(Damage, reason=self._link.unreadable, dropped=0)

    def advance(self) -> None:
        """Nothing has come: let time pass."""
        self._tell(self._monitor.advance(now_us(), self._number))

    def say(self, kind: type[Event], **more: Any) -> None:
        """Tell an event of the link itself."""
        at = utc(now_us())
        event = kind(vehicle=None, boot=None, boot_s=None, utc=at, check=None, link=readable(self._link.name), **more)
        self._tell([event])


class _Noise:
    """Bytes that come, one after the other, without a frame among them."""

    def __init__(self, frames: int) -> None:
        """So many frames came so far."""
        self._frames = frames
        self._told = False
        self._forget()

    def _forget(self) -> None:
        self._bytes = 0
        self._first_s, self._last_s = math.inf, -math.inf

    def add(self, size: int) -> None:
        """So many bytes came."""
        self._bytes += size
        self._last_s = time.monotonic()
        self._first_s = min(self._first_s, self._last_s)

    def is_news(self, frames: int) -> bool:
        """So many frames came by now: whether noise has come instead of more of them, and that was not said yet."""
        if frames != self._frames:
            self._frames, self._told = frames, False
            self._forget()
        lasts = self._last_s - self._first_s > _NO_FRAME_S and self._bytes >= _NO_FRAME_BYTES
        if self._told or not lasts:
            return False
        self._told = True
        return True
