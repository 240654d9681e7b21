"""`gcs-bridge export`: a recording as tables for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_bridge.cli.selection import Selection, selection_options
from gcs_bridge.cli.terminal import ProgressBar, complain
from gcs_bridge.errors import one_line

if TYPE_CHECKING:  # loaded when there is something to write
    from gcs_bridge.exporting.writers import Writer

__all__ = ["export"]

_FORMATS = ("parquet", "csv", "mcap", "rrd")
_MOST_NAMED = 5  # files
_FRAMES = ("ned_frd", "enu_flu", "enu_rfu")


@click.command()
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option("--format", "form", type=click.Choice(_FORMATS), default="parquet", help="What to write.  [parquet]")
@click.option(
    "--output", type=click.Path(path_type=Path), metavar="DIR|FILE", help="A folder for parquet and csv, else a file."
)
@click.option("--frame", type=click.Choice(_FRAMES), default="ned_frd", help="World and body axes.  [ned_frd]")
@click.option("--all", "every", is_flag=True, help="Every other message too, as it was sent, in a table of its own.")
@selection_options("Export")
@click.option("-q", "--quiet", is_flag=True, help="Only what went wrong.")
def export(
    path: Path,
    form: str,
    output: Path | None,
    frame: str,
    every: bool,
    selection: Selection,
    quiet: bool,
) -> int:
    """Write a recording's samples, pairs, residuals and events as tables: frame and unit stand in each column's name.

    Tables: attitude, attitude_quaternion, imu, secondary, pairs, events. mcap is for Foxglove and PlotJuggler (with
    --frame enu_flu, as ROS has it), rrd for the rerun viewer.

    \b
    Exit codes: 0 written, 2 usage or configuration, 3 a source that cannot be used,
    4 no vehicle in it sent its attitude.
    """
    from gcs_bridge.errors import UsageError
    from gcs_bridge.recordings.packed import name_of

    settings = selection.settings()
    selected = selection.window() | selection.verified()
    target = output or Path(f"{name_of(path)}-export" if form in ("parquet", "csv") else f"{name_of(path)}.{form}")
    if form == "rrd":
        if frame != "ned_frd":
            raise UsageError(f"--frame {frame}: the viewer's scene is in ned_frd alone")
        if every:
            raise UsageError("--all: the viewer shows no tables; give another --format")
        return _to_viewer(path, target, settings, selected, quiet=quiet)
    return _to_tables(path, form, target, frame, settings, selected, every=every, quiet=quiet)


def _to_tables(
    path: Path,
    form: str,
    target: Path,
    frame: str,
    settings: Any,
    selected: dict[str, Any],
    *,
    every: bool,
    quiet: bool,
) -> int:
    from gcs_bridge._version import __version__
    from gcs_bridge.contract import readable
    from gcs_bridge.exporting.conventions import CONVENTIONS
    from gcs_bridge.exporting.export import Export
    from gcs_bridge.exporting.writers import WRITERS
    from gcs_bridge.files import refuse_unwritable
    from gcs_bridge.recordings.check import check_file
    from gcs_bridge.report.verdicts import sends_attitude

    if form == "mcap":
        refuse_unwritable(target, sources=[path])
    said = {"source": readable(path.name), "made_by": f"gcs-bridge {__version__}", "frame": frame}
    writer = WRITERS[form](target, CONVENTIONS[frame], said)
    try:
        sink = Export(writer, CONVENTIONS[frame])
        size = path.stat().st_size if path.is_file() else 0
        with ProgressBar(total_bytes=size, enabled=not quiet) as progress:
            entry = check_file(path, settings, **selected, progress=progress, sinks=[sink])
        if every:
            _write_messages(path, writer, sink.rows, selected)
        written = writer.finish()
    finally:
        writer.discard()
    if not quiet:
        if older := _beside(written):
            more = f" and {len(older) - _MOST_NAMED} more" if len(older) > _MOST_NAMED else ""
            names = ", ".join(older[:_MOST_NAMED])
            complain(f"{target}: there before, and not of this recording: {names}{more}", kind="note")
        rows = ", ".join(f"{count} {name}" for name, count in sink.rows.items()) or "no rows"
        complain(f"{target}: {rows}", kind="note")
    return 0 if any(map(sends_attitude, entry.vehicles)) else 4


def _beside(written: list[Path]) -> list[str]:
    """Files of the same kind in the same folder as tables that were written: others took them for theirs."""
    if len(written) == 1:
        return []
    folder, suffix = written[0].parent, written[0].suffix
    return sorted(one_line(path.name) for path in folder.glob(f"*{suffix}") if path not in written)


def _write_messages(path: Path, writer: Writer, rows: dict[str, int], selected: dict[str, Any]) -> None:
    """Every message of a recording, by reading it once more."""
    from gcs_bridge.recordings.batches import iter_batches

    same = {name: value for name, value in selected.items() if name not in ("from_s", "to_s")}
    for batch in iter_batches(path, start=selected["from_s"], end=selected["to_s"], **same):
        writer.write(batch.message, batch.to_arrow())
        rows[batch.message] = rows.get(batch.message, 0) + len(batch)


def _to_viewer(path: Path, target: Path, settings: Any, selected: dict[str, Any], *, quiet: bool) -> int:
    from gcs_bridge.recordings.check import check_file
    from gcs_bridge.report.verdicts import sends_attitude
    from gcs_bridge.viewer import ViewerSpec, open_viewer

    def say(text: str) -> None:
        if not quiet:
            complain(text, kind="note")

    with open_viewer(ViewerSpec.parse(f"save:{target}"), say=say, sources=[path], live=False) as viewer:
        sink = viewer.recording(path.name)
        size = path.stat().st_size if path.is_file() else 0
        with ProgressBar(total_bytes=size, enabled=not quiet) as progress:
            entry = check_file(path, settings, **selected, progress=progress, sinks=[sink])
        sink.finish(None)
    return 0 if any(map(sends_attitude, entry.vehicles)) else 4
