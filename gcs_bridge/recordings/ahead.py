"""Scans a recording in a thread of its own, one piece ahead of whoever uses what it holds.

The scan holds no lock of Python's, so it takes no time where there is a second core. What comes out is what a plain
loop gives, in its order; two pieces are in memory at most.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from threading import Thread
from typing import Generic, TypeVar

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


def ahead(items: Iterator[T]) -> Iterator[T]:
    """The same items; while one is used, the next is made in another thread."""
    another = partial(next, items, None)
    coming = _Beside(another)
    try:
        while (item := coming.result()) is not None:
            coming = _Beside(another)
            yield item
    finally:
        coming.join()


def beside(make: Callable[[], T]) -> Callable[[], T]:
    """Begin something in another thread; what comes back waits for its result, or raises what went wrong."""
    return _Beside(make).result


class _Beside(Thread, Generic[T]):
    """What a function returns, while it is made. Python's pool of threads does as much, and takes longer to load."""

    def __init__(self, make: Callable[[], T]) -> None:
        """Begin."""
        super().__init__()
        self._make = make
        self._made: T
        self._error: BaseException | None = None
        self.start()

    def run(self) -> None:
        """Make it."""
        try:
            self._made = self._make()
        except BaseException as error:  # noqa: BLE001  # whatever it is, it is raised where the result is asked for
            self._error = error

    def result(self) -> T:
        """Wait for it; what went wrong when it was made is raised here."""
        self.join()
        if self._error is not None:
            raise self._error
        return self._made
