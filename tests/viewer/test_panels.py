"""What the panels beside the scene show: numbers worked out by hand or by SciPy, read back by rerun's reader."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge.mavlink.modes import mode_name
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.viewer.horizon import horizon_poses
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES
from tests.helpers.viewer_tools import Drawn, drawn

Records = list[tuple[int, bytes]]
SCALARS, STATES = "Scalars:scalars", "StateChange:state"
VEHICLE = "/vehicle/1.1"
QUATERNION_ID = 31


def written(records: Records, path: Path, pieces: int = 1) -> Drawn:
    return drawn(wire.tlog(records), path, pieces=pieces)[0]


def turning(rpy_deg: Any, turn: Rotation | None = None) -> Records:
    """Both forms of angles (n, 3) at 25 Hz from 1 s on, the quaternion turned from the left; a heartbeat a second."""
    records: Records = []
    for i, angles in enumerate(np.asarray(rpy_deg, float)):
        now_us, ms = wire.START_US + 40_000 * i, 1000 + 40 * i
        rotation = Rotation.from_euler("ZYX", angles[::-1], degrees=True)
        sent = wire.wxyz(turn * rotation if turn else rotation)
        if i % 25 == 0:
            records.append((now_us, wire.heartbeat(custom_mode=5 if i < 50 else 9)))
        wrapped = np.radians((angles + 180.0) % 360.0 - 180.0)
        records += [(now_us, wire.attitude(ms, wrapped)), (now_us, wire.attitude_quaternion(ms, sent))]
    return records


def along(n: int, **angles: Any) -> NDArray[np.float64]:
    """(n, 3) of roll, pitch and yaw, 0 where none is given."""
    return np.column_stack([np.broadcast_to(angles.get(name, 0.0), n) for name in ("roll", "pitch", "yaw")])


def states(recording: Drawn, entity: str) -> list[tuple[float, str]]:
    """When, in s of boot, each state of a lane began."""
    times, values = recording.rows(f"{VEHICLE}/{entity}", STATES)
    return [(t_us / 1e6, value[0]) for t_us, value in zip(times.tolist(), values, strict=True)]


@pytest.mark.parametrize("pieces", one_in(2, [1, 12]))
def test_no_line_crosses_the_plot_where_the_yaw_wraps(tmp_path: Path, pieces: int) -> None:
    """From 170.5° by 1° to 219.5°, which is −140.5°: one gap, behind 179.5°, and roll and pitch have none."""
    recording = written(turning(along(50, yaw=170.5 + np.arange(50))), tmp_path / "a.rrd", pieces)
    for source in ("euler", "quaternion"):
        boot_us, yaw = recording.numbers(f"{VEHICLE}/yaw/{source}", SCALARS)
        assert np.flatnonzero(np.isnan(yaw)).tolist() == [10]
        assert yaw[[0, 9, 11, 50]] == pytest.approx([170.5, 179.5, -179.5, -140.5], abs=1e-4)
        assert boot_us[[9, 10, 11]].tolist() == [1_360_000, 1_399_999, 1_400_000]
        for angle in ("roll", "pitch"):
            assert len(recording.rows(f"{VEHICLE}/{angle}/{source}", SCALARS)[0]) == 50


def test_a_bar_marks_where_roll_and_yaw_mean_little(tmp_path: Path) -> None:
    """Pitch by 1° a sample from 70.5° to 89.5° and back: from 85.5° (1.6 s) to 85.5° a bar lies under roll and yaw."""
    pitch = np.concatenate((np.arange(70.5, 90.0), np.arange(88.5, 70.0, -1.0)))
    recording = written(turning(along(len(pitch), pitch=pitch)), tmp_path / "a.rrd")
    for part in ("roll/near_pole/euler", "yaw/near_pole/quaternion"):
        boot_us, bar = recording.numbers(f"{VEHICLE}/{part}", SCALARS)
        assert bar[:-1].tolist() == [-180.0] * 9
        assert np.isnan(bar[-1])
        assert boot_us[0] == 1_600_000


@pytest.mark.slow
def test_a_hundredth_and_ninety_degrees_are_read_on_one_scale(tmp_path: Path) -> None:
    """Powers of ten of degrees: 0.01° is −2, 90° is 1.954, the limit of 0.52° −0.284, nothing −4."""
    for apart_deg, power in ((0.01, -2.0), (90.0, np.log10(90.0))):
        turn = Rotation.from_euler("Z", apart_deg, degrees=True)
        recording = written(turning(along(30), turn), tmp_path / f"{apart_deg:g}.rrd")
        _, rows = recording.rows(f"{VEHICLE}/disagreement_power", SCALARS)
        assert len(rows) == 30
        angle, limit, tilt, heading = np.array(rows).T
        assert angle == pytest.approx(power, abs=0.002)  # the wire's float32
        assert heading == pytest.approx(power, abs=0.002)
        assert limit == pytest.approx(-0.284, abs=1e-3)
        assert tilt == pytest.approx(-4.0, abs=0.5)


def test_the_horizon_tilts_the_right_way(tmp_path: Path) -> None:
    """Right wing down by 30°, nose up by 10°, y downwards: the horizon's right end rises, its middle sinks.

    By hand: its direction is (cos 30°, −sin 30°), and its middle lies 10 units off, along (sin 30°, cos 30°).
    """
    recording = written(turning(along(30, roll=30.0, pitch=10.0)), tmp_path / "a.rrd")
    for source in ("quaternion", "euler"):
        _, middle = recording.numbers(f"{VEHICLE}/horizon/{source}", "Transform3D:translation")
        _, xyzw = recording.numbers(f"{VEHICLE}/horizon/{source}", "Transform3D:quaternion")
        assert len(xyzw) == 1  # it does not move
        assert middle[0] == pytest.approx([5.0, 8.6603, 0.0], abs=1e-4)
        assert Rotation.from_quat(xyzw[0]).apply([1, 0, 0]) == pytest.approx([0.86603, -0.5, 0.0], abs=1e-5)


def test_the_horizon_lies_across_the_down_that_the_body_sees() -> None:
    """Of random attitudes, and by SciPy: in the plane of wings and fin it is at right angles to the earth's down."""
    rotations = Rotation.random(200, random_state=1)
    down_b = rotations.inv().apply([0.0, 0.0, 1.0])
    _, pitch, roll = rotations.as_euler("ZYX", degrees=True).T
    poses = horizon_poses(roll, pitch)
    turns = Rotation.from_quat(poses[:, [4, 5, 6, 3]])  # SciPy: x, y, z, w
    level, below = turns.apply([1.0, 0.0, 0.0]), turns.apply([0.0, 1.0, 0.0])
    across = down_b[:, 1:] / np.linalg.norm(down_b[:, 1:], axis=1)[:, None]  # right and down of the picture
    assert np.einsum("ij,ij->i", level[:, :2], across) == pytest.approx(0.0, abs=1e-9)
    assert np.einsum("ij,ij->i", below[:, :2], across) == pytest.approx(1.0, abs=1e-9)
    assert np.linalg.norm(poses[:, :2], axis=1) == pytest.approx(np.abs(np.degrees(np.arcsin(down_b[:, 0]))), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("pieces", [1, 12])
def test_the_verdict_of_a_check_goes_with_its_alarm(tmp_path: Path, pieces: int) -> None:
    """Turned by 25° for 0.2 s, which passes, and again for good: agree, pending, agree, pending, alarm."""
    straight, turned = turning(along(250)), turning(along(250), Rotation.from_euler("Z", 25, degrees=True))
    short = (2_000_000, 2_200_000)
    records = [
        bad if short[0] <= bad[0] - wire.START_US < short[1] or bad[0] - wire.START_US >= 5_000_000 else good
        for good, bad in zip(straight, turned, strict=True)
    ]
    told = states(written(records, tmp_path / "a.rrd", pieces), "verdict/euler_quaternion")
    assert [state for _, state in told] == ["agree", "pending", "agree", "pending", "alarm"]
    at = [second for second, _ in told]
    assert at[0] == pytest.approx(1.0)
    assert at[1] == pytest.approx(3.0, abs=0.2)
    assert 3.2 <= at[2] <= 5.0
    assert at[3] == pytest.approx(6.0, abs=0.2)
    assert at[4] > at[3]


@pytest.mark.slow
def test_a_tailsitters_view_is_named_where_it_explains_the_difference(tmp_path: Path) -> None:
    """It hovers, flies forward, and hovers again: the lane says what was undone, however the bytes were cut.

    It does not say that both agree before that was found: they are 90° apart then.
    """
    data = (FIXTURES / "d_tailsitter.tlog").read_bytes()
    once, often = (
        states(drawn(data, tmp_path / f"{pieces}.rrd", pieces=pieces)[0], "verdict/euler_quaternion")
        for pieces in (1, 15)
    )
    assert once == often
    hover, forward = "agree, explained by vtol_view", "agree"
    assert [state for _, state in once] == [hover, forward, hover]


def test_the_flight_mode_is_a_lane(tmp_path: Path) -> None:
    """ArduCopter's mode 5 is LOITER, 9 LAND (its parameter FLTMODE1)."""
    told = states(written(turning(along(80)), tmp_path / "a.rrd"), "mode")
    assert told == [(1.0, "loiter, disarmed"), (3.0, "land, disarmed")]


def test_flight_modes_have_their_firmwares_names() -> None:
    """By ArduPilot's documentation of FLTMODE1, and PX4's px4_custom_mode.h; else the number."""
    assert mode_name("ardupilot", "fixed_wing", 10) == "auto"
    assert mode_name("ardupilot", "vtol_tailsitter_duorotor", 19) == "qloiter"
    assert mode_name("ardupilot", "ground_rover", 4) == "hold"
    assert mode_name("px4", "fixed_wing", 3 << 16) == "posctl"
    assert mode_name("ardupilot", "quadrotor", 250) == "mode 250"
    assert mode_name("px4", "quadrotor", 200 << 16) == "mode 13107200"
    assert mode_name("invalid", "generic", 7) == "mode 7"


@pytest.mark.slow
def test_an_alarm_is_told_whole(tmp_path: Path) -> None:
    """With its size, cause and what to do, in one text; in the log it goes on in lines that can be seen."""
    flown = (FIXTURES / "c_copter_4hz.tlog").read_bytes()
    recording, events = drawn(inject(flown, [parse_fault("yaw_offset:25")], from_s=10), tmp_path / "a.rrd")
    _, texts = recording.rows(f"{VEHICLE}/alarms", "TextDocument:text")
    assert texts[0] == ["No alarm."]
    fix = next(event["diagnosis"]["fix"] for event in reversed(events) if event.get("diagnosis"))
    said = texts[-1][0].replace("\\", "")
    assert said.startswith("**ALARM euler_quaternion** since ")
    assert "ATTITUDE and ATTITUDE_QUATERNION are not one rotation: 25.00°" in said
    assert "yaw_offset" in said
    assert fix in said
    _, lines = recording.rows(f"{VEHICLE}/events", "TextLog:text")
    assert max(len(line[0]) for line in lines) <= 76
    whole = " ".join(" ".join(line[0] for line in lines).split())
    assert fix in whole


@pytest.mark.slow
def test_how_the_streams_arrive_is_counted_by_the_second(tmp_path: Path) -> None:
    """25 Hz, but no quaternion from 3.0 s to 3.6 s: then 10 in that second, and 0.64 s from one to the next."""
    records = [
        (t_us, frame)
        for t_us, frame in turning(along(130))
        if not (
            2_000_000 <= t_us - wire.START_US < 2_600_000 and frame[7] == mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
        )
    ]
    for pieces in (1, 7):
        recording = written(records, tmp_path / f"{pieces}.rrd", pieces)
        boot_us, rates = recording.rows(f"{VEHICLE}/streams/rate_hz", SCALARS)
        assert boot_us.tolist() == [2_000_000, 3_000_000, 4_000_000, 5_000_000, 6_000_000]
        assert rates == [[25, 25], [25, 25], [25, 10], [25, 25], [25, 25]]
        _, ages = recording.rows(f"{VEHICLE}/streams/age_s", SCALARS)
        assert ages[1] == pytest.approx([0.04, 0.04])
        assert ages[2] == pytest.approx([0.04, 0.64])


def test_rates_stand_beside_the_gyros(tmp_path: Path) -> None:
    """A vehicle that says that it yaws by 10°/s and a gyro that feels 12°/s: forward, right, down of both."""
    records: Records = []
    for i in range(75):
        now_us, ms = wire.START_US + 40_000 * i, 1000 + 40 * i
        if i % 25 == 0:
            records.append((now_us, wire.heartbeat()))
        turned = wire.wxyz(Rotation.from_euler("Z", 0.4 * i, degrees=True))
        records.append((now_us, wire.attitude_quaternion(ms, turned, (0, 0, np.radians(10.0)))))
        imu = mavlink.MAVLink_highres_imu_message(
            1000 * ms, 0, 0, -9.80665, 0, 0, np.radians(12.0), *[0] * 7, fields_updated=63
        )
        records.append((now_us, wire.pack(imu)))
    _, rates = written(records, tmp_path / "a.rrd").rows(f"{VEHICLE}/rates_deg_s", SCALARS)
    assert len(rates) > 60
    assert rates[-1] == pytest.approx([0, 0, 12, 0, 0, 10], abs=1e-4)


@pytest.mark.slow
def test_after_a_reboot_the_lanes_tell_what_is_judged(tmp_path: Path) -> None:
    """The second boot's first pair comes before the news of the reboot: it is judged and agrees all the same."""
    recording, _ = drawn((FIXTURES / "f_reboot.tlog").read_bytes(), tmp_path / "a.rrd")
    for check in ("euler_quaternion", "body_rates", "quaternion_norm"):
        _, states = recording.rows(f"/vehicle/1.1/verdict/{check}", "StateChange:state", "boot_1")
        assert states[-1] == ["agree"], check
