"""A viewer that does not keep up: what it cannot take is left out, told once, and drawn again once it can."""

from pathlib import Path
from typing import Any

import pytest

from gcs_bridge import Monitor
from gcs_bridge.viewer import pace
from gcs_bridge.viewer.drawing import new_recording
from gcs_bridge.viewer.pace import Pace
from gcs_bridge.viewer.sink import RerunSink
from gcs_bridge.viewer.world import World
from tests.helpers import wire
from tests.helpers.live_links import wait_until
from tests.helpers.viewer_tools import Drawn


class Served:
    """A recording that is served to somebody who reads, or does not."""

    def __init__(self) -> None:
        self.is_read = True
        self.flushes = 0

    def flush(self, *, timeout_sec: float) -> None:
        assert timeout_sec <= 2.0
        self.flushes += 1
        if not self.is_read:
            raise RuntimeError("Flush timed out - not all log messages were sent")


def test_it_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind, keeping up, and behind again."""
    monkeypatch.setattr(pace, "_EACH_S", 0.01)
    served: Any = Served()
    said: list[str] = []
    looking = Pace(served, said.append)
    for is_read in (False, True, False):
        served.is_read = is_read
        wait_until(lambda wanted=is_read: looking.is_kept is wanted)  # type: ignore[misc]
    looking.end()
    assert said == ["viewer: it reads too slowly; what it cannot take is left out of it"]


@pytest.mark.slow
def test_samples_are_left_out_and_drawn_again(tmp_path: Path) -> None:
    """Three seconds of a flight, of which the second is not drawn."""

    class Kept:
        is_kept = True

    kept: Any = Kept()
    recording = new_recording("pace", live=True)
    recording.save(tmp_path / "pace.rrd")
    sink = RerunSink(World(recording, live=True), pace=kept)
    monitor = Monitor(observer=sink.observe)
    flight = wire.flight(wire.Motion(3.0), 3.0)
    first_us = flight[0][0]
    for t_us, frame in flight:
        kept.is_kept = not 1e6 <= t_us - first_us < 2e6
        monitor.feed(frame, t_us)
        sink.events([])
    sink.close()
    recording.disconnect()
    times_us, _ = Drawn(tmp_path / "pace.rrd").moved("/vehicle/1.1/body/quaternion", "Transform3D:quaternion")
    gaps_us = times_us[1:] - times_us[:-1]
    assert len(times_us) > 20
    assert 0.8e6 < gaps_us.max() < 1.3e6
    assert sorted(gaps_us)[-2] < 0.2e6
