"""Errors that are somebody's to mend: each tells in one line what, where and what to do next.

Anything else that is raised is a mistake of this program. Dirt on a link is no error at all: it is counted.
"""

from __future__ import annotations

from typing import ClassVar

__all__ = ["INCOMPATIBLE", "GcsBridgeError", "SourceError", "UsageError", "one_line"]

INCOMPATIBLE = 66
"""What `rerun-importer-tlog` ends with for a file of another kind: rerun's EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE."""


class GcsBridgeError(Exception):
    """What the user can mend; `exit_code` is what the command line ends with."""

    exit_code: ClassVar[int] = 2


class UsageError(GcsBridgeError):
    """A wrong argument or setting, or an output that cannot be written."""

    exit_code: ClassVar[int] = 2


class SourceError(GcsBridgeError):
    """A link or recording that cannot be used."""

    exit_code: ClassVar[int] = 3


def one_line(text: str) -> str:
    r"""The text as one line of signs that can be shown; all others are spelled out.

    File names and texts from the air may hold line breaks, control characters and such as turn the direction of
    writing, and terminals obey them.

    >>> one_line("a\nb \x1b[2J.tlog")
    'a b \\x1b[2J.tlog'
    """
    flat = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in flat)
