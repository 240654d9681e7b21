"""What a survey of a large fleet costs, each part of it by itself; what docs/survey.md reckons with.

python -m benchmarks.survey                      # all of it: half an hour on two cores
python -m benchmarks.survey --only rows --rows 20000

workers: recordings made of ours, by one process and by several, in turns; they differ in some bits, so that no two are
one · tasks: a Dask scheduler with two workers, and tasks that do nothing · rows: a dataset of so many recordings, with
other numbers in each: what it costs to keep one, to open it again, to sum it up and to ask it something.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.processes import TOP, Run, gcs_bridge, run, spread
from gcs_bridge.executors.base import cores
from gcs_bridge.executors.cluster import Cluster
from gcs_bridge.settings import Settings
from gcs_bridge.survey.dataset import Dataset
from gcs_bridge.survey.summary import Run as SurveyRun
from gcs_bridge.survey.summary import summarised
from gcs_bridge.survey.task import Asked, Result, Task, survey_one

FIXTURES = TOP / "sitl_fixtures"
_MINUTE_US = 60_000_000
_PATIENCE_S = 60.0


def make_recordings(folder: Path, count: int) -> int:
    """So many recordings, in fifty folders; their bytes in all."""
    drawn, sources = random.Random(1), [path.read_bytes() for path in sorted(FIXTURES.glob("*.tlog"))]
    size = 0
    for number in range(count):
        data = bytearray(sources[number % len(sources)])
        for _ in range(3):
            data[drawn.randrange(len(data))] ^= 1 << drawn.randrange(8)
        path = folder / f"vehicle-{number % 50:02d}" / f"{number:06d}.tlog"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        size += len(data)
    return size


def of_workers(count: int, rounds: int) -> None:
    """One process against all cores, in turns."""
    with tempfile.TemporaryDirectory(prefix="survey-") as made:
        folder = Path(made, "logs")
        folder.mkdir()
        size = make_recordings(folder, count)
        runs: dict[int, list[Run]] = {1: [], cores(): []}
        for turn in range(rounds):
            for workers, of_workers in runs.items():
                load = os.getloadavg()[0]
                out = Path(made, f"out-{turn}-{workers}")
                command = gcs_bridge("survey", "-q", str(folder), "--fail-on", "never", "--workers", str(workers))
                done = run([*command, "--output", str(out)])
                of_workers.append(done)
                print(f"{workers} workers: {done.wall_s:.1f} s, {done.cpu_s:.1f} s of CPU, load {load:.1f}", flush=True)
        for workers, of_workers in runs.items():
            wall, cpu = spread([one.wall_s for one in of_workers]), spread([one.cpu_s for one in of_workers])
            rate = size / 1e6 / wall.least
            print(f"{workers} workers: {wall.show(1)} s, {cpu.show(1)} s of CPU; {rate:.1f} MB/s at best")
        one, all_cores = (min(one.wall_s for one in each) for each in runs.values())
        print(f"1 to {cores()} workers: {one / all_cores:.2f} times as fast, best against best")


@contextmanager
def running_cluster(folder: Path, workers: int) -> Iterator[tuple[str, int]]:
    """A scheduler with so many workers; its address and process."""
    told = folder / "scheduler.json"
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    quiet["env"] = {**os.environ, "PYTHONPATH": str(TOP)}
    dask = [sys.executable, "-m", "dask"]
    with ExitStack() as stack:

        def start(*command: str) -> subprocess.Popen[bytes]:
            process = stack.enter_context(subprocess.Popen([*dask, *command, "--no-dashboard"], **quiet))
            stack.callback(process.terminate)
            return process

        scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(told))
        end_s = time.monotonic() + _PATIENCE_S
        while not told.exists() or not told.read_text():
            if time.monotonic() > end_s:
                raise SystemExit("the scheduler does not begin")
            time.sleep(0.05)
        for _ in range(workers):
            start("worker", "--scheduler-file", str(told), "--nthreads", "1", "--no-nanny")
        yield json.loads(told.read_text())["address"], scheduler.pid


def nothing(number: int) -> int:
    """A task that does nothing."""
    return number


def of_tasks(count: int) -> None:
    """Tasks through a scheduler: how many a second, and what each costs it and us."""
    with tempfile.TemporaryDirectory(prefix="survey-") as made, running_cluster(Path(made), 2) as (address, pid):
        with Cluster(address) as cluster:
            cpu_s, ours_s, begun_s = _cpu_s(pid), time.process_time(), time.perf_counter()
            done = sum(1 for _ in cluster.run(nothing, range(count)))
            wall_s = time.perf_counter() - begun_s
            ours, scheduler = time.process_time() - ours_s, _cpu_s(pid) - cpu_s
        print(
            f"{done} tasks that do nothing, two workers: {done / wall_s:.0f} a second; each costs the scheduler "
            f"{scheduler / done * 1e3:.2f} ms of CPU, this process {ours / done * 1e3:.2f} ms"
        )


def _cpu_s(pid: int) -> float:
    """Of a process, by the kernel's count."""
    after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(after_name[11]) + int(after_name[12])) / os.sysconf("SC_CLK_TCK")


def of_rows(count: int) -> None:
    """A dataset of so many recordings."""
    asked = Asked(settings=Settings(), judged_by={}, settings_digest="benchmark")
    real = [survey_one(Task(asked=asked, path=str(path))) for path in sorted(FIXTURES.glob("*.tlog"))]
    packed = [msgspec.json.encode(one) for one in real]
    drawn = random.Random(1)
    with tempfile.TemporaryDirectory(prefix="survey-") as made:
        folder = Path(made, "fleet")
        with _timed(f"{count} recordings kept", count), Dataset(folder, "1", "benchmark") as dataset:
            for number in range(count):
                dataset.add(_another(packed[number % len(packed)], number, drawn))
        with _timed("the dataset opened again", count), Dataset(folder, "1", "benchmark"):
            pass
        tables = ("recordings", "checks", "alarms")
        files = {name: list((folder / name).glob("*.parquet")) for name in tables}
        for name, parts in files.items():
            print(f"{name}: {len(parts)} parts, {sum(path.stat().st_size for path in parts) / 1e6:.1f} MB")
        nothing_done = SurveyRun(judged=0, known=0, copies=0, retried=0, bytes=0, wall_s=0.0, workers=1)
        with _timed("summed up", count):
            summarised(folder, nothing_done, [], None)
        _ask(folder)


def _another(packed: bytes, number: int, drawn: random.Random) -> Result:
    """A result of another recording: of one of a hundred vehicles, a minute after the last."""
    result = msgspec.json.decode(packed, type=Result)
    content = f"{number:032x}"
    for row in (result.recording, *result.checks, *result.alarms):
        assert row is not None
        row["content"], row["path"], row["folder"] = content, f"logs/{number}.tlog", f"logs/{number % 100}"
        row["start_utc"] = (row["start_utc"] or 0) + number * _MINUTE_US
        for name, value in row.items():
            if isinstance(value, float) and value not in (0.0, 1.0):
                row[name] = value * drawn.uniform(0.9, 1.1)
    return result


@contextmanager
def _timed(what: str, count: int) -> Iterator[None]:
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    yield
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    print(f"{what}: {wall_s:.2f} s, {cpu_s:.2f} s of CPU, {cpu_s / count * 1e3:.3f} ms a recording")


def _ask(folder: Path) -> None:
    """The queries of docs/survey.md."""
    import duckdb

    text = (TOP / "docs" / "survey.md").read_text(encoding="utf-8")
    for title, query in re.findall(r"^([^\n]+):\n\n```sql\n(.*?)```", text, re.MULTILINE | re.DOTALL):
        if "earlier" in query:
            continue
        begun_s = time.perf_counter()
        rows = duckdb.sql(query.replace("'fleet/", f"'{folder}/")).fetchall()
        print(f"{title}: {time.perf_counter() - begun_s:.2f} s, {len(rows)} rows")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("workers", "tasks", "rows"))
    parser.add_argument("--recordings", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--tasks", type=int, default=20_000)
    parser.add_argument("--rows", type=int, default=100_000)
    given = parser.parse_args()
    if given.only in (None, "workers"):
        of_workers(given.recordings, given.rounds)
    if given.only in (None, "tasks"):
        of_tasks(given.tasks)
    if given.only in (None, "rows"):
        of_rows(given.rows)


if __name__ == "__main__":
    main()
