"""`gcs-bridge check` and `gcs_bridge.read` beside other readers of recordings, in alternation.

    python -m benchmarks.peers                        # 1, 20 and 200 MB, five rounds each; half an hour or more
    python -m benchmarks.peers --sizes 1 --rounds 3   # a first try; the peers are installed by it
    python -m benchmarks.peers --huge --wheel         # and 2 GB once; gcs-bridge as its users have it

Writes benchmarks/RESULTS.md. The peers are installed by pip in environments of their own, which are kept.
"""

from __future__ import annotations

import argparse
import os
import platform
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from benchmarks import COMPARED
from benchmarks.peers import environments, measure
from benchmarks.peers.measure import CHECK, Installed, Measured, Reader
from benchmarks.peers.results import HUGE_MB, Results
from benchmarks.processes import TOP, describe_system, gcs_bridge, output_of, run

RESULTS = TOP / "benchmarks" / "RESULTS.md"
WALKER = "C record walker"
SHORT_MB = 1  # for warming up, and to be damaged


def cache_folder() -> Path:
    """Where environments are kept, unless another folder is given."""
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "gcs-bridge-benchmarks"


def peers(folder: Path, wanted: Collection[str], left_out: dict[str, str]) -> tuple[list[Reader], list[str]]:
    """The other readers, the fastest first, and their versions; who cannot be had is put down in `left_out`."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    readers, versions = [], []
    if WALKER in wanted:
        with _named(WALKER, left_out):
            program = str(environments.walker(folder))
            readers.append(Reader(WALKER, (program,), (), clean))
            versions.append(f"{WALKER}: {environments.describe_compiler()}")
    for peer in environments.PEERS:
        if peer.name not in wanted:
            continue
        with _named(peer.name, left_out):
            measure.say(f"environment of {peer.name}")
            command = (str(environments.python_of(peer, folder)), str(environments.DRIVERS / peer.driver))
            readers.append(Reader(peer.name, command, COMPARED, clean))
            versions.append(peer.versions)
    return readers, versions


@contextmanager
def _named(peer: str, left_out: dict[str, str]) -> Iterator[None]:
    """Put down why a peer is left out, and go on."""
    try:
        yield
    except environments.NotInstalledError as reason:
        left_out[peer] = str(reason)


def ours(folder: Path, *, wheel: bool) -> Installed:
    """The gcs-bridge of this Python, or one that is built and installed from this checkout."""
    if not wheel:
        return Installed(Path(gcs_bridge()[0]).with_name(Path(sys.executable).name), os.environ)
    try:
        python = environments.python_of_wheel(folder)
    except environments.NotInstalledError as reason:
        raise SystemExit(str(reason)) from None
    return Installed(python, {name: value for name, value in os.environ.items() if name != "PYTHONPATH"})


def begun(installed: Installed, versions: list[str]) -> tuple[str, ...]:
    """When, on what machine, of which versions."""
    about = run([str(installed.python), str(environments.DRIVERS / "gcs_bridge_about.py")], installed.environment).said
    written = f"Written by `python -m benchmarks.peers` on {datetime.now(UTC):%Y-%m-%d}"
    return (
        f"{written}; [what it means](README.md#beside-other-readers).\n",
        f"{describe_system()}; {_processor()}, {_memory_gb():.0f} GB.\n",
        f"- {about.strip()}{_commit()}",
        *(f"- {line}" for line in versions),
    )


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or "processor unknown")


def _memory_gb() -> float:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9


def _commit() -> str:
    try:
        return f"; commit {output_of(['git', 'describe', '--always', '--dirty', '--exclude', '*']).strip()}"
    except (OSError, subprocess.CalledProcessError):  # an export without its history
        return ""


def measure_all(results: Results, installed: Installed, others: list[Reader], arguments: argparse.Namespace) -> None:
    """All measurements, into `results`."""
    check, read = installed.readers(COMPARED)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        short, recording = folder / "short.tlog", folder / "long.tlog"
        measure.make(short, SHORT_MB)
        failed = measure.warm_up([check, read, *others], short)
        if failed.keys() & {check.name, read.name}:
            raise SystemExit(f"gcs-bridge fails: {failed}")
        results.left_out |= {peer: f"it fails: {why}" for peer, why in failed.items()}
        others = [reader for reader in others if reader.name not in failed]
        results.help_s = [
            run([installed.program, "--help"], installed.environment).wall_s for _ in range(2 * arguments.rounds + 1)
        ]
        results.recoveries = measure.recoveries([read, *others], short, folder)
        for megabytes in arguments.sizes:
            of = _measured(installed, recording, megabytes)
            measure.in_alternation([check, read, *others], recording, arguments.rounds, of)
            if of.counted.get(read.name) != of.written:
                raise SystemExit(f"gcs_bridge.read counts {of.counted.get(read.name)}; written were {of.written}")
            of.memory = measure.memory_of_read(installed, short, recording)
            results.recordings.append(of)
        if arguments.huge:
            results.huge = _measured(installed, recording, HUGE_MB)
            walker = [reader for reader in others if reader.name == WALKER]
            measure.in_alternation([check, *walker], recording, 1, results.huge)


def _measured(installed: Installed, recording: Path, megabytes: float) -> Measured:
    measure.say(f"a recording of {megabytes:g} MB")
    of = measure.make(recording, megabytes)
    measure.refuse_wrong(installed, recording, of.written)
    return of


def main(argv: list[str]) -> int:
    known = [WALKER, *(peer.name for peer in environments.PEERS)]
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.peers", description=f"Compare {CHECK} with other readers of recordings."
    )
    parser.add_argument("--sizes", type=float, nargs="+", default=[1, 20, 200], metavar="MB", help="[1 20 200]")
    parser.add_argument("--rounds", type=int, default=5, help="in each of which every reader reads once  [5]")
    parser.add_argument("--peers", nargs="+", default=known, choices=known, metavar="NAME", help=f"{known}")
    parser.add_argument("--huge", action="store_true", help=f"and check {HUGE_MB} MB once, for the memory")
    parser.add_argument("--wheel", action="store_true", help="measure a wheel of this checkout, not what is installed")
    parser.add_argument("--environments", type=Path, metavar="DIR", help="where they are kept  [the user's cache]")
    parser.add_argument("--out", type=Path, default=RESULTS, help="where the results go  [benchmarks/RESULTS.md]")
    arguments = parser.parse_args(argv)
    folder = (arguments.environments or cache_folder()).resolve()
    out = arguments.out.resolve()
    os.chdir(TOP)  # children find `benchmarks` there
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # an installation has its bytecode, and so must a checkout
    left_out: dict[str, str] = {}
    others, versions = peers(folder, arguments.peers, left_out)
    installed = ours(folder, wheel=arguments.wheel)
    results = Results(begun(installed, versions), left_out=left_out)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("terminated"))
    try:
        measure_all(results, installed, others, arguments)
    except BaseException:
        print(results.show(), flush=True)  # much time may stand behind it
        raise
    out.write_text(results.show(), "utf-8")
    print(results.show())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
