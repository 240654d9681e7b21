"""The same bytes give the same events and the same report, however they were cut and whichever way they came."""

import json
import math
import random
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from benchmarks.trust_links import staggered, untold
from gcs_bridge import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES as SITL
from tests.helpers.wire import records

ALL = sorted(path.stem for path in SITL.glob("*.tlog"))
# Recordings' telling parts: their bytes from and to, and what the events or the report of them must show.
TELLING = {
    "d_plane_pitchtrim3": (0, 6_000, '"pitch_trim"'),  # fitted
    "e_two_vehicles": (0, 6_000, '"estimator_reset", "vehicle": [2, 1]'),
    "f_reboot": (65_500, 72_000, '"reboot"'),
    "h_lossy_dirty": (0, 6_000, '"bad_crc": 2'),  # some twenty
    "k8_stream_stops": (130_500, 144_600, '"alarm_raised"'),  # 31 stops
    "k5_three_vehicles": (2_000, 9_500, '"vehicle_seen", "vehicle": [3, 1]'),  # of two firmwares
    "d_tailsitter": (84_500, 90_500, '"max": 90.0'),  # ATTITUDE shows another view from here on
    "b2_mixed_rates": (0, 6_000, '"same_instant": 0'),
    "k12_yaw_reset": (54_000, 63_500, '"estimator_reset"'),  # two of them
}

Json = dict[str, Any]


def recording(name: str) -> bytes:
    return (SITL / f"{name}.tlog").read_bytes()


def story(data: bytes, size: Callable[[], int]) -> tuple[str, str]:
    """Events and report, as JSON, of a recording fed in pieces."""
    monitor = Monitor()
    events: list[Json] = []
    at = 0
    while at < len(data):
        piece = data[at : at + size()]
        events += monitor.feed_recording(piece)
        at += len(piece)
    return json.dumps(events), json.dumps(monitor.close().to_dict())


def any_size(seed: str, most: int = 65536) -> Callable[[], int]:
    """Sizes at random, from one byte to `most`: as many small ones as large ones."""
    chance = random.Random(seed)
    return lambda: int(2 ** chance.uniform(0, math.log2(most)))


def live(frames: list[tuple[int, bytes]], *, datagrams: bool) -> tuple[list[Json], Json]:
    """Events and the link's entry of frames that come one a call."""
    monitor = Monitor()
    monitor.open_link(0, datagrams=datagrams)
    events = [event for t_us, frame in frames for event in monitor.feed(frame, t_us)]
    (entry,) = monitor.close().to_dict()["files"]
    return events, entry


def within(data: bytes, begin: int, end: int) -> list[tuple[int, bytes]]:
    """The records that begin between two places of an undamaged recording."""
    found, at = [], 0
    for t_us, frame in records(data):
        if begin <= at < end:
            found.append((t_us, frame))
        at += 8 + len(frame)
    return found


@pytest.mark.parametrize("name", one_in(12, ALL))
def test_cut_anywhere(name: str) -> None:
    """Whole or in pieces of any sizes: events and report are the same to the last bit."""
    data = recording(name)
    assert story(data, any_size(name)) == story(data, lambda: len(data))


@pytest.mark.parametrize("name", one_in(2, ["d_plane_pitchtrim3", "k5_three_vehicles"]))
def test_a_fit_by_neighbouring_instants_is_the_same_in_pieces(name: str) -> None:
    """Of trims that nobody tells, and of messages that never carry one stamp: all that is remembered counts, once."""
    data = staggered(untold(recording(name)))
    assert story(data, lambda: len(data)) == story(data, lambda: 3000)


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("name", TELLING)
def test_cut_into_single_bytes(name: str) -> None:
    """A recording's telling part, byte by byte, gives the events and the report of the whole part."""
    begin, end, shows = TELLING[name]
    part = recording(name)[begin:end]
    whole = story(part, lambda: len(part))
    assert story(part, lambda: 1) == whole
    assert shows in whole[0] + whole[1]


# What happens to a link, as made-up flights: (record time, frame).
at_ten_hz = partial(wire.flight, euler_hz=10.0, quaternion_hz=10.0)


def _reordered() -> list[tuple[int, bytes]]:
    flown = at_ten_hz(wire.Motion(8), 4)
    chance = random.Random(0)
    for at in chance.sample(range(0, len(flown) - 8, 4), 14):
        frames = [frame for _, frame in flown[at : at + 8]]
        chance.shuffle(frames)
        flown[at : at + 8] = [(t_us, frame) for (t_us, _), frame in zip(flown[at : at + 8], frames, strict=True)]
    return flown


def _two_fall_silent() -> list[tuple[int, bytes]]:
    flown = [r for sysid, compid in ((1, 1), (2, 0)) for r in at_ten_hz(wire.Motion(6), 2, sysid=sysid, compid=compid)]
    beats = [
        (wire.START_US + s * 1_000_000, wire.heartbeat(autopilot=8, vehicle=6, sysid=255, compid=190, seq=s))
        for s in range(9)
    ]
    return sorted(flown + beats, key=lambda record: record[0])


def _clock_steps() -> list[tuple[int, bytes]]:
    return at_ten_hz(wire.Motion(6), 2) + at_ten_hz(
        wire.Motion(6, seed=1), 4, boot_ms=112_000, start_us=wire.START_US + 2_000_000
    )


def _restart_after_a_silence() -> list[tuple[int, bytes]]:
    return at_ten_hz(wire.Motion(6), 2) + at_ten_hz(
        wire.Motion(6, seed=1), 4, boot_ms=500, start_us=wire.START_US + 15_000_000
    )


def _heartbeat_behind_the_attitudes() -> list[tuple[int, bytes]]:
    flown = [r for r in at_ten_hz(wire.Motion(8), 2) if r[1][7] != 0]  # byte 7 of a v2 frame: the message id
    return [*flown[:25], (flown[24][0], wire.heartbeat(seq=250)), *flown[25:]]


def _companion_behind_its_attitudes() -> list[tuple[int, bytes]]:
    flown = [r for r in at_ten_hz(wire.Motion(8), 2, compid=2) if r[1][7] != 0]
    beat = wire.heartbeat(autopilot=wire.NO_AUTOPILOT, vehicle=18, compid=2, seq=250)  # MAV_TYPE_ONBOARD_CONTROLLER
    return [*flown[:25], (flown[24][0], beat), *flown[25:]]


def _wrapped_clock() -> list[tuple[int, bytes]]:
    return at_ten_hz(wire.Motion(8), 3, boot_ms=2**32 - 1500)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("happening", "shows"),
    [
        (_reordered, '"vehicle_seen"'),
        (_two_fall_silent, '"vehicle_lost", "vehicle": [2, 0]'),
        (_clock_steps, '"clock_step"'),
        (_restart_after_a_silence, '"reboot"'),
        (_heartbeat_behind_the_attitudes, '"vehicle_seen"'),
        (_companion_behind_its_attitudes, '"vehicle_seen"'),
        (_wrapped_clock, '"last_boot_s": 42949'),
    ],
)
def test_cut_anywhere_whatever_happens(happening: Callable[[], list[tuple[int, bytes]]], shows: str) -> None:
    """What no recording here shows, told the same way whole and 37 bytes a piece: no two frames of it in one."""
    data = wire.tlog(happening())
    whole = story(data, lambda: len(data))
    assert story(data, lambda: 37) == whole
    assert shows in whole[0] + whole[1]


# What the sender gets wrong for ten seconds, so that its alarms are raised, asked about and, but for the last, cleared.
MISTAKES = [
    *("quaternion_conjugate", "yaw_offset:25", "time_skew", "quaternion_unnormalised", "frozen_euler", "euler_degrees"),
    *("mount_offset:0,0.4,0",),
]


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("fault", ["loss:0.2", "reorder:0.3", "duplicate:0.2", "corrupt:0.003", *MISTAKES])
def test_cut_anywhere_with_a_fault(fault: str) -> None:
    """A recording with a fault of the link or the sender is told the same way however it is cut."""
    from_s, to_s = (8.0, 18.0) if fault in MISTAKES else (None, None)
    data = inject(recording("c_copter_4hz"), [parse_fault(fault)], from_s=from_s, to_s=to_s)[:120_000]
    whole = story(data, lambda: len(data))
    assert story(data, any_size(fault, 8192)) == whole
    raised = [event for event in json.loads(whole[0]) if event["event"] == "alarm_raised"]
    assert bool(raised) == (fault in MISTAKES)
    assert fault not in MISTAKES or f'"cause": "{fault.partition(":")[0]}"' in whole[1]


@pytest.mark.slow
def test_cut_anywhere_without_times() -> None:
    """A stream without times is judged the same in any pieces, and as the recording was."""
    faulty = inject(recording("d_plane_pitchtrim3")[:100_000], [parse_fault("yaw_offset:25")], from_s=8.0)
    data = b"".join(frame for _, frame in records(faulty))

    def fed(size: int) -> tuple[list[Json], Json]:
        monitor = Monitor()
        events = [event for at in range(0, len(data), size) for event in monitor.feed(data[at : at + size], -1)]
        return events, monitor.close().to_dict()["files"][0]

    whole = fed(len(data))
    assert fed(613) == whole
    assert all(event["utc"] is None for event in whole[0])
    timed = json.loads(story(faulty, lambda: 65536)[1])["files"][0]
    assert whole[1]["vehicles"][0]["checks"] == timed["vehicles"][0]["checks"]
    (alarm,), (timed_alarm,) = whole[1]["vehicles"][0]["alarms"], timed["vehicles"][0]["alarms"]
    assert alarm == timed_alarm | {"raised_utc": None}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "datagrams"),
    one_in(3, [("d_plane_pitchtrim3", True), ("e_two_vehicles", True), ("f_reboot", True), ("k5_three_vehicles", True),
     ("k8_stream_stops", True), ("b2_mixed_rates", False), ("k12_yaw_reset", False), ("g_signed", False)]),
)  # fmt: skip
def test_live_as_recorded(name: str, datagrams: bool) -> None:
    """Frames that come one by one over a link, as a stream or as datagrams, are judged as their recording is."""
    begin, end, shows = TELLING.get(name, (0, 14_000, '"signed": 6'))
    frames = within(recording(name), begin, end)
    data = wire.tlog(frames)
    told, report = story(data, lambda: len(data))
    (recorded,) = json.loads(report)["files"]
    events, entry = live(frames, datagrams=datagrams)
    assert shows in told + report
    assert entry["vehicles"] == recorded["vehicles"]
    assert entry["verdict"] == recorded["verdict"]
    assert events == json.loads(told)


@pytest.mark.slow
def test_live_with_damage_is_as_recorded() -> None:
    """A link that corrupts bytes raises the same alarm, with the same peak, as the stream's recording."""
    faults = [parse_fault("yaw_offset:25"), parse_fault("loss:0.1")]
    data = inject(recording("c_copter_4hz"), faults, from_s=10.0)
    frames = list(records(data))[1000:1600]
    chance = np.random.default_rng(1)
    damaged = [
        (t_us, frame if chance.random() > 0.05 else frame[:9] + bytes([frame[9] ^ 0x55]) + frame[10:])
        for t_us, frame in frames
    ]
    (recorded,) = json.loads(story(wire.tlog(damaged), lambda: 65536)[1])["files"]
    for datagrams in (False, True):
        _, entry = live(damaged, datagrams=datagrams)
        assert entry["vehicles"][0]["alarms"] == recorded["vehicles"][0]["alarms"] != []
        assert entry["vehicles"][0]["checks"] == recorded["vehicles"][0]["checks"]


def test_a_cut_where_nothing_was_undone_yet() -> None:
    """A trim is told behind the cut: what came before it is the same to the last bit, `raw` included."""
    data = (SITL / "k16_plane_trim_changes.tlog").read_bytes()[:200_000]
    whole, cut = Monitor(), Monitor()
    whole.feed_recording(data)
    cut.feed_recording(data[:100_000])
    cut.feed_recording(data[100_000:])
    assert whole.close().to_dict() == cut.close().to_dict()
