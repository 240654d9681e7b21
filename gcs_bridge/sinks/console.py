"""Events for people, one readable line each, on standard output."""

from __future__ import annotations

from collections.abc import Sequence

import click

from gcs_bridge.events import Event
from gcs_bridge.sinks.base import Sink
from gcs_bridge.sinks.event_lines import event_line, is_alarm, is_detail

__all__ = ["Console"]

_COLOURS = {"alarm_raised": "red", "alarm_cleared": "green", "no_compare": "yellow", "vehicle_lost": "yellow"}


class Console(Sink):
    """Prints events; `detail` −1: alarms alone, 1: also what may yet pass. `tell_link`: on which link each came."""

    def __init__(self, *, detail: int, colour: bool, tell_link: bool) -> None:
        """Print nothing yet."""
        self._detail = detail
        self._colour = colour
        self._tell_link = tell_link

    def events(self, events: Sequence[Event]) -> None:
        """Print those that are wanted."""
        for event in events:
            if is_alarm(event) or self._detail >= is_detail(event):
                where = f"  ({event['link']})" if self._tell_link and event["vehicle"] else ""
                colour = _COLOURS.get(event["event"]) if self._colour else None
                bold = event["event"] == "alarm_raised"
                click.secho(event_line(event) + where, fg=colour, bold=bold, color=self._colour)
