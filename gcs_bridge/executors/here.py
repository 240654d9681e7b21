"""An executor that is this process: one task after the other, and nothing travels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import TypeVar

from gcs_bridge.executors.base import Outcome

__all__ = ["Here"]

TaskT = TypeVar("TaskT")
ResultT = TypeVar("ResultT")


class Here:
    """An `Executor` for what no other process may have."""

    workers = 1

    def run(self, work: Callable[[TaskT], ResultT], tasks: Iterable[TaskT | None]) -> Iterator[Outcome[TaskT, ResultT]]:
        """As of an `Executor`."""
        return (Outcome(task, work(task)) for task in tasks if task is not None)

    def __enter__(self) -> Here:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """There is nothing to end."""
