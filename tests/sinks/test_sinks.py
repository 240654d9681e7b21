"""Where frames and events go: files that survive, lines that read well."""

import json
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge.errors import UsageError
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.sinks.event_lines import event_json, event_line, is_alarm, is_detail
from gcs_bridge.sinks.file import LiveFile
from tests.helpers.live_links import Event, fixture, tlog_of


def events_of(name: str, **options: Any) -> list[Event]:
    return Monitor().feed_recording(tlog_of(fixture(name, **options)))


def test_what_is_there_stays(tmp_path: Path) -> None:
    """A second run appends, and every write can be read at once."""
    path = tmp_path / "live.tlog"
    for data in (b"first", b"second"):
        with LiveFile(path, pytest.fail) as file:
            file.append(data)
            assert path.read_bytes().endswith(data)
    assert path.read_bytes() == b"firstsecond"


@pytest.mark.parametrize("where", [".", "none/live.tlog"])
def test_where_nothing_can_be_written(where: str, tmp_path: Path) -> None:
    """A folder, or no folder: refused at once."""
    with pytest.raises(UsageError, match="cannot write"):
        LiveFile(tmp_path / where, pytest.fail)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_told_once() -> None:
    """Listening goes on without the file."""
    said: list[str] = []
    with LiveFile(Path("/dev/full"), said.append) as file:
        for _ in range(3):
            file.append(b"x")
        assert file.failed
    assert said == ["cannot write /dev/full any longer: No space left on device; going on without it"]


def test_events_as_json() -> None:
    """One object a line, the event itself, and null where nothing is known."""
    for event in events_of("a_copter_square", from_s=75, to_s=81, fault="yaw_offset:25"):
        line = event_json(event)
        assert line.endswith(b"}\n")
        assert line.count(b"\n") == 1
        assert json.loads(line) == event
    assert json.loads(event_json({"heading": float("nan")})) == {"heading": None}


def test_events_as_lines() -> None:
    """Each says when, who and what, on one line of modest width."""
    events = events_of("a_copter_square", from_s=75, to_s=81, fault="yaw_offset:25")
    lines = {event["event"]: event_line(event) for event in events if not is_detail(event)}
    diagnosis = lines.pop("diagnosis")
    assert lines == {
        "vehicle_seen": "00:47:09  1,1               vehicle seen",
        "stream_started": "00:47:09  1,1       76.0 s  ATTITUDE_QUATERNION started",
        "alarm_raised": "00:47:14  1,1       81.1 s  ALARM euler_quaternion: "
        "ATTITUDE and ATTITUDE_QUATERNION are not one rotation: 25.00°, tilt 0.00°, heading 25.00°",
    }
    assert "euler_quaternion: yaw_offset" in diagnosis


@pytest.mark.parametrize(
    ("event", "said"),
    [
        ({"event": "link_up", "link": "udpin:0.0.0.0:14550"}, "link up: udpin:0.0.0.0:14550"),
        ({"event": "link_down", "link": "tcp:a:1", "reason": "gone\x1b"}, "link down: tcp:a:1: gone\\x1b"),
        ({"event": "vehicle_lost", "vehicle": [7, 1]}, "vehicle LOST: nothing comes from it any more"),
        ({"event": "stream_stale", "vehicle": [1, 1], "stream": "ATTITUDE"}, "ATTITUDE went silent"),
        ({"event": "no_compare", "vehicle": [1, 1], "check": "x", "reason": "why"}, "NO COMPARE x: why"),
        ({"event": "clock_step", "vehicle": [1, 1], "step_s": 61.0}, "boot clock stepped by +61.0 s"),
        (
            {"event": "alarm_cleared", "vehicle": [1, 1], "severity": "alarm", "check": "x", "unit": "deg", "peak": 3.0}
            | {
                "what": "they differ",
                "axis": "tilt, about body y (pitch)",
                "tilt": 3.0,
                "heading": None,
                "grouped": None,
            },
            "alarm cleared x: they differ: 3.00°, tilt 3.00°, heading unknown, about body y (pitch)",
        ),
        ({"event": "inop", "vehicle": [1, 1]}, "inop"),
    ],
)
def test_each_kind_of_event_reads_well(event: Event, said: str) -> None:
    """What is unknown is left out or called so; control characters of the other side do not reach the terminal."""
    whole = {"vehicle": None, "boot": None, "boot_s": None, "utc": None, "check": None} | event
    assert event_line(whole).endswith(f"  {said}")
    assert event_line(whole).startswith("time ?")


def test_who_sees_what() -> None:
    """Alarms for those who want nothing else; what is pending only for those who want everything."""
    assert is_alarm({"event": "alarm_raised"})
    assert is_alarm({"event": "alarm_cleared"})
    assert not is_alarm({"event": "alarm_pending"})
    assert not is_alarm({"event": "stream_stale"})
    assert is_detail({"event": "alarm_pending"})
