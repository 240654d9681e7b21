"""`--events` of the commands that read recordings: a file that is written anew, or standard output."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from gcs_bridge.cli.terminal import complain
from gcs_bridge.errors import UsageError
from gcs_bridge.files import refuse_unwritable, write_file, write_stdout, writing
from gcs_bridge.sinks.base import Plan, Sink, SinkContext
from gcs_bridge.sinks.event_lines import EventLines

__all__ = ["append_events", "events_of", "plan_events"]


def plan_events(asked: str, recordings: Sequence[Path], *, others: Sequence[Path] = ()) -> Plan:
    """The sink that `--events` asks for, of each recording; its file is there, and empty.

    Raises UsageError where it cannot be written, and where it is a recording or one of the `others` that are written.
    """
    plan = EventLines.plan(asked)
    if plan.writes is not None:
        if any(plan.writes.resolve() == other.resolve() for other in others):
            raise UsageError(f"{asked} cannot take the events and another output too: give two names")
        refuse_unwritable(plan.writes, sources=list(recordings))
        write_file(b"", plan.writes)
    return plan


@contextmanager
def events_of(recording: Path, plan: Plan | None) -> Iterator[list[Sink]]:
    """The sink of one recording's events, none where none is asked for; UsageError where it could not take them all."""
    if plan is None:
        yield []
        return
    with ExitStack() as stack:
        name = str(recording)
        sink = plan.open(SinkContext(name, [name], note=complain, complain=complain, stack=stack))
        try:
            yield [sink]
        finally:
            sink.close()
        if sink.failed:
            raise UsageError(f"{plan.writes}: not all events could be written")


def append_events(plan: Plan, kept: Path) -> None:
    """Give a recording's events, which were written to a file of their own, to where all go; UsageError: it cannot be.

    A recording that could not even be opened has no such file.
    """
    if not kept.exists():
        return
    if plan.writes is None:
        write_stdout(kept.read_text(encoding="utf-8"))
        return
    with writing(plan.writes), kept.open("rb") as source, plan.writes.open("ab") as target:
        shutil.copyfileobj(source, target)
