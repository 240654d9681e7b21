"""Silence judged in its context: what is no fault of a stream, and beside each the fault that looks like it.

Recordings are made of `a_copter_square` by taking records out, or by hand; the times are those at which it was done.
"""

from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from functools import cache
from itertools import count, pairwise, product
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge import Monitor
from tests.helpers import wire
from tests.helpers.craft import (
    BOOT_S,
    Change,
    Craft,
    Json,
    Record,
    alarms,
    between,
    check,
    nothing,
    parameter,
    spinning,
    told,
    true,
)
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES, ROOT

CASES = ROOT / "tests" / "data" / "cases"
TURNING = spinning(deg_s=5)
S = 1_000_000


def varied(first: Any, *others: Any) -> list[Any]:
    """The first value every day, the others with the slow tests."""
    return [first, *(pytest.param(other, marks=pytest.mark.slow) for other in others)]


def heard(records: Iterable[Record], **how: Any) -> tuple[list[Json], list[Json]]:
    """Events, and the entries of the vehicles in the report."""
    monitor = Monitor(**how)
    events = monitor.feed_recording(wire.tlog(records)) + monitor.finish()
    (entry,) = monitor.close().to_dict()["files"]
    return events, entry["vehicles"]


def one(records: Iterable[Record], **how: Any) -> tuple[list[Json], Json]:
    """Events, and the only vehicle's entry."""
    events, (vehicle,) = heard(records, **how)
    return events, vehicle


def utc_s(event: Json) -> float:
    """When it was received, seconds after the recording's start."""
    return datetime.fromisoformat(event["utc"]).timestamp() - wire.START_US / 1e6


def craft(**given: Any) -> Craft:
    return Craft(**{"turn": TURNING, **given})


def stopped(begin_s: float, end_s: float, change: Change = nothing) -> dict[str, Any]:
    """Craft's arguments for both attitudes stopped, or changed otherwise, for a time."""
    changed = between(begin_s, end_s, change)
    return {"euler": changed, "quaternion": changed}


def thinned(nth: int, hz: float = 20.0) -> Change:
    """Every n-th sample alone."""
    return lambda t_s, state: state if round(t_s * hz) % nth == 0 else None


# --- transfers ---


def mission_item(i: int) -> Any:
    return mavlink.MAVLink_mission_item_int_message(255, 190, i, 3, 16, 0, 1, 0, 0, 0, 0, 0, 0, 50.0, 0)


def mission_request(i: int) -> Any:
    return mavlink.MAVLink_mission_request_int_message(255, 190, i, 0)


def file_piece(i: int) -> Any:
    return mavlink.MAVLink_file_transfer_protocol_message(0, 255, 190, [i % 256] * 251)


def log_data(i: int) -> Any:
    return mavlink.MAVLink_log_data_message(1, 90 * i, 90, [i % 256] * 90)


def parameter_number(i: int) -> Any:
    return parameter(f"P{i}", i)


def transfer(make: Any, begin_s: float, end_s: float, hz: float) -> list[tuple[float, Any]]:
    number = int((end_s - begin_s) * hz)
    return [(begin_s + i / hz, make(i)) for i in range(number)]


@pytest.mark.parametrize("make", varied(parameter_number, mission_item, mission_request, file_piece, log_data))
@pytest.mark.parametrize(("seconds", "hz"), one_in(2, [(11, 50), (5, 4), (40, 1), (25, 10)]))
def test_a_transfer_stops_the_streams(make: Any, seconds: float, hz: float) -> None:
    """No alarm: NO COMPARE from two seconds on until it is over."""
    end_s = 20 + seconds
    also = transfer(make, 20, end_s, hz)
    events, vehicle = one(craft(**stopped(20, end_s), also=also).records(end_s + 12))
    assert alarms(vehicle) == []
    assert [utc_s(event) for event in told(events, "no_compare")] == pytest.approx([21.95], abs=0.01)
    assert [utc_s(event) for event in told(events, "compare_resumed")] == pytest.approx([end_s], abs=0.1)


@pytest.mark.parametrize("begin", varied(0.3, 0.4))
def test_a_manoeuvre_while_nothing_comes_is_judged_by_no_rates(begin: float) -> None:
    """It flew on while no attitude came: its rates at both ends say nothing of that, and are no warning."""
    records = list(wire.records((FIXTURES / "g_mavlink1.tlog").read_bytes()))
    first_us, last_us = records[0][0], records[-1][0]
    begin_us, end_us = (first_us + share * (last_us - first_us) for share in (begin, 0.6))
    kept = [one for one in records if one[1][5] not in (30, 31) or not begin_us < one[0] < end_us]  # MAVLink 1's ids
    assert len(kept) < len(records)
    _, vehicle = one(kept)
    assert alarms(vehicle, "kinematics") == []


@pytest.mark.parametrize(("nth", "hz"), one_in(2, [(4, 10), (4, 2), (16, 1)]))
def test_a_transfer_slows_the_streams(nth: int, hz: float) -> None:
    """Four times slower while a mission is read, and sixteen times: no warning."""
    slowed = stopped(30, 60, thinned(nth))
    assert alarms(one(craft(**slowed, also=transfer(mission_request, 30, 60, hz)).records(80))[1]) == []


def test_what_stays_away_behind_a_transfer_is_a_fault() -> None:
    """The transfer ends at 25 s and the streams stay away until 35 s: an alarm at 27 s."""
    made = craft(**stopped(20, 35), also=transfer(parameter_number, 20, 25.01, 20), imu=true)
    _, vehicle = one(made.records(45))
    assert [alarm["raised_boot_s"] for alarm in alarms(vehicle)] == pytest.approx([27.0] * 2, abs=0.15)
    assert [alarm["cleared_boot_s"] for alarm in alarms(vehicle)] == pytest.approx([37.0] * 2, abs=0.1)


def test_what_stopped_before_a_transfer_is_not_excused_by_it() -> None:
    """The streams stop at 20 s, parameters come from 25 to 30 s, the streams at 40 s: one alarm, from 22 to 42 s."""
    made = craft(**stopped(20, 40), also=transfer(parameter_number, 25, 30, 20), imu=true)
    _, vehicle = one(made.records(50))
    assert [alarm["raised_boot_s"] for alarm in alarms(vehicle)] == pytest.approx([22.0] * 2, abs=0.1)
    assert [alarm["cleared_boot_s"] for alarm in alarms(vehicle)] == pytest.approx([42.0] * 2, abs=0.1)


@pytest.mark.parametrize("every_s", [2.0, 5.0])
def test_parameters_now_and_then_are_no_transfer(every_s: float) -> None:
    """One each few seconds, as vehicles tell of themselves: the silence is a fault."""
    also = [(every_s * i + 0.3, parameter("STAT_RUNTIME", i)) for i in range(round(50 / every_s))]
    _, vehicle = one(craft(**stopped(20, 35), also=also).records(50))
    assert [alarm["raised_boot_s"] for alarm in alarms(vehicle)] == pytest.approx([22.0] * 2, abs=1.1)


# --- heartbeats alone ---


def a_flight(cut_s: tuple[float, float], *, keep: Sequence[int] = (0,)) -> list[Record]:
    """A real flight in which only messages of the ids `keep` come of the vehicle for a time; records from 0 s on."""
    records = list(wire.records((FIXTURES / "a_copter_square.tlog").read_bytes()))
    start_us = records[0][0]
    return [
        (wire.START_US + t_us - start_us, frame)
        for t_us, frame in records
        if not cut_s[0] <= (t_us - start_us) / S < cut_s[1]
        or frame[5] != 1
        or int.from_bytes(frame[7:10], "little") in keep
    ]


@pytest.mark.parametrize(
    ("keep", "seconds"),
    one_in(4, [(keep, seconds) for keep in ((0,), (0, 27), (0, 24, 33, 74), (0, 2)) for seconds in (4, 9, 31)]),
)
def test_a_real_flight_whose_attitudes_stop(keep: Sequence[int], seconds: float) -> None:
    """Heartbeats go on, and RAW_IMU, positions or SYSTEM_TIME beside them: alarms after 2 s, until it is back."""
    events, vehicle = one(a_flight((60.0, 60.0 + seconds), keep=keep))
    raised, cleared = told(events, "alarm_raised"), told(events, "alarm_cleared")
    assert [event["check"] for event in raised] == ["stream"] * 2
    assert all(61.9 < utc_s(event) < 63.2 for event in raised)  # the last ones came at 59.98 s
    assert [utc_s(event) for event in cleared] == pytest.approx([60 + seconds + 2.0] * 2, abs=0.1)
    assert check(vehicle, "stream")["verdict"] == vehicle["verdict"] == "alarm"
    assert len(vehicle["boots"]) == 1


@pytest.mark.parametrize("hz", one_in(3, [1, 4, 25, 50]))
@pytest.mark.parametrize("seconds", varied(9, 60))
def test_heartbeats_alone(hz: float, seconds: float) -> None:
    """Whatever the rate was: five of its periods, two seconds at the least, and the next heartbeat."""
    made = craft(**stopped(40, 40 + seconds), hz=hz, second_hz=1)
    _, vehicle = one(made.records(60 + seconds))
    deadline_s = max(5 / hz, 2.0) + 40 - 1 / hz
    assert len(alarms(vehicle)) == 2
    for alarm in alarms(vehicle):
        assert deadline_s < alarm["raised_boot_s"] <= deadline_s + 1.1
        assert alarm["cleared_boot_s"] == pytest.approx(40 + seconds + 2, abs=1.1)


@pytest.mark.parametrize("seconds", [1.5, 1.9])
def test_heartbeats_alone_for_less_than_two_seconds(seconds: float) -> None:
    """No alarm."""
    assert alarms(one(craft(**stopped(40, 40 + seconds)).records(60))[1]) == []


# --- a receiver that is suspended ---


def paused(records: Iterable[Record], at_s: float, pause_s: float) -> list[Record]:
    """The receiver's clock jumps, and nothing else does."""
    return [(t_us + round(pause_s * S) * (t_us >= wire.START_US + at_s * S), frame) for t_us, frame in records]


@cache
def flown_by(*sysids: int, seconds: float = 40) -> tuple[Record, ...]:
    """Several vehicles on one link, each a little behind the one before."""
    several = [
        (t_us + 7000 * i, frame)
        for i, sysid in enumerate(sysids)
        for t_us, frame in craft(sysid=sysid, boot_s=BOOT_S + 100 * i, imu=true).records(seconds)
    ]
    return tuple(sorted(several, key=lambda record: record[0]))


@pytest.mark.parametrize("pause_s", varied(10, 3, 60, 600))
@pytest.mark.parametrize("sysids", varied((1,), (1, 2, 3)))
@pytest.mark.parametrize("at_s", one_in(3, [20.0, 20.012, 20.032]))
def test_a_receiver_that_is_suspended(pause_s: float, sysids: Sequence[int], at_s: float) -> None:
    """No alarm, no stale stream, no lost vehicle; that the receiver paused is told once, and in the report."""
    events, vehicles = heard(paused(flown_by(*sysids), at_s, pause_s))
    (pause,) = told(events, "receiver_paused")
    assert (pause["vehicle"], pause["pause_s"]) == (None, pytest.approx(pause_s, abs=0.1))
    assert {event["event"] for event in events} == {"vehicle_seen", "stream_started", "receiver_paused"}
    for vehicle in vehicles:
        assert vehicle["verdict"] == "agree"
        assert "the receiver paused once" in check(vehicle, "stream")["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("pause_s", one_in(3, [3, 10, 600]))
def test_a_receiver_that_is_suspended_while_it_listens(pause_s: float) -> None:
    """The same as datagrams of a live link, while nobody could say that time passed."""
    monitor = Monitor()
    monitor.open_link(0, datagrams=True)
    events: list[Json] = []
    for t_us, frame in paused(flown_by(1, 2, seconds=10), 5.0, pause_s):
        events += monitor.feed(frame, t_us)
    assert {event["event"] for event in events} == {"vehicle_seen", "stream_started", "receiver_paused"}
    assert len(told(events, "receiver_paused")) == 1
    assert monitor.close().to_dict()["verdict"] == "agree"


@pytest.mark.slow
@pytest.mark.parametrize("pause_s", [3, 10, 60])
def test_what_waited_while_the_receiver_slept_comes_at_once(pause_s: float) -> None:
    """All of the time in which it slept arrives with one receive time: a pause, told once, and no alarm."""
    begin_us, end_us = (wire.START_US + round(at_s * S) for at_s in (10, 10 + pause_s))
    made = flown_by(1, 2, seconds=20 + pause_s)
    late = [(end_us if begin_us <= t_us < end_us else t_us, frame) for t_us, frame in made]
    events, vehicles = heard(late)
    assert {event["event"] for event in events} == {"vehicle_seen", "stream_started", "receiver_paused"}
    assert len(told(events, "receiver_paused")) == 1
    assert all(vehicle["verdict"] == "agree" for vehicle in vehicles)


@pytest.mark.slow
def test_three_pauses_are_told_three_times() -> None:
    """Each once, whoever is on the link."""
    records: Iterable[Record] = flown_by(1, 2)
    for at_s in (10, 25, 38):  # of the time that the receiver shows by then
        records = paused(records, at_s, 5)
    events, vehicles = heard(records)
    assert [event["pause_s"] for event in told(events, "receiver_paused")] == pytest.approx([5, 5, 5], abs=0.1)
    assert all("paused 3 times, 15.0 s in all" in check(vehicle, "stream")["reason"] for vehicle in vehicles)


def test_a_link_that_was_silent_is_no_pause() -> None:
    """Nothing comes for ten seconds, and the vehicle's clock went on as long: stale, lost, seen again, and no alarm."""
    records = [record for record in flown_by(1) if not 20 <= (record[0] - wire.START_US) / S < 30]
    events, vehicle = one(records)
    assert told(events, "receiver_paused") == alarms(vehicle) == []
    assert len(told(events, "stream_stale")) == len(told(events, "stream_resumed")) == 2
    assert [utc_s(event) for event in told(events, "vehicle_lost")] == pytest.approx([24.95], abs=0.01)
    assert len(told(events, "vehicle_seen")) == 2


@pytest.mark.slow
def test_time_that_is_known_to_pass_is_a_silence_at_once() -> None:
    """On a live link, asked each quarter of a second: stale after two seconds, lost after five."""
    monitor = Monitor()
    for t_us, frame in flown_by(1)[:1000]:
        monitor.feed(frame, t_us)
    last_us = t_us
    events = [event for i in range(1, 41) for event in monitor.advance(last_us + i * S // 4)]
    stale, lost = told(events, "stream_stale"), told(events, "vehicle_lost")
    assert [utc_s(event) - (last_us - wire.START_US) / S for event in stale] == pytest.approx([2, 2], abs=0.06)
    assert [utc_s(event) - (last_us - wire.START_US) / S for event in lost] == pytest.approx([5], abs=0.01)


# --- restarts ---


def sender(sysid: int = 1, first: int = 0) -> Any:
    """A counter of one vehicle's frames, and how each becomes bytes."""
    numbers = count(first)
    return lambda message: wire.pack(message, seq=next(numbers), sysid=sysid)


def system_time(ms: int) -> Any:
    return mavlink.MAVLink_system_time_message(0, ms)


def imu(ms: int) -> Any:
    return mavlink.MAVLink_raw_imu_message(1000 * ms, 0, 0, -1000, 0, 0, 0, 400, 0, 0)


def position(ms: int) -> Any:
    return mavlink.MAVLink_global_position_int_message(ms, 0, 0, 0, 0, 0, 0, 0, 0)


def pressure(ms: int) -> Any:
    return mavlink.MAVLink_scaled_pressure_message(ms, 1013.0, 0.0, 2000)


def heartbeat(state: int = 4) -> Any:
    """Of MAV_STATE 1 is BOOT, 4 ACTIVE."""
    return mavlink.MAVLink_heartbeat_message(wire.QUADROTOR, wire.ARDUPILOT, 81, 0, state, 3)


def restarted(
    others: Sequence[Any], silent_s: float, seconds: float = 30.0, hz: float = 4.0, *, first: int = 0, state: int = 4
) -> list[Record]:
    """Thirty seconds of flight with these messages, and then a new start that sends them and heartbeats alone.

    `first`: the number of its first frame that was heard; `state` what its heartbeats say.
    """
    also = [(i / hz, make(round(1000 * (BOOT_S + i / hz)))) for i in range(round(30 * hz)) for make in others]
    records = craft(also=also).records(30)
    send, begin_us = sender(first=first), wire.START_US + round((30 + silent_s) * S)
    for i in range(round(seconds * hz)):
        ms = 1500 + round(1000 * i / hz)
        said = [*([heartbeat(state)] if i % round(hz) == 0 else []), *(make(ms) for make in others)]
        records += [(begin_us + round(i / hz * S), send(message)) for message in said]
    return records


@pytest.mark.parametrize(
    "others",
    one_in(2, [[system_time], [imu], [position], [pressure, position], [imu, system_time]]),
    ids=lambda made: "+".join(one.__name__ for one in made),
)
@pytest.mark.parametrize("silent_s", one_in(9, [2, 0.5, 6, 20]))
def test_a_restart_that_other_messages_show(others: Sequence[Any], silent_s: float) -> None:
    """The boot is over, the new one is in the report, and its streams did not stop: they never began."""
    events, vehicle = one(restarted(others, silent_s))
    (reboot,) = told(events, "reboot")
    assert utc_s(reboot) == pytest.approx(30 + silent_s, abs=2.1)
    assert [boot["index"] for boot in vehicle["boots"]] == [0, 1]
    assert vehicle["boots"][0]["last_boot_s"] == pytest.approx(BOOT_S + 30, abs=0.3)
    assert vehicle["boots"][1]["last_boot_s"] == pytest.approx(1.5 + 30, abs=0.3)
    assert alarms(vehicle) == []


@pytest.mark.parametrize("silent_s", [2, 6, 20])
def test_a_restart_that_the_sequence_alone_shows(silent_s: float) -> None:
    """Heartbeats alone, whose numbers begin anew: ten seconds later it is a restart, whose time is not known."""
    events, vehicle = one(restarted([], silent_s))
    (reboot,) = told(events, "reboot")
    assert (reboot["boot"], reboot["boot_s"], reboot["step_s"]) == (1, None, None)
    assert [boot["first_boot_s"] for boot in vehicle["boots"]] == [BOOT_S, None]
    assert alarms(vehicle) == []


@pytest.mark.parametrize("booting_s", one_in(2, [0, 5, 9, 15]))
@pytest.mark.parametrize("first", one_in(3, [0, 3, 25]))
def test_a_restart_after_which_heartbeats_come_first(booting_s: float, first: int) -> None:
    """The attitudes follow when it has booted, some of its first frames were lost: one restart, and no alarm."""
    records = restarted([], 3, booting_s, first=first)
    begin_us = 33 * S + round(booting_s * S)
    after = craft(boot_s=3.0 + booting_s).records(20)
    events, vehicle = one([*records, *((t_us + begin_us, frame) for t_us, frame in after)])
    assert len(told(events, "reboot")) == 1
    assert len(vehicle["boots"]) == 2
    assert alarms(vehicle) == []


@pytest.mark.parametrize("booting_s", [3, 5, 15])
@pytest.mark.parametrize("silent_s", one_in(3, [0.3, 2, 4]))
def test_a_restart_that_heartbeats_tell(silent_s: float, booting_s: float) -> None:
    """They say that it boots, whatever the numbers do: no alarm until it has, and one restart."""
    records = restarted([], silent_s, booting_s, first=100, state=1)
    begin_us = round((30 + silent_s + booting_s) * S)
    after = craft(boot_s=3.0 + booting_s).records(20)
    events, vehicle = one([*records, *((t_us + begin_us, frame) for t_us, frame in after)])
    assert len(told(events, "reboot")) == 1
    assert alarms(vehicle) == []


def test_numbers_that_go_on_are_no_restart() -> None:
    """A silence of four seconds, and heartbeats alone whose numbers go on behind it: a fault of the streams."""
    records = restarted([], 4, 20, first=100)
    _, vehicle = one(records)
    assert [alarm["raised_boot_s"] for alarm in alarms(vehicle)] == pytest.approx([32.0] * 2, abs=1.1)
    assert len(vehicle["boots"]) == 1


def test_a_lost_stretch_of_frames_is_no_restart() -> None:
    """Frames are missing for three seconds and the next number is 2, as it may be: the time and the boot go on."""
    records = [record for record in flown_by(1) if not 20 <= (record[0] - wire.START_US) / S < 23]
    first = next(i for i, (t_us, _) in enumerate(records) if t_us >= wire.START_US + 23 * S)
    send = sender()
    send(heartbeat()), send(heartbeat())
    parser = mavlink.MAVLink(None)
    renumbered = [(t_us, send(parser.parse_buffer(frame)[0])) for t_us, frame in records[first:]]
    events, vehicle = one([*records[:first], *renumbered])
    assert told(events, "reboot") == []
    assert len(vehicle["boots"]) == 1


# --- two boots at once ---


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pattern", "older_s"),
    one_in(
        4,
        product(["ab", "aab", "abb", "aaaabbb", "aababbbaab", "a" * 40 + "b" * 40], [600.0, 90.0, 5000.0]),
    ),
)
def test_backlogs_of_two_boots_are_two_boots(pattern: str, older_s: float) -> None:
    """What was kept of the boot before comes between what is new: one restart."""
    of = {"a": craft(boot_s=older_s, beats=False).records(60), "b": craft(boot_s=4.0, beats=False).records(60)}
    left = {name: iter(records) for name, records in of.items()}
    mixed = [frame for _, frame in craft(boot_s=older_s - 5, beats=True).records(5)]
    for name in pattern * (2400 // len(pattern)):
        mixed += [frame for _, frame in [next(left[name], (0, b""))] if frame]
    mixed += [frame for _, frame in craft(boot_s=70.0).records(5)]
    records = [(wire.START_US + 10_000 * i, frame) for i, frame in enumerate(mixed)]
    events, vehicle = one(records)
    assert len(told(events, "reboot")) == 1
    assert [boot["index"] for boot in vehicle["boots"]] == [0, 1]
    assert vehicle["boots"][0]["first_boot_s"] == older_s - 5
    assert vehicle["boots"][1]["last_boot_s"] == pytest.approx(75.0, abs=0.1)


# --- rates that were asked for ---


def asked(how: str, rate_hz: float, by: tuple[int, int] = (255, 190)) -> list[bytes]:
    """The frames of a station's request."""
    if how == "REQUEST_DATA_STREAM":
        messages: list[Any] = [mavlink.MAVLink_request_data_stream_message(1, 1, 10, round(rate_hz), 1)]
    elif how == "ALL":
        messages = [mavlink.MAVLink_request_data_stream_message(1, 0, 0, round(rate_hz), 1)]
    elif how == "COMMAND_LONG":
        messages = [
            mavlink.MAVLink_command_long_message(1, 1, 511, 0, message, round(1e6 / rate_hz), 0, 0, 0, 0, 0)
            for message in (30, 31)
        ]
    elif how == "COMMAND_INT":
        messages = [
            mavlink.MAVLink_command_int_message(1, 1, 0, 511, 0, 0, message, round(1e6 / rate_hz), 0, 0, 0, 0, 0)
            for message in (30, 31)
        ]
    else:
        messages = [mavlink.MAVLink_param_set_message(1, 1, how.encode(), rate_hz, 9)]
    return [wire.pack(message, sysid=by[0], compid=by[1]) for message in messages]


WAYS = ("REQUEST_DATA_STREAM", "ALL", "COMMAND_LONG", "COMMAND_INT", "SR0_EXTRA1", "MAV1_EXTRA1")


def at_rates(*rates: tuple[float, float], seconds: float = 120) -> list[Record]:
    """A vehicle that sends its attitudes at each rate, Hz, from a time on; at 20 Hz before."""

    def told_at(t_s: float, state: Any) -> Any:
        hz = [20.0, *(hz for since_s, hz in rates if t_s >= since_s)][-1]
        return state if round(t_s * 20) % round(20 / hz) == 0 else None

    return craft(euler=told_at, quaternion=told_at).records(seconds)


def with_frames(records: list[Record], *more: tuple[float, list[bytes]]) -> list[Record]:
    added = [(wire.START_US + round(at_s * S), frame) for at_s, frames in more for frame in frames]
    return sorted([*records, *added], key=lambda record: record[0])


@pytest.mark.parametrize("how", varied(*WAYS))
@pytest.mark.parametrize("rate_hz", one_in(5, [4, 10, 5, 2, 1]))
def test_a_rate_that_was_asked_for(how: str, rate_hz: float) -> None:
    """No warning, and who asked, how, for what."""
    records = with_frames(at_rates((60.7, rate_hz)), (60.0, asked(how, rate_hz)))
    for given in ({}, {"sysid": 1}):
        events, vehicle = one(records, **given)
        assert alarms(vehicle) == []
        requests = told(events, "rate_requested")
        assert {name for event in requests for name in event["streams"]} == {"ATTITUDE", "ATTITUDE_QUATERNION"}
        for event in requests:
            assert (event["by"], event["instead_of"]) == ([255, 190], None)
            assert event["rate_hz"] == pytest.approx(rate_hz, rel=1e-3)
            assert "255,190" in event["reason"]


def test_a_rate_that_is_told_by_a_parameter_alone() -> None:
    """Somebody whose frames are not on this link has set it: it is told first as 20 and then as 4."""
    also = [(5.0, parameter("SR1_EXTRA1", 20)), (60.0, parameter("SR1_EXTRA1", 4)), (90.0, parameter("SR1_EXTRA1", 4))]
    told_at = between(60.7, 120, thinned(5))
    events, vehicle = one(craft(euler=told_at, quaternion=told_at, also=also).records(120))
    assert alarms(vehicle) == []
    (event,) = told(events, "rate_requested")
    assert (event["by"], event["how"], event["rate_hz"]) == (None, "SR1_EXTRA1", 4)


@pytest.mark.slow
@pytest.mark.parametrize("how", one_in(2, WAYS))
def test_a_higher_rate_and_back(how: str) -> None:
    """From 5 to 20 Hz and back to 5, each asked for: nothing; back to 5 without a word: a warning."""
    records = with_frames(at_rates((0, 5), (60, 20), (120, 5), seconds=180), (59.9, asked(how, 20)))
    (first, *_) = alarms(one(records)[1])
    assert first["severity"] == "warning"
    assert first["raised_boot_s"] == pytest.approx(125, abs=5.1)
    assert alarms(one(with_frames(records, (119.9, asked(how, 5))))[1]) == []


@pytest.mark.parametrize("how", varied(*WAYS))
def test_slower_than_was_asked_for_is_slow(how: str) -> None:
    """Ten a second were asked for, and four come: a warning with the first five seconds."""
    _, vehicle = one(with_frames(at_rates((60.7, 4)), (60.0, asked(how, 10))))
    assert [alarm["severity"] for alarm in alarms(vehicle)] == ["warning"] * 2
    assert all(65 <= alarm["raised_boot_s"] <= 71 for alarm in alarms(vehicle))


@pytest.mark.parametrize(
    "request_",
    one_in(
        2,
        [
            wire.pack(mavlink.MAVLink_request_data_stream_message(1, 1, 2, 4, 1), sysid=255),  # another stream
            wire.pack(mavlink.MAVLink_request_data_stream_message(2, 1, 10, 4, 1), sysid=255),  # of another vehicle
            wire.pack(mavlink.MAVLink_command_long_message(1, 1, 511, 0, 33, 250_000, 0, 0, 0, 0, 0), sysid=255),
            wire.pack(mavlink.MAVLink_command_long_message(1, 1, 512, 0, 30, 0, 0, 0, 0, 0, 0), sysid=255),
            wire.pack(mavlink.MAVLink_param_set_message(1, 1, b"SR0_POSITION", 4, 9), sysid=255),
        ],
        swept=False,
    ),
)
def test_what_nobody_asked_for_is_slow(request_: bytes) -> None:
    """A request for something else excuses nothing."""
    events, vehicle = one(with_frames(at_rates((60.7, 4)), (60.0, [request_])))
    assert told(events, "rate_requested") == []
    assert [alarm["severity"] for alarm in alarms(vehicle)] == ["warning"] * 2


def test_a_request_that_is_said_again_excuses_nothing() -> None:
    """Each ten seconds a station says that it wants 20 Hz; the rate falls by itself: a warning."""
    again = [(10.0 * i, asked("REQUEST_DATA_STREAM", 20)) for i in range(1, 12)]
    events, vehicle = one(with_frames(at_rates((60.7, 4)), *again))
    assert len(told(events, "rate_requested")) == 1
    assert [alarm["severity"] for alarm in alarms(vehicle)] == ["warning"] * 2


@pytest.mark.parametrize("how", ["REQUEST_DATA_STREAM", "COMMAND_LONG"])
def test_two_stations_that_undo_each_other_are_named(how: str) -> None:
    """One wants 4 Hz, the other 10, in turn: no warning, both named, in the report too."""
    turns = [(20.0 * i, 4 if i % 2 else 10, (255, 190) if i % 2 else (254, 230)) for i in range(1, 6)]
    records = at_rates(*((at_s + 0.3, hz) for at_s, hz, _ in turns))
    events, vehicle = one(with_frames(records, *((at_s, asked(how, hz, by)) for at_s, hz, by in turns)))
    assert alarms(vehicle) == []
    requests = [event for event in told(events, "rate_requested") if "ATTITUDE" in event["streams"]]
    assert [event["instead_of"] for event in requests] == [None, [255, 190], [254, 230], [255, 190], [254, 230]]
    assert [event["undo_each_other"] for event in requests] == [False, False, True, True, True]
    assert "254,230 and 255,190 undo each other's rates" in check(vehicle, "stream")["reason"]


# --- radios that run out of buffer ---

LOW_S, FULL_S = 30, 60  # a buffer is nearly full from one time to the other


def free_at(second: int, low: int) -> int:
    """How much of the buffer is free, per cent."""
    return low if LOW_S <= second < FULL_S else 100


def radio(
    seconds: int, low: int, message: Any = mavlink.MAVLink_radio_status_message
) -> list[tuple[float, list[bytes]]]:
    """What a SiK radio says each second."""
    said = [message(190, 190, free_at(s, low), 40, 40, 0, 0) for s in range(seconds)]
    return [(s + 0.5, [wire.pack(one, seq=s, sysid=51, compid=68)]) for s, one in enumerate(said)]


def slowed_by(low: int, seconds: int, hz: float = 20.0) -> Change:
    """As GCS_MAVLINK::handle_radio_status of ArduPilot lengthens the intervals, from 0.1 s on."""
    slower_ms, due_ms, ticks = 0, 0.0, set()
    for tick in range(round(seconds * hz)):
        ms = round(1000 * tick / hz)
        if ms % 1000 == 500:
            free = free_at(ms // 1000, low)
            if free < 50 and slower_ms < 2000:
                slower_ms += 60 if free < 20 else 20
            elif free > 95 and slower_ms > 200:
                slower_ms -= 40
            elif free > 90:
                slower_ms = max(slower_ms - 20, 0)
        if ms >= due_ms:
            ticks.add(tick)
            due_ms = ms + 100 + slower_ms
    return lambda t_s, state: state if round(t_s * hz) in ticks else None


@pytest.mark.parametrize("low", varied(10, 40))
@pytest.mark.parametrize("message", varied(mavlink.MAVLink_radio_status_message, mavlink.MAVLink_radio_message))
def test_a_radio_that_runs_out_of_buffer_slows_the_streams(low: int, message: Any) -> None:
    """Up to 1.9 s a message: no warning, and why; without what the radio says, one of each stream."""
    told_at = slowed_by(low, 160)
    records = craft(euler=told_at, quaternion=told_at).records(160)
    assert [alarm["severity"] for alarm in alarms(one(records)[1])] == ["warning"] * 2
    for given in ({}, {"sysid": 1}):
        _, vehicle = one(with_frames(records, *radio(160, low, message)), **given)
        assert alarms(vehicle) == []
        assert "a radio, 51,68, ran out of buffer" in check(vehicle, "stream")["reason"]


def test_a_stream_that_stops_while_a_radio_slows_it() -> None:
    """At 50 s messages come 1.3 s apart, and may 1.2 s longer: it is silent after five times the one and the other."""
    told_at = slowed_by(10, 70)
    stops = between(50, 70, nothing, told_at)
    made = craft(euler=told_at, quaternion=stops).records(70)
    (alarm,) = alarms(one(with_frames(made, *radio(70, 10)))[1])
    assert alarm["what"] == "ATTITUDE_QUATERNION stopped, while the vehicle is still heard"
    assert 52 <= alarm["raised_boot_s"] <= 58.5


@pytest.mark.parametrize("low", varied(100, 60))
def test_a_radio_with_room_in_its_buffer_excuses_nothing(low: int) -> None:
    """The streams come at a fifth of their rate by themselves."""
    _, vehicle = one(with_frames(at_rates((60.7, 4)), *radio(120, low)))
    assert [alarm["severity"] for alarm in alarms(vehicle)] == ["warning"] * 2
    assert "radio" not in check(vehicle, "stream")["reason"]


# --- clocks that stand still ---


def with_stuck_clock(records: Iterable[Record], stuck_ms: int, from_s: float = 0.0, to_s: float = 1e9) -> list[Record]:
    """The same with one and the same time_boot_ms, where a payload begins with it, for a time."""
    stamp, stuck = stuck_ms.to_bytes(4, "little"), []
    for t_us, frame in records:
        message = mavlink.mavlink_map[int.from_bytes(frame[7:10], "little")]
        if message.ordered_fieldnames[0] == "time_boot_ms" and from_s <= (t_us - wire.START_US) / S < to_s:
            frame = wire.with_checksum(frame[:10] + stamp + frame[14:], message.crc_extra)
        stuck.append((t_us, frame))
    return stuck


@pytest.mark.parametrize("stuck_ms", varied(0, 1, 77_000, 4_000_000_000))
@pytest.mark.parametrize("hz", one_in(3, [20, 5, 50]))
@pytest.mark.parametrize("also_imu", [False, True])
def test_a_clock_that_stands_still(stuck_ms: int, hz: float, also_imu: bool) -> None:
    """Nothing can be compared, and that is said; the rate is told by receipt."""
    made = craft(hz=hz, second_hz=1, imu=true if also_imu else None, second=true if also_imu else None)
    events, vehicle = one(with_stuck_clock(made.records(60), stuck_ms))
    assert vehicle["verdict"] == "no_compare"
    assert alarms(vehicle) == []
    entry = check(vehicle, "euler_quaternion")
    assert (entry["verdict"], entry["reason"][:22]) == ("no_compare", "the clock stands still")
    assert "the clock stands still" in check(vehicle, "stream")["reason"]
    for name in ("ATTITUDE", "ATTITUDE_QUATERNION"):
        assert vehicle["streams"][name]["rate_hz"] == pytest.approx(hz, rel=0.02)
    (no_compare,) = told(events, "no_compare")
    assert "the clock stands still" in no_compare["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("stuck_ms", one_in(2, [0, 77_000]))
def test_a_clock_that_stands_still_and_is_told_without_receive_times(stuck_ms: int) -> None:
    """Raw bytes: nothing tells how often they came."""
    monitor = Monitor()
    for _, frame in with_stuck_clock(craft().records(20), stuck_ms):
        monitor.feed(frame, -1)
    ((vehicle,),) = [entry["vehicles"] for entry in monitor.close().to_dict()["files"]]
    assert check(vehicle, "euler_quaternion")["reason"].startswith("the clock stands still")
    assert {stream["rate_hz"] for stream in vehicle["streams"].values()} == {None}


@pytest.mark.parametrize("boot_s", [BOOT_S, 500.0])
def test_one_stream_whose_times_stand_still(boot_s: float) -> None:
    """ATTITUDE_QUATERNION with the time 0 beside an ATTITUDE that goes on: it came, and its times are of no use."""
    of_quaternion = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
    stuck = [
        with_stuck_clock([record], 0)[0] if int.from_bytes(record[1][7:10], "little") == of_quaternion else record
        for record in craft(boot_s=boot_s).records(30)
    ]
    events, vehicle = one(stuck)
    assert told(events, "reboot") == []
    entry = check(vehicle, "euler_quaternion")
    assert entry["verdict"] == "no_compare"
    assert "the times of ATTITUDE_QUATERNION do not go on" in entry["reason"]


def test_a_clock_that_stands_still_for_a_time() -> None:
    """From 20 to 40 s: nothing is compared then, and all is well before and behind it."""
    records = with_stuck_clock(craft().records(60), 29_950, 20, 40)
    events, vehicle = one(records)
    assert alarms(vehicle) == []
    assert [utc_s(event) for event in told(events, "no_compare")] == pytest.approx([22.0], abs=0.1)
    assert [utc_s(event) for event in told(events, "compare_resumed")] == pytest.approx([40.0], abs=0.1)
    assert check(vehicle, "euler_quaternion")["pairs"] == pytest.approx(20 * 20 + 20 * 20, abs=2)


# --- however it comes ---


STOPS = stopped(10, 16)
TURNS = [(3.0 * i, 4 if i % 2 else 10, (255, 190) if i % 2 else (254, 230)) for i in range(1, 6)]


def two_backlogs() -> list[Record]:
    """Of two boots, frame by frame."""
    older, newer = (craft(boot_s=boot_s).records(10) for boot_s in (300.0, 4.0))
    mixed = [one for pair in zip(older, newer, strict=True) for one in pair]
    return [(wire.START_US + 10_000 * i, frame) for i, (_, frame) in enumerate(mixed)]


STORIES: dict[str, Callable[[], list[Record]]] = {  # of each kind one, short
    "transfer": lambda: craft(**STOPS, also=transfer(file_piece, 10, 14, 8)).records(20),
    "heartbeats": lambda: craft(**STOPS).records(20),
    "pause": lambda: paused(flown_by(1, 2), 20.032, 10)[:2600],
    "restart": lambda: restarted([imu, position], 3, 8),
    "sequence": lambda: restarted([], 3, 15),
    "requests": lambda: with_frames(
        at_rates((12.0, 5.0), seconds=20), *((at_s, asked("ALL", hz, by)) for at_s, hz, by in TURNS)
    ),
    "standing": lambda: with_stuck_clock(craft().records(14), 15_000, 5, 9),
    "backlogs": two_backlogs,
}


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("story", STORIES)
def test_the_cut_into_pieces_changes_nothing(story: str) -> None:
    """Whole, in pieces of some hundred bytes, and frame by frame: the same events, the same report."""
    records = STORIES[story]()
    data, told_of = wire.tlog(records), []
    by_frame = np.cumsum([8 + len(frame) for _, frame in records]).tolist()
    for ends in ([0, len(data)], [*range(0, len(data), 997), len(data)], [0, *by_frame]):
        monitor, events = Monitor(), []
        for begin, end in pairwise(ends):
            events += monitor.feed_recording(data[begin:end])
        events += monitor.finish()
        told_of.append((events, monitor.close().to_dict()))
    assert told_of[0] == told_of[1] == told_of[2]


# --- the small recordings ---


def test_rate_request() -> None:
    """A ground station asks for 4 Hz instead of 10."""
    events, vehicle = one(wire.records((CASES / "rate_request.tlog").read_bytes()))
    assert alarms(vehicle) == []
    (request,) = told(events, "rate_requested")
    assert (request["by"], request["rate_hz"], request["how"]) == ([255, 190], 4.0, "REQUEST_DATA_STREAM")


def test_boot_time_zero() -> None:
    """Every time_boot_ms is 0, twenty a second."""
    _, vehicle = one(wire.records((CASES / "boot_time_zero.tlog").read_bytes()))
    assert vehicle["verdict"] == "no_compare"
    assert [stream["rate_hz"] for stream in vehicle["streams"].values()] == pytest.approx([20.0] * 2, rel=0.01)
