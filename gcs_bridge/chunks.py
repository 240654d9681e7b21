"""Bytes on their way to a monitor: what live links and recordings both bring, and how frames lie in it."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

__all__ = ["Chunk", "Framing"]


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
