"""Can the alarms be trusted? Judge recordings of healthy vehicles over worse and worse links, and count what is raised.

    python -m benchmarks.trust                    # the fixtures; some minutes, two processes
    python -m benchmarks.trust FOLDER ...         # and other recordings, .tlog
    python -m benchmarks.trust --faults           # how soon faults that are put in are found, instead
    python -m benchmarks.trust --every 9          # each recording over one link in nine, over all by turns

Every recording is brought by links of several rates, losses and disorders (`trust_links`), judged, and looked at by a
witness (`trust_witness`), who also asks a naive comparator. What a fixture should raise is known from its facts; of
other recordings only those are counted as healthy that bear a fixture's name, and what the rest raise is listed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from benchmarks import trust_faults
from benchmarks.trust_links import LOSSES, RATES_HZ, TROUBLES, Link
from benchmarks.trust_witness import NAIVE_LIMIT_DEG, Coverage, Witness
from gcs_bridge.judging.monitor import Monitor

T = TypeVar("T")

FIXTURES = Path(__file__).parents[1] / "sitl_fixtures"
LINKS = [Link(rate, loss, trouble) for rate in RATES_HZ for loss in LOSSES for trouble in TROUBLES]
PROCESSES = 2
COVERED_FROM_HZ = 10.0  # where coverage is promised
PAIRS_PROMISED, ARMED_PROMISED = 0.99, 0.9


class Told(NamedTuple):
    """An alarm or warning."""

    recording: str
    link: Link
    vehicle: str
    severity: str
    check: str
    what: str
    axis: str | None
    at_s: float
    until_s: float | None
    peak: float
    unit: str
    times: int


@dataclass
class Flown:
    """What came of one recording over one link, or of several together."""

    hours: float = 0.0
    told: list[Told] = field(default_factory=list)
    coverage: Coverage = field(default_factory=Coverage)
    checks: dict[str, float] = field(default_factory=dict)  # hours judged
    naive_alarms: int = 0

    def __add__(self, other: Flown) -> Flown:
        return Flown(
            self.hours + other.hours,
            self.told + other.told,
            self.coverage + other.coverage,
            {name: self.checks.get(name, 0.0) + other.checks.get(name, 0.0) for name in self.checks | other.checks},
            self.naive_alarms + other.naive_alarms,
        )

    def count(self, severity: str, check: str | None = None) -> int:
        return sum(one.times for one in self.told if one.severity == severity and check in (None, one.check))


def judge(data: bytes) -> tuple[dict[str, Any], Witness]:
    """The report on a recording, and what the witness saw."""
    witness = Witness()
    monitor = Monitor(observer=witness)
    monitor.feed_recording(data)
    return monitor.close().to_dict(), witness


def fly(path: Path, link: Link, data: bytes) -> Flown:
    """Judge a recording as the link brings it."""
    report, witness = judge(link.bring(data))
    flown = Flown(naive_alarms=witness.naive_alarms)
    for vehicle in report["files"][0]["vehicles"]:
        key = (vehicle["sysid"], vehicle["compid"])
        hours = sum(boot["last_boot_s"] - boot["first_boot_s"] for boot in vehicle["boots"]) / 3600
        flown.hours += hours
        flown.coverage += witness.coverage.get(key, Coverage())
        for check in vehicle["checks"]:
            name = check["name"]
            flown.checks[name] = flown.checks.get(name, 0.0) + hours * (check["coverage"] or 0.0)
        flown.told += [told(path.stem, link, f"{key[0]}.{key[1]}", alarm) for alarm in vehicle["alarms"]]
    return flown


def told(recording: str, link: Link, vehicle: str, alarm: dict[str, Any]) -> Told:
    at_s, until_s = alarm["raised_boot_s"], alarm["cleared_boot_s"]
    shown = (alarm["severity"], alarm["check"], alarm["what"], alarm["axis"])
    return Told(recording, link, vehicle, *shown, at_s, until_s, alarm["peak"], alarm["unit"], 1 + alarm["repeats"])


def own_rate_hz(data: bytes) -> float:
    """The rate of the faster attitude in a recording, 0 without any."""
    report, _ = judge(data)
    streams = [vehicle["streams"] for vehicle in report["files"][0]["vehicles"]]
    rates = [of[name]["rate_hz"] for of in streams for name in ("ATTITUDE", "ATTITUDE_QUATERNION") if name in of]
    return max(filter(None, rates), default=0.0)


def fly_all(
    path: Path, number: int, every: int = 1, troubles: Sequence[str] = tuple(TROUBLES)
) -> list[tuple[Link, Flown]]:
    """Judge a recording over the links of some troubles whose rate it can have, or one in `every`: by its number."""
    data = path.read_bytes()
    own_hz = own_rate_hz(data)
    fastest_hz = max((rate for rate in RATES_HZ if own_hz >= _ENOUGH * rate), default=RATES_HZ[-1])
    links = [link for link in LINKS if link.rate_hz <= fastest_hz and link.trouble in troubles]
    return [(link, fly(path, link, data)) for link in links[number % every :: every]]


_ENOUGH = 0.6  # of a rate, lost messages considered: a slower recording has its place at a lower rate


class Recording(NamedTuple):
    path: Path
    kind: str  # "healthy", "faulty" or "unknown"


def recordings(folders: Iterable[Path]) -> Iterator[Recording]:
    """The fixtures' and the folders' recordings; a whole one in the place of its cut."""
    found = {path.stem: path for folder in (FIXTURES, *folders) for path in sorted(folder.glob("*.tlog"))}
    for name, path in found.items():
        facts = FIXTURES / f"{name}.facts.json"
        kind = "unknown"
        if facts.exists():
            of = json.loads(facts.read_text())
            sound = of["judgement"] in ("agree", "explained") and not of["other_alarms"]
            kind = "healthy" if sound else "faulty"
        yield Recording(path, kind)


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table, if there is anything in it."""
    if not rows:
        print("\nnone")
        return
    print(f"\n| {' | '.join(head)} |\n|{' --- |' * len(head)}")
    for row in rows:
        print(f"| {' | '.join(map(str, row))} |")
    sys.stdout.flush()


def share(part: float, whole: float) -> str:
    return f"{100 * part / whole:.1f} %" if whole else "–"


def per_hour(count: int, hours: float) -> str:
    return f"{count} ({count / hours:.1f})" if hours else "–"


def by(flown: Iterable[tuple[Link, Flown]], key: Callable[[Link], Any]) -> list[tuple[Any, Flown]]:
    """What was flown over the links of one kind together, in the order of LINKS."""
    sums: dict[Any, Flown] = {}
    for link, one in sorted(flown, key=lambda one: LINKS.index(one[0])):
        sums[key(link)] = sums.get(key(link), Flown()) + one
    return list(sums.items())


def show_links(flown: list[tuple[Link, Flown]]) -> None:
    """One table over rates and losses, and one over what else the links do."""
    head = ["flight hours", "alarms (an hour)", "warnings (an hour)", "naive alarms (an hour)"]
    head += ["same-instant pairs judged", "armed time judged"]
    losses = by(flown, lambda link: (link.rate_hz, link.loss))
    shown = [(f"{rate:g} Hz", f"{loss:.0%}", *_numbers(one)) for (rate, loss), one in losses]
    table(["rate", "lost", *head], shown)
    troubles = by(flown, lambda link: link.trouble)
    table(["link", *head], [(trouble, *_numbers(one)) for trouble, one in troubles])


def _numbers(one: Flown) -> tuple[object, ...]:
    of = one.coverage
    return (
        f"{one.hours:.2f}",
        per_hour(one.count("alarm"), one.hours),
        per_hour(one.count("warning"), one.hours),
        per_hour(one.naive_alarms, one.hours),
        share(of.judged_same_instant, of.same_instant),
        share(of.judged_armed_s, of.armed_s),
    )


def show_checks(flown: list[tuple[Link, Flown]]) -> None:
    """Alarms, warnings and coverage of every check, by rate."""
    rates = by(flown, lambda link: link.rate_hz)
    together = sum((one for _, one in rates), Flown())
    rows = []
    for check in together.checks:
        counts = [per_hour(together.count(severity, check), together.hours) for severity in ("alarm", "warning")]
        rows.append((f"`{check}`", *counts, *(share(one.checks[check], one.hours) for _, one in rates)))
    table(["check", "alarms", "warnings", *(f"judged, {rate:g} Hz" for rate, _ in rates)], rows)


def show_recordings(flown: dict[str, list[tuple[Link, Flown]]]) -> None:
    rows = []
    for name, of in flown.items():
        one = sum((found for _, found in of), Flown())
        own = of[0][1]
        worst = min((found.coverage for link, found in of if promised(link)), key=_armed_share, default=Coverage())
        rows.append(
            (
                f"`{name}`",
                f"{own.hours * 3600:.0f}",
                one.count("alarm"),
                one.count("warning"),
                own.naive_alarms,
                one.naive_alarms,
                share(worst.judged_armed_s, worst.armed_s),
            )
        )
    head = ["recording", "s", "alarms, all links", "warnings, all links", "naive alarms, as recorded", "all links"]
    table([*head, "least armed time judged, 10 Hz and above"], rows)


def promised(link: Link) -> bool:
    """Whether coverage is promised: not of attitudes that share no instant, nor while others come in their place."""
    return link.rate_hz >= COVERED_FROM_HZ and not link.shares_no_instant and link.trouble != "transfer"


def _armed_share(of: Coverage) -> float:
    return of.judged_armed_s / of.armed_s if of.armed_s else 1.0


def show_told(flown: Iterable[tuple[Link, Flown]]) -> None:
    """Each kind of alarm and warning, with the worst of it."""
    kinds: dict[tuple[str, ...], list[Told]] = defaultdict(list)
    for _, one in flown:
        for each in one.told:
            kinds[each.recording, each.vehicle, each.severity, each.check, each.what].append(each)
    rows = []
    for (recording, vehicle, severity, check, what), of in sorted(kinds.items()):
        worst = max(of, key=lambda each: each.peak)
        until = "the end" if worst.until_s is None else f"{worst.until_s:.1f}"
        rates = Counter(f"{each.link.rate_hz:g} Hz" for each in of)
        troubles = Counter(each.link.trouble for each in of)
        rows.append(
            (
                f"{recording} {vehicle}",
                severity,
                f"{check}: {what}",
                ", ".join(f"{kind}: {count}" for counts in (rates, troubles) for kind, count in counts.items()),
                f"{worst.peak:.3g} {worst.unit} {worst.axis or ''}",
                f"{worst.at_s:.1f} to {until}",
                worst.link,
            )
        )
    table(["recording", "", "check", "links on which it came", "worst", "boot time, s", "over"], rows)


def broken_promises(flown: dict[str, list[tuple[Link, Flown]]]) -> Iterator[str]:
    """What should not be, of healthy recordings."""
    for name, of in flown.items():
        for link, one in of:
            if one.count("alarm"):
                yield f"{name}: {one.count('alarm')} false alarms over {link}"
            coverage = one.coverage
            if promised(link) and coverage.judged_same_instant < PAIRS_PROMISED * coverage.same_instant:
                yield f"{name}: {coverage.judged_same_instant} of {coverage.same_instant} pairs judged over {link}"
            if promised(link) and coverage.judged_armed_s < ARMED_PROMISED * coverage.armed_s:
                yield f"{name}: {coverage.judged_armed_s:.1f} of {coverage.armed_s:.1f} armed s judged over {link}"


def main(argv: list[str] | None = None) -> int:
    """Judge, and print; 1 where something was raised on a healthy vehicle, or too little was judged."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.trust", description="Count false alarms.")
    parser.add_argument("folders", nargs="*", type=Path, help="with more recordings")
    parser.add_argument("--only", default="", help="judge the recordings whose names begin so")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="one link in N alone")
    parser.add_argument("--troubles", nargs="+", choices=TROUBLES, default=list(TROUBLES), metavar="NAME")
    parser.add_argument("--processes", type=int, default=PROCESSES, metavar="N")
    parser.add_argument("--faults", action="store_true", help="measure how soon faults are found instead")
    arguments = parser.parse_args(argv)
    chosen = [one for one in recordings(arguments.folders) if one.path.stem.startswith(arguments.only)]
    with ProcessPoolExecutor(arguments.processes) as pool:
        if arguments.faults:
            return find_faults(pool, chosen)
        work = partial(fly_all, every=max(arguments.every, 1), troubles=arguments.troubles)
        return count_false_alarms(pool, chosen, work)


def in_turn(
    pool: Executor, work: Callable[[Path, int], T], chosen: Sequence[Recording]
) -> Iterator[tuple[Recording, T]]:
    """Do the work on each recording, given its number; say so on stderr as it gets done."""
    begun_s = time.monotonic()
    for recording, done in zip(chosen, pool.map(work, [one.path for one in chosen], range(len(chosen))), strict=True):
        print(f"{time.monotonic() - begun_s:5.0f} s  {recording.path.stem}", file=sys.stderr, flush=True)
        yield recording, done


def try_faults(path: Path, _number: int) -> list[trust_faults.Case]:
    """Every fault in one recording."""
    return trust_faults.try_faults(path)


def find_faults(pool: Executor, chosen: Sequence[Recording]) -> int:
    """Put faults into the healthy recordings, and print how soon they were told; 1 where one never was."""
    healthy = [one for one in chosen if one.kind == "healthy"]
    cases = [case for _, found in in_turn(pool, try_faults, healthy) for case in found]
    table(["fault", *map(str, trust_faults.LINKS)], list(trust_faults.rows(cases)))
    missed = [case for case in cases if case.delay_s is None]
    print("", *missed, sep="\n", file=sys.stderr)
    return int(bool(missed))


def count_false_alarms(
    pool: Executor, chosen: Sequence[Recording], work: Callable[[Path, int], list[tuple[Link, Flown]]]
) -> int:
    """Judge the recordings over all links, and print; 1 where a promise is broken."""
    flown: dict[str, dict[str, list[tuple[Link, Flown]]]] = defaultdict(dict)
    for recording, found in in_turn(pool, work, chosen):
        flown[recording.kind][recording.path.stem] = found
    healthy = flown["healthy"]
    every = [one for of in healthy.values() for one in of]
    print(f"healthy, beside latest against latest with a limit of {NAIVE_LIMIT_DEG:g}°:")
    show_links(every)
    show_checks(every)
    show_recordings(healthy)
    show_told(every)
    for kind in ("faulty", "unknown"):
        print(f"\n{kind}:")
        show_told(one for of in flown[kind].values() for one in of)
    broken = list(broken_promises(healthy))
    print("", *broken, sep="\n", file=sys.stderr)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
