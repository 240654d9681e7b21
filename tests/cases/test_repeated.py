"""Every frame twice on one link, or thrice: what came before counts once, and that is said."""

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from gcs_bridge import Monitor
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import ROOT

Record = tuple[int, bytes]
Json = dict[str, Any]
CASES = ROOT / "tests" / "data" / "cases"
SECONDS, HZ = 20.0, 20.0


@cache
def flight(version: int, numbered: bool) -> list[Record]:
    """As a vehicle sends it; many simple senders never count their frames."""
    motion = wire.Motion(SECONDS + 1, seed=1)
    if numbered:
        return wire.flight(motion, SECONDS, euler_hz=HZ, quaternion_hz=HZ, version=version)
    flown: list[Record] = []
    for t_us, _ in wire.flight(motion, SECONDS, euler_hz=HZ, quaternion_hz=0.0):
        ms = (t_us - wire.START_US) // 1000
        to: Json = {"seq": 0, "version": version}
        if ms % 1000 == 0 and (not flown or flown[-1][0] != t_us):
            flown.append((t_us, wire.heartbeat(**to)))
            continue
        rotation, rates = motion.rotation(ms / 1000), motion.rates(ms / 1000)
        flown.append((t_us, wire.attitude(10_000 + ms, rotation.as_euler("ZYX")[::-1], rates, **to)))
        flown.append((t_us, wire.attitude_quaternion(10_000 + ms, wire.wxyz(rotation), rates, **to)))
    return flown


def judged(data: bytes) -> tuple[Json, dict[str, Json], Json]:
    """What is said of the bytes, the vehicle's checks by name, and its streams."""
    monitor = Monitor()
    monitor.feed_recording(data)
    (entry,) = monitor.close().to_dict()["files"]
    (vehicle,) = entry["vehicles"]
    return entry["salvage"], {check["name"]: check for check in vehicle["checks"]}, vehicle["streams"]


@cache
def judged_once(version: int, numbered: bool) -> tuple[Json, dict[str, Json], Json]:
    return judged(wire.tlog(flight(version, numbered)))


def test_the_case() -> None:
    """600 pairs, not 1200; what is said of the streams is what came of the vehicle."""
    salvage, checks, streams = judged((CASES / "every_frame_twice.tlog").read_bytes())
    assert checks["euler_quaternion"]["pairs"] == 600
    assert {stream["count"] for stream in streams.values()} == {600}
    assert salvage["remarks"] == ["each frame came twice, by 1,1: it counts once"]


@pytest.mark.parametrize(
    ("times", "late_ms", "numbered", "version"),
    one_in(7, product([2, 3], [0, 1, 3, 20, 50], [False, True], [1, 2])),
)
def test_every_frame_again(times: int, late_ms: int, numbered: bool, version: int) -> None:
    """However late the copies are, and whether the frames are numbered or not."""
    flown = flight(version, numbered)
    _, once, streams = judged_once(version, numbered)
    copies = [(t_us + 1000 * late_ms * k, frame) for k in range(times) for t_us, frame in flown]
    salvage, checks, streams_again = judged(wire.tlog(sorted(copies, key=lambda one: one[0])))
    assert checks["euler_quaternion"]["pairs"] == once["euler_quaternion"]["pairs"] == round(SECONDS * HZ)
    assert {name: stream["count"] for name, stream in streams.items()} == {
        name: stream["count"] for name, stream in streams_again.items()
    }
    assert checks["euler_quaternion"]["verdict"] == "agree"
    said = "each frame came twice" if times == 2 else "each frame came 3 times"
    assert salvage["remarks"] == [f"{said}, by 1,1: it counts once"]


def test_some_frames_again() -> None:
    """Those count once too; not each came twice, so that is not said."""
    flown = flight(2, True)
    chance = np.random.default_rng(0)
    copies = [*flown, *((t_us + 5_000, frame) for t_us, frame in flown if chance.random() < 0.4)]
    salvage, checks, _ = judged(wire.tlog(sorted(copies, key=lambda one: one[0])))
    assert checks["euler_quaternion"]["pairs"] == round(SECONDS * HZ)
    assert salvage["duplicates"] == len(copies) - len(flown)
    assert "remarks" not in salvage


def test_a_gateway_s_copy_in_the_other_version() -> None:
    """The same frame as MAVLink 1 and as MAVLink 2 under one number is one."""
    motion = wire.Motion(SECONDS + 1, seed=1)
    both = [wire.flight(motion, SECONDS, euler_hz=HZ, quaternion_hz=0.0, version=version) for version in (1, 2)]
    _, checks, streams = judged(wire.tlog([one for pair in zip(*both, strict=True) for one in pair]))
    assert streams["ATTITUDE"]["count"] == round(SECONDS * HZ)
    assert checks["stream"]["verdict"] == "agree"


def test_what_says_the_same_is_no_copy_where_nothing_is_numbered() -> None:
    """Heartbeats, and a second estimate of a vehicle at rest, come again and again and say the same each time."""
    records = []
    for i in range(200):
        t_us = wire.START_US + 100_000 * i
        if i % 5 == 0:
            records.append((t_us, wire.heartbeat()))
        records.append((t_us, wire.attitude(10_000 + 100 * i, (0.0, 0.0, 0.1))))
        records.append((t_us + 1000, wire.ahrs2((0.0, 0.0, 0.1))))
    salvage, _, streams = judged(wire.tlog(records))
    assert salvage["duplicates"] == 0
    assert streams["AHRS2"]["count"] == 200
