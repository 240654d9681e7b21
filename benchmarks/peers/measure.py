"""What is measured: readers in alternation, memory, damaged recordings. Numbers only; results.py shows them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from benchmarks.peers.environments import DRIVERS
from benchmarks.processes import Run, run, this_python
from benchmarks.read_speed import counts_in, judged

CHECK, READ = "`gcs-bridge check`", "`gcs_bridge.read`"
Counts = dict[str, int]


class Reader(NamedTuple):
    """A program that takes a recording, as a process of its own."""

    name: str
    before: tuple[str, ...]  # of its command, before the recording
    behind: tuple[str, ...]
    environment: Mapping[str, str]

    def read(self, recording: Path) -> Run:
        """Let it read; ReadingError where it cannot."""
        try:
            return run([*self.before, str(recording), *self.behind], self.environment)
        except subprocess.CalledProcessError as error:
            last = (error.stderr.strip() or f"exit code {error.returncode}").rpartition("\n")[2]
            raise ReadingError(last.replace(str(recording), recording.name)) from None


class ReadingError(Exception):
    """A reader did not come to its end; its last words."""


class Installed(NamedTuple):
    """The gcs-bridge that is measured."""

    python: Path
    environment: Mapping[str, str]

    @property
    def program(self) -> str:
        return str(self.python.with_name("gcs-bridge"))

    def readers(self, names: Sequence[str]) -> list[Reader]:
        """Its check, and its reading of the messages `names`."""
        reads = (str(self.python), str(DRIVERS / "gcs_bridge_reads.py"))
        return [
            Reader(CHECK, (self.program, "check"), (), self.environment),
            Reader(READ, reads, tuple(names), self.environment),
        ]


class Memory(NamedTuple):
    """What `gcs_bridge.read` takes: bytes of the arrays that it returns, and by how many the process grew."""

    arrays: int
    grown: int


@dataclass
class Measured:
    """One recording, read by all."""

    megabytes: float
    messages: int
    written: Counts  # of the messages compared, as the recording was made
    counted: dict[str, Counts] = field(default_factory=dict)  # by reader
    rounds: list[dict[str, Run]] = field(default_factory=list)  # by reader
    failed: dict[str, str] = field(default_factory=dict)  # reader → its last words
    memory: Memory | None = None

    def walls(self, reader: str) -> list[float]:
        return [runs[reader].wall_s for runs in self.rounds if reader in runs]

    def ratios(self, reader: str, other: str) -> list[float]:
        """Wall time of one over the other's, round by round."""
        both = (runs for runs in self.rounds if reader in runs and other in runs)
        return [runs[reader].wall_s / runs[other].wall_s for runs in both]


class Recovery(NamedTuple):
    """Of one damaged recording: messages that were left whole, and what each reader counted."""

    damage: str
    whole: Counts
    counted: dict[str, Counts | None]  # None: it failed


def make(recording: Path, megabytes: float) -> Measured:
    """A recording of that size, and what is in it; nobody has read it yet."""
    said = run(this_python("-m", "benchmarks.make_recording", str(recording), "--megabytes", f"{megabytes:g}")).said
    total = int(said.split(": ")[1].split()[0])
    return Measured(megabytes, total, counts_in(said))


def warm_up(readers: Iterable[Reader], recording: Path) -> dict[str, str]:
    """Let every reader read once, unmeasured: kernels are compiled, libraries are in memory. Who fails, and why."""
    failed = {}
    for reader in readers:
        say(f"warming up: {reader.name}")
        try:
            reader.read(recording)
        except ReadingError as error:
            failed[reader.name] = str(error)
    return failed


def refuse_wrong(ours: Installed, recording: Path, written: Counts) -> None:
    """SystemExit unless the recording is judged `agree` and all that is compared in it was counted."""
    counts, verdict = judged(ours.program, recording, ours.environment)
    if counts != written or verdict != "agree":
        raise SystemExit(f"gcs-bridge check says {verdict} and counts {counts}; written were {written}")


def in_alternation(readers: Sequence[Reader], recording: Path, rounds: int, into: Measured) -> None:
    """Let all read, one after the other, again and again. Who fails once is not asked again."""
    for number in range(1, rounds + 1):
        runs: dict[str, Run] = {}
        for reader in readers:
            if reader.name in into.failed:
                continue
            try:
                runs[reader.name] = done = reader.read(recording)
            except ReadingError as error:
                into.failed[reader.name] = str(error)
                continue
            say(f"{into.megabytes:g} MB, round {number} of {rounds}: {reader.name} {done.wall_s:.2f} s")
            if reader.name != CHECK:
                into.counted[reader.name] = counts_in(done.said)
        into.rounds.append(runs)


def memory_of_read(ours: Installed, short: Path, recording: Path) -> Memory:
    """What `gcs_bridge.read` takes for a recording, after it has read a short one."""
    driver = str(DRIVERS / "gcs_bridge_memory.py")
    told = counts_in(run([str(ours.python), driver, str(short), str(recording)], ours.environment).said)
    return Memory(told["ARRAYS"], told["GROWN"])


def recoveries(readers: Sequence[Reader], recording: Path, folder: Path) -> list[Recovery]:
    """What each reader counts in damaged copies of the first frames of a recording."""
    damaged = json.loads(run(this_python("-m", "benchmarks.damage", str(recording), "--write", str(folder))).said)
    found = []
    for one in damaged:
        say(f"damaged by {one['damage']}")
        counted: dict[str, Counts | None] = {}
        for reader in readers:
            try:
                counted[reader.name] = counts_in(reader.read(folder / one["file"]).said)
            except ReadingError:
                counted[reader.name] = None
        found.append(Recovery(one["damage"], one["whole"], counted))
    return found


def say(what: str) -> None:
    """Progress, for whoever waits."""
    print(what, file=sys.stderr, flush=True)
