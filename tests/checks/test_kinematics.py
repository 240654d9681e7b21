"""Each stream's rotation against its own rates: steps that the rates deny, rates of another scale, resets."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.helpers.craft import (
    BOOT_S,
    Array,
    Change,
    Craft,
    State,
    alarms,
    between,
    check,
    judged,
    one_sided,
    rotvec,
    rpy,
    spinning,
    swaying,
    told,
    two_sided,
    watched,
    with_rates,
)
from tests.helpers.everyday import one_in

SIDES = {"euler": "ATTITUDE", "quaternion": "ATTITUDE_QUATERNION"}
SWAY = swaying((0, 1, 0), by_deg=20, period_s=4)  # 31 °/s at most: 1.6° from sample to sample at 20 Hz


# --- steps -----------------------------------------------------------------------------------------------------------


def backwards(rates: float) -> Change:
    """The attitude of a vehicle that turns the other way than its rates say."""
    back = spinning(deg_s=-rates)
    return lambda t_s, state: State(back(t_s)[0], state.rates, state.force)


@pytest.mark.slow
@pytest.mark.parametrize("side", SIDES)
def test_a_stream_that_turns_the_other_way(side: str) -> None:
    """6° from sample to sample to the left while its rates say 6° to the right: 12° a step, an alarm of that stream."""
    craft = Craft(turn=spinning(deg_s=60), hz=10, **one_sided(side, between(5, 9, backwards(60))))
    vehicle = judged(craft, 20)
    (alarm,) = alarms(vehicle, "kinematics")
    assert alarm["severity"] == "alarm"
    assert alarm["what"] == f"{SIDES[side]} does not turn as its rates say"
    assert alarm["is_not"] == "not one form against the other: each stream contradicts its own rates"
    # At 5 s it leaps by 60° x 10 s = 600°, which is 120° the other way; then 12° a step. Denied from 5.0 s on; the
    # first of them could be a reset and has no vote, so the third vote comes with the fourth.
    assert alarm["raised_boot_s"] == pytest.approx(5.0 + 0.3 + 1.0)
    assert alarm["cleared_boot_s"] == pytest.approx(9.0 + 0.3 + 2.0)  # at 9.0 s it leaps back
    assert (alarm["axis"], alarm["unit"]) == ("body z (yaw)", "deg")


def shaken(deg: float, hz: float = 20) -> Change:
    """An attitude that leaps to and fro about x from sample to sample; its rates know nothing of it."""
    return lambda t_s, state: state._replace(rotation=state.rotation * rotvec(deg * (round(t_s * hz) % 2), 0, 0))


@pytest.mark.parametrize(("deg", "alarm"), [(2.6, True), (1.9, False)])
def test_the_limit_of_a_step(deg: float, alarm: bool) -> None:
    """Turning at 2 °/s, at 20 Hz, the limit is 2.2 + 0.002·2 + 1.5·0.05·0.1·2 = 2.22°: 2.6° is beyond, 1.9° within."""
    found = alarms(judged(Craft(**two_sided(between(5, 12, shaken(deg)))), 18), "kinematics")
    assert {one["severity"] for one in found} == ({"alarm"} if alarm else set())
    assert len(found) == (2 if alarm else 0)


@pytest.mark.slow
@pytest.mark.parametrize(("deg", "alarm"), [(3.5, True), (2.9, False)])
def test_the_limit_of_a_step_while_turning(deg: float, alarm: bool) -> None:
    """At 60 °/s and 10 Hz the limit is 2.2 + 0.002·60 + 1.5·0.1·0.1·60 = 3.22°: 3.5° is beyond, 2.9° within."""
    shaking = between(5, 12, shaken(deg, 10))
    found = alarms(judged(Craft(turn=spinning(deg_s=60), hz=10, **two_sided(shaking)), 18), "kinematics")
    assert [one["severity"] for one in found] == (["alarm", "alarm"] if alarm else [])


# --- slope -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1.5, 0.68])
@pytest.mark.parametrize("side", SIDES)
def test_rates_of_another_scale(side: str, factor: float) -> None:
    """Slopes of 1/1.5 and 1/0.68 from the beginning: with 8 s of them, and 5 s more of waiting, a warning."""
    (warning,) = alarms(
        judged(Craft(turn=SWAY, **one_sided(side, with_rates(lambda rates: factor * rates))), 25), "kinematics"
    )
    assert warning["severity"] == "warning"
    assert warning["what"] == f"the rates of {SIDES[side]} have another scale than its turn"
    assert warning["raised_boot_s"] == pytest.approx(8.0 + 5.0, abs=0.15)
    assert warning["axis"] == "body y (pitch)"
    assert warning["unit"] == "1"


def test_rates_in_the_wrong_sense_of_slow_motion() -> None:
    """Rates of the other sign in motion too slow for single steps: a warning of the scale."""
    found = alarms(judged(Craft(turn=swaying(by_deg=8, period_s=4), **two_sided(with_rates(lambda rates: -rates))), 25))
    assert [alarm["severity"] for alarm in found if alarm["check"] == "kinematics"] == ["warning", "warning"]


@pytest.mark.parametrize("factor", [1.0, 0.75, 1.4])
def test_rates_of_nearly_the_right_scale(factor: float) -> None:
    """A slope of turn against rate between 0.7 and 1.4 (1/1.4 = 0.71, 1/0.75 = 1.33) is healthy."""
    vehicle = judged(Craft(turn=SWAY, **two_sided(with_rates(lambda rates: factor * rates))), 30)
    assert alarms(vehicle) == []
    assert check(vehicle, "kinematics")["verdict"] == "agree"


def test_too_little_motion_shows_no_scale() -> None:
    """Swaying by 2° (2.2 °/s in the mean square, 4.4 as reported, below 5) is too little to tell the rates' scale."""
    slow = swaying(by_deg=2, period_s=4)
    assert alarms(judged(Craft(turn=slow, **two_sided(with_rates(lambda rates: 2 * rates))), 25)) == []


def test_too_few_samples_show_no_scale() -> None:
    """Below 10 Hz too much happens between two samples: no slope is told."""
    twice = with_rates(lambda rates: 2 * rates)
    vehicle = judged(Craft(turn=SWAY, hz=8, second_hz=4, **two_sided(twice)), 40)
    assert [alarm for alarm in alarms(vehicle, "kinematics") if alarm["severity"] == "warning"] == []


@pytest.mark.parametrize("deg_s", [20.0, 4.0])
@pytest.mark.parametrize("side", [*SIDES, None])
def test_rates_that_are_not_reported(side: str | None, deg_s: float) -> None:
    """A vehicle that turns and sends zero rates reports none: nothing is judged by them, and nothing agrees."""
    none = with_rates(lambda rates: 0 * rates)
    changed = two_sided(none) if side is None else one_sided(side, none)
    vehicle = judged(Craft(turn=spinning(deg_s=deg_s), hz=10, **changed), 30)
    entry = check(vehicle, "kinematics")
    assert alarms(vehicle, "kinematics") == []
    if side is None:
        assert entry["verdict"] == "no_compare"
        assert entry["reason"] == "no stream brought two attitudes in a row with body rates"


# --- resets ----------------------------------------------------------------------------------------------------------


def leaps(*at_s: float, deg: tuple[float, float, float] = (0, 0, 21.7)) -> Change:
    """The attitude leaps by a turn of the world at each of these times, and keeps it."""

    def change(t_s: float, state: State) -> State:
        leap = rotvec(*(sum(t_s >= one - 1e-9 for one in at_s) * np.array(deg)))
        return state._replace(rotation=leap * state.rotation)

    return change


def test_a_lone_reset_of_both_streams() -> None:
    """Both streams leap by 21.7° of yaw at 5 s: one reset told, with its size, and no alarm of any check."""
    events, vehicle = watched(Craft(**two_sided(leaps(5)), imu=lambda _, state: state).records(15))
    (reset,) = told(events, "estimator_reset")
    assert reset["boot_s"] == pytest.approx(BOOT_S + 5)
    assert reset["heading"] == pytest.approx(21.7, abs=0.15)  # and a tenth of a degree that it really turned
    assert reset["tilt"] == pytest.approx(0, abs=1e-3)
    assert alarms(vehicle) == []


def test_a_lone_reset_of_the_tilt() -> None:
    """A leap of 10° about north is a reset of the tilt."""
    (reset,) = told(watched(Craft(**two_sided(leaps(5, deg=(10, 0, 0)))).records(15))[0], "estimator_reset")
    assert reset["tilt"] == pytest.approx(10, abs=0.01)
    assert abs(reset["heading"]) < 0.2


def test_a_leap_within_the_limit_is_no_reset() -> None:
    """A leap of 2.1° is below 2.2°: it may be motion."""
    events, _ = watched(Craft(**two_sided(leaps(5, deg=(0, 0, 2.0)))).records(15))
    assert told(events, "estimator_reset") == []


@pytest.mark.slow
def test_a_leap_of_one_stream_alone_is_no_reset() -> None:
    """The quaternion leaps and the Euler angles do not: no reset, but two forms that disagree."""
    events, vehicle = watched(Craft(quaternion=leaps(5)).records(15))
    assert told(events, "estimator_reset") == []
    assert [alarm["check"] for alarm in alarms(vehicle)] == ["euler_quaternion"]


def test_a_reset_of_the_only_stream() -> None:
    """Where only one of the two streams comes, its lone leap is a reset."""
    events, vehicle = watched(Craft(euler=leaps(5), quaternion=None).records(15))
    (reset,) = told(events, "estimator_reset")
    assert reset["heading"] == pytest.approx(21.7, abs=0.15)
    assert alarms(vehicle, "kinematics") == []


@pytest.mark.parametrize("count", [2, 3])
def test_leaps_in_a_row_are_no_reset(count: int) -> None:
    """Two or three leaps from sample to sample are no reset; so short a fault is no alarm yet."""
    events, vehicle = watched(Craft(**two_sided(leaps(*(5 + 0.05 * i for i in range(count))))).records(15))
    assert told(events, "estimator_reset") == []
    assert alarms(vehicle) == []


def test_leaps_for_longer_than_the_delay() -> None:
    """Leaps from sample to sample for 1.25 s are no reset but a fault of both streams: two alarms of this check."""
    events, vehicle = watched(Craft(**two_sided(leaps(*(5 + 0.05 * i for i in range(26))))).records(15))
    assert told(events, "estimator_reset") == []
    found = alarms(vehicle)
    assert {alarm["check"] for alarm in found} == {"kinematics"}
    assert [alarm["raised_boot_s"] for alarm in found] == pytest.approx(
        [5 + 0.15 + 1, 5 + 0.15 + 1]
    )  # the first has no vote
    assert [alarm["severity"] for alarm in found] == ["alarm", "alarm"]


def test_two_resets_far_apart_are_two() -> None:
    """Leaps at 5 and 8 s are two resets and no alarm."""
    events, vehicle = watched(Craft(**two_sided(leaps(5, 8))).records(15))
    assert [event["boot_s"] - BOOT_S for event in told(events, "estimator_reset")] == pytest.approx([5, 8])
    assert alarms(vehicle) == []


def test_a_leap_that_the_rates_explain() -> None:
    """A true turn of 21.7° in one sample, with the rates to it, is motion and no reset."""
    rate_deg_s = 21.7 / 0.05

    def turn(t_s: float) -> tuple[Any, Array]:
        turned = np.clip((t_s - 5.0) * rate_deg_s, 0.0, 21.7) + 2.0 * t_s
        during = 4.99 < t_s < 5.06
        return rotvec(0, 0, turned), np.radians([0, 0, rate_deg_s if during else 2.0])

    crafted: Callable[[float], tuple[Any, Array]] = turn
    events, _ = watched(Craft(turn=crafted).records(12))
    assert told(events, "estimator_reset") == []


# --- rates that mean something else --------------------------------------------------------------------------------


def turning(bank_deg: float, deg_s: float) -> Callable[[float], tuple[Any, Array]]:
    """A level turn to the right at a constant bank: the heading changes by `deg_s`."""

    def turn(t_s: float) -> tuple[Any, Array]:
        rotation = rpy(roll=bank_deg, yaw=deg_s * t_s)
        return rotation, rotation.inv().apply([0.0, 0.0, np.radians(deg_s)])

    return turn


def as_angles(_: float, state: State) -> State:
    """How fast roll, pitch and yaw change, in the body rates' place: in a level turn the yaw alone."""
    down_b = state.rotation.inv().apply([0.0, 0.0, 1.0])
    return state._replace(rates=np.array([0.0, 0.0, float(state.rates @ down_b)]))


@pytest.mark.parametrize(
    ("bank", "deg_s", "hz"),
    one_in(4, [(*turn, hz) for turn in ((20, 20), (45, 28), (60, 20), (-45, -15)) for hz in (5, 10, 25)]),
)
def test_rates_of_the_angles(bank: float, deg_s: float, hz: float) -> None:
    """In a banked turn the angles' rates are not the body's: a warning of each stream, which names the cause."""
    found = alarms(judged(Craft(turn=turning(bank, deg_s), hz=hz, **two_sided(as_angles)), 40), "kinematics")
    # At 5 Hz the faster ones miss single steps by more than 2.2° + 0.3 s of a tenth of the rate.
    assert len(found) == 2
    assert {alarm["severity"] for alarm in found} == {
        "alarm" if hz == 5 and abs(bank) > 20 and deg_s >= 20 else "warning"
    }
    assert {alarm["diagnosis"]["cause"] for alarm in found} == {"euler_rates"}
    assert {alarm["diagnosis"]["confidence"] for alarm in found} == {"certain"}


@pytest.mark.slow
@pytest.mark.parametrize("side", SIDES)
def test_rates_of_the_angles_in_one_message(side: str) -> None:
    """One of both is enough for its warning; it is named as far as both messages do not contradict it."""
    craft = Craft(turn=turning(45, 28), hz=20, **one_sided(side, as_angles))
    (warning,) = alarms(judged(craft, 40), "kinematics")
    assert warning["what"] == f"{SIDES[side]} turns otherwise than its rates say"


@pytest.mark.slow
@pytest.mark.parametrize(("bank", "deg_s"), [(0, 20), (20, 20), (45, 28), (70, 40)])
def test_a_banked_turn_is_healthy(bank: float, deg_s: float) -> None:
    """The same turns with the body's rates, also 0.3 °/s and 2 % off."""
    off = with_rates(lambda rates: 1.02 * rates + np.radians([0.3, 0, 0]))
    for change in (lambda _, state: state, off):
        assert alarms(judged(Craft(turn=turning(bank, deg_s), **two_sided(change)), 40)) == []


@pytest.mark.parametrize("rad_s", [41.0, 202.0, 1e6])
def test_rates_beyond_any_gyro(rad_s: float) -> None:
    """A warning of both streams, whatever else there is; gravity is judged, also half-way between two attitudes."""
    garbage = with_rates(lambda rates: rates + np.array([0.0, rad_s, 0.0]))
    vehicle = judged(Craft(imu=lambda _, state: state, hz=10, **two_sided(garbage)), 30)
    found = alarms(vehicle)
    assert [(alarm["check"], alarm["severity"]) for alarm in found] == [("kinematics", "warning")] * 2
    assert found[0]["what"] == "the rates of ATTITUDE are beyond any gyro"
    assert check(vehicle, "gravity")["verdict"] == "agree"
    assert "beyond any gyro" in check(vehicle, "gyro")["reason"]


def test_rates_that_miss_a_vehicle_at_rest() -> None:
    """20 °/s in the rates of a vehicle that does not turn: a warning, as no swing goes to one side for ten seconds."""
    found = alarms(judged(Craft(**two_sided(with_rates(lambda rates: rates + np.radians([20.0, 0, 0])))), 40))
    assert [(alarm["check"], alarm["severity"]) for alarm in found] == [("kinematics", "warning")] * 2
