"""What is known while links are listened to: what was sent last, how far it differs, what stands."""

import json
from typing import Any

import pytest

import gcs_bridge
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire

S = 1_000_000
MOTION = wire.Motion(12.0, seed=3)
HEALTHY = wire.flight(MOTION, 12.0)
FAULTY = list(wire.records(inject(wire.tlog(HEALTHY), [parse_fault("yaw_offset:25")], from_s=4.0)))


def batches(frames: list[tuple[int, bytes]]) -> list[list[tuple[bytes, int]]]:
    """As datagrams, some at once."""
    datagrams = [(frame, t_us) for t_us, frame in frames]
    return [datagrams[start : start + 20] for start in range(0, len(datagrams), 20)]


def fed(frames: list[tuple[int, bytes]], monitor: gcs_bridge.Monitor | None = None, link: int = 0) -> Any:
    monitor = monitor or gcs_bridge.Monitor()
    for batch in batches(frames):
        monitor.feed_datagrams(batch, link)
    return monitor


def vehicle_of(monitor: gcs_bridge.Monitor, place: int = 0) -> dict[str, Any]:
    vehicle: dict[str, Any] = monitor.snapshot().to_dict()["vehicles"][place]
    return vehicle


def alarm_of(vehicle: dict[str, Any], check: str, name: str) -> dict[str, Any]:
    (found,) = [one for one in vehicle["checks"] if one["name"] == check]
    (alarm,) = [one for one in found["alarms"] if one["name"] == name]
    assert isinstance(alarm, dict)
    return alarm


def test_nothing_is_known_before_the_first_byte() -> None:
    """No link, no vehicle; with bytes that hold no frame, a link without vehicles."""
    monitor = gcs_bridge.Monitor()
    assert monitor.snapshot().to_dict() == {"links": [], "vehicles": []}
    monitor.feed(b"\0" * 40, wire.START_US)
    monitor.close_link(0, wire.START_US)
    (link,) = monitor.snapshot().to_dict()["links"]
    assert link == {
        "name": 0,
        "is_open": False,
        "frames": 0,
        "bytes": 40,
        "bad_crc": 0,
        "skipped_bytes": 40,
        "unlisted": 0,
    }


def test_the_latest_attitudes_are_those_that_were_sent() -> None:
    """Both forms as SciPy made them, with their rates, times and ages; the last ones of a flight of 12 s at 25 Hz."""
    monitor = fed(HEALTHY)
    monitor.advance(HEALTHY[-1][0] + S // 2)
    vehicle = vehicle_of(monitor)
    last_s = 11.96  # of 0, 0.04, … 11.96
    assert vehicle["attitude"]["rpy_rad"] == pytest.approx(MOTION.rpy(last_s).tolist(), abs=1e-6)
    assert vehicle["attitude_quaternion"]["q_nb"] == pytest.approx(MOTION.wxyz(last_s).tolist(), abs=1e-6)
    assert vehicle["attitude_quaternion"]["rpy_rad"] is None
    for form in ("attitude", "attitude_quaternion"):
        assert vehicle[form]["w_nb_b_rad_s"] == pytest.approx(MOTION.rates(last_s).tolist(), abs=1e-6)
        assert vehicle[form]["t_boot_s"] == pytest.approx(10.0 + last_s)  # the boot clock stood at 10 s
        assert vehicle[form]["age_s"] == pytest.approx(0.5)
        assert vehicle[form]["alive"]
        assert vehicle[form]["valid"]
    assert (vehicle["sysid"], vehicle["compid"], vehicle["link"]) == (1, 1, None)
    assert (vehicle["boot"], vehicle["t_boot_s"], vehicle["age_s"]) == (0, pytest.approx(21.96), pytest.approx(0.5))
    assert (vehicle["received"], vehicle["lost"]) == (len(HEALTHY), 0)
    assert vehicle["streams"]["ATTITUDE"]["rate_hz"] == pytest.approx(25.0)


@pytest.mark.slow
def test_a_residual_stands_beside_its_limit() -> None:
    """25° of yaw on the quaternion are 25° beyond a limit of half a degree and the bound, and raise the alarm."""
    vehicle = vehicle_of(fed(FAULTY))
    alarm = alarm_of(vehicle, "euler_quaternion", "pairs")
    assert alarm["value"] == pytest.approx(25.0, abs=1e-3)
    assert 0.5 < alarm["limit"] < 0.6
    assert (alarm["unit"], alarm["state"], alarm["announcement"]) == ("deg", "raised", "told")
    assert alarm["id"] == "1.1-euler_quaternion-0-1"
    assert alarm["peak"] == pytest.approx(25.0, abs=1e-3)
    assert vehicle["verdict"] == "alarm"
    healthy = alarm_of(vehicle_of(fed(HEALTHY)), "euler_quaternion", "pairs")
    assert healthy["value"] < 1e-3
    assert (healthy["state"], healthy["id"], healthy["peak"]) == ("normal", None, None)


def test_what_people_say_to_an_alarm_shows() -> None:
    """Acknowledged, then shelved; a vehicle that fell silent is no longer alive."""
    monitor = fed(FAULTY)
    alarm_id = "1.1-euler_quaternion-0-1"
    end_us = FAULTY[-1][0]
    monitor.acknowledge(alarm_id, end_us)
    monitor.shelve(alarm_id, end_us, 60.0)
    alarm = alarm_of(vehicle_of(monitor), "euler_quaternion", "pairs")
    assert (alarm["state"], alarm["announcement"]) == ("acknowledged", "shelved")
    monitor.advance(end_us + 3 * S)
    vehicle = vehicle_of(monitor)
    assert not vehicle["attitude"]["alive"]
    assert vehicle["attitude"]["age_s"] == pytest.approx(3.0)


@pytest.mark.slow
def test_an_alarm_that_has_gone_waits_to_be_acknowledged() -> None:
    """It still has its id, by which somebody can say that it was seen; then it has none."""
    passing = inject(wire.tlog(HEALTHY), [parse_fault("yaw_offset:25")], from_s=2.0, to_s=5.0)
    monitor = fed(list(wire.records(passing)))
    alarm = alarm_of(vehicle_of(monitor), "euler_quaternion", "pairs")
    assert (alarm["state"], alarm["id"]) == ("returned", "1.1-euler_quaternion-0-1")
    monitor.acknowledge(alarm["id"], HEALTHY[-1][0])
    alarm = alarm_of(vehicle_of(monitor), "euler_quaternion", "pairs")
    assert (alarm["state"], alarm["id"]) == ("normal", None)


def test_frames_that_went_missing_are_counted() -> None:
    """Every tenth frame is left out: the sequence numbers miss it."""
    kept = [one for place, one in enumerate(HEALTHY) if place % 10 != 5]
    vehicle = vehicle_of(fed(kept))
    assert (vehicle["received"], vehicle["lost"]) == (len(kept), len(HEALTHY) - len(kept))


@pytest.mark.slow
def test_two_links_are_told_apart() -> None:
    """The same vehicle on both; of the second link it carries the link's number."""
    monitor = fed(FAULTY, fed(HEALTHY), link=3)
    snapshot = monitor.snapshot().to_dict()
    assert [link["name"] for link in snapshot["links"]] == [0, 3]
    assert [(vehicle["link"], vehicle["verdict"]) for vehicle in snapshot["vehicles"]] == [
        (None, "agree"),
        (3, "alarm"),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("frames", [HEALTHY, FAULTY])
def test_looking_changes_nothing(frames: list[tuple[int, bytes]]) -> None:
    """After each batch, and before the report: that is what it is without; its verdicts are the last ones seen."""
    watched, alone = gcs_bridge.Monitor(), gcs_bridge.Monitor()
    for batch in batches(frames):
        assert watched.feed_datagrams(batch) == alone.feed_datagrams(batch)
        json.dumps(watched.snapshot().to_dict())
    seen = vehicle_of(watched)
    report = watched.close().to_dict()
    assert report == alone.close().to_dict()
    (vehicle,) = report["files"][0]["vehicles"]
    assert seen["verdict"] == vehicle["verdict"]
    assert [(one["name"], one["verdict"]) for one in seen["checks"]] == [
        (one["name"], one["verdict"]) for one in vehicle["checks"]
    ]
    assert seen["streams"] == vehicle["streams"]
