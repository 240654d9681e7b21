"""`gcs-bridge check`: judges recordings and ends with what it found."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs_bridge.cli.selection import Selection, selection_options
from gcs_bridge.cli.terminal import ProgressBar, complain, print_coloured, wants_colour
from gcs_bridge.errors import GcsBridgeError, SourceError, UsageError
from gcs_bridge.recordings.open import READERS
from gcs_bridge.recordings.packed import ARCHIVE, PACKED, recordings_in
from gcs_bridge.report.formats import FORMATS, PAGE, TELL_REFUSED, Asked, format_of

if TYPE_CHECKING:  # loaded when there is something to judge
    from gcs_bridge.evidence.place import Folder
    from gcs_bridge.pages.curves import Curves
    from gcs_bridge.report.schema import File

__all__ = ["check", "find_recordings"]

_FOUND = (*READERS, *(suffix + PACKED for suffix in READERS), ARCHIVE)


@click.command()
@click.argument(
    "paths", nargs=-1, required=True, metavar="FILE|FOLDER...", type=click.Path(path_type=Path, readable=False)
)
@click.option(
    "--format",
    "form",
    type=click.Choice([*FORMATS, PAGE]),
    help="Of the report.  [by the ending of --output, else text]",
)
@click.option(
    "--output",
    "outputs",
    type=click.Path(path_type=Path),
    multiple=True,
    metavar="PATH",
    help="Write the report to this file; may be repeated.",
)
@click.option("--events", metavar="FILE|-", help="Write events as JSON lines; - is standard output.")
@click.option(
    "--baseline",
    type=click.Path(path_type=Path, readable=False),
    metavar="REPORT",
    help="An earlier report (JSON): fail by what is new alone.",
)
@click.option("--evidence", type=click.Path(path_type=Path), metavar="DIR", help="Write what each alarm rests on.")
@click.option("--fail-on", type=click.Choice(["warning", "alarm", "never"]), help="What ends with 1.  [alarm]")
@selection_options("Judge")
@click.option("-q", "--quiet", is_flag=True, help="Only the last line of each file.")
@click.option("-v", "--verbose", is_flag=True, help="Every number.")
@click.option("--no-color", is_flag=True, help="Plain text; so does the variable NO_COLOR.")
def check(
    paths: tuple[Path, ...],
    form: str | None,
    outputs: tuple[Path, ...],
    events: str | None,
    baseline: Path | None,
    evidence: Path | None,
    fail_on: str | None,
    selection: Selection,
    quiet: bool,
    verbose: bool,
    no_color: bool,
) -> int:
    """Judge recordings and tell what was found: .tlog, .raw, .rlog, .mavlink, .pcap, .pcapng, each also gzipped or in
    a zip; - is standard input, folders are searched.

    \b
    Exit codes: 0 good, 1 an alarm (or warning, by --fail-on), 2 usage or configuration,
    3 a source that cannot be used, 4 no attitude could be compared.
    """
    from gcs_bridge.cli.recorded_events import events_of, plan_events
    from gcs_bridge.contract import readable
    from gcs_bridge.evidence.place import Place
    from gcs_bridge.files import refuse_unwritable, write_file, write_stdout
    from gcs_bridge.report import Report, worst_exit_code
    from gcs_bridge.report.baseline import NOTHING_KNOWN, known_from, read_baseline

    if form == PAGE and not outputs:
        raise UsageError("--format html writes files: name one by --output")
    settings = selection.settings({"check": {"fail_on": fail_on}} if fail_on else None)
    verified = selection.verified()
    before = None if baseline is None else read_baseline(baseline)
    recordings, failures = find_recordings(paths)
    for output in outputs:
        refuse_unwritable(output, sources=recordings)
    place = None if evidence is None else Place(evidence, recordings)
    told = None if events is None else plan_events(events, recordings, others=outputs)

    gc.disable()  # what is imported stays: looking for garbage in it again and again takes a tenth of the start
    from gcs_bridge.recordings.check import check_file  # the heavy part, after everything that may be refused

    gc.freeze()
    gc.enable()

    pages = [output for output in outputs if (form or format_of(output)) == PAGE]
    curves: dict[str, Curves] = {}
    judged_by = selection.window() | verified

    def judge(recording: Path, progress: ProgressBar) -> File:
        with events_of(recording, told) as sinks:
            if pages:
                from gcs_bridge.pages.curves import Curves

                sinks.append(curves.setdefault(readable(str(recording)), Curves()))
            if place is None:
                return check_file(recording, settings, **judged_by, progress=progress, sinks=sinks)
            from gcs_bridge.evidence.gather import Evidence

            folder = place.folder(recording)
            with Evidence(recording, folder, selection.dialect, **verified) as gathered:
                entry = check_file(recording, settings, **judged_by, progress=progress, sinks=[gathered, *sinks])
                count = gathered.complete(entry)
            if not quiet:
                complain(_evidence(recording, folder, count, gathered.left_out), kind="note")
            return entry

    judged: list[File] = []
    sizes = [_size(recording) for recording in recordings]
    with ProgressBar(total_bytes=sum(sizes), enabled=not quiet) as progress:
        for failure in failures:
            complain(str(failure))
        for recording, size in zip(recordings, sizes, strict=True):
            try:
                judged.append(judge(recording, progress))
            except SourceError as failure:
                failures.append(failure)
                complain(str(failure))
            progress.file_done(size)

    report = Report.of(judged)
    known = NOTHING_KNOWN if before is None else known_from(report.files, before)
    if before is not None and not quiet:
        raised = sum(len(vehicle.alarms) for entry in judged for vehicle in entry.vehicles)
        complain(f"{len(known.alarms)} of {raised} alarms and warnings are as in {baseline}", kind="note")
    asked = Asked(
        detail=verbose - quiet, fail_on=settings.check.fail_on, known=known, refused=tuple(map(str, failures))
    )
    if pages and judged:
        from gcs_bridge.pages.files import write_pages

        for output in pages:
            write_pages(output, report.files, curves, asked.refused)
    for output in outputs:
        written = form or format_of(output)
        if written == PAGE:
            continue
        if judged or written in TELL_REFUSED:
            write_file(FORMATS[written](report, asked), output)
    if outputs:
        if judged and not quiet:
            click.echo(report.to_text(detail=-1), nl=False, err=True)
    elif judged or form in TELL_REFUSED:
        result = FORMATS[form or "text"](report, asked)
        if told is not None and told.takes_stdout:
            click.echo(result, nl=False, err=True)
        elif form in (None, "text") and wants_colour(no_color=no_color):
            print_coloured(result)
        else:
            write_stdout(result)
    of_recordings = report.exit_code(settings.check.fail_on, known)
    return worst_exit_code([*(failure.exit_code for failure in failures), of_recordings])


def find_recordings(paths: Iterable[Path]) -> tuple[list[Path], list[GcsBridgeError]]:
    """The files named and those found in the folders named, each once; and what is wrong with folders."""
    found: dict[Path, None] = {}
    failures: list[GcsBridgeError] = []
    for path in paths:
        if not os.path.isdir(path):
            found.update(dict.fromkeys(recordings_in(path) or [path]))
            continue
        unreadable: list[OSError] = []
        inside = sorted(
            Path(folder, name)
            for folder, _, names in os.walk(path, onerror=unreadable.append)
            for name in names
            if name.lower().endswith(_FOUND) and os.path.isfile(Path(folder, name))
        )
        recordings = [one for file in inside for one in recordings_in(file)]
        found.update(dict.fromkeys(recordings))
        failures += [SourceError(f"{error.filename}: cannot be searched: {error.strerror}") for error in unreadable]
        if not recordings and not unreadable:
            failures.append(
                SourceError(f"{path}: no recording in this folder (looked for {', '.join(READERS)}, {PACKED} of each)")
            )
    return list(found), failures


def _evidence(recording: Path, folder: Folder, count: int, left_out: int) -> str:
    """What there is evidence of, in one line."""
    if not count:
        earlier = f"; what lies in {folder.path} is of an earlier run" if folder.is_there else ""
        why = f"no room for {left_out} alarms or warnings" if left_out else "nothing was raised"
        return f"{recording}: {why}, so there is no evidence of it{earlier}"
    more = f"; {left_out} more are left out" if left_out else ""
    return f"{recording}: evidence of what was raised ({count}) is in {folder.path}{more}"


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # who reads it will tell
        return 0
