"""What a flight hands to the checks: one attitude, one inertial sensor on the vehicle's clock, where it may rest."""

import functools
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gcs_bridge import Monitor
from gcs_bridge.judging.observation import Observation
from tests.helpers.craft import (
    ARMED,
    BOOT_S,
    Change,
    Craft,
    Record,
    State,
    between,
    highres_imu,
    landed,
    nothing,
    raw_imu,
    scaled_imu,
    spinning,
    true,
    velocity,
    with_norm,
)
from tests.helpers.everyday import searched
from tests.helpers.wire import PX4, tlog

Array = NDArray[np.float64]


def observed(records: Sequence[Record], cuts: Sequence[int] = ()) -> list[Observation]:
    """What each batch showed."""
    data = tlog(records)
    seen: list[Observation] = []
    monitor = Monitor(observer=seen.append)
    edges = sorted({0, len(data), *(cut % len(data) for cut in cuts)})
    for begin, end in pairwise(edges):
        monitor.feed_recording(data[begin:end])
    return seen


def attitudes(craft: Craft, seconds: float) -> tuple[Array, Array]:
    """Times, in seconds of flight, and rows of the one attitude."""
    tracks = [seen.flight.attitude for seen in observed(craft.records(seconds))]
    times = np.concatenate([track.t_us for track in tracks]) / 1e6 - BOOT_S
    return times, np.concatenate([track.rows for track in tracks])


# --- one attitude ----------------------------------------------------------------------------------------------------


def marked(_: float, state: State) -> State:
    """The Euler angles' own rates, by which they can be told from the quaternion."""
    return state._replace(rates=np.array([0.5, 0, 0]))


def sources(craft: Craft, seconds: float) -> list[tuple[float, str]]:
    """Where the one attitude changes its source."""
    times, rows = attitudes(craft, seconds)
    names = ["euler" if rates[0] == 0.5 else "quaternion" for rates in rows[:, 4:]]
    return [
        (round(t, 3), name)
        for i, (t, name) in enumerate(zip(times, names, strict=True))
        if i == 0 or names[i - 1] != name
    ]


def test_the_quaternion_is_the_one_attitude() -> None:
    """While both come, the quaternion is taken and the Euler angles are not, but for the first."""
    found = sources(Craft(euler=marked), 3)
    assert found[-1][1] == "quaternion"
    assert found[-1][0] <= 0.05


def test_the_euler_angles_stand_in() -> None:
    """The quaternion is last heard at 1.95 s: from 2.95 s on the Euler angles stand in, until it is back at 5 s."""
    found = sources(Craft(euler=marked, quaternion=between(2, 5, nothing)), 7)
    assert found[-3:] == [(found[-3][0], "quaternion"), (2.95, "euler"), (5.0, "quaternion")]


def test_the_euler_angles_alone() -> None:
    """Where the quaternion never comes, or is never valid, every Euler attitude is taken."""
    for quaternion in (None, with_norm(0.0)):
        times, rows = attitudes(Craft(euler=marked, quaternion=quaternion), 2)
        assert len(times) == 40
        assert (rows[:, 4] == 0.5).all()


# --- one inertial sensor ---------------------------------------------------------------------------------------------


def imu_of(records: Sequence[Record], cuts: Sequence[int] = ()) -> tuple[list[str], Array, Array]:
    """Sources of the chosen samples, their times in seconds of flight, and their rates."""
    parts = [seen.flight.imu for seen in observed(records, cuts)]
    samples = [part for part in parts if part is not None]
    names = [sample.source for sample in samples for _ in range(len(sample))]
    times = np.concatenate([sample.t_boot_us for sample in samples]) / 1e6 - BOOT_S
    return names, times, np.concatenate([sample.w_b_rad_s for sample in samples])


def also(make: Callable[[int, State], Any], begin_s: float, end_s: float, rate: float) -> list[tuple[float, Any]]:
    """A second IMU at 10 Hz, which is known by the rate about x that it tells."""
    state = Craft().state(0.0)._replace(rates=np.array([rate, 0, 0]))
    times = np.arange(begin_s, end_s, 0.1).round(3)
    return [(float(t_s), make(round(1000 * (BOOT_S + t_s)), state)) for t_s in times]


@pytest.mark.slow
@pytest.mark.parametrize("cuts", [[], list(range(0, 40_000, 97))], ids=["whole", "in pieces"])
def test_the_best_sensor_that_was_heard(cuts: list[int]) -> None:
    """SCALED_IMU is taken until HIGHRES_IMU comes at 2 s, which then stays, even if it is gone at 4 s."""
    craft = Craft(imu=true, imu_message=scaled_imu, also=also(highres_imu, 2, 4, 0.25), hz=10)
    _, times, rates = imu_of(craft.records(6), cuts)
    second = rates[:, 0] == 0.25
    assert times[~second].max() == pytest.approx(1.9)
    assert times[second].min() == pytest.approx(2.0)
    assert len(times) == 20 + 20


def test_a_worse_sensor_is_not_taken() -> None:
    """RAW_IMU comes from the start and SCALED_IMU2 later: the second is passed over."""
    _, _, rates = imu_of(Craft(imu=true, also=also(scaled_imu, 1, 2, 0.25), hz=10).records(3))
    assert len(rates) == 30
    assert not (rates[:, 0] == 0.25).any()


# --- its clock -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "offset_us", [0, 7_000_000, -3_000_000, 1_700_000_000_000_000], ids=["boot", "+7", "-3", "unix"]
)
def test_a_clock_of_its_own(offset_us: int) -> None:
    """`time_usec` may count from boot, from somewhere else or from 1970: mapped, it is right to half a sample."""
    message = lambda ms, state: raw_imu(ms, state, clock_us=offset_us)
    _, times, _ = imu_of(Craft(imu=true, imu_message=message).records(10))
    np.testing.assert_allclose(times, np.arange(200) / 20, atol=0.001 if offset_us == 0 else 0.025)


def test_a_clock_that_is_the_vehicle_s_own_is_not_touched() -> None:
    """Stamps of the boot clock that came late, within the messages around them, stay what they are."""
    late: Change = lambda t_s, state: raw_imu(round(1000 * (BOOT_S + t_s)) - 1, state)
    _, times, _ = imu_of(Craft(imu=late).records(5))
    np.testing.assert_allclose(times, np.arange(100) / 20 - 0.001, atol=1e-9)


JITTERED = Craft(
    turn=spinning(deg_s=20),
    imu=lambda t_s, state: raw_imu(round(1000 * (BOOT_S + t_s + 0.02 * np.sin(40 * t_s))), state, clock_us=123_456_789),
    also=[(0.3, landed(1)), (0.6, landed(2)), *((0.1 * i, velocity(10_000 + 100 * i, 0.1 * i)) for i in range(15))],
    base_mode=ARMED,
    autopilot=PX4,
).records(2)
SIZE = len(tlog(JITTERED))


def columns(cuts: Sequence[int]) -> list[bytes]:
    """Everything that a flight hands on, column by column over all batches."""
    seen = [one.flight for one in observed(JITTERED, cuts)]
    imu = [flight.imu for flight in seen if flight.imu is not None]
    parts: list[list[NDArray[Any]]] = [
        [flight.attitude.t_us for flight in seen],
        [flight.attitude.frame_index for flight in seen],
        [flight.attitude.rows for flight in seen],
        [samples.may_rest for samples in imu],
        [samples.stands for samples in imu],
        [samples.trim_b_rad for samples in imu],
        [samples.t_boot_us for samples in imu],
        [samples.f_b_m_s2 for samples in imu],
        [samples.w_b_rad_s for samples in imu],
    ]
    return [np.concatenate(part).tobytes() for part in parts]


@pytest.mark.slow
@searched(25)
@given(cuts=st.lists(st.integers(0, SIZE), max_size=60))
def test_any_cutting_hands_on_the_same(cuts: list[int]) -> None:
    """Attitudes, inertial samples, their mapped times and where it may rest are the same bits, however it is cut."""
    assert columns(cuts) == whole_columns()


@functools.cache
def whole_columns() -> list[bytes]:
    return columns([])


# --- where it may rest -----------------------------------------------------------------------------------------------


def rests(seconds: float = 4.0, **said: Any) -> tuple[Array, Array]:
    """Where the vehicle may rest, and where it stands, at each of 10 samples a second."""
    seen = [one.flight.imu for one in observed(Craft(**{"imu": true, "hz": 10, **said}).records(seconds))]
    imu = [samples for samples in seen if samples is not None]
    return np.concatenate([samples.may_rest for samples in imu]), np.concatenate([samples.stands for samples in imu])


def test_disarmed_or_landed_it_stands() -> None:
    """A disarmed vehicle stands; an armed one where it says that it has landed, from that message on."""
    assert all(mask.all() for mask in rests())
    assert not any(mask.any() for mask in rests(base_mode=ARMED))
    for mask in rests(base_mode=ARMED, also=[(1.0, landed(1)), (2.0, landed(2))]):
        assert mask.tolist() == [10 <= i < 20 for i in range(40)]


def test_at_constant_speed_it_may_rest_and_does_not_stand() -> None:
    """An armed vehicle whose velocity changes by less than 0.3 m/s² may rest, but that is not standing."""
    speeds = [(i / 10, velocity(10_000 + 100 * i, 0.029 * i if i < 20 else 0.031 * i)) for i in range(40)]
    may_rest, stands = rests(base_mode=ARMED, also=speeds)
    assert may_rest.tolist() == [1 <= i < 20 for i in range(40)]  # the first message alone tells no change
    assert not stands.any()


def test_a_velocity_of_long_ago_tells_nothing() -> None:
    """Between two velocities 2.1 s apart no acceleration is known; between two 2 s apart it is."""
    for gap_s, known in ((2.0, True), (2.1, False)):
        also = [(t_s, velocity(round(1000 * (BOOT_S + t_s)), 5.0)) for t_s in (0.5, 0.5 + gap_s)]
        may_rest, _ = rests(base_mode=ARMED, also=also)
        assert may_rest[30:].all() == known


def test_where_nothing_is_known() -> None:
    """A vehicle of which neither arming nor landing nor speed is known may rest and may stand."""
    assert all(mask.all() for mask in rests(beats=False, imu_message=scaled_imu))
