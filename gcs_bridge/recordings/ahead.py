"""Scans a recording in another thread, one piece ahead of whoever uses what it holds.

Kernels hold no lock of Python's, so the scan takes no time where there is a second core. What comes out is what a plain
loop gives, in its order; two pieces are in memory at most. Who judges may give that thread some of its own work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from queue import SimpleQueue
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from gcs_bridge.chunks import Chunk
from gcs_bridge.mavlink.scanner import Scanned, Scanner

if TYPE_CHECKING:
    from gcs_bridge.judging.rating import Beside

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


def ahead(items: Iterator[T], other: Beside | None = None) -> Iterator[T]:
    """The same items; while one is used, the next is made in another thread, `other` if there is one already."""
    another = partial(next, items, None)
    with other_thread() if other is None else nullcontext(other) as begin:
        coming = begin(another)
        while (item := coming()) is not None:
            coming = begin(another)
            yield item


@contextmanager
def other_thread() -> Iterator[Beside]:
    """One that does what it is given, one thing after the other; who asks for what it has not begun does that himself.

    So two threads share the work, whoever has less of it, and none waits for what nobody does. It is one for all pieces
    of a recording: each new thread may take memory from another place, and what it gives back stays there. Python's own
    pool of threads does as much; to load it takes 16 ms, a twelfth of what is loaded here in all.
    """
    tasks: SimpleQueue[_Task[Any] | None] = SimpleQueue()
    thread = Thread(target=_work_off, args=(tasks,))
    try:
        thread.start()
    except RuntimeError:  # no thread can be had
        yield _put_off
        return

    def begin(make: Callable[[], T]) -> Callable[[], T]:
        task = _Task(make)
        tasks.put(task)
        return task.result

    try:
        yield begin
    finally:
        tasks.put(None)
        thread.join()


def _put_off(make: Callable[[], T]) -> Callable[[], T]:
    """Begin nothing: who asks does it."""
    return make


def _work_off(tasks: SimpleQueue[_Task[Any] | None]) -> None:
    while (task := tasks.get()) is not None:
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
