"""ATTITUDE against ATTITUDE_QUATERNION, once the motion is known exactly: small errors, and what they are called."""

from typing import Any

import numpy as np
import pytest

from benchmarks.trust_faults import START
from benchmarks.trust_links import Link
from gcs_bridge import Monitor
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scanner import Scanner
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers.apart import PLANE
from tests.helpers.craft import (
    Change,
    Craft,
    alarms,
    between,
    check,
    judged,
    rpy,
    still,
    turned_in_body,
    turned_in_world,
)
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES

SQUARE = FIXTURES / "a_copter_square.tlog"
FAULT_S = (3.0, 7.0)
LONG_S = (12.0, 25.0)


def flown(change: Change, fault_s: tuple[float, float] = FAULT_S, **given: Any) -> list[dict[str, Any]]:
    vehicle = judged(Craft(**{"quaternion": between(*fault_s, change), "hz": 10.0, **given}), fault_s[1] + 8)
    return alarms(vehicle, "euler_quaternion")


def test_a_lag_that_shows_in_each_swing_alone() -> None:
    """40 ms in a vehicle that swings: 6 to 10° for 0.7 s at a time, and nothing in between. The second swing tells."""
    data = inject((FIXTURES / "k8_stream_stops.tlog").read_bytes(), [parse_fault("time_skew:-40")], from_s=26.7)
    monitor = Monitor()
    monitor.feed_recording(data)
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    (alarm,) = [alarm for alarm in vehicle["alarms"] if alarm["check"] == "euler_quaternion"]
    assert 106 < alarm["raised_boot_s"] < 108
    assert alarm["diagnosis"]["causes"] == ["time_skew"]
    assert alarm["diagnosis"]["value"] == pytest.approx(-40, abs=2)


@pytest.mark.parametrize("fault", one_in(3, ["yaw_offset:0.4", "mount_offset:0,0.4,0", "world_offset:0.3,0.3,0"]))
def test_what_is_behind_a_warning_is_named(fault: str) -> None:
    """A small turn from second 60 on: what the mean rests on begins before it, and it is named all the same."""
    monitor = Monitor()
    monitor.feed_recording(inject(SQUARE.read_bytes(), [parse_fault(fault)], from_s=60))
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    (warning,) = vehicle["alarms"]
    made = parse_fault(fault)
    assert (warning["severity"], warning["diagnosis"]["candidates"]) == ("warning", [made.name])
    assert np.ravel(warning["diagnosis"]["value"]) == pytest.approx(made.value, abs=0.001)


@pytest.mark.slow
def test_one_degree_in_hover() -> None:
    """1° of yaw between the two forms of a real hover at 25 Hz, from second 60 on: an alarm within 1.5 s."""
    data = inject(SQUARE.read_bytes(), [parse_fault("yaw_offset:1")], from_s=60)
    monitor = Monitor()
    monitor.feed_recording(data)
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    (alarm,) = [alarm for alarm in vehicle["alarms"] if alarm["severity"] == "alarm"]
    begin_s = vehicle["boots"][0]["first_boot_s"] + 60  # the recording begins less than 0.5 s before its first attitude
    assert alarm["check"] == "euler_quaternion"
    assert -0.5 < alarm["raised_boot_s"] - begin_s <= 1.5
    assert alarm["axis"] == "heading"
    assert alarm["heading"] == pytest.approx(1.0, abs=0.01)
    assert alarm["peak"] == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("deg", "severity"), [(0.53, "alarm"), (0.51, "warning"), (0.25, None)])
def test_where_the_limits_are(deg: float, severity: str | None) -> None:
    """0.5° and 0.02° of a pair's own bound are the alarm's limit; 0.3° in the mean is the warning's."""
    found = flown(turned_in_body(deg, 0, 0), LONG_S)
    assert [alarm["severity"] for alarm in found] == ([severity] if severity else [])


@pytest.mark.slow
def test_an_alarm_says_what_it_is() -> None:
    """1° of roll on a level vehicle: what, axis, size, and what it is not; raised 1.2 s behind its onset."""
    (alarm,) = flown(turned_in_body(1, 0, 0), turn=still())
    assert alarm["what"] == "ATTITUDE and ATTITUDE_QUATERNION are not one rotation"
    assert alarm["is_not"] == "not an estimator that is wrong: both messages come from one estimate"
    assert alarm["axis"] == "tilt, about body x (roll)"
    assert alarm["rotvec_body"] == pytest.approx([1, 0, 0], abs=1e-4)
    assert (alarm["tilt"], alarm["heading"]) == pytest.approx((1, 0), abs=1e-4)
    assert alarm["raised_boot_s"] == pytest.approx(FAULT_S[0] + 0.2 + 1.0)
    assert alarm["cleared_boot_s"] == pytest.approx(FAULT_S[1] + 0.2 + 2.0)


def test_a_small_constant_offset_is_a_warning_by_the_mean() -> None:
    """0.4° from 12 s on: three quarters of the last 10 s make a mean of 0.3° at 19.5 s, and 3 s later it is told."""
    (warning,) = flown(turned_in_world(0, 0, 0.4), LONG_S)
    assert warning["severity"] == "warning"
    assert warning["what"] == "ATTITUDE and ATTITUDE_QUATERNION differ by a small constant turn"
    assert warning["axis"] == "heading"
    assert warning["raised_boot_s"] == pytest.approx(12 + 7.5 + 3, abs=0.15)
    assert warning["peak"] == pytest.approx(0.4, abs=0.01)
    # Below 70 % of 0.3° once less than 5.25 of the 10 s are left of it; two seconds later it is gone.
    assert warning["cleared_boot_s"] == pytest.approx(25 + 4.75 + 2, abs=0.15)


def test_a_constant_offset_that_the_motion_turns_about() -> None:
    """0.4° about body x while the vehicle turns: constant in body axes, though not in the world."""
    (warning,) = flown(turned_in_body(0.4, 0, 0), LONG_S)
    assert warning["axis"] == "tilt, about body x (roll)"


def test_noise_has_no_mean() -> None:
    """±0.45° from sample to sample is 0 in the mean: nothing."""
    noise: Change = lambda t_s, state: turned_in_body(0.45 * (-1) ** round(t_s * 10), 0, 0)(t_s, state)
    assert flown(noise, LONG_S) == []


@pytest.mark.slow
def test_roll_at_sixty_degrees_of_pitch_names_the_body_axis() -> None:
    """6° about body x at 60° of pitch is 3° of tilt and 5.2° about down: neither alone, but roll."""
    (alarm,) = flown(turned_in_body(6, 0, 0), turn=still(rpy(pitch=60)))
    assert alarm["axis"] == "tilt and heading, about body x (roll)"
    assert alarm["rotvec_body"] == pytest.approx([6, 0, 0], abs=1e-3)
    assert alarm["tilt"] == pytest.approx(3, abs=0.01)  # sin of 30°, the angle between body x and down
    assert alarm["heading"] == pytest.approx(-5.2, abs=0.01)  # 6° times −sin 60°


@pytest.mark.slow
@pytest.mark.parametrize("pitch", one_in(3, [0, 60, 89]))
def test_yaw_is_never_roll(pitch: float) -> None:
    """6° about the world's down is heading and no tilt at any pitch, though at 89° it lies along body x."""
    (alarm,) = flown(turned_in_world(0, 0, 6), turn=still(rpy(pitch=pitch)))
    assert alarm["axis"] == "heading"
    assert (alarm["tilt"], alarm["heading"]) == pytest.approx((0, 6), abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("pitched", "waits_s"), [((15,), 3.0), ((30,), 0.0), ((30, 15), 0.0)])
def test_a_plane_that_is_pitched_may_be_trimmed_and_not_by_thirty_degrees(
    pitched: tuple[float, ...], waits_s: float
) -> None:
    """Level flight, another 15° of pitch from 12 s on: a trim, maybe, until 3 s have not fitted it; 30° are none.

    Nor are 15° any more that come behind 30°, half a second later, within one disagreement.
    """
    change: Change = lambda t_s, state: turned_in_body(0, pitched[0 if t_s < 12.5 else -1], 0)(t_s, state)
    (alarm,) = flown(change, LONG_S, turn=still(), kind=PLANE)
    assert alarm["raised_boot_s"] == pytest.approx(12 + waits_s + 0.2 + 1.0, abs=0.11)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "hz", "loss", "since_s", "most_s"),
    [("d_tailsitter", 4.0, 0.2, 103.7, 4.0), ("d_tailsitter_tumble", 10.0, 0.0, 164.02, 2.0)],
)
def test_a_lag_at_the_end_of_a_tailsitters_flight(
    name: str, hz: float, loss: float, since_s: float, most_s: float
) -> None:
    """150 ms, a few seconds before the end, and no two stamps alike: what is large at once is no trim that comes."""
    data = Link(rate_hz=hz, loss=loss, trouble="none").bring((FIXTURES / f"{name}.tlog").read_bytes())
    t_us = Scanner(load_dialect("all"), timed=True).scan(data, final=True)["t_rx_us"]
    from_s = START * (int(t_us.max()) - int(t_us[t_us > 0][0])) / 1e6
    monitor = Monitor()
    monitor.feed_recording(inject(data, [parse_fault("time_skew:150")], from_s=from_s))
    (vehicle,) = monitor.close().to_dict()["files"][0]["vehicles"]
    (alarm,) = [alarm for alarm in vehicle["alarms"] if alarm["severity"] == "alarm"]
    assert alarm["check"] == "euler_quaternion"
    assert 0.0 < alarm["raised_boot_s"] - since_s < most_s


def test_a_healthy_flight() -> None:
    """Without a fault nothing is said, and the residual is that of float32."""
    vehicle = judged(Craft(), 15)
    assert alarms(vehicle) == []
    assert check(vehicle, "euler_quaternion")["verdict"] == "agree"
    assert check(vehicle, "euler_quaternion")["residual"]["max"] < 4e-5
