"""An earlier report as the baseline of a new one: what was so before fails nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePath
from typing import NamedTuple

import msgspec

from gcs_bridge.contract import Alarm
from gcs_bridge.errors import UsageError, one_line
from gcs_bridge.report.schema import File, Vehicle
from gcs_bridge.report.verdicts import SCHEMA, compared, sends_attitude

__all__ = ["NOTHING_KNOWN", "Known", "known_from", "read_baseline"]


class Known(NamedTuple):
    """What of a report was so in its baseline."""

    alarms: frozenset[tuple[str, str]] = frozenset()
    """Path and alarm id."""
    uncompared: frozenset[tuple[str, int, int]] = frozenset()
    """Path, system and component of vehicles whose attitude was compared with nothing before either."""
    empty: frozenset[str] = frozenset()
    """Paths of recordings without any attitude."""


NOTHING_KNOWN = Known()


class _Baseline(msgspec.Struct):
    """As much of a report as is needed, so that one of another version will do."""

    schema: str
    files: tuple[File, ...]


def read_baseline(path: Path) -> tuple[File, ...]:
    """The files of a JSON report. UsageError if it is none."""
    try:
        report = msgspec.json.decode(path.read_bytes(), type=_Baseline)
    except OSError as error:
        raise UsageError(f"--baseline {path}: cannot be read: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        made = "make one by check --format json --output"
        raise UsageError(f"--baseline {path}: no report ({one_line(str(error))}); {made} {path}") from error
    if report.schema != SCHEMA:
        raise UsageError(f"--baseline {path}: its schema is {one_line(report.schema)!r}, not {SCHEMA!r}")
    return report.files


def known_from(files: Sequence[File], baseline: Sequence[File]) -> Known:
    """What of these files was so before.

    A file is known by its path, or else by its name, where that is unique. An alarm is the same that was raised by the
    same check of the same vehicle, as severe, in the same words and for the same cause; when, and how often within a
    file, is left out but for the number: one more is new.
    """
    alarms: set[tuple[str, str]] = set()
    uncompared: set[tuple[str, int, int]] = set()
    empty: set[str] = set()
    for entry, before in _matched(files, baseline):
        left = Counter(_kind(vehicle, alarm) for vehicle in before.vehicles for alarm in vehicle.alarms)
        for vehicle in entry.vehicles:
            for alarm in vehicle.alarms:
                if left[_kind(vehicle, alarm)] > 0:
                    left[_kind(vehicle, alarm)] -= 1
                    alarms.add((entry.path, alarm.id))
        uncompared.update((entry.path, *of) for of in _uncompared(before))
        if not any(map(sends_attitude, before.vehicles)):
            empty.add(entry.path)
    return Known(frozenset(alarms), frozenset(uncompared), frozenset(empty))


def _matched(files: Sequence[File], baseline: Sequence[File]) -> Iterable[tuple[File, File]]:
    by_path = {entry.path: entry for entry in baseline}
    names = Counter(PurePath(entry.path).name for entry in baseline)
    by_name = {PurePath(entry.path).name: entry for entry in baseline if names[PurePath(entry.path).name] == 1}
    new_names = Counter(PurePath(entry.path).name for entry in files)
    for entry in files:
        name = PurePath(entry.path).name
        before = by_path.get(entry.path) or (by_name.get(name) if new_names[name] == 1 else None)
        if before is not None:
            yield entry, before


def _kind(vehicle: Vehicle, alarm: Alarm) -> tuple[object, ...]:
    cause = None if alarm.diagnosis is None else alarm.diagnosis.cause
    return vehicle.sysid, vehicle.compid, alarm.check, alarm.severity, alarm.what, cause


def _uncompared(entry: File) -> Iterable[tuple[int, int]]:
    for vehicle in entry.vehicles:
        if sends_attitude(vehicle) and not compared(vehicle):
            yield vehicle.sysid, vehicle.compid
