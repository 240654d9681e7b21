"""Scans a recording in another thread, one piece ahead of whoever uses what it holds.

Kernels hold no lock of Python's, so the scan takes no time where there is a second core. What comes out is what a plain
loop gives, in its order; two pieces are in memory at most. Who judges may give that thread some of its own work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from functools import partial
from queue import SimpleQueue
from threading import Lock, Thread
from types import TracebackType
from typing import Any, Generic, TypeVar

from gcs_bridge.chunks import Chunk
from gcs_bridge.mavlink.scanner import Scanned, Scanner

T = TypeVar("T")


def scanned_ahead(chunks: Iterable[Chunk], scanner: Scanner) -> Iterator[Scanned]:
    """A recording's chunks, scanned to its end, each while the one before is used."""
    return ahead(scanned(chunks, scanner))


def scanned(chunks: Iterable[Chunk], scanner: Scanner) -> Iterator[Scanned]:
    """A recording's chunks, scanned to its end."""
    for chunk in chunks:
        frames = scanner.scan(chunk.data)
        yield Scanned(scanner.buffer, frames, scanner.read)
    frames = scanner.scan(b"", final=True)
    yield Scanned(scanner.buffer, frames, scanner.read)


def ahead(items: Iterator[T], other: OtherThread | None = None) -> Iterator[T]:
    """The same items; while one is used, the next is made in another thread: `other`, behind what comes first there."""
    another = partial(next, items, None)
    with OtherThread() if other is None else nullcontext(other) as thread:
        begin = thread if other is None else thread.later
        coming = begin(another)
        while (item := coming()) is not None:
            coming = begin(another)
            yield item


class OtherThread:
    """Does what it is given, one thing after the other, until it is closed; who asks for what it has not begun does it.

    So two threads share the work, whoever has less of it, and none waits for what nobody does. It is one for all pieces
    of a recording: each new thread may take memory from another place, and what it gives back stays there.
    """

    def __init__(self) -> None:
        """Nothing is begun before there is something to do."""
        self._tasks: SimpleQueue[_Task[Any] | None] = SimpleQueue()
        self._later: _Task[Any] | None = None
        self._thread: Thread | None = None

    def __enter__(self) -> OtherThread:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait for what it still does."""
        if self._thread is not None:
            self._tasks.put(None)
            self._thread.join()

    def __call__(self, make: Callable[[], T]) -> Callable[[], T]:
        """Begin something; what comes back waits for its result, or raises what went wrong."""
        task = _Task(make)
        self._put(task)
        self.go_on()
        return task.result

    def later(self, make: Callable[[], T]) -> Callable[[], T]:
        """As a call, behind what it is given next: that is asked for sooner. One thing at a time can be put off so."""
        self._later = task = _Task(make)
        return task.result

    def go_on(self) -> None:
        """Begin what was put off: nothing comes that is asked for sooner."""
        task, self._later = self._later, None
        if task is not None:
            self._put(task)

    def _put(self, task: _Task[Any]) -> None:
        if self._thread is None:
            thread = Thread(target=self._run)
            try:
                thread.start()
            except RuntimeError:  # there can be none: who asks does it
                return
            self._thread = thread
        self._tasks.put(task)

    def _run(self) -> None:
        while (task := self._tasks.get()) is not None:
            task.run()
            del task  # what it made is its owner's alone


class _Task(Generic[T]):
    """What a function returns, while it is made."""

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._made: T
        self._error: BaseException | None = None
        self._begun, self._working = Lock(), Lock()
        self._working.acquire()

    def run(self) -> None:
        """Make it, unless somebody has begun to."""
        if not self._begun.acquire(blocking=False):
            return
        try:
            self._made = self._make()
        except BaseException as error:  # noqa: BLE001  # whatever it is, it is raised where the result is asked for
            self._error = error
        finally:
            self._working.release()

    def result(self) -> T:
        """Wait for it, or make it; what went wrong then is raised here."""
        self.run()
        with self._working:
            if self._error is not None:
                raise self._error
            return self._made
