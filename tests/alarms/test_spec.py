"""What the checks say of their alarms, and that an alarm is known by its spec alone."""

from dataclasses import FrozenInstanceError, replace

import pytest

from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.checks import all_checks
from gcs_bridge.checks.base import Check
from gcs_bridge.settings import Settings

CHECKS = all_checks(Settings())
SPECS = [spec for check in CHECKS for spec in check.alarm_specs]

# Severe ones first, in the order in which they are told when one frame brings several about.
ID_PARTS = """
alarm    euler_quaternion
alarm    quaternion_norm
alarm    quaternion_norm-zero
alarm    body_rates
alarm    kinematics-attitude-steps
alarm    kinematics-attitude_quaternion-steps
alarm    gyro
alarm    gravity
alarm    gravity-gross
alarm    secondary_estimate-tilt-alarm
alarm    secondary_estimate-heading-alarm
alarm    secondary_estimate-tilt-gross
alarm    secondary_estimate-heading-gross
alarm    stream-attitude-silent
alarm    stream-attitude-frozen
alarm    stream-attitude-invalid
alarm    stream-attitude_quaternion-silent
alarm    stream-attitude_quaternion-frozen
alarm    stream-attitude_quaternion-invalid
alarm    stream-senders
warning  euler_quaternion-mean
warning  quaternion_norm-warning
warning  body_rates-warning
warning  kinematics-attitude-slope
warning  kinematics-attitude-turn
warning  kinematics-attitude-impossible
warning  kinematics-attitude_quaternion-slope
warning  kinematics-attitude_quaternion-turn
warning  kinematics-attitude_quaternion-impossible
warning  gyro-warning
warning  gravity-warning
warning  secondary_estimate-tilt-warning
warning  secondary_estimate-heading-warning
warning  secondary_estimate-tilt-never
warning  stream-attitude-slow
warning  stream-attitude_quaternion-slow
warning  stream-versions
"""


def test_all_alarms_as_their_ids_name_them() -> None:
    """Ids are the contract's: who keeps them finds each alarm again."""
    expected = [tuple(line.split()) for line in ID_PARTS.strip().splitlines()]
    found = [(spec.severity, spec.id_part) for severity in ("alarm", "warning") for spec in SPECS
             if spec.severity == severity]  # fmt: skip
    assert found == expected


def test_names_within_a_check() -> None:
    """Each alarm is its check's, and has a name of its own there."""
    for check in CHECKS:
        assert {spec.check for spec in check.alarm_specs} <= {check.name}
        assert len({spec.name for spec in check.alarm_specs}) == len(check.alarm_specs)
        others = {"not a stream that is missing: it comes, with nothing in it"}  # of a quaternion of zeros
        assert {spec.not_a_sign_of for spec in check.alarm_specs} <= {check.not_a_sign_of, *others}


def test_which_alarms_have_another_unit_than_their_check() -> None:
    """A share has the unit 1, rates have theirs, what goes back and forth is counted; what only is so has none."""
    units = {check.name: check.unit for check in CHECKS}
    others = {(spec.id_part.split("-")[-1], spec.unit) for spec in SPECS if spec.unit != units[spec.check]}
    assert others == {
        *(("slope", "1"), ("turn", "deg/s"), ("impossible", "deg/s")),
        *(("invalid", ""), ("zero", ""), ("slow", "1"), ("senders", "times"), ("versions", "times")),
    }


def test_about_which_alarms_the_doctor_is_asked() -> None:
    """About the two forms, the norm, a stream against its own rates; what is summed up began while the sum grew."""
    asked = {spec.id_part: spec.onset_lead_s for spec in SPECS if spec.asks_doctor}
    assert asked == {
        "euler_quaternion": 0.0,
        "euler_quaternion-mean": 13.0,  # the window of 10 s, held for 3 s
        "quaternion_norm": 0.0,
        "quaternion_norm-warning": 0.0,
        **{f"kinematics-{stream}-steps": 0.0 for stream in ("attitude", "attitude_quaternion")},
        **{
            f"kinematics-{stream}-{of}": 10.0  # the window
            for stream in ("attitude", "attitude_quaternion")
            for of in ("slope", "turn")
        },
    }
    assert [spec.id_part for spec in SPECS if spec.onset_lead_s and not spec.asks_doctor] == []


def test_short_excursions_count_together_for_the_two_forms_only() -> None:
    """A lag comes and goes with the motion; no other alarm adds up what was too short."""
    assert [spec.id_part for spec in SPECS if spec.recurring_window_s] == ["euler_quaternion"]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_the_same_objects_for_life(check: Check) -> None:
    """A new boot brings no new alarms: the manager would not know them."""
    before = check.alarm_specs
    check.start_boot()
    assert all(a is b for a, b in zip(before, check.alarm_specs, strict=True))


def test_a_spec_is_itself_and_cannot_be_changed() -> None:
    """One of the same words is another alarm."""
    spec = SPECS[0]
    twin: AlarmSpec = replace(spec)
    assert twin != spec
    assert len({spec, twin}) == 2
    with pytest.raises(FrozenInstanceError):
        spec.unit = "rad"  # type: ignore[misc] # that it cannot be done is the test
