"""Find the MAVLink frames in bytes: versions 1 and 2, signed or not, every known checksum checked, damage survived.

One compiled loop serves two readings of the same bytes. A *stream* (serial, TCP, one datagram, a .raw file) is frame
after frame. A *recording* (.tlog) is record after record: eight bytes of big-endian time in microseconds, then a frame.

The rules, in the order in which they decide:

1. Where a frame is due (behind the one before), it is taken if its checksum holds.
2. A due frame that can't be checked (unknown id, unknown incompatibility flag) or fails is stepped over as a whole only
   if another frame starts where its length says, and none with a right checksum lies within. It is counted; what could
   not be checked is kept apart. A recorder that can't check it either takes noise for such a frame, and what came
   behind it for its payload: real frames, which have no times of their own then.
3. Otherwise the bytes from there on are a gap, and the next frame with a right checksum ends it; in a recording only
   if the eight bytes before it can be its time, or another record follows it, as 16 bits of checksum alone accept one
   false frame in some 20 MB of noise.

Nothing is decided before the bytes that decide it are there: what comes out does not depend on how the bytes were cut.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.dialect import BEYOND, WITHIN

Bytes = npt.NDArray[np.uint8]
FRAME = np.dtype(
    [
        ("offset", "i8"),  # of the frame's first byte in its link or file
        ("t_rx_us", "i8"),  # receive time; a recording's record time
        ("payload", "i4"),  # index of the payload in the scanned piece
        ("length", "i4"),  # of the payload on the wire
        ("msgid", "i4"),
        ("sysid", "u1"),
        ("compid", "u1"),
        ("seq", "u1"),
        ("duplicate", "u1"),
        ("verified", "u1"),  # 0: of an id that the dialect does not know, so its checksum says nothing; or refused
        ("signed", "u1"),  # 1: it carries a signature; BARE: it carries none, and its sender has signed others
        ("lost", "i8"),  # frames of this system and component that the sequence numbers miss so far
    ]
)
Frames = Annotated[npt.NDArray[np.void], FRAME]
BARE = 2
# What stands at a place of the buffer.
_NO_FRAME, _MORE, _GOOD, _BAD_CRC, _UNKNOWN = 0, 1, 2, 3, 4
_V1, _V2 = 0xFE, 0xFD
_SIGNED = 0x01  # the one incompatibility flag that is defined
_DAY_US = 86_400_000_000
_MINUTE_US = 60_000_000
_YEAR_2100_US = 4_102_444_800_000_000
_NO_TIME = -1
_NO_SEQ = -1
_HABIT = 3  # so many repaired frames show that a recorder cuts zeros behind the checksum
# Slots of `Scanner._counts`, the kernel's counters and state that outlive a call.
_CRC_FAILED, _REPAIRED, _UNVERIFIED, _SIGNED_FRAMES, _DUPLICATES, _BAD_TIMES = range(6)
_GAP_START, _LAST_TIME, _COMPONENTS, _CURSOR = 6, 7, 8, 9
_INSIDE_UNTIL, _INSIDE_TIME = (
    10,
    11,
)  # offset up to which a frame that can't be checked reaches that hides others; its time
_LINE_FEEDS, _CR_LINE_FEEDS, _CR_MISSING = 12, 13, 14  # in gaps; there behind a CR; frames that one CR would mend
_BARE_FRAMES = 15
_COUNTS = 16
_LF, _CR = 0x0A, 0x0D
_COPY_US = 1_000_000  # so long behind a frame it may come again
_PLACES = 4  # in which one of `stamped_hash` may be
_SLOTS = 256  # components whose sequence and repetitions are followed; those beyond share the last slot, unfollowed


class Components(NamedTuple):
    """Per link: what was last heard of each (system, component)."""

    slot: npt.NDArray[np.int16]  # of sysid·256 + compid, −1: none yet
    last_seq: npt.NDArray[np.int16]
    late_seq: npt.NDArray[np.int16]
    lost: npt.NDArray[np.int64]
    seen_hash: Annotated[npt.NDArray[np.uint64], 2]  # (slot, seq): the last frame with this sequence number
    seen_us: Annotated[npt.NDArray[np.int64], 2]
    # Where the number stands still: (slot, eight bits of the hash), the last frame with a time in it.
    stamped_hash: Annotated[npt.NDArray[np.uint64], 2]
    stamped_us: Annotated[npt.NDArray[np.int64], 2]
    stands: npt.NDArray[np.int16]  # whether it does: different frames came with the same number
    repeated: npt.NDArray[np.int64]  # frames that had come before
    signs: npt.NDArray[np.bool_]  # whether it has sent a signature


def _crc_tables() -> npt.NDArray[np.uint16]:
    """CRC-16/MCRF4XX, reflected polynomial 0x8408 (mavlink.io, guide/serialization.html#checksum).

    `[k, b]` is what byte b does to the checksum when k more bytes follow it, so that eight bytes can be taken at once.
    """
    tables = np.empty((8, 256), np.uint16)
    row = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        row = np.where(row & 1, (row >> 1) ^ np.uint16(0x8408), row >> 1).astype(np.uint16)
    tables[0] = row
    for k in range(1, 8):
        tables[k] = (tables[k - 1] >> 8) ^ tables[0, tables[k - 1] & 0xFF]
    return tables


CRC_TABLES = _crc_tables()


@helper
def crc_of(buf: Any, start: Any, stop: Any, crc: Any) -> Any:
    """The checksum `crc` gone on over the bytes from `start` up to, and without, `stop`."""
    t = CRC_TABLES
    i = start
    while stop - i >= 8:
        low, high = (crc ^ buf[i]) & 0xFF, (crc >> 8) ^ buf[i + 1]
        first = t[7, low] ^ t[6, high] ^ t[5, buf[i + 2]] ^ t[4, buf[i + 3]]
        crc = np.int64(first ^ t[3, buf[i + 4]] ^ t[2, buf[i + 5]] ^ t[1, buf[i + 6]] ^ t[0, buf[i + 7]])
        i += 8
    while i < stop:
        crc = (crc >> 8) ^ np.int64(t[0, (crc ^ buf[i]) & 0xFF])
        i += 1
    return crc


@helper
def crc_with_byte(crc: Any, byte: Any) -> Any:
    """The checksum `crc` gone on over one more byte."""
    return (crc >> 8) ^ np.int64(CRC_TABLES[0, (crc ^ byte) & 0xFF])


@helper
def integer_at(buf: Any, at: Any, size: Any) -> Any:
    """The little-endian unsigned integer of `size` bytes at `at`."""
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(buf[np.uint64(at + i)]) << (8 * i)
    return value


@helper
def _head(buf: Any, at: Any, n: Any) -> Any:
    """(header, whole length, id, flags) of a frame that would start at `at`; whole length 0: none, −1: more bytes."""
    if at >= n:
        return 0, -1, 0, 0
    if buf[at] == _V2:
        if n - at < 10:
            return 10, -1, 0, 0
        flags = np.int64(buf[at + 2])
        msgid = integer_at(buf, at + 7, 3)
        return 10, 12 + np.int64(buf[at + 1]) + (13 if flags & _SIGNED else 0), msgid, flags
    if buf[at] == _V1:
        if n - at < 6:
            return 6, -1, 0, 0
        return 6, 8 + np.int64(buf[at + 1]), np.int64(buf[at + 5]), 0
    return 0, 0, 0, 0


@helper
def _look(buf: Any, at: Any, n: Any, row_of_id: Any, crc_extra: Any) -> Any:
    """(what, header length, whole length, message id) of what stands at `at`."""
    header, whole, msgid, flags = _head(buf, at, n)
    if whole == 0:
        return _NO_FRAME, 0, 0, 0
    if whole < 0 or n - at < whole:
        return _MORE, header, whole, msgid
    row = -1
    if msgid < row_of_id.size:
        row = row_of_id[msgid]
    if row < 0:
        return _UNKNOWN, header, whole, msgid
    end = at + header + np.int64(buf[at + 1])
    crc = crc_with_byte(crc_of(buf, at + 1, end, np.int64(0xFFFF)), np.int64(crc_extra[row]))
    if crc == integer_at(buf, end, 2):
        return (_UNKNOWN if flags & ~_SIGNED else _GOOD), header, whole, msgid
    return _BAD_CRC, header, whole, msgid


@helper
def _zero_padded(
    buf: Any, at: Any, header: Any, msgid: Any, row_of_id: Any, crc_extra: Any, field_end: Any, anywhere: Any
) -> Any:
    """Whether the checksum at `at` was taken before the payload's trailing zeros were cut off (some recorders do so).

    Each length that is tried lets one bad frame in 65,536 through. So a payload is padded to the end of a field, as
    senders leave it, and to any length only where the recorder is known to cut zeros (`anywhere`).
    """
    length = np.int64(buf[at + 1])
    end = at + header + length
    if header != 10 or (buf[end - 1] == 0 and length > 1):  # version 2 alone cuts zeros, all but a first byte
        return False
    row = row_of_id[msgid]
    sent = integer_at(buf, end, 2)
    for padded in range(length + 1, field_end.shape[1]):
        if field_end[row, padded] == BEYOND:
            break
        if field_end[row, padded] == WITHIN and not anywhere:
            continue
        crc = crc_with_byte(np.int64(0xFFFF), np.int64(padded))  # the length byte counts too
        crc = crc_of(buf, at + 2, end, crc)
        for _ in range(padded - length):
            crc = crc_with_byte(crc, np.int64(0))
        crc = crc_with_byte(crc, np.int64(crc_extra[row]))
        if crc == sent:
            return True
    return False


@helper
def _time(buf: Any, at: Any) -> Any:
    """The big-endian time at `at`, µs; −1 where it can be none (behind the year 2100)."""
    value = np.int64(0)
    for i in range(8):
        value = (value << 8) | np.int64(buf[at + i])
    return value if 0 <= value < _YEAR_2100_US else np.int64(_NO_TIME)


@helper
def _near(time: Any, other: Any) -> Any:
    """Whether two times, both known, lie within a day of each other."""
    return time >= 0 and other >= 0 and abs(time - other) <= _DAY_US


@helper
def _follows(buf: Any, end: Any, n: Any, final: Any, timed: Any, time: Any, last_time: Any, row_of_id: Any) -> Any:
    """1 if another frame (in a recording: record) starts at `end`, 0 if not, −1 if more bytes are needed to tell."""
    at = end + 8 if timed else end
    if n <= at:
        return 1 if final else -1  # the last one of its file; a cut-off time counts as one
    if buf[at] != _V1 and buf[at] != _V2:
        return 0
    if timed:
        following = _time(buf, end)
        known = time >= 0 or last_time >= 0
        return 1 if _near(following, time) or _near(following, last_time) or (following >= 0 and not known) else 0
    _, whole, msgid, _ = _head(buf, at, n)
    if whole < 0:
        return 1 if final else -1
    return 1 if msgid < row_of_id.size and row_of_id[msgid] >= 0 else 0


@helper
def _hides_a_frame(
    buf: Any,
    start: Any,
    end: Any,
    n: Any,
    final: Any,
    timed: Any,
    needs_time: Any,
    last_time: Any,
    row_of_id: Any,
    crc_extra: Any,
) -> Any:
    """1 if a good frame begins within the bytes that a frame's length claims, 0 if not, −1 if more bytes must tell.

    Then the length is wrong. In a recording, where the next record's time speaks for it, the good one must end there
    too; `needs_time`: and have a time of its own, as what fails claims its length with more right than noise does.
    """
    for at in range(start + 1, end):
        if buf[at] != _V1 and buf[at] != _V2:
            continue
        what, _, whole, msgid = _look(buf, at, end if timed else n, row_of_id, crc_extra)
        if what == _GOOD and (not needs_time or (at - 8 > start and _near(_time(buf, at - 8), last_time))):
            return 1
        known = whole < 0 or (msgid < row_of_id.size and row_of_id[msgid] >= 0)
        if what == _MORE and known and not timed and not final:
            return -1
    return 0


@helper
def _lacks_a_return(buf: Any, at: Any, header: Any, msgid: Any, row_of_id: Any, crc_extra: Any) -> Any:
    """Whether a frame that fails passes with a CR put back before one of its LFs."""
    end = at + header + np.int64(buf[at + 1]) - 1  # it is one byte shorter than its length says
    for lf in range(at + 1, end + 1):  # up to the first byte of the checksum
        if buf[lf] == _LF:
            crc = crc_with_byte(crc_of(buf, at + 1, lf, np.int64(0xFFFF)), np.int64(_CR))
            crc = crc_with_byte(crc_of(buf, lf, end, crc), np.int64(crc_extra[row_of_id[msgid]]))
            if crc == integer_at(buf, end, 2):
                return True
    return False


@helper
def _pass_byte(buf: Any, at: Any, first: Any, counts: Any) -> Any:
    """Count the line feeds among the bytes of a gap, whose first one was at `first`."""
    if buf[at] == _LF:
        counts[_LINE_FEEDS] += 1
        counts[_CR_LINE_FEEDS] += at > first and buf[at - 1] == _CR


@helper
def _digest(buf: Any, start: Any, stop: Any, digest: Any) -> Any:
    """A 64-bit hash of the bytes and of what `digest` was, eight bytes at a time; zeros at the end don't count."""
    while stop > start and buf[stop - 1] == 0:  # they are cut off in one version of MAVLink, and not in the other
        stop -= 1
    odd = np.uint64(0x9E3779B97F4A7C15)
    for i in range(start, stop, 8):
        word = np.uint64(min(stop - i, 8))
        for j in range(i, min(i + 8, stop)):
            word = (word << np.uint64(8)) ^ np.uint64(buf[j])
        digest = (digest ^ word) * odd
        digest ^= digest >> np.uint64(29)
    return digest


@helper
def _stamped_again(components: Any, mine: Any, digest: Any, seq: Any, time: Any) -> Any:
    """Whether a frame that has a time in it came with this digest and number within a second; now it did."""
    hashes, times_us = components.stamped_hash, components.stamped_us
    digest ^= np.uint64(seq) << np.uint64(48)
    place = np.int64(digest >> np.uint64(56)) // _PLACES * _PLACES
    oldest = place
    for k in range(_PLACES):
        at = place + k
        if hashes[mine, at] == digest and times_us[mine, at] >= 0:
            again = abs(time - times_us[mine, at]) <= _COPY_US
            times_us[mine, at] = time
            return again
        if times_us[mine, at] < times_us[mine, oldest]:
            oldest = at
    hashes[mine, oldest], times_us[mine, oldest] = digest, time
    return False


@helper
def _admit(frame: Any, components: Any, counts: Any, buf: Any, time: Any, row_of_id: Any, stamped: Any) -> Any:
    """Follow the frame's component: losses, repetitions of the same frame within a second, signatures that are missing.

    Under a number that stands still a frame that says the same may be a new one, unless a time is in it: `stamped`, by
    the message's row.
    """
    key = np.int64(frame.sysid) * 256 + np.int64(frame.compid)
    mine = np.int64(components.slot[key])
    if mine < 0:
        mine = min(np.int64(counts[_COMPONENTS]), np.int64(_SLOTS - 1))
        components.slot[key] = mine
        counts[_COMPONENTS] = min(counts[_COMPONENTS] + 1, _SLOTS - 1)
    if mine == _SLOTS - 1:
        return
    if frame.verified:
        if frame.signed:
            components.signs[mine] = True
        elif components.signs[mine]:
            frame.signed = BARE
            counts[_BARE_FRAMES] += 1
    last_seq, late_seq, lost = components.last_seq, components.late_seq, components.lost
    seen_hash, seen_us = components.seen_hash, components.seen_us
    digest = _digest(buf, frame.payload, frame.payload + frame.length, np.uint64(frame.msgid))
    seq = np.int64(frame.seq)
    again = False
    if seen_hash[mine, seq] == digest:
        again = abs(time - seen_us[mine, seq]) <= _COPY_US and seen_us[mine, seq] >= 0
    elif seq == last_seq[mine]:
        components.stands[mine] = 1
    seen_hash[mine, seq] = digest
    seen_us[mine, seq] = time
    if components.stands[mine]:
        again = frame.verified and stamped[row_of_id[frame.msgid]]
        again = again and _stamped_again(components, mine, digest, seq, time)
    if again:
        frame.duplicate = 1
        components.repeated[mine] += 1
        counts[_DUPLICATES] += frame.verified
    else:
        ahead = (seq - last_seq[mine]) & 0xFF
        if last_seq[mine] < 0:
            last_seq[mine] = seq
        elif 0 < ahead < 128:
            lost[mine] += ahead - 1
            last_seq[mine] = seq
            late_seq[mine] = _NO_SEQ
            components.stands[mine] = 0
        elif ahead > 246:
            lost[mine] = max(lost[mine] - 1, np.int64(0))  # one of the last ten, counted as lost and now come late
        elif ahead and late_seq[mine] >= 0 and seq == (late_seq[mine] + 1) & 0xFF:
            last_seq[mine] = seq  # a second one far from where the sequence was: it started anew
            late_seq[mine] = _NO_SEQ
        elif ahead:
            late_seq[mine] = seq
    frame.lost = lost[mine]


@helper
def _scan_chunk(
    buf: Any,
    base: Any,
    n: Any,
    final: Any,
    timed: Any,
    admits: Any,
    t_rx_us: Any,
    row_of_id: Any,
    crc_extra: Any,
    field_end: Any,
    stamped: Any,
    counts: Any,
    components: Any,
    frames: Any,
    n_frames: Any,
    gaps: Any,
    n_gaps: Any,
) -> Any:
    """Scan on to the chunk's end `n`; the frames and gaps found so far, with those of before."""
    at = counts[_CURSOR] - base  # a due record's or frame's first byte; in a gap, where a frame may start
    while True:
        gap_start = counts[_GAP_START]
        in_gap = gap_start >= 0
        last_time = counts[_LAST_TIME]
        start = at + 8 if timed and not in_gap else at
        if in_gap:
            while start < n and buf[start] != _V1 and buf[start] != _V2:
                _pass_byte(buf, start, gap_start - base, counts)
                start += 1
            at = start
        if start >= n:
            break
        what, header, whole, msgid = _look(buf, start, n, row_of_id, crc_extra)
        if what == _MORE and not final:
            break
        end = start + whole
        time = t_rx_us
        if timed:
            time = _time(buf, start - 8) if not in_gap or start - 8 >= gap_start - base else np.int64(_NO_TIME)
        inside = timed and in_gap and base + start < counts[_INSIDE_UNTIL]
        if inside and not _near(time, counts[_INSIDE_TIME]):
            time = counts[_INSIDE_TIME]
        taken = what == _GOOD
        repaired = False
        if taken and in_gap and timed and not inside and (time < 0 or (last_time >= 0 and not _near(time, last_time))):
            follows = _follows(buf, end, n, final, timed, time, last_time, row_of_id)
            if follows < 0:
                break
            taken = follows == 1
        elif not in_gap and what in (_BAD_CRC, _UNKNOWN) and (not timed or last_time < 0 or _near(time, last_time)):
            follows = _follows(buf, end, n, final, timed, time, last_time, row_of_id)
            if follows < 0:
                break
            hides = 0
            if follows == 1:
                needs_time = timed and what == _BAD_CRC
                hides = _hides_a_frame(buf, start, end, n, final, timed, needs_time, last_time, row_of_id, crc_extra)
                if hides < 0:
                    break
            if hides:
                counts[_GAP_START] = base + at
                if what == _UNKNOWN:
                    counts[_INSIDE_UNTIL], counts[_INSIDE_TIME] = base + end, time
                continue
            if not follows and what == _BAD_CRC:
                counts[_CR_MISSING] += _lacks_a_return(buf, start, header, msgid, row_of_id, crc_extra)
            if follows == 1 and what == _BAD_CRC and field_end[row_of_id[msgid], buf[start + 1]] != BEYOND:
                repaired = _zero_padded(
                    buf, start, header, msgid, row_of_id, crc_extra, field_end, counts[_REPAIRED] >= _HABIT
                )
                if not repaired:
                    counts[_CRC_FAILED] += 1
                    gaps[n_gaps, 0] = base + at
                    gaps[n_gaps, 1] = end - at
                    n_gaps += 1
                    at = end
                    continue
            taken = repaired or (follows == 1 and what == _UNKNOWN)
        if not taken:
            if in_gap:
                _pass_byte(buf, at, gap_start - base, counts)
                at += 1
            else:
                counts[_GAP_START] = base + at
            continue

        time_is_bad = False
        if timed:
            # A time far from the last one is believed unless the next record's lies nearer to the last one. The first
            # has none before it: it is believed unless the next record's is known and far from it.
            if time < 0 or last_time < 0 or abs(time - last_time) > _MINUTE_US:
                if n < end + 9 and not final:
                    break
                following = np.int64(_NO_TIME)
                if n >= end + 9 and (buf[end + 8] == _V1 or buf[end + 8] == _V2):
                    following = _time(buf, end)
                if last_time < 0:
                    time_is_bad = bool(time < 0 or (following >= 0 and abs(following - time) > _DAY_US))
                    last_time = following
                else:
                    nearer_to_last = following >= 0 and abs(following - time) > abs(following - last_time)
                    time_is_bad = bool(time < 0 or nearer_to_last)
            if time_is_bad:
                counts[_BAD_TIMES] += 1
                time = last_time
            else:
                counts[_LAST_TIME] = time
        if in_gap:
            until = base + (start - 8 if timed and not time_is_bad else start)
            if until > gap_start:
                gaps[n_gaps, 0] = gap_start
                gaps[n_gaps, 1] = until - gap_start
                n_gaps += 1
            counts[_GAP_START] = -1
        frame = frames[n_frames]
        frame.offset = base + start
        frame.t_rx_us = time
        frame.payload = start + header
        frame.length = buf[start + 1]
        frame.msgid = msgid
        source = start + (5 if header == 10 else 3)
        frame.seq = buf[source - 1]
        frame.sysid = buf[source]
        frame.compid = buf[source + 1]
        frame.verified = 0 if what == _UNKNOWN else 1
        if what == _UNKNOWN:
            counts[_UNVERIFIED] += 1
        if repaired:
            counts[_REPAIRED] += 1
        frame.signed = 1 if header == 10 and buf[start + 2] & _SIGNED else 0
        counts[_SIGNED_FRAMES] += frame.signed
        frame.duplicate = 0
        frame.lost = 0
        if admits:
            _admit(frame, components, counts, buf, time, row_of_id, stamped)
        n_frames += 1
        at = end
    if final:
        gap_start = counts[_GAP_START] if counts[_GAP_START] >= 0 else base + at
        if base + n > gap_start:
            gaps[n_gaps, 0] = gap_start
            gaps[n_gaps, 1] = base + n - gap_start
            n_gaps += 1
        counts[_GAP_START] = -1
        at = n
    counts[_CURSOR] = base + at
    return n_frames, n_gaps


@kernel
def scan_kernel(
    buf: Bytes,
    base: int,
    ends: npt.NDArray[np.int64],
    t_rx_us: npt.NDArray[np.int64],
    whole: bool,
    final: bool,
    timed: bool,
    admits: bool,
    row_of_id: npt.NDArray[np.int16],
    crc_extra: npt.NDArray[np.uint8],
    field_end: Annotated[npt.NDArray[np.uint8], 2],
    stamped: npt.NDArray[np.bool_],
    counts: npt.NDArray[np.int64],
    components: Components,
    frames: Frames,
    gaps: Annotated[npt.NDArray[np.int64], 2],
) -> tuple[int, int]:
    """Scan `buf`, whose first byte has the offset `base`; return (frames, gaps) found, by the module's rules.

    It holds chunks up to their `ends`, received at `t_rx_us`. `whole`: nothing goes on behind any of them; `final`:
    behind the last. Unless it `admits` all frames, `admit_kernel` is to.
    """
    n_frames = 0
    n_gaps = 0
    for chunk in range(ends.size):
        n_frames, n_gaps = _scan_chunk(
            buf,
            base,
            ends[chunk],
            whole or (final and chunk == ends.size - 1),
            timed,
            admits,
            t_rx_us[chunk],
            row_of_id,
            crc_extra,
            field_end,
            stamped,
            counts,
            components,
            frames,
            n_frames,
            gaps,
            n_gaps,
        )
    return n_frames, n_gaps


@kernel
def admit_kernel(
    buf: Bytes,
    admitted: npt.NDArray[np.bool_],
    row_of_id: npt.NDArray[np.int16],
    stamped: npt.NDArray[np.bool_],
    counts: npt.NDArray[np.int64],
    components: Components,
    frames: Frames,
) -> None:
    """Follow the components of those frames of a scan that are `admitted` (n,), as if no other had come."""
    for i in range(frames.size):
        if admitted[i]:
            frame = frames[i]
            _admit(frame, components, counts, buf, frame.t_rx_us, row_of_id, stamped)
