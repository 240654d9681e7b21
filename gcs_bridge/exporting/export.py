"""The sink that fills the tables while a recording is judged."""

from __future__ import annotations

from collections.abc import Sequence

import pyarrow as pa

from gcs_bridge.events import Event
from gcs_bridge.exporting.conventions import Convention
from gcs_bridge.exporting.tables import event_rows, tables_of
from gcs_bridge.exporting.writers import Writer
from gcs_bridge.judging.observation import Observation
from gcs_bridge.sinks.base import Sink

__all__ = ["Export"]


class Export(Sink):
    """Gives what is judged to a writer, batch by batch: nothing is kept."""

    def __init__(self, writer: Writer, frame: Convention) -> None:
        """Start with nothing written."""
        self._writer, self._frame = writer, frame
        self.rows: dict[str, int] = {}

    def observe(self, observation: Observation) -> None:
        """Write what one batch showed of a vehicle."""
        for name, rows in tables_of(observation, self._frame):
            self._write(name, rows)

    def events(self, events: Sequence[Event]) -> None:
        """Write the events of a batch."""
        if events:
            self._write("events", event_rows(events))

    def _write(self, name: str, rows: pa.RecordBatch) -> None:
        self._writer.write(name, rows)
        self.rows[name] = self.rows.get(name, 0) + len(rows)
