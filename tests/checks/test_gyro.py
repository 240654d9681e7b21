"""The IMU's gyro against the attitude's rates: a slow bias is healthy, what comes on top of it is not."""

from typing import Any

import numpy as np
import pytest

from tests.helpers import wire
from tests.helpers.craft import (
    Array,
    Change,
    Craft,
    State,
    alarms,
    between,
    check,
    highres_imu,
    judged,
    rates_off,
    raw_imu,
    scaled_imu,
    spinning,
    swaying,
    told,
    true,
    watched,
)
from tests.helpers.turn import Turn

SWAY = swaying((1, 0, 0), by_deg=20, period_s=4)  # 31 °/s at most, 4.9 °/s from sample to sample at 10 Hz
HZ = 10.0
FAULT_S = (20.0, 26.0)


def flown(imu: Change, **given: Any) -> Craft:
    return Craft(**{"turn": SWAY, "imu": imu, "hz": HZ, **given})


def fault(*deg_s: float, **given: Any) -> Craft:
    return flown(between(*FAULT_S, rates_off(*deg_s)), **given)


@pytest.mark.parametrize("bias", [(2.0, 0, 0), (1.2, -1.2, 2.0)])
def test_a_constant_bias_is_healthy(bias: tuple[float, float, float]) -> None:
    """Up to 2.6 °/s of bias is what healthy aircraft have: nothing."""
    vehicle = judged(flown(rates_off(*bias)), 40)
    assert alarms(vehicle) == []
    assert check(vehicle, "gyro")["verdict"] == "agree"
    assert check(vehicle, "gyro")["residual"]["max"] < 1
    assert check(vehicle, "gyro")["bias"] == pytest.approx(bias, abs=0.05)  # and is told
    assert "bias" not in check(vehicle, "gravity")


def test_a_large_constant_bias_is_learned() -> None:
    """The first 10 s are not judged: even 20 °/s of bias that was always there is none of a fault."""
    assert alarms(judged(flown(rates_off(20, 0, 0)), 40)) == []


@pytest.mark.parametrize(
    ("message", "autopilot"),
    [(raw_imu, wire.ARDUPILOT), (scaled_imu, wire.PX4), (highres_imu, wire.PX4)],
)
def test_a_step_on_one_axis(message: Any, autopilot: int) -> None:
    """45.9 °/s on one axis, as when an estimator changes its gyro: an alarm in any message's unit, its axis named."""
    vehicle = judged(fault(45.9, 0, 0, imu_message=message, autopilot=autopilot), 40)
    found = alarms(vehicle)
    assert {alarm["check"] for alarm in found} == {"gyro"}
    alarm = found[0]
    assert alarm["severity"] == "alarm"
    assert alarm["what"] == "the IMU's gyro and the attitude's rates differ"
    assert alarm["is_not"] == "not a convention or encoding of the attitude: rates are compared with rates"
    assert (alarm["unit"], alarm["axis"]) == ("deg/s", "body x (roll)")
    assert alarm["peak"] == pytest.approx(45.9, abs=0.1)
    assert alarm["rotvec_body"] == pytest.approx([45.9, 0, 0], abs=0.1)
    assert alarm["raised_boot_s"] == pytest.approx(FAULT_S[0] + 0.2 + 1.0)
    # While it lasted the bias was followed: 45.9 (1 - exp(-6/30)) = 8.3 °/s is off at its end, below 70 % of 15 °/s.
    assert alarm["cleared_boot_s"] == pytest.approx(FAULT_S[1] + 0.2 + 2.0, abs=0.11)
    assert vehicle["verdict"] == "alarm"


@pytest.mark.parametrize(
    ("deg_s", "severity"), [(17.0, "alarm"), (14.0, "warning"), (-6.0, "warning"), (4.6, None), (-4.6, None)]
)
def test_where_the_limits_are(deg_s: float, severity: str | None) -> None:
    """In a steady turn 5 °/s on top of the bias are a warning and 15 °/s an alarm; the axis is named."""
    found = alarms(judged(fault(0, deg_s, 0, turn=spinning()), 32))
    assert [alarm["severity"] for alarm in found][:1] == ([severity] if severity else [])
    assert {(alarm["check"], alarm["axis"]) for alarm in found} <= {("gyro", "body y (pitch)")}
    if severity:
        assert found[0]["raised_boot_s"] == pytest.approx(FAULT_S[0] + 0.2 + 1.0)
        assert found[0]["cleared_boot_s"] == pytest.approx(FAULT_S[1] + 0.2 + 2.0, abs=0.11)


def test_what_the_rates_change_by_is_allowed() -> None:
    """A gyro read a sample late or early, in turn, differs by what the rates change in that time, 6 °/s: healthy."""

    def late_or_early(t_s: float, state: State) -> State:
        return state._replace(rates=FASTER(t_s + (-1) ** round(t_s * HZ) / HZ)[1])

    vehicle = judged(flown(late_or_early, turn=FASTER), 30)
    assert check(vehicle, "gyro")["residual"]["max"] > 5.5
    assert alarms(vehicle, "gyro") == []


FASTER = swaying((1, 0, 0), by_deg=25, period_s=4)  # 6.2 °/s from sample to sample


@pytest.mark.slow
def test_a_bias_that_drifts_is_followed() -> None:
    """A bias that grows by 0.1 °/s a second lags by no more than 30 s of it, 3 °/s: nothing, though it grows to 8."""
    drifting: Change = lambda t_s, state: rates_off(0, 0.1 * t_s, 0)(t_s, state)
    vehicle = judged(flown(drifting, turn=spinning()), 80)
    assert alarms(vehicle) == []
    assert 2 < check(vehicle, "gyro")["residual"]["max"] < 3


def test_the_first_ten_seconds_are_not_judged() -> None:
    """The bias is not known yet: what a gyro does from 2 to 3 s is not judged, and 30 of 40 s are."""
    vehicle = judged(flown(between(2, 3, rates_off(45.9, 0, 0)), turn=spinning()), 40)
    assert alarms(vehicle) == []
    assert check(vehicle, "gyro")["pairs"] == pytest.approx(30 * HZ, abs=2)


def spun_up(t_s: float) -> tuple[Turn, Array]:
    """A vehicle that spins at 40 rad/s for two seconds: beyond an int16's 32.767 rad/s."""
    angle, rate = 0.02 * t_s, 0.02
    if t_s >= 20:
        angle += 40 * min(t_s - 20, 2)
        rate += 40 if t_s < 22 else 0
    return Turn.from_rotvec([0, 0, angle]), np.array([0, 0, rate])


@pytest.mark.slow
def test_an_int16_that_starts_anew() -> None:
    """At 40 rad/s the counts are 40000 − 65536: no alarm in it, and behind it the bias is what it was."""
    sent = raw_imu(0, State(spun_up(21)[0], spun_up(21)[1], np.zeros(3)))
    assert sent.kind.unpacker.unpack(sent.payload)[6] == 40020 - 65536  # its z
    vehicle = judged(Craft(turn=spun_up, hz=25, imu=rates_off(1, 0, 0)), 40)
    assert alarms(vehicle, "gyro") == []
    assert check(vehicle, "gyro")["residual"]["max"] < 1


def test_beyond_what_gyros_can_measure() -> None:
    """Above 24 rad/s gyros saturate: what they say there is neither judged nor taken for a bias."""

    def saturated(_: float, state: State) -> State:
        return state._replace(rates=np.clip(state.rates, -20, 20))

    vehicle = judged(Craft(turn=spun_up, hz=25, imu=saturated, imu_message=highres_imu), 40)
    assert alarms(vehicle, "gyro") == []
    assert check(vehicle, "gyro")["residual"]["max"] < 1


# --- units -----------------------------------------------------------------------------------------------------------


def odd_counts(ms: int, state: State) -> Any:
    return raw_imu(ms, state, per_g=777.0)


def test_an_unknown_unit() -> None:
    """RAW_IMU of another autopilot, 777 counts a g, which is no known scale: told with the 200th sample; INOP."""
    events, vehicle = watched(flown(true, imu_message=odd_counts, autopilot=wire.PX4).records(25))
    for name in ("gyro", "gravity"):
        (inop,) = [event for event in told(events, "inop") if event["check"] == name]
        assert inop["boot_s"] == pytest.approx(10 + 199 / HZ)
        assert "RAW_IMU has no unit" in inop["reason"]
        entry = check(vehicle, name)
        assert entry["verdict"] == "inop"
        assert "px4" in entry["reason"]
    assert alarms(vehicle) == []
    assert vehicle["verdict"] == "agree"  # the two forms agree: what cannot run takes nothing from that


def test_an_unknown_unit_for_a_short_time() -> None:
    """With fewer than 200 samples it is not decided yet: nothing compared, and the unit is named as the reason."""
    events, vehicle = watched(flown(true, imu_message=odd_counts, autopilot=wire.PX4).records(8))
    assert told(events, "inop") == []
    assert check(vehicle, "gyro")["verdict"] == "no_compare"
    assert "RAW_IMU has no unit" in check(vehicle, "gyro")["reason"]


@pytest.mark.parametrize("per_g", [1000.0, 4096.0])
def test_a_unit_that_rest_shows(per_g: float) -> None:
    """Fifty samples of one steady length tell the scale: 1000 a g are mG and mrad/s, 4096 tell the force alone."""
    still_first = lambda t_s: SWAY(t_s) if t_s >= 5 else SWAY(0.0)
    message = lambda ms, state: raw_imu(ms, state, per_g=per_g)
    vehicle = judged(flown(true, turn=still_first, imu_message=message, autopilot=wire.PX4), 40)
    assert check(vehicle, "gyro")["verdict"] == ("agree" if per_g == 1000 else "inop")
    assert f"{per_g:.0f}" in check(vehicle, "gyro")["reason"]


def test_no_imu() -> None:
    """Without any IMU message the report says so."""
    entry = check(judged(Craft(), 10), "gyro")
    assert (entry["verdict"], entry["reason"]) == ("no_compare", "no message with a gyro was received")
