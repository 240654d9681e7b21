"""Every mistake of the causes' table put into recordings of real autopilots: is it found, how soon, and is it named?

    python -m benchmarks.diagnosis                  # the project's own recordings; half an hour or more on two cores
    python -m benchmarks.diagnosis --more FOLDER    # and every .tlog in a folder
    python -m benchmarks.diagnosis --every 10       # one case in ten
    python -m benchmarks.diagnosis --begin 0.5      # the mistakes begin later in each recording

Each case goes the way of `gcs-bridge check`: bytes in, report out. What the report says is held against SciPy, which
undoes what was named on fields unpacked by hand (`tests/diagnosis_oracle.py`). Of the first alarm's last diagnosis:

- right: one candidate, and it means the same as what was injected, for any motion
- tied: several candidates, each of which SciPy undoes and finds to fit the samples that it rests on
- unknown, or none: no name was given
- wrong: anything else; and if any answer before or after it, of any alarm, is wrong

A fault that never shows more than the limit for two seconds (a turned sign of a roll that stays zero) has no alarm to
raise and is left out.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from scipy.spatial.transform import Slerp

import gcs_bridge
from gcs_bridge import Monitor, diagnosis
from gcs_bridge.contract import plain
from gcs_bridge.diagnosis import Diagnosis, Window, diagnose, diagnose_norm
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.recordings.faults import Fault, parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.settings import AlignmentSettings
from gcs_bridge.telemetry.samples import AttitudeSamples
from tests.helpers import diagnosis_oracle as oracle
from tests.helpers import wire

ROOT = Path(__file__).parents[1]

STRENGTHS = {
    "yaw_offset": ["1", "-5", "12", "30", "90", "180"],
    "mount_offset": ["1,0,0", "0,4,0", "0,0,-5", "20,-10,5", "0,90,0"],
    "world_offset": ["4,0,0", "3,-2,10"],
    "time_skew": ["20", "-40", "150", "-250", "500"],
    "quaternion_unnormalised": ["0.95", "1.05"],
}
FAULTS = [
    fault
    for cause in CAUSES.values()
    if cause.falsify is not None and cause.acts_on != "rates"  # the two forms are one rotation
    for fault in ([f"{cause.name}:{value}" for value in STRENGTHS.get(cause.name, [])] or [cause.name])
]
RATES = {  # as it is recorded, and at the rates that many users have
    "as recorded": (),
    "25/10 Hz": ("thin:ATTITUDE=25", "thin:ATTITUDE_QUATERNION=10"),
    "10/4 Hz": ("thin:ATTITUDE=10", "thin:ATTITUDE_QUATERNION=4"),
    "4/4 Hz": ("thin:ATTITUDE=4", "thin:ATTITUDE_QUATERNION=4"),
}
TRIMMED = {  # recording and system → its trim, deg
    ("j_ahrs_trim5", 1): ("ahrs_trim", (5.0, -3.0)),
    ("k1_copter_trim", 1): ("ahrs_trim", (-2.0, 3.0)),
    ("k5_three_vehicles", 7): ("ahrs_trim", (0.0, 2.0)),
    ("d_plane_pitchtrim3", 1): ("pitch_trim", (3.0,)),
}
BEGIN = 0.35  # share of the recording, where the mistake begins
LIMIT_DEG = 0.52
SHOWS_S = 2.0
FITS_DEG = 0.3  # with interpolation in it
ABOUT_THE_SAME_DEG, ABOUT_THE_SAME_SHARE = 0.3, 0.05  # of the value
ABOUT_THE_SAME_MS = 5.0
TRIM_LEAVES_DEG = 0.1


Named = tuple[tuple[str, tuple[float, ...]], ...]
"""Mistakes and trims with their values, in the order of undoing."""


class Recording(NamedTuple):
    path: Path
    sysid: int
    trim: Named = ()  # which nobody tells: mistakes are in it from the start

    @property
    def name(self) -> str:
        return f"{self.path.stem}, {self.sysid}" + (", trim not told" if self.trim else "")


class Case(NamedTuple):
    recording: Recording
    rate: str
    fault: str
    begin: float


class Result(NamedTuple):
    case: Case
    outcome: str  # right, tied, unknown, none, wrong, undetected, unseen
    first: str  # outcome of the first answer, which comes with the alarm
    delay_s: float | None
    told: str


class Answer(NamedTuple):
    outcome: str
    entry: dict[str, Any]
    words: str


def recordings(more: Sequence[Path]) -> Iterator[Recording]:
    """Recordings whose two forms agree, or would but for a trim, each with its systems that send both.

    Says which others are left out.
    """
    for facts in sorted((ROOT / "sitl_fixtures").glob("*.facts.json")):
        told = json.loads(facts.read_text(encoding="utf-8"))
        path = facts.with_name(facts.name.replace(".facts.json", ".tlog"))
        if told["euler_quaternion"] == "agree":
            for vehicle in told["vehicles"]:
                yield from usable(path, int(vehicle.split(",")[0]))
    for (name, sysid), trim in TRIMMED.items():
        yield Recording(ROOT / "sitl_fixtures" / f"{name}.tlog", sysid, (trim,))
    for path in sorted(one for folder in more for one in folder.glob("*.tlog")):
        for sysid in range(1, 8):
            yield from usable(path, sysid)


def usable(path: Path, sysid: int) -> Iterator[Recording]:
    """The recording, if the oracle can walk it, and both forms are there and agree."""
    try:
        boots = oracle.boots(path.read_bytes(), sysid)
        sent = max(boots, key=lambda boot: len(boot.t_euler_s))
        if min(len(sent.t_euler_s), len(sent.t_quaternion_s)) < 60:
            return
        left_out = "" if len(boots) == 1 else "it restarts"
        if float(np.quantile(oracle.disagreement(sent)[1], 0.9)) > 0.5:
            left_out = "its two forms differ"
    except (ValueError, IndexError):
        left_out = "damaged"
    if left_out:
        print(f"left out: {path.name}, system {sysid}: {left_out}", file=sys.stderr)
    else:
        yield Recording(path, sysid)


def without_trims(data: bytes) -> bytes:
    """The recording without the parameters that tell trims."""
    told = (b"AHRS_TRIM_X", b"AHRS_TRIM_Y", b"PTCH_TRIM_DEG")
    kept = ((t_us, frame) for t_us, frame in wire.records(data) if not any(name in frame for name in told))
    return b"".join(t_us.to_bytes(8, "big") + frame for t_us, frame in kept)


def judge(case: Case) -> Result:
    """Inject, check, compare."""
    path, sysid, trim = case.recording
    data = path.read_bytes()
    if trim:
        data = without_trims(data)
    if RATES[case.rate]:
        data = inject(data, [parse_fault(fault) for fault in RATES[case.rate]], sysid=sysid)
    fault = parse_fault(case.fault)
    times_us = [t_us for t_us, _ in wire.records(data)]
    (healthy,) = oracle.boots(data, sysid)
    begin = 0.0 if trim else case.begin
    data = inject(data, [fault], sysid=sysid, from_s=begin * (times_us[-1] - times_us[0]) / 1e6)
    (sent,) = oracle.boots(data, sysid)
    shows_s = _shows_s(sent, fault.name)
    shows_s = shows_s[shows_s >= _begins_s(healthy, sent)]

    asked: list[tuple[Window | None, Diagnosis | None]] = []

    def noted(window: Window, alignment: AlignmentSettings | None = None) -> Diagnosis | None:
        asked.append((window, diagnose(window, alignment)))
        return asked[-1][1]

    def noted_norm(quaternion: AttitudeSamples) -> Diagnosis | None:
        asked.append((None, diagnose_norm(quaternion)))
        return asked[-1][1]

    monitor = Monitor(sysid=sysid)
    # What each answer rests on is told by nobody else.
    with mock.patch.multiple(diagnosis, diagnose=noted, diagnose_norm=noted_norm):
        monitor.feed_recording(data)
    (file,) = monitor.close().to_dict()["files"]
    vehicle = next(one for one in file["vehicles"] if one["sysid"] == sysid)
    alarms = [one for one in vehicle["alarms"] if one["check"] in ("euler_quaternion", "quaternion_norm")]
    if not alarms:
        lasts_s = len(shows_s) * float(np.median(np.diff(sent.t_quaternion_s)))
        return Result(case, "undetected" if lasts_s > SHOWS_S else "unseen", "none", None, "")
    alarm = alarms[0]
    delay_s = alarm["raised_boot_s"] - _onset_s(shows_s, alarm["raised_boot_s"])
    answers = [_answer(fault, trim, sent, window, found) for window, found in asked if found]
    last = next((one for one in reversed(answers) if one.entry == alarm["diagnosis"]), Answer("none", {}, ""))
    chosen = next((one for one in answers if one.outcome == "wrong"), last)
    return Result(case, chosen.outcome, answers[0].outcome if answers else "none", delay_s, chosen.words)


def _answer(fault: Fault, trim: Named, sent: oracle.Sent, window: Window | None, found: Diagnosis) -> Answer:
    begin_s, end_s = 0.0, np.inf
    if window is not None:
        times_us = np.concatenate((window.euler.t_boot_us, window.quaternion.t_boot_us))
        begin_s, end_s = times_us.min() / 1e6, times_us.max() / 1e6
    entry = plain(found.entry())
    outcome = _outcome(fault, trim, found, sent, sent.between(begin_s, end_s))
    told = f"{entry['cause']} {entry['value']} {entry['confidence']} {entry['candidates']}"
    return Answer(outcome, entry, f"by {end_s - begin_s:.1f} s: {told}")


def _begins_s(healthy: oracle.Sent, sent: oracle.Sent) -> float:
    """The first falsified sample's time."""
    euler = (healthy.rpy_rad != sent.rpy_rad).any(axis=1)
    quaternion = (healthy.wxyz != sent.wxyz).any(axis=1) | (healthy.t_quaternion_s != sent.t_quaternion_s)
    return float(np.concatenate((healthy.t_euler_s[euler], healthy.t_quaternion_s[quaternion])).min())


def _shows_s(sent: oracle.Sent, fault: str) -> oracle.Array:
    """When the fault shows, by SciPy: times at which the limit is exceeded."""
    if fault == "quaternion_unnormalised":
        return np.asarray(sent.t_quaternion_s[np.abs(np.linalg.norm(sent.wxyz, axis=1) - 1) > 1e-2])
    t_s, splined_deg = oracle.disagreement(sent)
    _, angle_deg = oracle.disagreement(sent, Slerp)
    return np.asarray(t_s[np.minimum(splined_deg, angle_deg) > LIMIT_DEG])


def _onset_s(shows_s: oracle.Array, raised_s: float) -> float:
    """When the disagreement began that was raised then: it showed from there on with gaps of less than a second."""
    before = shows_s[shows_s <= raised_s]
    breaks = np.flatnonzero(np.diff(before) > 1.0)
    return float(before[breaks[-1] + 1 if len(breaks) else 0]) if len(before) else raised_s


def _outcome(fault: Fault, trim: Named, found: Diagnosis, sent: oracle.Sent, window: oracle.Sent) -> str:
    if found.cause == "unknown":
        return "unknown"
    if len(found.candidates) > 1:
        fit = all(oracle.leaves_deg(window, candidate) < FITS_DEG for candidate in found.candidates)
        return "tied" if fit else "wrong"
    named = tuple(zip(found.causes, found.values, strict=True))
    mistakes = tuple(one for one in named if one[0] not in oracle.TRIMS)
    if _means_the_same(fault, (), mistakes):  # and a trim that is named beside it must fit the rest of the recording
        return "right" if mistakes == named or _leaves_deg(sent, named) < TRIM_LEAVES_DEG else "wrong"
    return "right" if trim and _means_the_same(fault, trim, named) else "wrong"


def _leaves_deg(sent: oracle.Sent, named: Named) -> float:
    """What is left, in the median, once all that was told is undone in the whole recording."""
    for name, value in named:
        sent = oracle.undone(sent, name, value)
    return float(np.median(oracle.disagreement(sent)[1]))


def _means_the_same(fault: Fault, trim: Named, named: Named) -> bool:
    """Whether what is named is what was made and set, by its value or for every motion."""
    name, value = fault.name, fault.value
    if name in ("time_skew", "quaternion_unnormalised"):
        within = max(ABOUT_THE_SAME_MS, 0.05 * abs(value[0])) if name == "time_skew" else 1e-3
        return [one for one, _ in named] == [name] and abs(named[0][1][0] - value[0]) <= within
    if name.startswith("frozen") or any(cause.startswith(("frozen", "time_skew")) for cause, _ in named):
        return [one for one, _ in named] == [name]
    within = ABOUT_THE_SAME_DEG + ABOUT_THE_SAME_SHARE * float(np.linalg.norm(value or [0.0]))
    return oracle.apart_deg([(name, value), *trim], named) < within


# --- tables ----------------------------------------------------------------------------------------------------------

OUTCOMES = ("right", "tied", "unknown", "none", "wrong", "undetected")


def table(results: Sequence[Result], title: str, key: Any) -> str:
    lines = [f"| {title} | cases | s to the alarm, median (p95) | {' | '.join(OUTCOMES)} |", "| --- " * 9 + "|"]
    groups = sorted({key(result) for result in results}, key=[key(result) for result in results].index)
    for group in [*groups, "all"]:
        mine = [result for result in results if group in ("all", key(result)) and result.outcome != "unseen"]
        if not mine:
            continue
        delays = [result.delay_s for result in mine if result.delay_s is not None]
        delay = "{:.2f} ({:.2f})".format(*np.quantile(delays, (0.5, 0.95))) if delays else ""
        counts = [sum(result.outcome == outcome for result in mine) for outcome in OUTCOMES]
        lines.append(f"| {group} | {len(mine)} | {delay} | {' | '.join(str(count or '') for count in counts)} |")
    return "\n".join(lines)


SPEED = {  # what is diagnosed → the faults that make it
    "one mistake": ["quaternion_conjugate"],
    "a turn": ["mount_offset:5,-9,14"],
    "a lag": ["time_skew:150"],
    "two mistakes": ["enu_flu", "yaw_sign"],
    "a lag and a turn": ["time_skew:80", "mount_offset:5,-9,14"],
    "none that is known": ["yaw_offset:12", "mount_offset:0,4,0", "quaternion_conjugate"],
}
HIDDEN = {"": (), ", AHRS_TRIM not told": ("ahrs_trim",)}


def speed(times: int = 15) -> str:
    """CPU time of one diagnosis of 2,000 pairs of acro at 50 Hz, median and slowest."""
    lines = ["| 2,000 pairs | diagnosis | ms of CPU, median (slowest) |", "| --- | --- | --- |"]
    data = (ROOT / "sitl_fixtures" / "b_copter_acro.tlog").read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        for title, faults in SPEED.items():
            path = Path(folder, "falsified.tlog")
            path.write_bytes(inject(data, [parse_fault(fault) for fault in faults]))
            vehicle = gcs_bridge.read(path).vehicles[1, 1]
            for also, trims in HIDDEN.items():
                window = Window(euler=vehicle.attitude, quaternion=vehicle.attitude_quaternion, trims=trims)
                found = diagnose(window)
                spent_s = []
                for _ in range(times):
                    begun_s = time.process_time()
                    diagnose(window)
                    spent_s.append(time.process_time() - begun_s)
                median, slowest = 1e3 * np.median(spent_s), 1e3 * max(spent_s)
                lines.append(f"| {title}{also} | {found.cause if found else ''} | {median:.0f} ({slowest:.0f}) |")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="How well mistakes are detected and named.")
    parser.add_argument("--more", type=Path, nargs="*", default=[], help="folders with more recordings")
    parser.add_argument("--every", type=int, default=1, help="only each so manieth case")
    parser.add_argument("--begin", type=float, default=BEGIN, help="share of the recording before the mistake")
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args(argv)
    chosen = list(recordings(arguments.more))
    every = itertools.product(chosen, RATES, FAULTS)
    cases = [Case(recording, rate, fault, arguments.begin) for recording, rate, fault in every]
    cases = cases[:: arguments.every]
    begun_s = time.perf_counter()
    with ProcessPoolExecutor(arguments.processes, initializer=os.nice, initargs=(19,)) as pool:
        results = list(pool.map(judge, cases, chunksize=8))
    print(table(results, "mistake", lambda result: result.case.fault.partition(":")[0]), end="\n\n")
    print(table(results, "rates", lambda result: result.case.rate), end="\n\n")
    print(table(results, "recording", lambda result: result.case.recording.name), end="\n\n")
    print(speed(), end="\n\n")
    unseen = sum(result.outcome == "unseen" for result in results)
    print(f"{len(cases)} cases in {time.perf_counter() - begun_s:.0f} s; {unseen} of them do not show.")
    for result in results:
        if result.outcome in ("wrong", "none", "undetected"):
            case = result.case
            print(f"{result.outcome}: {case.recording.name}, {case.rate}, {case.fault}: {result.told}")
    return int(any(result.outcome == "wrong" for result in results))


if __name__ == "__main__":
    sys.exit(main())
