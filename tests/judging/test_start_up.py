"""Start-up: alarms wait until an estimator first says that its attitude is ready, and never again."""

from collections.abc import Sequence
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge import Monitor
from tests.helpers import wire
from tests.helpers.craft import (
    ARMED,
    BOOT_S,
    Change,
    Craft,
    alarms,
    between,
    check,
    rotvec,
    still,
    told,
    two_sided,
    watched,
)

AHRS = 0x200000
Says = list[tuple[float, Any]]


def ekf(flags: int) -> Any:
    return mavlink.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0)


def estimator(flags: int) -> Any:
    return mavlink.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0)


def status(healthy: bool) -> Any:
    return mavlink.MAVLink_sys_status_message(AHRS, AHRS, AHRS * healthy, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


def converging(until_s: float, since_s: float = 0.0) -> Change:
    """An attitude that creeps by 4° from sample to sample, to and fro, while its rates know nothing of it."""
    leap: Change = lambda t_s, state: state._replace(
        rotation=state.rotation * rotvec(4.0 * (round(t_s * 10) % 2), 0, 0)
    )
    return between(since_s, until_s, leap)


def flown(
    says: Sequence[tuple[float, Any]], bad_s: tuple[float, float] = (0, 12), seconds: float = 30, **given: Any
) -> Any:
    craft = Craft(hz=10, also=says, imu=lambda _, state: state, **two_sided(converging(bad_s[1], bad_s[0])), **given)
    return watched(craft.records(seconds))


SOURCES: dict[str, tuple[Says, str]] = {
    "uninitialised": ([(0.0, ekf(1024)), (12.2, ekf(831))], "EKF_STATUS_REPORT"),
    "no attitude": ([(0.2, ekf(0)), (4.0, ekf(1024)), (12.2, ekf(1))], "EKF_STATUS_REPORT"),
    "PX4's": ([(0.0, estimator(0)), (12.2, estimator(0x33F))], "ESTIMATOR_STATUS"),
    "its health": ([(0.0, status(False)), (12.2, status(True))], "SYS_STATUS"),
    "two of them": ([(0.0, ekf(1024)), (0.1, status(True)), (12.2, ekf(1))], "EKF_STATUS_REPORT"),
}


@pytest.mark.parametrize("name", SOURCES)
def test_alarms_wait(name: str) -> None:
    """Denied steps for 12 s are start-up, said with who said so; what came behind is judged."""
    says, source = SOURCES[name]
    events, vehicle = flown(says)
    assert alarms(vehicle) == []
    entry = check(vehicle, "kinematics")
    assert entry["verdict"] == "agree"
    assert entry["reason"].startswith("start-up from 10.")
    assert f"as {source} said that the attitude was not ready" in entry["reason"]
    assert entry["pairs"] == pytest.approx(2 * 10 * (30 - 12.2), abs=4)
    (waits,) = told(events, "no_compare")
    assert waits["reason"] == f"start-up: {source} says that the attitude is not ready"
    (goes_on,) = told(events, "compare_resumed")
    assert goes_on["boot_s"] == pytest.approx(BOOT_S + 12.2)


@pytest.mark.slow
def test_without_a_word_of_it_they_do_not() -> None:
    """The same while nobody says anything, or says that it is ready, is an alarm."""
    for says in ([], [(0.0, ekf(831))], [(0.0, status(True))]):
        assert {one["check"] for one in alarms(flown(says)[1])} == {"kinematics"}


@pytest.mark.parametrize(
    "says",
    [
        [(0.0, ekf(831)), (11.0, ekf(0))],
        [(0.0, ekf(1024)), (5.0, ekf(831)), (11.0, ekf(1024))],
        [(0.0, estimator(1)), (11.0, ekf(1024)), (11.0, status(False))],
    ],
    ids=["ready", "ready after start-up", "another says so"],
)
def test_in_flight_nothing_waits(says: Says) -> None:
    """An estimator that loses its attitude after it was ready: that is what alarms are for."""
    found = alarms(flown(says, bad_s=(12, 20))[1])
    assert {one["check"] for one in found} == {"kinematics"}
    assert found[0]["raised_boot_s"] < 12 + 2


def test_who_is_armed_is_not_starting() -> None:
    """A recording that begins in flight, with an estimator that has lost it."""
    assert alarms(flown([(0.0, ekf(0))], base_mode=ARMED)[1]) != []


@pytest.mark.slow
def test_it_does_not_wait_for_ever() -> None:
    """DCM reports no flags at all: after two minutes it is judged nevertheless."""
    found = alarms(flown([(0.0, ekf(0))], bad_s=(0, 130), seconds=132)[1])
    assert found[0]["raised_boot_s"] == pytest.approx(120 + 1.4, abs=0.3)


def test_nothing_but_start_up() -> None:
    """Where it never got ready nothing was judged, and that is why."""
    _, vehicle = flown([(0.0, ekf(1024))])
    assert vehicle["verdict"] == "no_compare" or check(vehicle, "euler_quaternion")["verdict"] == "agree"
    entry = check(vehicle, "kinematics")
    assert entry["verdict"] == "no_compare"
    assert entry["reason"].startswith("start-up from 10.0 to 39.9 s of boot 0: not judged")


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("name", ["PX4's", "two of them"])
def test_it_is_cut_anywhere(name: str) -> None:
    """The same events and report however the recording is cut."""
    says, _ = SOURCES[name]
    tipped: Change = lambda _, state: state._replace(rotation=rotvec(20, 0, 0))
    craft = Craft(
        hz=10, also=says, turn=still(), imu=lambda _, state: state, euler=between(0, 14, tipped), second=lambda _, s: s
    )
    data = wire.tlog(craft.records(20))
    results = []
    for size in (len(data), 13, 97):  # shorter than any frame, or some frames
        monitor = Monitor()
        events = [event for at in range(0, len(data), size) for event in monitor.feed_recording(data[at : at + size])]
        results.append((events + monitor.finish(), monitor.close().to_dict()))
    assert results[1] == results[0]
    assert results[2] == results[0]
