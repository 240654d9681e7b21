"""Who becomes a vehicle, and who is only heard, whatever autopilot is claimed.

Numbers are MAVLink's: MAV_TYPE, MAV_COMPONENT and MAV_AUTOPILOT of common.xml.
"""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge import Monitor
from gcs_bridge.cli import main
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import ROOT

Record = tuple[int, bytes]
Json = dict[str, Any]
S = 1_000_000
CASES = ROOT / "tests" / "data" / "cases"
CLAIMED = [wire.ARDUPILOT, wire.PX4, wire.NO_AUTOPILOT, 0]


@cache
def motion(seed: int) -> wire.Motion:
    return wire.Motion(21, seed=seed)


@cache
def vehicle() -> list[Record]:
    return wire.flight(motion(1), 20.0, euler_hz=10.0, quaternion_hz=10.0)


def beats(seconds: int = 20, begin_s: float = 0.3, **wired: Any) -> list[Record]:
    return [(wire.START_US + round((begin_s + i) * S), wire.heartbeat(seq=i, **wired)) for i in range(seconds)]


def attitudes(**wired: Any) -> list[Record]:
    """Of another motion, without a heartbeat."""
    flown = wire.flight(motion(2), 20.0, euler_hz=10.0, quaternion_hz=0.0, **wired)
    return [one for one in flown if len(one[1]) > 30]


def judged(*records: list[Record], **options: Any) -> Json:
    monitor = Monitor(**options)
    monitor.feed_recording(wire.tlog(sorted((one for some in records for one in some), key=lambda one: one[0])))
    entry: Json = monitor.close().to_dict()["files"][0]
    return entry


def vehicles(entry: Json) -> dict[tuple[int, int], str]:
    return {(vehicle["sysid"], vehicle["compid"]): vehicle["type"] for vehicle in entry["vehicles"]}


def test_the_case() -> None:
    """An onboard computer that claims a generic autopilot is no vehicle: the verdict is the real one's."""
    monitor = Monitor()
    monitor.feed_recording((CASES / "companion_generic.tlog").read_bytes())
    entry = monitor.close().to_dict()["files"][0]
    assert (vehicles(entry), entry["verdict"]) == ({(1, 1): "quadrotor"}, "agree")
    assert entry["others"] == [
        {"sysid": 1, "compid": 93, "autopilot": "generic", "type": "onboard_controller", "frames": 60}
    ]


NO_VEHICLES = [  # MAV_TYPE, and the number of the component
    *((18, 93), (18, 191), (18, 1), (26, 154), (26, 171), (27, 156), (30, 100), (30, 105), (6, 190), (33, 140)),
    *((36, 180), (37, 161), (38, 155), (32, 160), (42, 169), (40, 200), (41, 220), (39, 157), (34, 236), (48, 25)),
    *((0, 158), (0, 195), (0, 197), (0, 240), (0, 68)),
]


@pytest.mark.parametrize("autopilot", one_in(4, CLAIMED))
@pytest.mark.parametrize("sends_attitude", [False, True])
def test_what_is_no_vehicle(sends_attitude: bool, autopilot: int) -> None:
    """By type, or by a number kept for other things where the type says nothing; each in a system of its own."""
    others = [(9 + i, kind, compid) for i, (kind, compid) in enumerate(NO_VEHICLES)]
    sent = [beats(vehicle=kind, autopilot=autopilot, sysid=sysid, compid=compid) for sysid, kind, compid in others]
    if sends_attitude:
        sent += [attitudes(sysid=sysid, compid=compid) for sysid, _, compid in others]
    entry = judged(vehicle(), *sent)
    assert (vehicles(entry), entry["verdict"]) == ({(1, 1): "quadrotor"}, "agree")
    assert [(one["sysid"], one["compid"]) for one in entry["others"]] == [
        (sysid, compid) for sysid, _, compid in others
    ]


@pytest.mark.parametrize("compid", one_in(2, [100, 103, 154, 158, 191, 195, 197, 200]))
def test_attitudes_under_a_number_for_other_things(compid: int) -> None:
    """A camera or a visual odometry that sends attitudes and no heartbeat."""
    assert vehicles(judged(vehicle(), attitudes(compid=compid))) == {(1, 1): "quadrotor"}


@pytest.mark.parametrize("compid", [0, 1, 2, 50])
def test_a_system_without_a_heartbeat(compid: int) -> None:
    """Attitudes alone name a vehicle where the number does not speak against it."""
    assert vehicles(judged(attitudes(sysid=7, compid=compid))) == {(7, compid): "unknown"}


@pytest.mark.parametrize("compid", [0, 1, 2, 50, 190, 200])
def test_an_autopilot_under_any_number(compid: int) -> None:
    """An airframe that flies is a vehicle, whatever number it was given."""
    flown = wire.flight(motion(1), 20.0, euler_hz=10.0, quaternion_hz=10.0, compid=compid)
    assert vehicles(judged(flown)) == {(1, compid): "quadrotor"}


def test_a_flow_sensor_with_a_generic_heartbeat() -> None:
    """It says generic twice, and sends no attitude; what says so and sends some is judged."""
    assert vehicles(judged(vehicle(), beats(sysid=81, compid=50, vehicle=0, autopilot=0))) == {(1, 1): "quadrotor"}
    generic = beats(sysid=81, compid=50, vehicle=0, autopilot=0), attitudes(sysid=81, compid=50)
    assert vehicles(judged(*generic)) == {(81, 50): "generic"}


def test_a_quadrotor_s_script_that_names_no_autopilot() -> None:
    """It sends attitudes under an autopilot's number: they are judged. Without any it is only heard."""
    script = {"autopilot": wire.NO_AUTOPILOT, "sysid": 3}
    assert vehicles(judged(beats(**script), attitudes(sysid=3))) == {(3, 1): "quadrotor"}
    assert vehicles(judged(vehicle(), beats(**script))) == {(1, 1): "quadrotor"}


@pytest.mark.parametrize("strange", [1, 4])
def test_most_heartbeats_say_what_it_is(strange: int) -> None:
    """A few that say something else come first: the type is that of most, and it is a vehicle."""
    wrong = beats(strange, begin_s=-5.0, vehicle=6, autopilot=wire.NO_AUTOPILOT)
    assert vehicles(judged(wrong, vehicle())) == {(1, 1): "quadrotor"}
    assert vehicles(judged(beats(strange, begin_s=-5.0, vehicle=1), vehicle())) == {(1, 1): "quadrotor"}
    most = beats(30, begin_s=25.0, vehicle=18)
    assert vehicles(judged(vehicle(), most)) == {}


@pytest.fixture
def checked(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """The exit code and the report of `check`."""

    def check(path: Path, *options: str) -> tuple[int, str]:
        return main(["check", str(path), "--no-color", *options]), capsys.readouterr().out

    return check


def test_no_vehicle_says_who_was_heard(tmp_path: Path, checked: Callable[..., tuple[int, str]]) -> None:
    """In the last line; in the JSON with the number of their frames."""
    path = tmp_path / "stations.tlog"
    station = {"sysid": 255, "compid": 190, "vehicle": 6, "autopilot": wire.NO_AUTOPILOT}
    path.write_bytes(wire.tlog([*beats(20, **station), *beats(5, compid=100, vehicle=30)]))
    code, said = checked(path)
    assert code == 4
    assert said.splitlines()[-1].endswith("no vehicle; heard: 255,190 gcs, 1,100 camera")
    code, said = checked(path, "--format", "json")
    others = json.loads(said)["files"][0]["others"]
    assert [(one["sysid"], one["compid"], one["frames"]) for one in others] == [(1, 100, 5), (255, 190, 20)]


def test_a_system_that_is_not_there(tmp_path: Path, checked: Callable[..., tuple[int, str]]) -> None:
    """Those that are there are listed, the vehicle too."""
    path = tmp_path / "flight.tlog"
    path.write_bytes(wire.tlog(vehicle()))
    code, said = checked(path, "--sysid", "7")
    assert code == 4
    assert "system 7 was not heard; there are 1" in said
    assert "heard: 1,1 quadrotor" in said.splitlines()[-1]
    assert checked(path, "--sysid", "1")[0] == 0
