"""What a dataset says of a fleet: verdicts, causes, the worst flights, and how biases and trims drift."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from gcs_bridge._version import __version__
from gcs_bridge.report.schema import Verdict
from gcs_bridge.report.verdicts import VERDICTS, worst_verdict
from gcs_bridge.survey.drift import Drift, drifts
from gcs_bridge.survey.parts import read_table

__all__ = ["Cause", "Raised", "Run", "Summary", "WorstFlight", "summarised"]

_MOST_FLIGHTS = 500
_WORST = pc.field("alarms") + pc.field("warnings") > 0


class Raised(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that alarms or warnings said, over the fleet."""

    check: str
    severity: str
    what: str
    times: int
    recordings: int


class Cause(msgspec.Struct, frozen=True, kw_only=True):
    """One mistake that explains alarms, over the fleet."""

    cause: str
    alarms: int
    recordings: int


class WorstFlight(msgspec.Struct, frozen=True, kw_only=True):
    """One recording with an alarm or a warning."""

    path: str
    verdict: Verdict
    alarms: int
    warnings: int
    first_alarm: str | None
    first_cause: str | None
    page: str | None
    """Where its page is in the dataset's folder."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """What the last survey did."""

    judged: int
    known: int
    copies: int
    retried: int
    bytes: int
    wall_s: float
    workers: int


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """Of all recordings in a dataset; unknown is null."""

    schema: str = "gcs-bridge/survey-summary/1"
    version: str = __version__
    verdict: Verdict
    recordings: int
    bytes: int
    flight_s: float
    first_us: int | None
    """Start of the first flight, µs since 1970."""
    last_us: int | None
    verdicts: dict[str, int]
    """Of recordings."""
    checks: dict[str, dict[str, int]]
    """Of each check, its verdicts over all vehicles."""
    causes: list[Cause]
    raised: list[Raised]
    worst: list[WorstFlight]
    """Those with an alarm or a warning, most alarms first: five hundred at most."""
    drift: list[Drift]
    failures: list[str]
    """What could not be judged in the last run, and why."""
    run: Run


def summarised(folder: Path, run: Run, failures: list[str], vehicle: re.Pattern[str] | None) -> Summary:
    """Of the dataset in a folder. UsageError where it cannot be read."""
    columns = ["verdict", "bytes", "flight_s", "start_utc"]
    recordings = read_table(folder, "recordings", columns)
    verdicts = _counted(recordings, "verdict")
    times = recordings["start_utc"].cast(pa.int64())
    span = pc.min_max(times).as_py() if len(recordings) else {"min": None, "max": None}
    return Summary(
        verdict=worst_verdict(verdict for verdict in VERDICTS if verdicts.get(verdict)),
        recordings=len(recordings),
        bytes=pc.sum(recordings["bytes"]).as_py() or 0,
        flight_s=pc.sum(recordings["flight_s"]).as_py() or 0.0,
        first_us=span["min"],
        last_us=span["max"],
        verdicts={verdict: verdicts.get(verdict, 0) for verdict in VERDICTS},
        checks=_of_checks(folder),
        causes=_causes(folder),
        raised=_raised(folder),
        worst=_worst(folder),
        drift=drifts(folder, vehicle),
        failures=failures,
        run=run,
    )


def _counted(table: pa.Table, column: str) -> dict[str, int]:
    return {one["values"]: one["counts"] for one in pc.value_counts(table[column]).to_pylist()}


def _of_checks(folder: Path) -> dict[str, dict[str, int]]:
    table = read_table(folder, "checks", ["check", "verdict"])
    counts: dict[str, dict[str, int]] = {}
    for row in table.group_by(["check", "verdict"]).aggregate([([], "count_all")]).to_pylist():
        counts.setdefault(row["check"], {})[row["verdict"]] = row["count_all"]
    return {check: dict(sorted(of_check.items())) for check, of_check in sorted(counts.items())}


def _causes(folder: Path) -> list[Cause]:
    named = pc.field("cause").is_valid() & (pc.field("cause") != "unknown")
    rows = _in_recordings(read_table(folder, "alarms", ["cause", "content"], named), ["cause"])
    found = [Cause(cause=row["cause"], alarms=row["times"], recordings=row["recordings"]) for row in rows]
    return sorted(found, key=lambda one: (-one.recordings, one.cause))


def _raised(folder: Path) -> list[Raised]:
    keys = ["check", "severity", "what"]
    rows = _in_recordings(read_table(folder, "alarms", [*keys, "content"]), keys)
    found = [Raised(**row) for row in rows]
    return sorted(found, key=lambda one: (-one.recordings, one.check, one.what))


def _in_recordings(table: pa.Table, keys: list[str]) -> list[dict[str, Any]]:
    """How often each came, and in how many recordings."""
    grouped = table.group_by(keys).aggregate([([], "count_all"), ("content", "count_distinct")])
    names = {"count_all": "times", "content_count_distinct": "recordings"}
    return list(grouped.rename_columns([names.get(name, name) for name in grouped.column_names]).to_pylist())


def _worst(folder: Path) -> list[WorstFlight]:
    names = list(WorstFlight.__struct_fields__)
    table = read_table(folder, "recordings", names, _WORST)
    order = [("alarms", "descending"), ("warnings", "descending"), ("path", "ascending")]
    first = pc.select_k_unstable(table, min(_MOST_FLIGHTS, len(table)), order) if len(table) else []
    return [WorstFlight(**row) for row in table.take(first).to_pylist()] if len(table) else []
