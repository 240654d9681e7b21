"""A Dask cluster: a real scheduler and real workers, and what is told where there is none."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge.errors import UsageError
from gcs_bridge.executors.cluster import Cluster
from gcs_bridge.survey.dataset import Dataset
from gcs_bridge.survey.task import Result
from tests.helpers.paths import FIXTURES, ROOT
from tests.helpers.surveyed import DIGEST, rows, surveyed_into

PATIENCE_S = 120
DATA = (FIXTURES / "d_tailsitter_tumble.tlog").read_bytes()


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, and how to get it."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"pip install 'gcs-bridge\[cluster\]'"):
        Cluster("tcp://127.0.0.1:8786")


class Running:
    """A scheduler and its workers, each a process of its own."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._told, self._stack = folder / "scheduler.json", stack
        self._folder = folder
        self.scheduler = self._start("scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", self._told)
        end_s = time.monotonic() + PATIENCE_S
        while not self._told.exists() or not self._told.read_text():
            assert time.monotonic() < end_s, "the scheduler does not begin"
            time.sleep(0.05)
        self.address: str = json.loads(self._told.read_text())["address"]

    def worker(self, path: Path = ROOT) -> "subprocess.Popen[bytes]":
        """One more worker, without a nanny that would start another in its place; `path`: of what it may import."""
        options = ("--scheduler-file", self._told, "--nthreads", "1", "--no-nanny", "--no-dashboard")
        return self._start("worker", *options, path=path)

    def _start(self, what: str, *options: Any, path: Path = ROOT) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "dask", what, "--host", "127.0.0.1", *map(str, options)]
        if what == "worker":
            command += ["--local-directory", str(self._folder)]
        environment = {**os.environ, "PYTHONPATH": str(path)}
        quiet = subprocess.DEVNULL
        started = self._stack.enter_context(
            subprocess.Popen(command, cwd=self._folder, env=environment, stdout=quiet, stderr=quiet)
        )
        self._stack.callback(started.kill)
        return started


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Running]:
    """A scheduler without workers."""
    pytest.importorskip("distributed", reason="the cluster extra installs it")
    with ExitStack() as stack:
        yield Running(tmp_path, stack)


@pytest.mark.slow
@pytest.mark.sweep
def test_a_worker_that_is_killed_costs_no_recording(cluster: Running, tmp_path: Path) -> None:
    """Two workers; one is killed in the middle. All is judged, as one process judges it."""
    logs = tmp_path / "logs"
    logs.mkdir()
    for number in range(24):
        (logs / f"{number:02d}.tlog").write_bytes(DATA[:-1] + bytes([number]))
    workers = [cluster.worker(), cluster.worker()]
    left = [3]

    class Watched(Dataset):
        def add(self, result: Result) -> bool:
            left[0] -= 1
            if not left[0]:
                workers[0].send_signal(signal.SIGKILL)
            return super().add(result)

    with Cluster(cluster.address, patience_s=PATIENCE_S) as executor, Watched(tmp_path / "out", "1", DIGEST) as dataset:
        executor._client.wait_for_workers(2, timeout=PATIENCE_S)
        ran = surveyed_into(dataset, [logs], executor=executor)
    assert (ran.judged, ran.failures) == (24, [])
    assert workers[0].wait(PATIENCE_S) == -signal.SIGKILL
    with Dataset(tmp_path / "alone", "1", DIGEST) as dataset:
        surveyed_into(dataset, [logs])
    for table in ("recordings", "checks", "alarms"):
        key = ("path", "sysid", "check")
        both = [
            sorted(rows(tmp_path / name, table), key=lambda row: [str(row.get(one)) for one in key])
            for name in ("out", "alone")
        ]
        assert both[0] == both[1]


@pytest.mark.slow
def test_a_scheduler_without_workers(cluster: Running) -> None:
    """It is told, after a time that is bounded."""
    with pytest.raises(UsageError, match="it has no workers"):
        Cluster(cluster.address, patience_s=0.5)


@pytest.mark.slow
def test_a_scheduler_that_is_not_there() -> None:
    """It is told what answers, and how to start one."""
    pytest.importorskip("distributed", reason="the cluster extra installs it")
    with socket.socket() as silent:  # it has a port, and listens to nobody
        silent.bind(("127.0.0.1", 0))
        with pytest.raises(UsageError, match="no Dask scheduler answers there"):
            Cluster(f"tcp://127.0.0.1:{silent.getsockname()[1]}", patience_s=0.5)
    with pytest.raises(UsageError, match="no Dask scheduler answers there"):
        Cluster("nonsense://", patience_s=0.5)


@pytest.mark.slow
@pytest.mark.sweep
def test_a_scheduler_that_goes(cluster: Running, tmp_path: Path) -> None:
    """What was judged is kept, and the survey ends."""
    logs = tmp_path / "logs"
    logs.mkdir()
    for number in range(12):
        (logs / f"{number:02d}.tlog").write_bytes(DATA[:-1] + bytes([number]))
    worker = cluster.worker()

    class Watched(Dataset):
        def add(self, result: Result) -> bool:
            if len(self) == 2:
                worker.kill()
                cluster.scheduler.kill()
            return super().add(result)

    dataset = Watched(tmp_path / "out", "1", DIGEST)
    with (
        pytest.raises(UsageError, match=r"has gone|have gone"),
        dataset,
        Cluster(cluster.address, alone_s=1) as executor,
    ):
        surveyed_into(dataset, [logs], executor=executor)
    assert 0 < len(rows(tmp_path / "out", "recordings")) < 12


@pytest.mark.slow
def test_workers_that_cannot_judge(cluster: Running, tmp_path: Path) -> None:
    """Where they have no gcs-bridge it is told, not tried a thousand times."""
    (tmp_path / "sitecustomize.py").write_text("import sys; sys.modules['gcs_bridge'] = None")
    cluster.worker(path=tmp_path)
    with pytest.raises(UsageError, match=r"tcp://.* has no gcs-bridge .*: install .* there, as here"):
        Cluster(cluster.address, patience_s=PATIENCE_S)
