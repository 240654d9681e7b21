"""This machine's clock is set while links are listened to, as where a companion computer learns the time."""

import socket
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge import Monitor
from gcs_bridge.links import wall_clock
from gcs_bridge.links.open import open_link
from gcs_bridge.links.uri import NetworkUri
from gcs_bridge.links.wall_clock import WallClock
from tests.helpers.everyday import one_in
from tests.helpers.live_links import Event, Live, fixture, frames_of, free_port, paced, recorder, tlog_of, wait_until

SPEED = 15.0
HOUR_S = 3600.0


class SetClock:
    """The machine's clocks, of which the wall clock can be set."""

    def __init__(self) -> None:
        self.ahead_s = 0.0

    def time_ns(self) -> int:
        return time.time_ns() + round(self.ahead_s * 1e9)

    def monotonic_ns(self) -> int:
        return time.monotonic_ns()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SetClock:
    stand_in = SetClock()
    monkeypatch.setattr(wall_clock, "time", stand_in)
    return stand_in


@pytest.fixture
def sender() -> Iterator[tuple[NetworkUri, socket.socket]]:
    """A link's URI, and what connects to it: over TCP the program itself tells when bytes came."""
    uri = NetworkUri("tcpin", "127.0.0.1", free_port(socket.SOCK_STREAM))
    with socket.socket() as sending:
        yield uri, sending


def alarms(events: Sequence[Event]) -> list[tuple[Any, ...]]:
    told = ("alarm_raised", "alarm_cleared")
    return [(event["event"], event["id"], event["boot_s"]) for event in events if event["event"] in told]


def test_a_step_is_told_once_and_a_nudge_not(clock: SetClock) -> None:
    """Forward and back; what clocks that are kept go apart is none."""
    watched = WallClock()
    assert watched.step_us() == 0
    for step_s in (HOUR_S, -2 * HOUR_S, -1.0, 0.5):
        clock.ahead_s += step_s
        assert watched.step_us() == pytest.approx(step_s * 1e6, abs=10_000)
        assert watched.step_us() == 0
    for _ in range(20):
        clock.ahead_s += 0.02
        assert watched.step_us() == 0


@pytest.mark.slow
@pytest.mark.parametrize("step_s", one_in(3, (HOUR_S, -5.0, -HOUR_S)))
def test_nothing_is_lost_and_the_alarms_are_right(
    step_s: float, clock: SetClock, sender: tuple[NetworkUri, socket.socket], tmp_path: Path
) -> None:
    """While the link is quiet for a moment: no silence is made of it, it is told once, and the recording has all."""
    frames = fixture("a_copter_square", from_s=75, to_s=84, fault="yaw_offset:25")
    wanted = alarms(Monitor().feed_recording(tlog_of(frames)))
    assert len(wanted) == 1
    uri, sending = sender
    path = tmp_path / "live.tlog"
    record = recorder(path)
    with Live(open_link(uri), on_frames=record.frames) as live:
        sending.connect((uri.host, uri.port))
        half = len(frames) // 2
        paced(frames[:half], sending.sendall, SPEED)
        wait_until(lambda: path.stat().st_size == len(tlog_of(frames[:half])))
        wait_until(lambda: live.names().count("stream_started") == 2)
        clock.ahead_s = step_s
        wait_until(lambda: len(live.notes) == 1)
        time.sleep(0.3)  # time passes once at least
        paced(frames[half:], sending.sendall, SPEED)
        wait_until(lambda: path.stat().st_size == len(tlog_of(frames)))
    record.close()
    recorded = frames_of(path.read_bytes())
    assert [frame.data for frame in recorded] == [frame.data for frame in frames]
    assert recorded[-1].t_rx_us - recorded[0].t_rx_us == pytest.approx(step_s * 1e6, abs=10e6)
    assert not {"stream_stale", "vehicle_lost", "reboot"} & set(live.names())
    assert alarms(live.events) == alarms(Monitor().feed_recording(path.read_bytes())) == wanted
    (note,) = live.notes
    assert note.startswith("this machine's clock was set ")


@pytest.mark.slow
def test_a_clock_set_back_hides_no_silence(clock: SetClock, sender: tuple[NetworkUri, socket.socket]) -> None:
    """Not for an hour: the streams are stale and the vehicle is lost as always."""
    uri, sending = sender
    with Live(open_link(uri)) as live:
        sending.connect((uri.host, uri.port))
        paced(fixture("a_copter_square", from_s=75, to_s=78), sending.sendall, SPEED)
        wait_until(lambda: live.names().count("stream_started") == 2)
        time.sleep(0.5)  # all has come
        clock.ahead_s = -HOUR_S
        wait_until(lambda: "vehicle_lost" in live.names(), 10)
    names = live.names()
    assert names.count("stream_stale") == 2
    assert names.index("stream_stale") < names.index("vehicle_lost")


@pytest.mark.slow
@pytest.mark.parametrize("step_s", one_in(7, (-5.0, -HOUR_S, -30.0, -0.5, 0.5, 5.0, HOUR_S)))
@pytest.mark.parametrize(("name", "start_s"), one_in(2, (("a_copter_square", 20), ("p_px4_quad_square", 0))))
def test_a_recording_across_a_step(name: str, start_s: float, step_s: float) -> None:
    """Its times jump with the clock: the alarm is the one that it would be, and no other."""
    frames = fixture(name, from_s=start_s, to_s=start_s + 15, fault="yaw_offset:25")
    half = len(frames) // 2
    later = [frame._replace(t_rx_us=frame.t_rx_us + round(step_s * 1e6)) for frame in frames[half:]]
    wanted = alarms(Monitor().feed_recording(tlog_of(frames)))
    assert len(wanted) == 1
    assert alarms(Monitor().feed_recording(tlog_of([*frames[:half], *later]))) == wanted
