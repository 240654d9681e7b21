"""How labelled rows and numbers are written, in every report for reading: lines of at most 100 columns."""

from __future__ import annotations

import math
import textwrap

__all__ = ["NBSP", "WIDTH", "counted", "in_bytes", "in_percent", "in_seconds", "labelled", "shown", "unbroken"]
WIDTH = 100
NBSP = "\N{NO-BREAK SPACE}"
"""Within what stays on one line, until it is written."""


def labelled(label: str, said: str, *, indent: int = 6) -> list[str]:
    """A labelled row, broken at spaces and continued under its text."""
    head = f"{'':{indent}}{label:<{24 - indent}}  "
    wrapped = textwrap.wrap(
        said,
        WIDTH,
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(NBSP, " ") for line in wrapped] or [head.rstrip()]


def unbroken(said: str) -> str:
    """The words, kept on one line."""
    return said.replace(" ", NBSP)


def shown(value: float | None) -> str:
    """A number, with three digits if it is no whole one."""
    if value is None:
        return "unknown"
    return str(value) if isinstance(value, int) else f"{value:.3g}"


def counted(value: int | None, noun: str) -> str:
    """So many of something."""
    return f"{shown(value)} {noun}{'' if value == 1 else 's'}"


def in_seconds(value: float | None, digits: int = 1) -> str:
    """A time in s."""
    return "unknown" if value is None else f"{value:.{digits}f} s"


def in_percent(share: float | None) -> str:
    """Rounded down: what is not whole must not look whole."""
    return "unknown" if share is None else f"{math.floor(share * 1000 + 1e-9) / 10:g} %"


def in_bytes(size: int | None) -> str:
    """A size in kB or MB."""
    if size is None:
        return "size unknown"
    return f"{size / 1e6:.1f} MB" if size >= 1_000_000 else f"{size / 1e3:.1f} kB"
