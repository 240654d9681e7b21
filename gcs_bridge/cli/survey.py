"""`gcs-bridge survey`: thousands of recordings, judged on this machine or a cluster, as a dataset and a summary."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gcs_bridge.cli.selection import Selection, selection_options
from gcs_bridge.cli.terminal import ProgressBar, complain, show
from gcs_bridge.errors import UsageError

if TYPE_CHECKING:  # loaded when there is something to judge
    from gcs_bridge.executors.base import Executor
    from gcs_bridge.survey.run import Ran
    from gcs_bridge.survey.summary import Summary

__all__ = ["survey"]

_MOST_FAILURES = 20  # that are printed; the summary has all
_FILE_BYTES = 200_000  # of time left: to begin with a file takes as long as judging so many bytes of it


@click.command()
@click.argument("paths", nargs=-1, required=True, metavar="PATH|URL...")
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    default=Path("survey"),
    metavar="DIR",
    help="The dataset; one that is there already is gone on with.  [survey]",
)
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Processes on this machine.  [one a core]")
@click.option("--scheduler", metavar="URL", help="Judge on a Dask cluster instead: its scheduler, as tcp://host:8786.")
@click.option(
    "--pages/--no-pages",
    default=None,
    help="A page of every flight, or of none.  [of those with alarms or warnings]",
)
@click.option(
    "--vehicle",
    metavar="REGEX",
    help="What of a path names the vehicle whose drift is followed.  [the folder]",
)
@click.option("--fail-on", type=click.Choice(["warning", "alarm", "never"]), help="What ends with 1.  [alarm]")
@selection_options("Judge")
@click.option("-q", "--quiet", is_flag=True, help="Only the last line.")
@click.option("--no-color", is_flag=True, help="Plain text; so does the variable NO_COLOR.")
def survey(
    paths: tuple[str, ...],
    output: Path,
    workers: int | None,
    scheduler: str | None,
    pages: bool | None,
    vehicle: str | None,
    fail_on: str | None,
    selection: Selection,
    quiet: bool,
    no_color: bool,
) -> int:
    """Judge any number of recordings, as `check` does, from folders and from URLs that fsspec knows (s3://, http://).

    Into DIR go Parquet tables (recordings/, checks/, alarms/), pages, summary.json and index.html. What is in DIR
    already is not judged again: ended half-way, it goes on where it was.

    \b
    Exit codes, of all recordings that were named: 0 good, 1 an alarm (or warning, by --fail-on),
    2 usage or configuration, or DIR cannot be written, 3 some recording could not be used (all others were judged),
    4 some attitude could be compared with nothing.
    """
    from gcs_bridge._version import __version__
    from gcs_bridge.files import write_file
    from gcs_bridge.report import worst_exit_code
    from gcs_bridge.survey.dataset import Dataset, exit_code_of
    from gcs_bridge.survey.found import find
    from gcs_bridge.survey.page import overview
    from gcs_bridge.survey.run import survey as run_survey
    from gcs_bridge.survey.summary import Run, summarised
    from gcs_bridge.survey.task import Asked, Pages

    settings = selection.settings({"check": {"fail_on": fail_on}} if fail_on else None)
    judged_by = selection.window() | selection.verified()
    of_vehicle = None if vehicle is None else _pattern(vehicle)
    digest = selection.digest()
    started_s = time.monotonic()
    with (
        Dataset(output, __version__, digest) as dataset,
        _executor(scheduler, workers, selection) as executor,
        ProgressBar(enabled=not quiet) as bar,
    ):
        asked = Asked(
            settings=settings,
            judged_by=judged_by,
            settings_digest=digest,
            pages=None
            if pages is False
            else Pages(folder=str(output.absolute()), token=dataset.token, every=bool(pages)),
        )
        ran = run_survey(find(paths), dataset, asked, executor, _Watch(bar))
        count = executor.workers
    run = Run(
        judged=ran.judged,
        known=ran.known,
        copies=ran.copies,
        retried=ran.retried,
        bytes=ran.bytes,
        wall_s=round(time.monotonic() - started_s, 3),
        workers=count,
    )
    summary = summarised(output, run, ran.failures, of_vehicle)
    write_file(_json(summary), output / "summary.json")
    write_file(overview(summary), output / "index.html")
    _tell(summary, ran, output, quiet=quiet, no_color=no_color)
    codes = [exit_code_of(frozenset(ran.codes), settings.check.fail_on)]
    return worst_exit_code([3, *codes] if ran.failures else codes)


def _pattern(vehicle: str) -> re.Pattern[str]:
    try:
        return re.compile(vehicle)
    except re.error as error:
        raise UsageError(f"--vehicle {vehicle}: no regular expression: {error}") from None


def _executor(scheduler: str | None, workers: int | None, selection: Selection) -> Executor:
    """What judges. UsageError where it cannot."""
    if workers is not None and scheduler is not None:
        raise UsageError("--workers is of this machine, and --scheduler has workers of its own: give one of them")
    if selection.signing_key_file is not None:
        if workers is not None or scheduler is not None:
            raise UsageError("--signing-key-file: a key is given to no other process: leave out --workers, --scheduler")
        from gcs_bridge.executors.here import Here

        return Here()
    if scheduler is not None:
        from gcs_bridge.executors.cluster import Cluster

        return Cluster(scheduler)
    from gcs_bridge.executors.base import cores
    from gcs_bridge.executors.processes import Processes

    return Processes(workers or cores())


def _json(summary: Summary) -> bytes:
    import msgspec

    return msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n"


def _tell(summary: Summary, ran: Ran, output: Path, *, quiet: bool, no_color: bool) -> None:
    from gcs_bridge.report.rows import counted
    from gcs_bridge.survey.text import lines

    for failure in ran.failures[:_MOST_FAILURES]:
        complain(failure)
    if len(ran.failures) > _MOST_FAILURES:
        complain(f"and {len(ran.failures) - _MOST_FAILURES} more, all of them in {output / 'summary.json'}")
    if not quiet:
        run = summary.run
        said = [
            f"{counted(run.judged, 'recording')} judged",
            f"{run.bytes / 1e6:.1f} MB in {run.wall_s:.1f} s ({run.bytes / 1e6 / max(run.wall_s, 1e-3):.1f} MB/s)",
        ]
        others = ((run.known, "known already"), (run.copies, "copies of known ones"), (run.retried, "tried again"))
        said += [f"{number} {what}" for number, what in others if number]
        complain(", ".join(said), kind="note")
    told = lines(summary, str(output))
    text = "\n".join(told[-1:] if quiet else told) + "\n"
    show(text, no_color=no_color)


class _Watch:
    """Shows on a bar how far a survey is."""

    def __init__(self, bar: ProgressBar) -> None:
        self._bar = bar

    def planned(self, files: int, size: int) -> None:
        """More is to be done."""
        self._bar.more(files * _FILE_BYTES + size)

    def done(self, ran: Ran, size: int) -> None:
        """A file is done."""
        failed = f", {len(ran.failures)} failed" if ran.failures else ""
        self._bar.file_done(_FILE_BYTES + size, said=f"{ran.judged} judged{failed}")
