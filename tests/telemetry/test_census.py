"""Who sends what: as many of each message as pymavlink finds, and rates, jitter and ages worked by hand."""

import json
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner
from gcs_bridge.telemetry.asks import Ask
from gcs_bridge.telemetry.census import Census, ComponentSeen, UtcSaid
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES, ROOT

S = 1_000_000
START_US = wire.START_US


def census(recording: bytes, *cuts: int) -> Census:
    """Of a .tlog in pieces."""
    scanner, counted = Scanner(load_dialect(), timed=True), Census(load_dialect())
    for first, end in pairwise([0, *cuts, len(recording)]):
        scanner.scan(recording[first:end])
        counted.take(scanner)
    scanner.scan(b"", final=True)
    counted.take(scanner)
    return counted


def of_one(records: list[tuple[int, bytes]]) -> ComponentSeen:
    (seen,) = census(wire.tlog(records)).components()
    return seen


def counts(counted: Census) -> dict[tuple[int, int, str], int]:
    return {(*one.address, name): of.frames for one in counted.components() for name, of in one.messages.items()}


@pytest.mark.parametrize("name", sorted(path.stem for path in FIXTURES.glob("*.tlog")))
def test_as_many_as_pymavlink_found(name: str) -> None:
    """Of every message in every recording, damaged ones too: what its reader and parser say, as kept in the facts."""
    facts = json.loads((FIXTURES / f"{name}.facts.json").read_text(encoding="utf-8"))
    components = census((FIXTURES / f"{name}.tlog").read_bytes()).components()
    total: Counter[str] = Counter()
    for one in components:
        total.update({message: of.frames for message, of in one.messages.items()})
    unknown = [message for message in total if message.startswith("UNKNOWN_")]
    if name == "h_lossy_dirty":  # behind damage pymavlink passes over whole frames
        assert total >= Counter(facts["messages"])
        return
    assert sum(total.pop(message) for message in unknown) == facts["unknown_ids"]
    assert dict(total) == facts["messages"]
    assert sum(one.signed for one in components) == facts["signed"]
    assert sum(one.mavlink1 for one in components) == facts["mavlink1"]


CASES = sorted((ROOT / "tests" / "data" / "cases").glob("*.tlog"))


@pytest.mark.parametrize("path", one_in(4, CASES), ids=lambda path: path.stem)
def test_as_many_of_each_sender_as_pymavlink_finds(path: Path) -> None:
    """By system, component and message, as mavutil reads the file now: copies too."""
    found: Counter[tuple[int, int, str]] = Counter()
    log = mavutil.mavlink_connection(str(path), dialect="all")
    while (message := log.recv_msg()) is not None:
        found[message.get_srcSystem(), message.get_srcComponent(), message.get_type()] += 1
    log.close()
    assert counts(census(path.read_bytes())) == dict(found)


@pytest.mark.slow
def test_the_pieces_do_not_matter() -> None:
    """One byte at a time, and as a whole: the same, but for the last digits of a sum."""
    recording = wire.tlog(wire.flight(wire.Motion(3.0), 3.0))
    (whole,), (cut,) = census(recording).components(), census(recording, *range(1, len(recording))).components()
    assert counts(census(recording)) == counts(census(recording, *range(1, len(recording))))
    for name, one in whole.messages.items():
        other = cut.messages[name]
        assert one.rate_hz == pytest.approx(other.rate_hz)
        assert one.jitter_ms == pytest.approx(other.jitter_ms, abs=1e-6)
        assert one.last_rx_us == other.last_rx_us


def test_rate_and_jitter() -> None:
    """Ten a second, each other one 5 ms late: intervals of 105 and 95 ms, whose standard deviation is 5 ms.

    A silence of 7 s is part of neither.
    """
    times_us = [START_US + (100 * i + 5 * (i % 2)) * 1000 for i in range(51)]
    times_us += [time_us + 12 * S for time_us in times_us]
    seen = of_one([(t_us, wire.heartbeat(seq=i)) for i, t_us in enumerate(times_us)])
    beat = seen.messages["HEARTBEAT"]
    assert beat.frames == 102
    assert beat.rate_hz == pytest.approx(10.0)
    assert beat.jitter_ms == pytest.approx(5.0)
    assert beat.last_rx_us == START_US + 17 * S


def test_a_burst_has_its_messages() -> None:
    """Four that were received at once, each second: four a second."""
    seen = of_one(
        [(START_US + second * S, wire.heartbeat(seq=4 * second + i)) for second in range(20) for i in range(4)]
    )
    assert seen.messages["HEARTBEAT"].rate_hz == pytest.approx(79 / 19)


def test_an_answer_in_many_parts_has_no_rate() -> None:
    """Ten within 5 ms: nothing that comes again and again."""
    beat = of_one([(START_US + 500 * i, wire.heartbeat(seq=i)) for i in range(10)]).messages["HEARTBEAT"]
    assert (beat.frames, beat.rate_hz, beat.jitter_ms) == (10, None, None)


def test_slow_messages_have_a_rate_too() -> None:
    """One in five seconds: slower than silences are long."""
    beat = of_one([(START_US + 5 * S * i, wire.heartbeat(seq=i)) for i in range(5)]).messages["HEARTBEAT"]
    assert beat.rate_hz == pytest.approx(0.2)
    assert beat.jitter_ms == pytest.approx(0.0)


def test_copies_are_counted_and_no_part_of_the_rate() -> None:
    """Each frame comes twice, 3 ms apart."""
    records = [
        (START_US + i * 100_000 + late_us, wire.attitude(1000 + 100 * i, (0.1, 0, 0), seq=i))
        for i in range(30)
        for late_us in (0, 3000)
    ]
    seen = of_one(records)
    message = seen.messages["ATTITUDE"]
    assert (seen.frames, seen.copies, message.frames, message.copies) == (60, 30, 60, 30)
    assert message.rate_hz == pytest.approx(10.0)


def test_one_message_has_neither_rate_nor_jitter() -> None:
    """Nothing is made up."""
    beat = of_one([(START_US, wire.heartbeat())]).messages["HEARTBEAT"]
    assert (beat.frames, beat.rate_hz, beat.jitter_ms, beat.last_rx_us) == (1, None, None, START_US)


def test_a_stream_without_times_has_counts_alone() -> None:
    """Of a raw stream no receive time is known."""
    scanner, counted = Scanner(load_dialect(), timed=False), Census(load_dialect())
    scanner.scan(b"".join(wire.heartbeat(seq=i) for i in range(5)), final=True)
    counted.take(scanner)
    (seen,) = counted.components()
    beat = seen.messages["HEARTBEAT"]
    assert (beat.frames, beat.rate_hz, beat.jitter_ms, beat.last_rx_us) == (5, None, None, -1)


def test_an_unknown_message_makes_nobody() -> None:
    """A checksum that cannot be told is no proof of a sender; of one who is known it counts, under its number."""
    unknown = bytearray(wire.heartbeat(seq=1))
    unknown[7:10] = (54_321).to_bytes(3, "little")
    foreign = bytearray(unknown)
    foreign[5] = 77
    records = [(START_US + i * S, bytes(frame)) for i, frame in enumerate((unknown, foreign, wire.heartbeat(seq=2)))]
    seen = of_one(records)
    assert seen.address == (1, 1)
    assert {name: one.frames for name, one in seen.messages.items()} == {"HEARTBEAT": 1, "UNKNOWN_54321": 1}


def test_what_a_vehicle_tells_of_itself() -> None:
    """Its version by AUTOPILOT_VERSION, else by the text that ArduPilot sends at the start; the date, once known."""
    text = mavlink.MAVLink_statustext_message(6, b"ArduCopter V4.5.7 (2a3dc4b7)")
    version = mavlink.MAVLink_autopilot_version_message(0, 0x010F0240, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)
    dateless, dated = (mavlink.MAVLink_system_time_message(us, 5000) for us in (0, START_US - 3 * S))
    told = [(START_US + i * S, wire.pack(message, seq=i)) for i, message in enumerate((text, dateless, dated))]
    seen = of_one(told)
    assert (seen.firmware, seen.utc) == ("4.5.7", UtcSaid(START_US - 3 * S, START_US + 2 * S))
    assert of_one(told[:2]).utc is None
    assert of_one([*told, (START_US + 3 * S, wire.pack(version, seq=3))]).firmware == "1.15.2-alpha"


def test_who_asks_whom_for_what() -> None:
    """By stream, by message and by parameter; what is said again is counted, what asks for no rate is not."""
    asked = [
        mavlink.MAVLink_request_data_stream_message(1, 1, 10, 4, 1),
        mavlink.MAVLink_request_data_stream_message(1, 1, 10, 4, 1),
        mavlink.MAVLink_request_data_stream_message(1, 0, 0, 10, 0),
        mavlink.MAVLink_command_long_message(1, 1, 511, 0, 31, 40_000, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(1, 1, 511, 0, 27, -1, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_param_set_message(1, 1, b"SR1_RAW_SENS", 25.0, 9),
        mavlink.MAVLink_param_set_message(1, 1, b"MAV1_OPTIONS", 2.0, 9),
    ]
    sent = [(START_US + i * S, wire.pack(one, seq=i, sysid=255, compid=190)) for i, one in enumerate(asked)]
    by = (255, 190)
    assert census(wire.tlog(sent)).asks() == [
        (Ask(by, (1, 0), "REQUEST_DATA_STREAM", "ALL", 0.0), 1),
        (Ask(by, (1, 1), "PARAM_SET", "SR1_RAW_SENS", 25.0), 1),
        (Ask(by, (1, 1), "REQUEST_DATA_STREAM", "EXTRA1", 4.0), 2),
        (Ask(by, (1, 1), "SET_MESSAGE_INTERVAL", "ATTITUDE_QUATERNION", 25.0), 1),
        (Ask(by, (1, 1), "SET_MESSAGE_INTERVAL", "RAW_IMU", 0.0), 1),
    ]
