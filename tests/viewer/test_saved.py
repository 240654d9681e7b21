"""What is written into an .rrd: every sample, as it was sent, at its own times; read back by rerun's reader."""

import itertools
import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge.alarms.record import AlarmRecord
from gcs_bridge.cli import main
from gcs_bridge.contract import Severity
from gcs_bridge.events import AlarmCleared, AlarmEvent, AlarmRaised, head
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer import open_viewer
from gcs_bridge.viewer.drawing import new_recording
from gcs_bridge.viewer.sink import RerunSink
from gcs_bridge.viewer.world import World
from tests.helpers import wire
from tests.helpers.paths import FIXTURES
from tests.helpers.viewer_tools import Drawn, drawn, eventually, verify

LEVEL = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def said_by_pymavlink(path: Path) -> dict[str, list[Any]]:
    """The attitudes of a recording as pymavlink reads them, with their record times."""
    os.environ["MAVLINK20"] = "1"
    found: dict[str, list[Any]] = {"ATTITUDE": [], "ATTITUDE_QUATERNION": []}
    log = mavutil.mavlink_connection(str(path), dialect="all")
    while message := log.recv_match(type=list(found)):
        found[message.get_type()].append(message)
    log.close()
    return found


def written(records: list[tuple[int, bytes]], path: Path, pieces: int = 1) -> Drawn:
    """What is drawn of a recording of these records, fed in so many pieces."""
    return drawn(wire.tlog(records), path, pieces=pieces)[0]


@pytest.fixture(scope="module")
def acro(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording at 50 Hz as `replay` writes it."""
    path = tmp_path_factory.mktemp("acro") / "acro.rrd"
    assert main(["replay", str(FIXTURES / "b_copter_acro.tlog"), "--viewer", f"save:{path}", "-q"]) == 0
    return path


@pytest.mark.slow
def test_every_quaternion_of_a_50_hz_recording_is_written_as_sent(acro: Path) -> None:
    """One row a message, [x, y, z, w], to the last bit of the wire's float32, at its boot and its record time."""
    sent = said_by_pymavlink(FIXTURES / "b_copter_acro.tlog")["ATTITUDE_QUATERNION"]
    recording = Drawn(acro)
    boot_us, xyzw = recording.numbers("/vehicle/1.1/body/quaternion", "Transform3D:quaternion")
    assert len(sent) == len(xyzw) == 2049
    assert boot_us.tolist() == [1000 * message.time_boot_ms for message in sent]
    assert np.array_equal(xyzw, np.array([[m.q2, m.q3, m.q4, m.q1] for m in sent], np.float32))
    rx_us, _ = recording.rows("/vehicle/1.1/body/quaternion", "Transform3D:quaternion", "utc")
    assert np.abs(rx_us - np.array([1e6 * message._timestamp for message in sent])).max() <= 1


@pytest.mark.slow
def test_roll_pitch_and_yaw_are_written_as_sent_in_degrees(acro: Path) -> None:
    """The plots of the Euler angles show what ATTITUDE said, not what became of it."""
    sent = said_by_pymavlink(FIXTURES / "b_copter_acro.tlog")["ATTITUDE"]
    for name in ("roll", "pitch", "yaw"):
        boot_us, degrees = Drawn(acro).numbers(f"/vehicle/1.1/{name}/euler", "Scalars:scalars")
        is_gap = np.isnan(degrees)  # where the line would cross the plot
        assert is_gap.sum() < 0.02 * len(sent)
        boot_us, degrees = boot_us[~is_gap], degrees[~is_gap]
        assert boot_us.tolist() == [1000 * message.time_boot_ms for message in sent]
        assert degrees == pytest.approx([math.degrees(getattr(message, name)) for message in sent], abs=1e-9)


@pytest.mark.slow
def test_a_saved_recording_passes_reruns_own_check(acro: Path) -> None:
    """`rerun rrd verify` is content, and nothing but the file is left behind."""
    verify(acro)
    assert [path.name for path in acro.parent.iterdir()] == ["acro.rrd"]


@pytest.mark.slow
def test_the_disagreement_of_a_turned_quaternion_is_drawn_with_its_limit(tmp_path: Path) -> None:
    """Yaw 25° against yaw 0°: angle and heading 25°, tilt 0°, limit 0.52° at one instant; then an alarm, red."""
    turned = wire.wxyz(Rotation.from_euler("Z", 25, degrees=True))
    records = []
    for i in range(100):
        at = (wire.START_US + 40_000 * i, 1000 + 40 * i)
        records += [(at[0], wire.attitude(at[1], LEVEL)), (at[0], wire.attitude_quaternion(at[1], turned))]
    recording = written(records, tmp_path / "a.rrd")
    _, rows = recording.rows("/vehicle/1.1/disagreement", "Scalars:scalars")
    assert rows == [pytest.approx([25, 0.52, 0, 25], abs=1e-5)] * 100  # angle, limit, tilt, heading
    _, states = recording.rows("/vehicle/1.1/state", "StateChange:state")
    assert states == [["compared"], ["alarm"]]
    _, levels = recording.rows("/vehicle/1.1/events", "TextLog:level")
    assert [level for level in levels if level not in (["INFO"], ["…"])] == [["WARN"], ["CRITICAL"]]
    _, tags = recording.rows("/vehicle/1.1/body/name", "Points3D:labels")
    assert tags == [["1.1"], ["1.1 compared"], ["1.1 ALARM"]]


def moving(headings_deg: Any, force: Any) -> list[tuple[int, bytes]]:
    """A level vehicle of these headings at 25 Hz, and an accelerometer of one more second that feels `force`."""
    records = []
    for i in range(len(headings_deg) + 25):
        now_us, ms = wire.START_US + 40_000 * i, 1000 + 40 * i
        if i % 25 == 0:
            records.append((now_us, wire.heartbeat()))
        if i < len(headings_deg):
            turned = wire.wxyz(Rotation.from_euler("Z", headings_deg[i], degrees=True))
            records.append((now_us, wire.attitude_quaternion(ms, turned)))
        imu = mavlink.MAVLink_highres_imu_message(1000 * ms, *force(i), *[0] * 10, fields_updated=63)
        records.append((now_us, wire.pack(imu)))
    return records


def test_the_motion_is_drawn_with_units_and_bounds(tmp_path: Path) -> None:
    """Four seconds of rest, then 2 m/s² to the right for two: 4 m/s, 4 m, and bounds of 0.6 m/s and 0.6 m."""
    records = moving(np.full(152, 90.0), lambda i: (0, 2.0 if i > 100 else 0.0, -9.80665))
    recording = written(records, tmp_path / "a.rrd")
    motion = "/vehicle/1.1/motion"
    boot_us, acceleration = recording.rows(f"{motion}/acceleration_h_m_s2", "Scalars:scalars")
    assert boot_us.tolist() == [1_000_000 + 40_000 * i for i in range(152)]
    assert acceleration[151] == pytest.approx([0, 2, 0], abs=1e-5)
    _, velocity = recording.rows(f"{motion}/velocity_h_m_s", "Scalars:scalars")
    assert velocity[100] == [0, 0, 0, 0, 0]
    assert velocity[151] == pytest.approx([0, 4.04, 0, 0.612, -0.612], abs=1e-4)  # the step is a ramp of 0.04 s
    _, displacement = recording.rows(f"{motion}/displacement_h_m", "Scalars:scalars")
    assert displacement[151] == pytest.approx([0, 4.0805, 0, 0.624, -0.624], abs=1e-3)
    assert np.isnan(velocity[20]).all()  # before the first three seconds of rest nothing is known
    assert np.isnan(displacement[20]).all()


@pytest.mark.slow
def test_down_by_the_accelerometer_is_drawn_in_the_world(tmp_path: Path) -> None:
    """A level vehicle with its nose east feels as much force to its left as upwards: its down seems 45° to the south.

    Right of a nose that points east is south; the force to the left pulls a plumb line to the right.
    """
    recording = written(moving(np.full(50, 90.0), lambda i: (0, -9.8, -9.8)), tmp_path / "a.rrd")
    _, arrows = recording.numbers("/vehicle/1.1/body/down/accelerometer", "Arrows3D:vectors")
    assert len(arrows) == 50
    assert arrows == pytest.approx(np.tile(1.15 * np.array([-1, 0, 1]) / np.sqrt(2), (50, 1)), abs=1e-6)
    _, apart = recording.numbers("/vehicle/1.1/motion/down_apart_deg", "Scalars:scalars")
    assert apart == pytest.approx(45, abs=1e-4)


@pytest.mark.slow
def test_no_line_is_drawn_across_the_wrap_of_the_heading(tmp_path: Path) -> None:
    """From 3° over 0° to 357°: between the two lies a row that is no number, however the bytes were cut."""
    records = moving(3 - 0.5 * np.arange(100), lambda i: (0, 0, -9.80665))
    records = records[: -25 - 1]  # nothing comes behind the last attitude, and still it is drawn
    for pieces in (1, 60):
        recording = written(records, tmp_path / f"{pieces}.rrd", pieces=pieces)
        boot_us, heading = recording.numbers("/vehicle/1.1/motion/heading_deg", "Scalars:scalars")
        (gap,) = np.flatnonzero(np.isnan(heading))
        assert heading[gap - 1] == pytest.approx(0, abs=1e-5)
        assert heading[gap + 1] == pytest.approx(359.5, abs=1e-4)
        assert boot_us[gap - 1] < boot_us[gap] < boot_us[gap + 1]
        assert np.delete(heading, gap) == pytest.approx((3 - 0.5 * np.arange(100)) % 360, abs=1e-4)


@pytest.mark.slow
def test_each_boots_motion_is_drawn_to_its_end(tmp_path: Path) -> None:
    """Of the 597 RAW_IMU of a flight with a reboot, all are drawn but the last of each boot, behind all attitudes."""
    records = list(wire.records((FIXTURES / "f_reboot.tlog").read_bytes()))
    records.insert(0, (records[0][0], wire.heartbeat()))  # it tells the unit of RAW_IMU
    for pieces in (1, 40):
        recording = written(records, tmp_path / f"{pieces}.rrd", pieces)
        drawn_rows = [
            len(recording.rows("/vehicle/1.1/motion/acceleration_h_m_s2", "Scalars:scalars", timeline)[0])
            for timeline in ("boot", "boot_1")
        ]
        assert min(drawn_rows) > 200
        assert 595 <= sum(drawn_rows) <= 597


@pytest.mark.slow
def test_how_the_bytes_were_cut_does_not_change_what_is_drawn(tmp_path: Path) -> None:
    """A live link's short batches and a whole file give the same rows."""
    records = wire.flight(wire.Motion(6.0), 6.0, quaternion_hz=20.0)
    once, often = written(records, tmp_path / "once.rrd"), written(records, tmp_path / "often.rrd", pieces=250)
    for entity, component in (
        ("/vehicle/1.1/body/quaternion", "Transform3D:quaternion"),
        ("/vehicle/1.1/body/euler", "Transform3D:quaternion"),
        ("/vehicle/1.1/yaw/quaternion", "Scalars:scalars"),
        ("/vehicle/1.1/disagreement", "Scalars:scalars"),
    ):
        for timeline in ("boot", "utc"):
            times, values = once.rows(entity, component, timeline)
            times_often, values_often = often.rows(entity, component, timeline)
            assert len(values) > 100
            assert np.array_equal(times, times_often)
            assert np.array_equal(values, values_often, equal_nan=True)


@pytest.mark.slow
def test_live_attitudes_come_at_once_and_plots_soon(tmp_path: Path) -> None:
    """Of a live flight each attitude is there within 0.05 s, the plots within 0.4 s; all of them with the next event.

    However many batches bring them, they are drawn some twenty times a second.
    """
    path, told = tmp_path / "live.rrd", []
    recording = new_recording("by hand", live=True)
    recording.save(path)
    sink = RerunSink(World(recording, live=True))
    monitor = Monitor(observer=sink.observe)
    data = (FIXTURES / "b_copter_acro.tlog").read_bytes()[:120_000]
    for at in range(0, len(data), 600):
        told += monitor.feed_recording(data[at : at + 600])
        sink.events([])
    recording.flush()

    def seen() -> list[NDArray[np.int64]]:
        turns, _ = Drawn(path).moved("/vehicle/1.1/body/quaternion", "Transform3D:quaternion")
        boot_us, roll = Drawn(path).numbers("/vehicle/1.1/roll/quaternion", "Scalars:scalars")
        return [turns, boot_us[~np.isnan(roll)]]

    attitudes, plots = seen()
    sink.events(told[-1:])
    recording.flush()
    all_attitudes, all_plots = seen()
    assert len(all_attitudes) > 180
    assert 0 <= all_attitudes[-1] - attitudes[-1] <= 50_000
    assert 0 < len(attitudes) - len(plots) <= 20
    assert attitudes[-1] - plots[-1] <= 400_000
    np.testing.assert_array_equal(all_plots, all_attitudes)
    drawings = [one for one in Drawn(path)._chunks if one.entity_path == "/frames"]
    assert len(drawings) < 25 * (all_attitudes[-1] - all_attitudes[0]) / 1e6


def test_attitudes_that_are_none_are_left_out(tmp_path: Path) -> None:
    """A quaternion of zeros or with NaN would be drawn as something; it is not drawn at all."""
    bad = {3: (0.0,) * 4, 5: (math.nan, 0.0, 0.0, 1.0)}
    records = []
    for i in range(20):
        quaternion = wire.attitude_quaternion(1000 + 40 * i, bad.get(i, UPRIGHT))
        records += [(wire.START_US + 40_000 * i, frame) for frame in (wire.attitude(1000 + 40 * i, LEVEL), quaternion)]
    boot_us, _ = written(records, tmp_path / "a.rrd").rows("/vehicle/1.1/body/quaternion", "Transform3D:quaternion")
    assert boot_us.tolist() == [1_000_000 + 40_000 * i for i in range(20) if i not in bad]


def test_a_stream_without_times_is_drawn_on_the_boot_clock_alone(tmp_path: Path) -> None:
    """Where receive times are unknown there is no `utc`, rather than a wrong one."""
    source = tmp_path / "link.raw"
    source.write_bytes(b"".join(frame for _, frame in wire.flight(wire.Motion(3.0), 3.0)))
    assert main(["replay", str(source), "--viewer", f"save:{tmp_path / 'a.rrd'}", "-q"]) == 0
    recording = Drawn(tmp_path / "a.rrd")
    assert len(recording.rows("/vehicle/1.1/body/quaternion", "Transform3D:quaternion")[0]) == 75
    assert recording.timelines() == {"boot"}


def test_the_state_is_the_worst_that_is_raised(tmp_path: Path) -> None:
    """A warning and an alarm come and go: the worst of both is shown, and at last that all is compared."""
    story: list[tuple[type[AlarmEvent], str, Severity, str]] = [
        (AlarmRaised, "gravity-1", "warning", "warning"),
        (AlarmRaised, "euler-1", "alarm", "alarm"),
        (AlarmCleared, "gravity-1", "warning", "alarm"),
        (AlarmCleared, "euler-1", "alarm", "compared"),
    ]
    path = tmp_path / "a.rrd"
    with open_viewer(f"save:{path}", say=pytest.fail) as viewer:
        sink = viewer.recording("by hand")
        for second, (kind, alarm, severity, _) in enumerate(story):
            where = head(VehicleId(None, 1, 1), 0, 1_000_000 * second, -1, "gravity")
            record = AlarmRecord.new(
                alarm_id=alarm, check="gravity", severity=severity, boot=0, what="", is_not="", unit="deg"
            )
            sink.events([kind(**where, **record.told())])
        sink.finish()
    _, states = Drawn(path).rows("/vehicle/1.1/state", "StateChange:state")
    assert states == [[state] for *_, state in story]


@pytest.mark.slow
def test_each_boot_has_a_clock_of_its_own(tmp_path: Path) -> None:
    """After a reboot the boot time begins again: on one timeline both flights would lie over each other."""
    path = tmp_path / "a.rrd"
    assert main(["replay", str(FIXTURES / "f_reboot.tlog"), "--viewer", f"save:{path}", "-q"]) == 0
    recording = Drawn(path)
    assert recording.timelines() == {"boot", "boot_1", "utc"}
    entity = ("/vehicle/1.1/body/quaternion", "Transform3D:quaternion")
    first, second = recording.rows(*entity)[0], recording.rows(*entity, "boot_1")[0]
    assert first[0] > 60e6 > 5e6 > second[0]
    assert len(recording.rows(*entity, "utc")[0]) == len(first) + len(second)
    _, states = recording.rows("/vehicle/1.1/state", "StateChange:state", "utc")
    # Not while nothing comes, and again not from the estimator's first word that it is not ready to the one that it is.
    told = ["compared", "not compared", "compared", "not compared", "compared"]
    assert [state for (state,), _ in itertools.groupby(states)] == told


@pytest.mark.slow
def test_vehicles_stand_side_by_side(tmp_path: Path) -> None:
    """Each has its entities and a place of its own."""
    path = tmp_path / "a.rrd"
    assert main(["replay", str(FIXTURES / "e_two_vehicles.tlog"), "--viewer", f"save:{path}", "-q"]) == 0
    recording = Drawn(path)
    for system in (1, 2):
        assert len(recording.rows(f"/vehicle/{system}.1/body/euler", "Transform3D:quaternion", "utc")[0]) > 200
    assert {"/vehicle/1.1/body", "/vehicle/2.1/body", "/", "/axes"} <= recording.static()


@pytest.mark.slow
def test_a_killed_process_leaves_a_readable_file(tmp_path: Path) -> None:
    """Under a name that tells that it is a part: FILE.partial.rrd."""
    code = "from gcs_bridge.cli import main; import sys; sys.exit(main(sys.argv[1:]))"
    arguments = [str(FIXTURES / "b_copter_acro.tlog"), "--speed", "20", "--viewer", f"save:{tmp_path / 'a.rrd'}"]
    program = [sys.executable, "-c", code, "replay", *arguments]
    process = subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    part = tmp_path / "a.partial.rrd"
    eventually(lambda: part.exists() and part.stat().st_size > 600_000)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "a.rrd").exists()
    boot_us, _ = Drawn(part).rows("/vehicle/1.1/body/quaternion", "Transform3D:quaternion")
    assert 64 <= len(boot_us) < 2049
