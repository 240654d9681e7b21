"""Bytes on their way to a monitor: what live links and recordings both bring, and how frames lie in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s

__all__ = ["Chunk", "Chunks", "Framing"]


class Framing(Enum):
    """What the borders of a chunk mean, and where its receive times are."""

    RECORDS = "records"  # of a .tlog, cut anywhere; each record brings its time
    STREAM = "stream"  # cut anywhere: what is cut off goes on in the next chunk
    DATAGRAM = "datagram"  # whole: nothing goes on in the next one


class Chunk(NamedTuple):
    """Bytes as they came; `t_rx_us` is µs since 1970, −1 where it is unknown or the records bring it."""

    data: bytes | bytearray | memoryview
    t_rx_us: int
    framing: Framing


@dataclass(frozen=True)
class Chunks:
    """Chunks of one link, one behind the other in `data` (n,); where each `ends` (chunks,), and its receive time, µs.

    Iterating them gives each as a `Chunk` of its own.
    """

    data: npt.NDArray[np.uint8]
    ends: Int64s
    t_rx_us: Int64s
    framing: Framing

    @classmethod
    def of(cls, chunks: Iterable[Chunk]) -> Chunks:
        """The same chunks in one piece of memory; there must be one at least, and all of one framing."""
        data, t_rx_us, framings = zip(*chunks, strict=True)
        ends = np.cumsum([len(one) for one in data])
        return cls(np.frombuffer(b"".join(data), np.uint8), ends, np.array(t_rx_us), framings[0])

    def __len__(self) -> int:
        return len(self.ends)

    def __iter__(self) -> Iterator[Chunk]:
        start = 0
        for end, t_rx_us in zip(self.ends.tolist(), self.t_rx_us.tolist(), strict=True):
            yield Chunk(self.data[start:end].tobytes(), t_rx_us, self.framing)
            start = end
