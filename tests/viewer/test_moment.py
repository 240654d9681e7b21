"""The .rrd beside an alarm's evidence: the ten seconds on both sides, and what is seen when it opens."""

from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_bridge.cli import main
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.viewer.processes import free_port
from tests.helpers import wire
from tests.helpers.paths import FIXTURES
from tests.helpers.viewer_tools import HEADLESS_PORT, Drawn, can_draw, eventually, headless, verify


@pytest.fixture(scope="module")
def moment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a quaternion that is turned by 25° from 110 s on, 10 s before the recording's end."""
    folder = tmp_path_factory.mktemp("moment")
    data = inject((FIXTURES / "a_copter_square.tlog").read_bytes(), [parse_fault("yaw_offset:25")], from_s=110.0)
    (folder / "a.tlog").write_bytes(data)
    assert main(["check", str(folder / "a.tlog"), "--evidence", str(folder / "e"), "-q"]) == 1
    return folder / "e" / "a" / "1.1-euler_quaternion-0-1" / "moment.rrd"


@pytest.mark.slow
def test_the_file_holds_the_moment(moment: Path) -> None:
    """Rerun's own check is content; the rows are those of pymavlink within 10 s; the alarm is in the log."""
    verify(moment)
    drawn = Drawn(moment)
    frames = [mavlink.MAVLink(None).parse_char(f) for _, f in wire.records((moment.parents[3] / "a.tlog").read_bytes())]
    boot_us, xyzw = drawn.numbers("/vehicle/1.1/body/quaternion", "Transform3D:quaternion")
    times, levels = drawn.rows("/vehicle/1.1/events", "TextLog:level")
    (raised_us, *_) = [time for time, level in zip(times.tolist(), levels, strict=True) if level == ["CRITICAL"]]
    sent = [
        m
        for m in frames
        if m.get_type() == "ATTITUDE_QUATERNION" and abs(1000 * m.time_boot_ms - raised_us) <= 10_000_000
    ]
    assert boot_us.tolist() == [1000 * m.time_boot_ms for m in sent]
    assert np.array_equal(xyzw, np.array([[m.q2, m.q3, m.q4, m.q1] for m in sent], np.float32))
    _, disagreement = drawn.rows("/vehicle/1.1/disagreement", "Scalars:scalars")
    assert disagreement[-1] == pytest.approx([25, 0.52, 0, 25], abs=1e-3)


@pytest.mark.slow
@can_draw
def test_it_opens_on_the_moment(moment: Path) -> None:
    """On the boot clock, with the cursor where the fault is seen: the solid body 25° to the right of the outline."""
    with headless(moment, free_port(HEADLESS_PORT)) as viewer:

        def turn(name: str) -> np.ndarray:
            return np.array(viewer.edge(f"/vehicle/1.1/body/{name}")["source"]["parent_from_child"])[:3, :3]

        def opened() -> bool:  # what has come has no timeline, then no time, then no bodies until it is shown
            recording = viewer.wait_for("boot", 120_000_000)
            assert recording.current_timeline == "boot"
            assert recording.current_time >= 112_060_000_000
            apart = np.degrees(np.arccos((np.trace(turn("euler").T @ turn("quaternion")) - 1) / 2))
            assert apart == pytest.approx(25.0, abs=0.05)
            return True

        assert eventually(opened)
        assert not viewer.errors()


@pytest.mark.slow
def test_the_mistake_is_undone_in_it_as_in_the_whole_recording(tmp_path: Path) -> None:
    """Roll of the wrong sign in a plane whose pitch trim changes after the alarm: both are undone there as here."""
    data = inject((FIXTURES / "k16_plane_trim_changes.tlog").read_bytes(), [parse_fault("roll_sign")], from_s=20.0)
    source = tmp_path / "a.tlog"
    source.write_bytes(data)
    assert main(["check", str(source), "--evidence", str(tmp_path / "e"), "-q"]) == 1
    assert main(["replay", str(source), "--viewer", f"save:{tmp_path / 'a.rrd'}", "-q"]) == 0
    cut = Drawn(tmp_path / "e" / "a" / "1.1-euler_quaternion-0-1" / "moment.rrd")
    whole = Drawn(tmp_path / "a.rrd")
    entity = ("/vehicle/1.1/body/corrected", "Transform3D:quaternion")
    boot_us, xyzw = cut.numbers(*entity)
    whole_us, whole_xyzw = whole.numbers(*entity)
    assert len(boot_us) > 200
    assert np.array_equal(xyzw, whole_xyzw[np.isin(whole_us, boot_us)])
