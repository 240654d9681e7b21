"""Small recordings of a kind each on which a check once said something untrue."""

from functools import cache
from typing import Any

import pytest

import gcs_bridge
from tests.helpers.craft import check
from tests.helpers.paths import ROOT

CASES = ROOT / "tests" / "data" / "cases"


@cache
def vehicle(name: str) -> dict[str, Any]:
    (entry,) = gcs_bridge.check(CASES / f"{name}.tlog").to_dict()["files"][0]["vehicles"]
    found: dict[str, Any] = entry
    return found


def raised(name: str) -> list[tuple[str, str]]:
    return [(alarm["check"], alarm["severity"]) for alarm in vehicle(name)["alarms"]]


def test_a_swing_as_fast_as_the_samples() -> None:
    """3.4 Hz sampled at 4 Hz: gyro and rates show different parts of it, and nothing can be told."""
    assert raised("alias_3.4_45") == []
    assert "its motion is too fast for the streams" in check(vehicle("alias_3.4_45"), "gyro")["reason"]


def test_an_estimator_that_starts() -> None:
    """Its attitude converges while EKF_STATUS_REPORT says that it is not ready, up to 9.2 s behind the start."""
    assert raised("startup_dcm") == []
    entry = check(vehicle("startup_dcm"), "kinematics")
    assert entry["verdict"] == "agree"
    assert entry["reason"].startswith("start-up from 2.2 to 11.2 s of boot 0: not judged, as EKF_STATUS_REPORT said")


def test_a_second_estimate_that_sees_another_down() -> None:
    """8.8° of tilt from the first sample on: one warning, and no agreement."""
    assert raised("ahrs2_tilt") == [("secondary_estimate", "warning")]
    (alarm,) = vehicle("ahrs2_tilt")["alarms"]
    assert (alarm["peak"], alarm["repeats"]) == (pytest.approx(8.8, abs=0.01), 0)


def test_rates_that_no_gyro_measures() -> None:
    """202 rad/s: said so, and gravity is judged all the same."""
    assert raised("rates_garbage") == [("kinematics", "warning")]
    (alarm,) = vehicle("rates_garbage")["alarms"]
    assert alarm["what"] == "the rates of ATTITUDE are beyond any gyro"
    assert alarm["peak"] == pytest.approx(11585, abs=1)  # 202.2 rad/s
    assert check(vehicle("rates_garbage"), "gravity")["verdict"] == "agree"
    assert "beyond any gyro" in check(vehicle("rates_garbage"), "gyro")["reason"]


@pytest.mark.parametrize("name", ["gyro", "gravity"])
def test_an_imu_of_zeros(name: str) -> None:
    """Nothing can be compared with it, and that is why."""
    entry = check(vehicle("dead_imu"), name)
    assert entry["verdict"] == "inop"
    assert entry["reason"].startswith("the IMU sends zeros (RAW_IMU)")


def test_rates_of_the_angles() -> None:
    """Euler rates in a turn at 45° of bank: a warning of each message, and its cause; the same turn with body rates."""
    assert raised("euler_rates_sent") == [("kinematics", "warning")] * 2
    assert {alarm["diagnosis"]["cause"] for alarm in vehicle("euler_rates_sent")["alarms"]} == {"euler_rates"}
    assert vehicle("banked_turn")["verdict"] == "agree"
    assert vehicle("banked_turn")["alarms"] == []


def test_a_quaternion_of_zeros() -> None:
    """One fault, one alarm: it comes, so there is nothing to ask for; its norm is not the matter, nor is it frozen."""
    assert check(vehicle("zero_quaternion"), "euler_quaternion")["reason"] == (
        "600 of 600 ATTITUDE_QUATERNION are all four zero: no attitude"
    )
    (alarm,) = vehicle("zero_quaternion")["alarms"]
    assert alarm["what"] == "ATTITUDE_QUATERNION is all four zero: no attitude"
