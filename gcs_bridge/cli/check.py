"""`gcs-bridge check`: judges recordings and ends with what it found."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_bridge.cli.selection import Selection, selection_options
from gcs_bridge.cli.terminal import ProgressBar, complain, show
from gcs_bridge.errors import GcsBridgeError, SourceError, UsageError
from gcs_bridge.recordings.open import READERS
from gcs_bridge.recordings.packed import LOOKED_FOR, PACKED, recordings_in
from gcs_bridge.report.formats import FORMATS, PAGE, TELL_REFUSED, Asked, Refused, format_of

if TYPE_CHECKING:  # loaded when there is something to judge
    from gcs_bridge.cli.check_run import Judged
    from gcs_bridge.pages.curves import Curves
    from gcs_bridge.report.schema import File

__all__ = ["check", "find_recordings"]


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
@click.option(
    "--jobs", type=click.IntRange(min=1), metavar="N", help="Judge so many recordings at a time.  [by their sizes]"
)
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
    jobs: int | None,
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
    from gcs_bridge.cli.check_run import CheckTask, jobs_for, judged, judged_by_several, size_of
    from gcs_bridge.cli.recorded_events import plan_events
    from gcs_bridge.evidence.place import Place
    from gcs_bridge.files import refuse_unwritable, write_file, write_stdout
    from gcs_bridge.report import Report, worst_exit_code
    from gcs_bridge.report.baseline import NOTHING_KNOWN, known_from, read_baseline

    if form == PAGE and not outputs:
        raise UsageError("--format html writes files: name one by --output")
    settings = selection.settings({"check": {"fail_on": fail_on}} if fail_on else None)
    verified = selection.verified()
    before = None if baseline is None else read_baseline(baseline)
    recordings, unusable = find_recordings(paths)
    for output in outputs:
        refuse_unwritable(output, sources=recordings)
    place = None if evidence is None else Place(evidence, recordings)
    told = None if events is None else plan_events(events, recordings, others=outputs)

    pages = [output for output in outputs if (form or format_of(output)) == PAGE]
    kept_curves: dict[str, Curves] = {}
    judged_by = selection.window() | verified

    def task_of(index: int, others: int = 0) -> CheckTask | None:
        recording = recordings[index]
        folder = None if place is None else place.folder(recording, others)
        if place is not None and folder is None:
            return None
        kept: dict[str, Any] = {"events": events, "has_curves": bool(pages), "evidence": folder}
        return CheckTask(recording=recording, settings=settings, judged_by=judged_by, **kept)

    def one_after_the_other(progress: ProgressBar) -> Iterator[Judged]:
        gc.disable()  # what is imported stays: looking for garbage in it again and again takes a tenth of the start
        import_module("gcs_bridge.recordings.check")  # the heavy part, after everything that may be refused
        gc.freeze()
        gc.enable()
        for index in range(len(recordings)):
            task = task_of(index)
            assert task is not None
            yield judged(task, progress)

    entries: list[File] = []
    sizes = [size_of(recording) for recording in recordings]
    processes = 1 if verified["signing_key"] is not None else jobs_for(recordings, jobs)
    with ProgressBar(total_bytes=sum(sizes), enabled=not quiet) as progress:
        for _, failure in unusable:
            complain(str(failure))
        if processes == 1:
            results = one_after_the_other(progress)
        else:
            results = judged_by_several(len(recordings), task_of, processes, told)
        for recording, one, size in zip(recordings, results, sizes, strict=True):
            if one.failure is not None:
                unusable.append((recording, one.failure))
                complain(str(one.failure))
            if one.entry is not None:
                entries.append(one.entry)
            if one.entry is not None and one.curves is not None:
                kept_curves[one.entry.path] = one.curves
            if one.note is not None and not quiet:
                complain(one.note, kind="note")
            if place is not None:
                place.taken(one.alarms)
            progress.file_done(size)

    report = Report.of(entries)
    known = NOTHING_KNOWN if before is None else known_from(report.files, before)
    if before is not None and not quiet:
        raised = sum(len(vehicle.alarms) for entry in entries for vehicle in entry.vehicles)
        complain(f"{len(known.alarms)} of {raised} alarms and warnings are as in {baseline}", kind="note")
    refused = tuple(Refused(str(path), str(failure)) for path, failure in unusable)
    asked = Asked(detail=verbose - quiet, fail_on=settings.check.fail_on, known=known, refused=refused)
    if pages and entries:
        from gcs_bridge.pages.files import write_pages

        for output in pages:
            write_pages(output, report.files, kept_curves, [one.line for one in refused])
    for output in outputs:
        written = form or format_of(output)
        if written == PAGE:
            continue
        if entries or written in TELL_REFUSED:
            write_file(FORMATS[written](report, asked), output)
    if outputs:
        if entries and not quiet:
            click.echo(report.to_text(detail=-1), nl=False, err=True)
    elif entries or form in TELL_REFUSED:
        result = FORMATS[form or "text"](report, asked)
        if told is not None and told.takes_stdout:
            click.echo(result, nl=False, err=True)
        elif form in (None, "text"):
            show(result, no_color=no_color)
        else:
            write_stdout(result)
    of_recordings = report.exit_code(settings.check.fail_on, known)
    return worst_exit_code([*(failure.exit_code for _, failure in unusable), of_recordings])


def find_recordings(paths: Iterable[Path]) -> tuple[list[Path], list[tuple[Path, GcsBridgeError]]]:
    """The files named and those found in the folders named, each once; and folders, with what is wrong with them."""
    found: dict[Path, None] = {}
    failures: list[tuple[Path, GcsBridgeError]] = []
    for path in paths:
        if not os.path.isdir(path):
            found.update(dict.fromkeys(recordings_in(path) or [path]))
            continue
        unreadable: list[OSError] = []
        inside = sorted(
            Path(folder, name)
            for folder, _, names in os.walk(path, onerror=unreadable.append)
            for name in names
            if name.lower().endswith(LOOKED_FOR) and os.path.isfile(Path(folder, name))
        )
        recordings = [one for file in inside for one in recordings_in(file)]
        found.update(dict.fromkeys(recordings))
        for error in unreadable:
            folder, why = Path(error.filename), error.strerror
            failures.append((folder, SourceError(f"{folder}: cannot be searched: {why}")))
        if not recordings and not unreadable:
            looked_for = f"looked for {', '.join(READERS)}, {PACKED} of each"
            failures.append((path, SourceError(f"{path}: no recording in this folder ({looked_for})")))
    return list(found), failures
