"""The accelerometer's down against the attitude's: fine limits at rest, a gross one in slow flight."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.helpers import wire
from tests.helpers.craft import (
    ARMED,
    G_M_S2,
    Array,
    Change,
    Craft,
    alarms,
    between,
    check,
    judged,
    landed,
    parameter,
    rotvec,
    rpy,
    scaled_imu,
    spinning,
    still,
    true,
    turned_in_body,
    two_sided,
    velocity,
)
from tests.helpers.turn import Turn

HZ = 10.0
UNTRIMMED = [(0.0, parameter(f"AHRS_TRIM_{axis}", 0.0)) for axis in "XY"]  # else it may be a trim
FAULT_S = (5.0, 9.0)  # known to be at rest from 3.0 s on
RAISED_S, CLEARED_S = 5.0 + 0.2 + 1.0, 9.0 + 0.2 + 2.0


def leaning(*deg: float, **given: Any) -> Craft:
    """A vehicle whose attitude, in both messages, is off by this turn in body axes for four seconds."""
    off = between(*FAULT_S, turned_in_body(*deg))
    return Craft(**{"euler": off, "quaternion": off, "imu": true, "hz": HZ, **given})


# --- at rest ---------------------------------------------------------------------------------------------------------


def test_twelve_degrees_at_rest_are_an_alarm() -> None:
    """An attitude rolled 12° too far at rest: an alarm, which says where the accelerometer's down is."""
    vehicle = judged(leaning(12, 0, 0), 14)
    (alarm,) = [alarm for alarm in alarms(vehicle) if alarm["severity"] == "alarm"]
    assert (alarm["check"], alarm["unit"]) == ("gravity", "deg")
    assert alarm["what"] == "at rest the accelerometer's down is not the attitude's"
    assert alarm["is_not"] == "not the heading, which gravity cannot show"
    assert alarm["axis"] == "tilt, about body x (roll)"
    assert (alarm["peak"], alarm["tilt"]) == pytest.approx((12, 12), abs=0.05)
    assert alarm["rotvec_body"] == pytest.approx([-12, 0, 0], abs=0.05)  # by that it would see what gravity shows
    assert alarm["raised_boot_s"] == pytest.approx(RAISED_S)
    assert alarm["cleared_boot_s"] == pytest.approx(CLEARED_S)


@pytest.mark.parametrize(("deg", "severity"), [((0, -6, 0), "warning"), ((0, 4.5, 0), None), ((0, 0, 90), None)])
def test_smaller_errors_at_rest(deg: Sequence[float], severity: str | None) -> None:
    """6° of pitch are a warning, 4.5° nothing; a yaw of 90° nothing, for gravity does not show it."""
    vehicle = judged(leaning(*deg, also=UNTRIMMED), 14)
    assert [alarm["severity"] for alarm in alarms(vehicle, "gravity")] == ([severity] if severity else [])
    assert check(vehicle, "gravity")["verdict"] == (severity or "agree")


def test_rest_must_have_lasted_for_three_seconds() -> None:
    """An attitude 12° off from the beginning is bad from 3.0 s on, when rest is known."""
    vehicle = judged(Craft(**two_sided(turned_in_body(12, 0, 0)), imu=true, hz=HZ), 10)
    assert alarms(vehicle, "gravity")[0]["raised_boot_s"] == pytest.approx(3.0 + 0.2 + 1.0)


@pytest.mark.parametrize(
    ("turn", "force"),
    [
        (spinning(deg_s=3.2), None),
        (still(), lambda _, rotation: rotation.inv().apply([0, 0, -G_M_S2 - 0.35])),
        (still(), lambda _, rotation: rotation.inv().apply([0, 0, -G_M_S2 + 0.35])),
    ],
    ids=["turning", "pushed up", "falling"],
)
def test_what_is_no_rest(turn: Any, force: Any) -> None:
    """Turning at more than 2.9 °/s, or a force that is off 1 g by more than 0.3 m/s², is no rest."""
    entry = check(judged(leaning(12, 0, 0, turn=turn, force=force), 14), "gravity")
    assert (entry["verdict"], entry["pairs"]) == ("no_compare", 0)
    assert "never known to be at rest" in entry["reason"]


@pytest.mark.parametrize(
    ("said", "rests"),
    [
        ({}, True),
        ({"beats": False, "imu_message": scaled_imu}, True),
        ({"base_mode": ARMED}, False),
        ({"base_mode": ARMED, "also": [(0.0, landed(1))]}, True),
        ({"base_mode": ARMED, "also": [(0.0, landed(2))]}, False),
        ({"base_mode": ARMED, "also": [(i / 10, velocity(10_000 + 100 * i, 5.0)) for i in range(140)]}, True),
        ({"base_mode": ARMED, "also": [(i / 10, velocity(10_000 + 100 * i, 0.2 * i)) for i in range(140)]}, False),
    ],
    ids=["disarmed", "nothing known", "armed", "landed", "in the air", "at constant speed", "accelerating at 2 m/s²"],
)
def test_who_may_be_at_rest(said: dict[str, Any], rests: bool) -> None:
    """A quiet IMU is rest where the vehicle is disarmed, landed or not accelerating, or where nothing is known."""
    vehicle = judged(leaning(12, 0, 0, **said), 14)
    assert check(vehicle, "gravity")["verdict"] == ("alarm" if rests else "no_compare")


def test_accelerated_flight_is_no_fault() -> None:
    """Forward at 2 m/s² the force is 10.01 m/s², as quiet as at rest, and leans by 11.5°: its speed tells it apart."""
    speeds = [(i / 10, velocity(10_000 + 100 * i, 0.2 * i)) for i in range(200)]
    forward = lambda _, rotation: rotation.inv().apply([2.0, 0, -G_M_S2])
    craft = Craft(turn=still(), imu=true, hz=HZ, base_mode=ARMED, also=speeds, force=forward)
    assert np.hypot(2.0, G_M_S2) == pytest.approx(G_M_S2 + 0.2, abs=0.01)
    assert alarms(judged(craft, 18)) == []


@pytest.mark.parametrize(("told", "severity"), [(True, None), (False, "alarm")])
def test_trims_that_were_told(told: bool, severity: str | None) -> None:
    """q_sent = q ⊗ exp(−[τx, τy, 0]): with AHRS_TRIM 8° and −9° told, the IMU agrees at rest; untold it is 12° off."""
    trims = (8.0, -9.0)
    sent = turned_in_body(-trims[0], -trims[1], 0)
    names = zip(("AHRS_TRIM_X", "AHRS_TRIM_Y"), trims, strict=True)
    also = [(0.0, parameter(name, float(np.radians(trim)))) for name, trim in names] if told else []
    vehicle = judged(Craft(turn=still(rpy(10, -20, 30)), quaternion=sent, euler=None, imu=true, hz=HZ, also=also), 12)
    found = alarms(vehicle, "gravity")
    assert (found[0]["severity"] if found else None) == severity
    if told:
        assert check(vehicle, "gravity")["residual"]["max"] < 0.1


# --- grossly, in flight ----------------------------------------------------------------------------------------------

HOVER = spinning(deg_s=2)


def banked(deg: float) -> Any:
    """The force that a vehicle banked by `deg` in a coordinated turn feels: along its own down, 1/cos of the bank."""
    return lambda _, __: [0.0, 0.0, -G_M_S2 / np.cos(np.radians(deg))]


def in_flight(off: Change, **given: Any) -> Craft:
    return Craft(**{"turn": HOVER, "euler": off, "quaternion": off, "imu": true, "hz": HZ, "base_mode": ARMED, **given})


def test_grossly_off_in_flight() -> None:
    """50° off in slow flight: an alarm once the mean of 3 s is beyond 45°, and gone when it is healthy again."""
    vehicle = judged(in_flight(between(6, 14, turned_in_body(0, 50, 0))), 24)
    (alarm,) = alarms(vehicle)
    assert (alarm["check"], alarm["severity"]) == ("gravity", "alarm")
    assert alarm["what"] == "for seconds the accelerometer's down is far from the attitude's"
    assert alarm["axis"] == "tilt, about body y (pitch)"
    assert alarm["peak"] == pytest.approx(50, abs=0.1)
    # Means of downs 50° apart: with a share s of the 3 s, tan = s sin 50 / (1 − s + s cos 50) is 1 at s = 0.89.
    assert alarm["raised_boot_s"] == pytest.approx(6 + 0.89 * 3 + 0.2, abs=0.21)
    assert 14 + 2 < alarm["cleared_boot_s"] < 14 + 3 + 2.3


@pytest.mark.parametrize(
    "craft",
    [
        in_flight(between(6, 14, turned_in_body(0, 42, 0))),
        in_flight(between(6, 8, turned_in_body(0, 50, 0))),
        in_flight(between(6, 14, turned_in_body(0, 50, 0)), turn=spinning(deg_s=11)),
    ],
    ids=["less than 45°", "two seconds", "while turning at 11 °/s"],
)
def test_what_is_not_gross(craft: Craft) -> None:
    """42°, or 50° for two seconds, or 50° while the vehicle turns faster than 10 °/s, is no gross fault."""
    assert alarms(judged(craft, 20), "gravity") == []


@pytest.mark.parametrize(("kind", "count"), [(1, 0), (wire.QUADROTOR, 1)], ids=["fixed wing", "quadrotor"])
def test_a_coordinated_turn_feels_level(kind: int, count: int) -> None:
    """Banked by 50° in a turn of 8 °/s the force lies along the own down: right for a fixed wing, wrong for a hover.

    The attitude is what is right here: its down is 50° from the force.
    """
    bank = rpy(roll=50)

    def turn(t_s: float) -> tuple[Turn, Array]:
        yaw = rotvec(0, 0, 8 * t_s)
        return yaw * bank, bank.inv().apply(np.radians([0, 0, 8]))

    vehicle = judged(in_flight(true, turn=turn, force=banked(50), kind=kind), 15)
    assert len(alarms(vehicle, "gravity")) == count
    level = lambda _, state: state._replace(rotation=state.rotation * rotvec(-50, 0, 0))
    assert alarms(judged(in_flight(level, turn=turn, force=banked(50), kind=kind), 15), "gravity") == []


def test_no_accelerometer() -> None:
    """Without any IMU message the report says so."""
    entry = check(judged(Craft(), 5), "gravity")
    assert (entry["verdict"], entry["reason"]) == ("no_compare", "no message with an accelerometer was received")
