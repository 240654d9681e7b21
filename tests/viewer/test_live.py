"""What is drawn while links are listened to."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs_bridge.cli import main
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.links.player import Player
from gcs_bridge.viewer.drawing import new_recording
from gcs_bridge.viewer.processes import free_port as free_viewer_port
from gcs_bridge.viewer.sink import RerunSink
from gcs_bridge.viewer.world import World
from tests.helpers import wire
from tests.helpers.live_links import fixture, free_port
from tests.helpers.viewer_tools import HEADLESS_PORT, Drawn, can_draw, headless


@pytest.mark.slow
def test_events_of_a_live_link_are_drawn_at_their_vehicle(tmp_path: Path) -> None:
    """The same vehicle on two links is drawn twice, each with its samples and its events, and there is no third."""
    frames = fixture("a_copter_square", from_s=75, to_s=77)
    ports = free_port(), free_port()
    path = tmp_path / "a.rrd"
    with Player(frames, ports[0]), Player(frames, ports[1]):
        uris = [f"udpin:127.0.0.1:{port}" for port in ports]
        assert main(["listen", *uris, "--duration", "1.5", "--viewer", f"save:{path}", "-q"]) == 0
    drawn = Drawn(path)
    entities = drawn.entities()
    assert {entity.split("/")[2] for entity in entities if entity.startswith("/vehicle/")} == {"1.1", "link1-1.1"}
    for vehicle in ("1.1", "link1-1.1"):
        assert len(drawn.rows(f"/vehicle/{vehicle}/body/quaternion", "Transform3D:quaternion")[0]) > 10
        _, texts = drawn.rows(f"/vehicle/{vehicle}/events", "TextLog:text", "utc")
        assert sum("vehicle seen" in text[0] for text in texts) == 1
    _, states = drawn.rows("/link/events", "TextLog:text", "utc")
    assert len(states) == 2


def drawn_live(path: Path, attitudes: dict[int, Rotation]) -> Drawn:
    """What is drawn of a live link: vehicles 1.1 and so on, each with one turning, its yaw 2° further each 20 ms."""
    recording = new_recording("by hand", live=True)
    recording.save(path)
    sink = RerunSink(World(recording, live=True))
    monitor = Monitor(observer=sink.observe)
    for i in range(60):
        ms, now = 1000 + 20 * i, wire.START_US + 20_000 * i
        for system, rotation in attitudes.items():
            yaw, pitch, roll = (Rotation.from_euler("Z", 2 * i, degrees=True) * rotation).as_euler("ZYX")
            x, y, z, w = Rotation.from_euler("ZYX", (yaw, pitch, roll)).as_quat()
            frames = [
                wire.attitude(ms, (roll, pitch, yaw), sysid=system, seq=i),
                wire.attitude_quaternion(ms, (w, x, y, z), sysid=system, seq=i),
            ]
            sink.events(monitor.feed(b"".join(frames), now))
    sink.close()
    recording.disconnect()
    return Drawn(path)


FLEET = {1: Rotation.from_euler("ZYX", (10, 20, 30), degrees=True), 2: Rotation.from_euler("X", -45, degrees=True)}


@pytest.mark.slow
def test_all_that_moves_on_a_live_link_is_told_at_one_entity(tmp_path: Path) -> None:
    """Of two vehicles each attitude at its time is SciPy's, and lies in the frame of its vehicle's body."""
    drawn = drawn_live(tmp_path / "a.rrd", FLEET)
    _, parents = drawn.numbers("/frames", "Transform3D:parent_frame")
    assert set(parents) == {f"tf#/vehicle/{system}.1/{part}" for system in FLEET for part in ("body", "horizon")}
    for system, rotation in FLEET.items():
        for source in ("euler", "quaternion"):
            boot_us, xyzw = drawn.moved(f"/vehicle/{system}.1/body/{source}", "Transform3D:quaternion")
            assert np.array_equal(boot_us, 1_000_000 + 20_000 * np.arange(60))
            turned = Rotation.from_euler("Z", 2 * np.arange(60)[:, None], degrees=True) * rotation
            assert (Rotation.from_quat(xyzw) * turned.inv()).magnitude().max() < 1e-5  # a float32 of the wire


@pytest.mark.slow
@can_draw
def test_the_viewer_turns_what_is_told_at_one_entity(tmp_path: Path) -> None:
    """Its own matrices are SciPy's, of each vehicle, at some instants; and the horizon's middle sinks nose up."""
    drawn_live(tmp_path / "a.rrd", FLEET)
    with headless(tmp_path / "a.rrd", free_viewer_port(HEADLESS_PORT)) as viewer:
        viewer.wait_for("boot", 2_180_000)
        for i in (5, 30, 59):
            viewer.go_to(1_000_000 + 20_000 * i)
            for system, rotation in FLEET.items():
                turned = Rotation.from_euler("Z", 2 * i, degrees=True) * rotation
                for source in ("euler", "quaternion"):
                    matrix = viewer.matrix(f"/vehicle/{system}.1/body/{source}")
                    assert matrix == pytest.approx(turned.as_matrix(), abs=1e-5)
        edge = viewer.edge("/vehicle/1.1/horizon/quaternion")
        assert edge["parent"] == "tf#/vehicle/1.1/horizon"
        at = np.array(edge["source"]["parent_from_child"])[:2, 3]
        assert at == pytest.approx([20 * np.sin(np.pi / 6), 20 * np.cos(np.pi / 6)], abs=0.2)
        assert viewer.errors() == []
