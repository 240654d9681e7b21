"""An executor on a Dask cluster that is there already: `dask scheduler` and `dask worker` start one.

What was out on a worker that died is given to another by the scheduler, some times (`allowed-failures`, 3).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
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
_LEAST_AHEAD, _MOST_AHEAD = 2, 4  # tasks for each thread of the workers: they are sent by the batch, as each costs
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
            try:
                self._client = Client(address, timeout=patience_s, set_as_default=False)
            except AssertionError:  # its loop has not begun within ten seconds: this machine is very busy
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
        # It goes as a name: what is not there cannot be called.
        versions = self._client.run(_version_there, on_error="return")
        for worker, there in versions.items():
            if there != __version__:
                raise self._other_version(worker, there)

    def _other_version(self, worker: str, there: object) -> UsageError:
        has = f"no gcs-bridge ({one_line(str(there))})" if isinstance(there, Exception) else f"gcs-bridge {there}"
        return UsageError(f"--scheduler {self._address}: {worker} has {has}: install {__version__} there, as here")

    @property
    def workers(self) -> int:
        """How many tasks are worked on at a time."""
        try:
            return sum(self._client.nthreads().values())
        except OSError:
            raise self._gone() from None

    def run(self, work: Callable[[TaskT], ResultT], tasks: Iterable[TaskT | None]) -> Iterator[Outcome[TaskT, ResultT]]:
        """As of an `Executor`."""
        waiting, out = iter(tasks), dict[Any, TaskT]()
        done: SimpleQueue[Any] = SimpleQueue()
        threads, looked_s = self.workers, time.monotonic()
        seen_s = looked_s

        def hand_out() -> None:
            workers = max(threads, 1)  # all may be gone for a moment
            if len(out) > _LEAST_AHEAD * workers:
                return
            batch: list[TaskT] = []
            while len(out) + len(batch) < _MOST_AHEAD * workers and (task := next(waiting, None)) is not None:
                batch.append(task)
            futures = self._client.map(work, batch, pure=False) if batch else []
            out.update(zip(futures, batch, strict=True))
            for future in futures:
                future.add_done_callback(done.put)

        hand_out()
        while out:
            if time.monotonic() - looked_s > _LOOK_AGAIN_S:  # workers come and go
                threads, looked_s = self.workers, time.monotonic()
                seen_s = looked_s if threads else seen_s
                if looked_s - seen_s > self._alone_s:
                    raise UsageError(f"--scheduler {self._address}: all its workers have gone")
            ended = _taken(done)
            if ended:
                outcomes: list[Outcome[TaskT, ResultT]] = self._outcomes([(out.pop(one), one) for one in ended])
                hand_out()
                yield from outcomes
            hand_out()

    def _outcomes(self, ended: Sequence[tuple[TaskT, Any]]) -> list[Outcome[TaskT, Any]]:
        """Of tasks that are done; the results come all at once."""
        from distributed import CancelledError, KilledWorker

        there = [future for _, future in ended if future.status == "finished"]
        outcomes: list[Outcome[TaskT, Any]] = []
        try:
            results = dict(zip(there, self._client.gather(there), strict=True))
            for task, future in ended:
                try:
                    outcomes.append(Outcome(task, results[future] if future in results else future.result()))
                except KilledWorker as error:
                    died = one_line(str(error)).partition(". ")[0]
                    outcomes.append(Outcome(task, None, lost=f"each worker that was at it died: {died}"))
        except ImportError as error:  # of a worker that came later
            raise self._other_version("one of its workers", error) from None
        except (CancelledError, OSError):
            raise self._gone() from None
        return outcomes

    def _gone(self) -> UsageError:
        return UsageError(f"--scheduler {self._address}: the scheduler has gone")

    def __enter__(self) -> Cluster:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the cluster go on without us: what is still out is cancelled with its client."""
        self._client.close(timeout=5)


def _taken(done: SimpleQueue[Any]) -> list[Any]:
    """All that is in it; what comes first is waited for, for a while."""
    taken: list[Any] = []
    with suppress(Empty):
        taken.append(done.get(timeout=_LOOK_AGAIN_S))
        while True:
            taken.append(done.get_nowait())
    return taken


def _version_there() -> str:
    """Of this package where it is called."""
    return __version__
