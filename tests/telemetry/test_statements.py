"""What a vehicle says of itself: values that hold from a frame on, parameters, texts."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge import Monitor
from gcs_bridge.telemetry.statements import (
    FlagsSet,
    LandedSet,
    ModeSet,
    ParameterSet,
    ReadySet,
    Statement,
    StepSignal,
    TextSaid,
    held_at,
)
from tests.helpers.craft import Craft, Record, landed, parameter, text
from tests.helpers.wire import PX4, tlog


def heard(records: Sequence[Record]) -> list[Statement]:
    """What the vehicle said, as its checks are given it."""
    said: list[Statement] = []
    Monitor(observer=lambda seen: said.extend(seen.flight.statements)).feed_recording(tlog(records))
    return said


def values(said: Sequence[Statement]) -> list[tuple[str, float]]:
    return [(say.name, say.value) for say in said if isinstance(say, ParameterSet)]


# --- a value that holds ----------------------------------------------------------------------------------------------


def at(latest: StepSignal, *frame_indices: int) -> list[float]:
    values: list[float] = latest.at(np.array(frame_indices, np.int64)).tolist()
    np.testing.assert_array_equal([held_at(latest.steps, one) for one in frame_indices], values)
    return values


def test_a_value_holds_from_its_frame_on() -> None:
    """Put at frame 5 and 9: before 5 nothing is known, from 5 on the one, from 9 on the other."""
    latest = StepSignal()
    latest.put(np.array([5, 9]), np.array([1.5, 2.5]))
    before, *known = at(latest, 4, 5, 8, 9, 100)
    assert np.isnan(before)
    assert known == [1.5, 1.5, 2.5, 2.5]


def test_a_value_before_anything_was_told() -> None:
    """The value given at the start holds until then."""
    assert at(StepSignal(7.0), 0, 3) == [7.0, 7.0]


def test_what_was_passed_is_forgotten_and_what_holds_is_not() -> None:
    """After a question at frame 20 the value of frame 9 still holds, though nothing older is kept."""
    latest = StepSignal()
    latest.put(np.array([5, 9, 30]), np.array([1.0, 2.0, 3.0]))
    assert at(latest, 20) == [2.0]
    assert at(latest, 20, 29, 30) == [2.0, 2.0, 3.0]
    assert at(latest) == []
    assert at(latest, 31) == [3.0]


def test_what_is_put_late_holds_from_its_own_frame_on() -> None:
    """A trim told in frame 30, of the next boot, then one fitted in frame 20: from 20 to 29 that one holds, then the
    other. Of two values of one frame the one put last holds.
    """
    latest = StepSignal(0.0)
    latest.put(np.array([10, 30]), np.array([1.0, 3.0]))
    latest.put(np.array([20]), np.array([2.0]))
    assert at(latest, 9, 10, 19, 20, 29, 30) == [0.0, 1.0, 1.0, 2.0, 2.0, 3.0]
    latest.put(np.array([20]), np.array([2.5]))
    assert at(latest, 20, 30) == [2.5, 3.0]
    latest.forget(25)
    assert at(latest, 25, 30) == [2.5, 3.0]


@pytest.mark.slow
@given(
    put=st.lists(st.integers(0, 50), unique=True).map(sorted),
    asked=st.lists(st.integers(0, 50)).map(sorted),
    cuts=st.lists(st.integers(0, 50)).map(sorted),
)
def test_any_cutting_gives_the_same_values(put: list[int], asked: list[int], cuts: list[int]) -> None:
    """Statement and asked piece by piece, a value is the last one put at or before the frame."""
    latest, found = StepSignal(), []
    for begin, end in zip([0, *cuts], [*cuts, 51], strict=True):
        mine = [one for one in put if begin <= one < end]
        latest.put(np.array(mine, np.int64), np.array(mine, np.float64))
        found += at(latest, *(one for one in asked if begin <= one < end))
    expected = [max((one for one in put if one <= frame_index), default=np.nan) for frame_index in asked]
    np.testing.assert_array_equal(found, expected)


# --- from the wire ---------------------------------------------------------------------------------------------------


def px4_parameter(name: str, kind: int, bits: bytes) -> Any:
    """A parameter as PX4 sends it: the bits of its integer in the float's place."""
    (value,) = struct.unpack("<f", bits)
    return mavlink.MAVLink_param_value_message(name.encode(), value, kind, 1, 0)


@pytest.mark.parametrize(
    ("kind", "bits", "value"),
    [
        (mavlink.MAV_PARAM_TYPE_INT32, struct.pack("<i", -7), -7.0),
        (mavlink.MAV_PARAM_TYPE_UINT32, struct.pack("<I", 4_000_000_000), 4e9),
        (mavlink.MAV_PARAM_TYPE_INT16, struct.pack("<hxx", -300), -300.0),
        (mavlink.MAV_PARAM_TYPE_UINT16, struct.pack("<Hxx", 65_535), 65_535.0),
        (mavlink.MAV_PARAM_TYPE_INT8, struct.pack("<bxxx", -5), -5.0),
        (mavlink.MAV_PARAM_TYPE_UINT8, struct.pack("<Bxxx", 250), 250.0),
        (mavlink.MAV_PARAM_TYPE_REAL32, struct.pack("<f", 0.25), 0.25),
    ],
)
def test_integers_of_px4(kind: int, bits: bytes, value: float) -> None:
    """PX4's integers are read from the bits, its floats as they are."""
    craft = Craft(autopilot=PX4, also=[(0.5, px4_parameter("SYS_X", kind, bits))])
    assert values(heard(craft.records(1))) == [("SYS_X", value)]


def test_integers_of_ardupilot() -> None:
    """ArduPilot sends an integer's value as a float."""
    message = mavlink.MAVLink_param_value_message(b"FLIGHT_OPTIONS", 257.0, mavlink.MAV_PARAM_TYPE_INT32, 1, 0)
    assert values(heard(Craft(also=[(0.5, message)]).records(1))) == [("FLIGHT_OPTIONS", 257.0)]


def test_a_name_of_sixteen_letters() -> None:
    """A parameter's name may fill its field, without a zero behind it."""
    assert values(heard(Craft(also=[(0.5, parameter("ABCDEFGHIJKLMNOP", 1))]).records(1))) == [
        ("ABCDEFGHIJKLMNOP", 1.0)
    ]


def test_modes_are_told_when_they_change() -> None:
    """Of the heartbeats those are told that say something else than the one before: mode and arming."""

    def beat(mode: int, armed: bool) -> Any:
        return mavlink.MAVLink_heartbeat_message(1, 3, 128 if armed else 0, mode, 4, 3)

    also = [(0.1, beat(5, False)), (0.2, beat(5, False)), (0.3, beat(5, True)), (0.4, beat(10, True))]
    modes = [say for say in heard(Craft(beats=False, also=also).records(1)) if isinstance(say, ModeSet)]
    assert [(say.custom_mode, say.armed) for say in modes] == [(5, False), (5, True), (10, True)]
    assert {(say.autopilot, say.type) for say in modes} == {("ardupilot", "fixed_wing")}


def test_the_ground_is_told() -> None:
    """EXTENDED_SYS_STATE: on the ground, in the air, taking off and landing, or not known."""
    also = [(0.1 * (i + 1), landed(state)) for i, state in enumerate((0, 1, 2, 3, 4))]
    states = [say.landed for say in heard(Craft(also=also).records(1)) if isinstance(say, LandedSet)]
    assert states == [None, True, False, False, False]


def test_texts_are_told() -> None:
    """STATUSTEXT without the zeros behind it."""
    said = heard(Craft(also=[(0.5, text("EKF2 yaw reset"))]).records(1))
    assert [say.text for say in said if isinstance(say, TextSaid)] == ["EKF2 yaw reset"]


def test_flags_are_told_when_they_change() -> None:
    """The first flags are no change; the second ones are, with both values."""

    def ekf(flags: int) -> Any:
        return mavlink.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0)

    also = [(0.1, ekf(831)), (0.2, ekf(831)), (0.3, ekf(191))]
    (change,) = [say for say in heard(Craft(also=also).records(1)) if isinstance(say, FlagsSet)]
    assert (change.what, change.before, change.value) == ("EKF_STATUS_REPORT.flags", 831, 191)


def test_in_order_of_arrival() -> None:
    """What was said comes with the frame_indices of its frames, in rising order, whatever the messages were."""
    also = [(0.1, text("one")), (0.2, parameter("TWO", 2)), (0.3, landed(1)), (0.4, text("four"))]
    said = heard(Craft(also=also).records(1))
    frame_indices = [say.frame_index for say in said]
    assert frame_indices == sorted(set(frame_indices))
    assert [type(say).__name__ for say in said] == ["ModeSet", "TextSaid", "ParameterSet", "LandedSet", "TextSaid"]


# --- whether the attitude is ready -----------------------------------------------------------------------------------

AHRS = 0x200000  # MAV_SYS_STATUS_AHRS


def ekf(flags: int) -> Any:
    return mavlink.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0)


def estimator(flags: int) -> Any:
    return mavlink.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0)


def status(present: int, enabled: int, health: int) -> Any:
    return mavlink.MAVLink_sys_status_message(present, enabled, health, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("messages", "expected"),
    [
        ([ekf(0), ekf(1024), ekf(1025), ekf(831), ekf(829)], [("EKF_STATUS_REPORT", r) for r in (False, True)]),
        ([estimator(0x33F), estimator(0x33E)], [("ESTIMATOR_STATUS", True), ("ESTIMATOR_STATUS", False)]),
        ([status(AHRS, AHRS, 0), status(AHRS, AHRS, AHRS | 1)], [("SYS_STATUS", False), ("SYS_STATUS", True)]),
        ([status(AHRS, 0, 0), status(0, AHRS, 1), status(1, 1, 3)], []),
    ],
    ids=["EKF_STATUS_REPORT", "ESTIMATOR_STATUS", "SYS_STATUS", "neither present nor enabled"],
)
def test_whether_the_attitude_is_ready(messages: list[Any], expected: list[tuple[str, bool]]) -> None:
    """By bit 0 and not bit 10 of the one, bit 0 of the other, and the health of AHRS: each told when it changes."""
    said = heard(Craft(also=[(0.5 + i, message) for i, message in enumerate(messages)]).records(8))
    assert [(say.source, say.ready) for say in said if isinstance(say, ReadySet)] == expected
