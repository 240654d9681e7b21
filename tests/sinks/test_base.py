"""What every sink is given, in which order, and what it costs where nobody takes it."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge.cli.live_sinks import LIVE_SINKS, plan_sinks
from gcs_bridge.errors import UsageError
from gcs_bridge.events import Event
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.observation import Observation
from gcs_bridge.mavlink.scanner import RawFrame
from gcs_bridge.recordings.check import check_file
from gcs_bridge.settings import Settings
from gcs_bridge.sinks.base import Sink, SinkContext, Sinks
from tests.helpers.live_links import fixture, tlog_of
from tests.helpers.paths import FIXTURES

RECORDING = FIXTURES / "f_reboot.tlog"


class Everything(Sink):
    """Keeps what it is given, and what kind each was."""

    def __init__(self) -> None:
        self.order: list[str] = []
        self.data: list[RawFrame] = []
        self.seen: list[Observation] = []
        self.told: list[Event] = []

    def frames(self, link: int | str, frames: Sequence[RawFrame]) -> None:
        self.order.append("frames")
        self.data += frames

    def observe(self, observation: Observation) -> None:
        self.order.append("observe")
        self.seen.append(observation)

    def events(self, events: Sequence[Event]) -> None:
        self.order.append("events")
        self.told += events


class EventsAlone(Sink):
    """Takes one kind of the three."""

    def __init__(self) -> None:
        self.told: list[Event] = []

    def events(self, events: Sequence[Event]) -> None:
        self.told += events


def context(stack: ExitStack, **more: Any) -> SinkContext:
    said: dict[str, Any] = {"title": "x", "links": ["udpin:0.0.0.0:1"], "note": pytest.fail, "complain": pytest.fail}
    return SinkContext(stack=stack, **said | more)


def test_a_recording_s_sinks_get_all_of_it() -> None:
    """Each sink of `check_file` gets frames, samples and events: those of the Monitor itself, in this order."""
    one, other = Everything(), EventsAlone()
    check_file(RECORDING, Settings(), sinks=[one, other])
    monitor = Monitor()
    told = monitor.feed_recording(RECORDING.read_bytes())
    assert one.told == other.told == told + monitor.finish()
    assert one.data == list(fixture("f_reboot"))
    assert sum(len(seen.segment.euler) for seen in one.seen) == sum(
        vehicle.streams["ATTITUDE"].count for vehicle in monitor.close().files[0].vehicles
    )
    assert one.order[0] == "frames"
    assert one.order[-1] == "events"
    assert one.order.index("observe") < one.order.index("events")


def test_a_batch_without_events_is_told_too() -> None:
    """By it a sink knows that a batch is over: what it keeps for an alarm's sake may go."""
    sink = Everything()
    sinks = Sinks([sink])
    monitor = Monitor(observer=sinks.observer)
    tlog = tlog_of(fixture("a_copter_square", to_s=2))
    for start in range(0, len(tlog), 100):
        sinks.events(monitor.feed_recording(tlog[start : start + 100]))
    assert sink.order.count("events") == -(-len(tlog) // 100) > len(sink.told)


def test_what_nobody_takes_costs_nothing() -> None:
    """A monitor copies frames and shows samples only where a sink has a method for them."""
    assert Sinks([]).observer is Sinks([EventsAlone()]).observer is None
    assert Sinks([]).on_frames is Sinks([EventsAlone()]).on_frames is None
    both = Sinks([EventsAlone(), Everything()])
    assert both.observer is not None
    assert both.on_frames is not None


def test_several_are_one() -> None:
    """One that failed, or is looked at, is enough."""

    class Failed(Sink):
        failed = property(lambda _: True)

    assert not Sinks([Sink()]).failed
    assert Sinks([Sink(), Failed()]).failed


def test_each_sink_of_the_table_opens_writes_and_closes(tmp_path: Path) -> None:
    """Of those that write files: appended at once, and given back at the end, twice if need be."""
    frames = fixture("a_copter_square", to_s=2)
    values = {"record": str(tmp_path / "a.tlog"), "events": str(tmp_path / "a.jsonl"), "viewer": "none"}
    assert set(values) == set(LIVE_SINKS)
    plans = plan_sinks(values)
    assert sorted(str(plan.writes) for plan in plans) == sorted([values["record"], values["events"]])
    with ExitStack() as stack:
        opened = [plan.open(context(stack)) for plan in plans]
        sinks = Sinks(opened)
        monitor = Monitor(on_frames=sinks.on_frames, observer=sinks.observer)
        told = monitor.feed_recording(tlog_of(frames))
        sinks.events(told)
        assert Path(values["record"]).read_bytes() == tlog_of(frames)
        assert Path(values["events"]).read_bytes().count(b"\n") == len(told) > 0
    assert not sinks.failed
    for sink in opened * 2:
        sink.close()


def test_two_sinks_do_not_write_one_file(tmp_path: Path) -> None:
    """Refused, whatever each is called there, before either is opened."""
    path = tmp_path / "a"
    with pytest.raises(UsageError, match="--record and --events cannot both write"):
        plan_sinks({"record": str(path), "events": str(tmp_path / "." / "a")})
    assert not path.exists()


def test_events_to_standard_output_take_it() -> None:
    """Then nothing else may be written there."""
    (plan,) = plan_sinks({"events": "-", "viewer": "none"})
    assert plan.takes_stdout
    assert plan.writes is None
