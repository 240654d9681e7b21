"""How a live run shows itself where it was started: as a view on the terminal, or as lines."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gcs_bridge.cli.terminal import wants_colour
from gcs_bridge.sinks.base import Sink

if TYPE_CHECKING:  # loaded where it is drawn
    from gcs_bridge.screen.view import View
    from gcs_bridge.sinks.event_lines import ReadableLines

__all__ = ["open_shown"]


def open_shown(
    links: Sequence[str], *, title: str, detail: int, no_color: bool, plain: bool, bell: bool
) -> tuple[Sink, View | None]:
    """What shows a run on standard output; and the same once more, if it is a view.

    It is a view where standard output is the terminal that this was started from, in its foreground; and lines where it
    is a file, a pipe, a journal, or a terminal that nothing can be drawn on.
    """
    from gcs_bridge.sinks.event_lines import ReadableLines

    lines, colour = ReadableLines(links, detail=detail), wants_colour(no_color=no_color)
    view = None if plain else _view(lines, title=title, colour=colour, bell=bell)
    if view is not None:
        return view, view
    from gcs_bridge.sinks.console import Console

    return Console(lines, colour=colour, rings=bell and sys.stdout.isatty()), None


def _view(lines: ReadableLines, *, title: str, colour: bool, bell: bool) -> View | None:
    if not sys.stdout.isatty() or os.environ.get("TERM", "dumb") in ("dumb", "unknown", ""):
        return None
    from gcs_bridge.screen.terminal import Terminal

    terminal = Terminal.of_stdout()
    if terminal is None:
        return None
    import rich.console

    from gcs_bridge.screen.view import View

    return View(
        terminal,
        title=title,
        line=lines,
        colours=rich.console.Console().color_system if colour else None,
        encoding=sys.stdout.encoding or "ascii",
        rings=bell,
    )
