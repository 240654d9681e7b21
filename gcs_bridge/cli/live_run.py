"""What `listen` and `demo` share: their common options, and one live run from opened links to its report."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gcs_bridge.cli.terminal import complain, wants_colour
from gcs_bridge.contract import readable
from gcs_bridge.errors import UsageError
from gcs_bridge.events import Event

if TYPE_CHECKING:  # loaded when there is something to run
    from gcs_bridge.links.link import Link
    from gcs_bridge.links.loop import Stop
    from gcs_bridge.report import Report
    from gcs_bridge.settings import Settings
    from gcs_bridge.sinks.file import LiveFile
    from gcs_bridge.viewer import ViewerSpec

__all__ = ["LiveOptions", "LiveRun", "live_options", "refuse_not_positive"]

_Command = TypeVar("_Command", bound=Callable[..., Any])

STDOUT = "-"
_COLOURS = {"alarm_raised": "red", "alarm_cleared": "green", "no_compare": "yellow", "vehicle_lost": "yellow"}
_WARM_UP_BYTES = 40_000  # of the bundled recording: a second or two of flight, so every kernel runs once


@dataclass(frozen=True, kw_only=True)
class LiveOptions:
    """The options that every live command has, as given."""

    viewer: str
    events: str | None
    record: Path | None
    profile: str
    config: Path | None
    dialect: str
    quiet: bool
    verbose: bool
    no_color: bool


def live_options(command: _Command) -> _Command:
    """Give a command the options of `LiveOptions`, under their own names."""
    for option in reversed(
        (
            click.option(
                "--viewer",
                default="auto",
                metavar="WHICH",
                help="auto, native, web, save:FILE.rrd or none.  [auto]",
            ),
            click.option("--record", type=click.Path(path_type=Path), metavar="FILE.tlog", help="Append every frame."),
            click.option("--events", metavar="FILE|-", help="Append events as JSON lines; - is standard output."),
            click.option("--profile", default="default", metavar="NAME", help="Shipped settings: default, ci."),
            click.option("--config", type=click.Path(path_type=Path), metavar="FILE", help="TOML with your settings."),
            click.option("--dialect", default="all", metavar="NAME", help="MAVLink dialect to read with.  [all]"),
            click.option("-q", "--quiet", is_flag=True, help="Only alarms."),
            click.option("-v", "--verbose", is_flag=True, help="Pending alarms too, and the whole report at the end."),
            click.option("--no-color", is_flag=True, help="Plain text; so does the variable NO_COLOR."),
        )
    ):
        command = option(command)
    return command


def refuse_not_positive(option: str, value: float | None) -> None:
    """Raise UsageError for a number that is no positive one."""
    if value is not None and not (math.isfinite(value) and value > 0):
        raise UsageError(f"{option} {value:g}: must be above 0")


class LiveRun:
    """One run: refuses at once what cannot be, then opens links, files and viewer, listens, and sums up."""

    def __init__(self, options: LiveOptions) -> None:
        """Check everything that can be checked without opening anything; UsageError says what is wrong."""
        from gcs_bridge.files import refuse_unwritable
        from gcs_bridge.settings import load_settings

        self._options = options
        self._settings: Settings = load_settings(options.profile, options.config)
        self._viewer: ViewerSpec | None = None
        if options.viewer != "none":  # then its package is not even looked at
            from gcs_bridge.viewer import ViewerSpec

            self._viewer = ViewerSpec.parse(options.viewer)
        for path in (options.record, self._events_path):
            if path is not None:
                refuse_unwritable(path, sources=[])
        if options.record and self._events_path and options.record.resolve() == self._events_path.resolve():
            raise UsageError(f"--record and --events cannot both write {options.record}")
        self._files: list[LiveFile] = []
        self._colour = wants_colour(no_color=options.no_color)

    @property
    def _events_path(self) -> Path | None:
        return Path(self._options.events) if self._options.events not in (None, STDOUT) else None

    def run(
        self,
        openers: Sequence[Callable[[], Link]],
        *,
        title: str,
        duration_s: float | None,
        beside: Callable[[], AbstractContextManager[Any]] = nullcontext,
        also_tell: Callable[[Event], None] = lambda _: None,
    ) -> int:
        """Listen on the links that `openers` open until a signal, or `duration_s`, ends it; returns the exit code.

        `beside` is entered for the time of listening; `also_tell` gets every event. A link that cannot be opened is a
        SourceError.
        """
        from gcs_bridge.links.loop import Stop

        with Stop() as stop, ExitStack() as stack:
            try:
                return self._run(stack, stop, openers, title, duration_s, beside, also_tell)
            except KeyboardInterrupt:  # before anything was heard, or by somebody in a hurry
                return 0

    def _run(
        self,
        stack: ExitStack,
        stop: Stop,
        openers: Sequence[Callable[[], Link]],
        title: str,
        duration_s: float | None,
        beside: Callable[[], AbstractContextManager[Any]],
        also_tell: Callable[[Event], None],
    ) -> int:
        from gcs_bridge.judging.monitor import Monitor
        from gcs_bridge.links.loop import link_name, listen
        from gcs_bridge.sinks.event_lines import event_json
        from gcs_bridge.sinks.tlog import TlogRecorder

        options = self._options
        _warm_up(self._settings, options.dialect)
        links: list[Link] = []
        for open_link in openers:
            links.append(open_link())
            stack.callback(links[-1].close)
        recorder = TlogRecorder(self._file(stack, options.record)) if options.record else None
        journal = self._file(stack, self._events_path) if self._events_path else None
        sink = None
        if self._viewer is not None:
            from gcs_bridge.viewer import open_viewer

            viewer = stack.enter_context(open_viewer(self._viewer, say=_note, live=True))
            sink = viewer.recording(title)
        monitor = Monitor(
            settings=self._settings,
            dialect=options.dialect,
            observer=sink.observe if sink else None,
            on_frames=recorder.record if recorder else None,
        )

        def tell(event: Event) -> None:
            link = link_name(event, links)
            if journal is not None:
                journal.append(event_json(event, link))
            if sink is not None:
                sink.event(event)
            also_tell(event)
            self._show(event, link, tell_link=len(links) > 1)

        with beside():
            stop.patient = True
            links_left = listen(
                links, monitor, tell, stop=lambda: stop.asked, duration_s=duration_s, watched=sink is not None
            )
        report = _named(monitor.close(), [link.name for link in links])
        self.print_result(report.to_text(detail=0 if options.verbose else -1))
        if not any(entry.bytes for entry in report.files):
            _note("nothing was received: does anything send here? gcs-bridge listens only, and never asks")
        if not links_left:
            complain("every link has ended")
            return 3
        return 2 if any(file.failed for file in self._files) else 0

    def print_result(self, text: str) -> None:
        """Print a part of the result: on standard output, unless that carries JSON lines."""
        click.echo(text, nl=False, err=self._options.events == STDOUT)

    def _show(self, event: Event, link: str, *, tell_link: bool) -> None:
        from gcs_bridge.files import write_stdout
        from gcs_bridge.sinks.event_lines import event_json, event_line, is_alarm, is_detail

        if self._options.events == STDOUT:
            write_stdout(event_json(event, link).decode())
        elif is_alarm(event) or not (self._options.quiet or (is_detail(event) and not self._options.verbose)):
            colour = _COLOURS.get(event.name) if self._colour else None
            where = f"  ({link})" if tell_link and event.vehicle else ""
            click.secho(event_line(event) + where, fg=colour, bold=event.name == "alarm_raised", color=self._colour)

    def _file(self, stack: ExitStack, path: Path) -> LiveFile:
        from gcs_bridge.sinks.file import LiveFile

        file = stack.enter_context(LiveFile(path, complain))
        self._files.append(file)
        return file


def _warm_up(settings: Settings, dialect: str) -> None:
    """Judge some of the bundled recording and forget it, so that nothing is loaded or compiled once data come."""
    from gcs_bridge import resources
    from gcs_bridge.jit import needs_compiling
    from gcs_bridge.judging.monitor import Monitor
    from gcs_bridge.mavlink.decode import gather
    from gcs_bridge.mavlink.scan import scan_kernel
    from gcs_bridge.pairing.kernel import match_kernel

    if needs_compiling(scan_kernel, gather, match_kernel):
        _note("compiling its kernels, once on this machine (some seconds)")
    with resources.demo_recording().open("rb") as recording:
        Monitor(settings=settings, dialect=dialect).feed_recording(recording.read(_WARM_UP_BYTES))


def _named(report: Report, names: Sequence[str]) -> Report:
    """The report with each link under its URI."""
    from msgspec.structs import replace

    from gcs_bridge.report import Report

    return Report.of(replace(entry, path=readable(name)) for entry, name in zip(report.files, names, strict=True))


def _note(text: str) -> None:
    complain(text, kind="note")
