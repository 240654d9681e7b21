"""What is kept of a recording's report: a row of the recording, one of each check, one of each alarm.

Rows are plain values by name. Times are µs since 1970; unknown is None, never 0; values are in degrees where the name
says so, else in the check's own unit, which stands beside them.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from pathlib import PurePath
from typing import Any

from msgspec.structs import asdict

from gcs_bridge._version import __version__
from gcs_bridge.contract import Alarm, Distribution, ExplainedBy
from gcs_bridge.report import all_compared
from gcs_bridge.report.schema import Boot, Check, File, Vehicle

__all__ = ["Row", "alarm_rows", "check_rows", "folder_of", "recording_row", "start_us"]

Row = dict[str, Any]
_PARTS = ("median", "p95", "p99", "max")


def recording_row(entry: File, known_by: Row, page: str | None) -> Row:
    """The row of a recording; `known_by`: what it is known by in all tables, `page`: where its page is."""
    alarms = [alarm for vehicle in entry.vehicles for alarm in vehicle.alarms]
    salvage = entry.salvage
    counted = ("frames", "bad_crc", "repaired_crc", "unverified", "skipped_bytes", "signed", "duplicates", "gap_count")
    return {
        **known_by,
        "version": __version__,
        "verdict": entry.verdict,
        "compared": all_compared(entry),
        "flight_s": max(map(_flight_s, entry.vehicles), default=None),
        "vehicles": len(entry.vehicles),
        "alarms": sum(alarm.severity == "alarm" for alarm in alarms),
        "warnings": sum(alarm.severity == "warning" for alarm in alarms),
        "first_alarm": next((alarm.check for alarm in _worst_first(alarms)), None),
        "first_cause": next((alarm.diagnosis.cause for alarm in _worst_first(alarms) if alarm.diagnosis), None),
        "bytes": entry.bytes,
        **{name: getattr(salvage, name) for name in counted},
        "read_fraction": salvage.read_fraction,
        "remarks": list(salvage.remarks),
        "page": page,
    }


def check_rows(entry: File, known_by: Row) -> list[Row]:
    """A row of each check of each vehicle."""
    return [
        {**known_by, **_vehicle(vehicle), **_check(check)} for vehicle in entry.vehicles for check in vehicle.checks
    ]


def alarm_rows(entry: File, known_by: Row) -> list[Row]:
    """A row of each alarm and warning."""
    return [
        {**known_by, **_vehicle(vehicle), **_alarm(alarm)} for vehicle in entry.vehicles for alarm in vehicle.alarms
    ]


def start_us(entry: File) -> int | None:
    """When the first vehicle of a recording was first heard, by the receiver's clock."""
    return min((at for vehicle in entry.vehicles for boot in vehicle.boots if (at := _began_us(boot))), default=None)


def _began_us(boot: Boot) -> int | None:
    zero_us = _us(boot.start_utc)
    return None if zero_us is None or boot.first_boot_s is None else zero_us + round(boot.first_boot_s * 1e6)


def _us(utc: str | None) -> int | None:
    return None if utc is None else round(datetime.fromisoformat(utc).timestamp() * 1e6)


def _flight_s(vehicle: Vehicle) -> float:
    spans = ((boot.first_boot_s, boot.last_boot_s) for boot in vehicle.boots)
    return sum(last - first for first, last in spans if first is not None and last is not None)


def _worst_first(alarms: Iterable[Alarm]) -> list[Alarm]:
    return sorted(alarms, key=lambda alarm: alarm.severity != "alarm")


def _vehicle(vehicle: Vehicle) -> Row:
    return {
        "sysid": vehicle.sysid,
        "compid": vehicle.compid,
        "autopilot": vehicle.autopilot,
        "type": vehicle.type,
    }


def _check(check: Check) -> Row:
    bias = check.bias or (None, None, None)
    row = {
        "check": check.name,
        "verdict": check.verdict,
        "reason": check.reason,
        "unit": check.unit,
        "coverage": check.coverage,
        "pairs": check.pairs,
        "same_instant": check.same_instant,
        "lag_ms": check.lag_ms,
        **{f"bias_{axis}": value for axis, value in zip("xyz", bias, strict=True)},
        **_explained(check.explained_by),
    }
    for name in ("residual", "raw", "tilt", "heading"):
        row |= _distribution(name, getattr(check, name))
    return row


def _distribution(name: str, values: Distribution | None) -> Row:
    return {f"{name}_{part}": None if values is None else getattr(values, part) for part in _PARTS}


def _explained(explained_by: Iterable[ExplainedBy]) -> Row:
    """Each cause, and as numbers what is asked for most: the last value of each, in degrees."""
    causes = tuple(explained_by)
    latest = {one.cause: one.value if isinstance(one.value, tuple) else (one.value,) for one in causes}
    trim_x, trim_y = latest.get("ahrs_trim", (None, None))
    return {
        "explained_by": [one.cause for one in causes],
        "explained_estimated": any(one.estimated for one in causes) if causes else None,
        "pitch_trim_deg": latest.get("pitch_trim", (None,))[0],
        "vtol_view_deg": latest.get("vtol_view", (None,))[0],
        "ahrs_trim_x_deg": trim_x,
        "ahrs_trim_y_deg": trim_y,
    }


def _alarm(alarm: Alarm) -> Row:
    found = alarm.diagnosis
    row = asdict(alarm)
    del row["diagnosis"], row["rotvec_body"]
    value = None if found is None else found.value
    return {
        **row,
        "raised_utc": _us(alarm.raised_utc),
        **{f"rotvec_{axis}": part for axis, part in zip("xyz", alarm.rotvec_body or (None,) * 3, strict=True)},
        "cause": None if found is None else found.cause,
        "causes": [] if found is None else list(found.causes),
        "confidence": None if found is None else found.confidence,
        "distinguishable": None if found is None else found.distinguishable,
        "candidates": [] if found is None else list(found.candidates),
        "side": None if found is None else found.side,
        "cause_value": [] if value is None else list(value) if isinstance(value, tuple) else [value],
        "cause_unit": None if found is None else found.unit,
        "cause_residual_deg": None if found is None else found.residual,
        "fix": None if found is None else found.fix,
    }


def folder_of(path: str) -> str:
    """Where a recording lies: by it fleets are often told apart."""
    return str(PurePath(path).parent) if "://" not in path else path.rpartition("/")[0]
