"""The two streams themselves: without numbers, frozen, silent, slow; each moment is worked by hand."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from tests.helpers import wire
from tests.helpers.craft import (
    BOOT_S,
    Change,
    Craft,
    State,
    alarms,
    between,
    check,
    judged,
    nothing,
    parameter,
    rpy,
    spinning,
    still,
    told,
    true,
    turned_in_world,
    watched,
)

MESSAGES = ("ATTITUDE", "ATTITUDE_QUATERNION")
TURNING = spinning(deg_s=5)  # 0.25° from sample to sample at 20 Hz


def falsified(message: str, change: Change, **given: Any) -> Craft:
    """A craft, one of whose attitudes is falsified."""
    return Craft(**{"turn": TURNING, "euler" if message == "ATTITUDE" else "quaternion": change, **given})


def as_at(at_s: float) -> Change:
    """The attitude of one moment, on and on."""
    return lambda t_s, state: State(*TURNING(at_s), state.force)


def thinned(kept: int) -> Change:
    """Of five samples, at 20 Hz, so many."""
    return lambda t_s, state: state if 3 * round(t_s * 20) % 5 < kept else None


# --- NaN and infinity ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [math.nan, math.inf])
@pytest.mark.parametrize("message", MESSAGES)
def test_no_numbers_for_three_seconds(message: str, number: float) -> None:
    """NaN or infinity from 4 to 7 s: an alarm of that stream at 5.1 s, cleared at 9.1 s."""

    def broken(t_s: float, state: State) -> Any:
        ms = round(1000 * (BOOT_S + t_s))
        if message == "ATTITUDE":
            roll, _, yaw = state.rotation.rpy_rad()
            return mavlink.MAVLink_attitude_message(ms, roll, number, yaw, *state.rates)
        w, x, _, z = state.rotation
        return mavlink.MAVLink_attitude_quaternion_message(ms, w, x, number, z, *state.rates)

    (alarm,) = alarms(judged(falsified(message, between(4, 7, broken)), 15))
    assert (alarm["check"], alarm["severity"]) == ("stream", "alarm")
    assert alarm["what"] == f"{message} carries NaN or infinity"
    assert alarm["is_not"] == "not the attitude itself: what does not come, or stands still, tells nothing of it"
    assert alarm["raised_boot_s"] == pytest.approx(4.1 + 1.0)
    assert alarm["cleared_boot_s"] == pytest.approx(7.1 + 2.0)
    assert alarm["unit"] != "s"  # it is no time


# --- frozen ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("message", MESSAGES)
def test_frozen_for_three_seconds(message: str) -> None:
    """The same numbers from 5 to 8 s while the other stream turns by 15°: an alarm at 7.0 s, cleared at 10.0 s."""
    vehicle = judged(falsified(message, between(5, 8, as_at(5))), 15)
    (alarm,) = alarms(vehicle, "stream")
    assert (alarm["severity"], alarm["unit"]) == ("alarm", "s")
    assert alarm["what"] == f"{message} is frozen: the same attitude on and on"
    assert alarm["raised_boot_s"] == pytest.approx(7.0)
    assert alarm["cleared_boot_s"] == pytest.approx(10.0)
    assert alarm["peak"] == pytest.approx(2.95)  # at 7.95 s, the last of them


def test_frozen_for_less_than_two_seconds() -> None:
    """The same numbers for 1.95 s are no frozen stream."""
    assert alarms(judged(falsified("ATTITUDE_QUATERNION", between(5, 7, as_at(5))), 15), "stream") == []


def test_frozen_while_the_other_hardly_moves() -> None:
    """While the other stream turns by less than 1° (0.3 °/s for 3 s) the same numbers are possible."""
    slow = spinning(deg_s=0.3)
    held: Change = lambda t_s, state: State(*slow(5), state.force)
    assert alarms(judged(Craft(turn=slow, quaternion=between(5, 8, held)), 15), "stream") == []


def test_both_at_rest() -> None:
    """Both streams with the same numbers for 20 s: a vehicle at rest, and not frozen."""
    vehicle = judged(Craft(turn=still(rpy(1, 2, 3))), 20)
    assert alarms(vehicle) == []
    assert check(vehicle, "stream")["verdict"] == "agree"


def test_at_rest_before_and_after_a_step_of_both() -> None:
    """Both streams step by 10° at one instant and stand still again: neither moved while the other was frozen."""
    step = between(5, 99, turned_in_world(0, 0, 10))
    assert alarms(judged(Craft(turn=still(), euler=step, quaternion=step), 15), "stream") == []


# --- silent ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("message", MESSAGES)
def test_silent_while_the_other_comes(message: str) -> None:
    """Last heard at 4.95 s: an alarm with the first message more than 2 s behind that; back at 9 s, cleared at 11 s."""
    events, vehicle = watched(falsified(message, between(5, 9, nothing)).records(15))
    (alarm,) = alarms(vehicle)
    assert (alarm["check"], alarm["severity"], alarm["unit"]) == ("stream", "alarm", "s")
    assert alarm["what"] == f"{message} stopped, while the vehicle is still heard"
    assert alarm["raised_boot_s"] == pytest.approx(7.0)  # at 6.95 s it is 2 s, and not more
    assert alarm["cleared_boot_s"] == pytest.approx(11.0)
    assert alarm["peak"] == pytest.approx(4.0, abs=0.06)  # at the last message before it came back
    (stale,) = told(events, "stream_stale")
    assert stale["stream"] == message
    assert stale["boot_s"] == pytest.approx(BOOT_S + 6.95)
    assert vehicle["verdict"] == check(vehicle, "stream")["verdict"] == "alarm"


def test_five_periods_of_a_slow_stream() -> None:
    """At 2 Hz five periods are 2.5 s, longer than 2 s: last heard at 19.5 s, an alarm behind 22.0 s."""
    vehicle = judged(falsified("ATTITUDE_QUATERNION", between(20, 24, nothing), hz=2, second_hz=1), 30)
    (alarm,) = alarms(vehicle)
    assert alarm["raised_boot_s"] == pytest.approx(19.5 + 2.5 + 0.5)  # with the next message
    assert alarm["cleared_boot_s"] == pytest.approx(24 + 2.0)


@pytest.mark.parametrize("seconds", [1.5, 1.9])
def test_a_pause_below_two_seconds(seconds: float) -> None:
    """A pause of less than 2 s is none."""
    assert alarms(judged(falsified("ATTITUDE_QUATERNION", between(5, 5 + seconds, nothing)), 15)) == []


def test_a_vehicle_that_starts_anew() -> None:
    """Silent for 3 s, and then in a new boot: its streams did not stop, it was not there."""
    first = Craft(turn=TURNING, boot_s=600.0, hz=10).records(10)
    second = [(t_us + 13_000_000, frame) for t_us, frame in Craft(turn=TURNING, boot_s=2.0, hz=10).records(10)]
    events, vehicle = watched(first + second)
    assert len(told(events, "reboot")) == 1
    assert vehicle["alarms"] == []


def test_a_vehicle_that_falls_silent_altogether() -> None:
    """Nothing of the vehicle comes for 10 s while another is heard: its streams go stale, and that is no alarm."""
    silent = Craft(turn=TURNING, euler=between(5, 15, nothing), quaternion=between(5, 15, nothing), beats=False)
    one = silent.records(25)
    other = Craft(turn=TURNING, sysid=2).records(25)
    events, vehicle = watched_first(sorted(one + other, key=lambda record: record[0]))
    assert {event["stream"] for event in told(events, "stream_stale") if event["vehicle"] == [1, 1]} == set(MESSAGES)
    assert alarms(vehicle) == []


def watched_first(records: list[tuple[int, bytes]]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Events, and the entry of the first of several vehicles."""
    from gcs_bridge import Monitor

    monitor = Monitor()
    events = monitor.feed_recording(wire.tlog(records))
    return events, monitor.close().to_dict()["files"][0]["vehicles"][0]


def test_both_stop_while_the_vehicle_is_heard() -> None:
    """Both attitudes stop for 15 s while heartbeats and RAW_IMU come, which tell no boot time: alarms after 2 s."""
    stopped = between(5, 20, nothing)
    vehicle = judged(Craft(turn=TURNING, euler=stopped, quaternion=stopped, imu=true), 26)
    assert {alarm["what"].split(" ")[0] for alarm in alarms(vehicle)} == set(MESSAGES)
    assert all(
        alarm["raised_utc"] == "2023-11-14T22:13:27.000Z" for alarm in alarms(vehicle)
    )  # 4.95 s, 2 s and a frame
    assert [alarm["raised_boot_s"] for alarm in alarms(vehicle)] == pytest.approx([7.0, 7.0])
    assert [alarm["cleared_boot_s"] for alarm in alarms(vehicle)] == pytest.approx([22, 22])


# --- slow ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("message", MESSAGES)
def test_two_fifths_of_the_usual_rate(message: str) -> None:
    """From 20 s on two fifths of 20 Hz: with the 5 s that end at 25 s it is a warning; back at 32 s, it goes."""
    (warning,) = alarms(judged(falsified(message, between(20, 32, thinned(2))), 50))
    assert (warning["check"], warning["severity"]) == ("stream", "warning")
    assert warning["what"] == f"{message} comes at less than half of its usual rate"
    assert warning["raised_boot_s"] == pytest.approx(25, abs=0.3)
    assert 32 < warning["cleared_boot_s"] <= 42  # 5 s windows, the first that lies behind 32 s, and two more seconds
    assert warning["unit"] != "s"  # it is no time


def test_more_than_half_of_the_usual_rate() -> None:
    """Three of five samples are more than half: nothing."""
    assert alarms(judged(falsified("ATTITUDE_QUATERNION", between(20, 32, thinned(3))), 45)) == []


def test_slow_while_parameters_are_sent() -> None:
    """While the vehicle sends its parameters, ten a second, its streams may be slow."""
    sent = [(20 + i / 10, parameter(f"P{i}", i)) for i in range(120)]
    assert alarms(judged(falsified("ATTITUDE_QUATERNION", between(20, 32, thinned(2)), also=sent), 50)) == []


def test_slow_from_the_beginning() -> None:
    """A stream that was never faster has no usual rate that it falls short of."""
    assert alarms(judged(falsified("ATTITUDE_QUATERNION", thinned(2)), 40)) == []
