"""The rates of the two messages at one instant: one estimate has one set of body rates."""

import pytest

from tests.helpers.craft import (
    Craft,
    alarms,
    between,
    check,
    judged,
    one_sided,
    rates_off,
    spinning,
    swaying,
    with_rates,
)

TURNING = spinning(deg_s=20)  # steady: nothing of a difference is the motion's own
FAULT_S = (4.0, 8.0)


@pytest.mark.parametrize(
    ("off_deg_s", "severity"), [(11.0, "alarm"), (-40.0, "alarm"), (2.3, "warning"), (9.0, "warning")]
)
@pytest.mark.parametrize("side", ["euler", "quaternion"])
def test_rates_that_differ(side: str, off_deg_s: float, severity: str) -> None:
    """In a steady turn, rates 2 °/s apart are a warning and 10 °/s apart an alarm, on whichever side they are wrong."""
    vehicle = judged(Craft(turn=TURNING, **one_sided(side, between(*FAULT_S, rates_off(0, off_deg_s, 0)))), 12)
    (alarm,) = [alarm for alarm in alarms(vehicle, "body_rates") if alarm["severity"] == severity]
    assert severity == "alarm" or len(alarms(vehicle, "body_rates")) == 1
    assert alarm["what"] == "the body rates of ATTITUDE and ATTITUDE_QUATERNION differ"
    assert alarm["is_not"] == "not the angles: they are judged by other checks"
    assert (alarm["unit"], alarm["axis"]) == ("deg/s", "body y (pitch)")
    assert alarm["peak"] == pytest.approx(abs(off_deg_s), abs=0.01)
    sign = 1 if side == "quaternion" else -1  # the quaternion's rates minus the Euler angles'
    assert alarm["rotvec_body"] == pytest.approx([0, sign * off_deg_s, 0], abs=0.01)
    assert alarm["raised_boot_s"] == pytest.approx(
        FAULT_S[0] + 1.1, abs=0.06
    )  # D: the first step of the rates is a change
    assert alarm["cleared_boot_s"] == pytest.approx(FAULT_S[1] + 2.1, abs=0.06)
    assert alarms(vehicle, "euler_quaternion") == []


def test_rates_that_hardly_differ() -> None:
    """1.8 °/s apart is nothing."""
    vehicle = judged(Craft(turn=TURNING, quaternion=rates_off(0, 1.8, 0)), 12)
    assert alarms(vehicle, "body_rates") == []
    assert check(vehicle, "body_rates")["residual"]["median"] == pytest.approx(1.8, abs=1e-3)


def test_what_the_motion_explains() -> None:
    """Rates taken one sample later differ by no more than they change from sample to sample: healthy."""
    late = lambda t_s, state: state._replace(rates=SWAY(t_s - 0.05)[1])
    vehicle = judged(Craft(turn=SWAY, quaternion=late), 20)
    assert check(vehicle, "body_rates")["residual"]["max"] > 5
    assert alarms(vehicle, "body_rates") == []


SWAY = swaying(by_deg=30, period_s=2)  # 94 °/s at most, and 15 °/s of change from one sample to the next


def test_a_message_without_rates() -> None:
    """Where one message's rates are all zero they are not reported: nothing is compared."""
    vehicle = judged(Craft(turn=TURNING, quaternion=with_rates(lambda rates: 0 * rates)), 12)
    entry = check(vehicle, "body_rates")
    assert (entry["verdict"], entry["pairs"]) == ("no_compare", 0)
    assert entry["reason"] == "the two messages never came at the same instant with rates in both"
