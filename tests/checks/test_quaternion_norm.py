"""The norm of ATTITUDE_QUATERNION: 1e-3 off is a warning, 1e-2 an alarm, and the angle is still judged."""

import pytest

from tests.helpers.craft import (
    Change,
    Craft,
    State,
    alarms,
    between,
    check,
    judged,
    turned_in_world,
    watched,
    with_norm,
)

BEGIN_S, END_S = 4.0, 8.0  # of the fault; samples come every 0.05 s
RAISED_S = BEGIN_S + 0.1 + 1.0  # with the third bad sample pending, a second later raised
CLEARED_S = END_S + 0.1 + 2.0


@pytest.mark.parametrize("norm", [1.05, 0.95, 1.011, 0.989])
def test_an_alarm_above_a_hundredth(norm: float) -> None:
    """A quaternion more than 1 % too long or too short raises this check's alarm, named right, and no other check's."""
    vehicle = judged(Craft(quaternion=between(BEGIN_S, END_S, with_norm(norm))), 15)
    (alarm,) = [alarm for alarm in alarms(vehicle) if alarm["severity"] == "alarm"]
    assert {alarm["check"] for alarm in alarms(vehicle)} == {"quaternion_norm"}
    assert alarm["what"] == "the norm of ATTITUDE_QUATERNION is not 1"
    assert alarm["is_not"] == "not a wrong angle: that is judged on a normalised copy"
    assert (alarm["unit"], alarm["axis"], alarm["tilt"], alarm["rotvec_body"]) == ("1", None, None, None)
    assert alarm["peak"] == pytest.approx(abs(norm - 1), abs=1e-6)
    assert alarm["raised_boot_s"] == pytest.approx(RAISED_S)
    assert alarm["cleared_boot_s"] == pytest.approx(CLEARED_S)
    assert check(vehicle, "euler_quaternion")["verdict"] == "agree"
    assert vehicle["verdict"] == check(vehicle, "quaternion_norm")["verdict"] == "alarm"


@pytest.mark.parametrize("norm", [1.002, 0.998, 1.0011, 1.009])
def test_a_warning_above_a_thousandth(norm: float) -> None:
    """Between 0.1 % and 1 % it is a warning, and no alarm."""
    vehicle = judged(Craft(quaternion=between(BEGIN_S, END_S, with_norm(norm))), 15)
    (warning,) = alarms(vehicle)
    assert (warning["check"], warning["severity"]) == ("quaternion_norm", "warning")
    assert warning["raised_boot_s"] == pytest.approx(RAISED_S)
    assert warning["cleared_boot_s"] == pytest.approx(CLEARED_S)
    assert vehicle["verdict"] == "warning"


@pytest.mark.parametrize("norm", [1.0005, 0.9991])
def test_less_is_nothing(norm: float) -> None:
    """Below 0.1 % nothing is said."""
    vehicle = judged(Craft(quaternion=with_norm(norm)), 15)
    assert alarms(vehicle) == []
    entry = check(vehicle, "quaternion_norm")
    assert entry["verdict"] == "agree"
    assert entry["residual"]["max"] == pytest.approx(abs(norm - 1), abs=1e-6)


def test_a_zero_quaternion_is_a_fault_of_the_norm_and_no_angle() -> None:
    """Zeros have no direction: the norm is off by 1, and no pair of them is judged as an angle."""
    vehicle = judged(Craft(quaternion=between(BEGIN_S, END_S, with_norm(0.0))), 15)
    assert alarms(vehicle, "euler_quaternion") == []
    assert alarms(vehicle, "quaternion_norm")[0]["peak"] == 1.0
    assert check(vehicle, "euler_quaternion")["residual"]["max"] < 1e-4


@pytest.mark.slow
def test_the_angle_of_a_long_quaternion_is_judged() -> None:
    """A quaternion 1.05 long and 25° of yaw off raises both alarms, the angle measured as if its norm were 1."""

    def both(t_s: float, state: State) -> object:
        return with_norm(1.05)(t_s, turned_in_world(0, 0, 25)(t_s, state))

    vehicle = judged(Craft(quaternion=between(BEGIN_S, END_S, both)), 15)
    (angle,) = alarms(vehicle, "euler_quaternion")
    assert angle["peak"] == pytest.approx(25, abs=1e-4)
    assert "alarm" in {alarm["severity"] for alarm in alarms(vehicle, "quaternion_norm")}


def test_a_warning_is_not_told_beside_the_alarm() -> None:
    """Norm 1.05 is above both limits: the alarm is told, and nothing of a warning, in events and report."""
    events, vehicle = watched(Craft(quaternion=between(BEGIN_S, END_S, with_norm(1.05))).records(15))
    assert {alarm["severity"] for alarm in alarms(vehicle)} == {"alarm"}
    assert {event["severity"] for event in events if event["event"].startswith("alarm")} == {"alarm"}


def test_a_warning_that_outlasts_the_alarm_is_told() -> None:
    """Norm 1.05 and then 1.005: once the alarm has cleared, the warning that still stands is told."""
    fault = between(BEGIN_S, END_S, with_norm(1.05), between(END_S, 25, with_norm(1.005)))
    vehicle = judged(Craft(quaternion=fault), 30)
    assert [alarm["severity"] for alarm in alarms(vehicle)] == ["alarm", "warning"]
    alarm, warning = alarms(vehicle)
    assert alarm["cleared_boot_s"] == pytest.approx(CLEARED_S)
    assert warning["raised_boot_s"] >= CLEARED_S - 1e-6
    assert warning["cleared_boot_s"] == pytest.approx(25.1 + 2.0)


@pytest.mark.parametrize("of_three", [3, 2])
def test_quaternions_of_zeros(of_three: int) -> None:
    """All four zero, always or two times of three: an alarm that says so, and none of the norm."""
    none: Change = lambda t_s, state: state._replace(norm=0.0 if round(t_s * 20) % 3 < of_three else 1.0)
    found = alarms(judged(Craft(quaternion=none), 20), "quaternion_norm")
    assert {alarm["what"] for alarm in found} == {"ATTITUDE_QUATERNION is all four zero: no attitude"}
    assert found[0]["is_not"] == "not a stream that is missing: it comes, with nothing in it"


def test_zeros_for_a_while() -> None:
    """Zeros from 5 to 9 s: the alarm goes with them."""
    (alarm,) = alarms(judged(Craft(quaternion=between(5, 9, with_norm(0.0))), 20), "quaternion_norm")
    assert alarm["raised_boot_s"] == pytest.approx(5.0 + 0.1 + 1.0)
    assert alarm["cleared_boot_s"] == pytest.approx(9.0 + 0.1 + 2.0, abs=0.06)
