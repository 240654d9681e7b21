"""What was measured, as Markdown: what it must show, and the tables behind that."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from benchmarks import COMPARED
from benchmarks.peers.measure import CHECK, READ, Counts, Measured, Recovery
from benchmarks.processes import Run, spread

HUGE_MB = 2000


@dataclass
class Results:
    """All of one run of the command."""

    begun: tuple[str, ...]  # lines that tell when, on what and of which versions
    recordings: list[Measured] = field(default_factory=list)
    huge: Measured | None = None  # each read once, for the memory
    help_s: list[float] = field(default_factory=list)
    recoveries: list[Recovery] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)  # peer → reason

    def of_size(self, megabytes: float) -> Measured:
        """The recording of that size; an empty one where it was not measured."""
        return next((one for one in self.recordings if one.megabytes == megabytes), Measured(megabytes, 0, {}))

    def show(self) -> str:
        parts = [
            "# gcs-bridge beside other readers\n",
            "\n".join(self.begun),
            "\n## What it must show\n",
            "\n".join(_target_table(targets(self))),
            *("\n".join(_recording_table(one)) for one in self.recordings),
        ]
        if any(one.memory for one in self.recordings):
            parts.append("\n".join(_memory_table(self.recordings)))
        if self.huge:
            parts.append("\n".join(_huge_table(self.huge)))
        if self.recoveries:
            parts.append("\n".join(_recovery_table(self.recoveries)))
        if self.left_out:
            parts.append("\n## Left out\n\n" + "\n".join(f"- {name}: {why}" for name, why in self.left_out.items()))
        return "\n".join(parts) + "\n"


class Target(NamedTuple):
    """What the median of `values` must not exceed, or must reach; without values it was not measured."""

    what: str
    limit: float
    values: Sequence[float]
    digits: int = 2
    at_least: bool = False

    @property
    def met(self) -> bool | None:
        if not self.values:
            return None
        median = spread(self.values).median
        return median >= self.limit if self.at_least else median <= self.limit


def targets(results: Results) -> list[Target]:
    """All that the run must show."""
    small, middle, large = (results.of_size(megabytes) for megabytes in (1, 20, 200))
    peaks = _peaks(large, CHECK)
    huge = _peaks(results.huge, CHECK) if results.huge else []
    grown = [large.memory.grown / large.memory.arrays] if large.memory else []
    return [
        Target("`check` of 200 MB, of fasttlogparser's time", 0.5, large.ratios(CHECK, "fasttlogparser")),
        Target("`check` of 200 MB, times as fast as pymavlink", 30, large.ratios("pymavlink", CHECK), 0, at_least=True),
        Target("`check` of 200 MB, peak, MB", 300, peaks, 0),
        Target("`check` of 2 GB, of that peak", 1.1, [peak / spread(peaks).median for peak in huge if peaks]),
        Target("`read` of 200 MB, of fasttlogparser's time", 0.35, large.ratios(READ, "fasttlogparser")),
        Target("`read` of 200 MB, memory over its arrays", 1.3, grown),
        Target("`check` of 20 MB, s", 0.5, middle.walls(CHECK)),
        Target("`check` of 1 MB, s", 0.35, small.walls(CHECK)),
        Target("`gcs-bridge --help`, s", 0.1, results.help_s, 3),
    ]


def _target_table(shown: Iterable[Target]) -> Iterator[str]:
    yield "| median (least…most) | must be | is | |\n| --- | --- | --- | --- |"
    for one in shown:
        limit = f"at {'least' if one.at_least else 'most'} {one.limit:g}"
        found = spread(one.values).show(one.digits) if one.values else "not measured"
        verdict = {None: "", True: "yes", False: "**no**"}[one.met]
        yield f"| {one.what} | {limit} | {found} | {verdict} |"


def _recording_table(of: Measured) -> Iterator[str]:
    yield (
        f"\n## {of.megabytes:g} MB\n\n{of.messages:,} messages, {sum(of.written.values()):,} of them "
        f"{', '.join(COMPARED)}; rounds: {len(of.rounds)}.\n\n| median (least…most) | wall, s | CPU, s | peak, MB "
        "| rows | `check` is … times as fast | `read` is … times as fast |\n| --- | --- | --- | --- | --- | --- | --- |"
    )
    for name in dict.fromkeys(name for runs in of.rounds for name in runs):
        walls, cpus = of.walls(name), [runs[name].cpu_s for runs in of.rounds if name in runs]
        cells = [_show(walls), _show(cpus), f"{spread(_peaks(of, name)).median:.0f}"]
        cells.append(_rows(of.counted[name], of.written) if name in of.counted else "judged")
        for ours in (CHECK, READ):
            ratios = of.ratios(name, ours)
            cells.append("" if ours == name or not ratios else _show(ratios))
        yield f"| {name} | {' | '.join(cells)} |"
    for name, why in of.failed.items():
        yield f"\n{name} fails: {why}"


def _show(values: Sequence[float]) -> str:
    """About two significant digits."""
    shown = spread(values)
    return shown.show(sum(shown.median < scale for scale in (10.0, 1.0, 0.1)))


def _rows(counted: Counts, written: Counts) -> str:
    missing = sum(written.values()) - sum(counted.values())
    return "all" if counted == written else f"{-missing:+,}"


def _peaks(of: Measured, name: str) -> list[float]:
    return [runs[name].peak_mb for runs in of.rounds if name in runs]


def _memory_table(recordings: Iterable[Measured]) -> Iterator[str]:
    yield (
        "\n## Memory of `gcs_bridge.read`\n\n| recording | arrays that it returns, MB | process grows by, MB | ratio |"
        "\n| --- | --- | --- | --- |"
    )
    for one in recordings:
        if one.memory:
            arrays, grown = one.memory
            yield f"| {one.megabytes:g} MB | {arrays / 1e6:.1f} | {grown / 1e6:.1f} | {grown / arrays:.2f} |"


def _huge_table(of: Measured) -> Iterator[str]:
    yield f"\n## {of.megabytes:g} MB, once\n\n| | wall, s | CPU, s | peak, MB |\n| --- | --- | --- | --- |"
    for name, done in _only(of.rounds).items():
        yield f"| {name} | {done.wall_s:.1f} | {done.cpu_s:.1f} | {done.peak_mb:.0f} |"


def _only(rounds: Sequence[Mapping[str, Run]]) -> Mapping[str, Run]:
    (runs,) = rounds
    return runs


def _recovery_table(recoveries: Sequence[Recovery]) -> Iterator[str]:
    readers = list(recoveries[0].counted)
    yield (
        f"\n## Damaged recordings\n\nRows of {', '.join(COMPARED)}, counted; more than were left whole must be false."
        f"\n\n| damage | left whole | {' | '.join(readers)} |\n| --- | --- |{' --- |' * len(readers)}"
    )
    for one in recoveries:
        cells = [f"{sum(one.whole.values()):,}", *(_recovered(counted, one.whole) for counted in one.counted.values())]
        yield f"| {one.damage} | {' | '.join(cells)} |"


def _recovered(counted: Counts | None, whole: Counts) -> str:
    if counted is None:
        return "fails"
    good = sum(min(counted[name], whole[name]) for name in whole)
    false = sum(counted.values()) - good
    return f"{good:,}" + (f" and {false:,} false" if false else "")
