"""Facts worked by hand, before any round trip: a round trip survives a sign that is wrong both ways."""

import numpy as np
import numpy.typing as npt
import pytest

from gcs_bridge import attitude
from tests.helpers.attitude_cases import Array

NOSE, RIGHT_WING, BELLY = np.eye(3)
NORTH, EAST, DOWN = np.eye(3)
EXACT = 1e-15
"""A few roundings of numbers near one."""


def close(got: npt.ArrayLike, expected: npt.ArrayLike, tolerance: float = 4 * EXACT) -> None:
    np.testing.assert_allclose(np.asarray(got), np.asarray(expected), rtol=0.0, atol=tolerance)


def degrees(roll: npt.ArrayLike = 0.0, pitch: npt.ArrayLike = 0.0, yaw: npt.ArrayLike = 0.0) -> Array:
    roll, pitch, yaw = np.radians(roll), np.radians(pitch), np.radians(yaw)
    return attitude.quaternion_from_rpy(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)


@pytest.mark.parametrize(
    ("turn", "axis", "points"),
    [
        ({"yaw": 90}, NOSE, EAST),
        ({"yaw": 90}, RIGHT_WING, -NORTH),
        ({"pitch": 90}, NOSE, -DOWN),
        ({"pitch": 90}, BELLY, NORTH),
        ({"roll": 90}, RIGHT_WING, DOWN),
        ({"roll": 90}, BELLY, -EAST),
        ({"roll": 90, "yaw": 90}, RIGHT_WING, DOWN),
        ({"pitch": 90, "yaw": 90}, BELLY, EAST),
        ({"pitch": 30, "yaw": 90}, NOSE, [0.0, 0.75**0.5, -0.5]),
    ],
)
def test_a_turn_points_the_body_axis_there(turn: dict[str, float], axis: Array, points: npt.ArrayLike) -> None:
    """Yaw 90 deg turns the nose east, pitch 90 deg points it up, roll 90 deg puts the right wing down."""
    q = degrees(**turn)
    close(attitude.rotate(q, axis), points)
    close(attitude.matrix_from_quaternion(q) @ axis, points)
    yaw_pitch_roll = np.radians([turn.get(name, 0.0) for name in ("yaw", "pitch", "roll")])
    close(attitude.matrix_from_euler(yaw_pitch_roll) @ axis, points)


@pytest.mark.parametrize(
    ("axis", "vector", "turned"),
    [("x", [0, 1, 0], [0, 0, 1]), ("y", [0, 0, 1], [1, 0, 0]), ("z", [1, 0, 0], [0, 1, 0])],
)
def test_elementary_rotations_are_right_handed(axis: str, vector: Array, turned: Array) -> None:
    """An active quarter turn takes y to z, z to x, x to y; the passive one turns the axes instead (M1)."""
    close(attitude.elementary_rotation(axis, np.pi / 2) @ vector, turned)
    close(attitude.elementary_rotation(axis.upper(), np.pi / 2, passive=True) @ turned, vector)
    close(
        attitude.elementary_rotation(axis, [0.3, -0.3]), attitude.elementary_rotation(axis, [-0.3, 0.3], passive=True)
    )


def test_the_printed_matrix_of_roll_pitch_yaw() -> None:
    """matrix_from_euler is M3 as printed, and the product Rz Ry Rx."""
    roll, pitch, yaw = 0.4, -0.7, 2.1
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    printed = [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
    close(attitude.matrix_from_euler([yaw, pitch, roll]), printed)
    turn = attitude.elementary_rotation
    close(turn("z", yaw) @ turn("y", pitch) @ turn("x", roll), printed)


def test_the_printed_quaternion_of_roll_pitch_yaw() -> None:
    """quaternion_from_rpy is M11 as printed."""
    roll, pitch, yaw = 0.4, -0.7, 2.1
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll / 2, pitch / 2, yaw / 2]), np.sin([roll / 2, pitch / 2, yaw / 2])
    printed = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    close(attitude.quaternion_from_rpy(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw), printed)


def test_the_printed_angles_of_a_quaternion_and_of_a_matrix() -> None:
    """Away from the poles the exact form gives what the documented forms M14 and M4 give."""
    rng = np.random.default_rng(14)
    q = attitude.normalise(rng.normal(size=(1000, 4)))
    w, x, y, z = q.T
    sine = 2 * (w * y - x * z)
    away = np.abs(sine) < 0.9
    documented = np.stack(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(sine.clip(-1, 1)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ],
        axis=-1,
    )
    close(attitude.rpy_from_quaternion(q)[away], documented[away], 1e-13)
    R = attitude.matrix_from_quaternion(q)
    documented = np.stack(
        [
            np.arctan2(R[:, 1, 0], R[:, 0, 0]),
            -np.arcsin(R[:, 2, 0].clip(-1, 1)),
            np.arctan2(R[:, 2, 1], R[:, 2, 2]),
        ],
        axis=-1,
    )
    close(attitude.euler_from_matrix(R)[away], documented[away], 1e-13)


@pytest.mark.parametrize("norm", [0.5, 1.0, 1.05, 1e-40, 1e40])
def test_a_quaternion_off_unit_norm_is_the_same_attitude(norm: float) -> None:
    """The norm is divided out where an attitude is meant, kept where algebra is meant (M8, M12)."""
    q, p = degrees(10, 20, 30), degrees(-50, 5, 100)
    close(attitude.matrix_from_quaternion(norm * q), attitude.matrix_from_quaternion(q))
    close(attitude.rpy_from_quaternion(norm * q), np.radians([10, 20, 30]))
    close(attitude.rotate(norm * q, NOSE), attitude.rotate(q, NOSE))
    close(attitude.rotvec_from_quaternion(norm * q), attitude.rotvec_from_quaternion(q))
    close(attitude.angle_between(norm * q, p), attitude.angle_between(q, p))
    close(attitude.integrate(norm * q, NOSE, 0.1), attitude.integrate(q, NOSE, 0.1))
    close(attitude.slerp(norm * q, p, 0.25), attitude.slerp(q, p, 0.25))
    close(attitude.mean([norm * q, p]), attitude.mean([q, p]))
    close(attitude.body_down(norm * q), attitude.body_down(q))
    close(attitude.normalise(norm * q), q)
    close(attitude.multiply(norm * q, p) / norm, attitude.multiply(q, p))
    close(attitude.conjugate(norm * q) / norm, attitude.conjugate(q))
    close(attitude.quaternion_rate(norm * q, NOSE) / norm, attitude.quaternion_rate(q, NOSE))
    close(attitude.enu_flu_from_ned_frd(norm * q) / norm, attitude.enu_flu_from_ned_frd(q))


@pytest.mark.parametrize(("a", "b", "ab"), [(1, 2, 3), (2, 3, 1), (3, 1, 2)])
def test_hamiltons_units(a: int, b: int, ab: int) -> None:
    """i j = k and j i = -k, and so on round; each squared is -1 (M10)."""
    units = np.eye(4)
    close(attitude.multiply(units[a], units[b]), units[ab])
    close(attitude.multiply(units[b], units[a]), -units[ab])
    close(attitude.multiply(units[a], units[a]), -units[0])


def test_composition_order() -> None:
    """Yaw, then pitch about the turned axis: q_z * q_y, and the product turns first by its right factor (M10)."""
    yaw, pitch = degrees(yaw=90), degrees(pitch=90)
    close(attitude.multiply(yaw, pitch), degrees(pitch=90, yaw=90))
    close(attitude.rotate(attitude.multiply(yaw, pitch), BELLY), EAST)
    close(attitude.rotate(attitude.multiply(pitch, yaw), BELLY), NORTH)


def test_rotation_vectors_and_axes() -> None:
    """A third of a turn about the diagonal takes x to y; the log goes the short way round (M9)."""
    third = 2 * np.pi / 3
    q = attitude.quaternion_from_axis_angle([2, 2, 2], third)
    close(q, [0.5, 0.5, 0.5, 0.5])
    close(attitude.quaternion_from_rotvec(np.full(3, third / 3**0.5)), q)
    close(attitude.rotate(q, [1, 0, 0]), [0, 1, 0])
    close(
        attitude.rotvec_from_quaternion(attitude.quaternion_from_rotvec([0, 0, np.radians(350)])), [0, 0, -np.pi / 18]
    )
    close(attitude.quaternion_from_axis_angle([0, 0, -1], np.pi / 2), degrees(yaw=-90))
    assert attitude.quaternion_from_axis_angle([0, 3, 0], 0.0).tolist() == [1, 0, 0, 0]
    assert np.isnan(attitude.quaternion_from_axis_angle([0, 0, 0], 1.0)).all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_half_turns_by_each_of_the_four_candidates(sign: float) -> None:
    """Identity and the three half turns, where the trace says nothing, come back from their matrices (M13)."""
    for unit in np.eye(4):
        close(attitude.quaternion_from_matrix(attitude.matrix_from_quaternion(sign * unit)), unit, 0.0)


def test_quaternion_from_matrix_prefers_w_positive() -> None:
    """Of q and -q the matrix gives the one with w >= 0."""
    rng = np.random.default_rng(13)
    assert (
        attitude.quaternion_from_matrix(attitude.matrix_from_quaternion(rng.normal(size=(200, 4))))[:, 0] >= 0
    ).all()


@pytest.mark.parametrize(("pitch", "roll", "yaw", "left"), [(90, 20, 50, 30), (-90, 20, 50, 70), (90, -170, 170, -20)])
def test_gimbal_lock_gives_the_whole_turn_to_yaw(pitch: float, roll: float, yaw: float, left: float) -> None:
    """At pitch 90 deg only yaw minus roll is defined, at -90 deg yaw plus roll; roll is said to be 0 (M5)."""
    got = np.degrees(attitude.rpy_from_quaternion(degrees(roll, pitch, yaw)))
    assert got[0] == 0.0
    close(got, [0.0, pitch, left], 1e-12)
    close(np.degrees(attitude.heading(degrees(roll, pitch, yaw))), left % 360, 1e-12)
    close(
        np.degrees(attitude.euler_from_matrix(attitude.matrix_from_quaternion(degrees(roll, pitch, yaw)))),
        [left, pitch, 0.0],
        1e-12,
    )


@pytest.mark.parametrize(
    ("sequence", "middle", "first"), [("ZYX", 90, 30), ("zyx", 90, 70), ("ZXZ", 0, 70), ("xyx", 180, 30)]
)
def test_the_angle_listed_last_is_zero_at_every_singularity(sequence: str, middle: float, first: float) -> None:
    """Of outer angles 50 and 20 deg the first keeps the sum or the difference, intrinsic or extrinsic."""
    q = attitude.quaternion_from_euler(np.radians([50, middle, 20]), sequence)
    got = np.degrees(attitude.euler_from_quaternion(q, sequence))
    assert got[2] == 0.0
    close(got, [first, middle, 0.0], 1e-12)


def test_near_gimbal_lock_measures_the_distance_in_radians() -> None:
    """A nose 0.001 rad below the vertical is near the lock of Z-Y-X, one at 0.0011 rad is not (M5)."""
    offsets = np.array([0.0, 0.00099, 0.0011, 0.1])
    q = attitude.quaternion_from_rpy(roll_rad=0.4, pitch_rad=np.pi / 2 - offsets, yaw_rad=2.0)
    assert attitude.near_gimbal_lock(q).tolist() == [True, True, False, False]
    assert attitude.near_gimbal_lock(q, 0.2).tolist() == [True] * 4
    q = attitude.quaternion_from_rpy(roll_rad=0.4, pitch_rad=offsets - np.pi / 2, yaw_rad=2.0)
    assert attitude.near_gimbal_lock(q).tolist() == [True, True, False, False]
    assert attitude.near_gimbal_lock([1, 0, 1, 0], 0.0)
    level = degrees()
    assert attitude.near_gimbal_lock(level, sequence="ZXZ")
    assert attitude.near_gimbal_lock(degrees(roll=180), sequence="ZXZ")
    assert not attitude.near_gimbal_lock(degrees(roll=90), sequence="ZXZ")


def test_heading_is_a_compass() -> None:
    """North is 0, east 90, south 180, west 270 deg, and a hair west of north is not 360 (M6)."""
    close(
        np.degrees(attitude.heading(degrees(yaw=np.array([0, 90, 180, -90, 269.5])))), [0, 90, 180, 270, 269.5], 1e-12
    )
    assert attitude.heading([1.0, 0.0, 0.0, -1e-20]) == 0.0
    assert attitude.heading([0.0, 0.0, 0.0, -1.0]) == np.pi


def test_ranges_are_closed_at_plus_pi() -> None:
    """Half a turn is +180 deg for roll, yaw and heading differences, never -180."""
    for sign in (1.0, -1.0):
        assert attitude.rpy_from_quaternion([0.0, 0.0, 0.0, sign]).tolist() == [0.0, 0.0, np.pi]
        assert attitude.rpy_from_quaternion([-0.0, sign, 0.0, 0.0]).tolist() == [np.pi, 0.0, 0.0]
        assert attitude.tilt_heading_between([1, 0, 0, 0], [0, 0, 0, sign])[1] == np.pi
    assert attitude.ned_frd_rpy_from_enu_flu([0, 0, -np.pi / 2])[2] == np.pi
    assert attitude.ned_frd_rpy_from_enu_flu([0, 0, 1.5 * np.pi])[2] == np.pi
    half_turns = np.pi * np.arange(-2001.0, 2002.0, 2.0)[:, None] * (1.0 + 2.0**-52 * np.arange(-4, 5))
    angles = np.stack(np.broadcast_arrays(0.0, 0.0, 0.5 * np.pi - half_turns), axis=-1)
    yaw = attitude.ned_frd_rpy_from_enu_flu(angles)[..., 2]  # each a few floats from half a turn
    assert ((yaw > -np.pi) & (yaw <= np.pi)).all()


@pytest.mark.parametrize("turn", [{"yaw": 90}, {"yaw": 90, "pitch": 20}, {"yaw": 90, "pitch": -20, "roll": 30}])
def test_heading_east_in_every_frame(turn: dict[str, float]) -> None:
    """Heading 90 deg is east in NED and ENU alike: the nose is FLU's x and RFU's y (M24)."""
    q = degrees(**turn)
    nose_east = np.cos(np.radians(turn.get("pitch", 0)))
    R_flu = attitude.matrix_from_quaternion(attitude.enu_flu_from_ned_frd(q))
    R_rfu = attitude.matrix_from_quaternion(attitude.enu_rfu_from_ned_frd(q))
    for nose in (R_flu[:, 0], R_rfu[:, 1]):
        close(nose[:2], [nose_east, 0.0])
        close(nose[2], np.sin(np.radians(turn.get("pitch", 0))))
    close(attitude.rpy_from_enu_rfu_matrix(R_rfu), attitude.rpy_from_quaternion(q))
    close(attitude.rpy_from_enu_rfu_matrix(R_rfu), np.radians([turn.get(n, 0) for n in ("roll", "pitch", "yaw")]))
    flu = attitude.rpy_from_quaternion(attitude.enu_flu_from_ned_frd(q))
    close(flu, np.radians([turn.get("roll", 0), -turn.get("pitch", 0), 0.0]))


def test_frames_of_vectors() -> None:
    """North is ENU's second axis, the right wing is minus left, the nose is RFU's second axis (M24)."""
    close(attitude.enu_from_ned(NORTH), [0, 1, 0], 0.0)
    close(attitude.enu_from_ned(DOWN), [0, 0, -1], 0.0)
    close(attitude.ned_from_enu([1, 0, 0]), EAST, 0.0)
    close(attitude.flu_from_frd(RIGHT_WING), [0, -1, 0], 0.0)
    close(attitude.frd_from_flu([0, 0, 1]), -BELLY, 0.0)
    close(attitude.rfu_from_frd(NOSE), [0, 1, 0], 0.0)
    close(attitude.frd_from_rfu([1, 0, 0]), RIGHT_WING, 0.0)


def test_the_printed_frame_changes() -> None:
    """Quaternions and matrices change frames by P and D as printed, with the contract's signs (M24)."""
    R_p, R_d = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])
    e, i = [0, 0.5**0.5, 0.5**0.5, 0], [0, 1, 0, 0]
    q = degrees(10, 20, 30)
    R = attitude.matrix_from_quaternion(q)
    close(attitude.enu_flu_matrix_from_ned_frd(R), R_p @ R @ R_d)
    close(attitude.enu_rfu_matrix_from_ned_frd(R), R_p @ R @ R_p)
    close(attitude.ned_frd_matrix_from_enu_flu(R), R_p @ R @ R_d)
    close(attitude.ned_frd_matrix_from_enu_rfu(R), R_p @ R @ R_p)
    close(attitude.enu_flu_from_ned_frd(q), attitude.multiply(attitude.multiply(e, q), i))
    close(attitude.enu_rfu_from_ned_frd(q), -attitude.multiply(attitude.multiply(e, q), e))
    close(attitude.matrix_from_quaternion(attitude.enu_flu_from_ned_frd(q)), R_p @ R @ R_d)
    close(attitude.matrix_from_quaternion(attitude.enu_rfu_from_ned_frd(q)), R_p @ R @ R_p)


def test_the_printed_enu_rfu_angles() -> None:
    """Roll, pitch and heading of C_b^n in ENU and RFU are M24's three formulas, and the passive Z-X-Y product."""
    roll, pitch, yaw = np.radians([25, -40, 130])
    R = attitude.enu_rfu_matrix_from_rpy([roll, pitch, yaw])
    turn = attitude.elementary_rotation
    passive = turn("y", roll, passive=True) @ turn("x", pitch, passive=True) @ turn("z", -yaw, passive=True)
    close(R, passive.T)
    printed = [np.arctan2(-R[2, 0], R[2, 2]), np.arcsin(R[2, 1]), np.arctan2(R[0, 1], R[1, 1])]
    close(printed, [roll, pitch, yaw])
    close(attitude.rpy_from_enu_rfu_matrix(R), printed)


def test_flu_angles() -> None:
    """In ENU and FLU roll stays, pitch turns its sign, yaw counts from east anticlockwise."""
    close(np.degrees(attitude.enu_flu_rpy_from_ned_frd(np.radians([5, 10, 100]))), [5, -10, -10], 1e-12)
    q = degrees(5, 10, 100)
    close(attitude.rpy_from_quaternion(attitude.enu_flu_from_ned_frd(q)), np.radians([5, -10, -10]))
    close(np.degrees(attitude.ned_frd_rpy_from_enu_flu(np.radians([5, -10, -10]))), [5, 10, 100], 1e-12)
    for turns in (-50, -5, -1, 1, 5, 50):
        whole = np.radians([5, 10, 100 + 360 * turns])
        close(np.degrees(attitude.enu_flu_rpy_from_ned_frd(whole)), [5, -10, -10], 1e-11)


def test_distances() -> None:
    """The distance is the angle of the rotation between, whatever the signs (M17)."""
    close(attitude.angle_between(degrees(yaw=170), degrees(yaw=-170)), np.radians(20))
    close(attitude.angle_between(degrees(), -degrees(pitch=60)), np.radians(60))
    close(attitude.angle_between(degrees(), degrees(roll=180)), np.pi)
    assert attitude.angle_between([0.1, 0.7, 0.3, -0.2], [-0.1, -0.7, -0.3, 0.2]) == 0.0


def test_tilt_and_heading_of_a_difference() -> None:
    """A yaw difference is all heading at any pitch, a roll difference of a level vehicle all tilt (M17)."""
    for pitch in (0, 60, 89.9, -90):
        tilt, heading = attitude.tilt_heading_between(degrees(10, pitch, 30), degrees(10, pitch, 75))
        close([tilt, heading], [0.0, np.radians(45)])
        close(attitude.tilt_heading_between(degrees(10, pitch, 75), -degrees(10, pitch, 30))[1], np.radians(-45))
    tilt, heading = attitude.tilt_heading_between(degrees(yaw=200), degrees(roll=25, yaw=200))
    close([tilt, heading], [np.radians(25), 0.0])


def test_roll_of_a_pitched_aircraft_is_tilt_and_heading() -> None:
    """10 deg of body roll at 60 deg of pitch: the nose axis is (1/2, 0, -sin 60), and both parts follow by hand."""
    tilt, heading = attitude.tilt_heading_between(degrees(pitch=60), degrees(roll=10, pitch=60))
    half = np.radians(5)
    close(tilt, 2 * np.arcsin(0.5 * np.sin(half)))
    close(heading, 2 * np.arctan2(-np.sin(np.pi / 3) * np.sin(half), np.cos(half)))


def test_heading_is_undefined_beyond_150_degrees_of_tilt() -> None:
    """Above 150 deg of tilt a heading difference means nothing and is NaN, just below it still stands (M17)."""
    tilt, heading = attitude.tilt_heading_between(degrees(), degrees(roll=np.array([149.99, 150.01, 180])))
    close(np.degrees(tilt), [149.99, 150.01, 180], 1e-12)
    assert np.isnan(heading).tolist() == [False, True, True]


def test_slerp_goes_the_short_way_at_a_constant_rate() -> None:
    """From yaw 170 to -170 deg the middle is 180, and a quarter of the way is 175 (M18)."""
    a, b = degrees(yaw=170), degrees(yaw=-170)
    close(np.degrees(attitude.heading(attitude.slerp(a, b, [0, 0.25, 0.5, 1]))), [170, 175, 180, 190], 1e-12)
    close(attitude.slerp(a, -b, 0.5), attitude.slerp(a, b, 0.5))
    assert np.isnan(attitude.slerp(a, b, [-0.01, 1.01])).all()
    near = attitude.quaternion_from_rotvec([0, 0, 1e-12])
    close(attitude.slerp(degrees(), near, 0.25)[3] / 0.125e-12, 1.0)
    close(attitude.slerp(a, a, 0.3), a)
    close(attitude.slerp(degrees(), degrees(roll=180), 0.5), degrees(roll=90))
    close(attitude.slerp(degrees(), [0, 0, 0, 1], 0.5), degrees(yaw=90))  # either way is short: as b's sign has it


def test_mean_attitude() -> None:
    """The mean of yaws 10 and 50 deg is 30, of any signs, three to one it is nearer to the three (M19)."""
    close(np.degrees(attitude.heading(attitude.mean([degrees(yaw=10), -degrees(yaw=50)]))), 30, 1e-12)
    rolls = degrees(roll=np.array([0, 0, 0, 40]))
    assert 9 < np.degrees(attitude.rpy_from_quaternion(attitude.mean(rolls))[0]) < 11
    pairs = attitude.normalise(np.random.default_rng(19).normal(size=(100, 2, 4)))
    assert (attitude.mean(pairs)[:, 0] > 0).all()
    bad = [[np.nan] * 4, [0.0] * 4]
    close(
        attitude.mean(np.array([*bad, degrees(yaw=10), degrees(yaw=50)])),
        attitude.mean([degrees(yaw=10), degrees(yaw=50)]),
    )
    assert np.isnan(attitude.mean(bad)).all()
    assert np.isnan(attitude.mean([degrees(), degrees(roll=180)])).all()
    half_turns = attitude.multiply(pairs[:, :1], [[1, 0, 0, 0], [0, 0, 1, 0]])
    assert np.isnan(attitude.mean(half_turns)).all()
    assert attitude.mean(np.broadcast_to(degrees(5, 6, 7), (3, 2, 4))).shape == (3, 4)


def test_a_stream_is_made_continuous() -> None:
    """Each sample gets the sign nearer to its predecessor, over a lost one too; the first keeps its own (M16)."""
    q = degrees(yaw=np.array([170, 175, 185, 190, 195]))
    signs = np.array([-1, 1, 1, -1, 1])[:, None]
    close(attitude.continuous(signs * q), -q)
    lost = signs * q
    lost[2] = np.nan
    close(np.delete(attitude.continuous(lost), 2, axis=0), np.delete(-q, 2, axis=0))
    assert np.isnan(attitude.continuous(lost)[2]).all()
    lost[:2] = 0.0
    close(attitude.continuous(lost)[3:], -q[3:])
    stacked = attitude.continuous([signs * q, -signs * q])
    close(stacked, [-q, q])
    two = np.stack([signs * q, signs * q])
    two[0, 2] = two[1, 1] = np.nan
    for stream, good in zip(attitude.continuous(two), ([0, 1, 3, 4], [0, 2, 3, 4]), strict=True):
        close(stream[good], -q[good])
    close(attitude.continuous(3.0 * signs * q), -3.0 * q)
    close(attitude.continuous(np.eye(4)), np.eye(4))  # half turns are equally near with either sign


def test_the_nearest_rotation() -> None:
    """A drifted matrix is brought back, a reflection gives a rotation too, rank one has no nearest (M2)."""
    R = attitude.matrix_from_quaternion(degrees(10, 20, 30))
    close(attitude.nearest_rotation(1.01 * R), R)
    skewed = R @ (np.eye(3) + 1e-3 * np.array([[0, 1, 2], [1, 0, 3], [2, 3, 0]]))
    close(attitude.nearest_rotation(skewed), R)
    mirrored = attitude.nearest_rotation(np.diag([2.0, 3.0, -1.0]))
    close(mirrored, np.diag([1.0, 1.0, 1.0]))
    assert np.isnan(attitude.nearest_rotation(np.zeros((3, 3)))).all()
    assert np.isnan(attitude.nearest_rotation(np.ones((3, 3)))).all()


def test_what_is_a_rotation() -> None:
    """Scale, skew and reflection are told from a rotation, within the tolerance (M2)."""
    R = attitude.matrix_from_quaternion(degrees(10, 20, 30))
    assert attitude.is_rotation([R, R.T, -R, 1.001 * R, R + 1e-3, np.zeros((3, 3))]).tolist() == [True, True] + 4 * [
        False
    ]
    assert attitude.is_rotation(1.001 * R, tolerance=0.01)
    assert not attitude.is_rotation(np.full((3, 3), np.nan))
    for line in range(3):
        for column in range(3):
            bent = R.copy()
            bent[line, column] += 1e-4
            assert not attitude.is_rotation(bent)
            stretched_or_sheared = np.eye(3)
            stretched_or_sheared[line, column] += 1e-4
            assert not attitude.is_rotation(R @ stretched_or_sheared)
    assert not attitude.is_rotation(np.zeros((3, 3)), tolerance=1.0)
    assert attitude.is_rotation(np.eye(3), tolerance=0.0)


def test_what_is_no_rotation_has_no_quaternion() -> None:
    """A reflection and a zero matrix give NaN rather than some attitude (M13)."""
    assert np.isnan(attitude.quaternion_from_matrix([np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3)), -np.eye(3)])).all()


def test_scalar_last() -> None:
    """The scalar moves to the other end and back (M15)."""
    assert attitude.xyzw_from_wxyz([1, 2, 3, 4]).tolist() == [2, 3, 4, 1]
    assert attitude.wxyz_from_xyzw([2, 3, 4, 1]).tolist() == [1, 2, 3, 4]


def test_infinitesimal_and_whole_turns() -> None:
    """Rotation vectors as small as floats go, and beyond one turn, keep their meaning."""
    close(attitude.quaternion_from_rotvec([2e-200, 0, 0])[1] / 1e-200, 1.0)
    close(attitude.rotvec_from_quaternion([1, 0, -1e-200, 0])[1] / -2e-200, 1.0)
    close(attitude.quaternion_from_rotvec([0, 0, 2 * np.pi]), [-1, 0, 0, 0])
    close(attitude.rotvec_from_quaternion([0, 0, -1, 0]), [0, -np.pi, 0])
    assert attitude.quaternion_from_rotvec([0, 0, 0]).tolist() == [1, 0, 0, 0]
    assert attitude.rotvec_from_quaternion([-2, 0, 0, 0]).tolist() == [0, 0, 0]
