"""Judges recordings: each is fed to a Monitor, piece by piece; how anything is judged is not known here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from msgspec.structs import replace

from gcs_bridge.contract import readable
from gcs_bridge.errors import UsageError
from gcs_bridge.events import Event
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.observation import Observation
from gcs_bridge.recordings.source import open_recording
from gcs_bridge.report import Report
from gcs_bridge.report.schema import File
from gcs_bridge.settings import Settings, load_settings

Progress = Callable[[int, int], None]


class RecordingObserver(Protocol):
    """Whoever wants to see how a recording is judged."""

    def observe(self, observation: Observation) -> None:
        """Take what was judged: before the events that came of it."""

    def take(self, events: list[Event]) -> None:
        """Take the events of a piece of the recording, none included."""


def check(
    path: str | Path, profile: str = "default", *, settings: Settings | None = None, dialect: str = "all"
) -> Report:
    """Judge one recording; `report.to_dict()` is the contract's JSON.

    Raises SourceError where the file cannot be used, UsageError for an unknown profile or dialect.
    """
    return Report.of([check_file(Path(path), settings or load_settings(profile), dialect=dialect)])


def check_file(
    path: Path,
    settings: Settings,
    *,
    dialect: str = "all",
    sysid: int | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    progress: Progress | None = None,
    observer: RecordingObserver | None = None,
) -> File:
    """Judge one recording and return its entry in the report.

    `progress` is told bytes done and bytes in all, `observer` is shown how it is judged. Raises SourceError where the
    file cannot be used, UsageError where `from_s` is past its end or the file has no times to select by.
    """
    observe = None if observer is None else observer.observe
    monitor = Monitor(settings=settings, dialect=dialect, sysid=sysid, from_s=from_s, to_s=to_s, observer=observe)
    with open_recording(path, dialect) as source:
        if from_s is not None or to_s is not None:
            source.need_times("--from and --to cannot select by them")
        done = 0
        for piece in source.pieces():
            events = source.feed(monitor, piece)
            if observer is not None:
                observer.take(events)
            done += len(piece)
            if progress is not None:
                progress(done, source.size)
    if observer is not None:
        observer.take(monitor.finish())
    return closing_entry(monitor, path)


def closing_entry(monitor: Monitor, path: Path) -> File:
    """The report's entry of a recording that has been fed to `monitor` as a whole.

    Raises UsageError where nothing was recorded in the times to judge.
    """
    report = monitor.close()
    if monitor.window_is_empty:
        raise UsageError(f"{path}: nothing was recorded between --from and --to: {monitor.span_s:.1f} s in all")
    return replace(report.files[0], path=readable(str(path)))
