"""What an executor is: it takes tasks as it has room for them, and gives what came of each once that is done."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Generic, Protocol, TypeVar

__all__ = ["Executor", "Outcome", "cores"]

TaskT = TypeVar("TaskT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True)
class Outcome(Generic[TaskT, ResultT]):
    """What came of a task: `result`, or None and in one line why its worker was `lost`."""

    task: TaskT
    result: ResultT | None
    lost: str | None = None


class Executor(Protocol):
    """Runs functions that can be imported on tasks that can be pickled, in other processes, at most some at a time.

    A worker that dies costs the task that it was at, and no other. What such a function raises is raised here: it is a
    mistake of ours, as what can go wrong is part of its result.
    """

    @property
    def workers(self) -> int:
        """How many tasks are worked on at a time."""

    def run(self, work: Callable[[TaskT], ResultT], tasks: Iterable[TaskT | None]) -> Iterator[Outcome[TaskT, ResultT]]:
        """What comes of each task, in the order in which they are done.

        The next task is taken when there is room for it. None among them says that there is none before another of
        those that are out is done.
        """

    def __enter__(self) -> Executor: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave no process behind, and wait for nothing that is still worked on."""


def cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
