"""Several links at once, and links that end: the same vehicle on two of them is two, and neither is lost by the other.

Flights are made by hand (tests/helpers/wire.py) and falsified by `inject`.
"""

from typing import Any

import pytest

from gcs_bridge import Monitor
from gcs_bridge.events import Notice, utc
from gcs_bridge.judging.link_vehicle import LinkVehicle
from gcs_bridge.judging.monitor import Monitor as JudgingMonitor
from gcs_bridge.judging.observation import Observation
from gcs_bridge.mavlink.scanner import RawFrame
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.telemetry.link_clock import LinkClock
from tests.helpers import wire

Event = dict[str, Any]

S = 1_000_000
HEALTHY = wire.flight(wire.Motion(30.0, seed=3), 30.0, euler_hz=10.0, quaternion_hz=10.0)
FAULTY = list(wire.records(inject(wire.tlog(HEALTHY), [parse_fault("yaw_offset:25")], from_s=4.0)))


def feed(monitor: Monitor, frames: list[tuple[int, bytes]], link: int) -> list[Event]:
    """What all these frames, one datagram each, bring about on a link."""
    return [event for t_us, frame in frames for event in monitor.feed(frame, t_us, link)]


def named(events: list[Event], *names: str) -> list[Event]:
    return [event for event in events if event["event"] in names]


def until(frames: list[tuple[int, bytes]], seconds: float, since: float = 0.0) -> list[tuple[int, bytes]]:
    return [one for one in frames if wire.START_US + since * S <= one[0] < wire.START_US + seconds * S]


@pytest.mark.slow
def test_one_vehicle_on_two_links_has_two_alarms() -> None:
    """Each has an id of its own, and is acknowledged by it alone; the first link's is as if it were alone."""
    monitor = Monitor()
    raised = [named(feed(monitor, until(FAULTY, 6.0), link), "alarm_raised")[0] for link in (0, 1)]
    assert [event["id"] for event in raised] == ["1.1-euler_quaternion-0-1", "link1-1.1-euler_quaternion-0-1"]
    assert ["link" in event for event in raised] == [False, True]
    assert raised[1]["link"] == 1
    (told,) = monitor.acknowledge(raised[1]["id"], FAULTY[-1][0])
    assert (told["event"], told["id"], told["link"]) == ("alarm_acknowledged", raised[1]["id"], 1)
    files = monitor.close().to_dict()["files"]
    first, second = ([alarm for v in file["vehicles"] for alarm in v["alarms"]] for file in files)
    assert [alarm["acknowledged"] for alarm in first if alarm["id"] == raised[0]["id"]] == [False]
    assert [alarm["acknowledged"] for alarm in second if alarm["id"] == raised[1]["id"]] == [True]


@pytest.mark.slow
def test_of_two_links_the_one_that_ends_loses_its_vehicle_in_time() -> None:
    """Its alarm can still be acknowledged; it is stale 2 s, and lost 5 s, behind its last frame; the other goes on."""
    monitor = Monitor()
    events: dict[int, list[Event]] = {0: [], 1: []}
    for link, flight in ((0, until(FAULTY, 7.0)), (1, until(HEALTHY, 7.0))):
        events[link] += feed(monitor, flight, link)
    end_us = wire.START_US + 7 * S
    assert monitor.close_link(0, end_us) == []
    (alarm,) = named(events[0], "alarm_raised")
    assert [event["event"] for event in monitor.acknowledge(alarm["id"], end_us)] == ["alarm_acknowledged"]
    told = []
    for quarter in range(28, 52):
        second = quarter / 4
        events[1] += feed(monitor, until(HEALTHY, second + 0.25, second), 1)
        told += [(second, event) for event in monitor.advance(wire.START_US + round(second * S), 0)]
    last_s = max(t_us for t_us, _ in until(FAULTY, 7.0)) / S - wire.START_US / S
    stale = [at for at, event in told if event["event"] == "stream_stale"]
    lost = [at for at, event in told if event["event"] == "vehicle_lost"]
    assert stale == [9.0, 9.0]  # the first quarter second more than 2 s behind the last samples at 6.9 s
    assert lost == [12.0]
    assert last_s == pytest.approx(6.9)
    assert not named(events[1], "stream_stale", "vehicle_lost", "alarm_raised")
    closed, alive = monitor.close().to_dict()["files"]
    assert alive["verdict"] == "agree"
    assert closed["verdict"] == "alarm"


def test_half_a_frame_is_dropped_and_the_link_opens_again() -> None:
    """What was left of a stream joins nothing that comes later: no false frame, and every byte accounted for."""
    whole = [frame for _, frame in until(HEALTHY, 20.0)]
    before, after = whole[:200], whole[200:]
    half = after[0][:20]
    monitor = Monitor()
    monitor.open_link(0)
    t_us = wire.START_US
    monitor.feed(b"".join(before) + half, t_us, 0)
    monitor.close_link(0, t_us + 8 * S)
    with pytest.raises(ValueError, match="link 0 is not open"):
        monitor.close_link(0, t_us + 8 * S)
    monitor.open_link(0)
    # The rest of that frame would complete it, and hides a whole frame of another system as its payload would.
    decoy = after[0][20:] + wire.heartbeat(sysid=77)
    events = monitor.feed(decoy + b"".join(after[1:]), t_us + 9 * S, 0)
    entry = monitor.close().to_dict()["files"][0]
    salvage = entry["salvage"]
    assert salvage["frames"] == len(before) + 1 + len(after) - 1  # the decoy's own heartbeat, and all that came whole
    assert salvage["skipped_bytes"] == len(after[0])
    assert [gap["bytes"] for gap in salvage["gaps"]] == [len(after[0])]
    assert {(v["sysid"], v["compid"]) for v in entry["vehicles"]} == {(1, 1), (77, 1)}
    assert named(events, "vehicle_seen")


def test_a_link_that_was_closed_is_open_again_with_its_next_bytes() -> None:
    """Who does not say that it is there again may go on all the same; one that is open cannot be opened."""
    monitor = Monitor()
    monitor.open_link(2, datagrams=True)
    feed(monitor, until(HEALTHY, 2.0), 2)
    monitor.close_link(2, wire.START_US + 2 * S)
    seen = feed(monitor, until(HEALTHY, 12.0, 10.0), 2)
    assert [e["event"] for e in named(seen, "vehicle_lost", "vehicle_seen")] == ["vehicle_lost", "vehicle_seen"]
    with pytest.raises(ValueError, match="link 2 is open already"):
        monitor.open_link(2)


def test_frames_of_datagrams_judged_together_are_handed_on_before_with_their_own_times() -> None:
    """All of them at once, byte for byte, each with the receive time of its datagram."""
    seen: list[RawFrame] = []
    monitor = JudgingMonitor(on_frames=lambda _, frames: seen.extend(frames))
    sent = [(frame, wire.START_US + i) for i, (_, frame) in enumerate(HEALTHY[:3])]
    monitor.feed_datagrams(sent)
    assert [(frame.data, frame.t_rx_us) for frame in seen] == sent


def test_a_vehicle_that_sends_nothing_is_looked_at_when_its_time_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixty others on the link cost nothing while one flies on; five seconds behind their beat all of them are lost."""
    looked_at: list[tuple[int, int]] = []
    advance = LinkVehicle.advance

    def counted(vehicle: LinkVehicle, clock: LinkClock) -> list[Notice]:
        looked_at.append(vehicle.vehicle.address)
        return advance(vehicle, clock)

    monkeypatch.setattr(LinkVehicle, "advance", counted)
    monitor, others = Monitor(), [(2 + i, 1) for i in range(60)]
    for sysid, _ in others:
        monitor.feed(wire.heartbeat(sysid=sysid), wire.START_US)
    early = feed(monitor, until(HEALTHY, 4.95), 0)
    assert (looked_at, named(early, "vehicle_lost")) == ([], [])
    late = named(feed(monitor, until(HEALTHY, 9.0, 4.95), 0), "vehicle_lost")
    assert sorted(tuple(event["vehicle"]) for event in late) == others
    assert {event["utc"] for event in late} == {utc(wire.START_US + 5 * S)}
    assert sorted(looked_at) == others


@pytest.mark.slow
def test_an_alarm_that_is_shelved_while_its_vehicle_is_silent_returns_in_time() -> None:
    """Nothing of the vehicle comes any more: the time of the link alone ends it, with the first frame behind it."""
    monitor = Monitor()
    (raised,) = named(feed(monitor, until(FAULTY, 8.0), 0), "alarm_raised")
    end_us = wire.START_US + 8 * S
    monitor.shelve(raised["id"], end_us, 1.5)
    beats = [(end_us + quarter * S // 4, wire.heartbeat(sysid=9, seq=quarter)) for quarter in range(1, 12)]
    told = [(t_us, event) for t_us, beat in beats for event in feed(monitor, [(t_us, beat)], 0)]
    back = [t_us for t_us, event in told if event["event"] == "alarm_unshelved"]
    assert back == [end_us + 3 * S // 2]


@pytest.mark.slow
def test_observers_see_vehicles_alone_and_all_of_them() -> None:
    """A ground station that sends attitudes is shown to nobody; of a vehicle that is known late nothing is missing."""
    station = [
        (t_us, wire.heartbeat(autopilot=wire.NO_AUTOPILOT, vehicle=wire.GROUND_STATION, sysid=255, compid=190))
        for t_us, _ in HEALTHY[:200:50]
    ]
    sent = wire.flight(wire.Motion(4.0, seed=5), 4.0, euler_hz=10.0, quaternion_hz=10.0, sysid=255, compid=190)
    others = [*station, *(one for one in sent if len(one[1]) > 30)]  # without its heartbeats, of an autopilot
    third = wire.flight(wire.Motion(4.0, seed=6), 4.0, euler_hz=10.0, quaternion_hz=10.0, sysid=3)
    silent = [one for one in third if len(one[1]) > 30]
    seen: list[Observation] = []
    monitor = Monitor(observer=seen.append)
    for t_us, frame in sorted([*until(HEALTHY, 4.0), *others, *silent], key=lambda one: one[0]):
        monitor.feed(frame, t_us)
    assert {observation.vehicle.address for observation in seen} == {(1, 1), (3, 1)}
    for sysid, sent in ((1, until(HEALTHY, 4.0)), (3, silent)):
        shown = sum(len(one.segment.euler) + len(one.segment.quaternion) for one in seen if one.vehicle.sysid == sysid)
        assert shown == sum(len(frame) > 30 for _, frame in sent)
