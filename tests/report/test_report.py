"""The report: verdict, exit code, JSON and text from the recordings' entries."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

import gcs_bridge
from gcs_bridge._version import __version__
from gcs_bridge.checks import all_checks
from gcs_bridge.contract import Distribution
from gcs_bridge.report import Report, worst_exit_code
from gcs_bridge.report.verdicts import COMPARATORS
from gcs_bridge.settings import Settings
from tests.helpers.paths import FIXTURES
from tests.helpers.report_entries import (
    ALARM,
    DIAGNOSIS,
    PARTS,
    SALVAGE,
    check,
    entry,
    report,
    stream,
    vehicle,
    without_quaternion,
)

AGREE = entry(vehicle())
ALARMED = entry(vehicle("alarm"), verdict="alarm")
WARNED = entry(vehicle("warning"), verdict="warning")
NOT_COMPARED = entry(vehicle(), without_quaternion(sysid=2), verdict="no_compare")
WITHOUT_ATTITUDE = entry(without_quaternion(streams={"RAW_IMU": stream()}), verdict="no_compare")
EMPTY = entry(verdict="no_compare")
BYSTANDER = entry(vehicle(), without_quaternion(sysid=2, streams={}), verdict="no_compare")
ONLY_QUALITY_WARNED = entry(
    vehicle("warning", checks=[check(verdict="no_compare"), check("quaternion_norm", "warning")]), verdict="warning"
)


@pytest.mark.parametrize(
    ("files", "by_alarm", "by_warning"),
    [
        ([AGREE], 0, 0),
        ([ALARMED], 1, 1),
        ([WARNED], 0, 1),
        ([NOT_COMPARED], 4, 4),
        ([WITHOUT_ATTITUDE], 4, 4),
        ([EMPTY], 4, 4),
        ([BYSTANDER], 0, 0),
        ([ONLY_QUALITY_WARNED], 4, 1),
        ([AGREE, EMPTY], 4, 4),
        ([EMPTY, ALARMED, AGREE], 1, 1),
        ([], 0, 0),
    ],
)
def test_exit_codes(files: list[dict[str, Any]], by_alarm: int, by_warning: int) -> None:
    """1 for what is to fail; 4 if an attitude was compared with nothing or there was none; never 4 hides 1."""
    told = report(*files)
    assert (told.exit_code("alarm"), told.exit_code("warning"), told.exit_code("never")) == (by_alarm, by_warning, 0)


def test_worst_exit_code_is_not_the_greatest() -> None:
    """A source that cannot be used is worst, then an alarm, then nothing compared, then good."""
    assert [worst_exit_code(codes) for codes in ([0, 4, 1, 3], [0, 4, 1], [0, 4], [0], [])] == [3, 1, 4, 0, 0]


@pytest.mark.parametrize(
    ("files", "verdict"),
    [
        ([AGREE, EMPTY, WARNED, ALARMED], "alarm"),
        ([AGREE, EMPTY, WARNED], "warning"),
        ([AGREE, EMPTY], "no_compare"),
        ([AGREE], "agree"),
        ([], "no_compare"),
    ],
)
def test_verdict_is_the_worst_file(files: list[dict[str, Any]], verdict: str) -> None:
    """Alarm, warning, no compare, agree, in this order; nothing judged is no agreement."""
    assert report(*files).verdict == verdict


def test_json_has_the_contract_s_shape() -> None:
    """Schema, version and verdict stand above the files, which are as the judges gave them."""
    told = json.loads(report(AGREE, ALARMED).to_json())
    assert told == {
        "schema": "gcs-bridge/report/1",
        "version": __version__,
        "verdict": "alarm",
        "files": [AGREE, ALARMED],
    }
    assert list(told) == ["schema", "version", "verdict", "files"]


def test_what_is_not_finite_is_null() -> None:
    """NaN and infinity are null, in JSON and in the dict: whatever became of a check's numbers."""
    bad = Distribution(median=math.nan, p95=math.inf, p99=-math.inf, max=0.25)
    (file,) = report(AGREE).files
    (vehicle,) = file.vehicles
    checks = (replace(vehicle.checks[0], residual=bad, coverage=math.nan),)
    told = Report.of([replace(file, vehicles=(replace(vehicle, checks=checks),))])
    (found,) = told.to_dict()["files"][0]["vehicles"][0]["checks"]
    assert found["residual"] == {"median": None, "p95": None, "p99": None, "max": 0.25}
    assert found["coverage"] is None
    assert json.loads(told.to_json()) == told.to_dict()


def test_a_report_cannot_be_changed_from_outside() -> None:
    """What to_dict gives is a copy."""
    told = report(AGREE)
    told.to_dict()["files"][0]["vehicles"].clear()
    assert told.to_dict()["files"][0]["vehicles"]


def test_a_name_that_is_not_utf8_is_still_reported(tmp_path: Path) -> None:
    """A file name with bytes that are no text stays readable, in JSON and in text."""
    path = tmp_path / "bad\udcff.tlog"
    path.write_bytes((FIXTURES / "c_copter_4hz.tlog").read_bytes()[:20_000])
    told = gcs_bridge.check(path)
    assert json.loads(told.to_json())["files"][0]["path"] == f"{tmp_path}/bad\\xff.tlog"
    told.to_text().encode()


def text(*vehicles: dict[str, Any], detail: int = 0, **changes: Any) -> str:
    return report({**entry(*vehicles), **changes}).to_text(detail=detail)


def row(said: str, label: str) -> str:
    """The row with this label, its continuation lines joined."""
    lines = said.splitlines()
    first = next(i for i, line in enumerate(lines) if line.strip().startswith(label + "  "))
    rest = next(i for i in range(first + 1, len(lines)) if not lines[i].startswith(" " * 20))
    return " ".join(line.strip() for line in lines[first:rest])


def test_first_line_of_a_vehicle_tells_how_much_was_judged() -> None:
    """Verdict and coverage of euler_quaternion; the share is rounded down, since not all is not 100 %."""
    first = text(vehicle(checks=[check(coverage=0.9999)])).splitlines()[1]
    assert first == "  1,1 ardupilot quadrotor  AGREE  euler_quaternion judged over 99.9 % of the time both came"
    assert "over 100 % of" in text(vehicle(checks=[check(coverage=1.0)]))


def test_first_line_of_a_vehicle_tells_that_nothing_was_judged() -> None:
    """Agreement of other checks does not hide that euler_quaternion had nothing to compare."""
    said = text(without_quaternion(verdict="agree", checks=[check(verdict="no_compare"), check("gravity")]))
    assert said.splitlines()[1] == "  1,1 ardupilot quadrotor  AGREE  euler_quaternion not judged"
    assert "NO COMPARE  no ATTITUDE_QUATERNION was received" in row(said, "euler_quaternion")


def test_unknown_is_never_zero() -> None:
    """Null reads 'unknown'; a zero that was measured reads 0."""
    residual = {**dict.fromkeys(PARTS), "max": 0.0}
    said = text(vehicle(checks=[check(coverage=0.0, residual=residual, same_instant=0)]))
    assert "judged over 0 % of" in said
    assert "median unknown, p99 unknown, max 0°; 2953 pairs (0 at the same instant)" in row(said, "euler_quaternion")


def test_an_alarm_is_a_sentence() -> None:
    """When, on which boot, which check, what, how much, how it splits, what it is not, and why if known."""
    said = row(text(vehicle("alarm", alarms=[{**ALARM, "diagnosis": DIAGNOSIS}]), verdict="alarm"), "ALARM")
    assert said.split(maxsplit=1)[1] == (
        "euler_quaternion from 12.4 s to 15.0 s of boot 0 (raised 2026-05-01T12:00:12.400Z): the two forms differ: "
        "90.00°, tilt 0.00°, heading 90.00°. This is no fault of the estimate: both forms come from one. "
        "Cause: yaw_offset 90° in message 31 (certain). Turn by 5° of tilt to tell."
    )
    about = {"axis": "tilt and heading, about body x (roll)", "repeats": 2, "grouped": "chatter"}
    said = row(text(vehicle("alarm", alarms=[{**ALARM, **about}]), verdict="alarm"), "ALARM")
    assert "(raised 2026-05-01T12:00:12.400Z), 2 times again: " in said
    assert "heading 90.00°, about body x (roll); chatter." in said


def test_an_alarm_that_is_no_attitude_has_its_own_unit() -> None:
    """A stream's silence is told in seconds, without parts of an angle."""
    silent = {"check": "stream", "what": "it stopped", "unit": "s", "peak": 2.0}
    silent |= {"axis": None, "tilt": None, "heading": None, "rotvec_body": None}
    said = text(vehicle("alarm", alarms=[{**ALARM, **silent}]), verdict="alarm")
    assert "it stopped: 2 s. This is" in " ".join(said.split())


def test_an_alarm_that_was_never_cleared_says_so() -> None:
    """An open alarm lasts to the end, and a heading that is undefined is unknown."""
    said = text(vehicle("alarm", alarms=[{**ALARM, "cleared_boot_s": None, "heading": None}]), verdict="alarm")
    assert "from 12.4 s to the end of boot 0" in said
    assert "heading unknown" in " ".join(said.split())


def test_damage_is_told_where_there_is_some() -> None:
    """An undamaged recording has no such line; a damaged one tells what was lost."""
    assert "damage" not in text(vehicle())
    damaged = {**SALVAGE, "bad_crc": 12, "skipped_bytes": 340, "gap_count": 3, "read_fraction": 0.9996}
    said = row(text(vehicle(), salvage=damaged), "damage")
    assert "read 99.9 % of the bytes, 12 with a bad checksum, 340 bytes skipped in 3 gaps" in said


def test_text_ends_with_a_line_for_each_file() -> None:
    """Verdict, path and a few words, a line a file, in the order of the files; quiet leaves nothing else."""
    told = report(AGREE, ALARMED, EMPTY)
    last = [
        "AGREE       flight.tlog: 1 vehicle, no alarm",
        "ALARM       flight.tlog: 1 vehicle, 1 alarm: euler_quaternion at 12.4 s",
        "NO COMPARE  flight.tlog: no vehicle",
    ]
    assert told.to_text().splitlines()[-3:] == last
    assert told.to_text(detail=-1).splitlines() == last


def test_the_command_that_gets_the_missing_message_is_told() -> None:
    """A vehicle without ATTITUDE_QUATERNION gets the request of message 31, and no praise."""
    assert text(without_quaternion(sysid=7), verdict="no_compare", detail=-1).splitlines() == [
        "NO COMPARE  flight.tlog: 1 vehicle, vehicle 7 not compared",
        "            next, in MAVProxy for vehicle 7: long SET_MESSAGE_INTERVAL 31 40000",
    ]
    assert "next" not in text(vehicle())


def test_under_an_alarm_the_last_line_is_about_it() -> None:
    """When, by which check, and why; and no request of a message that has nothing to do with it."""
    gravity = {**ALARM, "check": "gravity", "id": "1,1/gravity/0/1"}
    said = text(without_quaternion("alarm", alarms=[gravity]), verdict="alarm", detail=-1)
    assert said.splitlines() == ["ALARM       flight.tlog: 1 vehicle, 1 alarm: gravity at 12.4 s"]
    warned = {**ALARM, "severity": "warning", "check": "stream", "id": "7,1/stream/0/1"}
    diagnosed = {**ALARM, "diagnosis": DIAGNOSIS}
    said = text(vehicle("warning", sysid=7, alarms=[warned]), vehicle("alarm", alarms=[diagnosed]), verdict="alarm")
    assert said.splitlines()[-1].endswith(
        "2 vehicles, 1 alarm, 1 warning: vehicle 1: euler_quaternion at 12.4 s, yaw_offset"
    )


def test_resets_of_the_estimator_have_rows() -> None:
    """When, how far it stepped, and what the vehicle said before it."""
    reset = {"boot": 1, "boot_s": 70.1, "utc": None, "tilt": 0.012, "heading": 21.7, "explained_by": ["EKF yaw reset"]}
    assert row(text(vehicle(resets=[reset])), "reset").split(maxsplit=1)[1] == (
        "at 70.1 s of boot 1 the estimator's heading stepped by 21.70°, its tilt by 0.01° "
        "(said before it: EKF yaw reset)"
    )


def test_who_has_no_attitude_is_asked_for_one_only_if_nobody_has() -> None:
    """A tracker beside a copter may have none; a recording without any needs both messages."""
    silent = without_quaternion(sysid=2, streams={})
    assert "next" not in text(vehicle(), silent)
    commands = [line.rpartition(": ")[2] for line in text(silent, verdict="no_compare", detail=-1).splitlines()[1:]]
    assert commands == ["long SET_MESSAGE_INTERVAL 30 40000", "long SET_MESSAGE_INTERVAL 31 40000"]


@pytest.mark.parametrize("detail", [0, 1])
def test_text_fits_100_columns(detail: int) -> None:
    """Rows are broken at spaces and never wider than 100 columns."""
    many = {f"MESSAGE_NUMBER_{i}": stream() for i in range(20)}
    explained = check(
        verdict="explained",
        reason="word " * 60,
        explained_by=[
            {"cause": "ahrs_trim", "value": [1.0, 2.0], "unit": "deg", "estimated": True, "alternatives": []}
        ],
    )
    alarms = [{**ALARM, "diagnosis": DIAGNOSIS}]
    said = text(vehicle("alarm", streams=many, checks=[explained], alarms=alarms), verdict="alarm", detail=detail)
    assert max(map(len, said.splitlines())) <= 100
    assert "explained by ahrs_trim 1/2° (estimated)" in said


def test_a_path_cannot_command_the_terminal() -> None:
    """Control characters in a file's name are shown, not obeyed."""
    assert "\x1b" not in text(vehicle(), path="\x1b[2J.tlog")


def test_the_comparators_are_the_checks_that_compare() -> None:
    """The report knows them by name, without the checks: a new one that is forgotten there would end with 4."""
    assert {check.name for check in all_checks(Settings()) if check.compares} == COMPARATORS
