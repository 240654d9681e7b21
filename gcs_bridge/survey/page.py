"""The summary as a page: it leads to the pages of flights, opens offline and asks nobody."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

from gcs_bridge._version import __version__
from gcs_bridge.pages.templates import asset, template
from gcs_bridge.report.rows import in_bytes
from gcs_bridge.report.verdicts import VERDICTS
from gcs_bridge.report.wording import UNITS
from gcs_bridge.survey.drift import Drift
from gcs_bridge.survey.summary import Summary
from gcs_bridge.survey.text import flight_words, hours

__all__ = ["overview"]

_SHOWN = 20  # rows of long tables, until one asks for more
_COLUMNS = ("alarm", "warning", "explained", "agree", "no_compare", "inop")
_WIDTH, _HEIGHT, _EDGE = 160, 36, 3  # of a curve, in pixels


def overview(summary: Summary) -> str:
    """The page."""
    return template("survey.html").render(
        summary=summary,
        counts=[(verdict, summary.verdicts[verdict]) for verdict in VERDICTS if summary.verdicts[verdict]],
        size=in_bytes(summary.bytes),
        flown=hours(summary.flight_s),
        span=None if summary.first_us is None else _days(summary.first_us, summary.last_us or 0),
        columns=_COLUMNS,
        worst=[{"of": one, "link": one.page and quote(one.page), "words": flight_words(one)} for one in summary.worst],
        shown=_SHOWN,
        more=sum(summary.verdicts[one] for one in ("alarm", "warning")) - len(summary.worst),
        drift=[_drifted(one) for one in sorted(summary.drift, key=lambda one: -one.clarity)],
        version=__version__,
        style=asset("page.css"),
    )


def _day(t_us: int) -> str:
    return datetime.fromtimestamp(t_us / 1e6, UTC).date().isoformat()


def _days(first_us: int, last_us: int) -> str:
    days = _day(first_us), _day(last_us)
    return days[0] if days[0] == days[1] else " to ".join(days)


def _drifted(one: Drift) -> dict[str, Any]:
    """A row of the table, with a curve of the flights."""
    values = [value for _, value in one.points]
    least, most = min(values), max(values)
    span_us, span = one.last_us - one.first_us, most - least or 1.0
    across, high = _WIDTH - 2 * _EDGE, _HEIGHT - 2 * _EDGE
    points = (
        (_EDGE + across * (t_us - one.first_us) / span_us, _EDGE + high * (most - value) / span)
        for t_us, value in one.points
    )
    return {
        "of": one,
        "unit": UNITS.get(one.unit, f" {one.unit}"),
        "span": _days(one.first_us, one.last_us),
        "points": " ".join(f"{x:.1f},{y:.1f}" for x, y in points),
        "width": _WIDTH,
        "height": _HEIGHT,
    }
