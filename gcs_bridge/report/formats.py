"""The formats of a report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from gcs_bridge.report import Report
from gcs_bridge.report.baseline import NOTHING_KNOWN, Known
from gcs_bridge.settings import FailOn

__all__ = ["FORMATS", "PAGE", "TELL_REFUSED", "Asked", "Refused", "format_of"]


class Refused(NamedTuple):
    """A source that could not be used, and what is said of it, in one line that begins with its path."""

    path: str
    line: str


class Asked(NamedTuple):
    """What is wanted of a report, and what it cannot know by itself."""

    detail: int = 0
    """From −1, the last line of each file alone, to 1, every number: of the text."""
    fail_on: FailOn = "alarm"
    known: Known = NOTHING_KNOWN
    refused: tuple[Refused, ...] = ()


def _junit(report: Report, asked: Asked) -> str:
    from gcs_bridge.report.junit import suites

    return suites(report.files, fail_on=asked.fail_on, known=asked.known, refused=asked.refused)


def _markdown(report: Report, asked: Asked) -> str:
    from gcs_bridge.report.markdown import comment

    return comment(report, known=asked.known, refused=[one.line for one in asked.refused])


# By name, each loaded when it is asked for.
FORMATS: dict[str, Callable[[Report, Asked], str]] = {
    "text": lambda report, asked: report.to_text(detail=asked.detail),
    "json": lambda report, _: report.to_json(),
    "junit": _junit,
    "markdown": _markdown,
}
TELL_REFUSED = frozenset({"junit", "markdown"})
"""The formats that tell of sources that could not be used: there is a report even if there is nothing else."""
PAGE = "html"
"""The format that is none of text: it needs the curves too, see `pages`."""
_ENDINGS = {".html": PAGE, ".htm": PAGE, ".json": "json", ".xml": "junit", ".md": "markdown"}


def format_of(output: Path) -> str:
    """The format that a file's ending tells."""
    return _ENDINGS.get(output.suffix.lower(), "text")
