"""What sampling cannot tell is not judged, in gyro, kinematics and gravity; and what it can is found as before."""

from typing import Any

import numpy as np
import pytest

from tests.helpers.craft import Array, alarms, check, highres_imu, raw_imu, watched
from tests.helpers.everyday import in_turns, one_in
from tests.helpers.oscillating import swing

# Of the swing's frequency to the samples'. Nearer to 1 and 2 the beat is slower than what is looked back on, and a gyro
# that is read between the samples looks as if it were wrong: nothing on the link tells the two apart.
RATIOS = (0.3, 0.45, 0.5, 0.6, 0.7, 0.85, 0.95, 1.05, 1.43, 1.9, 2.05)
STREAMS = ((4.0, 4.0, 0.5), (4.0, 2.0, 0.25), (2.0, 4.0, 0.8), (10.0, 10.0, 0.25), (10.0, 30.0, 0.5), (20.0, 20.0, 0.8))


def flown(*given: Any, **more: Any) -> dict[str, Any]:
    return watched(swing(*given, **more))[1]


@pytest.mark.parametrize(
    ("sampled_hz", "imu_hz", "place", "ratio"),
    one_in(7, [(*streams, ratio) for ratio, streams in in_turns(2, RATIOS, STREAMS)]),
)
def test_a_swing_that_the_samples_miss_is_no_fault(
    sampled_hz: float, imu_hz: float, place: float, ratio: float
) -> None:
    """Whatever its frequency and size, a gyro that says exactly what the rates say raises nothing, nor do these."""
    for deg_s in (45.0, 110.0):
        vehicle = flown(ratio * sampled_hz, deg_s, sampled_hz=sampled_hz, imu_hz=imu_hz, place=place)
        assert alarms(vehicle) == []


@pytest.mark.parametrize("quaternion", [False, True])
def test_what_was_not_judged_is_said(quaternion: bool) -> None:
    """A swing of 3.4 Hz at 4 Hz for 23 of 45 s: some of it is not judged, and the rest agrees."""
    entry = check(flown(3.4, 60, sampled_hz=4, quaternion=quaternion), "gyro")
    assert entry["verdict"] == "agree"
    assert "too fast for the streams" in entry["reason"]
    assert entry["coverage"] < 0.8


def test_all_of_it_too_fast() -> None:
    """110 °/s at 4 Hz may turn 27° from sample to sample: where all is like that, that is the reason, and no other."""
    vehicle = flown(3.4, 110, sampled_hz=4, span_s=(0, 45))
    for name in ("gyro", "kinematics"):
        assert check(vehicle, name)["verdict"] == "no_compare"
        assert check(vehicle, name)["reason"].startswith("its motion is too fast for the streams")


def off(deg_s: float, since_s: float = 25.0) -> Any:
    """A gyro that is off about x from some time on."""
    return lambda t_s, rates: rates + (np.radians([deg_s, 0, 0]) if t_s >= since_s else 0)


@pytest.mark.parametrize("message", [raw_imu, highres_imu])
@pytest.mark.parametrize(
    ("sampled_hz", "hz", "deg_s"), one_in(2, [(4, 0.2, 20), (10, 0.5, 60), (25, 1, 60), (50, 2, 100)])
)
def test_a_gyro_that_is_off_in_motion(sampled_hz: float, hz: float, deg_s: float, message: Any) -> None:
    """A lane switch of 45.9 °/s, while the vehicle swings with five samples a period or more: an alarm in 3 s."""
    found = alarms(flown(hz, deg_s, sampled_hz=sampled_hz, gyro=off(45.9), imu_message=message), "gyro")
    first = next(one for one in found if one["severity"] == "alarm")
    assert 25.0 + 1.0 <= first["raised_boot_s"] <= 25.0 + 3.0
    assert first["axis"] == "body x (roll)"


def negated(t_s: float, rates: Array) -> Array:
    return rates * [-1.0, 1.0, 1.0] if t_s >= 20.0 else rates


@pytest.mark.slow
@pytest.mark.parametrize(("sampled_hz", "hz"), [(10, 0.4), (25, 1.0), (50, 2.0)])
def test_a_gyro_with_a_wrong_axis(sampled_hz: float, hz: float) -> None:
    """x of the other sign: off by twice the rate, ±120 °/s, which an account of the turn by the rates shows."""
    found = alarms(flown(hz, 60, sampled_hz=sampled_hz, gyro=negated), "gyro")
    assert "alarm" in {one["severity"] for one in found}


def test_the_bias_is_not_pulled_off_by_a_gap() -> None:
    """After 12 s without a gyro a sample of a swing says little of the bias: nothing is raised in the calm behind."""
    records = swing(0.8, 150, sampled_hz=10, span_s=(15, 31), gyro=lambda _, rates: rates * [1.03, 1, 1])
    start_us = records[0][0]
    left = [one for one in records if not 18e6 < one[0] - start_us < 30.3e6 or one[1][7:10] != b"\x1b\0\0"]
    assert len(left) < len(records) - 100  # RAW_IMU is message 27, 0x1b
    assert alarms(watched(left)[1], "gyro") == []


def test_gravity_in_a_swing_that_looks_like_rest() -> None:
    """5° to and fro at 3.96 Hz, seen at its ends by a gyro four times a second, half a swing later by the attitude."""
    assert alarms(flown(3.96, 124, sampled_hz=4, place=0.5, span_s=(5, 45)), "gravity") == []
