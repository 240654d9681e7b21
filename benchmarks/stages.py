"""Where the time and the memory of one `gcs-bridge check` go, in this one process: start-up, then stage by stage.

Time is a stage's own: what it calls is another's if that is in the table. Of the threads only the one that judges is on
the clock: another reads the next piece meanwhile, and short-lived ones judge some of the checks. With --functions,
cProfile's list follows; with --scan, the speed of the frame scan alone is all there is.

    python -m benchmarks.stages long.tlog
"""

from __future__ import annotations

import argparse
import cProfile
import functools
import importlib
import inspect
import io
import pstats
import resource
import statistics
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from gcs_bridge.jit.kernels import KERNELS

PIECE = 2**22
CHECKS = [
    ("euler_quaternion", "EulerQuaternion"),
    ("quaternion_norm", "QuaternionNorm"),
    ("body_rates", "BodyRates"),
    ("kinematics", "Kinematics"),
    ("gyro", "Gyro"),
    ("gravity", "Gravity"),
    ("mag_heading", "MagHeading"),
    ("secondary_estimate", "SecondaryEstimate"),
    ("stream", "StreamCheck"),
]

# stage → its functions; each compiled kernel is a stage of its own. A function that is not there any more is named in
# the output and costs nothing else.
STAGES = {
    "expected differences": ["gcs_bridge.expected.vehicle:Expected.correct"],
    "pairing": ["gcs_bridge.pairing.pairs:Aligner.pair"],
    "liveness": [
        "gcs_bridge.telemetry.stream_liveness:Liveness.take",
        "gcs_bridge.telemetry.stream_liveness:Liveness.pass_silence",
    ],
    "checks": [f"gcs_bridge.checks.{module}:{name}.judge" for module, name in CHECKS],
    "quantiles": ["gcs_bridge.checks.quantiles:Quantiles.add", "gcs_bridge.checks.quantiles:Quantiles.summary"],
    "alarms": ["gcs_bridge.alarms.manager:AlarmManager.begin", "gcs_bridge.alarms.manager:AlarmManager.tell"],
    "vehicle, rest": ["gcs_bridge.judging.vehicle:VehicleJudge.take"],
    "monitor, rest": ["gcs_bridge.judging.monitor:Monitor.judge", "gcs_bridge.judging.monitor:Monitor.close"],
    "waiting for the other thread, and rest": ["gcs_bridge.recordings.check:check_file"],
}


class Clock(threading.local):
    """Gives each moment of one thread to the innermost stage that runs in it."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self._running: list[str] = []
        self._since_s = 0.0

    def enter(self, stage: str) -> None:
        self._settle()
        self._running.append(stage)

    def leave(self) -> None:
        self._settle()
        self._running.pop()

    def _settle(self) -> None:
        now_s = time.perf_counter()
        if self._running:
            stage = self._running[-1]
            self.spent_s[stage] = self.spent_s.get(stage, 0.0) + now_s - self._since_s
        self._since_s = now_s

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, on this clock; a generator is on it while it works."""

        @functools.wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            self.calls[stage] = self.calls.get(stage, 0) + 1
            self.enter(stage)
            try:
                return function(*args, **kwargs)
            finally:
                self.leave()

        @functools.wraps(function)
        def iterate(*args: Any, **kwargs: Any) -> Iterator[Any]:
            self.calls[stage] = self.calls.get(stage, 0) + 1
            items = function(*args, **kwargs)
            while True:
                self.enter(stage)
                try:
                    item = next(items, _END)
                finally:
                    self.leave()
                if item is _END:
                    return
                yield item

        return iterate if inspect.isgeneratorfunction(function) else call

    def install(self) -> list[str]:
        """Put every stage on this clock; returns the functions that are not there."""
        missing = []
        for stage, places in STAGES.items():
            for place in places:
                module, _, path = place.partition(":")
                *owners, name = path.split(".")
                try:
                    owner = functools.reduce(getattr, owners, importlib.import_module(module))
                    setattr(owner, name, self.timed(stage, getattr(owner, name)))
                except (ImportError, AttributeError):
                    missing.append(place)
        for kernel in KERNELS:
            kernel.load()
            kernel._run = self.timed(f"kernel {kernel.__name__}", kernel._run)
        return missing


_END = object()


def peak_mb() -> float:
    """The largest memory of this process so far, MB of 1,000,000 bytes."""
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size / 1e6 if sys.platform == "darwin" else size * 1024 / 1e6


def start_up(head: bytes) -> None:
    """Import what `check` imports and load its kernels, in its order; print each step's time and memory."""
    from gcs_bridge._version import __version__  # so that the package itself is no part of the first step

    def load_kernels() -> None:
        from gcs_bridge.judging.monitor import Monitor

        monitor = Monitor()
        monitor.feed_recording(head)
        monitor.close()

    def load_dialect() -> None:
        from gcs_bridge.mavlink.dialect import load_dialect

        load_dialect("all")

    steps: list[tuple[str, Callable[[], object]]] = [
        ("command line (click)", lambda: importlib.import_module("gcs_bridge.cli.app")),
        ("settings (msgspec)", lambda: importlib.import_module("gcs_bridge.settings").load_settings()),
        ("numpy", lambda: importlib.import_module("numpy")),
        ("llvmlite", lambda: importlib.import_module("llvmlite.binding")),
        ("the rest of gcs_bridge", lambda: importlib.import_module("gcs_bridge.recordings.source")),
        ("dialect tables (pymavlink)", load_dialect),
        ("kernels, from where they are kept", load_kernels),
    ]
    print(f"gcs-bridge {__version__}\n\n| start-up | ms | peak MB |\n| --- | --- | --- |")
    print(f"| (the interpreter, and this script) | | {peak_mb():.0f} |")
    for name, step in steps:
        begun_s = time.perf_counter()
        step()
        print(f"| {name} | {(time.perf_counter() - begun_s) * 1e3:.0f} | {peak_mb():.0f} |", flush=True)


def judge(path: Path) -> None:
    """Judge the recording with every stage on a clock; print each one's own time."""
    from gcs_bridge.recordings import check as recording
    from gcs_bridge.settings import Settings

    clock = Clock()
    for place in clock.install():
        print(f"not measured, as it is not there: {place}", file=sys.stderr)
    begun_s = time.perf_counter()
    recording.check_file(path, Settings())  # by its module, where the clock has taken its place
    all_s = time.perf_counter() - begun_s
    print("\n| judging, this thread | calls | ms | % |\n| --- | --- | --- | --- |")
    for stage, spent_s in sorted(clock.spent_s.items(), key=lambda one: -one[1]):
        if spent_s > all_s / 1000:
            print(f"| {stage} | {clock.calls[stage]} | {spent_s * 1e3:.1f} | {spent_s / all_s * 100:.1f} |")
    print(f"| all | | {all_s * 1e3:.1f} | 100 |\n\npeak {peak_mb():.0f} MB, {path.stat().st_size / 1e6:.1f} MB file")


def show_functions(path: Path) -> None:
    """Judge it once more under cProfile, which slows down short functions, and print the ones of the most own time."""
    from gcs_bridge.recordings.check import check_file
    from gcs_bridge.settings import Settings

    profiler = cProfile.Profile()
    profiler.runcall(check_file, path, Settings())
    text = io.StringIO()
    pstats.Stats(profiler, stream=text).strip_dirs().sort_stats("tottime").print_stats(25)
    print(text.getvalue())


def scan_speed(path: Path, times: int = 9) -> float:
    """Median speed of the frame scan alone over the file, MB/s, with the file in memory and the kernel loaded."""
    from gcs_bridge.mavlink.dialect import load_dialect
    from gcs_bridge.mavlink.scanner import Scanner

    data = memoryview(path.read_bytes())
    dialect = load_dialect("all")
    Scanner(dialect, timed=True).scan(data[:PIECE])
    spent_s = []
    for _ in range(times):
        scanner = Scanner(dialect, timed=True)
        begun_s = time.perf_counter()
        for start in range(0, len(data), PIECE):
            scanner.scan(data[start : start + PIECE], final=start + PIECE >= len(data))
        spent_s.append(time.perf_counter() - begun_s)
    return len(data) / 1e6 / statistics.median(spent_s)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Where the time and the memory of one check go.")
    parser.add_argument("recording", type=Path)
    parser.add_argument("--functions", action="store_true", help="and cProfile's list of functions")
    parser.add_argument("--scan", action="store_true", help="only the speed of the frame scan, MB/s")
    arguments = parser.parse_args(argv)
    if arguments.scan:
        print(f"{scan_speed(arguments.recording):.0f}")
        return 0
    with arguments.recording.open("rb") as file:
        head = file.read(2**16)
    start_up(head)
    judge(arguments.recording)
    if arguments.functions:
        show_functions(arguments.recording)
    return 0


if __name__ == "__main__":
    sys.exit(main())
