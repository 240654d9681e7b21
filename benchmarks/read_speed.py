"""`gcs-bridge check` against pymavlink merely reading the same recording: whole processes, in alternation.

The two do not do the same: one judges every attitude, the other only reads three messages. Both must count the same
messages, and the recording must be judged `agree`. Ratios are of the two runs of one pair, as a machine's speed changes
with what else it does.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Mapping
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from benchmarks import COMPARED
from benchmarks.processes import TOP, describe_machine, gcs_bridge, output_of, run, spread, this_python

# What is shown of a pair: digits, where it stands in a Run, and whether the ratio is ours over theirs.
_COLUMNS = (
    ("wall, s", 2, attrgetter("wall_s"), False),
    ("CPU, s", 2, attrgetter("cpu_s"), False),
    ("peak, MB", 0, attrgetter("peak_mb"), True),
)
PYMAVLINK_READS = Path(__file__).parent / "peers" / "drivers" / "pymavlink_reads.py"


class Judged(NamedTuple):
    """What `gcs-bridge check` finds in a recording: messages by name, and the verdict."""

    counts: dict[str, int]
    verdict: str


def pymavlink_reads(recording: Path) -> list[str]:
    return this_python(str(PYMAVLINK_READS), str(recording), *COMPARED)


def counts_in(said: str) -> dict[str, int]:
    """What a reader counted, from the last line that it printed: NAME=COUNT, and so on."""
    pairs = (pair.split("=") for pair in said.strip().rpartition("\n")[2].split())
    return {name: int(count) for name, count in pairs}


def judged(program: str, recording: Path, environment: Mapping[str, str] | None = None) -> Judged:
    """Let `program`, a gcs-bridge, judge the recording."""
    report = json.loads(run([program, "check", "--format", "json", str(recording)], environment).said)["files"][0]
    streams = [vehicle["streams"] for vehicle in report["vehicles"]]
    counts = {name: sum(of[name]["count"] for of in streams if name in of) for name in COMPARED}
    return Judged(counts, report["verdict"])


def refuse_unequal(recording: Path) -> int:
    """The number of messages compared; SystemExit unless both count the same and the recording is judged `agree`."""
    theirs = counts_in(output_of(pymavlink_reads(recording)))
    ours, verdict = judged(gcs_bridge()[0], recording)
    if ours != theirs:
        raise SystemExit(f"the readers disagree: gcs-bridge {ours}, pymavlink {theirs}")
    if verdict != "agree":
        raise SystemExit(f"{recording} is judged {verdict}, not agree")
    return sum(ours.values())


def first_run_s(recording: Path) -> float:
    """Wall time of a check that finds no compiled kernels."""
    with tempfile.TemporaryDirectory() as empty:
        return run(gcs_bridge("check", str(recording)), {**os.environ, "NUMBA_CACHE_DIR": empty}).wall_s


def side_by_side(recording: Path, pairs: int) -> None:
    """Measure both in alternation and print the table."""
    ours, theirs = gcs_bridge("check", str(recording)), pymavlink_reads(recording)
    run(ours)
    measured = [(run(ours), run(theirs)) for _ in range(pairs)]
    print("\n| median (least…most) | gcs-bridge check | pymavlink reads | ratio |\n| --- | --- | --- | --- |")
    for name, digits, column, inverse in _COLUMNS:
        of_us, of_them = ([column(both[side]) for both in measured] for side in (0, 1))
        ratios = [a / b if inverse else b / a for a, b in zip(of_us, of_them, strict=True)]
        what = "of its memory" if inverse else "times as fast"
        shown = f"**{spread(ratios).median:.2f}** ({min(ratios):.2f}…{max(ratios):.2f}) {what}"
        print(f"| {name} | {spread(of_us).show(digits)} | {spread(of_them).show(digits)} | {shown} |")


def start_times(times: int) -> None:
    """Measure the shortest commands, in alternation with a Python that does nothing."""
    commands = {
        "`gcs-bridge --help`": gcs_bridge("--help"),
        "`gcs-bridge check --help`": gcs_bridge("check", "--help"),
        "`python -c pass`": this_python("-c", "pass"),
    }
    for command in commands.values():
        run(command)
    measured = [[run(command).wall_s for command in commands.values()] for _ in range(times)]
    print("\n| median (least…most) | wall, s |\n| --- | --- |")
    for name, walls in zip(commands, zip(*measured, strict=True), strict=True):
        print(f"| {name} | {spread(walls).show(2)} |")


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Compare gcs-bridge check with pymavlink."
    )
    parser.add_argument("--recording", type=Path, help="judge this .tlog, instead of one that is made")
    parser.add_argument("--megabytes", type=float, default=20.0, help="size of the one that is made  [20]")
    parser.add_argument("--pairs", type=int, default=5, help="runs of each  [5]")
    parser.add_argument("--profile", action="store_true", help="and where the time and the memory of a check go")
    arguments = parser.parse_args(argv)
    given: Path | None = arguments.recording and arguments.recording.resolve()
    os.chdir(TOP)  # children find `benchmarks` there
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # an installation has its bytecode, and so must a checkout
    print(describe_machine(), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        recording = given or Path(folder, "long.tlog")
        if given is None:
            make = this_python("-m", "benchmarks.make_recording", str(recording))
            run([*make, "--megabytes", str(arguments.megabytes)])
        count = refuse_unequal(recording)
        size_mb = recording.stat().st_size / 1e6
        print(f"{size_mb:.1f} MB, {count:,} messages of {', '.join(COMPARED)}; both count the same", flush=True)
        side_by_side(recording, arguments.pairs)
        start_times(2 * arguments.pairs + 1)
        scan_mb_s = float(output_of(this_python("-m", "benchmarks.stages", "--scan", str(recording))))
        print(f"\nframe scan alone: {scan_mb_s:.0f} MB/s; first check on a machine: {first_run_s(recording):.1f} s\n")
        print(output_of(this_python("-m", "benchmarks.damage", str(recording))), flush=True)
        if arguments.profile:
            print(output_of(this_python("-m", "benchmarks.stages", "--functions", str(recording))))
    return 0
