"""Whatever is sent to a link: nothing raises, nothing takes long, and the true vehicle is judged as it would be alone.

`python -m benchmarks.fuzz --minutes N` does the same for as long as one likes, with other seeds.
"""

import itertools
import math
import struct
import tracemalloc
from functools import cache
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from benchmarks import fuzz
from gcs_bridge import Monitor
from tests.helpers.craft import BOOT_S
from tests.helpers.everyday import one_in
from tests.helpers.live_links import fixture, judgement, recorded_judgement, tlog_of

CASES = 600


@pytest.mark.sweep
@pytest.mark.slow  # hundreds of datagrams at random; the rest of this file is by hand
@pytest.mark.parametrize("seed", range(2))
def test_strangers_do_no_harm(seed: int) -> None:
    """Noise, damage, and right frames of other systems with the worst in them: the true vehicle's entry is the same."""
    done = fuzz.strangers(seed, CASES, fuzz.flights()[seed % 2])
    assert done.cases > 0.9 * CASES
    assert len(done.wanted) == 1
    assert done.judged == done.wanted
    assert done.slowest_s < 5 * fuzz.SLOW_S


@pytest.mark.slow
def test_strangers_are_heard() -> None:
    """They are no noise that is passed over: some become vehicles, and what they send is judged."""
    hostile = fuzz.Hostile(3, system=None)
    monitor = Monitor()
    monitor.open_link(0, datagrams=True)
    for number in range(CASES):
        monitor.feed(hostile.datagram(), 1_700_000_000_000_000 + 20_000 * number)
    (entry,) = monitor.close().to_dict()["files"]
    assert len(entry["vehicles"]) > 2
    assert entry["salvage"]["frames"] > CASES
    assert entry["salvage"]["bad_crc"] > 10


@pytest.mark.slow  # as above
@pytest.mark.parametrize("seed", one_in(2, range(2)))
def test_forged_frames_raise_nothing(seed: int) -> None:
    """Under the vehicle's own address, cut anywhere, with receive times that jump; reports and events stay JSON."""
    done = fuzz.forged(seed, CASES, fuzz.flights()[2 + seed % 2])
    assert done.cases == CASES
    assert done.slowest_s < 5 * fuzz.SLOW_S


def test_a_seed_makes_the_same_again() -> None:
    """So that what was found can be looked at."""
    one, other = (fuzz.Hostile(7, system=1) for _ in range(2))
    assert [one.datagram() for _ in range(200)] == [other.datagram() for _ in range(200)]


@pytest.mark.sweep
@pytest.mark.slow
def test_memory_does_not_grow() -> None:
    """Of 64 KiB datagrams of noise and of frames, on and on: what is held is what was held before."""
    hostile = fuzz.Hostile(11, system=1)
    monitor = Monitor()
    monitor.open_link(0, datagrams=True)
    t_rx_us = 1_700_000_000_000_000
    held: list[int] = []
    tracemalloc.start()
    try:
        for _ in range(5):
            for _ in range(300):
                t_rx_us += 20_000
                monitor.feed(hostile.datagram(), t_rx_us)
            held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert held[4] - held[1] < 8e6, held


# --- by hand ---------------------------------------------------------------------------------------------------------


def packed(message: mavlink.MAVLink_message, system: int = 1) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1)))


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["AHRS_TRIM_X", "AHRS_TRIM_Y", "PTCH_TRIM_DEG", "TRIM_PITCH_CD", "FLIGHT_OPTIONS", "X"]
)
def test_parameters_that_are_no_numbers(name: str) -> None:
    """Told in mid-flight, again and again, they raise nothing, and no alarm: a value that cannot be is none."""
    flight = fixture("d_plane_pitchtrim3", to_s=8)
    values = itertools.cycle([math.nan, math.inf, -math.inf, 3e38])
    monitor = Monitor()
    monitor.open_link(0, datagrams=True)
    for number, frame in enumerate(flight):
        monitor.feed(frame.data, frame.t_rx_us)
        if number % 80 == 40:
            parameter = mavlink.MAVLink_param_value_message(name.encode(), next(values), 9, 1, 0)
            monitor.feed(packed(parameter), frame.t_rx_us)
    (vehicle,) = judgement(monitor.close().files[0])
    assert vehicle["alarms"] == []
    assert vehicle["checks"] == judged_alone()["checks"]


@cache
def judged_alone() -> dict[str, Any]:
    (vehicle,) = recorded_judgement(tlog_of(fixture("d_plane_pitchtrim3", to_s=8)))
    return vehicle


_TIMES_MS = (0, 1, 2**31 - 1, 2**31, 2**32 - 1)


@pytest.mark.slow
@pytest.mark.parametrize("order", one_in(3, [(order,) for order in list(itertools.permutations(_TIMES_MS, 3))[::7]]))
def test_times_at_the_edges(order: tuple[int, ...]) -> None:
    """Boot times at 0, at 2^32 − 1 and between them, one after the other, raise nothing and cost nothing."""
    monitor = Monitor()
    t_rx_us = 1_700_000_000_000_000
    for number in range(120):
        t_rx_us += 20_000
        boot_ms = min(order[number // 20 % len(order)] + number % 20 * 20, 2**32 - 1)
        messages = (
            mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0, 0, 0),
            mavlink.MAVLink_attitude_quaternion_message(boot_ms, 1, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_raw_imu_message(boot_ms * 1000, 0, 0, -1000, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_system_time_message(2**64 - 1, boot_ms),
        )
        monitor.feed(b"".join(map(packed, messages)), t_rx_us)
    (entry,) = monitor.close().to_dict()["files"]
    assert entry["salvage"]["frames"] == 480


@pytest.mark.slow
def test_nan_everywhere() -> None:
    """Every float of every message that is used: counted as invalid, never as agreement."""
    monitor = Monitor()
    t_rx_us = 1_700_000_000_000_000
    nan = struct.unpack("<f", b"\0\0\xc0\x7f")[0]
    for number in range(500):
        t_rx_us += 20_000
        boot_ms = round(1000 * BOOT_S) + 20 * number
        messages = (
            mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3),
            mavlink.MAVLink_attitude_message(boot_ms, *(nan,) * 6),
            mavlink.MAVLink_attitude_quaternion_message(boot_ms, *(nan,) * 7, (nan,) * 4),
            mavlink.MAVLink_highres_imu_message(boot_ms * 1000, *(nan,) * 13, 65535),
            mavlink.MAVLink_ahrs2_message(*(nan,) * 4, 0, 0),
            mavlink.MAVLink_local_position_ned_message(boot_ms, *(nan,) * 6),
        )
        monitor.feed(b"".join(map(packed, messages)), t_rx_us)
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    assert vehicle["streams"]["ATTITUDE"]["invalid"] == vehicle["streams"]["ATTITUDE_QUATERNION"]["invalid"] == 500
    assert {check["verdict"] for check in vehicle["checks"] if check["name"] != "stream"} <= {"no_compare", "inop"}


@pytest.mark.parametrize("size", one_in(2, [0, 1, 7, 8, 65_507, 65_535]))
@pytest.mark.parametrize("byte", one_in(2, [0x00, 0xFD, 0xFE, 0xFF]))
def test_datagrams_of_one_byte_over_and_over(size: int, byte: int) -> None:
    """Of any size, up to the largest: nothing is a frame, and the next frame is found."""
    monitor = Monitor()
    monitor.open_link(0, datagrams=True)
    frame = packed(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3))
    for number in range(5):
        monitor.feed(bytes((byte,)) * size, 1_700_000_000_000_000 + number)
        monitor.feed(frame, 1_700_000_000_000_000 + number)
    assert monitor.snapshot().links[0].frames == 5
