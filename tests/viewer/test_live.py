"""What is drawn while links are listened to."""

from pathlib import Path

import pytest

from gcs_bridge.cli import main
from gcs_bridge.links.player import Player
from tests.helpers.live_links import fixture, free_port
from tests.helpers.viewer_tools import Drawn


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
