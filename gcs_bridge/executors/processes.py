"""An executor on this machine's cores.

Each worker is a pool of one process: the standard library's pool gives up all its tasks when one of its processes dies.
Workers begin as fresh interpreters, on every system alike, and end when the process that started them has ended.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.context import SpawnContext, SpawnProcess
from threading import Thread
from types import TracebackType
from typing import Any, NamedTuple, TypeVar

from gcs_bridge.errors import UsageError
from gcs_bridge.executors.base import Outcome
from gcs_bridge.jit.preparation import let_others_tell

__all__ = ["Processes"]

TaskT = TypeVar("TaskT")
ResultT = TypeVar("ResultT")
_MOST_TASKS = 500  # of a process: what libraries keep for good goes with it
_MOST_ENDED = 4  # processes, before one did a task: then none ever will
_BY_ITSELF = "ended by itself"
_MOST_MEMORY = 2**30  # bytes that a process has held at once: what it keeps of that goes with it, too


class Processes:
    """An `Executor` with so many processes, which begin as there is work for them."""

    def __init__(self, workers: int, *, most_tasks: int = _MOST_TASKS, most_memory: int = _MOST_MEMORY) -> None:
        """A process is replaced after `most_tasks`, and once it has held more than `most_memory` bytes."""
        self._can_begin, self._ended = False, 0
        self._workers = [_Worker(most_tasks, most_memory, tells=not number) for number in range(workers)]

    @property
    def workers(self) -> int:
        """How many tasks are worked on at a time."""
        return len(self._workers)

    @property
    def pids(self) -> list[int]:
        """Of the processes that there are now."""
        return [pid for worker in self._workers if (pid := worker.pid) is not None]

    def run(self, work: Callable[[TaskT], ResultT], tasks: Iterable[TaskT | None]) -> Iterator[Outcome[TaskT, ResultT]]:
        """As of an `Executor`."""
        waiting, out = iter(tasks), dict[Future[_Done], tuple[_Worker, TaskT]]()
        idle = list(reversed(self._workers))

        def hand_out() -> None:
            while idle and (task := next(waiting, None)) is not None:
                worker = idle.pop()
                out[worker.submit(work, task)] = worker, task

        hand_out()
        while out:
            done, _ = wait(out, return_when=FIRST_COMPLETED)
            ended = [(*out.pop(future), future) for future in done]
            idle += [worker for worker, _, _ in ended]
            outcomes: list[Outcome[TaskT, ResultT]] = [worker.outcome(task, future) for worker, task, future in ended]
            self._look_at(outcomes)
            hand_out()  # before anybody looks at what was done, so that nobody waits for that
            yield from outcomes
            hand_out()  # what was waited for may be done now

    def _look_at(self, outcomes: Sequence[Outcome[Any, Any]]) -> None:
        """UsageError where no process can begin, as not a task was done, and several ended by themselves."""
        self._can_begin |= any(outcome.lost is None for outcome in outcomes)
        self._ended += sum(outcome.lost is not None and _BY_ITSELF in outcome.lost for outcome in outcomes)
        if not self._can_begin and self._ended > _MOST_ENDED:
            raise UsageError(
                f"worker processes cannot begin: {self._ended} of them {_BY_ITSELF} before a task was done"
            )

    def __enter__(self) -> Processes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave no process behind."""
        for worker in self._workers:
            worker.end()


class _Done(NamedTuple):
    """What a process gives back."""

    result: Any
    held: int  # bytes of memory that the process has held at once


class _Context(SpawnContext):
    """Starts processes as fresh interpreters, and knows the last one."""

    def __init__(self) -> None:
        super().__init__()
        self.process: SpawnProcess | None = None

    def Process(  # type: ignore[override]  # noqa: N802  # multiprocessing has a class of that name there, and calls it
        self, *args: Any, **kwargs: Any
    ) -> SpawnProcess:
        """Make one."""
        self.process = SpawnProcess(*args, **kwargs)
        return self.process


class _Worker:
    """A process that does one task after the other; a new one takes its place when it has done many, or died."""

    def __init__(self, most_tasks: int, most_memory: int, *, tells: bool) -> None:
        self._most_tasks, self._most_memory, self._tells = most_tasks, most_memory, tells
        self._context = _Context()
        self._pool: ProcessPoolExecutor | None = None
        self._tasks = 0
        self._is_at_work = False

    @property
    def pid(self) -> int | None:
        process = self._context.process
        return None if self._pool is None or process is None else process.pid

    def submit(self, work: Callable[[TaskT], ResultT], task: TaskT) -> Future[_Done]:
        if self._pool is None:
            self._pool, self._tasks = ProcessPoolExecutor(1, self._context, _begin, (self._tells,)), 0
        self._tasks += 1
        self._is_at_work = True
        return self._pool.submit(_do, work, task)

    def outcome(self, task: TaskT, future: Future[_Done]) -> Outcome[TaskT, Any]:
        self._is_at_work = False
        try:
            done = future.result()
        except BrokenProcessPool:
            self.end()
            return Outcome(task, None, lost=self._how_it_ended())
        if self._tasks >= self._most_tasks or done.held > self._most_memory:
            self.end()
        return Outcome(task, done.result)

    def end(self) -> None:
        """End its process, at once if it is at work."""
        if self._pool is None:
            return
        process = self._context.process
        if self._is_at_work and process is not None:
            process.kill()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = None

    def _how_it_ended(self) -> str:
        process = self._context.process
        code = None if process is None else process.exitcode
        if code is None or code >= 0:
            return f"its worker process {_BY_ITSELF} (exit code {code})"
        name = signal.Signals(-code).name
        why = ": was there too little memory?" if name == "SIGKILL" else ""
        return f"its worker process was ended by {name}{why}"


def _begin(tells: bool) -> None:
    """Of a new process: Ctrl-C is its parent's to obey, and where the parent ends it has nothing left to do.

    Of all that begin one `tells` that kernels are compiled.
    """
    if not tells:
        let_others_tell()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(work: Callable[[Any], Any], task: Any) -> _Done:
    if not gc.get_freeze_count():
        gc.freeze()  # what `work` imported stays: looking for garbage in it again and again takes a tenth of the time
    return _Done(work(task), _held())


def _held() -> int:
    """How many bytes of memory this process has held at once; 0 where that is not told."""
    if sys.platform == "win32":
        return 0
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024
