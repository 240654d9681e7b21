"""Independent oracles: SciPy's Rotation in bulk, mpmath with 40 digits where double precision cannot judge."""

from collections.abc import Iterable, Iterator

import mpmath as mp
import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from gcs_bridge import attitude
from tests.helpers.attitude_cases import Array, random_quaternions, turn_between
from tests.helpers.everyday import one_in

Exact = list[mp.mpf]
N = 100_000
INTRINSIC = ["XYX", "XZX", "YXY", "YZY", "ZXZ", "ZYZ", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]
SEQUENCES = [letters for name in INTRINSIC for letters in (name, name.lower())]
PROPER = {name for name in SEQUENCES if name[0] == name[2]}


@pytest.fixture(scope="module")
def q() -> Array:
    return random_quaternions(np.random.default_rng(1), N)


@pytest.fixture(scope="module")
def other() -> Array:
    return random_quaternions(np.random.default_rng(2), N)


@pytest.fixture(autouse=True)
def forty_digits() -> Iterator[None]:
    with mp.workdps(40):
        yield


def rotation(q: Array) -> Rotation:
    return Rotation.from_quat(attitude.xyzw_from_wxyz(q))


def close(got: npt.ArrayLike, expected: npt.ArrayLike, tolerance: float = 1e-14) -> None:
    np.testing.assert_allclose(np.asarray(got), np.asarray(expected), rtol=0.0, atol=tolerance)


# SciPy


def test_matrices(q: Array) -> None:
    """1e5 random rotations have SciPy's matrices, and its quaternions back."""
    R = rotation(q).as_matrix()
    close(attitude.matrix_from_quaternion(q), R)
    assert turn_between(attitude.quaternion_from_matrix(R), q).max() < 1e-14


def test_rotation_vectors(q: Array) -> None:
    """1e5 random rotations have SciPy's rotation vectors, both ways."""
    v = rotation(q).as_rotvec()
    close(attitude.rotvec_from_quaternion(q), v, 1e-13)
    close(attitude.rotvec_from_quaternion(-q), v, 1e-13)
    assert turn_between(attitude.quaternion_from_rotvec(v), q).max() < 1e-14
    angle = np.linalg.norm(v, axis=1)
    assert turn_between(attitude.quaternion_from_axis_angle(3.0 * v, angle), q).max() < 1e-14


def test_products_vectors_and_distances(q: Array, other: Array) -> None:
    """Products, turned vectors and distances of 1e5 random pairs are SciPy's."""
    v = np.random.default_rng(3).normal(size=(N, 3))
    a, b = rotation(q), rotation(other)
    assert turn_between(attitude.multiply(q, other), attitude.wxyz_from_xyzw((a * b).as_quat())).max() < 1e-14
    close(attitude.rotate(q, v), a.apply(v))
    close(attitude.rotate(attitude.conjugate(q), v), a.inv().apply(v))
    close(attitude.angle_between(q, other), (a.inv() * b).magnitude(), 1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("sequence", SEQUENCES)
def test_euler_angles(q: Array, sequence: str) -> None:
    """All 24 sequences of 1e4 random rotations agree with SciPy to 1e-12 rad away from their singularities."""
    q = q[: N // 10]
    expected = rotation(q).as_euler(sequence)
    got = attitude.euler_from_quaternion(q, sequence)
    away = ~attitude.near_gimbal_lock(q, 1e-2, sequence)
    assert away.mean() > 0.98
    difference = got - expected
    close(difference[away] - 2 * np.pi * np.round(difference[away] / (2 * np.pi)), 0.0, 1e-12)
    made = attitude.wxyz_from_xyzw(Rotation.from_euler(sequence, expected).as_quat())
    assert turn_between(attitude.quaternion_from_euler(expected, sequence), made).max() < 1e-14
    close(attitude.matrix_from_euler(expected, sequence), rotation(made).as_matrix(), 1e-14)
    difference = (attitude.euler_from_matrix(rotation(q).as_matrix(), sequence) - expected)[away]
    close(difference - 2 * np.pi * np.round(difference / (2 * np.pi)), 0.0, 1e-12)


def test_means(q: Array) -> None:
    """The mean of a cluster of attitudes is SciPy's."""
    cluster = attitude.multiply(
        q[0], attitude.quaternion_from_rotvec(0.3 * np.random.default_rng(4).normal(size=(50, 3)))
    )
    assert turn_between(attitude.mean(cluster), attitude.wxyz_from_xyzw(rotation(cluster).mean().as_quat())) < 1e-13


def test_nearest_rotations(q: Array) -> None:
    """A noisy matrix is brought to SciPy's nearest rotation, whose determinant is +1."""
    noisy = attitude.matrix_from_quaternion(q[:500]) + 0.05 * np.random.default_rng(5).normal(size=(500, 3, 3))
    close(attitude.nearest_rotation(noisy), Rotation.from_matrix(noisy).as_matrix(), 1e-12)


def test_nearest_rotations_of_anything() -> None:
    """Of random matrices, half of them reflections, it is Davenport's: the q with the largest tr(R^T M) = q^T K q."""
    given = np.random.default_rng(6).normal(size=(500, 3, 3))
    assert 200 < (np.linalg.det(given) < 0).sum() < 300
    by_q = np.empty((500, 4, 4))
    trace, mirrored = np.trace(given, axis1=1, axis2=2), given.swapaxes(1, 2)
    by_q[:, 0, 0] = trace
    by_q[:, 0, 1:] = by_q[:, 1:, 0] = (given - mirrored)[:, [2, 0, 1], [1, 2, 0]]
    by_q[:, 1:, 1:] = given + mirrored - trace[:, None, None] * np.eye(3)
    close(attitude.nearest_rotation(given), rotation(np.linalg.eigh(by_q)[1][:, :, -1]).as_matrix(), 1e-12)


# mpmath


def mp_product(a: Exact, b: Exact) -> Exact:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]


def mp_conjugate(q: Exact) -> Exact:
    return [q[0], -q[1], -q[2], -q[3]]


def mp_exact(q: Iterable[float]) -> Exact:
    return [mp.mpf(float(part)) for part in q]


def mp_euler(angles: Iterable[float], sequence: str) -> Exact:
    """The rotation that three angles describe, by three elementary quaternions."""
    q = [mp.mpf(1), mp.mpf(0), mp.mpf(0), mp.mpf(0)]
    for letter, angle in zip(sequence, angles, strict=True):
        half = mp.mpf(float(angle)) / 2
        turn = [mp.cos(half), mp.mpf(0), mp.mpf(0), mp.mpf(0)]
        turn["xyz".index(letter.lower()) + 1] = mp.sin(half)
        q = mp_product(q, turn) if sequence.isupper() else mp_product(turn, q)
    return q


def mp_angle(a: Exact, b: Exact) -> mp.mpf:
    w, x, y, z = mp_product(mp_conjugate(a), b)
    return 2 * mp.atan2(mp.sqrt(x * x + y * y + z * z), abs(w))


def mp_log(q: Exact) -> Exact:
    w, *v = q
    size = mp.sqrt(sum(part * part for part in v))
    if size == 0:
        return [mp.mpf(0)] * 3
    angle = 2 * mp.atan2(size, abs(w)) * (1 if w >= 0 else -1)
    return [part * angle / size for part in v]


def mp_exp(v: Exact) -> Exact:
    angle = mp.sqrt(sum(part * part for part in v))
    return [mp.cos(angle / 2), *(part * mp.sin(angle / 2) / angle if angle else mp.mpf(0) for part in v)]


def mp_matrix(q: Exact) -> list[Exact]:
    w, x, y, z = q
    n = w * w + x * x + y * y + z * z
    return [
        [1 - 2 * (y * y + z * z) / n, 2 * (x * y - w * z) / n, 2 * (x * z + w * y) / n],
        [2 * (x * y + w * z) / n, 1 - 2 * (x * x + z * z) / n, 2 * (y * z - w * x) / n],
        [2 * (x * z - w * y) / n, 2 * (y * z + w * x) / n, 1 - 2 * (x * x + y * y) / n],
    ]


def poles(sequence: str) -> tuple[float, float]:
    """The middle angles at which a sequence is singular (M7)."""
    return (0.0, np.pi) if sequence in PROPER else (-np.pi / 2, np.pi / 2)


def near_poles(sequence: str) -> Iterator[float]:
    """Middle angles at each singularity exactly, one float away, and at distances down from 1e-3."""
    for pole in poles(sequence):
        inward = 1.0 if pole <= 0 else -1.0
        yield pole
        yield np.nextafter(pole, inward)
        yield from (pole + inward * distance for distance in (1e-17, 1e-15, 1e-12, 1e-9, 1e-7, 1e-4, 1e-3))


@pytest.mark.parametrize("sequence", one_in(8, SEQUENCES))
def test_at_and_near_the_poles(sequence: str) -> None:
    """There angles describe the rotation to 5e-15 rad, of float64 and of float32 quaternions and of matrices.

    The mask tells those nearer than its tolerance, and at the pole itself the angle listed last is zero (M5).
    """
    for middle in near_poles(sequence):
        for first, last in ((0.7, -2.3), (3.0, 1.1)):
            angles = np.array([first, middle, last])
            exact = mp_euler(angles, sequence)
            assert mp_angle(mp_exact(attitude.quaternion_from_euler(angles, sequence)), exact) < 1e-15
            double = np.array([float(part) for part in exact])
            for q in (double, -double, double.astype(np.float32)):
                distance = min(abs(middle - pole) for pole in poles(sequence))
                assert attitude.near_gimbal_lock(q, 3e-4, sequence) == (distance < 3e-4)
                got = attitude.euler_from_quaternion(q, sequence)
                assert got[2] == 0.0 or distance > 0.0 or q.dtype == np.float32
                assert np.isfinite(got).all()
                assert mp_angle(mp_euler(got, sequence), mp_exact(q)) < 5e-15
            R = np.array([[float(part) for part in line] for line in mp_matrix(exact)])
            assert mp_angle(mp_euler(attitude.euler_from_matrix(R, sequence), sequence), exact) < 5e-15


@pytest.mark.parametrize("sign", [1, -1])
def test_pitch_near_the_vertical_keeps_its_digits(sign: int) -> None:
    """Pitch itself, 1e-9 rad from the pole, is right to 1e-15 rad, where asin would lose 7 digits (M14)."""
    for distance in (1e-3, 1e-6, 1e-9, 1e-12):
        pitch = sign * (np.pi / 2 - distance)
        q = np.array([float(part) for part in mp_euler([0.7, pitch, -0.4], "ZYX")])
        assert abs(attitude.rpy_from_quaternion(q)[1] - pitch) < 1e-15


SIZES_RAD = [1e-200, 1e-30, 1e-16, 1e-9, 1e-4, 1.0, 3.0, np.pi - 1e-9, np.pi - 1e-15, np.pi, 6.0, 2 * np.pi, 500.0]


@pytest.mark.parametrize("size", SIZES_RAD)
def test_exp_and_log_at_both_ends(size: float) -> None:
    """Rotation vectors from 1e-200 rad to half a turn keep every digit, relative to their size, as do turns (M9)."""
    v = size * np.array([0.48, -0.6, 0.64])
    exact = mp_exp(mp_exact(v))
    got = attitude.quaternion_from_rotvec(v)
    for part, truth in zip(got, exact, strict=True):
        assert abs(part - truth) <= 1e-15 * min(1.0, size) or abs(part - truth) <= 2e-16 * abs(truth)
    for sign in (1.0, -1.0):
        log = attitude.rotvec_from_quaternion(sign * got)
        for part, truth in zip(log, mp_log(mp_exact(got)), strict=True):
            assert abs(part - truth) <= 1e-15 * size


@pytest.mark.parametrize("size", [0.0, 1e-16, 1e-15, 1e-12, 1e-8, 1e-4, 1.0, np.pi - 1e-8])
def test_distance_is_exact(size: float) -> None:
    """Of two given quaternions the distance is exact to 1e-15 rad, near zero and near half a turn (M17)."""
    for start in random_quaternions(np.random.default_rng(7), 5):
        end = attitude.multiply(start, attitude.quaternion_from_rotvec(size * np.array([0.48, -0.6, 0.64])))
        exact = mp_angle(mp_exact(start), mp_exact(end))
        assert abs(attitude.angle_between(start, end) - exact) < 1e-15


@pytest.mark.parametrize("size", [1e-12, 1e-8, 1e-5, 0.1, 2.0])
def test_slerp_of_small_and_large_steps(size: float) -> None:
    """The interpolated attitude is a * exp(t log(a* b)) to the last digits, for tiny steps too (M18)."""
    start = random_quaternions(np.random.default_rng(8))
    end = attitude.multiply(start, attitude.quaternion_from_rotvec(size * np.array([0.48, -0.6, 0.64])))
    for t in (0.1, 0.5, 0.9):
        step = mp_log(mp_product(mp_conjugate(mp_exact(start)), mp_exact(end)))
        exact = mp_product(mp_exact(start), mp_exp([mp.mpf(t) * part for part in step]))
        assert mp_angle(mp_exact(attitude.slerp(start, end, t)), exact) < 1e-15


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 0.9e-4, 1.1e-4, 1e-2, 1.0, 3.0, 5.0])
def test_right_jacobian_inverse_is_the_derivative_of_the_log(size: float) -> None:
    """J_r^-1(phi) w is d/dt log(exp(phi) exp(w t)) by 40 digits, with a small step and to 1e-15."""
    phi, w = size * np.array([0.48, -0.6, 0.64]), np.array([0.3, 0.5, -0.7])
    step = mp.mpf(10) ** -18

    def moved(sign: int) -> Exact:
        turn = mp_product(mp_exp(mp_exact(phi)), mp_exp([sign * step * part for part in mp_exact(w)]))
        log = mp_log(turn)
        if size > np.pi:  # the derivative of the vector itself, not of its short form
            whole = mp.sqrt(sum(part * part for part in log))
            log = [part * (1 - 2 * mp.pi / whole) for part in log]
        return log

    exact = [(after - before) / (2 * step) for after, before in zip(moved(1), moved(-1), strict=True)]
    for part, truth in zip(attitude.right_jacobian_inverse_times(phi, w), exact, strict=True):
        assert abs(part - truth) < 2e-15 * (1 + size)


def test_hermite_against_its_definition() -> None:
    """The interpolant is q0 * exp of the cubic through log and slopes, written out in 40 digits (M18)."""
    rng = np.random.default_rng(9)
    for size in (1e-6, 0.3, 2.5):
        q0 = random_quaternions(rng)
        q1 = attitude.integrate(q0, size * rng.normal(size=3) / 2, 1.0)
        w0, w1, dt, u = rng.normal(size=3), rng.normal(size=3), 0.4, 0.3
        phi1 = mp_log(mp_product(mp_conjugate(mp_exact(q0)), mp_exact(q1)))
        slope1 = mp_exact(attitude.right_jacobian_inverse_times([float(part) for part in phi1], w1))
        u_mp, dt_mp = mp.mpf(u), mp.mpf(dt)
        h10, h01, h11 = u_mp**3 - 2 * u_mp**2 + u_mp, 3 * u_mp**2 - 2 * u_mp**3, u_mp**3 - u_mp**2
        phi = [h10 * dt_mp * a + h01 * b + h11 * dt_mp * c for a, b, c in zip(mp_exact(w0), phi1, slope1, strict=True)]
        exact = mp_product(mp_exact(q0), mp_exp(phi))
        assert mp_angle(mp_exact(attitude.hermite(q0, q1, w0, w1, dt, u)[0]), exact) < 2e-15
