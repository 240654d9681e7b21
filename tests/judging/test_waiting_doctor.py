"""A doctor who waits: alarms are told before their diagnosis is made, and nothing else becomes different by that."""

import pytest

from gcs_bridge.events import AlarmCleared, AlarmRaised, DiagnosisMade, Event, Reboot
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire

Frames = list[tuple[int, bytes]]


def flown(*, reboots: bool = False) -> Frames:
    """25° of yaw from 3 s to 6 s; with a reboot in the midst of it another boot, which is fine."""
    lasts_s = 5.5 if reboots else 9.0
    healthy = wire.tlog(wire.flight(wire.Motion(9.0, seed=3), lasts_s, euler_hz=5.0, quaternion_hz=5.0))
    frames = list(wire.records(inject(healthy, [parse_fault("yaw_offset:25")], from_s=3.0, to_s=6.0)))
    if reboots:
        motion, later_us = wire.Motion(3.0, seed=4), wire.START_US + 7_000_000
        frames += wire.flight(motion, 3.0, start_us=later_us, boot_ms=500, euler_hz=5.0, quaternion_hz=5.0)
    return frames


def told(monitor: Monitor, frames: Frames, *, asked_each: int = 0) -> list[Event]:
    """All events; between two frames, after so many, one answer is asked for, or never but at the end."""
    events = []
    for number, (t_us, frame) in enumerate(frames):
        events += monitor.feed(frame, t_us)
        if asked_each and number % asked_each == 0:
            events += monitor.answer()
    return events + monitor.finish()


def of_alarms(events: list[Event]) -> list[Event]:
    return [event for event in events if isinstance(event, AlarmRaised | AlarmCleared | Reboot)]


def diagnoses(events: list[Event]) -> list[Event]:
    return [event for event in events if isinstance(event, DiagnosisMade)]


@pytest.mark.slow
@pytest.mark.parametrize(("asked_each", "reboots"), [(0, False), (7, False), (0, True)])
def test_whenever_it_answers_it_says_the_same(asked_each: int, reboots: bool) -> None:
    """Diagnoses, their times, and what alarms say as they go; and in the report: as of one who answers at once."""
    frames = flown(reboots=reboots)
    at_once, waiting = Monitor(), Monitor(doctor_waits=True)
    expected, found = told(at_once, frames), told(waiting, frames, asked_each=asked_each)
    assert diagnoses(expected)
    assert not waiting.is_asked
    assert of_alarms(found) == of_alarms(expected)
    assert diagnoses(found) == diagnoses(expected)
    assert waiting.close().to_dict() == at_once.close().to_dict()


def test_an_alarm_is_told_before_anybody_asks_why() -> None:
    """The raise comes with its frame, the diagnosis once there is time for it."""
    monitor = Monitor(doctor_waits=True)
    for t_us, frame in flown():
        events = monitor.feed(frame, t_us)
        if any(isinstance(event, AlarmRaised) for event in events):
            break
    assert not diagnoses(events)
    asked_before, (diagnosis,) = monitor.is_asked, monitor.answer()
    assert isinstance(diagnosis, DiagnosisMade)
    assert diagnosis.diagnosis.cause == "yaw_offset"
    assert (asked_before, monitor.is_asked, monitor.answer()) == (True, False, [])
