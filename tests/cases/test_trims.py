"""Trims and views that nobody tells, on links where the two attitudes never carry one stamp, and without a quaternion.

What the firmware does is explained; what it does not do is an alarm, named, as where the stamps are equal.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge import Monitor, check
from tests.helpers import wire
from tests.helpers.apart import PLANE, QUADROTOR, Apart, level, mounted, told, weaving, yawed
from tests.helpers.craft import (
    Craft,
    Json,
    Record,
    alarms,
    judged,
    parameter,
    true,
    turned_in_body,
    two_sided,
    watched,
)
from tests.helpers.craft import check as entry_of
from tests.helpers.everyday import in_turns, one_in
from tests.helpers.paths import ROOT

pytestmark = pytest.mark.slow

CASES = ROOT / "tests" / "data" / "cases"
VALUE_DEG = 0.3  # by which an estimated trim may be off


def case(name: str) -> Json:
    """The only vehicle of a case's report."""
    (vehicle,) = check(CASES / f"{name}.tlog").to_dict()["files"][0]["vehicles"]
    found: Json = vehicle
    return found


def explained(vehicle: Json) -> list[tuple[str, Any, bool, list[str]]]:
    """What `euler_quaternion` is explained by."""
    return [
        (one["cause"], one["value"], one["estimated"], one["alternatives"])
        for one in entry_of(vehicle, "euler_quaternion")["explained_by"]
    ]


def flown(craft: Apart, seconds: float = 40.0, more: list[Record] | None = None) -> Json:
    records = sorted([*craft.records(seconds), *(more or [])], key=lambda one: one[0])
    return watched(records)[1]


def raised(vehicle: Json) -> list[tuple[str, str]]:
    return [(alarm["check"], alarm["severity"]) for alarm in vehicle["alarms"]]


# --- fitted ----------------------------------------------------------------------------------------------------------

RADIO = [(50.0, 5), (25.0, 7), (25.0, 20), (10.0, 30), (8.0, 60), (5.0, 40), (5.0, 100), (4.0, 17)]  # Hz, ms apart
AHRS_TRIMS = [(5.0, -3.0), (-2.0, 3.0), (0.0, 8.0), (9.0, 6.0), (1.0, 2.0)]
PITCH_TRIMS = [-6.0, -1.5, 3.0, 12.0]


def test_a_flight_whose_stamps_never_meet() -> None:
    """A plane with 3° of pitch trim, quaternions 7 ms behind: no alarm, and the trim is named."""
    vehicle = case("apart_d_plane_pitchtrim3")
    assert vehicle["alarms"] == []
    assert explained(vehicle) == [("pitch_trim", pytest.approx(3.0, abs=VALUE_DEG), True, [])]
    assert entry_of(vehicle, "euler_quaternion")["verdict"] == "explained"


@pytest.mark.parametrize(
    ("hz", "apart_ms", "trim_deg"), one_in(8, [(*link, trim) for link, trim in in_turns(2, RADIO, AHRS_TRIMS)])
)
def test_ahrs_trim_is_fitted(hz: float, apart_ms: int, trim_deg: tuple[float, float]) -> None:
    """Both numbers, whatever the rate and the distance of the stamps, before anything is alarmed."""
    vehicle = flown(Apart(motion=weaving(), hz=hz, apart_ms=apart_ms, ahrs_trim_deg=trim_deg))
    assert vehicle["alarms"] == []
    assert explained(vehicle) == [("ahrs_trim", pytest.approx(list(trim_deg), abs=VALUE_DEG), True, [])]


@pytest.mark.parametrize(
    ("hz", "apart_ms", "trim_deg"), one_in(4, [(*link, trim) for link, trim in in_turns(2, RADIO, PITCH_TRIMS)])
)
def test_a_pitch_trim_is_fitted(hz: float, apart_ms: int, trim_deg: float) -> None:
    """And a bank tells it from a mount offset."""
    vehicle = flown(
        Apart(motion=weaving(), kind=PLANE, modes=[(0.0, 5)], hz=hz, apart_ms=apart_ms, pitch_trim_deg=trim_deg)
    )
    assert vehicle["alarms"] == []
    assert explained(vehicle) == [("pitch_trim", pytest.approx(trim_deg, abs=VALUE_DEG), True, [])]


@pytest.mark.parametrize("is_told", [False, True])
@pytest.mark.parametrize(("hz", "apart_ms", "loss"), [(2.0, 250, 0.2), (4.0, 0, 0.2), (10.0, 50, 0.0)])
def test_a_pitch_trim_that_changes_untold(hz: float, apart_ms: int, loss: float, is_told: bool) -> None:
    """From 1° to −3° and to +2°, as in `k16_plane_trim_changes`, the first one told or not: found anew, no alarm."""
    made = [
        Apart(motion=weaving(roll=35.0), kind=PLANE, modes=[(0.0, 5)], hz=hz, apart_ms=apart_ms, pitch_trim_deg=trim)
        for trim in (1.0, -3.0, 2.0)
    ]
    since_us = [wire.START_US + round(1e6 * at_s) for at_s in (22.0, 42.0)]
    records = [
        pair[sum(pair[0][0] >= at_us for at_us in since_us)]
        for pair in zip(*(one.records(70.0) for one in made), strict=True)
    ]
    chance = np.random.default_rng(3)
    records = [one for one in records if chance.random() >= loss]
    if is_told:
        records += told(at_s=1.0, PTCH_TRIM_DEG=1.0, AHRS_TRIM_X=0.0, AHRS_TRIM_Y=0.0)
    vehicle = watched(sorted(records, key=lambda one: one[0]))[1]
    assert vehicle["alarms"] == []
    values = [value for _, value, _, _ in explained(vehicle)]
    assert values == pytest.approx([1.0, -3.0, 2.0], abs=VALUE_DEG)


def test_what_level_flight_cannot_tell_is_named_beside_it() -> None:
    """Without a bank a pitch trim may be a mount offset: both are named."""
    vehicle = flown(Apart(motion=level(), kind=PLANE, modes=[(0.0, 5)], pitch_trim_deg=4.0))
    assert vehicle["alarms"] == []
    ((cause, value, estimated, alternatives),) = explained(vehicle)
    assert (cause, estimated) == ("pitch_trim", True)
    assert value == pytest.approx(4.0, abs=VALUE_DEG)
    assert "mount_offset" in alternatives


@pytest.mark.parametrize(
    ("hz", "apart_ms", "view_deg"),
    one_in(4, [(*link, view) for link in ((10.0, 50), (25.0, 7), (5.0, 60)) for view in (4.0, -6.0, 9.0)]),
)
def test_a_view_is_fitted(hz: float, apart_ms: int, view_deg: float) -> None:
    """A plane that hovers from 12 s to 30 s shows a pitched body then; it is followed through both changes."""
    craft = Apart(
        motion=weaving(roll=8.0, pitch=3.0),
        kind=PLANE,
        modes=[(0.0, 5), (12.0, 18), (30.0, 5)],
        hovers=lambda t_s: 12.0 <= t_s < 30.0,
        hz=hz,
        apart_ms=apart_ms,
        view_deg=view_deg,
    )
    vehicle = flown(craft)
    assert vehicle["alarms"] == []
    assert explained(vehicle) == [("vtol_view", pytest.approx(view_deg, abs=VALUE_DEG), True, [])]


def test_few_stamps_that_meet_are_enough_to_be_exact() -> None:
    """Of a radio's quaternions one in six carries ATTITUDE's stamp: then the trim is known as well as by those."""
    apart = Apart(motion=weaving(), hz=6.0, apart_ms=40, ahrs_trim_deg=(5.0, -3.0))
    together = Apart(motion=weaving(), hz=6.0, apart_ms=0, ahrs_trim_deg=(5.0, -3.0))
    records = [
        pair[0 if i % 18 > 2 else 1] for i, pair in enumerate(zip(apart.records(60), together.records(60), strict=True))
    ]
    vehicle = watched(sorted(records, key=lambda one: one[0]))[1]
    assert vehicle["alarms"] == []
    assert explained(vehicle) == [("ahrs_trim", pytest.approx([5.0, -3.0], abs=VALUE_DEG), True, [])]


@pytest.mark.sweep
def test_it_does_not_matter_how_the_bytes_are_cut() -> None:
    """A batch of one message and one of all give the same events and the same report."""
    data = wire.tlog(Apart(motion=weaving(), hz=10.0, ahrs_trim_deg=(5.0, -3.0), fault=yawed(6.0, 25.0)).records(35))
    outcomes = []
    for size in (len(data), 61):
        monitor = Monitor()
        events = [event for at in range(0, len(data), size) for event in monitor.feed_recording(data[at : at + size])]
        outcomes.append((events + monitor.finish(), monitor.close().to_dict()))
    assert outcomes[0] == outcomes[1]
    assert outcomes[0][1]["verdict"] == "alarm"


# --- faults ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hz", "apart_ms", "deg"),
    one_in(8, [(*link, deg) for link, deg in in_turns(2, ((25.0, 7), (10.0, 50), (5.0, 60)), (5.0, 1.2, 25.0))]),
)
def test_a_yaw_offset_is_found_beside_a_pitch_trim(hz: float, apart_ms: int, deg: float) -> None:
    """And named, as where the stamps meet."""
    craft = Apart(
        motion=weaving(),
        kind=PLANE,
        modes=[(0.0, 5)],
        hz=hz,
        apart_ms=apart_ms,
        pitch_trim_deg=3.0,
        fault=yawed(deg, 22.0),
    )
    vehicle = flown(craft)
    (alarm, *_) = alarms(vehicle, "euler_quaternion")
    assert alarm["severity"] == "alarm"
    assert 22.0 < alarm["raised_boot_s"] < 27.0
    assert alarm["diagnosis"]["cause"] == "yaw_offset"
    assert alarm["diagnosis"]["value"] == pytest.approx(deg, abs=0.3)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("fault", "cause", "kind"),
    [
        (yawed(4.0, 0.0), "yaw_offset", PLANE),
        (mounted(0.0, 4.0, 0.0), "mount_offset", PLANE),
        (mounted(0.0, 4.0, 0.0), "mount_offset", QUADROTOR),
        (mounted(4.0, 0.0, 0.0), "mount_offset", QUADROTOR),
    ],
)
def test_a_mistake_from_the_start_is_no_trim(fault: Any, cause: str, kind: int) -> None:
    """In a flight that banks, a turn of the world or of the body is an alarm, though no trim was told."""
    vehicle = flown(Apart(motion=weaving(), kind=kind, modes=[(0.0, 5)], hz=10.0, fault=fault))
    assert ("euler_quaternion", "alarm") in raised(vehicle)
    (alarm, *_) = alarms(vehicle, "euler_quaternion")
    assert alarm["diagnosis"]["cause"] == cause


@pytest.mark.parametrize("trim_deg", one_in(2, [((0.0, 0.0),), ((5.0, -3.0),)]))
def test_a_mount_offset_in_flight_is_no_trim(trim_deg: tuple[float, float]) -> None:
    """Whether a trim was fitted before or not."""
    craft = Apart(
        motion=weaving(), hz=10.0, apart_ms=50, ahrs_trim_deg=trim_deg, fault=mounted(0.0, 3.0, 0.0, from_s=24.0)
    )
    (alarm, *_) = alarms(flown(craft), "euler_quaternion")
    assert 24.0 < alarm["raised_boot_s"] < 30.0


@pytest.mark.sweep
@pytest.mark.parametrize("turn_deg", [12.0, 20.0])
def test_a_larger_turn_than_a_trim_may_make_is_an_alarm(turn_deg: float) -> None:
    """A pitch trim has 15° at the most, AHRS_TRIM 10°."""
    plane = Apart(motion=level(), kind=PLANE, modes=[(0.0, 5)], pitch_trim_deg=turn_deg + 5.0)
    copter = Apart(motion=weaving(), ahrs_trim_deg=(0.0, turn_deg))
    for craft in (plane, copter):
        assert ("euler_quaternion", "alarm") in raised(flown(craft))


# --- gravity ---------------------------------------------------------------------------------------------------------


def test_a_trim_that_is_told_late() -> None:
    """Till it is told, 6° at rest may be it: no warning, and the reason says so."""
    vehicle = case("trim_late")
    assert vehicle["alarms"] == []
    gravity = entry_of(vehicle, "gravity")
    assert gravity["verdict"] == "agree"
    assert gravity["residual"]["max"] < 0.1
    assert "AHRS_TRIM" in gravity["reason"]
    assert "6.02°" in gravity["reason"]


def resting(deg: float, **given: Any) -> Json:
    """A vehicle at rest whose attitude is pitched so far from what its accelerometer feels."""
    return judged(Craft(**two_sided(turned_in_body(0, deg, 0)), imu=true, hz=10.0, **given), 20)


BOTH = [(5.0, parameter("AHRS_TRIM_X", 0.0)), (5.0, parameter("AHRS_TRIM_Y", 0.0))]


@pytest.mark.parametrize(
    ("deg", "given", "severities"),
    [
        (6.0, {}, []),
        (9.9, {}, []),
        (12.0, {}, ["alarm"]),
        (6.0, {"also": BOTH}, ["warning"]),
        (6.0, {"also": BOTH[:1]}, []),  # the other axis may make it
        (6.0, {"autopilot": wire.PX4}, ["warning"]),
    ],
)
def test_gravity_while_a_trim_is_open(deg: float, given: dict[str, Any], severities: list[str]) -> None:
    """Up to 10° are held back while AHRS_TRIM was not told, of ArduPilot alone."""
    vehicle = resting(deg, **given)
    assert [alarm["severity"] for alarm in alarms(vehicle, "gravity")] == severities
    if not severities:
        gravity = entry_of(vehicle, "gravity")
        assert gravity["verdict"] == "no_compare"
        assert "AHRS_TRIM" in gravity["reason"]


def test_a_trim_that_is_never_told_at_rest_and_in_flight() -> None:
    """At rest for 15 s, then flown in banks: held back, then fitted, and at rest again it is the trim."""

    def motion(t_s: float) -> tuple[float, float, float]:
        flies = 15.0 <= t_s < 45.0
        return weaving()(t_s - 10.0) if flies else (0.0, 0.0, 80.0 if t_s < 45.0 else 280.0)

    craft = Apart(motion=motion, hz=10.0, ahrs_trim_deg=(5.0, -3.0), imu=True)
    vehicle = flown(craft, 70.0)
    assert [one for one in raised(vehicle) if one[0] in ("gravity", "euler_quaternion")] == []
    assert explained(vehicle) == [("ahrs_trim", pytest.approx([5.0, -3.0], abs=VALUE_DEG), True, [])]


# --- a view without a quaternion -------------------------------------------------------------------------------------


def test_a_tailsitter_that_hovers_in_auto() -> None:
    """No quaternion comes and AUTO says nothing of the view: the parameters and the accelerometer do."""
    vehicle = case("tailsitter_auto")
    assert vehicle["alarms"] == []
    gravity = entry_of(vehicle, "gravity")
    assert gravity["verdict"] == "explained"
    assert [(one["cause"], one["value"]) for one in gravity["explained_by"]] == [("vtol_view", 90.0)]


TAILSITTER = {"Q_ENABLE": 1.0, "Q_TAILSIT_ENABLE": 1.0, "Q_TRIM_PITCH": 0.0, "AHRS_TRIM_X": 0.0, "AHRS_TRIM_Y": 0.0}


def on_its_tail(
    parameters: dict[str, float],
    *,
    hz: float = 5.0,
    mode: int = 10,
    imu_every: int = 1,
    sway_deg: float = 0.0,
    view_deg: float = 90.0,
) -> list[Record]:
    """A plane that stands on its tail for 25 s, and then hovers for 35 s, where ATTITUDE shows the pitched view."""
    sender, found = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), list[Record]()

    def send(ms: int, message: Any) -> None:
        sender.seq = len(found) % 256
        found.append((wire.START_US + 1000 * ms, bytes(message.pack(sender))))

    beat = 0
    for tick in range(int(60 * hz)):
        t_s = tick / hz
        ms, hovers = round(1000 * t_s), t_s >= 25.0
        if ms >= beat:
            send(
                ms,
                mavlink.MAVLink_heartbeat_message(
                    PLANE, wire.ARDUPILOT, 217 if hovers else 81, mode if hovers else 0, 4, 3
                ),
            )
            beat += 1000
        if tick == round(3 * hz):
            for name, value in parameters.items():
                send(ms, parameter(name, value))
        w = 2 * np.pi * 0.2
        sway, rate = (np.radians(sway_deg) * hovers * of for of in (np.sin(w * t_s), w * np.cos(w * t_s)))
        body = Rotation.from_euler("ZYX", [0.3, np.radians(89.5), 0.0]) * Rotation.from_rotvec([0.0, sway, 0.0])
        shown = body * Rotation.from_rotvec([0.0, -np.radians(view_deg), 0.0]) if hovers else body
        (yaw, pitch, roll), (yaw2, pitch2, roll2) = shown.as_euler("ZYX"), body.as_euler("ZYX")
        send(ms, mavlink.MAVLink_attitude_message(10_000 + ms, roll, pitch, yaw, 0.0, rate, 0.0))
        if tick % imu_every == 0:
            force = np.rint(1000.0 * body.inv().apply([0.0, 0.0, -1.0])).astype(int).tolist()
            send(
                ms,
                mavlink.MAVLink_raw_imu_message(
                    10_000_000 + 1000 * ms, *force, 0, round(1000 * rate), 0, 200, 50, -500
                ),
            )
        send(ms, mavlink.MAVLink_ahrs2_message(roll2, pitch2, yaw2, 100.0, 0, 0))
    return found


@pytest.mark.parametrize(
    ("parameters", "given", "estimated"),
    [
        (TAILSITTER, {}, False),
        (TAILSITTER, {"hz": 10.0, "imu_every": 5}, False),
        (TAILSITTER, {"mode": 15, "sway_deg": 12.0, "hz": 10.0}, False),
        (TAILSITTER, {"mode": 19, "hz": 2.0}, False),
        ({"Q_ENABLE": 1.0, "Q_FRAME_CLASS": 10.0}, {}, False),
        ({"Q_TAILSIT_ENABLE": 2.0}, {}, False),
        ({"Q_TAILSIT_MOTMX": 3.0}, {}, False),
        ({}, {"mode": 18}, True),  # nothing told: its mode, and what the accelerometer feels in it
        ({"Q_ENABLE": 1.0}, {}, True),
    ],
)
def test_a_tailsitter_is_known_without_a_quaternion(
    parameters: dict[str, float], given: dict[str, Any], estimated: bool
) -> None:
    """By its parameters, its mode and the accelerometer: its view is explained, and nothing alarmed."""
    vehicle = watched(on_its_tail(parameters, **given))[1]
    assert vehicle["alarms"] == []
    assert [one[:3] for one in explained(vehicle)] == [("vtol_view", pytest.approx(90.0), estimated)]
    assert entry_of(vehicle, "gravity")["verdict"] == "explained"


@pytest.mark.parametrize(
    ("parameters", "mode"),
    [
        ({"Q_ENABLE": 0.0}, 10),
        ({}, 10),
        ({}, 5),
        ({"Q_ENABLE": 1.0, "Q_TAILSIT_ENABLE": 0.0}, 10),
        ({"Q_ENABLE": 1.0, "Q_TAILSIT_ENABLE": 0.0}, 18),
    ],
)
def test_a_plane_that_is_no_tailsitter_is_90_degrees_off(parameters: dict[str, float], mode: int) -> None:
    """The same 90° of a plane without a view, or of a quadplane that does not sit on its tail, are a fault."""
    assert ("gravity", "alarm") in raised(watched(on_its_tail(parameters, mode=mode))[1])
