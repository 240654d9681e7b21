"""A summary for reading: plain lines, what matters most first."""

from __future__ import annotations

from collections.abc import Iterator

from gcs_bridge.errors import one_line
from gcs_bridge.report.rows import counted, in_bytes
from gcs_bridge.report.verdicts import LABELS, VERDICTS
from gcs_bridge.report.wording import UNITS
from gcs_bridge.survey.drift import Drift
from gcs_bridge.survey.summary import Summary, WorstFlight

__all__ = ["drift_words", "flight_words", "hours", "lines"]

_SHOWN = 10
_COLUMNS = ("alarm", "warning", "explained", "agree", "no_compare", "inop")
_DAY_US = 86_400_000_000


def lines(summary: Summary, folder: str) -> list[str]:
    """What is printed in the end."""
    return list(_lines(summary, folder))


def _lines(summary: Summary, folder: str) -> Iterator[str]:
    said = f"{counted(summary.recordings, 'recording')}, {in_bytes(summary.bytes)}, {hours(summary.flight_s)} of flight"
    yield said
    yield ""
    yield f"  {'check':<20}" + "".join(f"{LABELS[name]:>12}" for name in _COLUMNS)
    for check, verdicts in summary.checks.items():
        yield f"  {check:<20}" + "".join(f"{verdicts.get(name, 0):>12}" for name in _COLUMNS)
    yield from _listed("causes", [f"{one.cause}: in {counted(one.recordings, 'recording')}" for one in summary.causes])
    yield from _listed("worst flights", [f"{one_line(one.path)}: {flight_words(one)}" for one in summary.worst])
    yield from _listed("drift", [drift_words(one) for one in sorted(summary.drift, key=lambda one: -one.clarity)])
    yield ""
    counts = ", ".join(f"{summary.verdicts[one]} {LABELS[one]}" for one in VERDICTS if summary.verdicts[one])
    where = one_line(folder)
    yield f"{LABELS[summary.verdict]:<10}  {where}: {counts or 'no recording'}; see {where}/index.html"


def _listed(title: str, said: list[str]) -> Iterator[str]:
    """A heading, and what stands below it."""
    if not said:
        return
    yield ""
    yield f"  {title}"
    yield from (f"    {one}" for one in said[:_SHOWN])
    if len(said) > _SHOWN:
        yield f"    and {len(said) - _SHOWN} more"


def hours(seconds: float) -> str:
    """A time, in hours once it is one."""
    return f"{seconds / 3600:.1f} h" if seconds >= 3600 else f"{seconds / 60:.1f} min"


def flight_words(one: WorstFlight) -> str:
    """How many alarms a flight has, and the first of the worst of them."""
    raised = [counted(count, noun) for count, noun in ((one.alarms, "alarm"), (one.warnings, "warning")) if count]
    first = ", ".join(filter(None, (one.first_alarm, one.first_cause)))
    return f"{', '.join(raised)}: {first}"


def drift_words(one: Drift) -> str:
    """By how much something changed, in which time, and how certain that is."""
    unit = UNITS.get(one.unit, f" {one.unit}")
    days = (one.last_us - one.first_us) / _DAY_US
    over = f"{days:.0f} days" if days >= 2 else f"{days * 24:.1f} h"
    return (
        f"{one_line(one.vehicle)} {one.quantity}: {one.change:+.3g}{unit} in {over}, {one.flights} flights, "
        f"±{one.noise:.2g}{unit} about a line, median {one.median:.3g}{unit}"
    )
