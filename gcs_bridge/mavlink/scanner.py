"""Finds the frames of a link or recording, piece by piece, and keeps count of what was damaged.

What they hold is not known here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Int64s, Mask
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import (
    _BAD_TIMES,
    _BARE_FRAMES,
    _COUNTS,
    _CR_LINE_FEEDS,
    _CR_MISSING,
    _CRC_FAILED,
    _CURSOR,
    _DUPLICATES,
    _GAP_START,
    _LAST_TIME,
    _LINE_FEEDS,
    _NO_SEQ,
    _REPAIRED,
    _SIGNED_FRAMES,
    _SLOTS,
    _UNVERIFIED,
    _V1,
    _V2,
    FRAME,
    Bytes,
    Components,
    Frames,
    admit_kernel,
    scan_kernel,
)
from gcs_bridge.mavlink.signing import BLOCK_BYTES, Outcome, Outcomes, SignatureCounts, Signatures, Signing


@dataclass(kw_only=True)
class Salvage:
    """What a link or file yielded, and what it lost; `gaps` keeps the first hundred (offset, bytes).

    Of LFs in gaps, those behind a CR, and bad frames that one CR more would mend: what a conversion of text does.
    """

    bytes: int = 0
    frames: int = 0
    bad_crc: int = 0
    repaired_crc: int = 0
    unverified: int = 0
    skipped_bytes: int = 0
    signed: int = 0
    signatures: SignatureCounts | None = None  # None: there is no key to verify them by
    duplicates: int = 0
    bad_times: int = 0
    line_feeds: int = 0
    cr_line_feeds: int = 0
    cr_missing: int = 0
    gap_count: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)
    _gap_end: int = -1

    def add_gap(self, offset: int, length: int) -> None:
        """Count `length` bytes at `offset` as unreadable, one gap with those right before them."""
        self.skipped_bytes += length
        if offset == self._gap_end:
            if self.gap_count <= len(self.gaps):
                first, before = self.gaps[-1]
                self.gaps[-1] = (first, before + length)
        else:
            self.gap_count += 1
            if len(self.gaps) < MAX_GAPS:
                self.gaps.append((offset, length))
        self._gap_end = offset + length

    @property
    def line_ends(self) -> str | None:
        """Which line ends were turned into others, as if this were text; None: there is no sign of it."""
        if self.line_feeds >= _LEAST_ENDS and self.cr_line_feeds >= _ENDS_SHARE * self.line_feeds:
            return "LF into CR LF"
        if self.cr_missing >= _LEAST_MENDED and 100 * self.cr_missing >= self.gap_count:
            return "CR LF into LF"
        return None

    @property
    def read_fraction(self) -> float | None:
        """Share of the bytes that were read, None before the first byte."""
        return 1.0 - self.skipped_bytes / self.bytes if self.bytes else None


MAX_GAPS = 100
MARKERS = (bytes([_V1]), bytes([_V2]))  # the first byte of a frame
# In noise one LF in 256 stands behind a CR, and a bad frame is mended by a CR with a chance of one in thousands.
_LEAST_ENDS, _ENDS_SHARE, _LEAST_MENDED = 10, 0.95, 2


class RawFrame(NamedTuple):
    """A whole frame, signature included, and its receive time."""

    t_rx_us: int
    data: bytes


class Scanned(NamedTuple):
    """Frames that were found, what they lie in, and how many bytes were read so far."""

    buffer: Bytes
    frames: Frames
    done: int


class Scanner:
    """The frames of one link or recording, from its bytes in pieces cut anywhere.

    `timed` reads a recording, else a stream. What a piece leaves undecided (at most one frame, and in a stream the one
    behind it) waits for the next piece. Bytes in, structured `FRAME` arrays out; the frames' payloads are in `buffer`
    until the next call.
    """

    def __init__(self, dialect: Dialect, *, timed: bool, signing: Signing | None = None) -> None:
        """Start with nothing read; with `signing` frames are verified, and those left out that are to be rejected."""
        self._signatures = None if signing is None else Signatures(signing)
        self.outcomes: Outcomes | None = None  # of the last call's `all_frames`, where they are verified
        self._salvage = Salvage(signatures=None if self._signatures is None else self._signatures.counts)
        self.buffer: Bytes = np.empty(0, np.uint8)
        self.all_frames: Frames = np.empty(0, FRAME)  # of the last call, with those of unknown ids
        self._base = 0
        self._timed = timed
        self._tables = dialect.tables
        self._counts = np.zeros(_COUNTS, np.int64)
        self._counts[[_GAP_START, _LAST_TIME]] = -1
        self._components = Components(
            slot=np.full(65536, -1, np.int16),
            last_seq=np.full(_SLOTS, _NO_SEQ, np.int16),
            late_seq=np.full(_SLOTS, _NO_SEQ, np.int16),
            lost=np.zeros(_SLOTS, np.int64),
            seen_hash=np.zeros((_SLOTS, 256), np.uint64),
            seen_us=np.full((_SLOTS, 256), -1, np.int64),
            stamped_hash=np.zeros((_SLOTS, 256), np.uint64),
            stamped_us=np.full((_SLOTS, 256), -1, np.int64),
            stands=np.zeros(_SLOTS, np.int16),
            repeated=np.zeros(_SLOTS, np.int64),
            signs=np.zeros(_SLOTS, np.bool_),
        )

    @property
    def read(self) -> int:
        """How many bytes were read so far."""
        return self._salvage.bytes

    @property
    def frames(self) -> int:
        """How many frames of known ids were found so far, refused ones included."""
        return self._salvage.frames

    @property
    def bare(self) -> int:
        """How many came unsigned of senders that had signed others."""
        return int(self._counts[_BARE_FRAMES])

    @property
    def salvage(self) -> Salvage:
        """What was read by now, and what was lost."""
        for slot, name in _COUNTERS:
            setattr(self._salvage, name, int(self._counts[slot]))
        return self._salvage

    def scan(self, data: bytes | bytearray | memoryview, *, t_rx_us: int = -1, final: bool = False) -> Frames:
        """Take the next bytes and return the frames that they complete.

        `t_rx_us` is the receive time of a stream's bytes, −1 if unknown (a recording brings its own). With `final`
        nothing follows: what is still undecided is decided, as at the end of a file or of a datagram.
        """
        ends, times_us = np.array([len(data)]), np.array([t_rx_us])
        return self.scan_chunks(np.frombuffer(data, np.uint8), ends, times_us, final=final)

    def scan_chunks(
        self, data: Bytes, ends: Int64s, t_rx_us: Int64s, *, whole: bool = False, final: bool = False
    ) -> Frames:
        """Take the chunks of `data`, up to `ends` each: as `scan` takes one after the other, in one call.

        `whole`: nothing goes on behind any of them, as behind datagrams; `final`: behind the last.
        """
        counts, salvage = self._counts, self._salvage
        keep = int(counts[_CURSOR]) - self._base
        if counts[_GAP_START] >= 0:
            keep = max(
                keep - 8, 0
            )  # the bytes before a frame found in a gap may be its time, and tell what a gap is of
        rest = self.buffer.size - keep
        buffer = np.empty(rest + data.size, np.uint8)
        buffer[:rest] = self.buffer[keep:]
        buffer[rest:] = data
        self.buffer = buffer
        self._base += keep
        capacity = buffer.size // _SMALLEST_FRAME + len(ends) + 1
        frames, gaps = np.empty(capacity, FRAME), np.empty((capacity, 2), np.int64)
        unverified = int(counts[_UNVERIFIED])
        refuses = self._signatures is not None and self._signatures.refuses
        n_frames, n_gaps = scan_kernel(
            buffer,
            self._base,
            ends + rest if rest else ends,
            t_rx_us,
            whole,
            final,
            self._timed,
            not refuses,
            *self._tables,
            counts,
            self._components,
            frames,
            gaps,
        )
        self.all_frames = verified = frames[:n_frames]
        unknown = int(counts[_UNVERIFIED]) - unverified
        salvage.bytes += data.size
        salvage.frames += n_frames - unknown
        if self._signatures is not None:
            self.outcomes = self._signatures.judge(buffer, self._base, verified)
            unknown += self._refuse(self._signatures.counts, self.outcomes) if refuses else 0
        if unknown:
            verified = verified[verified["verified"] == 1]
        for offset, length in gaps[:n_gaps].tolist():
            salvage.add_gap(offset, length)
        return verified

    def _refuse(self, counts: SignatureCounts, outcomes: Outcomes) -> int:
        """Leave out what does not hold, as if it had not come; how many of known ids that are."""
        frames, holds = self.all_frames, outcomes == Outcome.HOLDS
        row_of_id, _, _, stamped = self._tables
        admit_kernel(self.buffer, holds, row_of_id, stamped, self._counts, self._components, frames)
        if holds.all():
            return 0
        refused = int(frames["verified"][~holds].sum())
        frames["verified"][~holds] = 0
        counts.refused += refused
        return refused

    def repeated(self, sysid: int, compid: int) -> int:
        """How many frames of a component had come before."""
        mine = int(self._components.slot[sysid * 256 + compid])
        return 0 if mine < 0 else int(self._components.repeated[mine])

    def heads(self) -> tuple[Mask, Mask]:
        """Which of the last call's frames (n,), those of unknown ids included, are of MAVLink 1; which are signed."""
        start = self.all_frames["offset"] - self._base
        return self.buffer[start] == _V1, self.all_frames["signed"] == 1

    def raw_frames(self) -> list[RawFrame]:
        """The frames of the last call, those of unknown ids included, byte for byte as they came."""
        frames = self.all_frames
        start = frames["offset"] - self._base
        stop = ends_of(frames)
        return [
            RawFrame(t_rx_us, self.buffer[first:end].tobytes())
            for t_rx_us, first, end in zip(frames["t_rx_us"].tolist(), start.tolist(), stop.tolist(), strict=True)
        ]


def ends_of(frames: Frames) -> Int64s:
    """Where each of the frames (n,) ends in what was scanned, its signature included."""
    behind = np.where(frames["signed"] == 1, 2 + BLOCK_BYTES, 2)
    ends: Int64s = frames["payload"].astype(np.int64) + frames["length"] + behind
    return ends


_SMALLEST_FRAME = 8
_COUNTERS = (
    (_CRC_FAILED, "bad_crc"),
    (_REPAIRED, "repaired_crc"),
    (_UNVERIFIED, "unverified"),
    (_SIGNED_FRAMES, "signed"),
    (_DUPLICATES, "duplicates"),
    (_BAD_TIMES, "bad_times"),
    (_LINE_FEEDS, "line_feeds"),
    (_CR_LINE_FEEDS, "cr_line_feeds"),
    (_CR_MISSING, "cr_missing"),
)
