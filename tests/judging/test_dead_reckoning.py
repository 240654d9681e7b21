"""The motion of a vehicle by its attitudes and its accelerometer."""

from collections.abc import Iterable, Sequence
from dataclasses import fields

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from gcs_bridge import Monitor, attitude
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.judging.dead_reckoning import MotionSamples, MotionTracker
from gcs_bridge.judging.observation import Observation
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES
from tests.helpers.wire import Array

G = attitude.G_M_S2

# Bytes in, by the samples that its reader makes of them

START_MS = 10_000
FORWARD, RIGHT, DOWN = np.eye(3)


def flights(data: bytes, pieces: int = 1) -> list[CheckBatch]:
    """What the observer is shown of vehicle 1.1 in its first boot, of a recording that comes in pieces."""
    seen = []

    def observe(observation: Observation) -> None:
        if observation.vehicle.address == (1, 1) and observation.segment.boot == 0:
            seen.append(observation.flight)

    monitor = Monitor(observer=observe)
    for cut in np.array_split(np.frombuffer(data, np.uint8), pieces):
        monitor.feed_recording(cut.tobytes())
    monitor.close()
    return seen


def moved_by(flights: Iterable[CheckBatch]) -> MotionSamples:
    """The motion that these flights, one after the other, add up to."""
    tracker = MotionTracker()
    parts = [part for flight in flights if (part := tracker.feed(flight.imu_with_attitude)) is not None]
    return MotionSamples.joined(parts)


def moved(data: bytes) -> MotionSamples:
    """The motion of vehicle 1.1 in its first boot, of a recording."""
    return moved_by(flights(data))


def imu_message(t_s: float, f_b: Array, w_b: Array) -> bytes:
    """HIGHRES_IMU on the boot clock, at t_s after the start."""
    now_us = 1000 * START_MS + round(1e6 * t_s)
    return wire.pack(mavlink.MAVLink_highres_imu_message(now_us, *f_b, *w_b, *[0] * 7, fields_updated=63))


def told(
    t_s: Array,
    rotation: Rotation,
    f_b: Array,
    rates: Array | None = None,
    attitudes: Sequence[str] = ("quaternion",),
    every: int = 1,
    gyro: Array | None = None,
    armed_s: float = np.inf,
) -> bytes:
    """A recording of attitudes and specific forces at t_s (n,), s: SciPy's rotations and f_b (n, 3).

    Every so-many-th time has its attitudes, "euler", "quaternion" or both. The gyro says `rates` unless given.
    The heartbeats say whether it is armed yet.
    """
    rates = np.zeros((len(t_s), 3)) if rates is None else rates
    records = []
    for i, t in enumerate(t_s):
        now_us, now_ms = wire.START_US + round(1e6 * t), START_MS + round(1000 * t)
        if i % 50 == 0:
            mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if t >= armed_s else 0
            records.append((now_us, wire.pack(mavlink.MAVLink_heartbeat_message(2, 3, mode, 0, 4, 3))))
        for name in attitudes if i % every == 0 else ():
            if name == "euler":
                frame = wire.attitude(now_ms, rotation[i].as_euler("ZYX")[::-1], rates[i])
            else:
                frame = wire.attitude_quaternion(now_ms, wire.wxyz(rotation[i]), rates[i])
            records.append((now_us, frame))
        records.append((now_us, imu_message(t, f_b[i], rates[i] if gyro is None else gyro)))
    return wire.tlog(records)


def about(axis: Array, degrees: Array) -> Rotation:
    """Turns (n,) about one axis, by SciPy."""
    return Rotation.from_rotvec(np.outer(np.radians(degrees), axis))


def force(rotation: Rotation, a_n: Array) -> Array:
    """What an accelerometer reads at attitudes and accelerations (n, 3) in NED, by SciPy."""
    f_b: Array = rotation.inv().apply(np.asarray(a_n) - [0, 0, G])
    return f_b


def at(motion: MotionSamples, t_s: float) -> int:
    """The row at a time after the start."""
    return int(np.searchsorted(motion.t_boot_us, 1000 * START_MS + round(1e6 * t_s)))


def test_two_metres_per_second_squared_for_three_seconds() -> None:
    """Four seconds of rest, then 2 m/s^2 along the nose: 6 m/s and 9 m after three seconds, wherever the nose points.

    The first step, a ramp of 0.02 s, adds 0.02 m/s, and so 0.06 m in three seconds.
    """
    t = np.arange(0, 7.5, 0.02)
    east = about(DOWN, np.full(len(t), 90.0))
    a_n = np.where((t > 3.99)[:, None], [0.0, 2.0, 0.0], 0.0)
    motion = moved(told(t, east, force(east, a_n)))
    end = at(motion, 7.0)
    assert motion.a_h_m_s2[end] == pytest.approx([2, 0, 0], abs=1e-5)
    assert motion.v_h_m_s[end] == pytest.approx([6.02, 0, 0], abs=1e-4)
    assert motion.d_h_m[end] == pytest.approx([9.0601, 0, 0], abs=1e-3)
    assert motion.v_bound_m_s[end] == pytest.approx(0.3 * 3.02, abs=1e-6)
    assert motion.d_bound_m[end] == pytest.approx(0.15 * 3.02**2, abs=1e-6)
    assert np.degrees(motion.heading_rad[end]) == pytest.approx(90, abs=1e-4)


def test_a_turn_takes_the_velocity_from_the_nose_to_the_side() -> None:
    """Flying north at 6 m/s, a turn of the nose by 90 deg to the left leaves 6 m/s to the right and turns no path."""
    t = np.arange(0, 9.5, 0.02)
    a_n = np.where(((t > 3.99) & (t < 6.99))[:, None], [2.0, 0.0, 0.0], 0.0)
    turning = (t >= 7.5) & (t < 8.5)
    rates = np.where(turning[:, None], [0, 0, -np.pi / 2], 0.0)
    yaw = about(DOWN, -90 * np.clip(t - 7.5, 0, 1))
    motion = moved(told(t, yaw, force(yaw, a_n), rates))
    before, after = at(motion, 7.4), at(motion, 9.0)
    assert motion.v_h_m_s[before] == pytest.approx([6, 0, 0], abs=1e-3)
    assert motion.v_h_m_s[after] == pytest.approx([0, 6, 0], abs=1e-3)
    assert motion.d_h_m[after] - motion.d_h_m[before][[1, 0, 2]] == pytest.approx([0, 6 * 1.6, 0], abs=1e-2)
    assert np.degrees(motion.heading_rad[after]) == pytest.approx(270, abs=1e-4)


@pytest.mark.parametrize("gyro", [None, [np.nan] * 3])
def test_motion_is_known_since_a_rest_and_up_to_a_gap(gyro: Array | None) -> None:
    """Unknown before the first three quiet seconds, zero at rest, unknown from a gap of 1.2 s to the next rest.

    That it is quiet, the attitude's rates tell where there is no gyro.
    """
    t = np.concatenate((np.arange(0, 6, 0.02), np.arange(7.2, 12, 0.02)))
    level = Rotation.identity(len(t))
    motion = moved(told(t, level, force(level, np.zeros((len(t), 3))), gyro=gyro))
    known = np.isfinite(motion.v_h_m_s[:, 0])
    expected = ((t >= 2.99) & (t < 6.5)) | (t >= 10.19)
    assert known.tolist() == expected[: len(known)].tolist()
    for bound in (motion.v_bound_m_s, motion.d_bound_m, *motion.v_h_m_s.T, *motion.d_h_m.T):
        assert np.isfinite(bound).tolist() == known.tolist()
    assert np.isfinite(motion.a_h_m_s2).all()
    assert (motion.v_bound_m_s[known] == 0).all()


def test_an_armed_vehicle_does_not_stand() -> None:
    """A steady cruise reads like rest: of an armed vehicle nothing is known, or the bound goes on growing."""
    t = np.arange(0, 10, 0.02)
    level = Rotation.identity(len(t))
    f_b = force(level, np.zeros((len(t), 3)))
    assert np.isnan(moved(told(t, level, f_b, armed_s=0)).v_h_m_s).all()
    motion = moved(told(t, level, f_b, armed_s=5))
    assert motion.v_bound_m_s[at(motion, 4.9)] == 0
    assert motion.v_bound_m_s[at(motion, 8.0)] == pytest.approx(0.3 * 3.02, abs=1e-6)


@pytest.mark.parametrize("gyro", [None, [np.nan] * 3])
def test_the_attitude_is_that_of_the_samples_time(gyro: Array | None) -> None:
    """Rolling at 90 deg/s on the spot, attitudes at 4 Hz: between them too the acceleration is zero.

    With the latest attitude as it was sent, up to 22 deg old, it would be 3.7 m/s^2. That it turns, and so does not
    rest, the attitude's rates tell where there is no gyro.
    """
    t = np.arange(0, 8, 0.02)
    rolling = about(FORWARD, 90 * t)
    rates = np.tile([np.pi / 2, 0, 0], (len(t), 1))
    motion = moved(told(t, rolling, force(rolling, np.zeros((len(t), 3))), rates, every=12, gyro=gyro))
    assert len(motion) > 380
    assert np.abs(motion.a_h_m_s2).max() < 1e-4
    assert np.isnan(motion.v_h_m_s).all()


@pytest.mark.parametrize("rates", [0.0, np.nan])
def test_an_attitude_without_rates_is_interpolated_by_the_way_between(rates: float) -> None:
    """Rates that are no numbers, or that there is no turn to report, leave the short way between two attitudes."""
    t = np.arange(0, 2, 0.02)
    rolling = about(FORWARD, (90 if np.isnan(rates) else 0) * t)
    data = told(t, rolling, force(rolling, np.zeros((len(t), 3))), np.full((len(t), 3), rates), every=5)
    assert np.abs(moved(data).a_h_m_s2).max() < 1e-4


@pytest.mark.slow
def test_euler_angles_serve_where_no_quaternion_comes() -> None:
    """ATTITUDE alone gives the same motion; where both come the quaternion counts, and 0.5 s after its end no more."""
    t = np.arange(0, 8, 0.02)
    turned = wire.Motion(8.0, seed=3)
    rotation, rates = turned.rotation(t), turned.rates(t)
    f_b = force(rotation, np.zeros((len(t), 3)))
    by_quaternion, by_euler = (moved(told(t, rotation, f_b, rates, [name])) for name in ("quaternion", "euler"))
    assert by_euler.heading_rad == pytest.approx(by_quaternion.heading_rad, abs=1e-5)
    assert by_euler.a_h_m_s2 == pytest.approx(by_quaternion.a_h_m_s2, abs=1e-4)

    east, north = about(DOWN, np.full(len(t), 90.0)), Rotation.identity(len(t))
    eulers = wire.records(told(t, east, force(east, np.zeros((len(t), 3))), attitudes=["euler"]))
    quaternions = wire.records(told(t[:200], north, f_b, attitudes=["quaternion"]))
    merged = sorted([*eulers, *quaternions], key=lambda record: record[0])
    headings = np.degrees(moved(wire.tlog(merged)).heading_rad)
    assert headings[5:200] == pytest.approx(0, abs=1e-4)
    assert headings[-150:] == pytest.approx(90, abs=1e-4)
    assert np.isfinite(headings).all()


def test_the_two_downs_by_hand() -> None:
    """At rest and level, but the attitude says 30 deg nose up: the downs are 30 deg apart, the accelerometer's ahead.

    In the world that the attitude claims, the accelerometer's points north by sin 30.
    """
    t = np.arange(0, 2, 0.02)
    nose_up = about(RIGHT, np.full(len(t), 30.0))
    motion = moved(told(t, nose_up, np.tile([0, 0, -G], (len(t), 1))))
    assert motion.accelerometer_down_n[50] == pytest.approx([0.5, 0, np.sqrt(0.75)], abs=1e-6)
    assert np.degrees(motion.apart_rad[50]) == pytest.approx(30, abs=1e-4)


def test_headings_go_from_0_to_360() -> None:
    """Turning left through north, the heading falls to 0 and goes on from 360."""
    t = np.arange(0, 4, 0.02)
    turning = about(DOWN, 40 - 30 * t)
    motion = moved(told(t, turning, np.tile([0, 0, -G], (len(t), 1)), np.tile([0, 0, -np.pi / 6], (len(t), 1))))
    assert np.degrees(motion.heading_rad) == pytest.approx((40 - 30 * t[: len(motion)]) % 360, abs=1e-3)


def recording(name: str) -> bytes:
    """A recording of the fixtures, or "by hand" one that rests, moves, misses some seconds, and rests again."""
    if name != "by hand":
        return (FIXTURES / f"{name}.tlog").read_bytes()
    t = np.concatenate((np.arange(0, 6, 0.02), np.arange(7.2, 12, 0.02)))
    level = Rotation.identity(len(t))
    return told(t, level, force(level, np.where((np.abs(t - 4.5) < 0.5)[:, None], [2.0, 1.0, 0.5], 0.0)))


@pytest.mark.slow
@pytest.mark.parametrize("name", one_in(3, ["by hand", "b2_mixed_rates", "h_lossy_dirty"]))
def test_motion_does_not_depend_on_the_cut(name: str) -> None:
    """Whole and in 100 pieces: the motion is the same bit for bit."""
    data = recording(name)
    whole, cut = moved(data), flights(data, 100)
    assert len(whole) > 300
    assert len(cut) > 60
    other = moved_by(cut)
    for f in fields(MotionSamples):
        assert np.array_equal(getattr(whole, f.name), getattr(other, f.name), equal_nan=True), f.name


def test_an_ahrs_trim_turns_the_accelerometer_not_the_vehicle() -> None:
    """Hovering with a trim of 5.8 deg, both downs are one; untrimmed they are 5.8 deg apart, trimmed wrong twice that.

    AHRS_TRIM_X and _Y come in the recording; ArduPilot sends the attitude of the body that they make level.
    """
    motion = moved(recording("j_ahrs_trim5"))
    t_s = motion.t_boot_us * 1e-6
    hovering = (t_s > 51.5) & (t_s < 56)
    assert hovering.sum() > 100
    assert np.degrees(motion.apart_rad[hovering]).max() < 0.5


def test_a_flown_square_stays_within_the_drift() -> None:
    """76 s of flight since rest: the autopilot's own velocity and position are within the bound of what is reckoned.

    LOCAL_POSITION_NED by pymavlink, turned by hand into the level frame. From arming on it does not rest. It flies at
    5 m/s in all directions; a wrong sign or frame would show as 10 m/s, the drift is below 2.
    """
    path = FIXTURES / "a_copter_square.tlog"
    log = mavutil.mavlink_connection(str(path), dialect="all")
    armed_s, rows, latest_s = np.inf, [], 0.0
    while message := log.recv_match(type=["HEARTBEAT", "LOCAL_POSITION_NED"]):
        if message.get_type() == "LOCAL_POSITION_NED":
            latest_s = message.time_boot_ms / 1e3
            rows.append((latest_s, message.vx, message.vy, message.vz, message.x, message.y, message.z))
        elif message.autopilot == 3 and message.base_mode & 128:
            armed_s = min(armed_s, latest_s)
    log.close()
    seen = np.array(rows)
    seen[:, 4:] -= seen[np.searchsorted(seen[:, 0], armed_s), 4:]
    motion = moved(path.read_bytes())
    t_s = motion.t_boot_us * 1e-6
    flown = (t_s > armed_s + 1) & (t_s < seen[-1, 0])
    vx, vy, vz, x, y, z = (np.interp(t_s[flown], seen[:, 0], line) for line in seen.T[1:])
    c, s = np.cos(motion.heading_rad[flown]), np.sin(motion.heading_rad[flown])
    velocity = np.column_stack((c * vx + s * vy, c * vy - s * vx, vz))
    displacement = np.column_stack((c * x + s * y, c * y - s * x, z))
    errors = np.linalg.norm(motion.v_h_m_s[flown] - velocity, axis=1)
    assert (errors <= motion.v_bound_m_s[flown]).all()
    assert (np.linalg.norm(motion.d_h_m[flown] - displacement, axis=1) <= motion.d_bound_m[flown]).all()
    assert flown.sum() > 1800
    assert np.abs(velocity).max() > 4.5
    assert errors.max() < 2.0
