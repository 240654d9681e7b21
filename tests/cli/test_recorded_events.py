"""`check --events` and `replay --events`: what happened in a recording, one JSON object a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import gcs_bridge
from gcs_bridge.cli import main
from tests.helpers.paths import FIXTURES

RESETS = str(FIXTURES / "k12_yaw_reset.tlog")
FAULT = str(FIXTURES / "k7a_gyro_bias_both.tlog")


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def monitored(path: str) -> list[dict[str, Any]]:
    """The events that a monitor tells which is given the whole recording at once, with its name as the link's."""
    monitor = gcs_bridge.Monitor()
    told: list[Any] = [*monitor.feed_recording(Path(path).read_bytes()), *monitor.finish()]
    return [{**event, "link": path} for event in told]


def test_check_writes_what_a_monitor_tells(tmp_path: Path) -> None:
    """Of each recording in turn, with its name as the link's; a file of an earlier run is replaced."""
    file = tmp_path / "events.jsonl"
    file.write_text("old\n")
    assert main(["check", RESETS, FAULT, "-q", "--events", str(file)]) == 1
    told = lines(file.read_text())
    for path in (RESETS, FAULT):
        assert [event for event in told if event["link"] == path] == monitored(path)
    assert [event["link"] for event in told] == sorted((event["link"] for event in told), key=[RESETS, FAULT].index)


@pytest.mark.parametrize("command", [["check"], ["replay", "--viewer", "none"]])
def test_events_on_stdout_leave_the_report_to_stderr(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Whoever reads the events by a pipe finds nothing else in it."""
    assert main([*command, RESETS, "--events", "-"]) == 0
    out, err = capsys.readouterr()
    assert lines(out) == monitored(RESETS)
    assert f"AGREE       {RESETS}: 1 vehicle, no alarm" in err


def test_an_alarm_s_events_carry_what_the_report_says_of_it(tmp_path: Path) -> None:
    """Raised at the same second, by the same check, under the same name."""
    file, report = tmp_path / "events.jsonl", tmp_path / "report.json"
    assert main(["check", FAULT, "-q", "--format", "json", "--output", str(report), "--events", str(file)]) == 1
    alarms = json.loads(report.read_text())["files"][0]["vehicles"][0]["alarms"]
    raised = {event["id"]: event for event in lines(file.read_text()) if event["event"] == "alarm_raised"}
    assert raised.keys() == {alarm["id"] for alarm in alarms}
    for alarm in alarms:
        event = raised[alarm["id"]]
        assert (event["check"], event["raised_boot_s"]) == (alarm["check"], alarm["raised_boot_s"])


def test_the_report_lists_the_estimator_s_resets(tmp_path: Path) -> None:
    """Each as its event told it: when, how far heading and tilt stepped, and what the vehicle said before."""
    file, report = tmp_path / "events.jsonl", tmp_path / "report.json"
    assert main(["check", RESETS, "-q", "--format", "json", "--output", str(report), "--events", str(file)]) == 0
    listed = json.loads(report.read_text())["files"][0]["vehicles"][0]["resets"]
    told = [event for event in lines(file.read_text()) if event["event"] == "estimator_reset"]
    assert listed == [{name: event[name] for name in listed[0]} for event in told]
    assert [round(reset["heading"]) for reset in listed] == [22, 4]


@pytest.mark.parametrize("name", ["flight.tlog", "report.json", "missing/events.jsonl", "."])
def test_events_that_cannot_be_written_are_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recording itself, the report, a folder that is not there, a folder: one line, 2, and nothing is lost."""
    monkeypatch.chdir(tmp_path)
    recorded = Path(RESETS).read_bytes()[:20_000]
    Path("flight.tlog").write_bytes(recorded)
    assert main(["check", "flight.tlog", "--output", "report.json", "--events", name]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert Path("flight.tlog").read_bytes() == recorded
