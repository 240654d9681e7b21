"""How tables are written: by format, each streaming, and each file under its name only once it is whole."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Protocol

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from gcs_bridge.errors import UsageError
from gcs_bridge.exporting.conventions import Convention
from gcs_bridge.exporting.tables import TABLES, schema_of
from gcs_bridge.files import lead_nowhere, writing

__all__ = ["WRITERS", "Writer"]

_ROWS = 65_536  # that are written at once: what a reader can skip


class Writer(Protocol):
    """Takes tables in pieces; UsageError where they cannot be written."""

    def write(self, name: str, rows: pa.RecordBatch) -> None:
        """Take more rows of a table."""

    def finish(self) -> list[Path]:
        """All has come: the files that are there now."""

    def discard(self) -> None:
        """Leave nothing behind of what is not whole; nothing to do after `finish`."""


class _Table:
    """One file of one table."""

    def __init__(self, path: Path, schema: pa.Schema, open_writer: Callable[[IO[bytes], pa.Schema], Any]) -> None:
        self.path = path
        self._temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        self._waiting, self._count = list[pa.RecordBatch](), 0
        with writing(path):
            self._file = self._temporary.open("wb", buffering=0)
            try:
                self._writer = open_writer(self._file, schema)
            except OSError:
                self._file.close()
                self._temporary.unlink()
                raise

    def write(self, rows: pa.RecordBatch) -> None:
        self._waiting.append(rows)
        self._count += len(rows)
        if self._count >= _ROWS:
            self._flush()

    def finish(self) -> None:
        self._flush()
        with writing(self.path):
            self._writer.close()
            self._file.close()
            self._temporary.replace(self.path)

    def discard(self) -> None:
        if not self._file.closed:
            lead_nowhere(self._file.fileno())
            self._writer.close()
            self._file.close()
        self._temporary.unlink(missing_ok=True)

    def _flush(self) -> None:
        if not self._count:
            return
        with writing(self.path):
            self._writer.write_table(pa.Table.from_batches(self._waiting).combine_chunks())
        self._waiting, self._count = [], 0


class TableFiles:
    """A folder with a file a table; those without a row are there too, with their columns."""

    def __init__(
        self,
        folder: Path,
        frame: Convention,
        suffix: str,
        open_writer: Callable[[IO[bytes], pa.Schema], Any],
        said: dict[str, str],
        shape: Callable[[pa.RecordBatch], pa.RecordBatch] = lambda rows: rows,
    ) -> None:
        """Begin all files; `shape` makes of rows what the format can hold.

        UsageError where the folder cannot be written to.
        """
        self._shape = shape
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._suffix, self._open, self._said = folder, suffix, open_writer, said
        self._tables: dict[str, _Table] = {}
        try:
            for name, (columns, _) in TABLES.items():
                self._begin(name, schema_of(columns(frame)))
        except UsageError:
            self.discard()
            raise

    def write(self, name: str, rows: pa.RecordBatch) -> None:
        """Take more rows of a table; one that is not among `TABLES` begins with its first."""
        if name not in TABLES and name.lower() in TABLES:
            name += "_sent"  # not every file system tells ATTITUDE from attitude
        shaped = self._shape(rows)
        if name not in self._tables:
            self._begin(name, shaped.schema)
        self._tables[name].write(shaped)

    def _begin(self, name: str, schema: pa.Schema) -> None:
        path = self._folder / f"{name}{self._suffix}"
        self._tables[name] = _Table(path, schema.with_metadata(self._said), self._open)

    def finish(self) -> list[Path]:
        """Complete all files."""
        for table in self._tables.values():
            table.finish()
        return [table.path for table in self._tables.values()]

    def discard(self) -> None:
        """Remove what is not whole."""
        for table in self._tables.values():
            table.discard()


def _parquet(path: Path, frame: Convention, said: dict[str, str]) -> Writer:
    return TableFiles(
        path, frame, ".parquet", lambda file, schema: pq.ParquetWriter(file, schema, compression="zstd"), said
    )


def _csv(path: Path, frame: Convention, said: dict[str, str]) -> Writer:
    return TableFiles(path, frame, ".csv", pyarrow.csv.CSVWriter, said, _flat)


def _flat(rows: pa.RecordBatch) -> pa.RecordBatch:
    """Lists of fixed size as a column for each place, from 0; no text begins as a spreadsheet's formula does."""
    fields, columns = list[pa.Field](), list[pa.Array]()
    for field, column in zip(rows.schema, rows.columns, strict=True):
        if pa.types.is_fixed_size_list(field.type):
            size, values = field.type.list_size, column.flatten()
            fields += [pa.field(f"{field.name}_{at}", field.type.value_type) for at in range(size)]
            columns += [values[at::size] for at in range(size)]
        else:
            fields.append(field)
            is_text = pa.types.is_string(field.type)
            columns.append(pc.replace_substring_regex(column, r"^([=+@-])", r"'\1") if is_text else column)
    return pa.RecordBatch.from_arrays(columns, schema=pa.schema(fields))


def _mcap(path: Path, frame: Convention, said: dict[str, str]) -> Writer:
    from gcs_bridge.exporting.mcap import McapFile

    return McapFile(path, frame, said)


# By name: opens what a recording's tables are written to, at a path, in a convention, with what is said of all.
WRITERS: dict[str, Callable[[Path, Convention, dict[str, str]], Writer]] = {
    "parquet": _parquet,
    "csv": _csv,
    "mcap": _mcap,
}
