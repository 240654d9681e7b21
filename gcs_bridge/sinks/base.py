"""What a sink is: whatever takes what is told while links or recordings are judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a command line that only helps or refuses needs none of it
    from gcs_bridge.events import Event
    from gcs_bridge.judging.observation import Observation, Observer
    from gcs_bridge.mavlink.scanner import RawFrame

__all__ = ["Plan", "Sink", "SinkContext", "Sinks"]


class Sink:
    """Takes frames, samples and events; it does nothing with what it has no method of its own for.

    Of each batch the frames come first, then what was judged of each vehicle, then the events that came of it.
    """

    @property
    def failed(self) -> bool:
        """Whether it could not take all that it was given; it has told so, and the run goes on."""
        return False

    def frames(self, link: int | str, frames: Sequence[RawFrame]) -> None:
        """Take frames as they came, before they are judged: whoever sent them, unknown ids included."""

    def observe(self, observation: Observation) -> None:
        """Take what one batch showed of a vehicle. Waits for nobody."""

    def events(self, events: Sequence[Event]) -> None:
        """Take the events of one batch, in order; none if it brought none."""

    def reopen(self) -> None:
        """Somebody has moved its file away, as log rotation does: go on in a new one of the same name."""

    def close(self) -> None:
        """Nothing follows: give back what it holds. A second call does nothing."""


class Sinks:
    """Several sinks, each given what it takes, in their order."""

    def __init__(self, sinks: Iterable[Sink]) -> None:
        """Give to these; who takes no frames or no observations costs nothing for them."""
        self._sinks = tuple(sinks)
        self._take_frames = [sink.frames for sink in self._sinks if type(sink).frames is not Sink.frames]
        self._observe = [sink.observe for sink in self._sinks if type(sink).observe is not Sink.observe]

    @property
    def failed(self) -> bool:
        """Whether any of them could not take all that it was given."""
        return any(sink.failed for sink in self._sinks)

    @property
    def observer(self) -> Observer | None:
        """To be given to `Monitor(observer=…)`; None: nobody wants it."""
        return self._give_observation if self._observe else None

    @property
    def on_frames(self) -> Callable[[int | str, Sequence[RawFrame]], None] | None:
        """To be given to `Monitor(on_frames=…)`; None: nobody wants it."""
        return self._give_frames if self._take_frames else None

    def events(self, events: Sequence[Event]) -> None:
        """Give each the events of one batch."""
        for sink in self._sinks:
            sink.events(events)

    def reopen(self) -> None:
        """Let each open its file anew."""
        for sink in self._sinks:
            sink.reopen()

    def _give_observation(self, observation: Observation) -> None:
        for observe in self._observe:
            observe(observation)

    def _give_frames(self, link: int | str, frames: Sequence[RawFrame]) -> None:
        for take in self._take_frames:
            take(link, frames)


@dataclass(frozen=True)
class SinkContext:
    """What there is when a sink is opened."""

    title: str  # of the run
    links: Sequence[str]  # their names, by the numbers that events tell
    note: Callable[[str], None]  # tells people one line that they must know
    complain: Callable[[str], None]  # tells them one line of what went wrong
    stack: ExitStack  # closes what lives longer than the sink does


@dataclass(frozen=True)
class Plan:
    """A sink that is asked for: all has been checked that can be without opening it."""

    open: Callable[[SinkContext], Sink]
    writes: Path | None = None
    takes_stdout: bool = False
