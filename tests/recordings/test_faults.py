"""Faults put into recordings of real autopilots: each raises its alarm, in time, and what is no fault raises none."""

import json
import math
import random
import struct
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge import Monitor
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES as SITL
from tests.helpers.wire import records

HEALTHY = sorted(  # what the firmware differs in on purpose included
    path.name.removesuffix(".facts.json")
    for path in SITL.glob("*.facts.json")
    if not json.loads(path.read_text(encoding="utf-8"))["other_alarms"]
)
LIMIT_DEG = 0.5 + 0.02  # of a pair at one instant: the specification's limit and its bound
FLIGHTS = ("a_copter_square", "b_copter_acro")  # slow with long rests, and never at rest

Json = dict[str, Any]


def recording(name: str) -> bytes:
    return (SITL / f"{name}.tlog").read_bytes()


def falsified(name: str, *faults: str, **scope: Any) -> bytes:
    return inject(recording(name), [parse_fault(fault) for fault in faults], **scope)


def judged(data: bytes) -> tuple[list[Json], Json]:
    """Events and the only vehicle's entry."""
    monitor = Monitor()
    events = monitor.feed_recording(data)
    (entry,) = monitor.close().to_dict()["files"]
    (vehicle,) = entry["vehicles"]
    return events, vehicle


@cache
def as_recorded(name: str) -> Json:
    """The only vehicle's entry of a recording as it is; for reading alone."""
    return judged(recording(name))[1]


@cache
def faulty_from_12_s(name: str, fault: str) -> tuple[bytes, list[Json], Json]:
    """A recording with a fault from second 12 on, its events and its only vehicle's entry; for reading alone."""
    data = falsified(name, fault, from_s=12.0)
    return data, *judged(data)


def of_the_two_forms(vehicle: Json) -> list[Json]:
    """The alarms of euler_quaternion, without its warnings; a faulty form contradicts other sources as well."""
    return [a for a in vehicle["alarms"] if (a["check"], a["severity"]) == ("euler_quaternion", "alarm")]


def messages(data: bytes) -> Iterator[tuple[int, bytes, Any]]:
    """(record time, frame, pymavlink's message), the message None but for the two attitudes."""
    parser = mavlink.MAVLink(None)
    for t_us, frame in records(data):
        compared = frame[0] == 0xFD and frame[7:10] in (b"\x1e\0\0", b"\x1f\0\0")
        yield t_us, frame, parser.decode(bytearray(frame)) if compared else None


def rewritten(data: bytes, change: Callable[[Any], bytes | None]) -> bytes:
    """The recording with other frames where `change` gives one for an attitude."""
    return wire.tlog(
        (t_us, (message is not None and change(message)) or frame) for t_us, frame, message in messages(data)
    )


def header_of(message: Any) -> dict[str, Any]:
    return {"seq": message.get_seq(), "sysid": message.get_srcSystem(), "compid": message.get_srcComponent()}


def disagreement(data: bytes) -> tuple[Any, Any]:
    """Times (s since boot) and angles (deg) of all pairs of the same instant, by SciPy from pymavlink's fields."""
    of: dict[str, dict[int, Any]] = {"ATTITUDE": {}, "ATTITUDE_QUATERNION": {}}
    for _, _, message in messages(data):
        if message is not None:
            of[message.get_type()][message.time_boot_ms] = message
    euler, quaternion = of.values()
    common = sorted(euler.keys() & quaternion.keys())
    a = Rotation.from_euler("ZYX", [[euler[t].yaw, euler[t].pitch, euler[t].roll] for t in common])
    b = Rotation.from_quat([[quaternion[t].q2, quaternion[t].q3, quaternion[t].q4, quaternion[t].q1] for t in common])
    return np.array(common) / 1000, np.degrees((a.inv() * b).magnitude())


# --- faults ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", one_in(3, ["quaternion_xyzw", "quaternion_conjugate", "yaw_offset:25"]))
@pytest.mark.parametrize("name", one_in(2, FLIGHTS[::-1], swept=False))
def test_one_alarm_in_time(name: str, fault: str) -> None:
    """A fault from second 12 on raises exactly one alarm of the two forms, within 1.5 s of vehicle time of where SciPy
    sees it, with its cause; nothing else comes before it.
    """
    data, events, vehicle = faulty_from_12_s(name, fault)
    t_s, angle_deg = disagreement(data)
    onset_s = t_s[angle_deg > LIMIT_DEG][0]
    (alarm,) = of_the_two_forms(vehicle)
    assert vehicle["alarms"][0] == alarm
    assert alarm["diagnosis"]["cause"] == fault.split(":", maxsplit=1)[0]
    assert 1.0 <= alarm["raised_boot_s"] - onset_s <= 1.5
    assert alarm["peak"] == pytest.approx(angle_deg.max(), abs=1e-4)
    raised = next(event for event in events if event["event"] == "alarm_raised")
    assert (raised["id"], raised["boot_s"]) == (alarm["id"], alarm["raised_boot_s"])
    assert vehicle["verdict"] == "alarm"


@pytest.mark.slow
@pytest.mark.parametrize("name", one_in(2, FLIGHTS))
def test_a_yaw_error_is_told_as_heading(name: str) -> None:
    """25° of yaw is 25° of heading and no tilt, in acro at 89.85° of pitch as well: never roll or pitch."""
    _, _, vehicle = faulty_from_12_s(name, "yaw_offset:25")
    (alarm,) = vehicle["alarms"]
    assert alarm["heading"] == pytest.approx(25, abs=0.1)
    assert alarm["tilt"] == pytest.approx(0, abs=0.01)
    assert alarm["peak"] == pytest.approx(25, abs=0.1)
    check = vehicle["checks"][0]
    assert check["tilt"]["max"] < 0.01
    assert check["heading"]["p95"] == pytest.approx(25, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", one_in(2, FLIGHTS))
def test_a_fault_that_ends_clears_its_alarm(name: str) -> None:
    """The same yaw error from second 12 to 20 raises one alarm, cleared two to three seconds after its last pair."""
    data = falsified(name, "yaw_offset:25", from_s=12.0, to_s=20.0)
    t_s, angle_deg = disagreement(data)
    ended_s = t_s[angle_deg > LIMIT_DEG][-1]
    (alarm,) = judged(data)[1]["alarms"]
    assert 2.0 <= alarm["cleared_boot_s"] - ended_s <= 2.5


@pytest.mark.slow
@pytest.mark.parametrize("thinned", [("thin:ATTITUDE=10",), ("thin:ATTITUDE=10", "thin:ATTITUDE_QUATERNION=4")])
@pytest.mark.parametrize("name", one_in(2, FLIGHTS))
def test_in_time_at_common_rates(name: str, thinned: Sequence[str]) -> None:
    """At the rates that most users have, 10 and 4 Hz, 25° of yaw is one alarm too, within a second and four periods."""
    data = falsified(name, *thinned, "yaw_offset:25", from_s=12.0)
    begins_s = min(  # by the boot clock: the first quaternion at or behind second 12 of the recording
        message.time_boot_ms / 1000
        for t_us, _, message in messages(data)
        if message is not None
        and message.get_type() == "ATTITUDE_QUATERNION"
        and t_us >= struct.unpack(">Q", data[:8])[0] + 12_000_000
    )
    slowest_hz = 10 if len(thinned) == 1 else 4
    (alarm,) = of_the_two_forms(judged(data)[1])
    assert 1.0 <= alarm["raised_boot_s"] - begins_s <= 1.0 + 4 / slowest_hz
    assert alarm["peak"] == pytest.approx(25, abs=1)


# Not among them: an unnormalised quaternion, which points where it should, and rates, which point nowhere.
UNTURNED = {"quaternion_unnormalised", "euler_rates"}
CAUSE_NAMES = [c.name for c in CAUSES.values() if c.falsify is not None and c.name not in UNTURNED]


@pytest.mark.parametrize("cause", one_in(12, CAUSE_NAMES))
def test_every_cause_raises_an_alarm_in_acro(cause: str) -> None:
    """In acro every mistake of the table shows, and gets its name: an alarm behind its onset and none before."""
    vehicle = judged(falsified("b_copter_acro", cause, from_s=20.0))[1]
    assert vehicle["verdict"] == "alarm"
    first = vehicle["alarms"][0]
    assert first == of_the_two_forms(vehicle)[0]
    onset_s = 175.563 + 20.0  # the recording's first attitude, and the fault's second
    assert onset_s - 1 < first["raised_boot_s"] < onset_s + 6
    assert first["diagnosis"]["cause"] == cause


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("from_s", [0.0, 12.0])
@pytest.mark.parametrize(
    ("name", "fault", "peak"),
    [
        ("d_plane_pitchtrim3", "yaw_offset:5", 5.0),
        ("k16_plane_trim_changes", "yaw_offset:5", 5.0),
        ("d_tailsitter", "quaternion_conjugate", None),
        ("k16_plane_trim_changes", "mount_offset:0,90,0", 90.0),  # a plane that is no tailsitter
        ("k4_quadplane", "mount_offset:0,3,0", 3.0),
        ("k1_copter_trim", "mount_offset:0,3,0", 3.0),
    ],
)
def test_a_fault_on_top_of_what_is_expected(name: str, fault: str, peak: float | None, from_s: float) -> None:
    """A trim or a view explains itself alone: a fault beside it is an alarm, soon and in its own size."""
    data = falsified(name, fault, from_s=from_s)
    starts_s = next(m.time_boot_ms for _, _, m in messages(data) if m is not None) / 1000
    alarms = of_the_two_forms(judged(data)[1])
    assert -0.1 <= alarms[0]["raised_boot_s"] - starts_s - from_s <= 6
    if peak is not None:  # where the trim has to be fitted first, it may be in it
        assert max(alarm["peak"] for alarm in alarms) == pytest.approx(peak, abs=0.1 if from_s else 3.1)


def test_a_quaternion_s_norm_is_no_disagreement() -> None:
    """A quaternion 1.05 times too long is the same rotation: quaternion_norm's alarm, and no other check's."""
    vehicle = judged(falsified("b_copter_acro", "quaternion_unnormalised", from_s=10.0))[1]
    assert vehicle["checks"][0]["verdict"] == "agree"
    assert vehicle["checks"][0]["residual"]["max"] < 1e-3
    assert [alarm["check"] for alarm in vehicle["alarms"]] == ["quaternion_norm"]


# --- no faults -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_a_quaternion_s_sign_means_nothing(name: str) -> None:
    """q and −q are one rotation: with the sign of every other sample, at random, turned, nothing changes."""
    chance = random.Random(name)
    turned = 0

    def change(message: Any) -> bytes | None:
        nonlocal turned
        if message.get_type() == "ATTITUDE" or chance.random() < 0.5:
            return None
        turned += 1
        q = (-message.q1, -message.q2, -message.q3, -message.q4)
        rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
        return wire.attitude_quaternion(message.time_boot_ms, q, rates, **header_of(message))

    before = as_recorded(name)
    after = judged(rewritten(recording(name), change))[1]
    assert turned > 500
    assert after["verdict"] == "agree"
    assert after["alarms"] == []
    checks = (before["checks"][0], after["checks"][0])
    assert checks[0]["pairs"] == checks[1]["pairs"]
    assert checks[1]["residual"]["max"] == pytest.approx(checks[0]["residual"]["max"], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_yaw_from_0_to_360(name: str) -> None:
    """Yaw sent as 0…2π instead of −π…π is the same rotation: no alarm, and no residual but float32's."""
    moved = 0

    def change(message: Any) -> bytes | None:
        nonlocal moved
        if message.get_type() != "ATTITUDE" or message.yaw >= 0:
            return None
        moved += 1
        rpy = (message.roll, message.pitch, message.yaw + 2 * math.pi)
        rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
        return wire.attitude(message.time_boot_ms, rpy, rates, **header_of(message))

    vehicle = judged(rewritten(recording(name), change))[1]
    assert moved > 500
    assert vehicle["alarms"] == []
    assert vehicle["checks"][0]["residual"]["max"] < 1e-4


LINK_FAULTS = [
    *(("loss:0.2",), ("reorder:0.3",), ("duplicate:0.3",)),
    *(("thin:ATTITUDE=10",), ("thin:ATTITUDE_QUATERNION=10",), ("thin:ATTITUDE_QUATERNION=4",)),
    *(("thin:ATTITUDE=10", "thin:ATTITUDE_QUATERNION=4"), ("thin:ATTITUDE=4", "thin:ATTITUDE_QUATERNION=10")),
    *(("thin:ATTITUDE=4", "loss:0.2"), ("loss:0.2", "reorder:0.3", "duplicate:0.2"), ("corrupt:0.003",)),
]


@pytest.mark.parametrize("faults", one_in(3, [(faults,) for faults in LINK_FAULTS]), ids="+".join)
@pytest.mark.parametrize(
    "name", one_in(6, [*FLIGHTS, "f_reboot", "b2_mixed_rates", "p_px4_quad_square", "k12_yaw_reset"])
)
def test_a_bad_link_is_no_disagreement(name: str, faults: tuple[str, ...]) -> None:
    """Loss, reordering, repetition, thinning and dirt on the link raise no alarm: across a restart, resets, in acro."""
    vehicle = judged(falsified(name, *faults))[1]
    assert vehicle["alarms"] == []
    assert vehicle["checks"][0]["verdict"] == "agree"


def apart(name: str, every: int) -> bytes:
    """The recording with every so manieth message of each of the two forms, never two at one instant."""
    seen = {"ATTITUDE": 0, "ATTITUDE_QUATERNION": every // 2}
    kept = []
    for t_us, frame, message in messages(recording(name)):
        if message is not None:
            seen[message.get_type()] += 1
        if message is None or seen[message.get_type()] % every == 0:
            kept.append((t_us, frame))
    return wire.tlog(kept)


@pytest.mark.parametrize("every", one_in(4, [2, 4, 12, 25]))
@pytest.mark.parametrize("name", one_in(2, [*FLIGHTS, "b2_mixed_rates", "k12_yaw_reset"], swept=False))
def test_forms_that_never_meet(name: str, every: int) -> None:
    """Where the two never share an instant, down to 1 or 2 Hz in acro, what interpolation cannot know is no alarm."""
    vehicle = judged(apart(name, every))[1]
    assert vehicle["alarms"] == []
    check = vehicle["checks"][0]
    assert (check["verdict"], check["same_instant"]) == ("agree", 0)


def test_nothing_is_interpolated_across_a_reset() -> None:
    """The estimator's yaw steps of 19.8° and 2.4° in a_copter_square are in no interpolated pair."""
    check = judged(apart("a_copter_square", 2))[1]["checks"][0]
    assert check["pairs"] > 1400
    assert check["residual"]["max"] < 0.1


@pytest.mark.parametrize("seed", one_in(3, range(6)))
def test_loss_at_random(seed: int) -> None:
    """Wherever 20 % of the messages are lost, in acro and in both streams, there is no alarm."""
    vehicle = judged(falsified("b_copter_acro", "loss:0.2", seed=seed))[1]
    assert vehicle["alarms"] == []
    assert vehicle["streams"]["ATTITUDE"]["lost"] > 200


@pytest.mark.parametrize("name", one_in(4, HEALTHY))
def test_loss_on_every_healthy_recording(name: str) -> None:
    """20 % of loss on top of whatever else a healthy recording has raises no alarm and no warning."""
    monitor = Monitor()
    monitor.feed_recording(falsified(name, "loss:0.2", seed=3))
    (entry,) = monitor.close().to_dict()["files"]
    assert [alarm for vehicle in entry["vehicles"] for alarm in vehicle["alarms"]] == []
    assert entry["verdict"] == "agree"


def test_repetitions_are_used_once() -> None:
    """A third of the frames logged twice, as recorders do, are counted and change no number."""
    monitor = Monitor()
    monitor.feed_recording(falsified("a_copter_square", "duplicate:0.3"))
    (entry,) = monitor.close().to_dict()["files"]
    assert entry["salvage"]["duplicates"] == round(0.3 * 14879)
    assert entry["salvage"]["frames"] == 14879 + entry["salvage"]["duplicates"]
    before = as_recorded("a_copter_square")
    assert entry["vehicles"][0]["checks"] == before["checks"]
    assert entry["vehicles"][0]["streams"] == before["streams"]


def test_lost_messages_are_counted() -> None:
    """Of 20 % lost frames the missing attitudes are counted as lost, to a few that the sequence cannot place."""
    before, after = as_recorded("a_copter_square"), judged(falsified("a_copter_square", "loss:0.2"))[1]
    for message in ("ATTITUDE", "ATTITUDE_QUATERNION"):
        missing = before["streams"][message]["count"] - after["streams"][message]["count"]
        assert missing > 500
        assert after["streams"][message]["lost"] == pytest.approx(missing, rel=0.05)


@pytest.mark.parametrize("name", FLIGHTS)
def test_reordering_loses_nothing(name: str) -> None:
    """Frames that change places are all there: none is lost, and every pair of one instant is found."""
    before, after = as_recorded(name), judged(falsified(name, "reorder:0.4"))[1]
    assert after["checks"][0]["same_instant"] == before["checks"][0]["same_instant"]
    for message in ("ATTITUDE", "ATTITUDE_QUATERNION"):
        assert after["streams"][message]["count"] == before["streams"][message]["count"]
        assert after["streams"][message]["lost"] == 0
        assert after["streams"][message]["rate_hz"] == pytest.approx(before["streams"][message]["rate_hz"], rel=1e-3)
