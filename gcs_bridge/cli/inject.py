"""`gcs-bridge inject`: writes a copy of a recording with chosen faults."""

from __future__ import annotations

import re
import shlex
import textwrap
from collections.abc import Iterator
from pathlib import Path

import click

from gcs_bridge.errors import SourceError

__all__ = ["inject"]


def _list(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    """Print the table of faults and end."""
    if wanted:
        from gcs_bridge.files import write_stdout

        write_stdout("".join(f"{line}\n" for line in _table()))
        context.exit()


@click.command()
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option("--list", is_flag=True, is_eager=True, expose_value=False, callback=_list, help="All faults, and end.")
@click.option(
    "--fault",
    "faults",
    multiple=True,
    required=True,
    metavar="NAME[:VALUE]",
    help="A fault of --list, as yaw_offset:25; several are made in the order given.",
)
@click.option("--from", "from_s", type=float, metavar="S", help="Begin S seconds after the recording's start.")
@click.option("--to", "to_s", type=float, metavar="S", help="End S seconds after the recording's start.")
@click.option("--sysid", type=click.IntRange(1, 255), metavar="N", help="Falsify this system alone.")
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write to this file.  [FILE.FAULT.tlog in the current folder]",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, metavar="N", help="Of what is left to chance.  [0]")
@click.option("--dialect", default="all", metavar="NAME", help="MAVLink dialect to read with.  [all]")
def inject(
    path: Path,
    faults: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    sysid: int | None,
    output: Path | None,
    seed: int,
    dialect: str,
) -> int:
    """Write a copy of the recording FILE (.tlog) with chosen faults: to see what a mistake looks like, and for tests.

    \b
    Exit codes: 0 good, 2 usage: an unknown fault, a value out of range, an output that cannot be written,
    3 a source that cannot be used, 4 the stream to falsify is not in it. Unless 0, nothing is written.
    """
    from gcs_bridge.files import write_stdout
    from gcs_bridge.recordings.edits import scope_text
    from gcs_bridge.recordings.faults import parse_fault
    from gcs_bridge.recordings.inject import inject_file
    from gcs_bridge.recordings.open import open_recording
    from gcs_bridge.recordings.packed import name_of

    wanted = [parse_fault(fault) for fault in faults]
    target = output or Path(f"{name_of(path)}.{'+'.join(re.sub(r'[:=,]', '_', fault) for fault in faults)}.tlog")
    with open_recording(path, dialect, judged=False) as source:
        if not source.timed:
            raise SourceError(f"{path}: a stream without record times: faults can be put into a .tlog alone")
    made = inject_file(path, target, wanted, dialect=dialect, sysid=sysid, from_s=from_s, to_s=to_s, seed=seed)
    told = ", ".join(f"{one.fault} ({one.became}: {one.number})" for one in made)
    where = scope_text(sysid=sysid, from_s=from_s, to_s=to_s)
    write_stdout(f"wrote {target}: {told}{where}; next: gcs-bridge check {shlex.quote(str(target))}\n")
    return 0


def _table() -> Iterator[str]:
    """Every fault with what its value may be and where it comes from."""
    from gcs_bridge.diagnosis.causes import CAUSES
    from gcs_bridge.recordings.link_faults import LINK_FAULTS

    messages = {(30,): "ATTITUDE", (31,): "ATTITUDE_QUATERNION", (30, 31): "both messages"}
    rows = [
        (cause.name, messages[cause.messages], cause.parameter, cause.origin)
        for cause in CAUSES.values()
        if cause.messages  # none: an event, that is not made
    ]
    rows += [(name, "any message", fault.parameter, fault.origin) for name, fault in LINK_FAULTS.items()]
    yield f"{'fault':<24}{'falsifies':<21}{'default':<9}value"
    for name, falsifies, parameter, origin in rows:
        default = ",".join(f"{number:g}" for number in parameter.default or ()) or "-"
        yield f"{name:<24}{falsifies:<21}{default:<9}{parameter.allowed(name)}"
        yield from textwrap.wrap(origin, 96, initial_indent="    ", subsequent_indent="    ")
