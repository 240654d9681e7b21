"""The page that tells what an alarm was about, and what lies beside it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from gcs_bridge.contract import Alarm, Diagnosis, ExplainedBy
from gcs_bridge.errors import one_line
from gcs_bridge.events import AlarmPending, Event
from gcs_bridge.report.schema import Vehicle
from gcs_bridge.report.verdicts import LABELS
from gcs_bridge.report.wording import difference, quantity

__all__ = ["DRAWN", "summary"]

DRAWN = "moment.rrd"
"""The file for the viewer, where there is one."""
_HOLDS = {
    "attitude": "`ATTITUDE` as sent, and with what the firmware does on purpose undone (`q_nb_undone_…`)",
    "attitude_quaternion": "`ATTITUDE_QUATERNION` as sent, never normalised, and the angles that it means",
    "pairs": "both attitudes at one instant, how they differ, and the limit",
    "imu": "the accelerometer, gyro and compass that the attitude was judged by",
    "ahrs2": "`AHRS2`, the second estimate",
    "parameters": "parameters in force before, and as they changed",
    "said": "texts, modes and estimator flags, the last ones before included",
    "frames": "every frame of the link, byte for byte, with its offset in the recording",
}


def summary(
    recording: str,
    vehicle: Vehicle,
    alarm: Alarm,
    rows: Mapping[str, int],
    events: Iterable[Event],
    *,
    drawn: bool,
) -> str:
    """The page, as Markdown. `alarm` is the report's entry, `rows` how many each table has, `events` the moment's.

    `drawn`: the moment is there to be looked at.
    """
    return "\n".join(_lines(recording, vehicle, alarm, rows, list(events), drawn)) + "\n"


def _lines(
    recording: str, vehicle: Vehicle, alarm: Alarm, rows: Mapping[str, int], events: list[Event], drawn: bool
) -> Iterator[str]:
    yield f"# {LABELS[alarm.severity]}: {difference(alarm)}"
    yield ""
    for what, said in _facts(recording, vehicle, alarm, events):
        yield f"- **{what}**: {one_line(said)}"
    yield ""
    yield "## In this folder"
    yield ""
    yield "The ten seconds before the alarm and the ten behind it, as far as they came."
    yield ""
    yield "| file | rows | holds |"
    yield "| --- | --- | --- |"
    for name, count in rows.items():
        yield f"| `{name}.parquet` | {count} | {_HOLDS[name]} |"
    if drawn:
        yield f"| `{DRAWN}` | | both attitudes, their disagreement, the events: a 3D view and plots |"
    yield ""
    yield "Angles in columns that end in `_rad` are radians, in `_deg` degrees; `_nb` turns body axes (forward, right,"
    yield "down) to north, east, down; `_b` is in body axes. `frame` is the same number in every table. To look:"
    yield ""
    yield "```sh"
    if drawn:
        yield f"rerun {DRAWN}"
    first = next(iter(rows))
    yield f"python -c 'import pandas; print(pandas.read_parquet(\"{first}.parquet\"))'"
    if "pairs" in rows:
        query = r"SELECT t_boot_s, residual_deg FROM \"pairs.parquet\" WHERE residual_deg > limit_deg"
        yield f"python -c 'import duckdb; print(duckdb.sql(\"{query}\"))'"
    yield "```"


def _facts(recording: str, vehicle: Vehicle, alarm: Alarm, events: list[Event]) -> Iterator[tuple[str, str]]:
    yield "where", alarm.axis or "no axis: it is no turn, or about no one axis"
    yield "since when", _when(alarm, events)
    yield from _cause(alarm.diagnosis)
    yield "this is", alarm.is_not
    undone = next((check.explained_by for check in vehicle.checks if check.name == "euler_quaternion"), None)
    if undone:
        said = [f"{one.cause} {_values(one)}{' (estimated)' if one.estimated else ''}" for one in undone]
        yield "made on purpose by the firmware, and undone before judging", ", ".join(said)
    yield "vehicle", f"{vehicle.sysid},{vehicle.compid} {vehicle.autopilot} {vehicle.type}"
    yield "recording", recording
    yield "alarm", alarm.id


def _when(alarm: Alarm, events: list[Event]) -> str:
    first = [one.boot_s for one in events if isinstance(one, AlarmPending) and one.id == alarm.id]
    utc = "" if alarm.raised_utc is None else f", {alarm.raised_utc}"
    said = f"raised at {alarm.raised_boot_s:.2f} s of boot {alarm.boot}{utc}"
    if first:
        said = f"{first[0]:.2f} s of boot {alarm.boot}; {said}"
    cleared = alarm.cleared_boot_s
    said += "; never seen to go" if cleared is None else f"; gone at {cleared:.2f} s"
    return said + (f", raised {alarm.repeats} more times ({alarm.grouped})" if alarm.repeats else "")


def _cause(diagnosis: Diagnosis | None) -> Iterator[tuple[str, str]]:
    if diagnosis is None:
        return
    value = "" if diagnosis.value is None else f" {_values(diagnosis)}"
    side = "" if diagnosis.side is None else f", in message {diagnosis.side}"
    said = f"{diagnosis.cause}{value}{side} ({diagnosis.confidence})"
    others = [cause for cause in diagnosis.candidates if cause != diagnosis.cause]
    yield "likely cause", said + (f"; not yet told apart from {', '.join(others)}" if others else "")
    if diagnosis.fix:
        yield "what to do", diagnosis.fix


def _values(cause: ExplainedBy | Diagnosis) -> str:
    """A cause's number, or its numbers."""
    values = cause.value if isinstance(cause.value, tuple) else (cause.value,)
    return " / ".join(quantity(value, cause.unit or "") for value in values)
