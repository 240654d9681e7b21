"""What the tests' own helpers compute, against SciPy, and what they pack, against pymavlink."""

import math
from collections.abc import Callable
from contextlib import closing
from itertools import count
from typing import Any

import hypothesis
import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from tests.helpers import craft, wire
from tests.helpers.craft import State
from tests.helpers.everyday import ALL_CASES, one_in, searched
from tests.helpers.paths import FIXTURES
from tests.helpers.turn import Turn


def test_turns_are_scipys() -> None:
    """Made of vectors, also tiny ones, and of angles; turned one after the other, back, and vectors by them."""
    random = np.random.default_rng(1)
    vectors = random.uniform(-2.5, 2.5, (100, 3)) * random.choice([1e-14, 1e-3, 1.0], (100, 1))
    rpy_deg = random.uniform((-180, -89, -180), (180, 89, 180), (100, 3))
    turned, scipys = [], []
    for rotvec, (roll, pitch, yaw), force in zip(vectors, rpy_deg, random.normal(size=(100, 3)), strict=True):
        turn = Turn.from_rpy_deg(roll, pitch, yaw) * Turn.from_rotvec(rotvec)
        scipy = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True) * Rotation.from_rotvec(rotvec)
        turned.append([*turn, *turn.rpy_rad(), *turn.apply(force), *turn.inv().apply(force)])
        w_last = scipy.as_quat()
        scipys.append(
            [w_last[3], *w_last[:3], *scipy.as_euler("ZYX")[::-1], *scipy.apply(force), *scipy.inv().apply(force)]
        )
    found, expected = np.array(turned), np.array(scipys)
    expected[:, :4] *= np.sign((found[:, :4] * expected[:, :4]).sum(axis=1, keepdims=True))  # q and −q are one turn
    np.testing.assert_allclose(found, expected, atol=1e-12)


NUMBERS = (0.1, -0.2, 3.0, 0.25, -1e-6, 1e9, 0.5)
ZEROS = (0.0,) * 7
MESSAGES: dict[str, Callable[[Any], Any]] = {
    "ATTITUDE": lambda n: mavlink.MAVLink_attitude_message(4_000_000_000, *n[:6]),
    "ATTITUDE_QUATERNION": lambda n: mavlink.MAVLink_attitude_quaternion_message(70_000, *n, [1, 0, 0, 0]),
    "AHRS2": lambda n: mavlink.MAVLink_ahrs2_message(*n[:3], 0, 0, 0),
    "UAVCAN_NODE_STATUS": lambda _: mavlink.MAVLink_uavcan_node_status_message(7, 8, 1, 2, 3, 0),  # an id above 255
    "EXTENDED_SYS_STATE": lambda _: mavlink.MAVLink_extended_sys_state_message(0, 0),
}


@pytest.mark.parametrize("key", [None, bytes(range(32))])
@pytest.mark.parametrize("numbers", [NUMBERS, ZEROS, (math.nan, math.inf, *ZEROS[2:])])
@pytest.mark.parametrize("name", MESSAGES)
def test_a_packed_message_is_framed_as_pymavlink_frames_it(
    name: str, numbers: tuple[float, ...], key: bytes | None
) -> None:
    """Zeros at the end, also nothing but zeros, ids above 255; signed, and as MAVLink 1 where an id fits into that."""
    message = MESSAGES[name](numbers)
    expected = wire.pack(message, seq=300, sysid=200, compid=7, key=key)
    signature = 13 if key is not None else 0
    told = expected[10 : 10 + expected[1]]
    assert len(expected) == 12 + len(told) + signature
    short = wire.Packed(type(message), told.ljust(message.unpacker.size, b"\0"))
    assert wire.pack(short, seq=300, sysid=200, compid=7, key=key) == expected
    if message.id < 256:
        as_1: dict[str, Any] = {"seq": 255, "sysid": 1, "compid": 190, "version": 1, "key": key}
        assert wire.pack(short, **as_1) == wire.pack(message, **as_1)


def test_attitudes_are_packed_as_pymavlink_packs_them() -> None:
    """The helpers' own messages, field by field; stamps begin anew behind 32 bits."""
    rpy, q, rates = (0.1, -0.2, 3.0), (0.5, -0.5, 0.25, 1.0), (1.0, -2.0, 0.0)
    begun = 2**32 + 5
    pairs: list[tuple[bytes, Any]] = [
        (wire.attitude(begun, rpy, rates), mavlink.MAVLink_attitude_message(5, *rpy, *rates)),
        (wire.ahrs2(rpy), mavlink.MAVLink_ahrs2_message(*rpy, 0, 0, 0)),
        (
            wire.attitude_quaternion(begun, q, rates, (1, 2, 3, 4)),
            mavlink.MAVLink_attitude_quaternion_message(5, *q, *rates, [1, 2, 3, 4]),
        ),
    ]
    for ours, message in pairs:
        assert ours == wire.pack(message)


def test_a_craft_s_messages_are_packed_as_pymavlink_packs_them() -> None:
    """Each from one state; the IMU's counts start anew beyond their 16 bits."""
    turn = Turn.from_rpy_deg(170.0, -80.0, 100.0)
    told = State(turn, np.array([1.0, -2.0, 40.0]), np.array([9.8, -400.0, 0.123]), 0.75)
    q = [0.75 * part for part in turn]
    north = turn.inv().apply([1.0, 0.0, 0.0])
    exact = [*(1000 * told.force / craft.G_M_S2), 1000.0, -2000.0, 40_000.0, *(400 * north)]
    counts = np.rint(exact).astype(np.int64).astype(np.int16).tolist()
    assert counts[1] == -40_789 + 2**16
    floats = (*told.force, *told.rates, *(0.4 * north))
    expected: list[tuple[Any, Any]] = [
        (craft.attitude, mavlink.MAVLink_attitude_message(7, *turn.rpy_rad(), *told.rates)),
        (craft.attitude_quaternion, mavlink.MAVLink_attitude_quaternion_message(7, *q, *told.rates, [0, 0, 0, 0])),
        (craft.ahrs2, mavlink.MAVLink_ahrs2_message(*turn.rpy_rad(), 0, 0, 0)),
        (craft.raw_imu, mavlink.MAVLink_raw_imu_message(7000, *counts)),
        (craft.scaled_imu, mavlink.MAVLink_scaled_imu_message(7, *counts)),
        (craft.highres_imu, mavlink.MAVLink_highres_imu_message(7000, *floats, 0, 0, 0, 20, 63)),
    ]
    for make, message in expected:
        assert wire.pack(make(7, told)) == wire.pack(message)


def test_a_search_keeps_its_share_of_the_cases() -> None:
    """All of its own where all of Hypothesis's are tried, a third elsewhere, one at least; other settings are kept."""
    tried = hypothesis.settings().max_examples
    assert tried in (ALL_CASES, ALL_CASES // 3)
    assert searched(3 * ALL_CASES).max_examples == 3 * tried
    assert searched(1).max_examples == 1
    assert searched(60, print_blob=True).print_blob
    assert searched(60).deadline is None


def test_of_a_family_some_are_for_every_day() -> None:
    """The first of each `n`; the others are slow, and left to sweeps unless each shows something else."""
    for swept, rest in ((True, {"slow", "sweep"}), (False, {"slow"})):
        marks = [{mark.name for mark in case.marks} for case in one_in(3, range(7), swept=swept)]
        assert marks == [set(), rest, rest, set(), rest, rest, set()]
    assert [case.values for case in one_in(2, [(1, "a"), (2, "b")])] == [(1, "a"), (2, "b")]


@pytest.mark.parametrize("name", ["g_mavlink1", "g_signed"])
def test_messages_are_those_that_pymavlink_reads(name: str) -> None:
    """Of the names asked for, in order, with their record times and their numbers among all."""
    names = ("HEARTBEAT", "ATTITUDE")
    expected = []
    with closing(mavutil.mavlink_connection(str(FIXTURES / f"{name}.tlog"), dialect="all")) as log:
        for number in count():
            if (message := log.recv_msg()) is None:
                break
            if message.get_type() in names:
                expected.append((number, round(message._timestamp * 1e6), message.to_dict()))
    found = wire.messages((FIXTURES / f"{name}.tlog").read_bytes(), *names)
    read = [(number, t_us, message.to_dict()) for number, t_us, message in found]
    assert [one[0::2] for one in read] == [one[0::2] for one in expected]
    assert [one[1] for one in read] == pytest.approx([one[1] for one in expected], abs=1)
    assert len(read) > 100
