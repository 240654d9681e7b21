"""Events for people, one readable line each, on standard output."""

from __future__ import annotations

from collections.abc import Sequence

import click

from gcs_bridge.events import AlarmRaised, Event
from gcs_bridge.sinks.base import Sink
from gcs_bridge.sinks.event_lines import ReadableLines

__all__ = ["Console"]

_COLOURS = {"alarm_raised": "red", "alarm_cleared": "green", "no_compare": "yellow", "vehicle_lost": "yellow"}


class Console(Sink):
    """Prints events as lines; where that is asked for, it rings the terminal's bell for alarms."""

    def __init__(self, lines: ReadableLines, *, colour: bool, rings: bool = False) -> None:
        """Print nothing yet."""
        self._lines = lines
        self._colour = colour
        self._rings = rings

    def events(self, events: Sequence[Event]) -> None:
        """Print those that are wanted."""
        for event in events:
            if (line := self._lines(event)) is not None:
                colour = _COLOURS.get(event.name) if self._colour else None
                is_raised = isinstance(event, AlarmRaised)
                bell = "\a" if self._rings and is_raised else ""
                click.secho(bell + line, fg=colour, bold=is_raised, color=self._colour)
