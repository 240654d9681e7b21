"""`gcs-bridge replay`: shows recordings in the viewer."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from pathlib import Path

import click

from gcs_bridge.cli.live_run import refuse_not_positive
from gcs_bridge.cli.selection import Selection, selection_options
from gcs_bridge.cli.terminal import complain
from gcs_bridge.errors import UsageError
from gcs_bridge.viewer.base import FORMS

__all__ = ["replay"]


@click.command()
@click.argument("paths", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@click.option("--speed", type=float, metavar="X", help="Play X times as fast as it was; else all is shown at once.")
@click.option("--at", metavar="alarm|S", help="Open at the first alarm (of a check, or an id), or S s after the start.")
@click.option(
    "--align",
    type=click.Choice(["start", "alarm", "utc"]),
    help="Of several recordings, what lies at one time: their starts, their first alarms, or what was received then."
    "  [start]",
)
@click.option("--viewer", default="auto", metavar="WHICH", help=f"{FORMS}.  [auto]")
@click.option("--events", metavar="FILE|-", help="Write events as JSON lines; - is standard output.")
@selection_options("Show")
@click.option("-q", "--quiet", is_flag=True, help="Only what went wrong, and the web viewer's address.")
def replay(
    paths: tuple[Path, ...],
    speed: float | None,
    at: str | None,
    align: str | None,
    viewer: str,
    events: str | None,
    selection: Selection,
    quiet: bool,
) -> int:
    """Show recordings in the viewer: both attitudes, their disagreement, and the events.

    Several stand side by side in one scene, on one timeline, each under its file's name.
    A window or a page is served until Ctrl-C; save:FILE.rrd writes a file, to be opened with `rerun`, and ends.

    \b
    Exit codes: 0 shown, whatever was raised, 2 usage or configuration, 3 a source that cannot be used,
    4 no vehicle in it sent its attitude.
    """
    from gcs_bridge.checks import all_checks
    from gcs_bridge.cli.recorded_events import plan_events
    from gcs_bridge.cli.replay_run import START, Replay
    from gcs_bridge.judging.monitor import open_dialect
    from gcs_bridge.links.loop import Stop
    from gcs_bridge.recordings.packed import recordings_in
    from gcs_bridge.report import worst_exit_code
    from gcs_bridge.viewer import ViewerSpec, open_viewer

    refuse_not_positive("--speed", speed)
    if speed is not None and at is not None:
        raise UsageError("--at opens what is shown at once, and --speed plays it from its beginning: give one of them")
    spec = ViewerSpec.parse(viewer)
    settings = selection.settings()
    moment = _moment(at, [check.name for check in all_checks(settings)])
    open_dialect(selection.dialect)
    paths = tuple(dict.fromkeys(one for path in paths for one in recordings_in(path) or [path]))
    told = None if events is None else plan_events(events, paths, others=[spec.path] if spec.path else [])
    shown = Replay(
        paths=list(paths),
        selected={"settings": settings, **selection.window(), **selection.verified()},
        speed=speed,
        at=moment,
        align=align or (START if len(paths) > 1 else None),
        events=told,
        quiet=quiet,
    )
    with Stop():
        try:
            with open_viewer(spec, say=_note, sources=paths, live=speed is not None) as opened:
                codes = shown.run(opened)
                if opened.stays and 0 in codes:
                    _note("the viewer gets its data from this process: Ctrl-C ends it")
                    threading.Event().wait()
        except KeyboardInterrupt:
            return 0
    return worst_exit_code(codes)


def _moment(at: str | None, checks: Sequence[str]) -> float | str | None:
    """What `--at` asks for; UsageError for what is neither an alarm, a check nor a time."""
    from gcs_bridge.cli.replay_run import is_alarm_id

    if at is None or at in ("alarm", *checks) or is_alarm_id(at):
        return at
    try:
        seconds = float(at)
    except ValueError:
        seconds = math.nan
    if not (math.isfinite(seconds) and seconds >= 0):
        raise UsageError(
            f"--at {at}: must be alarm, the id of an alarm, a check ({', '.join(checks)}), "
            "or seconds after the recording's start, 0 or more"
        )
    return seconds


def _note(text: str) -> None:
    complain(text, kind="note")
