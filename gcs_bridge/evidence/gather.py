"""Gathers the evidence of one recording's alarms while it is judged, and writes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
from msgspec.structs import asdict

from gcs_bridge._version import __version__
from gcs_bridge.contract import Alarm
from gcs_bridge.events import Event
from gcs_bridge.evidence.frames import frames_of
from gcs_bridge.evidence.place import Folder
from gcs_bridge.evidence.summary import DRAWN, summary
from gcs_bridge.evidence.tables import tables_of
from gcs_bridge.files import writing
from gcs_bridge.judging.alarm_windows import AlarmWindow, AlarmWindows
from gcs_bridge.judging.monitor import open_dialect
from gcs_bridge.judging.observation import Observation
from gcs_bridge.mavlink.signing import Signing, SigningKey, Unsigned
from gcs_bridge.recordings.open import open_recording
from gcs_bridge.report.schema import File, Vehicle
from gcs_bridge.sinks.base import Sink
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.open import is_installed

__all__ = ["Evidence"]


@dataclass(frozen=True)
class _Written:
    """What was written of one alarm."""

    path: Path
    vehicle: VehicleId
    alarm_id: str
    frames: tuple[int, int]  # indices: the first, and the first one behind
    events: tuple[Event, ...]
    rows: dict[str, int]


class Evidence(Sink):
    """A sink of how a recording is judged: `gcs_bridge.recordings.check.check_file(sinks=…)`.

    Tables and pictures are written as each moment ends; `complete`, with the report's entry, adds frames and summaries.
    """

    def __init__(
        self,
        recording: Path,
        folder: Folder,
        dialect: str,
        signing_key: SigningKey | None = None,
        unsigned: Unsigned | None = None,
    ) -> None:
        """Start with nothing gathered, and touch nothing before the first alarm; all as it is judged with."""
        self._recording = recording
        self._folder = folder
        self._dialect = dialect
        self._signing = Signing.of(signing_key, unsigned)
        self._moments = AlarmWindows()
        self._written: list[_Written] = []

    def __enter__(self) -> Evidence:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave nothing of what was not completed."""
        self._folder.discard()

    def observe(self, observation: Observation) -> None:
        """Take what was judged."""
        self._moments.observe(observation)

    def events(self, events: Sequence[Event]) -> None:
        """Take the events of a batch, and write the moments that are over."""
        self._write(self._moments.take(events))

    @property
    def left_out(self) -> int:
        """Alarms without evidence, as there were too many."""
        return self._folder.left_out + self._moments.missed

    def complete(self, entry: File) -> int:
        """The recording is judged: write what is left; how many alarms there is evidence of. UsageError: it cannot be.

        `entry` is the recording's in the report.
        """
        self._write(self._moments.finish())
        if not self._written:
            return 0
        with writing(self._folder.path):
            self._write_frames()
            index = [self._sum_up(entry, written) for written in self._written]
            said = {"version": __version__, "recording": entry.path, "bytes": entry.bytes, "alarms": index}
            self._folder.complete(msgspec.json.format(msgspec.json.encode(said)))
        return len(self._written)

    def _write(self, moments: list[AlarmWindow]) -> None:
        for moment in moments:
            with writing(self._folder.path):
                path = self._folder.new(moment.alarm.id)
                if path is None:
                    continue
                tables = tables_of(moment)
                for name, table in tables.items():
                    _save(table, path / f"{name}.parquet")
                if is_installed():
                    from gcs_bridge.viewer.moment import save_moment

                    save_moment(moment, f"{self._folder.path.name} {moment.alarm.id}", path / DRAWN)
            rows = {name: len(table) for name, table in tables.items()}
            about = (moment.vehicle, moment.alarm.id, (moment.first, moment.end), moment.events)
            self._written.append(_Written(path, *about, rows))

    def _write_frames(self) -> None:
        with open_recording(self._recording, self._dialect, judged=False) as source:
            ranges = [written.frames for written in self._written]
            for index, table in frames_of(source, ranges, open_dialect(self._dialect), self._signing):
                written = self._written[index]
                _save(table, written.path / "frames.parquet")
                written.rows["frames"] = len(table)

    def _sum_up(self, entry: File, written: _Written) -> dict[str, Any]:
        """Write an alarm's summary; its entry in the index."""
        vehicle, alarm = _alarm_of(entry, written)
        drawn = (written.path / DRAWN).exists()
        page = summary(entry.path, vehicle, alarm, written.rows, written.events, drawn=drawn)
        (written.path / "summary.md").write_text(page, encoding="utf-8")
        return {"folder": written.path.name, "vehicle": list(written.vehicle.address), **asdict(alarm)}


def _alarm_of(entry: File, written: _Written) -> tuple[Vehicle, Alarm]:
    """The vehicle's and the alarm's entry in the report."""
    for vehicle in entry.vehicles:
        if (vehicle.sysid, vehicle.compid) == written.vehicle.address:
            for alarm in vehicle.alarms:
                if alarm.id == written.alarm_id:
                    return vehicle, alarm
    raise LookupError(written.alarm_id)


def _save(table: pa.Table, path: Path) -> None:
    with path.open("wb") as file:
        pq.write_table(table, file, compression="zstd")
