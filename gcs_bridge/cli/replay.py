"""`gcs-bridge replay`: shows recordings in the viewer."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from gcs_bridge.cli.check import refuse_times
from gcs_bridge.cli.live_run import refuse_not_positive
from gcs_bridge.cli.signing_options import key_of, signing_options
from gcs_bridge.cli.terminal import ProgressBar, complain
from gcs_bridge.errors import SourceError, UsageError
from gcs_bridge.viewer.base import FORMS

if TYPE_CHECKING:  # loaded when there is something to show
    from gcs_bridge.judging.monitor import Monitor
    from gcs_bridge.sinks.base import Plan
    from gcs_bridge.viewer import Viewer

__all__ = ["replay"]

_PACED_BYTES = (64, 65_536)  # the shortest and the longest chunk of a paced recording
_SMOOTH_S = 0.05  # what a chunk should last
_LONGEST_PAUSE_S = 5.0  # nobody waits for the rest of a longer one


@click.command()
@click.argument("paths", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@click.option("--speed", type=float, metavar="X", help="Play X times as fast as it was; else all is shown at once.")
@click.option("--at", metavar="alarm|S", help="Open at the first alarm, or S seconds after the recording's start.")
@click.option("--sysid", type=click.IntRange(1, 255), metavar="N", help="Show this system alone.")
@click.option("--from", "from_s", type=float, metavar="S", help="Begin S seconds after the recording's start.")
@click.option("--to", "to_s", type=float, metavar="S", help="End S seconds after the recording's start.")
@click.option("--viewer", default="auto", metavar="WHICH", help=f"{FORMS}.  [auto]")
@click.option("--events", metavar="FILE|-", help="Write events as JSON lines; - is standard output.")
@signing_options
@click.option("--profile", default="default", metavar="NAME", help="Shipped settings: default, ci.  [default]")
@click.option("--config", type=click.Path(path_type=Path), metavar="FILE", help="TOML with settings of your own.")
@click.option("--dialect", default="all", metavar="NAME", help="MAVLink dialect to read with.  [all]")
@click.option("-q", "--quiet", is_flag=True, help="Only what went wrong, and the web viewer's address.")
def replay(
    paths: tuple[Path, ...],
    speed: float | None,
    at: str | None,
    sysid: int | None,
    from_s: float | None,
    to_s: float | None,
    viewer: str,
    events: str | None,
    signing_key_file: Path | None,
    unsigned: str | None,
    profile: str,
    config: Path | None,
    dialect: str,
    quiet: bool,
) -> int:
    """Show recordings in the viewer: both attitudes, their disagreement, and the events.

    A window or a page is served until Ctrl-C; save:FILE.rrd writes a file, to be opened with `rerun`, and ends.

    \b
    Exit codes: 0 shown, whatever was raised, 2 usage or configuration, 3 a source that cannot be used,
    4 no vehicle in it sent its attitude.
    """
    from gcs_bridge.cli.recorded_events import plan_events
    from gcs_bridge.judging.monitor import open_dialect
    from gcs_bridge.links.loop import Stop
    from gcs_bridge.report import worst_exit_code
    from gcs_bridge.settings import load_settings
    from gcs_bridge.viewer import ViewerSpec, open_viewer

    refuse_times(from_s, to_s)
    refuse_not_positive("--speed", speed)
    moment = _moment(at)
    if speed is not None and at is not None:
        raise UsageError("--at opens what is shown at once, and --speed plays it from its beginning: give one of them")
    spec = ViewerSpec.parse(viewer)
    settings = load_settings(profile, config)
    open_dialect(dialect)
    told = None if events is None else plan_events(events, paths, others=[spec.path] if spec.path else [])
    selected: dict[str, Any] = {
        "settings": settings,
        "dialect": dialect,
        "sysid": sysid,
        "from_s": from_s,
        "to_s": to_s,
    }
    selected |= {"signing_key": key_of(signing_key_file, unsigned), "unsigned": unsigned}

    with Stop():
        try:
            with open_viewer(spec, say=_note, sources=paths, live=speed is not None) as shown:
                codes = [
                    _show(path, shown, selected, speed=speed, moment=moment, events=told, quiet=quiet) for path in paths
                ]
                if shown.stays and 0 in codes:
                    _note("the viewer gets its data from this process: Ctrl-C ends it")
                    threading.Event().wait()
        except KeyboardInterrupt:
            return 0
    return worst_exit_code(codes)


def _show(
    path: Path,
    viewer: Viewer,
    selected: dict[str, Any],
    *,
    speed: float | None,
    moment: Literal["alarm"] | float | None,
    events: Plan | None,
    quiet: bool,
) -> int:
    """Show one recording; the exit code that it alone would give."""
    from gcs_bridge.cli.recorded_events import events_of
    from gcs_bridge.judging.monitor import Monitor
    from gcs_bridge.recordings.check import closing_entry, feed
    from gcs_bridge.recordings.open import open_recording
    from gcs_bridge.report import Report
    from gcs_bridge.sinks.base import Sinks

    try:
        with open_recording(path, selected["dialect"]) as source, events_of(path, events) as lines:
            if selected["from_s"] is not None or selected["to_s"] is not None:
                source.need_times("--from and --to cannot select by them")
            if speed is not None:
                source.need_times("--speed cannot pace it")
            if isinstance(moment, float):
                source.need_times("--at cannot find a time in it")
            sink = viewer.recording(path.name)
            sinks = Sinks([sink, *lines])
            monitor = Monitor(**selected, observer=sinks.observer, on_frames=sinks.on_frames)
            pace = None if speed is None else _Pace(monitor, speed)
            with ProgressBar(total_bytes=source.size, enabled=not quiet and pace is None) as progress:

                def after(done: int) -> None:
                    progress(done, source.size)
                    if pace:
                        pace.keep()

                feed(source.chunks(pace.chunk_bytes) if pace else source, monitor, sinks, after)
            entry = closing_entry(monitor, path, source.remarks)
    except SourceError as failure:
        complain(str(failure))
        return failure.exit_code
    at = round(moment * 1e6) + (source.start_us or 0) if isinstance(moment, float) else moment
    if not sink.finish(at) and viewer.kind != "none":
        if at != "alarm":
            raise UsageError(f"{path}: --at {moment:g} is past its end: {monitor.span_s:.1f} s in all")
        _note(f"{path}: no alarm was raised, so it is opened at its beginning")
    if not quiet:
        click.echo(Report.of([entry]).to_text(detail=-1), nl=False, err=events is not None and events.takes_stdout)
    if not any(stream in vehicle.streams for vehicle in entry.vehicles for stream in _ATTITUDES):
        return 4
    return 0


_ATTITUDES = ("ATTITUDE", "ATTITUDE_QUATERNION")


class _Pace:
    """Feeds a recording no faster than it was recorded, `speed` times."""

    def __init__(
        self,
        monitor: Monitor,
        speed: float,
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._monitor = monitor
        self._speed = speed
        self._now_s = now_s
        self._sleep = sleep
        self._start_s = now_s()
        self._bytes = _PACED_BYTES[0]

    def chunk_bytes(self) -> int:
        """How much to read next: so much that a chunk lasts an eye's blink, whatever the rate."""
        return self._bytes

    def keep(self) -> None:
        """Wait until the time of what has been fed has come; a long pause in the recording is cut short."""
        ahead_s = self._monitor.span_s / self._speed - (self._now_s() - self._start_s)
        shortest, longest = _PACED_BYTES
        self._bytes = min(max(self._bytes // 2 if ahead_s > _SMOOTH_S else self._bytes * 2, shortest), longest)
        if ahead_s > _LONGEST_PAUSE_S:
            self._start_s -= ahead_s - _LONGEST_PAUSE_S
            ahead_s = _LONGEST_PAUSE_S
        if ahead_s > 0:
            self._sleep(ahead_s)


def _moment(at: str | None) -> Literal["alarm"] | float | None:
    """What `--at` asks for; UsageError for what is neither an alarm nor a time."""
    if at is None or at == "alarm":
        return "alarm" if at else None
    try:
        seconds = float(at)
    except ValueError:
        seconds = math.nan
    if not (math.isfinite(seconds) and seconds >= 0):
        raise UsageError(f"--at {at}: must be alarm, or seconds after the recording's start, 0 or more")
    return seconds


def _note(text: str) -> None:
    complain(text, kind="note")
