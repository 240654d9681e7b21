"""The files of the dataset: a few tables, each in parts of many recordings, each part whole or not there."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset
import pyarrow.parquet as pq

from gcs_bridge.errors import UsageError, one_line
from gcs_bridge.files import writing
from gcs_bridge.survey.rows import Row

__all__ = ["TABLES", "parts_of", "read_table", "rows_in", "write_part"]

_TEXT, _INT, _FLOAT, _FLAG = pa.string(), pa.int64(), pa.float64(), pa.bool_()
_TEXTS, _FLOATS, _UTC = pa.list_(pa.string()), pa.list_(pa.float64()), pa.timestamp("us", "UTC")
_NAMED = {"content": _TEXT, "path": _TEXT, "folder": _TEXT, "start_utc": _UTC}
_VEHICLE = {"sysid": pa.int16(), "compid": pa.int16(), "autopilot": _TEXT, "type": _TEXT}
_COUNTS = ("frames", "bad_crc", "repaired_crc", "unverified", "skipped_bytes", "signed", "duplicates", "gap_count")
_SPREADS = [
    f"{name}_{part}" for name in ("residual", "raw", "tilt", "heading") for part in ("median", "p95", "p99", "max")
]
_EXPLAINED = dict.fromkeys(("pitch_trim_deg", "vtol_view_deg", "ahrs_trim_x_deg", "ahrs_trim_y_deg"), _FLOAT)

TABLES: dict[str, pa.Schema] = {
    "alarms": pa.schema(
        {
            **_NAMED,
            **_VEHICLE,
            **dict.fromkeys(("id", "check", "severity", "what", "is_not"), _TEXT),
            "boot": _INT,
            "raised_boot_s": _FLOAT,
            "cleared_boot_s": _FLOAT,
            "raised_utc": _UTC,
            "unit": _TEXT,
            "peak": _FLOAT,
            "axis": _TEXT,
            **dict.fromkeys(("tilt", "heading", "rotvec_x", "rotvec_y", "rotvec_z"), _FLOAT),
            "repeats": _INT,
            "grouped": _TEXT,
            "acknowledged": _FLAG,
            "cause": _TEXT,
            "causes": _TEXTS,
            "confidence": _TEXT,
            "distinguishable": _FLAG,
            "candidates": _TEXTS,
            "side": _INT,
            "cause_value": _FLOATS,
            "cause_unit": _TEXT,
            "cause_residual_deg": _FLOAT,
            "fix": _TEXT,
        }
    ),
    "checks": pa.schema(
        {
            **_NAMED,
            **_VEHICLE,
            **dict.fromkeys(("check", "verdict", "reason", "unit"), _TEXT),
            "coverage": _FLOAT,
            "pairs": _INT,
            "same_instant": _INT,
            **dict.fromkeys(_SPREADS, _FLOAT),
            **dict.fromkeys(("lag_ms", "bias_x", "bias_y", "bias_z"), _FLOAT),
            "explained_by": _TEXTS,
            "explained_estimated": _FLAG,
            **_EXPLAINED,
        }
    ),
    "recordings": pa.schema(
        {
            **_NAMED,
            "version": _TEXT,
            "settings": _TEXT,
            "verdict": _TEXT,
            "compared": _FLAG,
            "flight_s": _FLOAT,
            **dict.fromkeys(("vehicles", "alarms", "warnings"), _INT),
            "first_alarm": _TEXT,
            "first_cause": _TEXT,
            "bytes": _INT,
            **dict.fromkeys(_COUNTS, _INT),
            "read_fraction": _FLOAT,
            "remarks": _TEXTS,
            "page": _TEXT,
            "file_bytes": _INT,
            "stamp": _TEXT,
            "recordings_in_file": _INT,
        }
    ),
}
"""By name, in the order in which a part of each is written: what the last one names is there."""


def parts_of(folder: Path, table: str) -> list[Path]:
    """The parts of a table, oldest first."""
    return sorted((folder / table).glob("part-*.parquet"))


def read_table(folder: Path, table: str, columns: Sequence[str], where: pa.Expression | None = None) -> pa.Table:
    """Some columns of all parts. UsageError names the part that cannot be read."""
    paths = parts_of(folder, table)
    if not paths:
        return TABLES[table].empty_table().select(columns)
    try:
        whole = pyarrow.dataset.dataset(paths, TABLES[table], format="parquet")
        return whole.to_table(columns=list(columns), filter=where)
    except (OSError, pa.ArrowException) as error:
        for path in paths:
            _read(path)  # tells which it is
        raise UsageError(f"{folder / table}: cannot be read: {one_line(str(error))}") from None


def write_part(path: Path, rows: Iterable[Row], contents: Sequence[str], table: str) -> None:
    """Write rows of these contents to a part, beside what it has of others. UsageError: it cannot be written.

    Done twice it is as if it was done once.
    """
    schema = TABLES[table]
    new = pa.Table.from_pylist([{name: row[name] for name in schema.names} for row in rows], schema)
    if path.exists():
        before = _read(path)
        ours = pc.is_in(before["content"], pa.array(contents, _TEXT))
        new = pa.concat_tables([before.filter(pc.invert(ours)), new])
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with writing(path):
        try:
            with temporary.open("wb", buffering=0) as file:
                pq.write_table(new.combine_chunks(), file, compression="zstd")
                os.fsync(file.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def rows_in(path: Path) -> int:
    """How many rows a part has; 0 for one that is not there."""
    if not path.exists():
        return 0
    with _told(path):
        return int(pq.read_metadata(path).num_rows)


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """UsageError for a part that is damaged."""
    try:
        yield
    except (OSError, pa.ArrowException) as error:
        said = one_line(str(error))
        raise UsageError(f"{path}: cannot be read ({said}): move it away, and what was in it is judged anew") from None


def _read(path: Path) -> pa.Table:
    with _told(path):
        return pq.read_table(path, partitioning=None)
