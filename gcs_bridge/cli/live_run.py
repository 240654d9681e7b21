"""What `listen` and `demo` share: their common options, and one live run from opened links to its report."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gcs_bridge.cli.live_sinks import LIVE_SINKS, plan_sinks
from gcs_bridge.cli.selection import settings_options
from gcs_bridge.cli.terminal import complain
from gcs_bridge.contract import readable
from gcs_bridge.errors import UsageError
from gcs_bridge.sinks.base import Sink, SinkContext, Sinks

if TYPE_CHECKING:  # loaded when there is something to run
    from gcs_bridge.links.link import Link
    from gcs_bridge.links.loop import Stop
    from gcs_bridge.mavlink.signing import SigningKey, Unsigned
    from gcs_bridge.metrics.served import MetricsServer
    from gcs_bridge.report import Report
    from gcs_bridge.screen.view import View
    from gcs_bridge.sending.asked import Asked
    from gcs_bridge.sending.station import Station
    from gcs_bridge.settings import Settings

__all__ = ["LiveOptions", "LiveRun", "LiveTask", "live_options", "refuse_not_positive", "warm_up"]

_Command = TypeVar("_Command", bound=Callable[..., Any])

# So long what comes may gather while no alarm is on its way; where somebody looks on, for some 17 pictures a second.
_PATIENCE_S, _LOOKED_AT_S = 0.15, 0.055
_WARM_UP_BYTES = 40_000  # of the bundled recording: a second or two of flight, so every kernel runs once


@dataclass(frozen=True, kw_only=True)
class LiveOptions:
    """The options that every live command has, as given; `sinks` and their `limits` by the names of `LIVE_SINKS`."""

    sinks: Mapping[str, str]
    limits: Mapping[str, Mapping[str, float]]
    profile: str
    config: Path | None
    dialect: str
    quiet: bool
    verbose: bool
    no_color: bool
    plain: bool
    bell: bool

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> LiveOptions:
        """From the values of all options of `live_options`."""
        rest = dict(given)
        sinks = {name: value for name in LIVE_SINKS if (value := rest.pop(name)) is not None}
        limits = {
            name: {
                ending: value
                for ending in sink.limits
                if (value := rest.pop(f"{name}-{ending}".replace("-", "_"))) is not None
            }
            for name, sink in LIVE_SINKS.items()
        }
        return cls(sinks=sinks, limits=limits, **rest)


def live_options(command: _Command) -> _Command:
    """Give a command the options of `LiveOptions`, under their own names."""
    for option in reversed(
        (
            *_sink_options(),
            settings_options,
            click.option("-q", "--quiet", is_flag=True, help="Only alarms."),
            click.option("-v", "--verbose", is_flag=True, help="Pending alarms too, and the whole report at the end."),
            click.option("--plain", is_flag=True, help="Lines, where a terminal would show the full-screen view."),
            click.option("--bell", is_flag=True, help="Ring the terminal's bell for alarms."),
            click.option("--no-color", is_flag=True, help="No colours; so does the variable NO_COLOR."),
        )
    ):
        command = option(command)
    return command


def _sink_options() -> Iterator[Callable[[_Command], _Command]]:
    for name, sink in LIVE_SINKS.items():
        yield click.option(f"--{name}", default=sink.default, metavar=sink.metavar, help=sink.help)
        for ending, limit in sink.limits.items():
            yield click.option(f"--{name}-{ending}", type=float, metavar=limit.metavar, help=limit.help)


def refuse_not_positive(option: str, value: float | None) -> None:
    """Raise UsageError for a number that is no positive one."""
    if value is not None and not (math.isfinite(value) and value > 0):
        raise UsageError(f"{option} {value:g}: must be above 0")


@dataclass(frozen=True, kw_only=True)
class LiveTask:
    """What one run is to do; `title`: how it is called where it is shown."""

    openers: Sequence[Callable[[], Link]]
    """Each opens a link."""
    title: str
    duration_s: float | None
    beside: Callable[[], AbstractContextManager[Any]] = nullcontext
    """Entered for the time of listening."""
    sinks: Iterable[Sink] = ()
    """Beside those of the options."""
    asked: Asked | None = None
    """What is to be sent."""
    metrics_port: int | None = None
    """Where Prometheus may read."""
    signing_key: SigningKey | None = None
    unsigned: Unsigned | None = None
    """Both as a `Monitor` has them."""


class LiveRun:
    """One run: refuses at once what cannot be, then opens links, files and viewer, listens, and sums up."""

    def __init__(self, options: LiveOptions) -> None:
        """Check everything that can be checked without opening anything; UsageError says what is wrong."""
        from gcs_bridge.settings import load_settings

        self._options = options
        self._settings: Settings = load_settings(options.profile, options.config)
        self._plans = plan_sinks(options.sinks, options.limits)
        self._stdout_is_taken = any(plan.takes_stdout for plan in self._plans)

    def run(self, task: LiveTask) -> int:
        """Listen until a signal, or the task's time, ends it; returns the exit code.

        A link or a port that cannot be opened is a SourceError.
        """
        from gcs_bridge.links.loop import Stop

        with Stop() as stop, ExitStack() as stack:
            try:
                return self._run(stack, stop, task)
            except KeyboardInterrupt:  # before anything was heard, or by somebody in a hurry
                return 0

    def _run(self, stack: ExitStack, stop: Stop, task: LiveTask) -> int:
        from gcs_bridge.cli.service import Hangup, Notifier
        from gcs_bridge.judging.monitor import Monitor
        from gcs_bridge.links.loop import Errand, listen

        options = self._options
        notifier = Notifier()  # before anything is started that would inherit whom it tells
        warm_up(self._settings, options.dialect)
        links: list[Link] = []
        for open_link in task.openers:
            links.append(open_link())
            stack.callback(links[-1].close)
        station = self._station(stack, links, task.asked)
        metrics = self._metrics(stack, links, task.metrics_port)
        names = [link.name for link in links]
        shown, view = self._shown(stack, task.title, names)
        sinks = Sinks([*self._opened(stack, task.title, names), *shown, *station, *metrics, *task.sinks])
        hangup = stack.enter_context(Hangup(sinks.reopen, stop.ask))
        errands: list[Errand] = [*station, *metrics, notifier, hangup, *([view] if view else [])]
        monitor = Monitor(
            settings=self._settings,
            dialect=options.dialect,
            observer=sinks.observer,
            on_frames=sinks.on_frames,
            signing_key=task.signing_key,
            unsigned=task.unsigned,
            doctor_waits=True,
        )
        for server in metrics:
            server.follow(monitor)
        patience_s = _LOOKED_AT_S if view or sinks.observer else _PATIENCE_S
        # What is there by now stays: no later collection of garbage goes through it, and holds the loop up meanwhile.
        gc.collect()
        gc.freeze()
        stack.callback(gc.unfreeze)
        with task.beside(), view.watching(monitor, sinks.events, stop.ask) if view else nullcontext():
            stop.patient = True
            notifier.ready()
            listen(
                links,
                monitor,
                sinks.events,
                stop=lambda: stop.asked,
                duration_s=task.duration_s,
                note=_note,
                errands=errands,
                patience_s=0.0 if station else patience_s,  # what is passed on, or answered, waits for nothing
            )
            notifier.stopping()
        report = _named(monitor.close(), names)
        self.print_result(report.to_text(detail=0 if options.verbose else -1))
        if not any(entry.bytes for entry in report.files):
            asks = "" if task.asked is not None and task.asked.transmits else " gcs-bridge listens only, and never asks"
            _note(f"nothing was received: does anything send here?{asks}")
        return 2 if sinks.failed else 0

    def _station(self, stack: ExitStack, links: Sequence[Link], asked: Asked | None) -> list[Station]:
        """What sends, where anything was asked for that does; else none, and nothing can."""
        if asked is None or not asked.anything:
            return []
        from gcs_bridge.sending.station import Station

        for warning in asked.warnings():
            complain(warning, kind="warning")
        station = Station(asked, self._settings.transmit, links, dialect=self._options.dialect, note=_note)
        stack.callback(station.close)
        return [station]

    def _metrics(self, stack: ExitStack, links: Sequence[Link], port: int | None) -> list[MetricsServer]:
        """What Prometheus reads, where that was asked for."""
        if port is None:
            return []
        from gcs_bridge.metrics.served import MetricsServer

        server = MetricsServer(port, [link.name for link in links])
        stack.callback(server.close)
        _note(f"metrics are at {server.url}")
        return [server]

    def print_result(self, text: str) -> None:
        """Print a part of the result: on standard output, unless a sink has that for itself."""
        click.echo(text, nl=False, err=self._stdout_is_taken)

    def _opened(self, stack: ExitStack, title: str, links: Sequence[str]) -> list[Sink]:
        """The sinks that were asked for."""
        context = SinkContext(title=title, links=links, note=_note, complain=complain, stack=stack)
        sinks: list[Sink] = []
        for plan in self._plans:
            sinks.append(plan.open(context))
            stack.callback(sinks[-1].close)
        return sinks

    def _shown(self, stack: ExitStack, title: str, links: Sequence[str]) -> tuple[list[Sink], View | None]:
        """What people see, where standard output is free; and the same if it is a view on the terminal."""
        if self._stdout_is_taken:
            return [], None
        from gcs_bridge.cli.shown import open_shown

        options = self._options
        shown, view = open_shown(
            links,
            title=title,
            detail=-1 if options.quiet else int(options.verbose),
            no_color=options.no_color,
            plain=options.plain,
            bell=options.bell,
        )
        if view is not None:
            stack.callback(view.close)
            view.catch_notes()
        return [shown], view


def warm_up(settings: Settings, dialect: str) -> None:
    """Judge some of the bundled recording and forget it, so that nothing is loaded or compiled once data come."""
    from gcs_bridge import resources
    from gcs_bridge.jit import prepare
    from gcs_bridge.judging.monitor import Monitor

    prepare("gcs_bridge")
    import_module("gcs_bridge.diagnosis")  # the doctor, who is asked in the midst of a flight
    with resources.demo_recording().open("rb") as recording:
        Monitor(settings=settings, dialect=dialect).feed_recording(recording.read(_WARM_UP_BYTES))


def _named(report: Report, names: Sequence[str]) -> Report:
    """The report with each link under its URI."""
    from msgspec.structs import replace

    from gcs_bridge.report import Report

    return Report.of(replace(entry, path=readable(name)) for entry, name in zip(report.files, names, strict=True))


def _note(text: str) -> None:
    complain(text, kind="note")
