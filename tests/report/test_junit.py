"""JUnit's XML, as a library reads it that other programs use: junitparser."""

from typing import Any

import pytest
from junitparser import Error, Failure, JUnitXml, Skipped

from gcs_bridge.report.baseline import NOTHING_KNOWN, known_from
from gcs_bridge.report.formats import FORMATS, Asked, Refused
from gcs_bridge.settings import FailOn
from tests.helpers.report_entries import ALARM, check, entry, report, stream, vehicle, without_quaternion

AGREE = entry(vehicle(), path="good.tlog")
ALARMED = entry(vehicle("alarm"), verdict="alarm", path="bad.tlog")
WARNED = entry(vehicle("warning", alarms=[{**ALARM, "severity": "warning"}]), verdict="warning", path="hm.tlog")
NOT_COMPARED = entry(
    vehicle(),
    without_quaternion(sysid=2, checks=[check(verdict="no_compare"), check("gyro", "no_compare")]),
    verdict="no_compare",
    path="half.tlog",
)
BY_ANOTHER = entry(vehicle(checks=[check(verdict="no_compare"), check("gyro")]), path="gyro.tlog")
NO_ATTITUDE = entry(without_quaternion(streams={"RAW_IMU": stream()}), verdict="no_compare", path="imu.tlog")


def read(*files: dict[str, Any], **asked: Any) -> dict[str, list[Any]]:
    """What came of each case, by `suite::name`."""
    found = JUnitXml.fromstring(FORMATS["junit"](report(*files), Asked(**asked)).encode())
    return {f"{suite.name}::{case.name}": list(case.result) for suite in found for case in suite}


def kinds(found: dict[str, list[Any]]) -> dict[str, list[type]]:
    return {name: [type(one) for one in result] for name, result in found.items()}


def test_a_suite_a_file_and_a_case_a_check() -> None:
    """Named as the contract says; the alarm is a failure with its sentence."""
    found = read(AGREE, ALARMED)
    assert kinds(found) == {"good.tlog::1.1.euler_quaternion": [], "bad.tlog::1.1.euler_quaternion": [Failure]}
    (failure,) = found["bad.tlog::1.1.euler_quaternion"]
    assert failure.type == "alarm"
    assert failure.message.startswith("the two forms differ: 90.00°")
    assert "from 12.4 s to 15.0 s of boot 0" in failure.text


def test_what_could_not_be_judged_is_skipped_and_a_vehicle_that_was_not_an_error() -> None:
    """One check that judges the vehicle is enough; without any, nobody may take the page for a good one."""
    assert kinds(read(BY_ANOTHER)) == {"gyro.tlog::1.1.euler_quaternion": [Skipped], "gyro.tlog::1.1.gyro": []}
    assert kinds(read(NOT_COMPARED)) == {
        "half.tlog::1.1.euler_quaternion": [],
        "half.tlog::2.1.euler_quaternion": [Error],
        "half.tlog::2.1.gyro": [Skipped],
    }
    (error,) = read(NOT_COMPARED)["half.tlog::2.1.euler_quaternion"]
    assert error.message == "no ATTITUDE_QUATERNION was received"


def test_a_source_that_cannot_be_used_is_an_error() -> None:
    """A suite of its own, so that it cannot be overlooked."""
    found = read(AGREE, refused=(Refused("day: 1/gone.tlog", "day: 1/gone.tlog: cannot be read: no such file"),))
    (error,) = found["day: 1/gone.tlog::readable"]
    assert (type(error), error.message) == (Error, "cannot be read: no such file")


@pytest.mark.parametrize("fail_on", ["alarm", "warning", "never"])
@pytest.mark.parametrize(
    "files", [[AGREE], [ALARMED], [WARNED], [NOT_COMPARED], [BY_ANOTHER], [NO_ATTITUDE], [AGREE, WARNED]]
)
def test_it_fails_where_the_exit_code_does(files: list[dict[str, Any]], fail_on: FailOn) -> None:
    """1 is a failure, 4 an error; what is known from a baseline is neither, in both."""
    for known in (NOTHING_KNOWN, known_from(report(*files).files, report(*files).files)):
        results = [one for result in kinds(read(*files, fail_on=fail_on, known=known)).values() for one in result]
        code = 1 if Failure in results else 4 if Error in results else 0
        assert code == report(*files).exit_code(fail_on, known)


def test_text_from_outside_is_text() -> None:
    """Markup, control characters and undecodable bytes: the XML is read back, and nothing of them acts."""
    hostile = 'a<b>&"\x1b[2J\x00\udcff]]>.tlog'
    alarm = {**ALARM, "what": hostile.replace("\udcff", "")}
    (name,) = read(entry(vehicle("alarm", alarms=[alarm]), verdict="alarm", path='<&"\x1b.tlog'))
    assert name == '<&"\\x1b.tlog::1.1.euler_quaternion'


def test_the_counts() -> None:
    """Of each suite and of all."""
    found = JUnitXml.fromstring(FORMATS["junit"](report(AGREE, ALARMED, NOT_COMPARED), Asked()).encode())
    assert (found.tests, found.failures, found.errors, found.skipped) == (5, 1, 1, 1)
    assert [(suite.tests, suite.failures, suite.errors, suite.skipped) for suite in found] == [
        (1, 0, 0, 0),
        (1, 1, 0, 0),
        (3, 0, 1, 1),
    ]
