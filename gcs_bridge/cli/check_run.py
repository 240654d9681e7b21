"""Judges the recordings of `check`, one after the other or several at a time: what comes out is the same."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gcs_bridge.cli.recorded_events import append_events, events_of
from gcs_bridge.errors import GcsBridgeError, SourceError, UsageError
from gcs_bridge.executors.base import cores
from gcs_bridge.files import file_of
from gcs_bridge.recordings.packed import STANDARD_INPUT
from gcs_bridge.sinks.event_lines import EventLines

if TYPE_CHECKING:  # loaded when there is something to judge
    from gcs_bridge.evidence.place import Folder
    from gcs_bridge.pages.curves import Curves
    from gcs_bridge.recordings.check import Progress
    from gcs_bridge.report.schema import File
    from gcs_bridge.settings import Settings
    from gcs_bridge.sinks.base import Plan, Sink

__all__ = ["CheckTask", "Judged", "jobs_for", "judged", "judged_by_several", "size_of"]

_WORTH_S = 0.6  # of work for each process: to begin takes one 0.4 s
_BYTES_PER_S, _FILE_S = 25e6, 0.01  # what judging takes, roughly: more makes nothing wrong, but slower


@dataclass(frozen=True, kw_only=True)
class CheckTask:
    """What is judged, and what is kept of it."""

    recording: Path
    settings: Settings
    judged_by: Mapping[str, Any]  # arguments of a `Monitor`
    events: str | None = None  # as `--events` names it
    has_curves: bool = False
    evidence: Folder | None = None


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What came of it: its entry in the report, or why there is none."""

    entry: File | None = None
    failure: GcsBridgeError | None = None
    curves: Curves | None = None
    note: str | None = None  # on the evidence
    alarms: int = 0  # with evidence


def judged(task: CheckTask, progress: Progress | None = None) -> Judged:
    """Judge one recording, here and now. Raises UsageError; what is wrong with the recording is part of the result."""
    from gcs_bridge.recordings.check import check_file

    recording, judged_by = task.recording, task.judged_by
    curves: Curves | None = None
    sinks: list[Sink]
    plan = None if task.events is None else EventLines.plan(task.events)
    with events_of(recording, plan) as sinks:
        if task.has_curves:
            from gcs_bridge.pages.curves import Curves

            sinks.append(curves := Curves())
        try:
            if task.evidence is None:
                entry = check_file(recording, task.settings, **judged_by, progress=progress, sinks=sinks)
                return Judged(entry=entry, curves=curves)
            from gcs_bridge.evidence.gather import Evidence

            verified = {name: judged_by.get(name) for name in ("signing_key", "unsigned")}
            with Evidence(recording, task.evidence, judged_by["dialect"], **verified) as gathered:
                both = [gathered, *sinks]
                entry = check_file(recording, task.settings, **judged_by, progress=progress, sinks=both)
                count = gathered.complete(entry)
            note = _evidence(recording, task.evidence, count, gathered.left_out)
            return Judged(entry=entry, curves=curves, note=note, alarms=count)
        except SourceError as failure:
            return Judged(failure=failure)


def jobs_for(recordings: Sequence[Path], asked: int | None) -> int:
    """How many processes judge these recordings: as many as asked for, else so many as shorten it; 1: this one."""
    if any(file_of(recording)[0] == STANDARD_INPUT for recording in recordings):
        return 1  # no other process can read it
    most = min(len(recordings), cores() if asked is None else asked)
    if asked is not None or most < 2:
        return most
    held = {file_of(recording)[0] for recording in recordings}
    work_s = sum(map(size_of, held)) / _BYTES_PER_S + len(recordings) * _FILE_S
    return max(1, min(most, int(work_s / _WORTH_S)))


def judged_by_several(
    count: int, task_of: Callable[[int, int], CheckTask | None], jobs: int, events: Plan | None
) -> Iterator[Judged]:
    """What comes of so many recordings, in their order, judged by so many processes; `events`: where those go.

    `task_of` gives a recording's task by its place, told how many are judged at the time; None: not before one of them
    is done. Raises UsageError where one recording after the other would.
    """
    from gcs_bridge.executors.processes import Processes

    with tempfile.TemporaryDirectory(prefix="gcs-bridge-") as folder, Processes(jobs) as processes:
        done: dict[int, Judged] = {}
        given = 0

        def tasks() -> Iterator[_Numbered | None]:
            nonlocal given
            while given < count:
                task = task_of(given, given - told)
                if task is None:
                    yield None
                    continue
                kept = None if events is None else f"{folder}/{given}"
                given += 1
                yield _Numbered(given - 1, replace(task, events=kept))

        told = 0
        for outcome in processes.run(_judged_there, tasks()):
            place, task = outcome.task
            lost = SourceError(f"{task.recording}: not judged: {outcome.lost}")
            done[place] = outcome.result or Judged(failure=lost)
            while told in done:
                one = done.pop(told)
                if events is not None:
                    append_events(events, Path(folder, str(told)))
                told += 1
                if isinstance(one.failure, UsageError):
                    raise one.failure
                yield one


class _Numbered(NamedTuple):
    """A task, and its place among all."""

    place: int
    task: CheckTask


def _judged_there(numbered: _Numbered) -> Judged:
    """The same as `judged`, in a process of its own; UsageError is part of the result."""
    try:
        return judged(numbered.task)
    except UsageError as failure:
        return Judged(failure=failure)


def _evidence(recording: Path, folder: Folder, count: int, left_out: int) -> str:
    """What there is evidence of, in one line."""
    if not count:
        earlier = f"; what lies in {folder.path} is of an earlier run" if folder.is_there else ""
        why = f"no room for {left_out} alarms or warnings" if left_out else "nothing was raised"
        return f"{recording}: {why}, so there is no evidence of it{earlier}"
    more = f"; {left_out} more are left out" if left_out else ""
    return f"{recording}: evidence of what was raised ({count}) is in {folder.path}{more}"


def size_of(path: Path) -> int:
    """Bytes of the file, 0 where it cannot be told: who reads it will tell why."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
