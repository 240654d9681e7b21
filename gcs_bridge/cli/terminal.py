"""What people see while a command runs: errors, a progress bar, colours. None of it is the result."""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING

from gcs_bridge.errors import one_line
from gcs_bridge.files import write_stdout

if TYPE_CHECKING:  # rich is loaded when there is something to draw
    from rich.progress import Progress

__all__ = ["ProgressBar", "complain", "show", "terminal_has_gone", "wants_colour"]

_PATIENCE_S = 1.0
_STYLES = {
    r"\bAGREE\b": "bold green",
    r"\bEXPLAINED\b": "green",
    r"\bWARNING\b": "bold yellow",
    r"\bNO COMPARE\b": "bold yellow",
    r"\b(ALARM|INOP)\b": "bold red",
}


def complain(message: str, *, kind: str = "error") -> None:
    """One line on stderr."""
    print(f"gcs-bridge: {kind}: {one_line(message)}", file=sys.stderr)


def wants_colour(*, no_color: bool) -> bool:
    """Whether standard output is a terminal whose user has not asked for plain text."""
    return sys.stdout.isatty() and not no_color and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def terminal_has_gone() -> bool:
    """Whether standard output or standard error was a terminal, and that has closed."""
    if sys.platform == "win32":
        return False
    import termios

    for number in (1, 2):
        try:
            termios.tcgetattr(number)
        except termios.error as error:
            if error.args[0] == errno.EIO:
                return True
    return False


def show(text: str, *, no_color: bool, styles: Mapping[str, str] = _STYLES) -> None:
    """Write a text for people to standard output, its verdicts in colour where those are wanted.

    `styles`: of the words, by a pattern. UsageError where it cannot be written.
    """
    if not wants_colour(no_color=no_color):
        write_stdout(text)
        return
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    coloured = Text(text.removesuffix("\n"))
    for words, style in styles.items():
        coloured.highlight_regex(words, style)
    console.print(coloured)


class ProgressBar:
    """A bar on stderr over several files' bytes: only on a terminal, and only for what takes longer than a second."""

    def __init__(self, *, total_bytes: int = 0, enabled: bool) -> None:
        self._total_bytes, self._said = total_bytes, "judging"
        self._enabled = enabled and sys.stderr.isatty()
        self._before = 0  # bytes of the files that are done
        self._started_s = time.monotonic()
        self._bar: Progress | None = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, done: int, _total: int) -> None:
        """So many of the present file's bytes are read."""
        if self._enabled and time.monotonic() - self._started_s > _PATIENCE_S:
            bar = self._bar = self._bar or self._drawn()
            done += self._before
            bar.update(bar.task_ids[0], completed=done, total=self._total_bytes, description=self._said)

    def more(self, size: int) -> None:
        """So many bytes more are to be read."""
        self._total_bytes += size

    def file_done(self, size: int, said: str | None = None) -> None:
        """The present file is done, however it ended; what there is to say beside the bar from now on."""
        self._before += size
        self._said = self._said if said is None else said
        self(0, 0)

    def _drawn(self) -> Progress:
        from rich.console import Console
        from rich.progress import Progress

        bar = Progress(console=Console(stderr=True), transient=True)
        bar.add_task(self._said, total=self._total_bytes)
        bar.start()
        return bar
