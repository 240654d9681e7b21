"""Estimator resets: told once, in which stream order and at which rates they come, with what the vehicle said."""

from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge import Monitor
from tests.helpers.craft import BOOT_S, Change, Craft, State, rotvec, spinning, text, told, watched
from tests.helpers.everyday import searched
from tests.helpers.wire import tlog

Json = dict[str, Any]


def leap(at_s: float, deg: float = 21.7) -> Change:
    """The attitude leaps by this much yaw, and keeps it."""

    def change(t_s: float, state: State) -> State:
        return state._replace(rotation=rotvec(0, 0, deg) * state.rotation) if t_s >= at_s - 1e-9 else state

    return change


def resets(craft: Craft, seconds: float = 10.0) -> list[Json]:
    return told(watched(craft.records(seconds))[0], "estimator_reset")


def half(change: Change, phase: int) -> Change:
    """Every second sample alone."""
    return lambda t_s, state: change(t_s, state) if round(t_s * 20) % 2 == phase else None


@pytest.mark.parametrize("phase", [0, 1])
def test_streams_that_never_meet(phase: int) -> None:
    """Where the two streams come in turn, each shows the leap in a step of its own: still one reset."""
    craft = Craft(euler=half(leap(5), phase), quaternion=half(leap(5), 1 - phase))
    (reset,) = resets(craft)
    assert 5.0 <= round(reset["boot_s"] - BOOT_S, 6) <= 5.05
    assert reset["heading"] == pytest.approx(21.7, abs=0.3)


def test_streams_of_different_rates() -> None:
    """ATTITUDE at 20 Hz and the quaternion at 5 Hz: one reset."""
    slow: Change = lambda t_s, state: leap(5)(t_s, state) if round(t_s * 20) % 4 == 0 else None
    assert len(resets(Craft(euler=leap(5), quaternion=slow))) == 1


def test_leaps_of_the_two_streams_at_different_times() -> None:
    """The Euler angles leap at 4 s and the quaternion at 6 s: not one estimate, and no reset."""
    assert resets(Craft(euler=leap(4), quaternion=leap(6))) == []


def test_a_leap_back_is_another_reset() -> None:
    """20° there and, 2 s later, 20° back: two resets, of opposite heading."""

    def there_and_back(t_s: float, state: State) -> State:
        return state._replace(rotation=rotvec(0, 0, 20 if 5 <= t_s < 7 else 0) * state.rotation)

    found = resets(Craft(euler=there_and_back, quaternion=there_and_back))
    assert [event["heading"] for event in found] == pytest.approx([20, -20], abs=0.2)


def test_a_leap_at_the_very_end_waits_for_the_next_sample() -> None:
    """The last sample leaps: whether it does so alone nobody knows yet."""
    assert resets(Craft(euler=leap(9.95), quaternion=leap(9.95))) == []


def test_what_the_vehicle_said_of_it() -> None:
    """A text about the yaw and a change of the estimator's flags explain it; a text about the battery does not."""

    def ekf(flags: int) -> Any:
        return mavlink.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0)

    also = [(1.0, ekf(831)), (4.8, text("EKF3 IMU0 yaw aligned")), (4.85, text("Battery low")), (4.9, ekf(831 | 1024))]
    (reset,) = resets(Craft(euler=leap(5), quaternion=leap(5), also=also))
    assert "EKF3 IMU0 yaw aligned" in reset["explained_by"]
    assert any("EKF_STATUS_REPORT.flags 831 -> 1855" in said for said in reset["explained_by"])
    assert not any("Battery" in said for said in reset["explained_by"])


def test_a_text_of_long_ago_explains_nothing() -> None:
    """What was said a minute before a reset is not about it."""
    also = [(1.0, text("EKF3 IMU0 yaw aligned"))]
    (reset,) = resets(Craft(euler=leap(65), quaternion=leap(65), also=also, hz=10), 70)
    assert reset["explained_by"] == []


def test_a_reset_while_turning() -> None:
    """A leap of 21.7° at 60 °/s: the heading is that of the step, turn and leap together, and it is a reset."""
    (reset,) = resets(Craft(turn=spinning(deg_s=60), euler=leap(5), quaternion=leap(5)))
    assert reset["heading"] == pytest.approx(21.7 + 60 * 0.05, abs=0.1)


RECORDS = Craft(
    euler=lambda t_s, state: leap(4)(t_s, leap(1.5)(t_s, state)),
    quaternion=half(lambda t_s, state: leap(4)(t_s, leap(1.5)(t_s, state)), 0),
    also=[(1.4, text("yaw one")), (3.9, text("yaw two"))],
).records(6)
DATA = tlog(RECORDS)


def events_of(cuts: list[int]) -> list[Json]:
    monitor = Monitor()
    edges = sorted({0, len(DATA), *(cut % len(DATA) for cut in cuts)})
    pieces = [DATA[begin:end] for begin, end in pairwise(edges)]
    return [event for piece in pieces for event in monitor.feed_recording(piece)]


@pytest.mark.slow
@searched(20)
@given(cuts=st.lists(st.integers(0, 10**6), max_size=40))
def test_any_cutting_finds_the_same_resets(cuts: list[int]) -> None:
    """Cut anywhere, the same two resets are told with the same words."""
    events = events_of(cuts)
    assert len(told(events, "estimator_reset")) == 2
    assert events == events_of([])
