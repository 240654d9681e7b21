"""Copters in the air together on one link: each of them flies `b_copter_acro`, over and over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks import COMPARED
from benchmarks.make_recording import (
    FLIGHT,
    HEADER_BYTES,
    STAMP_BYTES,
    Bytes,
    Ints,
    Loop,
    Record,
    records,
)

__all__ = ["PER_S", "Excursions", "Fleet", "Flight", "boot_ms"]
NEEDED = (*COMPARED, "HEARTBEAT", "AHRS2")  # by the checks
PER_S = 155.3  # of these, by each vehicle as it was flown
FLIGHT_S = 41.0  # once, or a little less
_BEHIND_US = 20_000  # by less than this the last vehicle is behind the first
_ROLLSPEED = HEADER_BYTES + 16  # where it is in an ATTITUDE


@dataclass(frozen=True)
class Excursions:
    """Body rates that disagree: of each `each_ms` of the vehicle's time the first `lasts_ms`, of the first vehicles."""

    each_ms: int
    lasts_ms: int
    vehicles: int
    by_rad_s: float = 0.6


class Flight(NamedTuple):
    """Frames of one or more vehicles in the order in which they are sent, and when each is due, µs from the start."""

    data: Bytes
    ends: Ints
    due_us: Ints


class Fleet:
    """So many vehicles, of systems 1 and on; each flight is one of their `copies`."""

    def __init__(self, vehicles: int, excursions: Excursions | None = None, also: tuple[str, ...] = ()) -> None:
        """Read what was flown: the messages that checks need, and others."""
        names = (*NEEDED, *also)
        flown = [one for one in records(FLIGHT.read_bytes()) if one.message.msgname in names and one.frame[5] == 1]
        self._loops = [
            Loop([Record(one.t_us, one.frame[:5] + bytes([1 + number]) + one.frame[6:]) for one in flown])
            for number in range(vehicles)
        ]
        self._attitudes = self._loops[0].frames[[one.message.msgname == "ATTITUDE" for one in flown]]
        self._excursions = excursions

    def copies(self, first: int, count: int) -> Flight:
        """So many flights of every vehicle, from number `first` on, one vehicle a little behind the other."""
        parts = [self._of(number, first, count) for number in range(len(self._loops))]
        data, sizes, due_us = (np.concatenate(several) for several in zip(*parts, strict=True))
        order = np.argsort(due_us, kind="stable")
        starts, sizes = (np.cumsum(sizes) - sizes)[order], sizes[order]
        ends = np.cumsum(sizes)
        return Flight(data[np.arange(ends[-1]) + np.repeat(starts - ends + sizes, sizes)], ends, due_us[order])

    def first(self, count: float) -> Flight:
        """The first so many frames, or some more."""
        seconds = count / (len(self._loops) * PER_S)
        flight = self.copies(0, int(seconds / FLIGHT_S) + 1)
        n = int(np.searchsorted(flight.due_us, seconds * 1e6))
        return Flight(flight.data[: flight.ends[n - 1]], flight.ends[:n], flight.due_us[:n])

    def _of(self, number: int, first: int, count: int) -> tuple[Bytes, Ints, Ints]:
        """A vehicle's frames one behind the other, their sizes, and when each is due, µs."""
        loop, wrong = self._loops[number], self._excursions
        out = loop.copies(first, count)
        if wrong is not None and number < wrong.vehicles:
            for copy in out:
                is_bad = boot_ms(copy, self._attitudes) % wrong.each_ms < wrong.lasts_ms
                places = self._attitudes[is_bad] + _ROLLSPEED
                raised = _four(copy, places).view("<f4") + np.float32(wrong.by_rad_s)
                copy[places[:, None] + np.arange(4)] = raised.view(np.uint8)
            loop.seal(out)
        sizes = loop.ends - loop.frames
        kept = np.concatenate([np.arange(end - size, end) for end, size in zip(loop.ends, sizes, strict=True)])
        due_us = _stamps_us(out, loop).ravel() - _stamps_us(loop.bytes[None], loop)[0, 0]
        return out[:, kept].ravel(), np.tile(sizes, count), due_us + number * _BEHIND_US // len(self._loops)


def boot_ms(data: Bytes, frames: Ints) -> Ints:
    """The time in attitude messages that start at these places."""
    return _four(data, frames + HEADER_BYTES).view("<u4")[:, 0].astype(np.int64)


def _stamps_us(out: Bytes, loop: Loop) -> Ints:
    stamps = np.stack([out[:, loop.frames - STAMP_BYTES + i] for i in range(STAMP_BYTES)], axis=-1)
    return stamps.view(">i8")[..., 0].astype(np.int64)


def _four(data: Bytes, places: Ints) -> Bytes:
    return np.asarray(data[places[:, None] + np.arange(4)])
