"""Make a long .tlog out of a short one: a real flight, flown over and over on one running clock.

Every copy of the flight goes on where the one before ended: record times, the messages' own times and the sequence
numbers, and the checksums are made anew. Nothing is random: equal arguments make equal files. Uses pymavlink's tables
and nothing of gcs_bridge, so that a mistake there cannot hide itself here.

    python -m benchmarks.make_recording long.tlog --megabytes 20
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from struct import calcsize
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import all as mavlink

from benchmarks import COMPARED

Bytes = npt.NDArray[np.uint8]
Ints = npt.NDArray[np.int64]

FLIGHT = Path(__file__).parents[1] / "sitl_fixtures" / "b_copter_acro.tlog"
MEGABYTE = 1_000_000

STAMP_BYTES, HEADER_BYTES, CRC_BYTES = 8, 10, 2
# The ground station's sticks and set points are left out: without them 3/4 of the messages are COMPARED ones.
LEFT_OUT = ("RC_CHANNELS_OVERRIDE", "SET_POSITION_TARGET_LOCAL_NED")
# The clocks of a message: name → counts in a second.
CLOCKS = {"time_boot_ms": 1_000, "time_usec": 1_000_000, "time_unix_usec": 1_000_000}
PERIOD_MS = 20  # of the flight's attitude: from a copy's last message to the next one's first
COPIES_AT_ONCE = 16  # bounds the memory


@dataclass(frozen=True)
class Record:
    """One record of the flight: its time, µs, and its unsigned MAVLink 2 frame."""

    t_us: int
    frame: bytes

    @property
    def message(self) -> Any:
        """The class that pymavlink has for it."""
        return mavlink.mavlink_map[int.from_bytes(self.frame[7:10], "little")]

    def clocks(self) -> list[tuple[int, int, int]]:
        """(offset in the payload, bytes, counts in a second) of each clock in the message."""
        found = []
        at = 0
        kinds = dict(zip(self.message.fieldnames, self.message.fieldtypes, strict=True))
        for name, count in zip(self.message.ordered_fieldnames, self.message.array_lengths, strict=True):
            size = _SIZES[kinds[name]]
            if name in CLOCKS:
                found.append((at, size, CLOCKS[name]))
            at += size * max(count, 1)
        return found

    def with_whole_clocks(self) -> Record:
        """The same, where a clock's upper zeros were cut off with them: later times need the room."""
        length = max([self.frame[1], *(at + size for at, size, _ in self.clocks())])
        payload = self.frame[HEADER_BYTES:-CRC_BYTES].ljust(length, b"\0")
        return Record(self.t_us, bytes([self.frame[0], length]) + self.frame[2:HEADER_BYTES] + payload + b"\0\0")


_SIZES = {
    kind: calcsize(code)
    for kind, code in {
        "char": "c", "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I",
        "int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d",
    }.items()
}  # fmt: skip


def records(data: bytes) -> list[Record]:
    """The records of an undamaged recording of unsigned MAVLink 2, one behind the other to the last byte."""
    found = []
    at = 0
    while at < len(data):
        if data[at + STAMP_BYTES] != 0xFD or data[at + STAMP_BYTES + 2]:
            raise ValueError(f"byte {at}: not a record of unsigned MAVLink 2")
        end = at + STAMP_BYTES + HEADER_BYTES + data[at + STAMP_BYTES + 1] + CRC_BYTES
        found.append(Record(int.from_bytes(data[at : at + STAMP_BYTES], "big"), data[at + STAMP_BYTES : end]))
        at = end
    return found


class Loop:
    """One flight as an array of bytes, and where in it stands what changes from copy to copy."""

    def __init__(self, flight: list[Record]) -> None:
        flight = [record.with_whole_clocks() for record in flight]
        parts = [record.t_us.to_bytes(STAMP_BYTES, "big") + record.frame for record in flight]
        self.bytes: Bytes = np.frombuffer(b"".join(parts), np.uint8)
        self.ends: Ints = np.cumsum([len(part) for part in parts])
        self.frames: Ints = np.concatenate(([0], self.ends[:-1])) + STAMP_BYTES
        self.lengths: Ints = np.array([record.frame[1] for record in flight])
        self.crc_extra = np.array([record.message.crc_extra for record in flight], np.uint16)

        clocks = [
            (start + HEADER_BYTES + at, size, counts_per_s)
            for start, record in zip(self.frames.tolist(), flight, strict=True)
            for at, size, counts_per_s in record.clocks()
        ]
        attitudes = [n for n, record in enumerate(flight) if record.message.msgname == "ATTITUDE"]
        boot_ms = self._numbers(self.frames[attitudes] + HEADER_BYTES, 4)  # its time_boot_ms comes first
        t_us = np.array([record.t_us for record in flight])
        self.shift_ms = int(max(np.ptp(boot_ms), np.ptp(t_us) // 1000 + 1)) + PERIOD_MS
        # (place, bytes, step from copy to copy): the least significant byte stands first.
        self.clocks = [
            (np.array([at for at, *kind in clocks if kind == [size, rate]]), size, self.shift_ms * rate // 1000)
            for size, rate in sorted({(size, rate) for _, size, rate in clocks})
        ]

        sender = self.bytes[self.frames + 5].astype(np.int64) * 256 + self.bytes[self.frames + 6]
        self.sent: Ints = np.empty(len(flight), np.int64)  # sequence number within the copy
        self.sent_in_all: Ints = np.empty(len(flight), np.int64)  # by the same sender, a copy
        for key in np.unique(sender):
            mine = sender == key
            self.sent[mine] = np.arange(mine.sum())
            self.sent_in_all[mine] = mine.sum()

    def copies(self, first: int, count: int) -> Bytes:
        """Copies number `first` and on, (count, bytes)."""
        number = np.arange(first, first + count)[:, None]
        out = np.tile(self.bytes, (count, 1))
        stamps = self._numbers(self.frames - 1, STAMP_BYTES, -1) + number * self.shift_ms * 1000
        self._write(out, self.frames - 1, stamps, STAMP_BYTES, -1)
        for places, size, step in self.clocks:
            self._write(out, places, self._numbers(places, size) + number * step, size)
        self._write(out, self.frames + 4, self.sent + number * self.sent_in_all, 1)
        self.seal(out)
        return out

    def seal(self, out: Bytes) -> None:
        """Make the checksums of copies anew."""
        self._write(out, self.ends - CRC_BYTES, self._checksums(out).astype(np.int64), CRC_BYTES)

    def _numbers(self, places: Ints, size: int, towards: int = 1) -> Ints:
        """The whole numbers whose least significant byte is at `places`."""
        numbers = np.zeros(len(places), np.int64)
        for i in range(size):
            numbers |= self.bytes[places + towards * i].astype(np.int64) << (8 * i)
        return numbers

    @staticmethod
    def _write(out: Bytes, places: Ints, numbers: Ints, size: int, towards: int = 1) -> None:
        for i in range(size):
            out[:, places + towards * i] = numbers >> (8 * i)

    def _checksums(self, out: Bytes) -> npt.NDArray[np.uint16]:
        """CRC-16/MCRF4XX of each frame without its magic byte, then CRC_EXTRA: one byte of all frames at a time."""
        order = np.argsort(-self.lengths)  # so that the frames that have a further byte are the first ones
        begins, sizes = self.frames[order] + 1, HEADER_BYTES - 1 + self.lengths[order]
        crc = np.full((len(out), len(order)), 0xFFFF, np.uint16)
        for i in range(int(sizes[0])):
            n = int(np.searchsorted(-sizes, -i))
            crc[:, :n] = _crc_step(crc[:, :n], out[:, begins[:n] + i])
        unsorted = np.empty_like(crc)
        unsorted[:, order] = _crc_step(crc, self.crc_extra[order])
        return unsorted


def _crc_step(crc: npt.NDArray[np.uint16], byte: npt.NDArray[Any]) -> npt.NDArray[np.uint16]:
    stepped: npt.NDArray[np.uint16] = (crc >> 8) ^ _CRC_TABLE[(crc ^ byte) & 0xFF]
    return stepped


def _crc_table() -> npt.NDArray[np.uint16]:
    """MAVLink's checksum, a byte at a time (mavlink.io, guide/serialization.html#checksum)."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 1, (table >> 1) ^ np.uint16(0x8408), table >> 1).astype(np.uint16)
    return table


_CRC_TABLE = _crc_table()


def write_recording(out: BinaryIO, size: int, flight: Path = FLIGHT) -> Counter[str]:
    """Write as many whole records as fit into `size` bytes; returns how many of each message."""
    flown = [record for record in records(flight.read_bytes()) if record.message.msgname not in LEFT_OUT]
    loop = Loop(flown)
    one = len(loop.bytes)
    whole, rest = divmod(size, one)
    firsts = range(0, whole, COPIES_AT_ONCE)
    out.writelines(loop.copies(first, min(COPIES_AT_ONCE, whole - first)).data for first in firsts)
    n = int(np.searchsorted(loop.ends, rest, side="right"))
    out.write(loop.copies(whole, 1)[0, : loop.ends[n - 1] if n else 0].tobytes())
    names = [record.message.msgname for record in flown]
    return Counter({name: count * whole for name, count in Counter(names).items()}) + Counter(names[:n])


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Make a long .tlog out of a short flight.")
    parser.add_argument("out", type=Path)
    parser.add_argument("--megabytes", type=float, default=20.0, help="size, in 1,000,000 bytes  [20]")
    arguments = parser.parse_args(argv)
    with arguments.out.open("wb") as out:
        counts = write_recording(out, round(arguments.megabytes * MEGABYTE))
    print(f"{arguments.out}: {counts.total()} messages, {arguments.out.stat().st_size / MEGABYTE:.1f} MB; of them")
    print(*(f"{name}={counts[name]}" for name in COMPARED))
    return 0


if __name__ == "__main__":
    sys.exit(main())
