"""The compass: followed, worth a remark, never an alarm."""

import pytest

from tests.helpers.craft import Change, Craft, State, alarms, between, check, judged, rotvec, rpy, still, true


def compass_off(deg: float) -> Change:
    """An IMU whose field is turned about down by this much; its gyro and force are right."""

    def change(_: float, state: State) -> State:
        field_turned = rotvec(0, 0, -deg) * state.rotation
        return state._replace(rotation=field_turned)

    return change


@pytest.mark.parametrize(("deg", "remark"), [(40.0, True), (25.0, False)])
def test_a_compass_that_is_disturbed(deg: float, remark: bool) -> None:
    """A field that turns away by 40° in flight is a remark, one by 25° is not; neither is an alarm or a warning."""
    vehicle = judged(Craft(imu=between(25, 30, compass_off(deg)), hz=10), 35)
    entry = check(vehicle, "mag_heading")
    assert alarms(vehicle) == []
    assert entry["verdict"] == "agree"
    assert entry["residual"]["max"] == pytest.approx(deg, abs=4.5)  # by then a sixth of the mean
    assert ("a hint, no alarm" in entry["reason"]) == remark


def test_a_constant_difference_is_no_difference() -> None:
    """Declination and mounting are constant: 60° from the beginning are none."""
    entry = check(judged(Craft(imu=compass_off(60), hz=10), 20), "mag_heading")
    assert entry["residual"]["max"] < 0.5
    assert "hint" not in entry["reason"]


def test_no_compass() -> None:
    """Without a field there is nothing to compare."""
    assert check(judged(Craft(), 5), "mag_heading")["verdict"] == "no_compare"
    assert check(judged(Craft(imu=true, hz=10), 15), "mag_heading")["verdict"] == "agree"


@pytest.mark.parametrize(("bank", "remark"), [(0, True), (20, False)])
def test_while_banked_more_is_usual(bank: float, remark: bool) -> None:
    """40° are a hint while level; above 10° of bank 60° would be."""
    vehicle = judged(Craft(turn=still(rpy(roll=bank)), imu=between(25, 30, compass_off(40)), hz=10), 35)
    assert ("a hint, no alarm" in check(vehicle, "mag_heading")["reason"]) == remark


def test_a_heading_that_no_compass_made() -> None:
    """A field that turns round and round agrees with the heading by chance alone: no agreement, and that is why."""
    round_and_round: Change = lambda t_s, state: compass_off(40 * t_s)(t_s, state)
    entry = check(judged(Craft(imu=round_and_round, hz=10), 60), "mag_heading")
    assert entry["verdict"] == "no_compare"
    assert entry["reason"].startswith("the compass and the heading never agreed for long")
