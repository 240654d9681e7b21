"""An earlier report as the baseline: what is new fails, and nothing else does."""

import json
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge.cli import main
from gcs_bridge.errors import UsageError
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.report.baseline import known_from, read_baseline
from tests.helpers.paths import FIXTURES
from tests.helpers.report_entries import ALARM, DIAGNOSIS, entry, report, vehicle, without_quaternion


def alarmed(*alarms: dict[str, Any], path: str = "flight.tlog") -> dict[str, Any]:
    numbered = [{**ALARM, **alarm, "id": f"1.1-{i}"} for i, alarm in enumerate(alarms)]
    return entry(vehicle("alarm", alarms=numbered), verdict="alarm", path=path)


@pytest.mark.parametrize(
    ("before", "now", "code"),
    [
        ([{}], [{}], 0),
        ([{}], [{"raised_boot_s": 99.0, "peak": 12.0}], 0),  # a simulation never runs twice alike
        ([{}], [{}, {"raised_boot_s": 99.0}], 1),  # one more
        ([{}], [{"check": "gravity"}], 1),
        ([{"severity": "warning"}], [{}], 1),
        ([{"diagnosis": DIAGNOSIS}], [{"diagnosis": {**DIAGNOSIS, "cause": "time_skew"}}], 1),
        ([{}, {"check": "gravity"}], [{"check": "gravity"}], 0),
        ([], [{}], 1),
    ],
)
def test_what_is_new(before: list[dict[str, Any]], now: list[dict[str, Any]], code: int) -> None:
    """Another check, severity, cause, or one more of a kind; not another time or size."""
    files = report(alarmed(*now)).files
    assert report(alarmed(*now)).exit_code("alarm", known_from(files, report(alarmed(*before)).files)) == code


def test_a_file_is_known_by_its_path_or_by_a_name_that_only_it_has() -> None:
    """Folders differ from machine to machine; of two with one name each needs its path."""
    now = report(
        alarmed({}, path="/tmp/x/a.tlog"), alarmed({}, path="/tmp/x/b.tlog"), alarmed({}, path="/tmp/y/b.tlog")
    )
    before = report(alarmed({}, path="logs/a.tlog"), alarmed({}, path="logs/b.tlog"))
    assert {path for path, _ in known_from(now.files, before.files).alarms} == {"/tmp/x/a.tlog"}


def test_what_was_not_compared_before_is_no_news() -> None:
    """Nor is a recording without an attitude; a vehicle that was compared before, and is not now, is."""
    half = entry(vehicle(), without_quaternion(sysid=2), verdict="no_compare")
    empty = entry(verdict="no_compare", path="empty.tlog")
    whole = entry(vehicle(), vehicle(sysid=2))
    files = report(half, empty).files
    assert report(half, empty).exit_code("alarm", known_from(files, files)) == 0
    assert report(half).exit_code("alarm", known_from(report(half).files, report(whole).files)) == 4


@pytest.mark.slow
def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A flight with a fault fails once; with its own report as the baseline it does not; with another fault it does."""
    data = (FIXTURES / "c_copter_4hz.tlog").read_bytes()
    flight, before = tmp_path / "flight.tlog", tmp_path / "before.json"
    flight.write_bytes(inject(data, [parse_fault("yaw_offset:30")]))
    assert main(["check", str(flight), "--format", "json", "--output", str(before), "-q"]) == 1
    assert main(["check", str(flight), "--baseline", str(before)]) == 0
    assert "are as in" in capsys.readouterr().err
    flight.write_bytes(inject(data, [parse_fault("quaternion_conjugate")]))
    assert main(["check", str(flight), "--baseline", str(before), "-q"]) == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "cannot be read: No such file"),
        ("{", "no report"),
        ("[]", "no report"),
        (json.dumps({"schema": "gcs-bridge/doctor/1", "files": []}), "its schema is 'gcs-bridge/doctor/1'"),
        (json.dumps({"schema": "gcs-bridge/report/1", "files": [{}]}), "no report"),
    ],
)
def test_what_is_no_baseline(content: str | None, said: str, tmp_path: Path) -> None:
    """One line that says what is wrong."""
    path = tmp_path / "before.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(UsageError, match=said):
        read_baseline(path)
