"""Whether bytes look like MAVLink, told without any table, and before anything that takes long to load.

For who is offered files of every kind. What it does not know may still be MAVLink, badly damaged: the scan tells.
"""

from __future__ import annotations

__all__ = ["frame_end", "holds", "looks_like_mavlink"]

_MAGICS = (0xFE, 0xFD)
_RECORD_TIME = 8  # bytes before each frame of a .tlog: microseconds since 1970, big-endian
_LATEST_US = 1 << 52  # of the year 2112: other bytes before a frame are no time
_IN_A_ROW = 3  # frames one behind the other, each with a checksum that holds
_MOST_TRIED = 50  # so many rows are summed, however many bytes there are that might begin one


def looks_like_mavlink(data: bytes) -> bool:
    """Whether a few frames lie one behind the other in `data`: with a record's time before each of them, or bare."""
    tried = 0
    for at in range(len(data)):
        if data[at] not in _MAGICS:
            continue
        for apart in (_RECORD_TIME, 0):
            if row := _row(data, at, apart):
                tried += 1
                if all(holds(data, begin, end) for begin, end in row):
                    return True
        if tried >= _MOST_TRIED:
            return False
    return False


def _row(data: bytes, at: int, apart: int) -> list[tuple[int, int]]:
    """Where frames begin and end, if from `at` on several may lie in a row, so many bytes apart."""
    row: list[tuple[int, int]] = []
    while len(row) < _IN_A_ROW:
        if apart and not 0 < int.from_bytes(data[max(at - apart, 0) : at], "big") < _LATEST_US:
            return []
        end = frame_end(data, at)
        if end is None:
            return []
        row.append((at, end))
        at = end + apart
    return row


def frame_end(data: bytes, at: int) -> int | None:
    """Where a frame of either version ends that begins at `at`; None: there is none, or not all of it."""
    if at + 3 > len(data) or data[at] not in _MAGICS:
        return None
    size = 8 if data[at] == 0xFE else 25 if data[at + 2] & 1 else 12
    end = at + size + data[at + 1]
    return end if end <= len(data) else None


def holds(data: bytes, at: int, end: int) -> bool:
    """Whether its checksum holds for some message: each adds a byte of its own, so of others one in 256 does."""
    signed = data[at] == 0xFD and data[at + 2] & 1
    stop = end - (15 if signed else 2)
    crc = 0xFFFF
    for byte in data[at + 1 : stop]:
        crc = _summed(crc, byte)
    said = int.from_bytes(data[stop : stop + 2], "little")
    return any(_summed(crc, extra) == said for extra in range(256))


def _summed(crc: int, byte: int) -> int:
    """The checksum with one more byte (CRC-16/MCRF4XX)."""
    mixed = byte ^ (crc & 0xFF)
    mixed ^= (mixed << 4) & 0xFF
    return (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
