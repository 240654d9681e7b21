"""Scans a recording in a thread of its own, one piece ahead of whoever uses what it holds.

The scan holds no lock of Python's, so it takes no time where there is a second core. What comes out is what a plain
loop gives, in its order; two pieces are in memory at most.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import TypeVar

from gcs_bridge.beside import Beside
from gcs_bridge.chunks import Chunk
from gcs_bridge.mavlink.scanner import Scanned, Scanner

T = TypeVar("T")


def scanned_ahead(chunks: Iterable[Chunk], scanner: Scanner) -> Iterator[Scanned]:
    """A recording's chunks, scanned to its end."""
    return ahead(_scanned(chunks, scanner))


def _scanned(chunks: Iterable[Chunk], scanner: Scanner) -> Iterator[Scanned]:
    for chunk in chunks:
        frames = scanner.scan(chunk.data)
        yield Scanned(scanner.buffer, frames, scanner.read)
    frames = scanner.scan(b"", final=True)
    yield Scanned(scanner.buffer, frames, scanner.read)


def ahead(items: Iterator[T]) -> Iterator[T]:
    """The same items; while one is used, the next is made in another thread."""
    another = partial(next, items, None)
    coming = Beside(another)
    try:
        while (item := coming.result()) is not None:
            coming = Beside(another)
            yield item
    finally:
        coming.join()
