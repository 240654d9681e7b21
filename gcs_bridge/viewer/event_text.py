"""Events as lines of a log beside plots: whole, folded, each with a level by which the viewer colours it."""

from __future__ import annotations

from textwrap import wrap

from gcs_bridge.events import AlarmRaised, Event
from gcs_bridge.sinks.event_lines import event_line

__all__ = ["text_of"]

_LINE = 76  # signs of an event that are seen beside plots; what is longer goes on below
_INDENT = 12 * "\N{NO-BREAK SPACE}"
_GOES_ON = "…"
_LEVELS = {
    "alarm_raised": "CRITICAL",
    "inop": "ERROR",
    "vehicle_lost": "ERROR",
    "link_down": "ERROR",
    **dict.fromkeys(
        ("alarm_pending", "no_compare", "stream_stale", "reboot", "clock_step", "estimator_reset", "damage"), "WARN"
    ),
}


def text_of(event: Event, label: str | None = None) -> tuple[list[str], list[str]]:
    """Lines and levels of an event, as many of the one as of the other; `label` says of which recording it is."""
    level = _LEVELS.get(event.name, "INFO")
    if isinstance(event, AlarmRaised) and event.severity == "warning":
        level = "WARN"
    said = event_line(event) if label is None else f"{label}  {event_line(event)}"
    lines = wrap(said, _LINE, subsequent_indent=_INDENT)
    return lines, [level, *[_GOES_ON] * (len(lines) - 1)]
