"""Where frames and events go: files that survive, lines that read well."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge.alarms.record import AlarmRecord
from gcs_bridge.contract import plain
from gcs_bridge.errors import UsageError
from gcs_bridge.events import (
    AlarmCleared,
    AlarmEvent,
    AlarmPending,
    AlarmRaised,
    ClockStep,
    EstimatorReset,
    Event,
    Inop,
    LinkDown,
    LinkUp,
    NoCompare,
    StreamResumed,
    StreamStale,
    VehicleLost,
    head,
)
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.sinks.event_lines import event_json, event_line, event_words, is_alarm, is_detail
from gcs_bridge.sinks.file import LiveFile
from gcs_bridge.telemetry.identity import VehicleId
from tests.helpers.live_links import fixture, tlog_of


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
    assert said == ["cannot write /dev/full: No space left on device; going on without it until that is mended"]


def test_events_as_json() -> None:
    """One object a line, the event itself, and null where nothing is known."""
    for event in events_of("a_copter_square", from_s=75, to_s=81, fault="yaw_offset:25"):
        line = event_json(event)
        assert line.endswith(b"}\n")
        assert line.count(b"\n") == 1
        assert json.loads(line) == plain(event)
        assert json.loads(event_json(event, "/dev/tty\udcff")) == plain(event) | {"link": "/dev/tty\\xff"}
    reset = EstimatorReset(**head(VehicleId(2, 1, 1), 0, None, -1), tilt=1.0, heading=math.nan, explained_by=())
    told = json.loads(event_json(reset))
    assert (told["event"], told["heading"], told["utc"], told["link"]) == ("estimator_reset", None, None, 2)


def test_events_as_lines() -> None:
    """Each says when, who and what, on one line of modest width."""
    events = events_of("a_copter_square", from_s=75, to_s=81, fault="yaw_offset:25")
    lines = {event.name: event_line(event) for event in events if not is_detail(event)}
    diagnosis = lines.pop("diagnosis")
    assert lines == {
        "vehicle_seen": "00:47:09  1,1               vehicle seen",
        "stream_started": "00:47:09  1,1       76.0 s  ATTITUDE_QUATERNION started",
        "alarm_raised": "00:47:14  1,1       81.1 s  ALARM euler_quaternion: "
        "ATTITUDE and ATTITUDE_QUATERNION are not one rotation: 25.00°, tilt 0.00°, heading 25.00°",
    }
    assert "euler_quaternion: yaw_offset" in diagnosis


def test_an_estimators_reset_is_told_with_its_size() -> None:
    """Heading and tilt of the step, and what the vehicle said before it."""
    reset = EstimatorReset(**of((1, 1)), tilt=0.012, heading=-21.7, explained_by=("EKF3 IMU0 yaw aligned",))
    told = event_words(reset)
    assert told == (
        "the estimator was reset: heading stepped by -21.70°, tilt by 0.01° (said before it: EKF3 IMU0 yaw aligned)"
    )


def of(vehicle: tuple[int, int] | None, check: str | None = None) -> Any:
    """The head of an event of which the time is unknown."""
    return {"vehicle": vehicle, "boot": None, "boot_s": None, "utc": None, "check": check}


def alarm(kind: type[AlarmEvent], **changes: Any) -> AlarmEvent:
    record = AlarmRecord.new(
        alarm_id="x-0-1", check="x", severity="alarm", boot=0, what="they differ", is_not="", unit="deg"
    )
    told = record.told() | {"peak": 3.0, "axis": "tilt, about body y (pitch)", "tilt": 3.0, "heading": None} | changes
    return kind(**of((1, 1), "x"), **told)


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (LinkUp(**of(None), link="udpin:0.0.0.0:14550"), "link up: udpin:0.0.0.0:14550"),
        (LinkDown(**of(None), link="tcp:a:1", reason="gone\x1b"), "link down: tcp:a:1: gone\\x1b"),
        (VehicleLost(**of((7, 1)), link=2), "vehicle LOST: nothing comes from it any more"),
        (StreamStale(**of((1, 1)), stream="ATTITUDE"), "ATTITUDE went silent"),
        (StreamResumed(**of((1, 1)), stream="ATTITUDE"), "ATTITUDE resumed"),
        (NoCompare(**of((1, 1), "x"), reason="why"), "NO COMPARE x: why"),
        (ClockStep(**of((1, 1)), step_s=61.0), "boot clock stepped by +61.0 s"),
        (
            alarm(AlarmCleared),
            "alarm cleared x: they differ: 3.00°, tilt 3.00°, heading unknown, about body y (pitch)",
        ),
        (
            alarm(AlarmRaised, severity="warning", axis=None, tilt=None),
            "WARNING x: they differ: 3.00°",
        ),
        (Inop(**of((1, 1), "x"), reason="why"), "inop"),
    ],
)
def test_each_kind_of_event_reads_well(event: Event, said: str) -> None:
    """What is unknown is left out or called so; control characters of the other side do not reach the terminal."""
    assert event_line(event).endswith(f"  {said}")
    assert event_line(event).startswith("time ?")


def test_who_sees_what() -> None:
    """Alarms for those who want nothing else; what is pending only for those who want everything."""
    assert is_alarm(alarm(AlarmRaised))
    assert is_alarm(alarm(AlarmCleared))
    assert not is_alarm(alarm(AlarmPending))
    assert not is_alarm(StreamStale(**of((1, 1)), stream="ATTITUDE"))
    assert is_detail(alarm(AlarmPending))
    assert not is_detail(alarm(AlarmRaised))
