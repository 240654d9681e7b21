"""Which tables there are, and what each column holds: frame and unit stand in its name, and in its metadata.

Times are `t_boot_us`, on the clock of the vehicle since its boot number `boot`, and `t_rx_us`, the receive time in µs
since 1970; `frame_index` is the number of the frame in its recording with which a row was complete. NaN that was sent
stays NaN; what is unknown is null.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pyarrow as pa

from gcs_bridge import attitude
from gcs_bridge.columns import Floats
from gcs_bridge.events import Event
from gcs_bridge.exporting.conventions import Convention
from gcs_bridge.judging.observation import Observation
from gcs_bridge.sinks.event_lines import event_json, event_words
from gcs_bridge.telemetry.samples import AttitudeSamples

__all__ = ["TABLES", "Column", "event_rows", "schema_of", "tables_of"]

_WXYZ, _XYZ = ("w", "x", "y", "z"), ("x", "y", "z")
_FLOAT, _INT, _BOOL, _TEXT = pa.float64(), pa.int64(), pa.bool_(), pa.string()


class Column(NamedTuple):
    """A column: its name, type, unit and meaning."""

    name: str
    type: pa.DataType
    unit: str = ""
    said: str = ""


Values = tuple[Any, ...]
"""The values of a table's columns, in their order."""


def tables_of(one: Observation, frame: Convention) -> Iterator[tuple[str, pa.RecordBatch]]:
    """What one batch brought, table by table; none without rows."""
    for name, (columns, fill) in TABLES.items():
        values = None if fill is None else fill(one, frame)
        if values is None or not len(values[0]):
            continue
        same = [np.full(len(values[0]), number) for number in (*one.vehicle.address, one.segment.boot)]
        schema = schema_of(columns(frame))
        arrays = [pa.array(of, column.type) for of, column in zip((*same, *values), schema, strict=True)]
        yield name, pa.RecordBatch.from_arrays(arrays, schema=schema)


def event_rows(events: Sequence[Event]) -> pa.RecordBatch:
    """Events as rows; `json` holds each one whole, as `--events` writes it."""
    rows = []
    for event in events:
        text = event_json(event)
        told = msgspec.json.decode(text)
        sysid, compid = told.get("vehicle") or (None, None)
        boot_s = told.get("boot_s")
        rows.append(
            {
                "sysid": sysid,
                "compid": compid,
                "boot": told.get("boot"),
                "t_boot_us": None if boot_s is None else round(boot_s * 1e6),
                "utc": told.get("utc"),
                "event": told["event"],
                "check": told.get("check"),
                "severity": told.get("severity"),
                "id": told.get("id"),
                "text": event_words(event),
                "json": text.decode().strip(),
            }
        )
    return pa.RecordBatch.from_pylist(rows, schema=schema_of(_events(None)))


def schema_of(columns: Sequence[Column]) -> pa.Schema:
    """The columns as Arrow has them, unit and meaning in each field's metadata."""
    return pa.schema(
        [pa.field(one.name, one.type, metadata={"unit": one.unit, "description": one.said}) for one in columns]
    )


def _whose() -> tuple[Column, ...]:
    return (
        Column("sysid", _INT, said="system id"),
        Column("compid", _INT, said="component id"),
        Column("boot", _INT, said="which boot of the vehicle, from 0"),
        Column("t_boot_us", _INT, "us", "since that boot, on the vehicle's clock"),
    )


def _when() -> tuple[Column, ...]:
    return (
        Column("t_rx_us", _INT, "us", "receive time since 1970, UTC"),
        Column("frame_index", _INT, said="number of the frame in its recording"),
    )


def _parts(name: str, parts: Sequence[str], unit: str, said: str) -> tuple[Column, ...]:
    return tuple(Column(f"{name}_{part}", _FLOAT, unit, said) for part in parts)


def _attitude_columns(frame: Convention) -> tuple[Column, ...]:
    angles = f"Z-Y-X angles, {frame.meaning}"
    return (
        *_whose(),
        *_when(),
        Column("valid", _BOOL, said="all numbers finite, and the norm within 0.5 of 1"),
        *(Column(f"{angle}_rad", _FLOAT, "rad", angles) for angle in ("roll", "pitch", "yaw")),
        *_parts(frame.q, _WXYZ, "1", f"attitude quaternion, {frame.meaning}; as sent, not normalised"),
        *_parts(f"w_{'nb_b' if frame.body == 'b' else frame.body}_rad_s", _XYZ, "rad/s", "body rates, body axes"),
    )


def _attitude_values(samples: AttitudeSamples, frame: Convention) -> Values:
    q = frame.attitude(samples.q_nb)
    sent = samples.rpy_rad if frame.world == "ned" else None
    rpy_rad = frame.rpy_rad(q) if sent is None else sent
    return (
        samples.t_boot_us,
        *_received(samples.t_rx_us, samples.frame_index),
        samples.valid,
        *rpy_rad.T,
        *q.T,
        *frame.vector(samples.w_nb_b_rad_s).T,
    )


def _received(t_rx_us: Any, frame_index: Any) -> Values:
    return pa.array(t_rx_us, _INT, mask=np.asarray(t_rx_us) <= 0), frame_index


def _euler(one: Observation, frame: Convention) -> Values:
    return _attitude_values(one.segment.euler, frame)


def _quaternion(one: Observation, frame: Convention) -> Values:
    return _attitude_values(one.segment.quaternion, frame)


def _secondary(one: Observation, frame: Convention) -> Values:
    return _attitude_values(one.flight.secondary, frame)


def _imu_columns(frame: Convention) -> tuple[Column, ...]:
    return (
        *_whose(),
        *_when(),
        Column("message", _TEXT, said="where it came from"),
        Column("t_sensor_us", _INT, "us", "the message's own clock"),
        *_parts(f"f_{frame.body}_m_s2", _XYZ, "m/s2", "specific force, body axes"),
        *_parts(f"w_{frame.body}_rad_s", _XYZ, "rad/s", "angular rate, body axes"),
        *_parts(f"m_{frame.body}_gauss", _XYZ, "gauss", "magnetic field, body axes"),
    )


def _imu(one: Observation, frame: Convention) -> Values | None:
    imu = one.flight.imu
    if imu is None:
        return None
    return (
        pa.array(imu.t_boot_us, _INT, mask=imu.t_boot_us < 0),
        *_received(imu.t_rx_us, imu.frame_index),
        [imu.source] * len(imu),
        imu.t_us,
        *_known(frame.vector(imu.f_b_m_s2)),
        *_known(frame.vector(imu.w_b_rad_s)),
        *_known(frame.vector(imu.m_b_gauss)),
    )


def _pair_columns(frame: Convention) -> tuple[Column, ...]:
    said = "of the quaternion, seen from the Euler angles once expected differences are undone"
    return (
        *_whose(),
        *_when(),
        Column("same_instant", _BOOL, said="both samples carry this time; else the faster stream is interpolated"),
        Column("judged", _BOOL, said="it could be told good or bad"),
        Column("counted", _BOOL, said="it has a vote in the alarm"),
        Column("angle_deg", _FLOAT, "deg", f"rotation {said}"),
        Column("limit_deg", _FLOAT, "deg", "above which a pair is bad: it grows with the bound"),
        Column("bound_deg", _FLOAT, "deg", "what the alignment alone may make of a perfect agreement"),
        Column("tilt_deg", _FLOAT, "deg", f"tilt {said}"),
        Column("heading_deg", _FLOAT, "deg", f"heading {said}; null where it means nothing"),
        Column("raw_deg", _FLOAT, "deg", "rotation before expected differences are undone"),
        *_parts(f"residual_{frame.body}_deg", _XYZ, "deg", f"rotation vector {said}, body axes"),
        *_parts(f"{frame.q}_euler", _WXYZ, "1", f"ATTITUDE, undone, unit: {frame.meaning}"),
        *_parts(f"{frame.q}_quaternion", _WXYZ, "1", f"ATTITUDE_QUATERNION, unit: {frame.meaning}"),
    )


def _pairs(one: Observation, frame: Convention) -> Values:
    pairs, found = one.pairs, one.disagreement
    raw_rad = attitude.angle_between(pairs.q_euler_sent, pairs.q_quaternion)
    in_rad = (found.angle, found.limit, pairs.bound_rad, found.tilt, found.heading, raw_rad)
    return (
        pairs.t_boot_us,
        *_received(pairs.t_rx_us, pairs.frame_index),
        pairs.same_instant,
        found.judged,
        found.counted,
        *(_or_null(np.degrees(of)) for of in in_rad),
        *_known(np.degrees(frame.vector(found.rotvec_body))),
        *_known(frame.attitude(pairs.q_euler)),
        *_known(frame.attitude(pairs.q_quaternion)),
    )


def _events(_: Convention | None) -> tuple[Column, ...]:
    return (
        *_whose(),
        Column("utc", _TEXT, said="receive time, ISO 8601"),
        Column("event", _TEXT, said="its kind"),
        Column("check", _TEXT, said="which check it is of"),
        Column("severity", _TEXT, said="of an alarm: warning or alarm"),
        Column("id", _TEXT, said="of an alarm"),
        Column("text", _TEXT, said="in words"),
        Column("json", _TEXT, said="the event whole, as --events writes it"),
    )


def _known(rows: Floats) -> tuple[pa.Array, ...]:
    return tuple(_or_null(column) for column in rows.T)


def _or_null(column: Floats) -> pa.Array:
    return pa.array(column, _FLOAT, from_pandas=True)


# By name: its columns in a convention, and their values of what one batch showed, behind those that say whose they are.
TABLES: dict[
    str,
    tuple[
        Callable[[Convention], tuple[Column, ...]],
        Callable[[Observation, Convention], Values | None] | None,
    ],
] = {
    "attitude": (_attitude_columns, _euler),
    "attitude_quaternion": (_attitude_columns, _quaternion),
    "imu": (_imu_columns, _imu),
    "secondary": (_attitude_columns, _secondary),
    "pairs": (_pair_columns, _pairs),
    "events": (_events, None),
}
