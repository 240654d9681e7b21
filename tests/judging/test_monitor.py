"""The monitor: who is a vehicle, what it tells as it happens, and what it makes of silence and of nonsense.

Flights are made by hand (tests/wire.py), so that every time in an event is known beforehand.
"""

import json
import math
import struct
from collections.abc import Iterable
from datetime import datetime
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge import Monitor
from gcs_bridge.errors import UsageError
from tests.helpers import wire
from tests.helpers.report_entries import CHECKS

Json = dict[str, Any]
Record = tuple[int, bytes]

EVENTS = {
    *("link_up", "link_down", "vehicle_seen", "vehicle_lost", "stream_started", "stream_stale", "stream_resumed"),
    *("reboot", "estimator_reset", "clock_step", "alarm_pending", "alarm_raised", "alarm_cleared"),
    *("alarm_acknowledged", "alarm_shelved", "alarm_unshelved", "diagnosis", "no_compare", "compare_resumed"),
    *("inop", "damage"),
}
ALARM_KEYS = {  # the contract's, and what an alarm says besides
    *("id", "check", "severity", "boot", "raised_boot_s", "cleared_boot_s", "raised_utc", "unit", "peak", "tilt"),
    *("heading", "rotvec_body", "diagnosis", "what", "is_not", "axis", "repeats", "grouped", "acknowledged"),
}
LEVEL = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
BOOT_S = 10.0  # the boot clock at START_US in wire.flight


def feed(monitor: Monitor, records: Iterable[Record], link: int = 0) -> list[Json]:
    return [event for t_us, frame in records for event in monitor.feed(frame, t_us, link)]


def watched(records: Iterable[Record], **options: Any) -> tuple[list[Json], Json]:
    """The events of a recording and its entry in the report."""
    monitor = Monitor(**options)
    events = monitor.feed_recording(wire.tlog(records))
    (entry,) = monitor.close().to_dict()["files"]
    return events, entry


def told(events: Iterable[Json], name: str) -> list[Json]:
    return [event for event in events if event["event"] == name]


def at_s(seconds: float) -> int:
    """Receive time so many seconds behind the start of wire.flight."""
    return wire.START_US + round(seconds * 1e6)


def utc_s(event: Json) -> float:
    """Seconds behind the start of wire.flight at which an event was received."""
    return datetime.fromisoformat(event["utc"]).timestamp() - wire.START_US / 1e6


def sent(
    seconds: float,
    hz: float,
    *,
    euler: Any = LEVEL,
    quaternion: Any = UPRIGHT,
    beats: bool = True,
    begin_s: float = 0.0,
    sysid: int = 1,
    compid: int = 1,
    rates: Any = (0, 0, 0),
) -> list[Record]:
    """Records of a vehicle at rest; `euler` and `quaternion` are values, functions of the number, or None for none.

    A live sensor never says the very same twice: every other attitude is 1e-7 rad of roll further, float32's noise.
    """
    records = []
    for number in range(round(seconds * hz)):
        now_s = begin_s + number / hz
        ms, t_us = round(1000 * (BOOT_S + now_s)), at_s(now_s)
        to: dict[str, Any] = {"seq": 3 * number, "sysid": sysid, "compid": compid}
        if beats and number % max(round(hz), 1) == 0:
            records.append((t_us, wire.heartbeat(**to)))
        for value, place, noise, make in (
            (euler, 0, 1e-7, wire.attitude),
            (quaternion, 1, 0.5e-7, wire.attitude_quaternion),
        ):
            given = value(number) if callable(value) else value
            to["seq"] += 1
            if given is not None:
                noisy = np.array(given, np.float64)
                noisy[place] += noise * (number % 2)
                records.append((t_us, make(ms, noisy, rates, **to)))
    return records


# --- who is a vehicle ------------------------------------------------------------------------------------------------


def keys(entry: Json) -> list[tuple[int, int]]:
    return [(vehicle["sysid"], vehicle["compid"]) for vehicle in entry["vehicles"]]


def test_ground_stations_radios_and_companions_are_no_vehicles() -> None:
    """Heartbeats of a ground station, a gimbal and a companion, and a radio's status, name no vehicle."""
    radio = mavlink.MAVLink_radio_status_message(190, 180, 100, 40, 45, 0, 0)
    records = []
    for second in range(20):
        records += [
            (at_s(second), wire.heartbeat(autopilot=8, vehicle=6, sysid=255, compid=190, seq=second)),
            (at_s(second), wire.heartbeat(autopilot=0, vehicle=6, sysid=254, compid=190, seq=second)),
            (at_s(second), wire.heartbeat(autopilot=8, vehicle=26, sysid=1, compid=154, seq=second)),
            (at_s(second), wire.heartbeat(autopilot=8, vehicle=18, sysid=1, compid=191, seq=second)),
            (at_s(second), wire.pack(radio, sysid=51, compid=68, seq=second)),
        ]
    events, entry = watched(records)
    assert keys(entry) == []
    assert events == []
    assert entry["verdict"] == "no_compare"
    assert entry["salvage"]["frames"] == len(records)


def test_attitudes_of_who_says_it_is_no_autopilot() -> None:
    """A gimbal that sends attitudes under its own component is no vehicle, and does not disturb the one beside it."""
    gimbal = sent(5, 10, beats=False, compid=154, quaternion=(0.0, 1.0, 0.0, 0.0))
    beat = (at_s(0), wire.heartbeat(autopilot=8, vehicle=26, compid=154))
    records = sorted([beat, *gimbal, *sent(5, 10)], key=lambda record: record[0])
    events, entry = watched(records)
    assert keys(entry) == [(1, 1)]
    assert {tuple(event["vehicle"]) for event in events} == {(1, 1)}
    assert entry["verdict"] == "agree"


def test_unknown_messages_name_no_vehicle() -> None:
    """Frames of a message that no dialect defines are counted as unverified and name no vehicle."""
    known = wire.attitude(1000, LEVEL, sysid=77)
    unknown = wire.with_checksum(known[:7] + (54321).to_bytes(3, "little") + known[10:], 0)
    events, entry = watched([(at_s(i / 10), unknown) for i in range(50)] + sent(2, 10))
    assert keys(entry) == [(1, 1)]
    assert entry["salvage"]["unverified"] == 50
    assert all(event["vehicle"] == [1, 1] for event in events)


def test_system_zero_is_nobody() -> None:
    """System 0 addresses all: attitudes and heartbeats under it name no vehicle."""
    events, entry = watched(sent(3, 10, sysid=0))
    assert keys(entry) == []
    assert events == []


def test_an_autopilot_s_heartbeat_names_a_vehicle() -> None:
    """One heartbeat of an autopilot is enough, with the names that people use for it; nothing to compare is told so."""
    records = [
        (at_s(0), wire.heartbeat(autopilot=3, vehicle=2, sysid=1)),
        (at_s(0), wire.heartbeat(autopilot=12, vehicle=1, sysid=2)),
        (at_s(0), wire.heartbeat(autopilot=0, vehicle=10, sysid=3, compid=7)),
    ]
    events, entry = watched(records)
    assert [(v["autopilot"], v["type"]) for v in entry["vehicles"]] == [
        ("ardupilot", "quadrotor"),
        ("px4", "fixed_wing"),
        ("generic", "ground_rover"),
    ]
    assert keys(entry) == [(1, 1), (2, 1), (3, 7)]
    assert [event["event"] for event in events] == ["vehicle_seen"] * 3
    assert {vehicle["verdict"] for vehicle in entry["vehicles"]} == {"no_compare"}


@pytest.mark.parametrize(("count", "is_vehicle"), [(9, False), (10, True)])
def test_ten_valid_attitudes_name_a_vehicle(count: int, is_vehicle: bool) -> None:
    """Without a heartbeat, nine attitudes may be a false id and ten are a vehicle, known from the tenth on."""
    records = sent(1, 20, beats=False, quaternion=None)[:count]
    events, entry = watched(records)
    assert keys(entry) == ([(1, 1)] if is_vehicle else [])
    if is_vehicle:
        assert [event["event"] for event in events] == ["vehicle_seen", "stream_started"]
        assert utc_s(events[0]) == pytest.approx(9 / 20, abs=1e-3)
        assert entry["vehicles"][0]["autopilot"] == entry["vehicles"][0]["type"] == "unknown"


def test_an_invalid_attitude_breaks_the_run() -> None:
    """Nine valid attitudes, one without a rotation, nine again: still no ten in a row."""
    zeros = (0.0, 0.0, 0.0, 0.0)
    records = sent(1.9, 10, beats=False, euler=None, quaternion=lambda n: zeros if n == 9 else UPRIGHT)
    assert len(records) == 19
    assert keys(watched(records)[1]) == []


def test_one_system_alone() -> None:
    """With `sysid` the other vehicles of the link are neither judged nor told of."""
    records = sorted(sent(3, 10) + sent(3, 10, sysid=2), key=lambda record: record[0])
    events, entry = watched(records, sysid=2)
    assert keys(entry) == [(2, 1)]
    assert {tuple(event["vehicle"]) for event in events} == {(2, 1)}


# --- events ----------------------------------------------------------------------------------------------------------

YAWED_25 = tuple(wire.wxyz(Rotation.from_euler("ZYX", [25.0, 0.0, 0.0], degrees=True)).tolist())


def with_a_fault(number: int) -> Any:
    """25° of yaw from second 4 to second 8, at 20 Hz."""
    return YAWED_25 if 80 <= number < 160 else UPRIGHT


def test_the_life_of_an_alarm() -> None:
    """Pending with the third bad pair, raised a second later and asked about at once, cleared two seconds after most
    of five are good again.
    """
    events, entry = watched(sent(15, 20, quaternion=with_a_fault))
    names = [event["event"] for event in events]
    assert names[:6] == [
        *("vehicle_seen", "stream_started", "stream_started", "alarm_pending", "alarm_raised", "diagnosis")
    ]
    assert set(names[6:-1]) <= {"diagnosis"}
    pending, raised, cleared = changes = [event for event in events if event["event"].startswith("alarm")]
    assert [event["event"] for event in changes] == ["alarm_pending", "alarm_raised", "alarm_cleared"]
    period_s = 1 / 20
    assert pending["boot_s"] == pytest.approx(BOOT_S + 4 + 2 * period_s)
    assert raised["boot_s"] == pytest.approx(BOOT_S + 4 + 2 * period_s + 1)
    assert cleared["boot_s"] == pytest.approx(BOOT_S + 8 + 2 * period_s + 2, abs=period_s)
    for event in changes:
        assert event["utc"] is not None
        assert utc_s(event) == pytest.approx(event["boot_s"] - BOOT_S, abs=1e-3)
        assert event.keys() >= ALARM_KEYS
        assert (event["check"], event["severity"], event["unit"]) == ("euler_quaternion", "alarm", "deg")
        assert event["peak"] == pytest.approx(25, abs=1e-4)
        assert event["heading"] == pytest.approx(25, abs=1e-4)
        assert event["tilt"] == pytest.approx(0, abs=1e-4)
        np.testing.assert_allclose(event["rotvec_body"], [0, 0, 25], atol=1e-4)
    assert pending["raised_boot_s"] is None
    (alarm,) = entry["vehicles"][0]["alarms"]
    assert alarm.keys() == ALARM_KEYS
    assert alarm == {key: cleared[key] for key in ALARM_KEYS}
    assert (alarm["raised_boot_s"], alarm["cleared_boot_s"]) == (raised["boot_s"], cleared["boot_s"])
    assert alarm["raised_utc"] == raised["utc"]
    assert len({event["id"] for event in events[3:]}) == 1
    assert (alarm["axis"], alarm["repeats"], alarm["acknowledged"]) == ("heading", 0, False)
    assert entry["verdict"] == "alarm"


@pytest.mark.parametrize("count", [1, 2, 19])
def test_what_is_shorter_than_the_delay_is_no_alarm(count: int) -> None:
    """One or two bad pairs are nothing, and 19 at 20 Hz pend below a second: no alarm."""
    events, entry = watched(sent(10, 20, quaternion=lambda n: YAWED_25 if 80 <= n < 80 + count else UPRIGHT))
    assert not told(events, "alarm_raised")
    assert bool(told(events, "alarm_pending")) == (count > 2)
    assert entry["verdict"] == "agree"
    assert entry["vehicles"][0]["alarms"] == []


@pytest.mark.slow
def test_a_second_excursion_is_a_second_alarm() -> None:
    """Two excursions 34 s apart, beyond the 30 s of a repeat, are two alarms with names of their own, in order."""
    events, entry = watched(sent(45, 10, quaternion=lambda n: YAWED_25 if 40 <= n < 80 or 380 <= n < 420 else UPRIGHT))
    alarms = entry["vehicles"][0]["alarms"]
    assert len(alarms) == len({alarm["id"] for alarm in alarms}) == 2
    assert alarms[0]["cleared_boot_s"] < alarms[1]["raised_boot_s"]
    changes = [event["event"] for event in events if event["event"].startswith("alarm")]
    assert changes == ["alarm_pending", "alarm_raised", "alarm_cleared"] * 2


def test_events_have_the_contract_s_keys_and_are_json() -> None:
    """Every event is a JSON object with the contract's fields, its name among the contract's, in order of time."""
    events = watched(sent(15, 20, quaternion=lambda n: None if 200 <= n < 260 else with_a_fault(n)))[0]
    assert len(events) > 8
    for event in events:
        assert json.loads(json.dumps(event, allow_nan=False)) == event
        assert event["event"] in EVENTS
        assert event.keys() >= {"vehicle", "boot", "boot_s", "utc", "check"}
        assert event["vehicle"] == [1, 1]
        assert event["boot"] == 0
    times = [utc_s(event) for event in events if event["event"] != "vehicle_seen"]
    assert times == sorted(times)


def test_events_of_a_recording_without_a_date() -> None:
    """Where the recorder's clock knew no date there is no utc, and the judgement is the same."""
    records = [(t_us - wire.START_US + 1_000_000, frame) for t_us, frame in sent(15, 20, quaternion=with_a_fault)]
    events, entry = watched(records)
    assert {event["utc"] for event in events} == {None}
    changes = [event["event"] for event in events if event["event"].startswith("alarm")]
    assert changes == ["alarm_pending", "alarm_raised", "alarm_cleared"]
    assert entry["vehicles"][0]["boots"][0]["start_utc"] is None


def test_reboot() -> None:
    """A clock that starts anew is a second boot: told once, nothing compared across it, no alarm of it."""
    motion = wire.Motion(20, speed_rad_s=1.5)
    before = wire.flight(motion, 10, boot_ms=600_000)
    after = wire.flight(wire.Motion(20, seed=5), 10, boot_ms=2000, start_us=at_s(12))
    after = [record for record in after if not at_s(16.02) < record[0] < at_s(17.02)]
    events, entry = watched(before + after)
    (reboot,) = told(events, "reboot")
    assert reboot["boot"] == 1
    assert reboot["boot_s"] == pytest.approx(2.0, abs=0.05)
    assert utc_s(reboot) == pytest.approx(12, abs=0.1)
    boots = entry["vehicles"][0]["boots"]
    assert [boot["index"] for boot in boots] == [0, 1]
    assert boots[0]["first_boot_s"] == 600.0
    assert boots[0]["last_boot_s"] == pytest.approx(609.96)
    assert boots[1]["first_boot_s"] == pytest.approx(2.0, abs=0.05)
    for stream in entry["vehicles"][0]["streams"].values():
        assert stream["max_gap_s"] == pytest.approx(1.04)  # in the second boot, and none from boot to boot
    assert entry["vehicles"][0]["alarms"] == []
    assert entry["verdict"] == "agree"


def test_a_wrapped_clock_is_no_reboot() -> None:
    """After 49.7 days time_boot_ms starts at zero again: one boot, and the time goes on."""
    events, entry = watched(wire.flight(wire.Motion(12), 10, boot_ms=2**32 - 5000))
    assert not told(events, "reboot")
    (boot,) = entry["vehicles"][0]["boots"]
    assert boot["last_boot_s"] == pytest.approx((2**32 - 5000 + 9960) / 1000)
    assert entry["verdict"] == "agree"


# --- silence ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [0.0, math.nan], ids=["rates", "no rates"])
@pytest.mark.parametrize(("missing", "number"), [("ATTITUDE_QUATERNION", 31), ("ATTITUDE", 30)], ids=["31", "30"])
def test_a_message_that_never_comes(missing: str, number: int, rate: float) -> None:
    """NO COMPARE is told once, with the missing message's name, and how to get it. What came is judged by its own
    rates: good; without any it was compared with nothing, which ends with 4.
    """
    both: dict[str, Any] = {"euler": LEVEL, "quaternion": UPRIGHT} | {"euler" if number == 30 else "quaternion": None}
    monitor = Monitor()
    events = monitor.feed_recording(wire.tlog(sent(10, 10, rates=(rate, rate, rate), **both)))
    (no_compare,) = told(events, "no_compare")
    assert missing in no_compare["reason"].split()
    assert no_compare["check"] == "euler_quaternion"
    report = monitor.close()
    assert report.exit_code() == (4 if math.isnan(rate) else 0)
    assert report.exit_code("never") == 0
    (vehicle,) = report.to_dict()["files"][0]["vehicles"]
    assert [check["name"] for check in vehicle["checks"]] == CHECKS
    by_name = {check["name"]: check for check in vehicle["checks"]}
    check = by_name["euler_quaternion"]
    assert check["verdict"] == "no_compare"
    assert by_name["kinematics"]["verdict"] == vehicle["verdict"] == ("no_compare" if math.isnan(rate) else "agree")
    assert missing in check["reason"].split()
    assert f"SET_MESSAGE_INTERVAL {number}" in check["reason"]
    assert check["coverage"] in (0, None)
    assert check["pairs"] == 0
    assert check["residual"]["median"] is None
    assert missing not in vehicle["streams"]
    assert vehicle["alarms"] == []


def test_a_message_that_stops_and_comes_back() -> None:
    """31 stops at 5 s and is back at 12 s: stale 2 s after its last, NO COMPARE and an alarm of the stream from then,
    resumed with it, and the alarm is over when it has come for 2 s.
    """
    events, entry = watched(sent(20, 20, quaternion=lambda n: None if 100 <= n < 240 else UPRIGHT))
    names = [event["event"] for event in events]
    assert names[3:] == [
        *("stream_stale", "no_compare", "alarm_pending", "alarm_raised"),
        *("stream_resumed", "compare_resumed", "alarm_cleared"),
    ]
    stale, no_compare, _, raised, resumed, compare_resumed, cleared = events[3:]
    assert (raised["check"], raised["severity"]) == ("stream", "alarm")
    assert stale["boot_s"] <= raised["boot_s"] <= stale["boot_s"] + 0.06  # with the next message that has a time
    assert "ATTITUDE_QUATERNION stopped" in raised["what"]
    assert cleared["boot_s"] == pytest.approx(BOOT_S + 12 + 2)
    assert [alarm["id"] for alarm in entry["vehicles"][0]["alarms"]] == [cleared["id"]]
    assert stale["boot_s"] == pytest.approx(BOOT_S + 4.95 + 2)
    assert utc_s(stale) == pytest.approx(4.95 + 2, abs=0.06)
    assert stale["stream"] == resumed["stream"] == "ATTITUDE_QUATERNION"
    assert "ATTITUDE_QUATERNION" in no_compare["reason"]
    assert no_compare["check"] == compare_resumed["check"] == "euler_quaternion"
    assert resumed["boot_s"] == compare_resumed["boot_s"] == pytest.approx(BOOT_S + 12)
    check = entry["vehicles"][0]["checks"][0]
    assert check["verdict"] == "agree"
    assert check["coverage"] == pytest.approx(1.0, abs=0.02)  # of the time in which both came
    assert check["pairs"] == 260


def test_a_message_that_stops_twice() -> None:
    """Each stop is told, and each return: NO COMPARE and resumed take turns."""
    events = watched(sent(30, 20, quaternion=lambda n: None if 100 <= n < 200 or 300 <= n < 400 else UPRIGHT))[0]
    turn = ["stream_stale", "no_compare", "stream_resumed", "compare_resumed"]
    assert [event["event"] for event in events[3:] if not event["event"].startswith("alarm")] == turn * 2


@pytest.mark.slow
def test_deadlines_while_nothing_comes() -> None:
    """`advance` tells of a silent stream once, when 2 s have passed, with the deadline's time in both clocks."""
    monitor = Monitor()
    feed(monitor, sent(5, 10))  # the last at 4.9 s
    assert monitor.advance(at_s(4.0)) == []
    assert monitor.advance(at_s(6.85)) == []
    events = monitor.advance(at_s(9.0))
    assert [event["event"] for event in events] == ["stream_stale", "no_compare", "stream_stale"]
    for event in events:
        assert event["boot_s"] == pytest.approx(BOOT_S + 4.9 + 2)
        assert utc_s(event) == pytest.approx(4.9 + 2, abs=2e-3)  # not 9.0, when it was noticed
    assert {event["stream"] for event in told(events, "stream_stale")} == {"ATTITUDE", "ATTITUDE_QUATERNION"}
    assert not told(monitor.advance(at_s(60)), "stream_stale")
    back = feed(monitor, sent(2, 10, begin_s=61))
    assert [len(told(back, name)) for name in ("stream_resumed", "compare_resumed")] == [2, 1]


@pytest.mark.slow
def test_deadline_of_a_slow_stream() -> None:
    """At 1 Hz a stream is silent after five of its own periods, not after 2 s."""
    monitor = Monitor()
    feed(monitor, sent(40, 1))  # the last at 39 s
    assert monitor.advance(at_s(43.9)) == []
    stale = told(monitor.advance(at_s(44.1)), "stream_stale")
    assert [event["boot_s"] for event in stale] == [BOOT_S + 39 + 5] * 2


def test_deadline_of_a_slow_stream_early_on() -> None:
    """A dozen messages at 1 Hz are enough to know that three seconds of silence are none."""
    monitor = Monitor()
    feed(monitor, sent(12, 1))
    assert monitor.advance(at_s(14.5)) == []


@pytest.mark.slow
def test_a_vehicle_that_falls_silent() -> None:
    """After a longer silence of everything the vehicle is lost, told once, and seen again with its next message."""
    monitor = Monitor()
    feed(monitor, sent(3, 10))
    gone = [event for second in range(4, 120) for event in monitor.advance(at_s(second))]
    (lost,) = told(gone, "vehicle_lost")
    assert lost["vehicle"] == [1, 1]
    assert utc_s(lost) > utc_s(told(gone, "stream_stale")[0])
    back = feed(monitor, sent(1, 10, begin_s=121))
    (seen,) = told(back, "vehicle_seen")
    assert back[0] == seen
    assert utc_s(seen) == pytest.approx(121, abs=1e-3)


@pytest.mark.slow
def test_deadline_on_a_link_that_others_keep_alive() -> None:
    """A vehicle that falls silent is told of when another's message passes its deadline, with the deadline's time."""
    monitor = Monitor()
    feed(monitor, sorted(sent(3, 10) + sent(3, 10, sysid=2), key=lambda record: record[0]))
    events = feed(monitor, sent(3, 10, begin_s=3, sysid=2))
    stale = told(events, "stream_stale")
    assert [event["vehicle"] for event in stale] == [[1, 1], [1, 1]]
    for event in stale:
        assert event["boot_s"] == pytest.approx(BOOT_S + 2.9 + 2)
        assert utc_s(event) == pytest.approx(2.9 + 2, abs=2e-3)


def test_time_that_passes_over_an_empty_monitor() -> None:
    """Before the first byte nothing can be late."""
    assert Monitor().advance(at_s(100)) == []


# --- nonsense --------------------------------------------------------------------------------------------------------

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("euler", "quaternion"),
    [
        ((NAN, 0.0, 0.0), None),
        ((0.0, INF, 0.0), None),
        ((0.0, 0.0, -INF), None),
        (None, (NAN, 0.0, 0.0, 0.0)),
        (None, (INF, 0.0, 0.0, 0.0)),
        (None, (0.0, 0.0, 0.0, 0.0)),
        (None, (3e38, 3e38, 3e38, 3e38)),
        (None, (0.49, 0.0, 0.0, 0.0)),
    ],
)
def test_invalid_attitudes(euler: Any, quaternion: Any) -> None:
    """What is no attitude (NaN, infinite, a norm far from one) is counted as invalid, compared with nothing, no alarm.

    Every third message: three of five would be an alarm of the stream.
    """
    events, entry = watched(
        sent(
            10,
            20,
            euler=lambda n: euler if euler and n % 3 == 2 else LEVEL,
            quaternion=lambda n: quaternion if quaternion and n % 3 == 2 else UPRIGHT,
        )
    )
    streams = entry["vehicles"][0]["streams"]
    assert {name: (stream["count"], stream["invalid"]) for name, stream in streams.items()} == {
        "ATTITUDE": (200, 66 if euler else 0),
        "ATTITUDE_QUATERNION": (200, 66 if quaternion else 0),
    }
    assert entry["verdict"] == "agree"
    assert entry["vehicles"][0]["checks"][0]["residual"]["max"] < 1e-4
    assert not [event for event in events if event["event"].startswith("alarm")]
    json.dumps(entry, allow_nan=False)


def test_nothing_but_invalid_attitudes() -> None:
    """A quaternion stream of zeros leaves nothing to compare: NO COMPARE, with the stream's name in the reason, and an
    alarm of its norm.
    """
    entry = watched(sent(10, 20, quaternion=(0.0, 0.0, 0.0, 0.0)))[1]
    check = entry["vehicles"][0]["checks"][0]
    assert (entry["verdict"], check["verdict"]) == ("alarm", "no_compare")
    assert {alarm["check"] for alarm in entry["vehicles"][0]["alarms"]} == {"quaternion_norm"}
    assert "ATTITUDE_QUATERNION" in check["reason"]
    assert check["pairs"] == 0
    assert not check["coverage"]


@pytest.mark.parametrize("rate", [NAN, INF, -INF, 3e38])
@pytest.mark.parametrize("shift", [0, 1])
def test_absurd_body_rates(rate: float, shift: int) -> None:
    """Body rates that no vehicle has disturb no attitude of the same instant and raise nothing between instants."""
    records = []
    for number in range(200):
        t_us, ms = at_s(number / 20), 10_000 + 50 * number
        records.append((t_us, wire.attitude(ms, LEVEL, (rate, 0, 0), seq=2 * number)))
        records.append((t_us, wire.attitude_quaternion(ms + 25 * shift, UPRIGHT, (0, rate, 0), seq=2 * number + 1)))
    events, entry = watched(records)
    check = entry["vehicles"][0]["checks"][0]
    assert check["verdict"] == ("no_compare" if shift else "agree")
    # Numbers, though absurd ones, are a matter of the rates' own check.
    told_of = {event["check"] for event in events if event["event"].startswith("alarm")}
    assert told_of <= (set() if not math.isfinite(rate) else {"kinematics"})
    json.dumps(entry, allow_nan=False)


def test_a_sender_without_body_rates() -> None:
    """Rates of zero beside an attitude that turns were not sent: without them nothing between two samples is judged."""
    motion = wire.Motion(62, speed_rad_s=1.5)
    records = []
    for number in range(300):
        ms = 200 * number
        frame = wire.attitude_quaternion(10_000 + ms, motion.wxyz(ms / 1000), seq=2 * number)
        records.append((at_s(ms / 1000), frame))
        if number % 2:  # 2.5 Hz against 5 Hz, never at one instant
            frame = wire.attitude(10_070 + ms, motion.rpy(ms / 1000 + 0.07), seq=2 * number + 1)
            records.append((at_s(ms / 1000 + 0.07), frame))
    vehicle = watched(records)[1]["vehicles"][0]
    assert vehicle["alarms"] == []
    assert vehicle["verdict"] == "no_compare"
    assert "body rates" in vehicle["checks"][0]["reason"]


def test_wide_angles_are_valid() -> None:
    """Angles beyond their nominal ranges, as with a trim, are the same rotation and are compared as one."""
    turned = Rotation.from_euler("ZYX", [370.0, 91.0, 181.5], degrees=True)
    rpy = tuple(np.radians([181.5, 91.0, 370.0]))
    entry = watched(sent(5, 20, euler=rpy, quaternion=wire.wxyz(turned)))[1]
    assert entry["vehicles"][0]["streams"]["ATTITUDE"]["invalid"] == 0
    assert entry["vehicles"][0]["checks"][0]["residual"]["max"] < 1e-4
    assert entry["verdict"] == "agree"


def test_an_unnormalised_quaternion_is_judged_by_its_direction() -> None:
    """A quaternion of norm 1.05 is the same rotation: the angle is judged on a normalised copy, `read` keeps it."""
    turned = wire.wxyz(Rotation.from_euler("ZYX", [40.0, 10.0, -20.0], degrees=True))
    rpy = tuple(np.radians([-20.0, 10.0, 40.0]))
    entry = watched(sent(5, 20, euler=rpy, quaternion=1.05 * turned))[1]
    assert entry["vehicles"][0]["streams"]["ATTITUDE_QUATERNION"]["invalid"] == 0
    assert entry["vehicles"][0]["checks"][0]["residual"]["max"] < 1e-4


# --- links -----------------------------------------------------------------------------------------------------------


def test_a_datagram_has_borders() -> None:
    """A frame cut off at a datagram's end takes nothing of the next with it; in a stream both pieces are one frame."""
    frame = wire.heartbeat(seq=1)
    datagrams = Monitor()
    datagrams.open_link(0, datagrams=True)
    stream = Monitor()
    for monitor in (datagrams, stream):
        monitor.feed(frame[:9], at_s(0))
        monitor.feed(frame[9:], at_s(0))
        monitor.feed(wire.heartbeat(seq=2) + wire.heartbeat(seq=3), at_s(1))
    lost, whole = (monitor.close().to_dict()["files"][0]["salvage"] for monitor in (datagrams, stream))
    assert (lost["frames"], lost["skipped_bytes"]) == (2, len(frame))
    assert (whole["frames"], whole["skipped_bytes"]) == (3, 0)


def test_a_damaged_datagram_waits_for_nothing() -> None:
    """A datagram whose length byte promises more than it holds is dirt, and the next one is heard at once."""
    monitor = Monitor()
    monitor.open_link(0, datagrams=True)
    assert monitor.feed(struct.pack("<BBB", 0xFD, 255, 0) + bytes(20), at_s(0)) == []
    assert [event["event"] for event in monitor.feed(wire.heartbeat(), at_s(0))] == ["vehicle_seen"]


@pytest.mark.slow
def test_two_links() -> None:
    """The same system on two links is two vehicles, each judged by what its own link brought."""
    monitor = Monitor()
    monitor.open_link(1, datagrams=True)
    good, bad = sent(3, 10), sent(3, 10, quaternion=YAWED_25)
    events: dict[int, list[Json]] = {0: [], 1: []}
    for (t_us, frame), (_, other) in zip(good, bad, strict=True):
        events[0] += monitor.feed(frame, t_us, link=0)
        events[1] += monitor.feed(other, t_us, link=1)
    assert not told(events[0], "alarm_raised")
    assert len(told(events[1], "alarm_raised")) == 1
    report = monitor.close().to_dict()
    verdicts = {entry["path"]: entry["verdict"] for entry in report["files"]}
    assert sorted(verdicts.values()) == ["agree", "alarm"]
    assert len(verdicts) == 2
    assert report["verdict"] == "alarm"


def test_a_link_is_opened_once() -> None:
    """Opening a link that is open already, or that has brought bytes, is a mistake of the caller."""
    monitor = Monitor()
    monitor.open_link(0)
    monitor.feed(b"", at_s(0), link=3)
    for link in (0, 3):
        with pytest.raises(ValueError, match=f"link {link}"):
            monitor.open_link(link, datagrams=True)


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_kind_of_bytes(kind: Any) -> None:
    """Bytes, bytearrays and views are all taken, and what the caller does with its buffer later changes nothing."""
    monitor = Monitor()
    data = wire.tlog(sent(3, 10))
    half = len(data) // 2
    first = bytearray(data[:half])
    monitor.feed_recording(kind(first))
    first[:] = bytes(half)
    monitor.feed_recording(kind(data[half:]))
    assert monitor.close().to_dict()["files"][0]["verdict"] == "agree"


def test_closing_twice() -> None:
    """Closing again tells the same again."""
    monitor = Monitor()
    monitor.feed_recording(wire.tlog(sent(5, 20, quaternion=with_a_fault)) + b"\xfd\x1c\x00")
    first = monitor.close().to_dict()
    assert monitor.close().to_dict() == first
    assert first["files"][0]["salvage"]["skipped_bytes"] == 3


def test_closing_without_data() -> None:
    """Without a byte there is nothing to judge, and no attitude was compared."""
    report = Monitor().close()
    assert report.to_dict()["files"] == []
    assert report.verdict == "no_compare"
    empty = Monitor()
    empty.feed_recording(b"")
    assert empty.close().exit_code() == 4


def test_nothing_but_noise() -> None:
    """From random bytes comes no vehicle and no event, and all of them are counted as skipped."""
    noise = np.random.default_rng(3).integers(0, 256, 200_000, dtype=np.uint8).tobytes()
    monitor = Monitor()
    assert monitor.feed(noise, at_s(0)) == []
    (entry,) = monitor.close().to_dict()["files"]
    assert entry["vehicles"] == []
    assert entry["salvage"]["skipped_bytes"] > 0.99 * len(noise)


def test_an_unknown_profile_or_dialect() -> None:
    """Both are refused when the monitor is made, with the name in the message."""
    with pytest.raises(UsageError, match="cii"):
        Monitor("cii")
    with pytest.raises(UsageError, match="nonsuch"):
        Monitor(dialect="nonsuch")
    with pytest.raises(UsageError, match="ATTITUDE"):
        Monitor(dialect="minimal")
