"""Tables as an MCAP file, for Foxglove and PlotJuggler: attitudes as frame transforms, events as a log, rows as JSON.

Topics begin with the vehicle: `/1.1/attitude/transform` and `/1.1/attitude_quaternion/transform` turn its body in its
world, `/1.1/attitude` and the other tables hold their rows, `/events` what happened. Log and publish time of a message
are that of its receipt. Where a recording's is damaged, they are the latest before; where it has none, they are the
vehicle's boot time, or 0 if a message does not carry it.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from gcs_bridge._version import __version__
from gcs_bridge.exporting.conventions import Convention
from gcs_bridge.exporting.tables import TABLES
from gcs_bridge.files import lead_nowhere, writing

__all__ = ["McapFile"]

_TRANSFORMED = ("attitude", "attitude_quaternion", "secondary")
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_TRANSFORM = {
    "title": "foxglove.FrameTransform",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "parent_frame_id": {"type": "string"},
        "child_frame_id": {"type": "string"},
        "translation": {"type": "object", "properties": {part: {"type": "number"} for part in "xyz"}},
        "rotation": {"type": "object", "properties": {part: {"type": "number"} for part in "xyzw"}},
    },
}
_LOG = {
    "title": "foxglove.Log",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
}
_INFO, _WARNING, _ERROR = 2, 3, 4  # foxglove.LogLevel
_BOOT_CLOCKS = (("t_boot_us", 1_000), ("time_boot_ms", 1_000_000))  # columns, and ns in their unit
_HERE = {"x": 0.0, "y": 0.0, "z": 0.0}


class McapFile:
    """One file with all tables of a recording."""

    def __init__(self, path: Path, frame: Convention, said: dict[str, str]) -> None:
        """Begin it. UsageError where it cannot be written."""
        self._path, self._frame = path, frame
        self._temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        self._encode = msgspec.json.Encoder().encode
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._latest_ns = 0
        self._has_times = False  # of receipt
        with writing(path):
            self._file = self._temporary.open("wb")
            self._mcap = McapWriter(self._file, compression=CompressionType.ZSTD)
            self._mcap.start(profile="", library=f"gcs-bridge {__version__}")
            self._mcap.add_metadata("gcs-bridge", {**said, "convention": frame.meaning})

    def write(self, name: str, rows: pa.RecordBatch) -> None:
        """Take more rows of a table."""
        with writing(self._path):
            if name == "events":
                self._write_events(rows)
                return
            if not len(rows):
                return
            vehicle = f"{rows['sysid'][0]}.{rows['compid'][0]}"
            times_ns = self._times_ns(rows)
            if name in _TRANSFORMED:
                self._write_transforms(f"{vehicle}/{name}", rows, times_ns)
            title = f"gcs_bridge.{name}" if name in TABLES else f"mavlink.{name}"
            topic = self._channel(f"/{vehicle}/{name}", title, _schema(title, rows.schema))
            for row, t_ns in zip(rows.to_pylist(), times_ns, strict=True):
                self._add(topic, t_ns, self._encode(row))  # of NaN, which JSON does not know, it makes null

    def finish(self) -> list[Path]:
        """Complete the file."""
        with writing(self._path):
            self._mcap.finish()  # type: ignore[no-untyped-call]  # mcap annotates its other methods, and not this one
            self._file.close()
            self._temporary.replace(self._path)
        return [self._path]

    def discard(self) -> None:
        """Remove what is not whole."""
        if not self._file.closed:
            lead_nowhere(self._file.fileno())
            self._file.close()
        self._temporary.unlink(missing_ok=True)

    def _write_transforms(self, child: str, rows: pa.RecordBatch, times_ns: list[int]) -> None:
        """The unit rotations from the body to the world: of what is no attitude there is none."""
        topic = self._channel(f"/{child}/transform", "foxglove.FrameTransform", _TRANSFORM)
        q = np.column_stack([rows[f"{self._frame.q}_{part}"].to_numpy(zero_copy_only=False) for part in "wxyz"])
        norm = np.linalg.norm(q, axis=1)
        for (w, x, y, z), size, valid, t_ns in zip(
            q.tolist(), norm.tolist(), rows["valid"].to_pylist(), times_ns, strict=True
        ):
            if valid:
                said = {
                    "timestamp": _stamp(t_ns),
                    "parent_frame_id": self._frame.world,
                    "child_frame_id": child,
                    "translation": _HERE,
                    "rotation": {"x": x / size, "y": y / size, "z": z / size, "w": w / size},
                }
                self._add(topic, t_ns, self._encode(said))

    def _write_events(self, rows: pa.RecordBatch) -> None:
        topic = self._channel("/events", "foxglove.Log", _LOG)
        for row in rows.to_pylist():
            t_ns = _parsed_ns(row["utc"]) or self._latest_ns
            level = {"alarm": _ERROR, "warning": _WARNING}.get(row["severity"] or "", _INFO)
            vehicle = "" if row["sysid"] is None else f"{row['sysid']}.{row['compid']}"
            said = {
                "timestamp": _stamp(t_ns),
                "level": level,
                "message": row["text"],
                "name": vehicle,
                "file": "",
                "line": 0,
            }
            self._add(topic, t_ns, self._encode(said))

    def _times_ns(self, rows: pa.RecordBatch) -> list[int]:
        clock, to_ns = next((one for one in _BOOT_CLOCKS if one[0] in rows.schema.names), (None, 0))
        boot = [None] * len(rows) if clock is None else rows[clock].to_pylist()
        times = []
        for received_us, since_boot in zip(rows["t_rx_us"].to_pylist(), boot, strict=True):
            if received_us is not None:
                self._has_times = True
                times.append(1000 * received_us)
            else:
                times.append(self._latest_ns if self._has_times else max(to_ns * (since_boot or 0), 0))
            self._latest_ns = max(self._latest_ns, times[-1])
        return times

    def _channel(self, topic: str, schema: str, layout: dict[str, Any]) -> int:
        if topic not in self._channels:
            if schema not in self._schemas:
                self._schemas[schema] = self._mcap.register_schema(schema, "jsonschema", self._encode(layout))
            self._channels[topic] = self._mcap.register_channel(topic, "json", self._schemas[schema])
        return self._channels[topic]

    def _add(self, channel: int, t_ns: int, data: bytes) -> None:
        self._mcap.add_message(channel, t_ns, data, t_ns)


def _schema(title: str, schema: pa.Schema) -> dict[str, Any]:
    """The JSON Schema of a table's rows."""
    said: dict[str, Any] = {}
    for field in schema:
        told = field.metadata or {}
        words = f"{told.get(b'description', b'').decode()} [{told.get(b'unit', b'').decode()}]"
        said[field.name] = {"type": _type(field.type), "description": words.removesuffix(" []")}
    return {"title": title, "type": "object", "properties": said}


def _type(of: pa.DataType) -> str:
    if pa.types.is_integer(of):
        return "integer"
    if pa.types.is_floating(of):
        return "number"
    return {pa.bool_(): "boolean", pa.string(): "string"}.get(of, "array")


def _stamp(t_ns: int) -> dict[str, int]:
    return {"sec": t_ns // 1_000_000_000, "nsec": t_ns % 1_000_000_000}


def _parsed_ns(utc: str | None) -> int | None:
    return None if utc is None else int(np.datetime64(utc.rstrip("Z"), "ns").astype(np.int64))
