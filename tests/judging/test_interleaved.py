"""Many vehicles on one link: each is judged as if it were alone."""

import heapq
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES as SITL

Flown = tuple[str, tuple[str, ...], set[str]]

# Recordings of one vehicle each, and what is wrong in them: of three firmwares' kinds, at 4 to 50 Hz, MAVLink 1 and 2,
# with a reboot, resets, trims, views, losses and a stream that stops.
FLOWN: list[Flown] = [
    ("b2_mixed_rates", (), set()),
    ("b_copter_acro", (), set()),
    ("c_copter_4hz", (), set()),
    ("d_plane_pitchtrim3", (), set()),
    ("d_tailsitter", (), set()),
    ("f_reboot", (), set()),
    ("g_mavlink1", (), set()),
    ("j_ahrs_trim5", (), set()),
    ("k12_yaw_reset", (), set()),
    ("k13b_px4_tailsitter_fw", (), set()),
    ("k16_plane_trim_changes", ("yaw_offset:5",), {"euler_quaternion"}),
    ("k1_copter_trim", (), set()),
    ("k4_quadplane", ("quaternion_unnormalised",), {"quaternion_norm"}),
    ("k7a_gyro_bias_both", (), {"gravity", "secondary_estimate"}),
    ("k8_stream_stops", (), {"stream"}),
    ("p_px4_quad_square", ("loss:0.1",), set()),
]

Json = dict[str, Any]
Record = tuple[int, bytes]


def readdressed(data: bytes, sysid: int) -> Iterator[Record]:
    """The recording from a common time on, with another system id for its vehicle; of known messages alone."""
    start_us = None
    for t_us, frame in wire.records(data):
        start_us = t_us if start_us is None else start_us
        first = frame[0] == 0xFE
        number = frame[5] if first else int.from_bytes(frame[7:10], "little")
        known = mavlink.mavlink_map.get(number)
        if known is None:
            continue
        at = 3 if first else 5
        if frame[at] == 1:
            frame = wire.with_checksum(frame[:at] + bytes([sysid]) + frame[at + 1 :], known.crc_extra)
        yield wire.START_US + t_us - start_us, frame


def judged(records: Iterable[Record]) -> dict[int, Json]:
    """The entries of the link's vehicles, by system."""
    monitor = Monitor()
    monitor.feed_recording(wire.tlog(records))
    (entry,) = monitor.close().to_dict()["files"]
    assert entry["salvage"]["bad_crc"] == 0
    return {vehicle["sysid"]: vehicle for vehicle in entry["vehicles"]}


def by_time(records: Iterable[Record]) -> list[tuple[int, Record]]:
    """Each record with the latest time up to it: recorders' times may run backwards, the order of arrival does not."""
    listed = list(records)
    return list(zip(accumulate((t_us for t_us, _ in listed), max), listed, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("flown", one_in(2, [FLOWN[1::3], FLOWN]), ids=["five", "sixteen"])
def test_vehicles_on_one_link(flown: Sequence[Flown]) -> None:
    """Interleaved, as a swarm's link brings them, every vehicle has the very entry that its own recording gives: the
    same numbers of every check, the same alarms at the same times, none of another's.

    A ground station is heard to the end of each, so that the end of a vehicle's data is its silence in both.
    """
    flights = {}
    for sysid, (name, faults, _) in enumerate(flown, start=11):
        data = inject((SITL / f"{name}.tlog").read_bytes(), [parse_fault(fault) for fault in faults])
        flights[sysid] = list(readdressed(data, sysid))
    end_us = max(t_us for records in flights.values() for t_us, _ in records)
    beat = wire.heartbeat(autopilot=wire.NO_AUTOPILOT, vehicle=wire.GROUND_STATION, sysid=255)
    bystander = [(t_us, beat) for t_us in (*range(wire.START_US, end_us, 1_000_000), end_us)]
    flights[255] = bystander
    together = judged(record for _, record in heapq.merge(*map(by_time, flights.values()), key=lambda one: one[0]))
    assert together.keys() == flights.keys() - {255}
    for sysid, (name, _, wrong) in enumerate(flown, start=11):
        of_both = map(by_time, (flights[sysid], bystander))
        (alone,) = judged(record for _, record in heapq.merge(*of_both, key=lambda one: one[0])).values()
        assert together[sysid] == alone, name
        assert {alarm["check"] for alarm in alone["alarms"]} == wrong, name
