"""A replay: recordings fed to Monitors, at once or at the pace at which they were made, and drawn into one scene."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any

import click

from gcs_bridge.cli.recorded_events import events_of
from gcs_bridge.cli.terminal import ProgressBar, complain
from gcs_bridge.errors import SourceError, UsageError
from gcs_bridge.events import AlarmRaised, Event
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.recordings.check import closing_entry, steps
from gcs_bridge.recordings.open import open_recording
from gcs_bridge.recordings.source import Source
from gcs_bridge.report import Report
from gcs_bridge.report.schema import File
from gcs_bridge.sinks.base import Plan, Sink, Sinks
from gcs_bridge.viewer.base import UTC, Beside, Viewer, ViewerSink

__all__ = ["ALARM", "NO_ATTITUDE", "START", "Replay", "is_alarm_id", "labels_of"]

ALARM, START = "alarm", "start"
_TIMELINES = {START: "since_start", ALARM: "since_alarm", "utc": UTC}  # by what --align asks for

_PACED_BYTES = (64, 65_536)  # the shortest and the longest chunk of a paced recording
_SMOOTH_S = 0.05  # what a chunk should last
_LONGEST_PAUSE_S = 5.0  # nobody waits for the rest of a longer one

_LONGEST_LABEL = 20  # signs: it stands above the vehicle and before the title of each of its panels
NO_ATTITUDE = 4  # the exit code
_ATTITUDES = ("ATTITUDE", "ATTITUDE_QUATERNION")


class _Raised(Sink):
    """Keeps the alarms and warnings that were raised."""

    def __init__(self) -> None:
        self.all: list[AlarmRaised] = []

    def events(self, events: Sequence[Event]) -> None:
        self.all += [event for event in events if isinstance(event, AlarmRaised)]

    def first(self) -> AlarmRaised | None:
        """The first alarm; the first warning where there is none."""
        return next((one for one in self.all if one.severity == "alarm"), next(iter(self.all), None))


@dataclass
class _Recording:
    """One file of a replay; `done`: how much of it was fed, piece by piece; `entry`: what it came to."""

    path: Path
    source: Source
    monitor: Monitor
    sink: ViewerSink
    raised: _Raised
    done: Iterator[int]
    pace: _Pace | None
    entry: File | None = None


@dataclass(frozen=True, kw_only=True)
class Replay:
    """What is to be replayed, and how.

    `selected` goes to each Monitor; `speed` None: at once; `at` the moment to open at: seconds after the first
    recording's start, `ALARM`, or the id or check of an alarm; `align` of several: a key of what they meet by, None:
    one is alone. `events`: where theirs are written.
    """

    paths: Sequence[Path]
    selected: dict[str, Any]
    speed: float | None = None
    at: float | str | None = None
    align: str | None = None
    events: Plan | None = None
    quiet: bool = False

    def run(self, viewer: Viewer) -> list[int]:
        """Show all of them; the exit codes that each alone would give."""
        with ExitStack() as stack:
            sources, codes = self._opened(stack)
            if not sources:
                return codes
            shown = self._begun(viewer, sources, stack)
            codes += self._fed(shown)
            shown = [one for one in shown if one.entry is not None]
            self._open_at(shown, viewer)
        for one in shown:
            assert one.entry is not None
            if not self.quiet:
                to_stderr = self.events is not None and self.events.takes_stdout
                click.echo(Report.of([one.entry]).to_text(detail=-1), nl=False, err=to_stderr)
            streams = {name for vehicle in one.entry.vehicles for name in vehicle.streams}
            codes.append(NO_ATTITUDE if streams.isdisjoint(_ATTITUDES) else 0)
        return codes

    def _opened(self, stack: ExitStack) -> tuple[dict[Path, Source], list[int]]:
        """Those that can be used; and the exit codes of those that cannot."""
        sources, codes = {}, []
        for path in self.paths:
            try:
                source = sources[path] = stack.enter_context(open_recording(path, self.selected["dialect"]))
            except SourceError as failure:
                complain(str(failure))
                codes.append(failure.exit_code)
                continue
            if self.selected["from_s"] is not None or self.selected["to_s"] is not None:
                source.need_times("--from and --to cannot select by them")
            if self.speed is not None:
                source.need_times("--speed cannot pace it")
            if isinstance(self.at, float):
                source.need_times("--at cannot find a time in it")
            if self.align == UTC:
                source.need_times(f"--align {UTC} cannot place it")
        return sources, codes

    def _begun(self, viewer: Viewer, sources: dict[Path, Source], stack: ExitStack) -> list[_Recording]:
        """Each with its Monitor and its place in the viewer; nothing is fed yet."""
        paths = list(sources)
        name = ", ".join(path.name for path in paths[:3]) + (f" and {len(paths) - 3} more" if len(paths) > 3 else "")
        besides: list[Beside | None] = [None] * len(paths)
        starts_s = [0.0] * len(paths)  # where each begins on the timeline
        if self.align is not None:
            zeros = [self._zero(path, source) for path, source in sources.items()]
            besides = [
                Beside(label, _TIMELINES[self.align], zero) for label, zero in zip(labels_of(paths), zeros, strict=True)
            ]
            starts_s = [_start_s(source, zero) for source, zero in zip(sources.values(), zeros, strict=True)]
        sinks = viewer.recordings(name, besides)
        clock = None if self.speed is None else _Clock(self.speed)
        first_s = min(starts_s) + (self.selected["from_s"] or 0.0)
        shown = []
        for path, sink, start_s in zip(paths, sinks, starts_s, strict=True):
            raised = _Raised()
            told = Sinks([sink, raised, *stack.enter_context(events_of(path, self.events))])
            monitor = Monitor(**self.selected, observer=told.observer, on_frames=told.on_frames)
            pace = None if clock is None else _Pace(monitor, clock, after_s=start_s - first_s)
            source = sources[path]
            done = steps(source.chunks(pace.chunk_bytes) if pace else source, monitor, told)
            shown.append(_Recording(path, source, monitor, sink, raised, done, pace))
        return shown

    def _zero(self, path: Path, source: Source) -> Event | int | None:
        """Where a recording lies at the zero of the timeline on which all meet."""
        if self.align != ALARM:
            return source.start_us if self.align == START else None
        raised = _Raised()
        told = Sinks([raised])
        for _ in steps(source, Monitor(**self.selected), told):
            found = raised.first()
            if found is not None and found.severity == ALARM:
                break
        if (found := raised.first()) is None:
            raise UsageError(f"{path}: no alarm was raised in it to align it at: leave it out, or use --align {START}")
        return found

    def _fed(self, shown: list[_Recording]) -> list[int]:
        """Feed all of them: one after the other, or paced, always the one that is behind; exit codes of what fails."""
        codes = []
        left = list(shown)
        total = sum(one.source.size for one in shown)
        with ProgressBar(total_bytes=total, enabled=not self.quiet and self.speed is None) as progress:
            while left:
                one = min(left, key=lambda one: 0.0 if one.pace is None else one.pace.reached_s)
                try:
                    done = next(one.done, None)
                    if done is None:
                        left.remove(one)
                        progress.file_done(one.source.size)
                        one.entry = closing_entry(one.monitor, one.path, one.source.remarks)
                        continue
                except SourceError as failure:
                    left.remove(one)
                    complain(str(failure))
                    codes.append(failure.exit_code)
                    continue
                progress(done, total)
                if one.pace is not None:
                    one.pace.keep()
        return codes

    def _open_at(self, shown: list[_Recording], viewer: Viewer) -> None:
        """Lay the whole out, around the moment that was asked for."""
        for one in shown:
            one.sink.close()
        if self.at is None or not shown or viewer.kind == "none":
            for one in shown[:1]:
                one.sink.finish()
            return
        opened = self._open_at_alarm if isinstance(self.at, str) else self._open_at_second
        if opened(shown) and viewer.kind in ("web", "save") and not self.quiet:
            complain("the plots show the time around it; the cursor starts at the beginning: click there", kind="note")

    def _open_at_second(self, shown: list[_Recording]) -> bool:
        assert isinstance(self.at, float)
        first = shown[0]
        for one in shown[:1] if self.align == ALARM else shown:  # the first may be over by then, another not
            begin_us = (first if self.align == UTC else one).source.start_us or 0
            if one.sink.finish(round(self.at * 1e6) + begin_us):
                return True
        raise UsageError(f"{first.path}: --at {self.at:g} is past its end: {first.monitor.span_s:.1f} s in all")

    def _open_at_alarm(self, shown: list[_Recording]) -> bool:
        """Lay it out around an alarm, before warnings, if there is one; what else there is to open at is told."""
        asked = self.at
        assert isinstance(asked, str)
        raised = [(one, event) for one in shown for event in one.raised.all]
        fitting = [(one, event) for one, event in raised if asked in (ALARM, event.check, event.id)]
        files, ids = ", ".join(str(one.path) for one in shown), [event.id for _, event in raised]
        if not fitting:
            if is_alarm_id(asked):
                there = f"there are {', '.join(ids)}" if ids else "none was raised"
                raise UsageError(f"{files}: --at {asked}: no such alarm: {there}")
            what = "no alarm" if asked == ALARM else f"no alarm of {asked}"
            complain(f"{files}: {what} was raised, so it is opened at its beginning", kind="note")
            shown[0].sink.finish()
            return False
        one, event = next((found for found in fitting if found[1].severity == ALARM), fitting[0])
        if not one.sink.finish(event):  # its time is unknown
            one.sink.finish()
        ids.remove(event.id)
        if ids and not is_alarm_id(asked) and not self.quiet:
            complain(f"{one.path}: opened at {event.id}; --at takes an id as well: {', '.join(ids)}", kind="note")
        return True


def is_alarm_id(text: str) -> bool:
    """Whether it is written as reports, events and evidence write the id of an alarm.

    >>> is_alarm_id("1.1-euler_quaternion-0-1"), is_alarm_id("euler_quaternion")
    (True, False)
    """
    return re.fullmatch(r"\d+\.\d+-.+-\d+-\d+", text) is not None


def _start_s(source: Source, zero: Event | int | None) -> float:
    """Where a recording begins, seconds after the zero of its timeline; 0 where its times are unknown."""
    if source.start_us is None:
        return 0.0
    if isinstance(zero, Event):
        return source.start_us / 1e6 - datetime.fromisoformat(zero.utc).timestamp() if zero.utc else 0.0
    return (source.start_us - (zero or 0)) / 1e6


def labels_of(paths: Sequence[Path]) -> list[str]:
    """A short name for each recording, unlike all others: the file's, with its folder's where two files share one.

    >>> labels_of([Path("a/flight.tlog"), Path("b/flight.tlog"), Path("the other one.tlog")])
    ['a_flight', 'b_flight', 'the_other_one']
    """
    stems = [path.stem for path in paths]
    labels: list[str] = []
    for path, stem in zip(paths, stems, strict=True):
        text = f"{path.absolute().parent.name}_{stem}" if stems.count(stem) > 1 else stem
        text = re.sub(r"[^A-Za-z0-9_.-]+", "_", text)[-_LONGEST_LABEL:].lstrip("-_.") or "recording"
        alike = (text if number == 1 else f"{text}-{number}" for number in count(1))
        labels.append(next(label for label in alike if label not in labels))
    return labels


class _Clock:
    """The time of a replay: it stands at the pace of all its recordings."""

    def __init__(
        self, speed: float, now_s: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self._speed = speed
        self._now_s = now_s
        self._sleep = sleep
        self._start_s = now_s()

    def wait_until(self, reached_s: float) -> float:
        """Wait until so much of the recordings is due, a long pause in them is cut short; how long that was, s."""
        ahead_s = reached_s / self._speed - (self._now_s() - self._start_s)
        if ahead_s > _LONGEST_PAUSE_S:
            self._start_s -= ahead_s - _LONGEST_PAUSE_S
            ahead_s = _LONGEST_PAUSE_S
        if ahead_s > 0:
            self._sleep(ahead_s)
        return ahead_s


class _Pace:
    """Feeds a recording no faster than it was recorded, and no further than the clock; it begins `after_s`."""

    def __init__(self, monitor: Monitor, clock: _Clock, *, after_s: float = 0.0) -> None:
        self._monitor = monitor
        self._clock = clock
        self._after_s = after_s
        self._bytes = _PACED_BYTES[0]

    @property
    def reached_s(self) -> float:
        """Up to where it was fed, s after the first recording's beginning."""
        return self._after_s + self._monitor.span_s

    def chunk_bytes(self) -> int:
        """How much to read next: so much that a chunk lasts an eye's blink, whatever the rate."""
        return self._bytes

    def keep(self) -> None:
        """Wait until the time of what has been fed has come."""
        ahead_s = self._clock.wait_until(self.reached_s)
        shortest, longest = _PACED_BYTES
        self._bytes = min(max(self._bytes // 2 if ahead_s > _SMOOTH_S else self._bytes * 2, shortest), longest)
