"""Who sends what on a link: every message of every component, how often and how evenly it comes, signed or not.

Every whole frame counts, copies too, as on the wire; how often a message comes, without copies. Receive times are the
link's, as they are: what a recorder stamped at once came at once. What is in the messages is looked at as far as it
tells of the sender: its firmware, its clock, and whom it asks for rates.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s, Mask
from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.mavlink.scanner import Scanner
from gcs_bridge.mavlink.signing import Outcome, Outcomes
from gcs_bridge.telemetry.asks import ASKS, Ask, asks_in
from gcs_bridge.telemetry.link_clock import SET_BACK_US
from gcs_bridge.telemetry.numbering import Numbering
from gcs_bridge.telemetry.statements import text_of
from gcs_bridge.telemetry.stream_counts import SILENCE_US, US_PER_S

__all__ = ["Census", "ComponentSeen", "MessageSeen", "UtcSaid"]
_LEAST_US = 500_000  # what came within less, as the answers to a request do, has no rate
_MOST_UNKNOWN = 200  # messages of one sender, from which on those of unknown ids are not told apart any more
_MOST_ASKS = 1000  # wishes that are told apart
_YEAR_2100_US = 4_102_444_800_000_000
_FIRMWARE = re.compile(
    r"(?:Ardu\w+|APM:\w+|Rover|Blimp|AntennaTracker) V(\d[\w.+-]{0,30})", re.ASCII
)  # of a STATUSTEXT
_RELEASES = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc"}  # FIRMWARE_VERSION_TYPE; 255: official


class MessageSeen(NamedTuple):
    """What came of one message of one component.

    `frames` of it, of which `copies` had come before; how often and how evenly, by receive time: the jitter is the
    standard deviation of the time from one to the next. `last_rx_us` −1: it had no receive time.
    """

    frames: int
    copies: int
    rate_hz: float | None
    jitter_ms: float | None
    last_rx_us: int


class UtcSaid(NamedTuple):
    """A vehicle told the date: `unix_us` at the receive time `t_rx_us` (−1: unknown)."""

    unix_us: int
    t_rx_us: int


class ComponentSeen(NamedTuple):
    """What came of one component; `lost` by its sequence numbers, of which `numbering` tells what they are worth.

    `held`: signatures that are right and new, `wrong`: that are not right; None where there is no key.
    """

    sysid: int
    compid: int
    frames: int
    copies: int
    signed: int
    held: int | None
    wrong: int | None
    mavlink1: int
    lost: int
    numbering: Numbering
    messages: dict[str, MessageSeen]
    firmware: str | None
    utc: UtcSaid | None

    @property
    def address(self) -> tuple[int, int]:
        """System and component."""
        return self.sysid, self.compid


class _Intervals:
    """Some intervals: how many, their sum and that of their squares, µs and µs²."""

    def __init__(self) -> None:
        self.count, self.sum, self.squares = 0, 0.0, 0.0

    def add(self, intervals_us: npt.NDArray[np.float64]) -> None:
        self.count += len(intervals_us)
        self.sum += float(intervals_us.sum())
        self.squares += float((intervals_us * intervals_us).sum())


class _Message:
    """One message of one component."""

    def __init__(self) -> None:
        self.count = self.copies = 0
        self._last_us = -1
        self._intervals, self._silences = _Intervals(), _Intervals()

    def add(self, t_rx_us: Int64s, copy: Mask) -> None:
        """Take the receive times (n,) of the next ones, and which of them had come before."""
        self.count += len(t_rx_us)
        self.copies += int(np.count_nonzero(copy))
        times_us = t_rx_us[~copy & (t_rx_us > 0)]  # a damaged time reads as 0
        if not len(times_us):
            return
        before = [self._last_us] if self._last_us >= 0 else []
        steps_us = np.diff(np.concatenate([np.array(before, np.int64), times_us]))
        self._last_us = int(times_us[-1])
        steps_us = steps_us[steps_us > -SET_BACK_US].astype(np.float64)  # the receiver's clock was set back
        silent = steps_us > SILENCE_US
        self._intervals.add(steps_us[~silent])
        self._silences.add(steps_us[silent])

    def seen(self) -> MessageSeen:
        of = self._intervals
        if of.count < self._silences.count:  # it is slower than silences are long
            of = _Intervals()
            for part in (self._intervals, self._silences):
                of.count, of.sum, of.squares = of.count + part.count, of.sum + part.sum, of.squares + part.squares
        lasts = of.sum >= _LEAST_US
        jitter_us = None
        if lasts and of.count > 1:
            mean_us = of.sum / of.count
            jitter_us = math.sqrt(max(of.squares / of.count - mean_us * mean_us, 0.0))
        return MessageSeen(
            frames=self.count,
            copies=self.copies,
            rate_hz=of.count / of.sum * US_PER_S if lasts else None,
            jitter_ms=None if jitter_us is None else jitter_us / 1e3,
            last_rx_us=self._last_us,
        )


class _Component:
    """One (system, component)."""

    def __init__(self) -> None:
        self.frames = self.copies = self.signed = self.held = self.wrong = self.mavlink1 = self.verified = self.lost = 0
        self.messages: dict[int, _Message] = {}
        self.numbering = Numbering()
        self.firmware: str | None = None
        self.utc: UtcSaid | None = None


class Census:
    """Of one link or recording."""

    def __init__(self, dialect: Dialect) -> None:
        """Start with nobody heard."""
        self._dialect = dialect
        self._components: dict[int, _Component] = {}
        self._asks: Counter[Ask] = Counter()
        self._verifies = False

    def take(self, scanner: Scanner) -> None:
        """Take the frames that the scanner found in its last call."""
        frames = scanner.all_frames
        if not len(frames):
            return
        mavlink1, signed = scanner.heads()
        outcomes = scanner.outcomes
        self._verifies = outcomes is not None
        if outcomes is None:
            outcomes = np.full(len(frames), Outcome.UNKNOWN, np.int8)
        address = frames["sysid"].astype(np.int64) << 8 | frames["compid"]
        key = address << 24 | frames["msgid"]
        order = np.argsort(key, kind="stable")
        for rows in _runs(order, key[order] >> 24):
            self._count(int(address[rows[0]]), frames, np.sort(rows), mavlink1, signed, outcomes)
        for rows in _runs(order, key[order]):
            first = frames[rows[0]]
            of = self._components[int(address[rows[0]])]
            copy = frames["duplicate"][rows] != 0
            msgid = int(first["msgid"])
            name = self._dialect.name_of(msgid)
            if name is None and len(of.messages) >= _MOST_UNKNOWN and msgid not in of.messages:  # noise has any id
                continue
            message = of.messages.setdefault(msgid, _Message())
            message.add(frames["t_rx_us"][rows], copy)
            if name in _TELLING or name in ASKS:
                fresh = rows[~copy & (frames["verified"][rows] == 1)]
                self._hear(name or "", of, int(address[rows[0]]), scanner.buffer, frames[fresh])

    def _count(
        self, address: int, frames: Frames, rows: Int64s, mavlink1: Mask, signed: Mask, outcomes: Outcomes
    ) -> None:
        of = self._components.setdefault(address, _Component())
        copy = frames["duplicate"][rows] != 0
        of.frames += len(rows)
        of.copies += int(np.count_nonzero(copy))
        of.verified += int(np.count_nonzero(frames["verified"][rows]))
        of.mavlink1 += int(np.count_nonzero(mavlink1[rows]))
        of.signed += int(np.count_nonzero(signed[rows]))
        of.held += int(np.count_nonzero(outcomes[rows] == Outcome.HOLDS))
        of.wrong += int(np.count_nonzero(outcomes[rows] == Outcome.WRONG))
        of.lost = int(frames["lost"][rows[-1]])
        of.numbering.add(frames["seq"][rows[~copy]])

    def _hear(self, name: str, of: _Component, address: int, buffer: Bytes, frames: Frames) -> None:
        """Messages of one name that tell something of their sender."""
        if not len(frames):
            return
        sent = decode(buffer, frames, self._dialect[name])
        if name in ASKS:
            for ask in asks_in(name, (address >> 8, address & 0xFF), sent, self._dialect):
                if ask in self._asks or len(self._asks) < _MOST_ASKS:
                    self._asks[ask] += 1
        elif name == "SYSTEM_TIME":
            unix_us = sent["time_unix_usec"]
            known = np.flatnonzero((unix_us > 0) & (unix_us < _YEAR_2100_US))  # 0: it does not know
            if len(known):
                of.utc = UtcSaid(int(unix_us[known[-1]]), int(frames["t_rx_us"][known[-1]]))
        elif name == "AUTOPILOT_VERSION":
            version = int(sent["flight_sw_version"][-1])
            if version:
                of.firmware = _version(version)
        elif of.firmware is None:
            said = (_FIRMWARE.match(text_of(record)) for record in sent)
            of.firmware = next((found[1] for found in said if found), None)

    def components(self) -> list[ComponentSeen]:
        """All that were heard by a frame whose checksum holds, by system and component."""
        return [
            ComponentSeen(
                sysid=address >> 8,
                compid=address & 0xFF,
                frames=of.frames,
                copies=of.copies,
                signed=of.signed,
                held=of.held if self._verifies else None,
                wrong=of.wrong if self._verifies else None,
                mavlink1=of.mavlink1,
                lost=of.lost,
                numbering=of.numbering,
                messages=self._named(of.messages),
                firmware=of.firmware,
                utc=of.utc,
            )
            for address, of in sorted(self._components.items())
            if of.verified
        ]

    def asks(self) -> list[tuple[Ask, int]]:
        """Who asked whom for which rates, and how often; the wishes of one sender beside each other."""
        return sorted(self._asks.items(), key=lambda asked: (asked[0][:4], asked[0].rate_hz or 0.0))

    def _named(self, messages: dict[int, _Message]) -> dict[str, MessageSeen]:
        names = {msgid: self._dialect.name_of(msgid) or f"UNKNOWN_{msgid}" for msgid in messages}
        return {names[msgid]: messages[msgid].seen() for msgid in sorted(messages, key=names.__getitem__)}


_TELLING = ("SYSTEM_TIME", "AUTOPILOT_VERSION", "STATUSTEXT")


def _runs(order: Int64s, key: Int64s) -> Iterable[Int64s]:
    """`order` (n,), cut wherever the sorted `key` (n,) becomes another."""
    return np.split(order, np.flatnonzero(key[1:] != key[:-1]) + 1)


def _version(number: int) -> str:
    """As AUTOPILOT_VERSION has it, a byte each: major, minor, patch, and what kind of release."""
    major, minor, patch, kind = number.to_bytes(4, "big")
    return f"{major}.{minor}.{patch}{_RELEASES.get(kind, '')}"
