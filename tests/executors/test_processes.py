"""Work in other processes: all of it is done, and a process that dies costs what it was at alone."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_bridge.errors import UsageError
from gcs_bridge.executors.processes import Processes
from tests.helpers.paths import ROOT
from tests.helpers.worked import DEADLY, begin_or_square, pid_of, squared

PATIENCE_S = 60


def is_there(pid: int) -> bool:
    """Whether a process runs: one that has ended may wait for its parent to notice."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")
    try:
        return status.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return not Path("/proc/self/stat").exists()


def wait_for(file: Path) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not file.exists():
        assert time.monotonic() < end_s, f"nobody writes {file}"
        time.sleep(0.02)


def wait_until_gone(pid: int) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while is_there(pid):
        assert time.monotonic() < end_s, f"process {pid} is still there"
        time.sleep(0.02)


@pytest.mark.slow
def test_a_process_that_dies_costs_its_task_alone() -> None:
    """All others are done, and it is told how the process ended."""
    with Processes(2) as processes:
        outcomes = list(processes.run(squared, [1, 2, DEADLY, 3, 4, 5]))
        pids = processes.pids
    assert sorted(outcome.result for outcome in outcomes if outcome.result is not None) == [1, 4, 9, 16, 25]
    (lost,) = (outcome for outcome in outcomes if outcome.lost)
    assert lost.task == DEADLY
    assert "SIGKILL" in str(lost.lost)
    assert not any(map(is_there, pids))


@pytest.mark.slow
def test_processes_that_cannot_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not all of a million tasks are tried: here each ends before it looks at one."""
    monkeypatch.setattr("gcs_bridge.executors.processes._begin", sys.exit)
    tried: list[int] = []
    with pytest.raises(UsageError, match="worker processes cannot begin"), Processes(1) as processes:
        tried.extend(outcome.task for outcome in processes.run(squared, range(1000)))
    assert len(tried) < 10


@pytest.mark.slow
def test_processes_are_replaced() -> None:
    """What libraries keep for good goes with a process after some tasks."""
    with Processes(1, most_tasks=2) as processes:
        pids = [outcome.result for outcome in processes.run(pid_of, range(4))]
    assert pids[0] == pids[1] != pids[2] == pids[3]


@pytest.mark.slow
def test_a_process_that_held_much_memory_is_replaced() -> None:
    """The limit here is below what any interpreter holds."""
    with Processes(1, most_memory=1) as processes:
        first, second = (outcome.result for outcome in processes.run(pid_of, range(2)))
    assert first != second


def test_tasks_are_taken_as_there_is_room() -> None:
    """None before another is done: the next is asked for again then."""
    done: list[int] = []

    def tasks() -> Iterator[int | None]:
        for number in range(3):
            while len(done) < number:
                yield None
            yield number

    with Processes(2) as processes:
        for outcome in processes.run(squared, tasks()):
            done.append(outcome.task)  # noqa: PERF401  # what is taken next depends on it
    assert done == [0, 1, 2]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    """Even when it is killed in the middle of a task."""
    file = tmp_path / "pid"
    code = (
        "from gcs_bridge.executors.processes import Processes\n"
        "from tests.helpers.worked import begin_and_wait\n"
        f"list(Processes(1).run(begin_and_wait, [{str(file)!r}]))"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) as parent:
        wait_for(file)
        parent.kill()
    wait_until_gone(int(file.read_text()))


@pytest.mark.slow
def test_leaving_waits_for_nothing(tmp_path: Path) -> None:
    """As on Ctrl-C: what is still at work is ended."""
    file = tmp_path / "pid"
    with Processes(2) as processes:
        done = processes.run(begin_or_square, [str(file), "3"])
        assert next(done).result == 9
        wait_for(file)
        pids = processes.pids
    assert not any(map(is_there, pids))
