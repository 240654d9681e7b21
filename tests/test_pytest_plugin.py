"""The fixture for other projects' pytest, in pytest runs of its own."""

import json

import pytest

import gcs_bridge
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers.paths import FIXTURES

pytest_plugins = ["pytester"]

FLIGHT = FIXTURES / "c_copter_4hz.tlog"


def run(pytester: pytest.Pytester, arguments: str) -> pytest.RunResult:
    """A test of somebody's that asserts it of flight.tlog."""
    pytester.makepyfile(f"def test_flight(gcs_bridge):\n    gcs_bridge.assert_attitude_agrees({arguments})")
    return pytester.runpytest_inprocess("-p", "no:xdist")


def test_a_flight_that_agrees_passes(pytester: pytest.Pytester) -> None:
    """And a second one beside it."""
    run(pytester, f"{str(FLIGHT)!r}, {str(FIXTURES / 'g_mavlink1.tlog')!r}").assert_outcomes(passed=1)


@pytest.mark.slow
def test_an_alarm_fails_with_the_report_and_a_baseline_lets_it_pass(pytester: pytest.Pytester) -> None:
    """The cause stands in what pytest prints, without a traceback of ours."""
    flight = pytester.path / "flight.tlog"
    flight.write_bytes(inject(FLIGHT.read_bytes(), [parse_fault("yaw_offset:30")]))
    result = run(pytester, "'flight.tlog'")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*ALARM*euler_quaternion*", "*yaw_offset 30*"])
    result.stdout.no_fnmatch_line("*pytest_plugin.py*")
    (pytester.path / "before.json").write_text(gcs_bridge.check(flight).to_json())
    run(pytester, "'flight.tlog', baseline='before.json'").assert_outcomes(passed=1)


def test_of_no_recording_nothing_is_asserted(pytester: pytest.Pytester) -> None:
    """A list of files that happens to be empty is no pass."""
    run(pytester, "*[]").assert_outcomes(failed=1)


def test_what_was_not_compared_fails(pytester: pytest.Pytester) -> None:
    """An attitude that nothing was compared with is no good one."""
    (pytester.path / "flight.tlog").write_bytes(inject(FLIGHT.read_bytes(), [parse_fault("thin:ATTITUDE=0.01")]))
    result = run(pytester, "'flight.tlog', to_s=0.3")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*NO COMPARE*"])


def test_what_is_no_recording_is_an_error_of_one_line(pytester: pytest.Pytester) -> None:
    """Which says what and where."""
    result = run(pytester, "'gone.tlog'")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*SourceError: gone.tlog: cannot be read*"])


def test_the_report_comes_back() -> None:
    """To look further: `check` by itself judges without failing."""
    from gcs_bridge.pytest_plugin import AttitudeAssertions

    report = AttitudeAssertions().check(FLIGHT, sysid=1, from_s=2.0, to_s=12.0)
    assert json.loads(report.to_json())["verdict"] == report.verdict
    (entry,) = report.files
    assert entry.vehicles[0].streams["ATTITUDE"].count < 50
