"""Events for people, one readable line each, on standard output."""

from __future__ import annotations

from collections.abc import Sequence

import click

from gcs_bridge.events import AlarmRaised, Event
from gcs_bridge.sinks.base import Sink
from gcs_bridge.sinks.event_lines import event_line, is_alarm, is_detail, link_name

__all__ = ["Console"]

_COLOURS = {"alarm_raised": "red", "alarm_cleared": "green", "no_compare": "yellow", "vehicle_lost": "yellow"}


class Console(Sink):
    """Prints events; `detail` −1: alarms alone, 1: also what may yet pass. Of several links, on which each came."""

    def __init__(self, links: Sequence[str], *, detail: int, colour: bool) -> None:
        """Print nothing yet; `links`: the names of the links, by their numbers."""
        self._links = links
        self._detail = detail
        self._colour = colour

    def events(self, events: Sequence[Event]) -> None:
        """Print those that are wanted."""
        for event in events:
            if is_alarm(event) or self._detail >= is_detail(event):
                tell_link = event.vehicle and len(self._links) > 1
                where = f"  ({link_name(event, self._links)})" if tell_link else ""
                colour = _COLOURS.get(event.name) if self._colour else None
                bold = isinstance(event, AlarmRaised)
                click.secho(event_line(event) + where, fg=colour, bold=bold, color=self._colour)
