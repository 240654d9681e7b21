"""`gcs-bridge check` against pymavlink merely reading the same recording: whole processes, in alternation.

The two do not do the same: one judges every attitude, the other only reads three messages. Both must count the same
messages, and the recording must be judged `agree`. Ratios are of the two runs of one pair, as a machine's speed changes
with what else it does. This process stays small and imports none of the libraries: a child's peak memory, as the kernel
tells it, is never below its parent's at the start.

Needs POSIX (`os.wait4`).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
COMPARED = ("ATTITUDE", "ATTITUDE_QUATERNION", "RAW_IMU")


class Run(NamedTuple):
    """One finished process."""

    wall_s: float
    cpu_s: float
    peak_mb: float


class Spread(NamedTuple):
    """Of some repeated measurement."""

    median: float
    least: float
    most: float

    def show(self, digits: int) -> str:
        median, least, most = (f"{value:.{digits}f}" for value in self)
        return f"{median} ({least}…{most})"


def spread(values: Sequence[float]) -> Spread:
    return Spread(statistics.median(values), min(values), max(values))


def run(command: Sequence[str], environment: dict[str, str] | None = None) -> Run:
    """Run a command to its end, its output thrown away; CalledProcessError where it fails."""
    begun_s = time.perf_counter()
    # No `with`: wait4 is what waits, and tells what was used.
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    _, status, used = os.wait4(child.pid, 0)
    wall_s = time.perf_counter() - begun_s
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, command)
    peak_bytes = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return Run(wall_s, used.ru_utime + used.ru_stime, peak_bytes / 1e6)


def output_of(command: Sequence[str]) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def gcs_bridge(*arguments: str) -> list[str]:
    """The command of this Python's own installation."""
    found = shutil.which("gcs-bridge", path=str(Path(sys.executable).parent))
    if found is None:
        raise SystemExit("gcs-bridge is not installed beside this Python: pip install -e .")
    return [found, *arguments]


def this_python(*arguments: str) -> list[str]:
    return [sys.executable, *arguments]


def pymavlink_reads(recording: Path) -> list[str]:
    return this_python(str(HERE / "pymavlink_reads.py"), str(recording))


def refuse_unequal(recording: Path) -> int:
    """The number of messages compared; SystemExit unless both count the same and the recording is judged `agree`."""
    theirs = dict(pair.split("=") for pair in output_of(pymavlink_reads(recording)).split())
    judged = json.loads(output_of(gcs_bridge("check", "--format", "json", str(recording))))["files"][0]
    streams = [vehicle["streams"] for vehicle in judged["vehicles"]]
    ours = {name: str(sum(of[name]["count"] for of in streams if name in of)) for name in COMPARED}
    if ours != theirs:
        raise SystemExit(f"the readers disagree: gcs-bridge {ours}, pymavlink {theirs}")
    if judged["verdict"] != "agree":
        raise SystemExit(f"{recording} is judged {judged['verdict']}, not agree")
    return sum(map(int, ours.values()))


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
    for name, digits, column, inverse in (("wall, s", 2, 0, False), ("CPU, s", 2, 1, False), ("peak, MB", 0, 2, True)):
        of_us, of_them = ([both[side][column] for both in measured] for side in (0, 1))
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


def describe_machine() -> str:
    packages = ", ".join(f"{name} {version(name)}" for name in ("gcs-bridge", "numpy", "numba", "pymavlink"))
    system = f"{platform.system()} {platform.machine()}"
    return (
        f"{system}, {os.cpu_count()} CPUs, {platform.python_implementation()} {platform.python_version()}; {packages}"
    )


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
    os.chdir(HERE.parent)  # children find `benchmarks` there
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
