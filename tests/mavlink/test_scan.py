"""The frame scan against pymavlink's parser and checksum: the same frames without damage, never fewer with it.

Damage is dealt by seeded hands, and what must survive it is counted from what it touched.
"""

import random
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink
from pymavlink.generator.mavcrc import x25crc

from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import RawFrame, Salvage, Scanner
from tests.helpers import wire
from tests.helpers.everyday import one_in, searched
from tests.helpers.paths import FIXTURES

DAMAGED = "h_lossy_dirty"
NAMES = sorted(path.stem for path in FIXTURES.glob("*.tlog"))
COPTER, SIGNED, VERSION_1 = "a_copter_square", "g_signed", "g_mavlink1"
UNKNOWN_ID = 0xABCDE  # in no dialect

Found = tuple[int, int, int, int, bytes]  # message, system, component, sequence, payload


@cache
def recording(name: str) -> bytes:
    return (FIXTURES / f"{name}.tlog").read_bytes()


def scan(data: bytes, *, timed: bool = True, sizes: Sequence[int] = (), t_rx_us: int = 0) -> tuple[np.ndarray, Salvage]:
    """All frames of `data`, cut into pieces of `sizes` (the rest in one), and what it yielded."""
    frames, _, salvage = scan_payloads(data, timed=timed, sizes=sizes, t_rx_us=t_rx_us)
    return frames, salvage


def scan_payloads(
    data: bytes, *, timed: bool = True, sizes: Sequence[int] = (), t_rx_us: int = 0
) -> tuple[np.ndarray, list[bytes], Salvage]:
    """The same with each frame's payload."""
    scanner = Scanner(load_dialect(), timed=timed)
    parts, payloads = [], []
    at = 0
    for size in [*sizes, len(data)]:
        piece = data[at : at + size]
        at += size
        frames = scanner.scan(piece, t_rx_us=t_rx_us, final=at >= len(data))
        whole = scanner.buffer.tobytes()
        payloads += [
            whole[p : p + n] for p, n in zip(frames["payload"].tolist(), frames["length"].tolist(), strict=True)
        ]
        parts.append(frames.copy())
        if at >= len(data):
            break
    return np.concatenate(parts), payloads, scanner.salvage


def found(data: bytes, *, timed: bool = True, sizes: Sequence[int] = ()) -> list[Found]:
    frames, payloads, _ = scan_payloads(data, timed=timed, sizes=sizes)
    columns = (frames[name].tolist() for name in ("msgid", "sysid", "compid", "seq"))
    return list(zip(*columns, payloads, strict=True))


def as_found(frame: bytes) -> Found:
    """A frame's own bytes, taken apart by hand."""
    if frame[0] == 0xFE:
        return frame[5], frame[3], frame[4], frame[2], frame[6 : 6 + frame[1]]
    return int.from_bytes(frame[7:10], "little"), frame[5], frame[6], frame[4], frame[10 : 10 + frame[1]]


def frame_size(data: bytes, at: int) -> int:
    return (12 + 13 * (data[at + 2] & 1) if data[at] == 0xFD else 8) + data[at + 1]


def records(data: bytes) -> Iterator[bytes]:
    """The records of an undamaged recording."""
    at = 0
    while at < len(data):
        end = at + 8 + frame_size(data, at + 8)
        yield data[at:end]
        at = end


@cache
def pymavlink_frames(name: str) -> list[Found]:
    """What pymavlink's parser finds in a recording, resynchronising as its own reader does; known ids alone."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    data = recording(name)
    seen = []
    at = 0
    while at + 8 < len(data):  # as mavutil.mavlogfile: eight bytes of time, then bytes until a message comes
        at += 8
        message = None
        while message is None and at < len(data):
            needed = parser.bytes_needed()
            message = parser.parse_char(data[at : at + needed])
            at += needed
        while message is not None and message.get_type() == "BAD_DATA":
            needed = parser.bytes_needed()
            if at >= len(data):
                break
            message = parser.parse_char(data[at : at + needed])
            at += needed
            while message is None and at < len(data):
                needed = parser.bytes_needed()
                message = parser.parse_char(data[at : at + needed])
                at += needed
        if message is not None and message.get_msgId() in mavlink.mavlink_map:
            seen.append(as_found(bytes(message.get_msgbuf())))
    return seen


def crc_holds(frame: bytes) -> bool:
    """Whether pymavlink's x25crc confirms a frame, as it is or with its payload's trailing zeros put back."""
    msgid = as_found(frame)[0]
    if msgid not in mavlink.mavlink_map:
        return False
    message = mavlink.mavlink_map[msgid]
    header = 10 if frame[0] == 0xFD else 6
    end = header + frame[1]
    sent = struct.unpack("<H", frame[end : end + 2])[0]
    for zeros in range(max(message.unpacker.size - frame[1], 0) + 1):
        checked = bytes([frame[1] + zeros]) + frame[2:end] + bytes(zeros) + bytes([message.crc_extra])
        if x25crc(checked).crc == sent:
            return True
        if header == 6:
            break
    return False


def crc_holds_at(data: bytes, offset: int) -> bool:
    return crc_holds(data[offset : offset + frame_size(data, offset)])


# --- undamaged -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", one_in(14, [name for name in NAMES if name != DAMAGED]))
def test_undamaged_recordings_hold_the_frames_that_pymavlink_finds(name: str) -> None:
    """Frame by frame: the same message, system, component, sequence and payload, in the same order, nothing skipped."""
    frames, payloads, salvage = scan_payloads(recording(name))
    columns = (frames[column].tolist() for column in ("msgid", "sysid", "compid", "seq"))
    assert list(zip(*columns, payloads, strict=True)) == pymavlink_frames(name)
    assert (salvage.frames, salvage.bad_crc, salvage.repaired_crc, salvage.skipped_bytes) == (len(frames), 0, 0, 0)
    assert salvage.read_fraction == 1.0


@pytest.mark.parametrize("name", one_in(4, [name for name in NAMES if name != DAMAGED]))
def test_record_times_and_offsets_are_those_of_the_file(name: str) -> None:
    """A frame's time is the big-endian number before it, its offset the place of its first byte."""
    at, expected = 0, []
    for record in records(recording(name)):
        if as_found(record[8:])[0] in mavlink.mavlink_map:
            expected.append((struct.unpack(">Q", record[:8])[0], at + 8))
        at += len(record)
    frames, _ = scan(recording(name))
    assert list(zip(frames["t_rx_us"].tolist(), frames["offset"].tolist(), strict=True)) == expected


def test_a_dirty_recording_yields_at_least_what_pymavlink_finds() -> None:
    """Every frame that pymavlink finds is found, in its order, and each further one holds pymavlink's checksum."""
    data = recording(DAMAGED)
    frames, payloads, salvage = scan_payloads(data)
    columns = (frames[name].tolist() for name in ("msgid", "sysid", "compid", "seq"))
    ours = list(zip(*columns, payloads, strict=True))
    assert not Counter(pymavlink_frames(DAMAGED)) - Counter(ours)
    rest = iter(ours)
    assert all(theirs in rest for theirs in pymavlink_frames(DAMAGED))  # a subsequence: the order is kept
    assert all(crc_holds_at(data, offset) for offset in frames["offset"].tolist())
    assert salvage.skipped_bytes > 0
    assert salvage.frames == len(frames) >= 2548  # pymavlink's count, from the facts of the recording


# --- the six damages of the comparison with other readers ------------------------------------------------------------

N = 4000


@cache
def undamaged() -> tuple[bytes, ...]:
    """N records of a real flight."""
    return tuple(records(recording(COPTER)))[:N]


def spoiled(dice: random.Random, damage: str) -> tuple[bytes, set[int]]:
    """The recording after one of the damages, and which of its frames were touched."""
    out = list(undamaged())
    touched = set(dice.sample(range(1, N - 1), {"random": 10, "markers": 10, "crc": 200}.get(damage, 50)))
    for i in touched:
        record = bytearray(out[i])
        if damage == "random":
            record[:0] = dice.randbytes(1000)
        elif damage == "markers":
            record[:0] = b"\xfd" * 200
        elif damage == "crc":
            record[-1 - dice.randrange(2)] ^= dice.randrange(1, 256)
        elif damage == "length":
            record[9] = dice.choice([n for n in range(256) if n != record[9]])
        elif damage == "lost":
            at = dice.randrange(8, len(record) - 7)
            del record[at : at + 7]
        elif damage == "unknown":
            payload = dice.randbytes(dice.randrange(1, 60))
            head = struct.pack("<BBBBBB", 0xFD, len(payload), 0, 0, dice.randrange(256), 1) + b"\x01"
            frame = head + UNKNOWN_ID.to_bytes(3, "little") + payload + dice.randbytes(2)
            record = record[:8] + frame + record
        out[i] = bytes(record)
    return b"".join(out), touched


@pytest.mark.parametrize("seed", one_in(2, range(4)))
@pytest.mark.parametrize(
    ("damage", "lost"), [("random", 0), ("markers", 0), ("crc", 200), ("length", 50), ("lost", 50), ("unknown", 0)]
)
def test_damage_costs_the_frames_that_it_touched_and_no_other(damage: str, lost: int, seed: int) -> None:
    """Noise, runs of 0xFD, bad checksums, bad lengths, lost bytes, unknown ids: the best possible yield."""
    data, touched = spoiled(random.Random(f"{damage} {seed}"), damage)
    frames, payloads, salvage = scan_payloads(data)
    columns = (frames[name].tolist() for name in ("msgid", "sysid", "compid", "seq"))
    expected = [as_found(record[8:]) for i, record in enumerate(undamaged()) if not lost or i not in touched]
    assert list(zip(*columns, payloads, strict=True)) == expected
    assert len(expected) == N - lost
    assert salvage.bad_crc <= (lost if damage == "crc" else 50)
    if damage == "unknown":
        assert (salvage.unverified, salvage.skipped_bytes) == (50, 0)
    if damage == "crc":
        assert salvage.bad_crc == 200
        assert salvage.skipped_bytes == sum(len(undamaged()[i]) for i in touched)


@pytest.mark.parametrize("seed", range(3))
def test_several_damages_at_once_are_survived_too(seed: int) -> None:
    """Noise, bad checksums, bad lengths, cut frames, all in one recording: each costs what it touched."""
    dice = random.Random(seed)
    out, kept = [], []
    for record in undamaged()[:1500]:
        fate, spoilt = dice.random(), bytearray(record)
        if fate < 0.01:
            spoilt[dice.randrange(8, len(record))] ^= 1 << dice.randrange(8)
        elif fate < 0.02:
            at = dice.randrange(8, len(record))
            del spoilt[at : at + dice.randrange(1, len(record) - at + 1)]
        else:
            kept.append(as_found(record[8:]))
        out.append(bytes(spoilt))
        if dice.random() < 0.01:
            out.append(dice.randbytes(dice.randrange(1, 300)))
    assert not Counter(kept) - Counter(found(b"".join(out)))


# --- pieces ----------------------------------------------------------------------------------------------------------

FIELDS = ["offset", "t_rx_us", "length", "msgid", "sysid", "compid", "seq", "duplicate", "lost"]


def stream_of(data: bytes) -> bytes:
    """A recording's frames without their times."""
    return b"".join(record[8:] for record in records(data))


def assert_pieces_change_nothing(data: bytes, size: int, *, timed: bool) -> None:
    whole, whole_payloads, whole_salvage = scan_payloads(data, timed=timed)
    frames, payloads, salvage = scan_payloads(data, timed=timed, sizes=[size] * (len(data) // size + 1))
    for field in FIELDS:
        assert np.array_equal(frames[field], whole[field]), field
    assert payloads == whole_payloads
    assert salvage == whole_salvage


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("timed", [True, False], ids=["recording", "stream"])
@pytest.mark.parametrize("size", [65536, 4099, 97])
@pytest.mark.parametrize("name", [DAMAGED, SIGNED, VERSION_1])
def test_pieces_of_any_size_give_the_same(name: str, size: int, timed: bool) -> None:
    """Frames, payloads, losses, repetitions, gaps and counts are bit for bit those of the whole."""
    data = recording(name)
    assert_pieces_change_nothing(data if timed or name == DAMAGED else stream_of(data), size, timed=timed)


@pytest.mark.slow
@pytest.mark.parametrize("timed", one_in(2, [True, False]), ids=["recording", "stream"])
@pytest.mark.parametrize("name", [DAMAGED, SIGNED, VERSION_1])
def test_one_byte_at_a_time_gives_the_same(name: str, timed: bool) -> None:
    """A serial line that delivers byte by byte loses nothing and invents nothing."""
    data = recording(name)[:12_000]
    assert_pieces_change_nothing(
        data if timed or name == DAMAGED else stream_of(recording(name))[:12_000], 1, timed=timed
    )


@pytest.mark.parametrize("timed", [True, False], ids=["recording", "stream"])
@pytest.mark.parametrize("damage", one_in(3, ["random", "markers", "crc", "length", "lost", "unknown"]))
def test_pieces_of_a_damaged_recording_give_the_same(damage: str, timed: bool) -> None:
    """The cut never decides what a gap swallows."""
    data = spoiled(random.Random(damage), damage)[0][:60_000]
    assert_pieces_change_nothing(data, 61, timed=timed)


@pytest.mark.parametrize("kind", ["recording", "stream", "datagrams"])
@pytest.mark.parametrize("damage", ["random", "markers", "length"])
def test_pieces_scanned_together_give_what_they_give_one_by_one(damage: str, kind: str) -> None:
    """Several pieces in one call: the same frames with their times and bytes, the same counts; also as datagrams."""
    dice, timed = random.Random(damage), kind == "recording"
    data = spoiled(random.Random(damage), damage)[0][:30_000]
    at = [0, *sorted(dice.sample(range(len(data)), 200)), len(data)]
    pieces = [data[lo:hi] for lo, hi in pairwise(at)]
    final = kind == "datagrams"
    single, together = (Scanner(load_dialect(), timed=timed) for _ in range(2))
    frames, raw = [], []
    for t_rx_us, piece in enumerate(pieces):
        frames.append(single.scan(piece, t_rx_us=t_rx_us, final=final).copy())
        raw += single.raw_frames()
    expected = np.concatenate(frames)
    found, found_raw = [], []
    for lo in range(0, len(pieces), 7):
        some = pieces[lo : lo + 7]
        ends = np.cumsum([len(one) for one in some])
        times = np.arange(lo, lo + len(some))
        found.append(together.scan_chunks(np.frombuffer(b"".join(some), np.uint8), ends, times, whole=final))
        found_raw += together.raw_frames()
    whole = np.concatenate(found)
    assert len(whole) > 100
    for name in sorted(set(expected.dtype.names or ()) - {"payload"}):
        assert whole[name].tolist() == expected[name].tolist(), name
    assert found_raw == raw
    assert together.salvage == single.salvage


def test_frames_cut_in_the_middle_of_a_datagram_do_not_join_the_next() -> None:
    """With `final` nothing is kept: half a frame in one datagram and its rest in the next are no frame."""
    scanner = Scanner(load_dialect(), timed=False)
    frame = wire.heartbeat()
    assert len(scanner.scan(frame + frame[:9], final=True)) == 1
    assert len(scanner.scan(frame[9:], final=True)) == 0
    assert len(scanner.scan(frame, final=True)) == 1
    assert scanner.salvage.skipped_bytes == len(frame)


# --- what is a frame -------------------------------------------------------------------------------------------------


def test_both_versions_and_signed_frames_are_read_side_by_side() -> None:
    """MAVLink 1 and 2, signed and not, mixed on one link as behind a SiK radio."""
    frames = [
        wire.heartbeat(seq=0, version=1),
        wire.heartbeat(seq=1),
        wire.heartbeat(seq=2, key=bytes(32)),
        wire.attitude(5, (0.1, 0.2, 0.3), seq=3, version=1),
        wire.attitude(6, (0.1, 0.2, 0.3), seq=4, key=bytes(range(32))),
        wire.heartbeat(seq=5),
    ]
    for timed in (True, False):
        data = wire.tlog((wire.START_US + i, frame) for i, frame in enumerate(frames)) if timed else b"".join(frames)
        assert found(data, timed=timed) == [as_found(frame) for frame in frames]
        assert scan(data, timed=timed)[1].signed == 2


@pytest.mark.parametrize("flags", [0x02, 0x03, 0x40, 0x80, 0xFE])
@pytest.mark.parametrize("timed", [True, False], ids=["recording", "stream"])
def test_an_unknown_incompatibility_flag_is_never_a_frame(flags: int, timed: bool) -> None:
    """The protocol says to discard such a packet, however right its checksum; those around it are read."""
    around = [wire.heartbeat(seq=0), wire.heartbeat(seq=2)]
    frame = bytearray(wire.attitude(1000, (0.1, 0.2, 0.3), seq=1))
    frame[2] = flags
    odd = wire.with_checksum(bytes(frame), 39) + (bytes(13) if flags & 1 else b"")
    sent = [around[0], odd, around[1]]
    data = wire.tlog((wire.START_US + i, f) for i, f in enumerate(sent)) if timed else b"".join(sent)
    assert found(data, timed=timed) == [as_found(f) for f in around]
    assert scan(data, timed=timed)[1].unverified == 1


@pytest.mark.parametrize("low", [0xFD, 0xFE, 0xFDFD, 0xFEFD, 0xFD09, 0xFE09])
def test_frame_markers_inside_record_times_are_no_frames(low: int) -> None:
    """0xFD and 0xFE occur in the times of 3 % of all records."""
    start = wire.START_US // 2**40 * 2**40
    times = sorted({start + k * 2**24 + low * 256**shift for k in range(20) for shift in range(3)})
    sent = [(t, wire.attitude(t % 1000, (0.1, 0.2, 0.3), seq=i)) for i, t in enumerate(times)]
    frames, payloads, salvage = scan_payloads(wire.tlog(sent))
    assert frames["t_rx_us"].tolist() == times
    assert payloads == [as_found(frame)[4] for _, frame in sent]
    assert salvage.skipped_bytes == 0


def test_an_unknown_id_is_counted_and_never_a_frame() -> None:
    """Nobody can check it: it is stepped over, as many times as it comes, and its bytes count as read."""
    unknown = struct.pack("<BBBBBBB", 0xFD, 3, 0, 0, 9, 1, 1) + UNKNOWN_ID.to_bytes(3, "little") + b"abc" + b"\1\2"
    sent = [wire.heartbeat(seq=0), unknown, unknown, unknown, wire.heartbeat(seq=1)]
    frames, salvage = scan(wire.tlog((wire.START_US + i, frame) for i, frame in enumerate(sent)))
    assert frames["msgid"].tolist() == [0, 0]
    assert (salvage.frames, salvage.unverified, salvage.gap_count) == (2, 3, 0)


def test_a_frame_longer_than_the_message_is_a_frame() -> None:
    """A newer dialect appends extension fields: the checksum seed stays, so the frame is verified and read."""
    frame = wire.attitude(1, (0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    longer = bytearray(frame[:-2] + b"\x11\x22\x33" + frame[-2:])
    longer[1] += 3
    ((msgid, _, _, _, payload),) = found(wire.with_checksum(bytes(longer), 39), timed=False)
    assert (msgid, payload) == (30, as_found(frame)[4] + b"\x11\x22\x33")


# --- gaps ------------------------------------------------------------------------------------------------------------


def good(count: int, first: int = 0) -> bytes:
    return wire.tlog(
        (wire.START_US + 40_000 * i, wire.attitude(40 * i, (0.1, 0.2, 0.01 * i + 0.01), seq=i))
        for i in range(first, first + count)
    )


def test_gaps_have_the_place_and_the_length_of_what_was_put_in() -> None:
    """Noise between records is a gap from its first byte to its last; read_fraction is the share of the rest."""
    a, b, c = good(3), good(4, 3), good(2, 7)
    noise, text = bytes(50), b"GARBAGE" * 9
    data = a + noise + b + text + c
    frames, salvage = scan(data)
    assert len(frames) == 9
    assert salvage.gaps == [(len(a), 50), (len(a) + 50 + len(b), 63)]
    assert (salvage.gap_count, salvage.skipped_bytes, salvage.bytes) == (2, 113, len(data))
    assert salvage.read_fraction == pytest.approx(1 - 113 / len(data), rel=1e-12)


def test_neighbouring_bad_frames_are_one_gap() -> None:
    """Three bad checksums in a row: counted three times, one stretch of bytes."""
    data = bytearray(good(10))
    size = len(data) // 10
    for i in (4, 5, 6):
        data[(i + 1) * size - 1] ^= 0xFF
    frames, salvage = scan(bytes(data))
    assert frames["seq"].tolist() == [0, 1, 2, 3, 7, 8, 9]
    assert (salvage.bad_crc, salvage.gaps) == (3, [(4 * size, 3 * size)])


def test_a_truncated_tail_costs_the_last_record_alone() -> None:
    """Recorders are switched off in mid-write; wherever that cuts, the rest is read and the cut is shown."""
    data = good(6)
    size = len(data) // 6
    for cut in range(1, size):
        frames, salvage = scan(data[:-cut])
        assert len(frames) == 5
        assert salvage.gaps == [(5 * size, size - cut)]


def test_trailing_zeros_are_a_gap() -> None:
    """QGroundControl has left megabytes of them behind good records (QGC#14210)."""
    frames, salvage = scan(good(6) + bytes(5000))
    assert len(frames) == 6
    assert salvage.gaps == [(len(good(6)), 5000)]


def test_the_first_hundred_gaps_are_kept_and_all_are_counted() -> None:
    """The list is bounded, the counters are not."""
    data = b"".join(good(1, i) + b"noise" for i in range(130))
    _, salvage = scan(data)
    assert (len(salvage.gaps), salvage.gap_count, salvage.skipped_bytes) == (100, 130, 650)
    assert salvage.gaps[99] == (100 * len(good(1)) + 99 * 5, 5)


def test_nothing_at_all_is_no_gap_and_has_no_share() -> None:
    """An empty file has no bytes of which a share could be read."""
    frames, salvage = scan(b"")
    assert (len(frames), salvage.gap_count, salvage.read_fraction) == (0, 0, None)


def test_a_recording_that_starts_in_the_middle_of_a_record_is_read_from_the_next() -> None:
    """As the head of a file cut by a tool: one gap, then every record."""
    data = good(6)
    for cut in range(1, len(data) // 6):
        frames, salvage = scan(data[cut:])
        assert frames["seq"].tolist()[-5:] == [1, 2, 3, 4, 5]
        assert len(frames) == 5 or cut <= 8  # a cut within the time leaves the frame itself whole
        assert frames["t_rx_us"].tolist()[-5:] == [wire.START_US + 40_000 * i for i in range(1, 6)]
        assert salvage.gap_count == (cut != 8)  # a record without its time alone is read to its last byte


# --- repair ----------------------------------------------------------------------------------------------------------


def cut_zeros(frame: bytes, count: int) -> bytes:
    """The frame as a recorder leaves it that cuts `count` trailing zeros of the payload and keeps the checksum."""
    end = 10 + frame[1]
    assert frame[end - count : end] == bytes(count)
    return bytes([0xFD, frame[1] - count]) + frame[2 : end - count] + frame[end:]


def untruncated(message: Any, crc_extra: int, seq: int) -> bytes:
    """A frame that a sender left at its full length, zeros included."""
    frame = wire.pack(message, seq=seq)
    payload = frame[10 : 10 + frame[1]].ljust(message.unpacker.size, b"\0")
    return wire.with_checksum(bytes([0xFD, len(payload)]) + frame[2:10] + payload + b"\0\0", crc_extra)


def test_a_frame_that_passes_with_its_zeros_put_back_is_repaired_and_counted() -> None:
    """Some recorders cut trailing zeros and keep the old checksum: padded to the end of a field it holds."""
    message = mavlink.MAVLink_attitude_quaternion_message(77, 1, 0, 0, 0, 0.5, 0, 0)
    full = untruncated(message, 246, seq=1)
    assert full[1] == 48
    cut = cut_zeros(full, 48 - 24)  # behind rollspeed 0.5, whose last byte is 0x3F
    data = wire.tlog(
        [(wire.START_US, wire.heartbeat()), (wire.START_US + 1, cut), (wire.START_US + 2, wire.heartbeat(seq=2))]
    )
    frames, payloads, salvage = scan_payloads(data)
    assert frames["msgid"].tolist() == [0, 31, 0]
    assert payloads[1] == full[10:34]
    assert (salvage.repaired_crc, salvage.bad_crc, salvage.gap_count, salvage.frames) == (1, 0, 0, 3)


def test_a_frame_that_no_padding_mends_stays_bad() -> None:
    """A repair is a proof by checksum, not a benefit of the doubt."""
    message = mavlink.MAVLink_attitude_quaternion_message(77, 1, 0, 0, 0, 0.5, 0, 0)
    cut = bytearray(cut_zeros(untruncated(message, 246, seq=1), 24))
    cut[12] ^= 1
    data = wire.tlog([(wire.START_US, bytes(cut)), (wire.START_US + 1, wire.heartbeat(seq=2))])
    frames, salvage = scan(data)
    assert (frames["msgid"].tolist(), salvage.repaired_crc, salvage.bad_crc) == ([0], 0, 1)


# --- sequence: losses and repetitions --------------------------------------------------------------------------------


def losses(sequence: Sequence[int]) -> list[int]:
    frames, _ = scan(b"".join(wire.attitude(i, (0, 0, 1.0), seq=seq) for i, seq in enumerate(sequence)), timed=False)
    return frames["lost"].tolist()  # type: ignore[no-any-return]  # untyped in numpy


def test_losses_are_what_the_sequence_misses_across_the_wrap() -> None:
    """254, 255, then 0 misses nothing; 254 then 1 misses two."""
    assert losses([253, 254, 255, 0, 1]) == [0, 0, 0, 0, 0]
    assert losses([254, 1, 2, 5]) == [0, 2, 2, 4]


def test_losses_are_counted_per_component() -> None:
    """Each (system, component) counts its own frames; a camera's sequence says nothing about the autopilot's."""
    sent = [(1, 1, 10), (1, 2, 200), (2, 1, 90), (1, 1, 11), (1, 2, 202), (2, 1, 91)]
    data = b"".join(wire.heartbeat(sysid=s, compid=c, seq=q) for s, c, q in sent)
    assert scan(data, timed=False)[0]["lost"].tolist() == [0, 0, 0, 0, 1, 0]


@pytest.mark.parametrize("late", [7, 255, 0, 1, 254])
@pytest.mark.parametrize("by", [1, 2, 5, 9])
def test_a_frame_that_comes_late_is_no_loss(late: int, by: int) -> None:
    """It was missed for a moment; once it is there nothing is lost, wherever the sequence stands."""
    sequence = [(late + k) % 256 for k in range(-4, 20)]
    moved = sequence[:4] + sequence[5 : 5 + by] + [late] + sequence[5 + by :]
    assert losses(moved)[-1] == 0


def test_neighbours_that_come_late_together_are_no_loss() -> None:
    """A datagram with two frames that another one overtook."""
    assert losses([10, 13, 11, 12, 14, 15])[-1] == 0
    assert losses([253, 1, 254, 255, 0, 2, 3])[-1] == 0


def test_a_sequence_that_starts_anew_is_not_a_loss_of_hundreds() -> None:
    """After a reboot the sequence begins near zero again."""
    assert losses([198, 199, 200, 0, 1, 2, 3])[-1] <= 56  # what a mere gap from 200 to 0 would be
    assert losses([100, 101, 102, 0, 1, 2, 3])[-1] == 0


def test_the_same_frame_twice_within_a_second_is_a_duplicate() -> None:
    """MAVProxy logs a frame once per link; whether 1 µs or 1 s later, it is the same; later it is not."""
    frame = wire.attitude(1000, (0.1, 0.2, 0.3), seq=9)
    for later_us, duplicates in ((0, 1), (1, 1), (1_000_000, 1), (1_000_001, 0), (90_000_000, 0)):
        frames, salvage = scan(wire.tlog([(wire.START_US, frame), (wire.START_US + later_us, frame)]))
        assert frames["duplicate"].tolist() == [0, duplicates]
        assert (salvage.duplicates, salvage.frames) == (duplicates, 2)


def test_a_different_frame_with_the_same_sequence_is_no_duplicate() -> None:
    """Payload, message, system and component must all be the same: some radios repeat sequence numbers."""
    frames = [
        wire.attitude(1000, (0.1, 0.2, 0.3), seq=9),
        wire.attitude(1000, (0.1, 0.2, 0.31), seq=9),
        wire.attitude_quaternion(1000, (1, 0, 0, 0), seq=9),
        wire.attitude(1000, (0.1, 0.2, 0.3), seq=9, compid=2),
        wire.attitude(1000, (0.1, 0.2, 0.3), seq=9, sysid=2),
        wire.attitude(1000, (0.1, 0.2, 0.3), seq=10),
    ]
    _, salvage = scan(wire.tlog((wire.START_US + i, frame) for i, frame in enumerate(frames)))
    assert salvage.duplicates == 0


def test_one_byte_makes_another_frame() -> None:
    """Whichever byte of the payload differs, the second frame is no repetition of the first."""
    frame = wire.attitude_quaternion(1000, (0.5, 0.5, 0.5, 0.5), (0.1, 0.2, 0.3), (0.1, 0.2, 0.3, 0.4), seq=9)
    for at in range(10, len(frame) - 2):
        other = wire.with_checksum(frame[:at] + bytes([frame[at] ^ 0x40]) + frame[at + 1 :], 246)
        assert scan(wire.tlog([(wire.START_US, frame), (wire.START_US, other)]))[1].duplicates == 0
        assert scan(wire.tlog([(wire.START_US, other), (wire.START_US, other)]))[1].duplicates == 1


def test_duplicates_do_not_disturb_the_loss_counter() -> None:
    """Every frame logged twice: nothing is lost."""
    sent = [(wire.START_US + 5000 * i, wire.heartbeat(seq=i // 2)) for i in range(600)]
    frames, salvage = scan(wire.tlog(sent))
    assert (salvage.duplicates, frames["lost"].max()) == (300, 0)


# --- record times ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [0, 1, 2**63, 2**64 - 1, 0xFDFDFDFDFDFDFDFD, wire.START_US + 400 * 86_400_000_000])
def test_an_impossible_record_time_is_counted_and_not_believed(bad: int) -> None:
    """One wrong time among good ones: the frame is read, at the time of the record before it."""
    sent = [(wire.START_US + 40_000 * i, wire.attitude(40 * i, (0, 0, 1.0), seq=i)) for i in range(10)]
    expected = [t for t, _ in sent]
    sent[5] = (bad, sent[5][1])
    expected[5] = expected[4]
    frames, salvage = scan(wire.tlog(sent))
    assert frames["t_rx_us"].tolist() == expected
    assert (salvage.bad_times, salvage.frames) == (1, 10)


@pytest.mark.parametrize("step_us", [-3_600_000_000, -1_000_000, 3_600_000_000, 400 * 86_400_000_000])
def test_a_clock_that_is_set_is_believed(step_us: int) -> None:
    """NTP, summer time, a laptop's clock set right in flight: all later records agree, so nothing is a bad time."""
    sent = [(wire.START_US + 40_000 * i + step_us * (i >= 5), wire.heartbeat(seq=i)) for i in range(10)]
    frames, salvage = scan(wire.tlog(sent))
    assert frames["t_rx_us"].tolist() == [t for t, _ in sent]
    assert salvage.bad_times == 0


@pytest.mark.parametrize("bad", [5, 2**63 + 5, 2**64 - 1])
def test_a_wrong_time_of_the_first_record_is_not_believed(bad: int) -> None:
    """It would put the recording's start into 1970, and --from and --to with it."""
    sent = [(wire.START_US + 40_000 * i, wire.heartbeat(seq=i)) for i in range(10)]
    frames, salvage = scan(wire.tlog([(bad, sent[0][1]), *sent[1:]]))
    assert len(frames) == 10
    assert salvage.bad_times == 1
    assert frames["t_rx_us"][0] == -1 or frames["t_rx_us"][0] >= wire.START_US


# --- properties ------------------------------------------------------------------------------------------------------

SLOW = searched(150, suppress_health_check=[HealthCheck.too_slow])

_seeds = [wire.heartbeat(), wire.attitude(1, (0.1, 0.2, 0.3)), wire.heartbeat(version=1), wire.heartbeat(key=bytes(32))]
_bits = st.one_of(
    st.binary(max_size=40),
    st.sampled_from([*_seeds, *(wire.record(wire.START_US, frame) for frame in _seeds)]),
    st.builds(lambda frame, at: frame[: at % len(frame)], st.sampled_from(_seeds), st.integers(0, 300)),
    st.sampled_from([b"\xfd", b"\xfe", b"\xfd" * 30, b"\xfe" * 30, bytes(8), struct.pack(">Q", wire.START_US)]),
)


@pytest.mark.slow
@SLOW
@given(st.lists(_bits, max_size=12), st.booleans(), st.lists(st.integers(1, 60), max_size=30))
def test_any_bytes_are_read_without_error_and_no_false_frame_is_given(
    parts: list[bytes], timed: bool, sizes: list[int]
) -> None:
    """Whatever comes on a link: no exception, no frame that pymavlink's checksum denies, the same in any pieces."""
    data = b"".join(parts)
    frames, payloads, salvage = scan_payloads(data, timed=timed)
    assert all(crc_holds_at(data, offset) for offset in frames["offset"].tolist())
    in_pieces, pieces_payloads, pieces_salvage = scan_payloads(data, timed=timed, sizes=sizes)
    assert all(np.array_equal(frames[name], in_pieces[name]) for name in FIELDS)
    assert (payloads, salvage) == (pieces_payloads, pieces_salvage)
    assert salvage.bytes == len(data)
    assert 0 <= salvage.skipped_bytes <= len(data)
    assert all(offset >= 0 and length > 0 and offset + length <= len(data) for offset, length in salvage.gaps)


def scanned(batches: Sequence[Sequence[bytes]], *, timed: bool, whole: bool, at_once: bool) -> tuple[Any, ...]:
    """What chunks yield, each received a µs behind the one before, scanned a batch at a time or one by one."""
    scanner = Scanner(load_dialect(), timed=timed)
    yielded: list[tuple[Any, ...]] = []
    raw: list[RawFrame] = []

    def keep(frames: np.ndarray) -> None:
        payloads = [scanner.buffer[at : at + n].tobytes() for at, n in frames[["payload", "length"]].tolist()]
        yielded.extend(zip(*(frames[name].tolist() for name in (*FIELDS, "verified")), payloads, strict=True))
        raw.extend(scanner.raw_frames())

    t_rx_us = wire.START_US
    for batch in batches:
        if at_once:
            data, ends = np.frombuffer(b"".join(batch), np.uint8), np.cumsum([len(chunk) for chunk in batch], dtype=int)
            keep(scanner.scan_chunks(data, ends, t_rx_us + np.arange(len(batch)), whole=whole))
        else:
            for i, chunk in enumerate(batch):
                keep(scanner.scan(chunk, t_rx_us=t_rx_us + i, final=whole))
        t_rx_us += len(batch)
    keep(scanner.scan(b"", t_rx_us=t_rx_us, final=True))
    return yielded, raw, scanner.salvage


@pytest.mark.slow
@SLOW
@given(st.lists(st.lists(_bits, max_size=8), max_size=4), st.sampled_from(["recording", "stream", "datagrams"]))
def test_chunks_at_once_are_chunks_one_by_one(batches: list[list[bytes]], kind: str) -> None:
    """To the byte: frames and their times, what is recorded, what was lost; however they are cut and damaged."""
    how = {"timed": kind == "recording", "whole": kind == "datagrams"}
    assert scanned(batches, at_once=True, **how) == scanned(batches, at_once=False, **how)


@pytest.mark.parametrize("kind", ["recording", "stream", "datagrams"])
@pytest.mark.parametrize("damage", ["length", "unknown"])
def test_chunks_of_a_damaged_flight_at_once_are_chunks_one_by_one(damage: str, kind: str) -> None:
    """Some hundred at a time, with whatever reaches across their borders."""
    dice = random.Random(damage)
    data = spoiled(dice, damage)[0][:40_000]
    cuts = [0, *sorted(dice.sample(range(1, len(data)), 700)), len(data)]
    chunks = [data[start:end] for start, end in pairwise(cuts)]
    batches = [chunks[at : at + 150] for at in range(0, len(chunks), 150)]
    how = {"timed": kind == "recording", "whole": kind == "datagrams"}
    at_once = scanned(batches, at_once=True, **how)
    assert at_once == scanned(batches, at_once=False, **how)
    assert len(at_once[0]) > 20


@cache
def short_flight() -> tuple[bytes, ...]:
    return tuple(records(recording(COPTER)))[500:620]


def damaged(cuts: list[tuple[int, int, bytes]]) -> tuple[bytes, list[Found]]:
    """A good recording after damages (place, bytes removed, bytes put in), and the frames of the records left whole."""
    rows = short_flight()
    data = bytearray(b"".join(rows))
    owner = np.repeat(np.arange(len(rows)), [len(row) for row in rows]).tolist()
    for at, removed, put_in in cuts:
        data[at : at + removed] = put_in
        owner[at : at + removed] = [-1] * len(put_in)
    owners = np.array(owner)
    places = [np.flatnonzero(owners == i) for i in range(len(rows))]
    whole = [len(p) == len(row) == p[-1] - p[0] + 1 if len(p) else False for p, row in zip(places, rows, strict=True)]
    return bytes(data), [as_found(row[8:]) for row, left in zip(rows, whole, strict=True) if left]


_cut = st.tuples(st.integers(0, 5000), st.integers(0, 40), st.binary(max_size=40))


@pytest.mark.slow
@SLOW
@given(st.lists(_cut, max_size=4))
def test_damage_anywhere_loses_no_frame_that_it_did_not_touch(cuts: list[tuple[int, int, bytes]]) -> None:
    """Bytes removed, replaced or put in: each record left whole is found, unless a damaged unknown id hides it."""
    data, whole = damaged(cuts)
    _, salvage = scan(data)
    missed = Counter(whole) - Counter(found(data))
    assert not missed or salvage.unverified
