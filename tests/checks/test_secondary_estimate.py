"""AHRS2 against the attitude: fine limits in quiet flight, a gross one in any, and only of what once agreed."""

from typing import Any

import numpy as np
import pytest

from tests.helpers.craft import (
    Change,
    Craft,
    alarms,
    between,
    check,
    judged,
    rotvec,
    rpy,
    spinning,
    still,
    swaying,
    true,
    turned_in_body,
    turned_in_world,
)
from tests.helpers.everyday import one_in

# AHRS2 comes five times a second. Judged from 30 s behind its first on.
FAULT_S = (40.0, 46.0)
RAISED_S, CLEARED_S = 40.0 + 0.4 + 1.0, 46.0 + 0.4 + 2.0


def flown(change: Change, **given: Any) -> Craft:
    return Craft(**{"second": between(*FAULT_S, change), "hz": 10.0, **given})


def test_one_degree_is_nothing() -> None:
    """1° of tilt and 5° of heading between the two estimates are healthy."""
    vehicle = judged(Craft(second=turned_in_body(1, 0, 5), hz=10), 52)
    assert alarms(vehicle) == []
    entry = check(vehicle, "secondary_estimate")
    assert entry["verdict"] == "agree"
    assert entry["residual"]["max"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("change", "severity", "part", "axis"),
    [
        (turned_in_body(6, 0, 0), "warning", "tilt", "tilt, about body x (roll)"),
        (turned_in_body(0, -12, 0), "alarm", "tilt", "tilt, about body y (pitch)"),
        (turned_in_world(0, 0, 12), "warning", "heading", "heading"),
        (turned_in_world(0, 0, -25), "alarm", "heading", "heading"),
    ],
    ids=["6° of roll", "12° of pitch", "12° of yaw", "25° of yaw"],
)
def test_quiet_flight(change: Change, severity: str, part: str, axis: str) -> None:
    """A tilt beyond 5° is a warning, beyond 10° an alarm; a heading beyond 10° and 20°; each is called what it is."""
    vehicle = judged(flown(change, turn=still(rpy(2, 3, 40))), 52)
    (alarm,) = [one for one in alarms(vehicle) if one["severity"] == severity]
    assert severity == "alarm" or len(alarms(vehicle)) == 1
    assert {one["check"] for one in alarms(vehicle)} == {"secondary_estimate"}
    assert alarm["what"] == f"the second estimate (AHRS2) has another {part}"
    assert alarm["is_not"] == "not one form against the other: one of two estimates is wrong, and it may be the second"
    assert alarm["axis"] == axis
    assert alarm["raised_boot_s"] == pytest.approx(RAISED_S)
    assert alarm["cleared_boot_s"] == pytest.approx(CLEARED_S)


@pytest.mark.parametrize("change", [turned_in_body(4.5, 0, 0), turned_in_world(0, 0, 9)])
def test_below_the_limits(change: Change) -> None:
    """4.5° of tilt, or 9° of heading, is nothing."""
    assert alarms(judged(flown(change), 50)) == []


def test_a_yaw_error_of_a_pitched_vehicle_is_heading() -> None:
    """25° about the world's down at 25° of pitch has roll and yaw in body axes, but is called heading, and no tilt."""
    vehicle = judged(flown(turned_in_world(0, 0, 25), turn=still(rpy(pitch=25))), 50)
    (alarm,) = alarms(vehicle)
    assert alarm["axis"] == "heading"
    assert (alarm["tilt"], alarm["heading"]) == pytest.approx((0, 25), abs=0.01)
    down_b = rpy(pitch=25).inv().apply([0, 0, 1])
    assert alarm["rotvec_body"] == pytest.approx(25 * down_b, abs=0.01)


@pytest.mark.parametrize(
    "turn",
    [spinning(deg_s=11), still(rpy(roll=31)), swaying(by_deg=4, period_s=2)],
    ids=["turning", "banked", "swaying"],
)
def test_what_is_not_quiet(turn: Any) -> None:
    """Turning above 10 °/s or banked above 30° is not quiet: 25° of tilt are not judged there."""
    vehicle = judged(flown(turned_in_body(25, 0, 0), turn=turn), 50)
    assert alarms(vehicle) == []
    assert check(vehicle, "secondary_estimate")["pairs"] == 0


def test_the_second_estimate_settles() -> None:
    """In the first 30 s of AHRS2 a difference of 12° is not judged, and counts from 30 s on."""
    leaning = still(rpy(1, 2, 3))  # all angles exactly zero would be an estimate that has not started
    vehicle = judged(Craft(turn=leaning, second=between(15, 36, turned_in_body(12, 0, 0)), hz=10), 42)
    assert alarms(vehicle)[0]["raised_boot_s"] == pytest.approx(30.0 + 0.4 + 1.0)


def test_a_heading_that_never_agreed() -> None:
    """A second estimate whose heading was off from the start, as one without a compass is: a remark and no alarm."""
    vehicle = judged(Craft(second=turned_in_world(0, 0, 90), hz=10), 50)
    assert alarms(vehicle) == []
    entry = check(vehicle, "secondary_estimate")
    assert entry["verdict"] == "agree"
    assert "never agreed in heading:" in entry["reason"]


@pytest.mark.parametrize(
    "change",
    one_in(3, [turned_in_body(0, 6, 0), turned_in_body(0, 30, 0), turned_in_body(60, 60, 60)], swept=False),
)
def test_a_tilt_that_never_agreed(change: Change) -> None:
    """Both see gravity: another down from the start on is a warning, told once, behind 30 s and ten seconds more."""
    vehicle = judged(Craft(second=change, hz=10), 90)
    (warning,) = alarms(vehicle)
    assert (warning["check"], warning["severity"], warning["repeats"]) == ("secondary_estimate", "warning", 0)
    assert warning["what"] == "the second estimate (AHRS2) never agreed in tilt"
    assert warning["raised_boot_s"] == pytest.approx(30.0 + 0.4 + 10.0)
    assert check(vehicle, "secondary_estimate")["verdict"] == "warning"


@pytest.mark.parametrize("change", [turned_in_body(0, 6, 0), turned_in_body(0, 30, 0)])
def test_too_short_to_say_that_it_never_agreed(change: Change) -> None:
    """In 35 s it cannot be told that they never do: no warning, and no agreement either."""
    vehicle = judged(Craft(second=change, hz=10), 35)
    assert alarms(vehicle) == []
    entry = check(vehicle, "secondary_estimate")
    assert (entry["verdict"], entry["reason"]) == ("no_compare", "the two estimates never agreed in tilt")


def test_a_tilt_that_agrees_late() -> None:
    """6° off for a minute and right from then on: the warning goes, two seconds behind ten of agreement."""
    (warning,) = alarms(judged(Craft(second=between(0, 60, turned_in_body(0, 6, 0)), hz=10), 90))
    assert warning["cleared_boot_s"] == pytest.approx(60.0 + 2.4, abs=0.3)  # what is within the limit clears it


@pytest.mark.parametrize(
    ("bank", "off", "severity"), [(15, 15, None), (15, 25, "warning"), (15, 41, "alarm"), (8, 15, "warning")]
)
def test_the_heading_while_banked(bank: float, off: float, severity: str | None) -> None:
    """Above 10° of bank the limits of the heading are twice as wide: 20° and 40°."""
    found = alarms(judged(flown(turned_in_world(0, 0, off), turn=still(rpy(roll=bank))), 50))
    assert {one["severity"] for one in found} - {severity} == (
        set() if severity != "alarm" else {"warning"} & {one["severity"] for one in found}
    )
    assert bool(found) == (severity is not None)


def test_nine_seconds_of_agreement_are_not_enough() -> None:
    """Agreed for 9 s and never again: not judged; agreed for 11 s: an alarm."""
    off = turned_in_world(0, 0, 90)
    assert alarms(judged(Craft(second=between(0, 9, true, off), hz=10), 45)) == []
    assert alarms(judged(Craft(second=between(0, 11, true, off), hz=10), 45)) != []


# --- in whatever flight ----------------------------------------------------------------------------------------------

FAST = spinning(deg_s=30)


@pytest.mark.parametrize("part", ["tilt", "heading"])
def test_grossly_off_for_six_seconds(part: str) -> None:
    """60° off for 6 s while turning at 30 °/s: an alarm after 5 s, cleared two seconds after it is over."""
    change = turned_in_body(60, 0, 0) if part == "tilt" else turned_in_world(0, 0, 60)
    (alarm,) = alarms(judged(Craft(turn=FAST, second=between(20, 26, change), hz=10), 32))
    assert (alarm["check"], alarm["severity"]) == ("secondary_estimate", "alarm")
    assert alarm["what"] == f"the second estimate (AHRS2) has a wholly different {part}"
    assert alarm["peak"] == pytest.approx(60, abs=1)
    assert alarm["raised_boot_s"] == pytest.approx(20 + 5.0)
    assert alarm["cleared_boot_s"] == pytest.approx(26 + 2.0)


@pytest.mark.parametrize(("deg", "seconds"), [(60, 4.8), (40, 8)])
def test_what_is_not_gross(deg: float, seconds: float) -> None:
    """60° for less than 5 s, or 40° for 8 s, is no gross fault: acro on healthy aircraft reaches 38°."""
    craft = Craft(turn=FAST, second=between(20, 20 + seconds, turned_in_body(deg, 0, 0)), hz=10)
    assert alarms(judged(craft, 32)) == []


def test_a_time_that_is_not_its_own() -> None:
    """AHRS2 has no time: one that is a tenth of a second old at 60 °/s is 6° off in heading, and that is no fault."""
    turn = spinning(deg_s=60)
    late = lambda t_s, state: state._replace(rotation=turn(t_s - 0.1)[0])
    assert alarms(judged(Craft(turn=turn, second=late, hz=10), 45)) == []


def test_no_second_estimate() -> None:
    """Without AHRS2 the report says so."""
    entry = check(judged(Craft(), 5), "secondary_estimate")
    assert entry["verdict"] == "no_compare"
    assert entry["reason"].startswith("AHRS2 was never received")


def test_zeros_are_no_estimate() -> None:
    """AHRS2 of zeros is one that has not started: it is not compared, whatever the attitude is."""
    level = lambda _, state: state._replace(rotation=rotvec(0, 0, 0))
    entry = check(judged(Craft(turn=still(rpy(1, 2, 3)), second=level, hz=10), 45), "secondary_estimate")
    assert entry["pairs"] == 0
    assert np.isnan(entry["coverage"] or np.nan)
