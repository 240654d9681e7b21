"""Laws that hold for every rotation, searched for counterexamples."""

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs_bridge import attitude
from tests.helpers.attitude_cases import Array, turn_between
from tests.helpers.everyday import searched


def law(*strategies: st.SearchStrategy[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Search for one in sixty cases, where sweeps are run."""
    search = searched(60)
    return lambda test: search(given(*strategies)(test))


TIGHT_RAD = 1e-14
"""Some tens of roundings of numbers near one."""

numbers = st.floats(-1.0, 1.0, allow_subnormal=False).map(lambda x: 0.0 if abs(x) < 1e-30 else x)
quaternions = arrays(float, 4, elements=numbers).filter(lambda q: np.linalg.norm(q) > 0.1).map(attitude.normalise)
vectors = arrays(float, 3, elements=st.floats(-10.0, 10.0))
angles = arrays(float, 3, elements=st.floats(-7.0, 7.0))
shares = st.floats(0.0, 1.0)
TAIT_BRYAN = ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]
PROPER = ["XYX", "XZX", "YXY", "YZY", "ZXZ", "ZYZ"]
sequences = st.sampled_from([s for name in TAIT_BRYAN + PROPER for s in (name, name.lower())])
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def same(a: Array, b: Array, tolerance: float = TIGHT_RAD) -> bool:
    return bool(turn_between(a, b) < tolerance)


@law(quaternions, quaternions, quaternions)
def test_rotations_are_a_group(a: Array, b: Array, c: Array) -> None:
    """The product is associative, keeps unit norm, has a neutral element and an inverse (M10)."""
    product = attitude.multiply
    np.testing.assert_allclose(product(product(a, b), c), product(a, product(b, c)), rtol=0, atol=2e-15)
    assert abs(np.linalg.norm(product(a, b)) - 1.0) < 1e-15
    np.testing.assert_array_equal(product(a, IDENTITY), a)
    np.testing.assert_array_equal(product(IDENTITY, a), a)
    np.testing.assert_allclose(product(a, attitude.conjugate(a)), IDENTITY, rtol=0, atol=1e-15)


@law(quaternions, quaternions, vectors)
def test_products_rotate_one_after_the_other(a: Array, b: Array, v: Array) -> None:
    """Turning by a * b is turning by b, then by a; matrices multiply alike (M10, M12)."""
    scale = 1e-15 * (1.0 + float(np.linalg.norm(v)))
    turned = attitude.rotate(a, attitude.rotate(b, v))
    np.testing.assert_allclose(attitude.rotate(attitude.multiply(a, b), v), turned, rtol=0, atol=8 * scale)
    R = attitude.matrix_from_quaternion(a) @ attitude.matrix_from_quaternion(b)
    np.testing.assert_allclose(R @ v, turned, rtol=0, atol=8 * scale)
    np.testing.assert_allclose(attitude.rotate(attitude.conjugate(a), attitude.rotate(a, v)), v, rtol=0, atol=8 * scale)


@law(quaternions)
def test_double_cover(q: Array) -> None:
    """q and -q are one attitude in every form (M16)."""
    np.testing.assert_array_equal(attitude.matrix_from_quaternion(q), attitude.matrix_from_quaternion(-q))
    np.testing.assert_array_equal(attitude.body_down(q), attitude.body_down(-q))
    assert attitude.angle_between(q, -q) == 0.0
    assert same(
        attitude.quaternion_from_rotvec(attitude.rotvec_from_quaternion(q)),
        attitude.quaternion_from_rotvec(attitude.rotvec_from_quaternion(-q)),
    )
    for sequence in ("ZYX", "xzx"):
        one, other = (attitude.euler_from_quaternion(p, sequence) for p in (q, -q))
        assert same(attitude.quaternion_from_euler(one, sequence), attitude.quaternion_from_euler(other, sequence))


@law(quaternions)
def test_matrices_are_rotations_and_come_back(q: Array) -> None:
    """A quaternion's matrix is a rotation to the last digits, is its own nearest one, and gives the quaternion back."""
    R = attitude.matrix_from_quaternion(q)
    assert attitude.is_rotation(R, 1e-15)
    assert same(attitude.quaternion_from_matrix(R), q, 3e-15)
    np.testing.assert_allclose(attitude.nearest_rotation(R), R, rtol=0, atol=4e-15)


@law(quaternions)
def test_log_and_exp_are_inverse(q: Array) -> None:
    """exp(log q) is q, and the log is never longer than half a turn (M9)."""
    v = attitude.rotvec_from_quaternion(q)
    assert np.linalg.norm(v) <= np.pi * (1 + 1e-15)
    assert same(attitude.quaternion_from_rotvec(v), q, 3e-15)


@law(quaternions, sequences)
def test_euler_angles_come_back_as_the_same_rotation(q: Array, sequence: str) -> None:
    """All 24 sequences describe the rotation exactly, within their ranges, from a quaternion and from a matrix (M7)."""
    for got in (
        attitude.euler_from_quaternion(q, sequence),
        attitude.euler_from_matrix(attitude.matrix_from_quaternion(q), sequence),
    ):
        assert same(attitude.quaternion_from_euler(got, sequence), q)
        np.testing.assert_allclose(
            attitude.matrix_from_euler(got, sequence), attitude.matrix_from_quaternion(q), rtol=0, atol=TIGHT_RAD
        )
        low, high = (0.0, np.pi) if sequence.upper() in PROPER else (-np.pi / 2, np.pi / 2)
        assert low <= got[1] <= high
        assert (-np.pi < got[[0, 2]]).all()
        assert (got[[0, 2]] <= np.pi).all()


@law(angles, sequences)
def test_an_extrinsic_sequence_is_the_intrinsic_one_backwards(abc: Array, sequence: str) -> None:
    """'zyx' of a, b, c is 'XYZ' of c, b, a (M7)."""
    backwards = sequence[::-1].swapcase()
    np.testing.assert_array_equal(
        attitude.quaternion_from_euler(abc, sequence), attitude.quaternion_from_euler(abc[::-1], backwards)
    )


@law(angles, sequences)
def test_euler_angles_are_three_elementary_turns(abc: Array, sequence: str) -> None:
    """Intrinsic turns multiply from left to right, extrinsic ones from right to left (M1, M7)."""
    first, second, third = (attitude.elementary_rotation(*pair) for pair in zip(sequence, abc, strict=True))
    R = first @ second @ third if sequence.isupper() else third @ second @ first
    np.testing.assert_allclose(attitude.matrix_from_euler(abc, sequence), R, rtol=0, atol=4e-15)


@law(angles)
def test_roll_pitch_yaw_is_the_sequence_zyx(abc: Array) -> None:
    """The named form is the general one with yaw, pitch, roll, both ways."""
    yaw, pitch, roll = abc
    q = attitude.quaternion_from_rpy(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    np.testing.assert_array_equal(q, attitude.quaternion_from_euler(abc))
    np.testing.assert_array_equal(attitude.rpy_from_quaternion(q), attitude.euler_from_quaternion(q)[::-1])


@law(quaternions, quaternions)
def test_distance_is_a_metric_that_frames_cannot_change(a: Array, b: Array) -> None:
    """It is symmetric, the length of the rotation vector between, and blind to world and body frames (M17)."""
    angle = attitude.angle_between(a, b)
    assert 0.0 <= angle <= np.pi
    assert abs(angle - attitude.angle_between(b, a)) < 1e-15
    assert abs(angle - turn_between(a, b)) < 1e-7  # the chord loses half of the digits near half a turn
    between = attitude.rotvec_from_quaternion(attitude.multiply(attitude.conjugate(a), b))
    assert abs(angle - np.linalg.norm(between)) < 2e-15
    for change in (attitude.enu_flu_from_ned_frd, attitude.enu_rfu_from_ned_frd):
        assert abs(attitude.angle_between(change(a), change(b)) - angle) < 4e-15


@law(quaternions, quaternions, st.floats(-3.0, 3.0))
def test_tilt_is_the_angle_between_the_downs(a: Array, b: Array, yaw: float) -> None:
    """It ignores a common or a single turn of the world about down, which all goes to the heading (M17)."""
    tilt, heading = attitude.tilt_heading_between(a, b)
    down_a, down_b = attitude.body_down(a), attitude.body_down(b)
    assert abs(tilt - np.arctan2(np.linalg.norm(np.cross(down_a, down_b)), down_a @ down_b)) < 2e-15
    turn = attitude.quaternion_from_rotvec([0, 0, yaw])
    tilt_turned, heading_turned = attitude.tilt_heading_between(a, attitude.multiply(turn, b))
    assert abs(tilt_turned - tilt) < 4e-15
    if tilt < np.radians(149):
        assert abs(np.angle(np.exp(1j * (heading_turned - heading - yaw)))) < 2e-14
    else:
        assert np.isnan(heading) or tilt <= np.radians(150)


@law(quaternions, quaternions, shares)
def test_slerp_divides_the_short_way(a: Array, b: Array, t: float) -> None:
    """The point at t is t of the distance from a and the rest from b, has unit norm, and mirrors backwards (M18)."""
    whole = attitude.angle_between(a, b)
    between = attitude.slerp(a, b, t)
    assert abs(np.linalg.norm(between) - 1.0) < 1e-15
    assert abs(attitude.angle_between(a, between) - t * whole) < 4e-15
    assert abs(attitude.angle_between(between, b) - (1 - t) * whole) < 4e-15
    if whole < 3.1:
        assert same(attitude.slerp(b, a, 1.0 - t), between)


@law(quaternions, vectors, st.floats(-0.3, 0.3))
def test_integrating_forth_and_back(q: Array, w: Array, dt: float) -> None:
    """A step and the step back, and two halves of a step, agree; between a and b lie the rates that led there (M20)."""
    there = attitude.integrate(q, w, dt)
    assert abs(np.linalg.norm(there) - 1.0) < 4e-16
    assert same(attitude.integrate(there, w, -dt), q)
    assert same(attitude.integrate(attitude.integrate(q, w, dt / 2), w, dt / 2), there)


@law(quaternions, vectors)
def test_frames_go_round(q: Array, v: Array) -> None:
    """Every change of frame undone is the identity, for quaternions, matrices, vectors and angles (M15, M24)."""
    R = attitude.matrix_from_quaternion(q)
    rpy = attitude.rpy_from_quaternion(q)
    np.testing.assert_array_equal(attitude.wxyz_from_xyzw(attitude.xyzw_from_wxyz(q)), q)
    for there, back in (
        (attitude.enu_flu_from_ned_frd, attitude.ned_frd_from_enu_flu),
        (attitude.enu_rfu_from_ned_frd, attitude.ned_frd_from_enu_rfu),
    ):
        np.testing.assert_allclose(back(there(q)), q, rtol=0, atol=1e-15)
        np.testing.assert_allclose(there(back(q)), q, rtol=0, atol=1e-15)
    for to_other, to_ours in (
        (attitude.enu_flu_matrix_from_ned_frd, attitude.ned_frd_matrix_from_enu_flu),
        (attitude.enu_rfu_matrix_from_ned_frd, attitude.ned_frd_matrix_from_enu_rfu),
    ):
        np.testing.assert_array_equal(to_ours(to_other(R)), R)
    for turned, turned_back in (
        (attitude.enu_from_ned, attitude.ned_from_enu),
        (attitude.flu_from_frd, attitude.frd_from_flu),
        (attitude.rfu_from_frd, attitude.frd_from_rfu),
    ):
        np.testing.assert_array_equal(turned_back(turned(v)), v)
    flu = attitude.enu_flu_rpy_from_ned_frd(rpy)
    assert -np.pi < flu[2] <= np.pi
    np.testing.assert_allclose(attitude.ned_frd_rpy_from_enu_flu(flu)[:2], rpy[:2], rtol=0, atol=0)
    assert same(attitude.quaternion_from_euler(flu[::-1]), attitude.enu_flu_from_ned_frd(q))
    rfu = attitude.enu_rfu_matrix_from_rpy(rpy)
    np.testing.assert_allclose(rfu, attitude.enu_rfu_matrix_from_ned_frd(R), rtol=0, atol=TIGHT_RAD)


@law(quaternions, vectors)
def test_a_vector_is_the_same_in_every_frame(q: Array, v_b: Array) -> None:
    """Turning in NED and FRD, then changing frames, equals changing frames, then turning in ENU (M24)."""
    v_enu = attitude.enu_from_ned(attitude.rotate(q, v_b))
    tolerance = 1e-14 * (1 + float(np.linalg.norm(v_b)))
    flu = attitude.rotate(attitude.enu_flu_from_ned_frd(q), attitude.flu_from_frd(v_b))
    rfu = attitude.rotate(attitude.enu_rfu_from_ned_frd(q), attitude.rfu_from_frd(v_b))
    np.testing.assert_allclose(flu, v_enu, rtol=0, atol=tolerance)
    np.testing.assert_allclose(rfu, v_enu, rtol=0, atol=tolerance)


@law(quaternions, vectors)
def test_force_and_acceleration_are_inverse(q: Array, a_n: Array) -> None:
    """The acceleration of a specific force is the one it was made of; the level frame only turns it (M21, M22)."""
    f_b = attitude.specific_force(q, a_n)
    np.testing.assert_allclose(attitude.acceleration_ned(q, f_b), a_n, rtol=0, atol=2e-14)
    level = attitude.acceleration_level(q, f_b)
    np.testing.assert_allclose(level, attitude.level_from_ned(q, a_n), rtol=0, atol=2e-14)
    turned_back = attitude.rotate(attitude.quaternion_from_rotvec([0, 0, float(attitude.heading(q))]), level)
    np.testing.assert_allclose(turned_back, a_n, rtol=0, atol=3e-14)
    np.testing.assert_allclose(
        attitude.body_down(q),
        attitude.down_from_specific_force(attitude.specific_force(q, [0, 0, 0])),
        rtol=0,
        atol=1e-15,
    )


@law(
    arrays(float, (6, 4), elements=numbers).filter(lambda q: (np.linalg.norm(q, axis=1) > 0.1).all()),
    st.integers(0, 63),
)
def test_continuity_undoes_any_flips(q: Array, flips: int) -> None:
    """Whatever signs a stream has, the continuous one begins alike and never turns its back (M16)."""
    signs = np.array([1 - 2 * (flips >> i & 1) for i in range(6)])[:, None]
    smooth = attitude.continuous(signs * q)
    assert ((smooth[1:] * smooth[:-1]).sum(axis=1) >= 0).all()
    np.testing.assert_array_equal(smooth[0], signs[0] * q[0])
    np.testing.assert_array_equal(np.abs(smooth), np.abs(q))
    np.testing.assert_array_equal(attitude.continuous(smooth), smooth)


@law(quaternions, arrays(float, (5, 3), elements=st.floats(-0.5, 0.5)), st.integers(0, 31))
def test_the_mean_turns_with_its_samples(q: Array, spread: Array, flips: int) -> None:
    """Whatever the signs, the mean of samples around q is q's turn of the mean around none (M19)."""
    samples = attitude.quaternion_from_rotvec(spread)
    signs = np.array([1 - 2 * (flips >> i & 1) for i in range(5)])[:, None]
    turned = attitude.mean(signs * attitude.multiply(q, samples))
    assert same(turned, attitude.multiply(q, attitude.mean(samples)), 1e-13)
