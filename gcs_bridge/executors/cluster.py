"""An executor on a Dask cluster that is there already: `dask scheduler` and `dask worker` start one.

What was out on a worker that died is given to another by the scheduler, some times (`allowed-failures`, 3).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, TypeVar

from gcs_bridge._version import __version__
from gcs_bridge.errors import UsageError, one_line
from gcs_bridge.executors.base import Outcome

__all__ = ["Cluster"]

TaskT = TypeVar("TaskT")
ResultT = TypeVar("ResultT")
_PATIENCE_S = 10.0  # for the scheduler to answer, and for a first worker
_ALONE_S = 60.0  # so long there may be no worker at all, as when all are replaced
_LOOK_AGAIN_S = 2.0
_AHEAD = 2  # tasks for each thread of the workers: while one is worked on, the next is on its way
_EXTRA = "pip install 'gcs-bridge[cluster]'"


class Cluster:
    """An `Executor` whose processes are those of a Dask cluster."""

    def __init__(self, address: str, *, patience_s: float = _PATIENCE_S, alone_s: float = _ALONE_S) -> None:
        """Connect to the scheduler at `address`; UsageError where it, its workers or this package there are not."""
        try:
            from distributed import Client
        except ImportError as error:
            raise UsageError(f"--scheduler needs Dask ({one_line(str(error))}): {_EXTRA}") from None
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong is told here, in one line
        self._address, self._alone_s = address, alone_s
        try:
            self._client = Client(address, timeout=patience_s, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:  # of an address that is none, too
            raise UsageError(
                f"--scheduler {one_line(address)}: no Dask scheduler answers there ({one_line(str(error))}): "
                "start one by `dask scheduler`, and workers by `dask worker`"
            ) from None
        try:
            self._look_at_workers(patience_s)
        except BaseException:
            self._client.close(timeout=1)
            raise

    def _look_at_workers(self, patience_s: float) -> None:
        from distributed import TimeoutError as TooLate

        try:
            self._client.wait_for_workers(1, timeout=patience_s)
        except TooLate:
            raise UsageError(
                f"--scheduler {self._address}: it has no workers: start some by `dask worker {self._address}`"
            ) from None
        versions = self._client.run(_version_there)  # pickled as a name: what is not there cannot be called
        for worker, there in versions.items():
            if there != __version__:
                raise UsageError(
                    f"--scheduler {self._address}: the worker {worker} has gcs-bridge {there}, not {__version__}"
                )

    @property
    def workers(self) -> int:
        """How many tasks are worked on at a time."""
        return sum(self._client.nthreads().values())

    def run(self, work: Callable[[TaskT], ResultT], tasks: Iterable[TaskT | None]) -> Iterator[Outcome[TaskT, ResultT]]:
        """As of an `Executor`."""
        waiting, out = iter(tasks), dict[Any, TaskT]()
        done: SimpleQueue[Any] = SimpleQueue()
        room, looked_s = self._room(), time.monotonic()

        def hand_out() -> None:
            while len(out) < room and (task := next(waiting, None)) is not None:
                future = self._client.submit(work, task, pure=False)
                out[future] = task
                future.add_done_callback(done.put)

        hand_out()
        seen_s = time.monotonic()
        while out:
            if time.monotonic() - looked_s > _LOOK_AGAIN_S:  # workers come and go
                room, looked_s = self._room(), time.monotonic()
                seen_s = looked_s if room else seen_s
                if looked_s - seen_s > self._alone_s:
                    raise UsageError(f"--scheduler {self._address}: all its workers have gone")
            try:
                future = done.get(timeout=_LOOK_AGAIN_S)
            except Empty:
                continue
            task = out.pop(future)
            hand_out()
            yield self._outcome(task, future)
            hand_out()

    def _room(self) -> int:
        return _AHEAD * self.workers

    def _outcome(self, task: TaskT, future: Any) -> Outcome[TaskT, Any]:
        from distributed import CancelledError, KilledWorker

        try:
            return Outcome(task, future.result())
        except KilledWorker as error:
            return Outcome(
                task, None, lost=f"each worker that was at it died: {one_line(str(error)).partition('. ')[0]}"
            )
        except (CancelledError, OSError):
            raise UsageError(f"--scheduler {self._address}: the scheduler has gone") from None

    def __enter__(self) -> Cluster:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the cluster go on without us: what is still out is cancelled with its client."""
        self._client.close(timeout=5)


def _version_there() -> str:
    """Of this package where it is called."""
    return __version__
