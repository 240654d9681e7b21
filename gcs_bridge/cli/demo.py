"""`gcs-bridge demo`: the whole live path with no hardware and no network: a recorded flight, and a fault half-way."""

from __future__ import annotations

import os
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_bridge.cli.live_run import LiveOptions, LiveRun, LiveTask, live_options, refuse_not_positive
from gcs_bridge.cli.terminal import complain
from gcs_bridge.events import AlarmRaised, Event
from gcs_bridge.sinks.base import Sink

if TYPE_CHECKING:  # loaded when there is something to play
    from gcs_bridge.mavlink.scanner import RawFrame

__all__ = ["demo"]

FAULT = "yaw_offset:25"
_MIDDLE_S = 80.0  # of the flight: the copter is flying the second side of its square, and turns
_GRACE_S = 0.3  # for the last frames to be judged


@click.command()
@click.option("--duration", "duration_s", type=float, default=40.0, metavar="S", help="End after S seconds.  [40]")
@click.option("--speed", type=float, default=1.0, metavar="X", help="Play X times as fast.  [1]")
@live_options
def demo(duration_s: float, speed: float, **options: Any) -> int:
    """Play a recorded flight through a UDP link of this machine; half-way its quaternion is turned by 25°.

    No hardware and no network are needed. It ends by itself; Ctrl-C ends it sooner.
    """
    refuse_not_positive("--duration", duration_s)
    refuse_not_positive("--speed", speed)
    run = LiveRun(LiveOptions.of(options))

    from gcs_bridge.links.open import open_link
    from gcs_bridge.links.player import Player
    from gcs_bridge.links.uri import NetworkUri
    from gcs_bridge.resources import demo_recording

    recording = demo_recording()
    frames, half_s = _flight(recording, duration_s * speed)
    lasts_s = (frames[-1].t_rx_us - frames[0].t_rx_us) / 1e6 / speed
    uri = NetworkUri("udpin", "127.0.0.1", _free_port())
    seen = _Raised()
    complain(
        f"a recorded flight plays for {lasts_s:.0f} s to {uri}; after {half_s / speed:.0f} s the fault {FAULT} is on",
        kind="note",
    )
    code = run.run(
        LiveTask(
            openers=[lambda: open_link(uri)],
            title="demo",
            duration_s=lasts_s + _GRACE_S,
            beside=lambda: Player(frames, uri.port, speed=speed),
            sinks=[seen],
        )
    )
    run.print_result(_what_was_seen(seen.alarms, _shown(recording)))
    return code


class _Raised(Sink):
    """Keeps what was told of alarms that were raised."""

    def __init__(self) -> None:
        self.alarms: list[AlarmRaised] = []

    def events(self, events: Sequence[Event]) -> None:
        self.alarms += [event for event in events if isinstance(event, AlarmRaised)]


def _flight(recording: Path, seconds: float) -> tuple[list[RawFrame], float]:
    """So much of the flight around its liveliest time, with the fault in its second half; and when that begins."""
    from gcs_bridge.mavlink.dialect import load_dialect
    from gcs_bridge.mavlink.scanner import Scanner
    from gcs_bridge.recordings.faults import parse_fault
    from gcs_bridge.recordings.inject import inject

    def frames_of(data: bytes) -> list[RawFrame]:
        scanner = Scanner(load_dialect(), timed=True)
        scanner.scan(data, final=True)
        return scanner.raw_frames()

    whole = frames_of(recording.read_bytes())
    first_us, last_us = whole[0].t_rx_us, whole[-1].t_rx_us
    latest_begin_us = max(last_us - round(seconds * 1e6), first_us)
    begin_us = min(max(first_us + round((_MIDDLE_S - seconds / 2) * 1e6), first_us), latest_begin_us)
    end_us = min(begin_us + round(seconds * 1e6), last_us)
    half_s = (end_us - begin_us) / 2e6
    cut = b"".join(
        frame.t_rx_us.to_bytes(8, "big") + frame.data for frame in whole if begin_us <= frame.t_rx_us <= end_us
    )
    return frames_of(inject(cut, [parse_fault(FAULT)], from_s=half_s)), half_s


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _what_was_seen(raised: list[AlarmRaised], recording: str) -> str:
    saw = "You saw a recorded flight, whose two attitudes are one"
    if raised:
        saw += f"; then the fault {FAULT} in its quaternion,\nand its alarm: a difference of {raised[0].peak:.3g}°."
    else:
        saw += ".\nThe fault was on for too short a time to raise its alarm: give it 10 s or more."
    return (
        f"\n{saw}\n"
        "Next, judge the recording itself, without the fault:\n"
        f"  gcs-bridge check {recording}\n"
        "or listen to a vehicle of your own:\n"
        "  gcs-bridge listen udpin:0.0.0.0:14550\n"
    )


def _shown(path: Path) -> str:
    """The path as somebody here would type it."""
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative
