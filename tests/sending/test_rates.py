"""Asking vehicles for rates: what they answer, whether it holds, and when it is asked again; in a time of our own."""

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import common as mavlink

from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.packer import Packer
from gcs_bridge.sending.rates import RateRequests, Who
from tests.helpers.autopilot import (
    ATTITUDE,
    DENIED,
    HIGHRES_IMU,
    QUATERNION,
    RAW_IMU,
    TEMPORARILY_REJECTED,
    Autopilot,
    station_message,
)
from tests.helpers.everyday import one_in

OWN = (254, 191)
STEP_S = 0.02
GET_INTERVAL = 510


class Run:
    """A vehicle, and whoever asks it, in steps of 20 ms."""

    def __init__(self, vehicle: Autopilot, rate_hz: float = 20.0) -> None:
        self.vehicle = vehicle
        self.said: list[str] = []
        self.now_s = 0.0
        self.reaches = True  # what is sent reaches the vehicle
        self._packer = Packer(*OWN)
        self.asking = RateRequests(rate_hz, OWN, load_dialect(), self.said.append)
        self.asking.seen(Who(0, vehicle.system, vehicle.component), 0.0)

    def go_on(self, seconds: float, *, meanwhile: Callable[[], None] = lambda: None) -> "Run":
        ends_s = self.now_s + seconds
        while self.now_s < ends_s:
            meanwhile()
            self.asking.frames(0, self.vehicle.due(self.now_s), self.now_s)
            for request in self.asking.due(self.now_s):
                if self.reaches:
                    self.vehicle.take(request.packed(self._packer))
            self.now_s += STEP_S
        return self

    def asked(self) -> list[int]:
        return [msgid for msgid, _ in self.vehicle.commands()]


def test_both_attitudes_and_the_imu_are_asked_once() -> None:
    """Each with its interval in µs, one after the other; the answers are told; then nothing more is sent, ever."""
    run = Run(Autopilot()).go_on(120)
    assert run.vehicle.commands() == [(ATTITUDE, 50_000), (QUATERNION, 50_000), (RAW_IMU, 50_000)]
    assert run.vehicle.commands(GET_INTERVAL) == []
    assert run.said == [f"1,1: {name} at 20 Hz: accepted" for name in ("ATTITUDE", "ATTITUDE_QUATERNION", "RAW_IMU")]


def test_px4_has_another_imu() -> None:
    """It has no RAW_IMU: HIGHRES_IMU is asked for."""
    run = Run(Autopilot(autopilot=12, rates_hz={ATTITUDE: 15.0, QUATERNION: 10.0, HIGHRES_IMU: 10.0})).go_on(20)
    assert run.asked() == [ATTITUDE, QUATERNION, HIGHRES_IMU]


def test_an_imu_that_the_firmware_lacks_is_followed_by_another() -> None:
    """Until one is granted; each answer is told."""
    run = Run(Autopilot(autopilot=0, rates_hz={ATTITUDE: 4.0, QUATERNION: 4.0, HIGHRES_IMU: 4.0})).go_on(20)
    assert run.asked() == [ATTITUDE, QUATERNION, RAW_IMU, 26, HIGHRES_IMU]
    assert run.said[2:] == [
        "1,1: RAW_IMU at 20 Hz: unsupported",
        "1,1: SCALED_IMU at 20 Hz: unsupported",
        "1,1: HIGHRES_IMU at 20 Hz: accepted",
    ]


def test_a_refusal_is_told_and_not_argued_with() -> None:
    """DENIED is what ArduPilot says to a rate that its loop cannot reach."""
    run = Run(Autopilot(results={ATTITUDE: DENIED})).go_on(60)
    assert run.asked() == [ATTITUDE, QUATERNION, RAW_IMU]
    assert run.said[0] == "1,1: ATTITUDE at 20 Hz: denied: the firmware allows no such rate"


def test_a_vehicle_that_is_busy_is_asked_again() -> None:
    """Three times, a second apart; then the answer is told."""
    run = Run(Autopilot(results={ATTITUDE: TEMPORARILY_REJECTED})).go_on(60)
    assert run.asked() == [ATTITUDE] * 3 + [QUATERNION, RAW_IMU]
    assert run.said[0] == "1,1: ATTITUDE at 20 Hz: temporarily rejected"


@pytest.mark.slow
def test_no_answer() -> None:
    """Three times each, and then it is said what may be the reason, and left alone."""
    run = Run(Autopilot(answers=False)).go_on(300)
    assert run.asked() == [ATTITUDE] * 3 + [QUATERNION] * 3 + [RAW_IMU] * 3
    assert "1,1: ATTITUDE at 20 Hz: no answer; is the link one-way" in run.said[0]


def test_an_answer_that_was_lost() -> None:
    """The first command never arrives: the second is answered."""
    run = Run(Autopilot())
    run.reaches = False
    run.go_on(0.5)
    run.reaches = True
    run.go_on(10)
    assert run.asked() == [ATTITUDE, QUATERNION, RAW_IMU]
    assert len(run.said) == 3


@pytest.mark.parametrize(
    ("to_hz", "tells_intervals", "knows_none"),
    one_in(6, [(to_hz, *knows) for to_hz in (4.0, 0.0) for knows in ((True, False), (False, False), (True, True))]),
)
def test_another_station_undoes_it(to_hz: float, tells_intervals: bool, knows_none: bool) -> None:
    """As MAVProxy does with 4 Hz: it is asked again, within seconds, and said; by the vehicle's word where it tells."""
    run = Run(Autopilot(tells_intervals=tells_intervals, knows_none=knows_none)).go_on(30)
    run.vehicle.rates_hz[ATTITUDE] = to_hz
    run.go_on(15)
    assert run.asked() == [ATTITUDE, QUATERNION, RAW_IMU, ATTITUDE]
    assert run.vehicle.rates_hz[ATTITUDE] == 20
    has = "has" if tells_intervals and not knows_none else "may have"
    assert any(f"Hz: another station {has} changed it; asked again" in line for line in run.said)
    asked = len(run.vehicle.received)
    run.go_on(120)
    assert len(run.vehicle.received) == asked


def test_a_station_that_was_heard_is_named() -> None:
    """Its REQUEST_DATA_STREAM came by: then nobody has to be asked."""
    run = Run(Autopilot()).go_on(30)
    wish = mavlink.MAVLink_request_data_stream_message(1, 1, 10, 4, 1)
    run.asking.frames(0, [station_message(wish)], run.now_s)
    run.vehicle.rates_hz.update({ATTITUDE: 4.0, QUATERNION: 4.0, RAW_IMU: 4.0})
    run.go_on(15)
    assert sorted(run.asked()[3:]) == sorted([ATTITUDE, QUATERNION, RAW_IMU])
    assert run.vehicle.commands(GET_INTERVAL) == []
    assert sum("the station 255,190 has changed it; asked again" in line for line in run.said) == 3


@pytest.mark.slow
def test_two_stations_that_undo_each_other_s_wish_tire() -> None:
    """One that sets 4 Hz every 3 s is answered ever more rarely: some times in ten minutes, not two hundred."""
    run = Run(Autopilot()).go_on(30)

    def undo() -> None:
        if int(run.now_s / STEP_S) % 150 == 0:
            run.vehicle.rates_hz[ATTITUDE] = 4.0

    run.go_on(600, meanwhile=undo)
    again = len(run.asked()) - 3
    assert 3 <= again <= 8
    assert sum("another station has changed it" in line for line in run.said) == again


@pytest.mark.parametrize("limit_hz", one_in(2, [3.0, 8.0], swept=False))
def test_a_link_that_takes_no_more(limit_hz: float) -> None:
    """The vehicle still means to send 20 Hz: nobody has undone anything, and nothing is asked again."""
    run = Run(Autopilot()).go_on(30)
    run.vehicle.limit_hz = limit_hz
    run.go_on(120)
    assert run.asked() == [ATTITUDE, QUATERNION, RAW_IMU]
    assert sum("the link takes no more" in line for line in run.said) == 3


@pytest.mark.slow
def test_a_rate_that_is_granted_and_never_comes() -> None:
    """Where the vehicle does not tell its intervals it is asked twice more, and then no more."""
    run = Run(Autopilot(tells_intervals=False, limit_hz=5.0)).go_on(600)
    assert run.asked().count(ATTITUDE) == 3
    assert any("ATTITUDE comes at 5" in line and line.endswith("not asked again") for line in run.said)


def test_a_transfer_slows_streams_and_is_no_reason() -> None:
    """ArduPilot sends at a quarter while it sends parameters."""
    run = Run(Autopilot()).go_on(30)
    parameter = mavlink.MAVLink_param_value_message(b"X", 1.0, 9, 1000, 1)
    run.vehicle.limit_hz = 5.0
    run.go_on(60, meanwhile=lambda: run.vehicle.say(parameter))
    run.vehicle.limit_hz = 1000.0
    run.go_on(30)
    assert len(run.vehicle.received) == 3


def test_a_vehicle_that_restarts_is_asked_again() -> None:
    """It has forgotten; and one that was lost is asked when it is there again, not before."""
    run = Run(Autopilot()).go_on(30)
    who = Who(0, 1, 1)
    run.asking.seen(who, run.now_s)
    assert len(run.go_on(10).asked()) == 6
    run.asking.lost(who)
    assert len(run.go_on(10).asked()) == 6
    run.asking.seen(who, run.now_s)
    assert len(run.go_on(10).asked()) == 9


def test_answers_to_others_are_not_ours() -> None:
    """An answer to another station's command tells nothing of ours."""
    vehicle = Autopilot(answers=False)
    run = Run(vehicle)
    answer = mavlink.MAVLink_command_ack_message(511, 0, 0, 0, 255, 190)
    run.go_on(30, meanwhile=lambda: vehicle.say(answer))
    assert not any("accepted" in line for line in run.said)


def test_forged_vehicles_are_not_all_asked() -> None:
    """A thousand of them are sent some dozen commands, and it is said."""
    said: list[str] = []
    asking = RateRequests(20.0, OWN, load_dialect(), said.append)
    for number in range(1000):
        asking.seen(Who(0, 1 + number % 250, 1 + number // 250), 0.0)
    assert len(asking.due(3.0)) == 32
    assert said == ["rates were asked of 32 vehicles; further ones are not asked"]
