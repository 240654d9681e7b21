"""Faults put into recordings: what changed, that it changed rightly, and that nothing else did.

pymavlink reads and packs, SciPy turns; neither shares a line with the code under test.
"""

import json
import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import all as mavlink
from pymavlink.generator.mavcrc import x25crc
from scipy.spatial.transform import Rotation

from gcs_bridge.errors import GcsBridgeError, SourceError, UsageError
from gcs_bridge.recordings.faults import Fault, parse_fault
from gcs_bridge.recordings.inject import StreamAbsentError, inject, inject_file
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES

Array = NDArray[np.float64]

ATTITUDE, QUATERNION = 30, 31


class Record(NamedTuple):
    """One record of an undamaged recording."""

    time_us: int
    frame: bytes

    @property
    def signed(self) -> bool:
        return self.frame[0] == 0xFD and bool(self.frame[2] & 1)

    @property
    def msgid(self) -> int:
        return int.from_bytes(self.frame[7:10], "little") if self.frame[0] == 0xFD else self.frame[5]

    @property
    def sysid(self) -> int:
        return self.frame[5] if self.frame[0] == 0xFD else self.frame[3]

    @property
    def message(self) -> Any:
        """The message, read by pymavlink, which raises MAVError where the checksum is wrong."""
        return mavlink.MAVLink(None).decode(bytearray(self.frame))


def records(data: bytes) -> Iterator[Record]:
    """The records of an undamaged recording, one behind the other to the last byte."""
    at = 0
    while at < len(data):
        v2, length = data[at + 8] == 0xFD, data[at + 9]
        size = (12 + 13 * (data[at + 10] & 1) if v2 else 8) + length
        frame = data[at + 8 : at + 8 + size]
        assert len(frame) == size
        yield Record(int.from_bytes(data[at : at + 8], "big"), frame)
        at += 8 + size


def recording(name: str, count: int | None = None) -> bytes:
    """A fixture, or its first `count` records."""
    data = (FIXTURES / f"{name}.tlog").read_bytes()
    return data if count is None else joined(list(records(data))[:count])


def joined(parts: list[Record]) -> bytes:
    return b"".join(part.time_us.to_bytes(8, "big") + part.frame for part in parts)


def faulty(data: bytes, *faults: str, **options: Any) -> bytes:
    return inject(data, [parse_fault(fault) for fault in faults], **options)


def tlog(*messages: Any, sysid: int = 1, step_us: int = 100_000, start_us: int = 10**15) -> bytes:
    """A recording of messages, packed by pymavlink."""
    mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
    frames = []
    for message in messages:
        frames.append(message.pack(mav))
        mav.seq = (mav.seq + 1) % 256
    return joined([Record(start_us + i * step_us, bytes(frame)) for i, frame in enumerate(frames)])


def quaternion(time_ms: int, *q: float, **more: Any) -> Any:
    return mavlink.MAVLink_attitude_quaternion_message(time_ms, *q, 0, 0, 0, **more)


def changed(before: bytes, after: bytes) -> list[tuple[Record, Record]]:
    """The records that differ; all others are the same, byte for byte, and so is every time."""
    pairs = list(zip(records(before), records(after), strict=True))
    assert all(one.time_us == other.time_us for one, other in pairs)
    return [(one, other) for one, other in pairs if one.frame != other.frame]


def rpy_of(message: Any) -> Array:
    """Roll, pitch and yaw of either attitude message, by SciPy."""
    if message.get_msgId() == ATTITUDE:
        return np.array([message.roll, message.pitch, message.yaw])
    rpy: Array = Rotation.from_quat([message.q2, message.q3, message.q4, message.q1]).as_euler("ZYX")[::-1]
    return rpy


@pytest.mark.slow
def test_rates_of_the_angles_are_sent_by_both_messages() -> None:
    """Both carry what their angles change by; turned back with the angles it is the body's rates."""
    data = recording("b_copter_acro", 3000)
    pairs = changed(data, faulty(data, "euler_rates"))
    assert {before.msgid for before, _ in pairs} == {ATTITUDE, QUATERNION}
    assert len(pairs) > 0.9 * sum(record.msgid in (ATTITUDE, QUATERNION) for record in records(data)) > 500
    for before, after in pairs:
        roll, pitch, _ = rpy_of(before.message)
        phi, theta, psi = after.message.rollspeed, after.message.pitchspeed, after.message.yawspeed
        back = [
            phi - psi * np.sin(pitch),
            theta * np.cos(roll) + psi * np.cos(pitch) * np.sin(roll),
            psi * np.cos(pitch) * np.cos(roll) - theta * np.sin(roll),
        ]
        was = [before.message.rollspeed, before.message.pitchspeed, before.message.yawspeed]
        np.testing.assert_allclose(back, was, rtol=1e-5, atol=1e-5)
        assert packed_anew(before, rollspeed=phi, pitchspeed=theta, yawspeed=psi) == after.frame


def without_signature(frame: bytes) -> bytes:
    """A frame as it would have been sent unsigned, checksum aside."""
    return frame[:2] + b"\0" + frame[3:-15] if frame[0] == 0xFD and frame[2] & 1 else frame[:-2]


def packed_anew(record: Record, **fields: Any) -> bytes:
    """pymavlink's own frame with some fields replaced."""
    message = record.message
    values = {name: getattr(message, name) for name in message.fieldnames} | fields
    head = message.get_header()
    mav = mavlink.MAVLink(None, srcSystem=head.srcSystem, srcComponent=head.srcComponent)
    mav.seq = head.seq
    return bytes(type(message)(**values).pack(mav, force_mavlink1=record.frame[0] == 0xFE))


# --- causes --------------------------------------------------------------------------------------------------------


def rotation(q: Array) -> Rotation:
    return Rotation.from_quat(np.column_stack([q[:, 1:], q[:, 0]]))


def slots(R: Rotation) -> Array:
    """[w, x, y, z]."""
    xyzw = R.as_quat()
    return np.column_stack([xyzw[:, 3], xyzw[:, :3]])


P, D = Rotation.from_quat([[0.5**0.5, 0.5**0.5, 0, 0]]), Rotation.from_quat([[1.0, 0, 0, 0]])
YAW_25 = Rotation.from_euler("z", [25], degrees=True)
PITCH_4 = Rotation.from_euler("y", [4], degrees=True)

QUATERNION_SENT: dict[str, Callable[[Array], Array]] = {
    "quaternion_xyzw": lambda q: q[:, [1, 2, 3, 0]],
    "quaternion_conjugate": lambda q: q * [1, -1, -1, -1],
    "quaternion_unnormalised:1.2": lambda q: 1.2 * q,
    "world_enu": lambda q: slots(P * rotation(q)),
    "body_flu": lambda q: slots(rotation(q) * D),
    "enu_flu": lambda q: slots(P * rotation(q) * D),
    "yaw_offset:25": lambda q: slots(YAW_25 * rotation(q)),
    "mount_offset:0,4,0": lambda q: slots(rotation(q) * PITCH_4),
}
RPY_SENT: dict[str, Callable[[Array], Array]] = {
    "euler_xyz_order": lambda rpy: Rotation.from_euler("ZYX", rpy[:, ::-1]).as_euler("XYZ"),
    "euler_degrees": lambda rpy: rpy * 180 / np.pi,
    "roll_pitch_swapped": lambda rpy: rpy[:, [1, 0, 2]],
    "roll_sign": lambda rpy: rpy * [-1, 1, 1],
    "pitch_sign": lambda rpy: rpy * [1, -1, 1],
    "yaw_sign": lambda rpy: rpy * [1, 1, -1],
}


@pytest.mark.parametrize("fault", one_in(8, [*QUATERNION_SENT, *RPY_SENT]))
def test_each_cause_sends_what_the_contract_says(fault: str) -> None:
    """Every message of the stream, and nothing else, carries what SciPy makes of the wire's values; checksums hold."""
    msgid, fields, expected = (
        (QUATERNION, ("q1", "q2", "q3", "q4"), QUATERNION_SENT[fault])
        if fault in QUATERNION_SENT
        else (ATTITUDE, ("roll", "pitch", "yaw"), RPY_SENT[fault])
    )
    data = recording("a_copter_square", 1500)
    pairs = changed(data, faulty(data, fault))
    assert len(pairs) == sum(record.msgid == msgid for record in records(data)) > 100
    was, sent = (np.array([[getattr(pair[i].message, field) for field in fields] for pair in pairs]) for i in range(2))
    should = expected(was)
    if msgid == QUATERNION:  # the norm of the wire is not SciPy's to keep, nor the sign
        should *= np.sign((should * sent).sum(axis=1, keepdims=True))
        np.testing.assert_allclose(sent, should, rtol=0, atol=3e-7)
    else:
        np.testing.assert_allclose(sent, should, rtol=1e-6, atol=1e-7)
    for before, after in pairs:
        values = dict(zip(fields, (getattr(after.message, field) for field in fields), strict=True))
        assert packed_anew(before, **values) == after.frame


def test_yaw_30_level_by_hand() -> None:
    """Yaw 30°, level: scalar last, its slots w, x, y, z hold 0, 0, sin 15°, cos 15°."""
    data = tlog(quaternion(100, 0.9659258, 0, 0, 0.2588190))
    [(_, sent)] = changed(data, faulty(data, "quaternion_xyzw"))
    assert struct.unpack_from("<4f", sent.frame, 14) == struct.unpack(
        "<4f", struct.pack("<4f", 0, 0, 0.2588190, 0.9659258)
    )


def test_several_faults_are_made_in_their_order() -> None:
    """Conjugated and then moved, [w, x, y, z] is [-x, -y, -z, w]; moved and then conjugated, [x, -y, -z, -w]."""
    data = tlog(quaternion(100, 0.5, 0.25, -0.75, 1))
    [(_, sent)] = changed(data, faulty(data, "quaternion_conjugate", "quaternion_xyzw"))
    assert [sent.message.q1, sent.message.q2, sent.message.q3, sent.message.q4] == [-0.25, 0.75, -1, 0.5]
    [(_, sent)] = changed(data, faulty(data, "quaternion_xyzw", "quaternion_conjugate"))
    assert [sent.message.q1, sent.message.q2, sent.message.q3, sent.message.q4] == [0.25, 0.75, -1, -0.5]


@pytest.mark.parametrize(
    ("q", "expected", "length"),
    [([1, 0, 0, 0], [0, 0, 0, 1], 20), ([0, 0, 0, 1], [0, 0, 1, 0], 16), ([0.5] * 4, [0.5] * 4, 20)],
)
def test_trailing_zeros_are_cut_anew(q: list[float], expected: list[float], length: int) -> None:
    """A payload that ends in other zeros becomes longer or shorter, as pymavlink itself would pack it."""
    out = faulty(tlog(quaternion(100, *q)), "quaternion_xyzw")
    assert out == tlog(quaternion(100, *expected))
    assert out[9] == length


def test_mavlink_1_keeps_its_length() -> None:
    """Version 1 cuts no zeros: frames keep their length, version and place."""
    data = recording("g_mavlink1", 1000)
    pairs = changed(data, faulty(data, "yaw_offset:25"))
    assert {before.frame[0] for before, _ in pairs} == {0xFE}
    for before, after in pairs:
        assert len(before.frame) == len(after.frame)
        assert before.frame[:10] + before.frame[26:-2] == after.frame[:10] + after.frame[26:-2]
        assert after.message.q1 != before.message.q1


def test_a_signed_frame_loses_its_signature() -> None:
    """Falsified, it is unsigned and has a right checksum; every other frame keeps its signature."""
    data = recording("g_signed")
    pairs = changed(data, faulty(data, "roll_sign"))
    signed = [(before, after) for before, after in pairs if before.signed]
    assert len(signed) > 100
    for before, after in signed:
        assert not after.signed
        assert after.message.roll == -before.message.roll
        head, payload = without_signature(before.frame)[:10], after.frame[10:-2]
        assert after.frame[:10] == head
        assert payload[8:] == before.frame[18:-15]
    assert sum(record.signed for record in records(data)) - len(signed) == sum(
        record.signed for record in records(faulty(data, "roll_sign"))
    )


def test_what_a_newer_dialect_appended_stays() -> None:
    """Bytes behind the last field that this dialect knows are kept."""
    frame = bytearray(tlog(quaternion(100, 1, 0, 0, 0, repr_offset_q=[1, 2, 3, 4]))[8:-2])
    frame += b"\7\0\11"
    frame[1] += 3

    def sealed(raw: bytearray) -> bytes:
        crc = x25crc(raw[1:])
        crc.accumulate(bytes([mavlink.MAVLink_attitude_quaternion_message.crc_extra]))
        return bytes(raw) + int(crc.crc).to_bytes(2, "little")

    expected = frame.copy()
    expected[14:30] = struct.pack("<4f", 0, 0, 0, 1)
    assert faulty(bytes(8) + sealed(frame), "quaternion_xyzw") == bytes(8) + sealed(expected)


def test_what_is_no_attitude_is_sent_as_it_was() -> None:
    """A zero quaternion and one with NaN stay; a number too large for float32 becomes infinite, without a warning."""
    data = tlog(quaternion(1, 0, 0, 0, 0), quaternion(2, float("nan"), 0, 0, 1))
    assert faulty(data, "world_enu") == data
    data = tlog(mavlink.MAVLink_attitude_message(1, 3e38, 0, 0, 0, 0, 0))
    assert next(records(faulty(data, "euler_degrees"))).message.roll == float("inf")


def test_damage_stays_where_it_was() -> None:
    """In a damaged recording what pymavlink's reader finds is falsified in its place, and no other byte changes."""
    data = recording("h_lossy_dirty")
    out = faulty(data, "quaternion_xyzw")
    assert len(out) == len(data)
    rest, falsified = bytearray(data), 0
    for match in re.finditer(rb"(?s)(?=\xfd(.)[\0\1].{4}\x1f\0\0)", data):
        at = match.start()
        frame = Record(0, data[at : at + 12 + match[1][0]])
        try:
            was = frame.message
        except mavlink.MAVError:
            continue
        sent = Record(0, out[at : at + len(frame.frame)]).message
        if sent.to_dict() == was.to_dict():
            continue  # checksums alone find more than a reader can trust
        assert (sent.q1, sent.q2, sent.q3, sent.q4) == (was.q2, was.q3, was.q4, was.q1)
        rest[at : at + len(frame.frame)] = out[at : at + len(frame.frame)]
        falsified += 1
    assert (
        falsified >= json.loads((FIXTURES / "h_lossy_dirty.facts.json").read_text())["messages"]["ATTITUDE_QUATERNION"]
    )
    assert rest == out


def test_time_skew_wraps_as_the_field_does() -> None:
    """150 ms are added to the stamp, which begins anew after 2³² ms; the attitude stays."""
    data = tlog(quaternion(1000, 1, 0, 0, 0), quaternion(2**32 - 100, 1, 0, 0, 0))
    assert faulty(data, "time_skew") == tlog(quaternion(1150, 1, 0, 0, 0), quaternion(50, 1, 0, 0, 0))
    assert faulty(data, "time_skew:-1100") == tlog(
        quaternion(2**32 - 100, 1, 0, 0, 0), quaternion(2**32 - 1200, 1, 0, 0, 0)
    )


@pytest.mark.parametrize(("fault", "msgid"), [("frozen_quaternion", QUATERNION), ("frozen_euler", ATTITUDE)])
def test_a_frozen_stream_repeats_its_first_payload_while_time_goes_on(fault: str, msgid: int) -> None:
    """Each vehicle repeats its own first message after `from`, rates included, under the times of the others."""
    data = recording("e_two_vehicles")
    start = next(records(data)).time_us
    first: dict[int, bytes] = {}
    systems = set()
    for before, after in zip(records(data), records(faulty(data, fault, from_s=3)), strict=True):
        if before.msgid != msgid or before.time_us < start + 3_000_000:
            assert before == after
            continue
        systems.add(before.sysid)
        payload = first.setdefault(before.sysid, before.frame[14:-2])
        assert after.frame[10:14] == before.frame[10:14]
        assert after.frame[14:-2] == payload
        assert after.message.time_boot_ms == before.message.time_boot_ms
    assert len(systems) == 2
    assert len(set(first.values())) == 2


# --- which records -------------------------------------------------------------------------------------------------


def test_one_system_alone() -> None:
    """With a system id only that system's messages change, without one every vehicle's."""
    data = recording("e_two_vehicles")
    vehicles = {record.sysid for record in records(data) if record.msgid == QUATERNION}
    assert len(vehicles) == 2
    for sysid in vehicles:
        pairs = changed(data, faulty(data, "yaw_offset", sysid=sysid))
        assert {before.sysid for before, _ in pairs} == {sysid}
    assert {before.sysid for before, _ in changed(data, faulty(data, "yaw_offset"))} == vehicles


def test_an_interval_holds_its_beginning_and_not_its_end() -> None:
    """Seconds count from the first record: of ten records 0.1 s apart, [0.3, 0.6) touches the fourth to sixth."""
    data = tlog(*(quaternion(100 * i, 1, 0, 0, 0) for i in range(10)))
    touched = [
        before.message.time_boot_ms for before, _ in changed(data, faulty(data, "world_enu", from_s=0.3, to_s=0.6))
    ]
    assert touched == [300, 400, 500]
    assert len(changed(data, faulty(data, "world_enu", from_s=0.9))) == 1
    assert len(changed(data, faulty(data, "world_enu", to_s=0.25))) == 3


def test_the_interval_outlives_the_loss_of_the_first_record() -> None:
    """A later fault counts its seconds from the recording's own start, though an earlier one dropped it."""
    data = tlog(*(quaternion(100 * i, 1, 0, 0, 0) for i in range(5)))
    starts = set()
    for seed in range(20):
        left = [record.message for record in records(faulty(data, "loss:0.67", "world_enu", to_s=0.25, seed=seed))]
        assert len(left) == 3
        assert all((message.q1 == 0) == (message.time_boot_ms < 250) for message in left)
        starts.add(left[0].time_boot_ms)
    assert starts == {0, 100, 200}


def test_a_first_time_that_is_damaged_is_no_beginning() -> None:
    """Seconds count from the first record time that can be one."""
    data = b"\xff" * 8 + tlog(*(quaternion(100 * i, 1, 0, 0, 0) for i in range(5)))[8:]
    touched = [after for before, after in changed(data, faulty(data, "world_enu", from_s=0.15))]
    assert [record.message.time_boot_ms for record in touched] == [300, 400]


# --- faults of the link --------------------------------------------------------------------------------------------


def test_lost_records_are_gone_and_no_other() -> None:
    """A tenth of the records is missing; the rest is what it was, in its order."""
    data = recording("a_copter_square", 1000)
    out = faulty(data, "loss:0.1")
    left = list(records(out))
    assert len(left) == 900
    remaining = iter(records(data))
    assert all(record in remaining for record in left)


def test_duplicates_follow_their_originals() -> None:
    """A tenth of the records stands twice, the copy right behind; without the copies it is the old recording."""
    data = recording("a_copter_square", 1000)
    copied = list(records(faulty(data, "duplicate:0.1")))
    assert len(copied) == 1100
    once = [record for i, record in enumerate(copied) if i == 0 or record != copied[i - 1]]
    assert joined(once) == data


def test_a_copy_has_a_time_where_damage_took_the_originals() -> None:
    """Of a record that lost part of its time the copy has the time before it, not bytes of the frame before it."""
    first, second, third = records(tlog(*(quaternion(i, 1, 0, 0, 0) for i in range(3))))
    stump = joined([second])[5:]
    out = faulty(joined([first]) + stump + joined([third]), "duplicate:1")
    assert out == joined([first, first]) + stump + joined([second._replace(time_us=first.time_us), third, third])


def test_reordered_frames_change_places_with_the_next_of_their_system() -> None:
    """Times keep their order; 10 % of each system's frames come one place later, and those behind them one earlier."""
    data = recording("e_two_vehicles", 1000)
    before, after = list(records(data)), list(records(faulty(data, "reorder:0.1")))
    assert [record.time_us for record in before] == [record.time_us for record in after]
    for sysid in {record.sysid for record in before}:
        old = [record.frame for record in before if record.sysid == sysid]
        new = [record.frame for record in after if record.sysid == sysid]
        swaps, i = 0, 0
        while i < len(old):
            if old[i] != new[i]:
                assert [new[i + 1], new[i]] == old[i : i + 2]
                swaps, i = swaps + 1, i + 1
            i += 1
        assert swaps == max(round(0.1 * len(old)), 1) or len(old) == 1


def test_every_record_can_be_in_a_swap() -> None:
    """At one half, each pair of neighbours is swapped."""
    data = tlog(*(quaternion(i, 1, 0, 0, 0) for i in range(6)))
    assert [r.message.time_boot_ms for r in records(faulty(data, "reorder:0.5"))] == [1, 0, 3, 2, 5, 4]


def test_corrupt_bytes_are_within_frames() -> None:
    """One frame byte in a hundred is another one; the record times are untouched."""
    data = recording("a_copter_square", 1000)
    out = faulty(data, "corrupt:0.01")
    assert len(out) == len(data)
    at, frame_bytes, other = 0, 0, 0
    for record in records(data):
        assert out[at : at + 8] == data[at : at + 8]
        end = at + 8 + len(record.frame)
        other += sum(a != b for a, b in zip(data[at + 8 : end], out[at + 8 : end], strict=True))
        frame_bytes += len(record.frame)
        at = end
    assert other == round(0.01 * frame_bytes)


def test_truncated_recordings_lack_their_end() -> None:
    """The last bytes are gone, wherever records begin; interval and system don't matter."""
    data = recording("a_copter_square", 100)
    assert faulty(data, "truncate:13") == data[:-13]
    assert faulty(data, "truncate:13", sysid=1, from_s=0.1) == data[:-13]


@pytest.mark.parametrize(("rate_hz", "expected"), [(1, 5), (4, 20), (10, 50), (25, 125), (50, 125)])
def test_thinned_messages_keep_to_the_rate(rate_hz: int, expected: int) -> None:
    """Of five seconds at 25 Hz with 2 ms of jitter, a lower rate leaves what it asks for, a higher one everything."""
    times = 40 * np.arange(125) + np.random.default_rng(0).integers(1, 6, 125)
    data = tlog(*(quaternion(int(t), 1, 0, 0, 0) for t in times))
    kept = [r.message.time_boot_ms for r in records(faulty(data, f"thin:ATTITUDE_QUATERNION={rate_hz}"))]
    assert abs(len(kept) - expected) <= 1
    assert set(kept) <= set(times.tolist())


def test_thinning_counts_each_vehicle_and_leaves_other_messages() -> None:
    """Each vehicle keeps its own share of the one message."""
    data = recording("e_two_vehicles")
    out = faulty(data, "thin:ATTITUDE=5")

    def others(part: bytes) -> list[Record]:
        return [record for record in records(part) if record.msgid != ATTITUDE]

    assert others(out) == others(data)
    for sysid in {record.sysid for record in records(data) if record.msgid == ATTITUDE}:
        times = [r.message.time_boot_ms for r in records(out) if r.msgid == ATTITUDE and r.sysid == sysid]
        seconds = (times[-1] - times[0]) / 1e3
        assert 4.5 < (len(times) - 1) / seconds <= 5.0 + 1 / seconds


def test_thinning_goes_by_record_time_where_the_message_has_none() -> None:
    """Heartbeats carry no time: ten a second by their records become two."""
    data = tlog(*[mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)] * 21)
    assert [r.time_us - 10**15 for r in records(faulty(data, "thin:HEARTBEAT=2"))] == [
        0,
        300_000,
        800_000,
        1_300_000,
        1_800_000,
    ]


def test_thinning_goes_on_after_a_reboot() -> None:
    """Boot time that starts anew is a new beginning; a message that comes late is none, and is one too many."""
    times = [20_000, 20_100, 20_200, 20_110, 20_300, 0, 100, 200]
    data = tlog(*(quaternion(t, 1, 0, 0, 0) for t in times))
    kept = [r.message.time_boot_ms for r in records(faulty(data, "thin:ATTITUDE_QUATERNION=10"))]
    assert kept == [20_000, 20_100, 20_200, 20_300, 0, 100, 200]


@pytest.mark.parametrize("fault", ["loss:0.2", "reorder:0.2", "duplicate:0.2", "corrupt:0.01"])
def test_chance_is_seeded(fault: str) -> None:
    """The same seed makes the same recording, another seed another one."""
    data = recording("a_copter_square", 300)
    assert faulty(data, fault, seed=3) == faulty(data, fault, seed=3) != faulty(data, fault, seed=4)


@pytest.mark.parametrize("fault", ["loss", "reorder", "duplicate", "corrupt"])
def test_a_share_of_nothing_changes_nothing_and_a_small_one_something(fault: str) -> None:
    """A share of 0 is no fault; one that rounds to nothing still makes one."""
    data = recording("a_copter_square", 50)
    assert faulty(data, f"{fault}:0") == data
    assert faulty(data, f"{fault}:0.00001") != data


def test_the_link_of_one_vehicle_in_an_interval() -> None:
    """Faults of the link keep to the system and the interval as well."""
    data = recording("e_two_vehicles")
    sysid = next(record.sysid for record in records(data) if record.msgid == QUATERNION)
    start = next(records(data)).time_us
    expected = [r for r in records(data) if r.sysid != sysid or not start + 2_000_000 <= r.time_us < start + 4_000_000]
    assert faulty(data, "loss:1", sysid=sysid, from_s=2, to_s=4) == joined(expected)


def test_a_link_fault_in_a_damaged_recording_keeps_the_damage() -> None:
    """With every intact record lost, what is left are the bytes between them."""
    good = tlog(quaternion(1, 1, 0, 0, 0), quaternion(2, 1, 0, 0, 0))
    half = len(good) // 2
    assert faulty(good[:half] + b"damage" * 9 + good[half:], "loss:1") == b"damage" * 9


# --- whole recordings, bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", one_in(3, ["g_signed", "g_mavlink1", "e_two_vehicles"], swept=False))
def test_every_frame_is_still_good(name: str) -> None:
    """After several faults at once pymavlink reads every frame of the result."""
    out = faulty(recording(name), "mount_offset:3,4,5", "pitch_sign", "duplicate:0.05", "reorder:0.1", "loss:0.1")
    assert sum(record.message is not None for record in records(out)) > 2000


def test_no_fault_is_a_copy() -> None:
    """Without a fault the bytes come back as they were."""
    data = recording("h_lossy_dirty")
    assert inject(data, []) == data


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("yaw_offset", Fault("yaw_offset", (12.0,))),
        ("yaw_offset:-25", Fault("yaw_offset", (-25.0,))),
        ("mount_offset:0,4,0", Fault("mount_offset", (0.0, 4.0, 0.0))),
        ("quaternion_xyzw", Fault("quaternion_xyzw", ())),
        ("loss:0.2", Fault("loss", (0.2,))),
        ("truncate:100", Fault("truncate", (100.0,))),
        ("thin:attitude=4", Fault("thin", (4.0,), "ATTITUDE")),
    ],
)
def test_a_fault_is_a_name_and_a_value(text: str, expected: Fault) -> None:
    """The text of `--fault` becomes the fault, with the default where no value is given."""
    assert parse_fault(text) == expected


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("yaw_ofset:25", "unknown fault 'yaw_ofset'; did you mean 'yaw_offset'?"),
        ("qwerty", "unknown fault 'qwerty'; known: loss, "),
        ("estimator_reset", "estimator_reset can be diagnosed but not injected"),
        ("yaw_offset:400", "from -180 to 180 deg"),
        ("loss", "needs a value: it must be a number from 0 to 1"),
        ("reorder:0.6", "from 0 to 0.5"),
        ("truncate:0.5", "a whole number, 1 bytes or more"),
        ("truncate:inf", "a whole number, 1 bytes or more"),
        ("thin:ATTITUDE", "as thin:ATTITUDE_QUATERNION=10"),
        ("thin:=3", "as thin:ATTITUDE_QUATERNION=10"),
        ("thin:ATTITUDE=0", "from 0.001 to 1000 Hz"),
    ],
)
def test_a_wrong_fault_is_one_line(text: str, said: str) -> None:
    """What is wrong and what would be right, and exit code 2."""
    with pytest.raises(UsageError, match=re.escape(said)) as refused:
        parse_fault(text)
    assert "\n" not in str(refused.value)
    assert refused.value.exit_code == 2


@pytest.mark.parametrize("name", ["yaw", "unknown"])
def test_there_is_no_fault_that_cannot_be_made(name: str) -> None:
    """A fault made by hand is refused where its name is no fault's."""
    with pytest.raises(UsageError, match=name):
        Fault(name, ())


@pytest.mark.parametrize(
    ("fault", "options", "error", "said"),
    [
        ("yaw_offset", {"from_s": 1.0}, UsageError, "from 1 s is past the end: the recording lasts 0.2 s"),
        ("yaw_offset", {"from_s": -1.0}, UsageError, "0 or more"),
        ("yaw_offset", {"to_s": float("nan")}, UsageError, "0 or more"),
        ("yaw_offset", {"from_s": 0.05, "to_s": 0.05}, UsageError, "to 0.05 s is not after from 0.05 s"),
        ("yaw_offset", {"dialect": "klingon"}, UsageError, "unknown dialect 'klingon'"),
        ("yaw_offset", {"dialect": "minimal"}, UsageError, "minimal has no message 'ATTITUDE_QUATERNION'"),
        ("thin:ATITUDE=5", {}, UsageError, "has no message 'ATITUDE'"),
        ("truncate:100000", {}, UsageError, "truncate:100000 would leave nothing"),
        ("yaw_offset", {"sysid": 9}, StreamAbsentError, "no ATTITUDE_QUATERNION of system 9"),
        ("loss:0.1", {"sysid": 9}, StreamAbsentError, "no record of system 9"),
        ("roll_sign", {}, StreamAbsentError, "no ATTITUDE in the recording"),
        ("thin:VFR_HUD=5", {}, StreamAbsentError, "no VFR_HUD in the recording"),
        ("yaw_offset", {"from_s": 0.01, "to_s": 0.02}, StreamAbsentError, "from 0.01 s on up to 0.02 s"),
    ],
)
def test_what_cannot_be_done_is_refused(
    fault: str, options: dict[str, Any], error: type[GcsBridgeError], said: str
) -> None:
    """One line says why; the exit code is 2 for a wrong argument, 4 where there is nothing to falsify."""
    beat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
    data = tlog(quaternion(1, 1, 0, 0, 0), quaternion(2, 1, 0, 0, 0), beat)
    with pytest.raises(error, match=re.escape(said)) as refused:
        faulty(data, fault, **options)
    assert refused.value.exit_code == (4 if error is StreamAbsentError else 2)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("data", [b"", b"no telemetry at all", np.random.default_rng(0).bytes(5000)])
def test_without_a_valid_frame_there_is_no_recording(data: bytes) -> None:
    """Nothing, text and noise are sources that cannot be used: exit code 3."""
    with pytest.raises(SourceError, match="not one valid MAVLink frame") as refused:
        faulty(data, "yaw_offset")
    assert refused.value.exit_code == 3


def test_a_file_is_written_whole(tmp_path: Path) -> None:
    """The target holds what `inject` gives, an older file is replaced, and no temporary file stays."""
    source, target = FIXTURES / "e_two_vehicles.tlog", tmp_path / "faulty.tlog"
    target.write_bytes(b"old")
    with target.open("rb") as reader:
        inject_file(source, target, [parse_fault("loss:0.1")], seed=5, from_s=2)
        assert reader.read() == b"old"  # whoever reads it meanwhile reads the old one to its end
    assert target.read_bytes() == faulty(source.read_bytes(), "loss:0.1", seed=5, from_s=2)
    assert list(tmp_path.iterdir()) == [target]


def test_what_fails_writes_nothing(tmp_path: Path) -> None:
    """A missing source, an absent stream and a target that can't be: the right error, and no file."""
    source, target = tmp_path / "bench.tlog", tmp_path / "faulty.tlog"
    source.write_bytes(tlog(quaternion(1, 1, 0, 0, 0)))
    before = source.read_bytes()
    with pytest.raises(SourceError, match=r"absent\.tlog: cannot be read"):
        inject_file(tmp_path / "absent.tlog", target, [parse_fault("yaw_offset")])
    with pytest.raises(StreamAbsentError, match=r"bench\.tlog: no ATTITUDE in"):
        inject_file(source, target, [parse_fault("roll_sign")])
    with pytest.raises(UsageError, match="it is one of the recordings to be read"):
        inject_file(source, source, [parse_fault("yaw_offset")])
    with pytest.raises(UsageError, match="cannot write"):
        inject_file(source, tmp_path / "no folder" / "faulty.tlog", [parse_fault("yaw_offset")])
    with pytest.raises(UsageError, match="cannot write"):
        inject_file(source, tmp_path, [parse_fault("yaw_offset")])
    assert source.read_bytes() == before
    assert list(tmp_path.iterdir()) == [source]


def test_a_disk_that_fails_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the last step fails, the old file stays as it was, and no temporary one lies beside it."""
    target = tmp_path / "faulty.tlog"
    target.write_bytes(b"old")

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fails)
    with pytest.raises(UsageError, match=r"cannot write .*faulty\.tlog: No space left on device"):
        inject_file(FIXTURES / "e_two_vehicles.tlog", target, [parse_fault("yaw_offset")])
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"old"]


def test_a_device_is_written_to_and_stays_one() -> None:
    """What is no regular file is not replaced by one."""
    inject_file(FIXTURES / "e_two_vehicles.tlog", Path("/dev/null"), [parse_fault("yaw_offset")])
    assert Path("/dev/null").is_char_device()
