"""Two senders that use one (system, component): told, never AGREE; one, whatever the link does to it, is not.

Flights are made by hand (tests/helpers/wire.py).
"""

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs_bridge import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.everyday import in_turns, one_in
from tests.helpers.paths import FIXTURES, ROOT

pytestmark = pytest.mark.slow

Record = tuple[int, bytes]
Json = dict[str, Any]
S = 1_000_000
CASES = ROOT / "tests" / "data" / "cases"


class Still:
    """A vehicle that stands, turned by a rotation vector, as `wire.Motion` is one that moves."""

    def __init__(self, *rotvec_deg: float) -> None:
        self._rotation = Rotation.from_rotvec(rotvec_deg, degrees=True)

    def rotation(self, t_s: Any) -> Rotation:
        return Rotation.concatenate([self._rotation] * len(t_s))

    def rates(self, t_s: Any) -> Any:
        return np.zeros((len(t_s), 3))


@cache
def moving(seed: int) -> wire.Motion:
    return wire.Motion(31, seed=seed)


def sent(motion: Any, seconds: float = 30.0, *, late_s: float = 0.0, first_seq: int = 0, **flight: Any) -> list[Record]:
    """A flight whose frames come `late_s` later than others that start together with it."""
    start_us = wire.START_US + round(late_s * S)
    return wire.flight(motion, seconds, start_us=start_us, first_seq=first_seq, **flight)


def together(*flights: list[Record]) -> list[Record]:
    return sorted((one for flight in flights for one in flight), key=lambda one: one[0])


def judged(records: list[Record]) -> tuple[str, list[str], int]:
    """The verdict of the recording's vehicle, what its alarms say of senders, and how many boots it has."""
    monitor = Monitor()
    monitor.feed_recording(wire.tlog(records))
    (entry,) = monitor.close().to_dict()["files"]
    (vehicle,) = entry["vehicles"]
    assert (vehicle["sysid"], vehicle["compid"]) == (1, 1)
    said = [alarm["what"] for alarm in vehicle["alarms"] if "two senders use 1,1" in alarm["what"]]
    return vehicle["verdict"], said, len(vehicle["boots"])


def test_the_case() -> None:
    """Two attitudes 114° apart in turn, one clock, and numbers that stand still."""
    monitor = Monitor()
    monitor.feed_recording((CASES / "two_senders_one_id.tlog").read_bytes())
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    assert vehicle["verdict"] == "alarm"
    (alarm,) = vehicle["alarms"]
    assert (alarm["check"], alarm["severity"], alarm["cleared_boot_s"]) == ("stream", "alarm", None)
    assert "two senders use 1,1" in alarm["what"]
    assert alarm["raised_boot_s"] < 6.0  # it begins at 5 s


@pytest.mark.parametrize(
    ("late_s", "hz", "apart_deg"),
    one_in(
        7,
        product(
            [0.0, 0.017],
            [(20.0, 20.0), (50.0, 5.0), (10.0, 4.0), (25.0, 25.0), (5.0, 10.0)],
            [5.0, 30.0, 114.0, 180.0],
        ),
    ),
)
def test_two_attitudes(apart_deg: float, hz: tuple[float, float], late_s: float) -> None:
    """Of one clock; a little apart only where that cannot be a motion between two samples."""
    turned = apart_deg * np.array([0.6, 0.0, 0.8])
    one = sent(Still(3, -2, 40), euler_hz=hz[0], quaternion_hz=hz[0])
    other = sent(
        Still(*turned), euler_hz=hz[1], quaternion_hz=0.0, late_s=late_s, boot_ms=10_000 + round(late_s * 1000)
    )
    verdict, said, _ = judged(together(one, other))
    assert (verdict, bool(said)) == ("alarm", True)


@pytest.mark.parametrize(
    ("hz", "apart_ms"),
    one_in(
        3,
        in_turns(
            2,
            [(20.0, 20.0), (50.0, 10.0), (10.0, 1.0), (4.0, 4.0), (4.0, 2.0)],
            [0, 7, 2_500, 20_000, 400_000, -9_000],
        ),
    ),
)
def test_two_vehicles_that_fly(hz: tuple[float, float], apart_ms: int) -> None:
    """Each by its own motion and on its own clock."""
    flights = [
        sent(moving(seed), euler_hz=hz[seed], quaternion_hz=hz[seed], boot_ms=10_000 + seed * apart_ms,
             first_seq=100 * seed, late_s=0.003 * seed)
        for seed in (0, 1)
    ]  # fmt: skip
    verdict, said, _ = judged(together(*flights))
    assert (verdict, bool(said)) == ("alarm", True)


@pytest.mark.parametrize("apart_ms", one_in(2, [30_000, 3_600_000]))
def test_two_clocks_of_one_attitude(apart_ms: int) -> None:
    """Two copies of one simulation, say: nothing but the clocks tells them apart."""
    motion = moving(5)
    flights = [sent(motion, euler_hz=10.0, quaternion_hz=10.0, boot_ms=10_000 + k * apart_ms) for k in (0, 1)]
    verdict, said, _ = judged(together(*flights))
    assert (verdict, bool(said)) == ("alarm", True)


@pytest.mark.parametrize(
    "other",
    [{"vehicle": 1}, {"autopilot": 12}, {"autopilot": 8, "vehicle": 6}, {"vehicle": 18}, {"custom_mode": 4}],
)
@pytest.mark.parametrize("hz", [1.0, 0.7])
def test_heartbeats_that_contradict_each_other(other: Json, hz: float) -> None:
    """The second sender sends nothing else; what most say names the vehicle."""
    flown = sent(moving(2), euler_hz=10.0, quaternion_hz=10.0)
    beats = [
        (wire.START_US + round((0.4 + i / hz) * S), wire.heartbeat(seq=77 + i, **other)) for i in range(int(29 * hz))
    ]
    verdict, said, _ = judged(together(flown, beats))
    assert (verdict, len(said)) == ("alarm", 1)


def test_another_version_numbered_apart() -> None:
    """Heartbeats of MAVLink 1 among frames of MAVLink 2, alike but for their numbers: that two send is a warning."""
    flown = sent(moving(2), euler_hz=10.0, quaternion_hz=10.0)
    beats = [(wire.START_US + round((0.45 + i) * S), wire.heartbeat(seq=i, version=1)) for i in range(29)]
    verdict, said, _ = judged(together(flown, beats))
    assert (verdict, len(said)) == ("warning", 1)


def test_it_is_over_when_the_second_is_silent() -> None:
    """Raised while both send, cleared within seconds behind it."""
    one = sent(Still(3, -2, 40), 60.0, euler_hz=10.0, quaternion_hz=10.0)
    other = sent(Still(0, 0, 100), 10.0, euler_hz=10.0, quaternion_hz=0.0, late_s=20.0, boot_ms=30_000)
    monitor = Monitor()
    monitor.feed_recording(wire.tlog(together(one, other)))
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    (alarm,) = [alarm for alarm in vehicle["alarms"] if "two senders" in alarm["what"]]
    assert 30.0 < alarm["raised_boot_s"] < 33.0
    assert 40.0 < alarm["cleared_boot_s"] < 60.0


# --- one sender ------------------------------------------------------------------------------------------------------

FLIGHT = "c_copter_4hz"


@pytest.mark.parametrize(
    ("fault", "name"),
    one_in(3, in_turns(
        1,
        ["loss:0.5", "reorder:0.5", "duplicate:0.5", "corrupt:0.003", "time_skew:3000", "euler_degrees",
         "quaternion_xyzw", "euler_xyz_order", "yaw_sign", "roll_pitch_swapped", "frozen_euler", "thin:ATTITUDE=1"],
        [FLIGHT, "b_copter_acro", "f_reboot", "f_reboot", FLIGHT],
    )),
)  # fmt: skip
def test_one_sender_on_a_bad_link(fault: str, name: str) -> None:
    """Whatever is lost, late, doubled or damaged, or stamped wrongly, is no second sender."""
    data = inject((FIXTURES / f"{name}.tlog").read_bytes(), [parse_fault(fault)])
    monitor = Monitor()
    monitor.feed_recording(data)
    vehicles = monitor.close().to_dict()["files"][0]["vehicles"]
    assert not [alarm for v in vehicles for alarm in v["alarms"] if "two senders" in alarm["what"]]


@pytest.mark.parametrize("late_s", [0.0, 0.05, 0.4, 0.9])
def test_one_vehicle_heard_twice(late_s: float) -> None:
    """Over two links into one recording, the second one later: frame by frame the same, half of them lost on each."""
    chance = np.random.default_rng(3)
    flown = sent(moving(4), euler_hz=20.0, quaternion_hz=20.0)
    paths = [
        [(t_us + round(late * S), frame) for t_us, frame in flown if chance.random() < 0.5] for late in (0.0, late_s)
    ]
    verdict, said, _ = judged(together(*paths))
    assert (verdict, said) == ("agree", [])


def test_one_vehicle_on_two_ports() -> None:
    """An autopilot numbers each port's frames by itself, and stamps each message when it is sent."""
    motion = moving(6)
    ports = [
        sent(motion, euler_hz=10.0, quaternion_hz=10.0),
        sent(motion, euler_hz=4.0, quaternion_hz=4.0, first_seq=120, version=1),
    ]
    verdict, said, _ = judged(together(*ports))
    assert (verdict, said) == ("agree", [])


def test_reboots_are_one_sender_s() -> None:
    """Again and again, as on a bench: each time the clock, the numbers and the attitude begin anew."""
    flights = [
        sent(Still(0, 0, 60.0 * (k % 2)), 5.0, euler_hz=10.0, quaternion_hz=10.0, late_s=7.0 * k, boot_ms=1_000)
        for k in range(8)
    ]
    _, said, _ = judged(together(*flights))
    assert said == []


@pytest.mark.parametrize("hz", [2.0, 4.0, 10.0])
@pytest.mark.parametrize("swing_hz", [1.0, 1.9, 3.4])
def test_a_vehicle_that_swings(hz: float, swing_hz: float) -> None:
    """Back and forth as often as it is sampled, with the rates that belong to it."""
    times = np.arange(0.0, 30.0, 1.0 / hz)
    swing = 2 * np.pi * swing_hz
    records = []
    for i, t_s in enumerate(times.tolist()):
        roll, rate = np.radians(40) * np.cos(swing * t_s), -np.radians(40) * swing * np.sin(swing * t_s)
        t_us = wire.START_US + round(t_s * S)
        if i % round(hz) == 0:
            records.append((t_us, wire.heartbeat(seq=2 * i)))
        records.append(
            (t_us, wire.attitude(10_000 + round(1000 * t_s), (roll, 0.0, 0.0), (rate, 0.0, 0.0), seq=2 * i + 1))
        )
    assert judged(records)[1] == []
