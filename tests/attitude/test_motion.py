"""Rates, interpolation, accelerometer, dead reckoning: stories with numbers worked by hand."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from gcs_bridge import attitude
from tests.helpers.attitude_cases import Array, random_quaternions, turn_between

G = 9.80665
LEVEL = [1.0, 0.0, 0.0, 0.0]


def close(got: npt.ArrayLike, expected: npt.ArrayLike, tolerance: float = 1e-14) -> None:
    np.testing.assert_allclose(np.asarray(got), np.asarray(expected), rtol=0.0, atol=tolerance)


def degrees(roll: npt.ArrayLike = 0.0, pitch: npt.ArrayLike = 0.0, yaw: npt.ArrayLike = 0.0) -> Array:
    roll, pitch, yaw = np.radians(roll), np.radians(pitch), np.radians(yaw)
    return attitude.quaternion_from_rpy(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)


# Rates


def test_omega_matrix_as_printed() -> None:
    """Omega has the rows of M20, and half of it times q is dq/dt."""
    assert attitude.omega_matrix([1, 2, 3]).tolist() == [[0, -1, -2, -3], [1, 0, 3, -2], [2, -3, 0, 1], [3, 2, -1, 0]]
    assert attitude.omega_matrix([0, 0, 0]).tolist() == np.zeros((4, 4)).tolist()
    q, w = degrees(10, 20, 30), np.array([0.4, -1.0, 2.0])
    close(0.5 * attitude.omega_matrix(w) @ q, attitude.quaternion_rate(q, w))
    close(0.5 * attitude.multiply(q, [0, *w]), attitude.quaternion_rate(q, w))


def test_a_body_rate_turns_about_the_body_axis() -> None:
    """Rolled right by 90 deg, z points west: -90 deg/s about it for 1 s takes the nose straight up."""
    q = attitude.integrate(degrees(roll=90), np.radians([0, 0, -90]), 1.0)
    close(attitude.rotate(q, [1, 0, 0]), [0, 0, -1])
    close(attitude.rotate(attitude.integrate(LEVEL, np.radians([0, 0, 90]), 1.0), [1, 0, 0]), [0, 1, 0])
    close(attitude.rotate(attitude.integrate(LEVEL, np.radians([0, 45, 0]), 2.0), [1, 0, 0]), [0, 0, -1])
    close(attitude.integrate(LEVEL, [0.0, 0.0, 1.0], -0.5), attitude.quaternion_from_rotvec([0, 0, -0.5]))


def test_a_small_step_follows_the_quaternion_rate() -> None:
    """For a small step, integrate moves by dq/dt times the step."""
    q, w, dt = degrees(10, 20, 30), np.array([0.4, -1.0, 2.0]), 1e-6
    central = (attitude.integrate(q, w, dt) - attitude.integrate(q, w, -dt)) / (2 * dt)
    close(central, attitude.quaternion_rate(q, w), 1e-9)


def test_rates_between_undo_a_step() -> None:
    """The rates that lead from a to b are those that led there, of either sign, backwards too (M20)."""
    rng = np.random.default_rng(20)
    a, w = random_quaternions(rng, 500), rng.normal(size=(500, 3))
    for dt in (0.02, -0.5):
        close(attitude.body_rates_between(a, -attitude.integrate(a, w, dt), dt), w, 1e-13)
    assert np.isnan(attitude.body_rates_between(a[0], a[1], 0.0)).all()


def test_euler_rates_by_hand() -> None:
    """Rolled right by 90 deg, the body's y points down: pitch rate about it is yaw rate; r is pitch rate reversed."""
    close(attitude.euler_rates_from_body_rates([0, 0, 0], [0, 1, 0]), [0, 1, 0])
    close(attitude.euler_rates_from_body_rates([np.pi / 2, 0, 0], [0, 1, 0]), [0, 0, 1])
    close(attitude.euler_rates_from_body_rates([np.pi / 2, 0, 0], [0, 0, 1]), [0, -1, 0])
    close(attitude.euler_rates_from_body_rates([0, np.pi / 4, 0], [0, 0, 1]), [1, 0, 2**0.5])
    close(attitude.body_rates_from_euler_rates([0, np.pi / 6, 2.0], [0, 0, 1]), [-0.5, 0, 0.75**0.5])
    assert np.isnan(attitude.euler_rates_from_body_rates([0, np.pi / 2, 0], [1, 1, 1])).all()


def test_euler_rates_are_the_derivative_of_the_angles() -> None:
    """Roll, pitch and yaw of a turning body change as M20 says."""
    rng = np.random.default_rng(21)
    rpy = np.column_stack([rng.uniform(-3, 3, 300), rng.uniform(-1.3, 1.3, 300), rng.uniform(-3, 3, 300)])
    w, dt = rng.normal(size=(300, 3)), 1e-5
    q = attitude.quaternion_from_rpy(roll_rad=rpy[:, 0], pitch_rad=rpy[:, 1], yaw_rad=rpy[:, 2])
    later, sooner = (attitude.rpy_from_quaternion(attitude.integrate(q, w, step)) for step in (dt, -dt))
    rates = attitude.euler_rates_from_body_rates(rpy, w)
    close((later - sooner) / (2 * dt), rates, 1e-6)
    close(attitude.body_rates_from_euler_rates(rpy, rates), w, 1e-13)


# Hermite


def test_hermite_meets_both_samples() -> None:
    """At the ends the interpolant has the samples' attitudes and body rates (M18)."""
    rng = np.random.default_rng(22)
    q0, q1 = random_quaternions(rng, 2, 300)
    w0, w1 = rng.normal(size=(2, 300, 3))
    for u, q_end, w_end in ((0.0, q0, w0), (1.0, q1, w1)):
        q, w = attitude.hermite(q0, q1, w0, w1, 0.3, u)
        assert turn_between(q, q_end).max() < 4e-15
        close(np.linalg.norm(q, axis=-1), 1.0)
        close(w, w_end, 1e-12)
    close(attitude.hermite(q0, q1, w0, w1, 0.3, 0.0)[0], q0)


def test_hermite_rates_are_the_turning_of_its_attitudes() -> None:
    """Between the ends the rates given are those of the attitudes given."""
    rng = np.random.default_rng(23)
    q0, w0, w1 = random_quaternions(rng, 200), rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    q1 = attitude.integrate(q0, 5 * rng.normal(size=(200, 3)), 0.4)
    du, dt = 1e-5, 0.4
    for u in (0.2, 0.5, 0.9):
        before, after = (attitude.hermite(q0, q1, w0, w1, dt, u + step)[0] for step in (-du, du))
        rates = attitude.body_rates_between(before, after, 2 * du * dt)
        close(attitude.hermite(q0, q1, w0, w1, dt, u)[1], rates, 1e-7)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-5, 0.1, 3.0])
def test_hermite_of_a_constant_rate_is_exact(size: float) -> None:
    """At a constant rate the interpolant is the motion itself, for steps of any size, backwards in time too."""
    w = size * np.array([0.6, 0.0, -0.8])
    q0 = degrees(10, 20, 30)
    q, rates = attitude.hermite(q0, attitude.integrate(q0, w, 1.0), w, w, 1.0, [0.25, 0.5])
    close(q, attitude.integrate(q0, w, [0.25, 0.5]), 2e-15)
    close(rates, [w, w], 4e-15)
    q, rates = attitude.hermite(attitude.integrate(q0, w, 1.0), q0, w, w, -1.0, [0.75, 0.5])
    close(q, attitude.integrate(q0, w, [0.25, 0.5]), 2e-15)
    close(rates, [w, w], 4e-15)


def test_hermite_follows_a_wobble_better_than_slerp() -> None:
    """On a coning motion sampled at 5 Hz its error is a small part of slerp's."""

    def coning(t: Array) -> Array:
        return attitude.quaternion_from_rotvec(0.5 * np.stack([np.cos(4 * t), np.sin(4 * t), 0 * t], axis=-1))

    def rates(t: Array) -> Array:
        return attitude.body_rates_between(coning(t - 1e-6), coning(t + 1e-6), 2e-6)

    t, h = np.linspace(0, 2, 11), 0.2
    q0, q1 = coning(t), coning(t + h)
    truth = coning(t + h / 2)
    hermite = attitude.angle_between(attitude.hermite(q0, q1, rates(t), rates(t + h), h, 0.5)[0], truth)
    assert hermite.max() < 0.05 * attitude.angle_between(attitude.slerp(q0, q1, 0.5), truth).max()


def test_hermite_does_not_extrapolate() -> None:
    """Outside the two samples, and for samples at one instant, the answer is NaN."""
    q, w = attitude.hermite(LEVEL, LEVEL, [0, 0, 1], [0, 0, 1], [1, 1, 0], [-0.1, 1.1, 0.5])
    assert np.isnan(q).all()
    assert np.isnan(w).all()


# Accelerometer


def test_specific_force_at_rest() -> None:
    """Level at rest reads -g on z in FRD, +g on a sensor whose z points up, 0 in free fall (M21)."""
    assert attitude.specific_force(LEVEL, [0, 0, 0]).tolist() == [0, 0, -G]
    assert attitude.flu_from_frd(attitude.specific_force(LEVEL, [0, 0, 0])).tolist() == [0, 0, G]
    assert attitude.specific_force(degrees(10, 20, 30), [0, 0, G]).tolist() == [0, 0, 0]
    close(attitude.specific_force(degrees(roll=90), [0, 0, 0]), [0, -G, 0])
    close(attitude.specific_force(degrees(pitch=90), [0, 0, 0]), [G, 0, 0])
    close(attitude.specific_force(degrees(yaw=90), [0, 3, 0]), [3, 0, -G])


def test_acceleration_of_a_specific_force() -> None:
    """Reading -g on z means no acceleration, reading nothing means falling; forward at yaw 90 deg is east (M22)."""
    assert attitude.acceleration_ned(LEVEL, [0, 0, -G]).tolist() == [0, 0, 0]
    close(attitude.acceleration_ned(degrees(yaw=90), [2, 0, -G]), [0, 2, 0])
    close(attitude.acceleration_ned(degrees(pitch=90), [0, 0, 0]), [0, 0, G])


def test_level_frame() -> None:
    """The level frame is NED turned by the yaw: forward stays forward, right stays right (M22)."""
    close(attitude.acceleration_level(degrees(yaw=37), [2, 1, -G]), [2, 1, 0])
    close(attitude.level_from_ned(degrees(yaw=90), [0, 5, 1]), [5, 0, 1])
    close(attitude.level_from_ned(degrees(yaw=90), [5, 0, 1]), [0, -5, 1])
    rng = np.random.default_rng(24)
    rpy, f = rng.uniform(-1.5, 1.5, (200, 3)), rng.normal(size=(200, 3))
    R_hb = attitude.matrix_from_euler(rpy[:, ::-1] * [0, 1, 1])
    q = attitude.quaternion_from_rpy(roll_rad=rpy[:, 0], pitch_rad=rpy[:, 1], yaw_rad=rpy[:, 2])
    close(attitude.acceleration_level(q, f), np.einsum("nij,nj->ni", R_hb, f) + np.array([0, 0, G]))


def test_the_two_downs() -> None:
    """At rest the accelerometer's down is the attitude's; a 30 deg lie of the attitude shows as 30 deg (M23)."""
    q = degrees(20, -35, 120)
    f = attitude.specific_force(q, [0, 0, 0])
    close(attitude.body_down(q), attitude.down_from_specific_force(f))
    close(attitude.accelerometer_tilt(q, f), 0.0)
    close(attitude.accelerometer_tilt(degrees(pitch=30), [0, 0, -G]), np.radians(30))
    close(attitude.accelerometer_tilt(LEVEL, [0, 0, 5]), np.pi)
    rng = np.random.default_rng(23)
    q, f = random_quaternions(rng, 100), rng.normal(size=(100, 3))
    cosines = -(attitude.body_down(q) * f).sum(axis=-1) / np.linalg.norm(f, axis=-1)
    close(np.cos(attitude.accelerometer_tilt(q, f)), cosines)
    close(attitude.body_down(degrees(roll=90)), [0, 1, 0])
    close(attitude.body_down(degrees(pitch=90)), [-1, 0, 0])
    assert np.isnan(attitude.accelerometer_tilt(LEVEL, [0, 0, 0]))
    assert np.isnan(attitude.down_from_specific_force([0, 0, 0])).all()


def test_hover() -> None:
    """T = m g when level, twice that at 60 deg of bank, negative upside down, none on the side (M23)."""
    assert attitude.hover_thrust(LEVEL, 1.5) == 1.5 * G
    close(attitude.hover_thrust(degrees(roll=60), 1.0), 2 * G, 1e-13)
    close(attitude.hover_thrust(degrees(pitch=45, roll=45, yaw=10), 1.0), 2 * G, 1e-13)
    close(attitude.hover_thrust(degrees(roll=180), 1.0), -G)
    assert np.isnan(attitude.hover_thrust([1, 1, 0, 0], 1.0))
    thrust = float(attitude.hover_thrust(LEVEL, 2.0))
    close(2.0 * attitude.acceleration_ned(LEVEL, [0, 0, -thrust / 2.0]), [0, 0, 0])


# Rest


def rest(n: int, rate_hz: float = 10) -> tuple[Array, Array, Array]:
    t = np.arange(n) / rate_hz
    return t, np.tile([0.0, 0.0, -G], (n, 1)), np.zeros((n, 3))


def test_rest_is_known_after_three_seconds() -> None:
    """A quiet vehicle rests from the sample on at which the quiet has lasted 3 s."""
    assert attitude.at_rest(*rest(40)).tolist() == [False] * 30 + [True] * 10
    t, f, w = rest(80)
    f[40] = [0, 0, -G - 0.31]
    assert np.flatnonzero(attitude.at_rest(t, f, w)).tolist() == [*range(30, 40), *range(71, 80)]


@pytest.mark.parametrize(
    ("force", "rate_deg_s", "rests"),
    [
        (G + 0.29, 0, True),
        (G + 0.31, 0, False),
        (G - 0.29, 0, True),
        (G - 0.31, 0, False),
        (G, 2.8, True),
        (G, 3, False),
    ],
)
def test_limits_of_rest(force: float, rate_deg_s: float, rests: bool) -> None:
    """The force is off g by less than 0.3 m/s^2 and the rate below 2.9 deg/s, about any axis."""
    t, f, w = rest(40)
    f[:] = force * np.array([0.6, 0.0, -0.8])
    w[:] = np.radians(rate_deg_s) * np.array([0.0, 0.6, 0.8])
    assert attitude.at_rest(t, f, w)[-1] == rests


def test_rest_is_not_known_across_a_gap() -> None:
    """What happened in a gap above 1 s is unknown: the 3 s count from its end."""
    t, f, w = rest(80)
    t[20:] += 1.0
    assert np.flatnonzero(attitude.at_rest(t, f, w))[0] == 50
    t, f, w = rest(80)
    t[20:] += 0.85
    assert np.flatnonzero(attitude.at_rest(t, f, w))[0] == 22


def test_others_may_deny_rest() -> None:
    """A message that says 'armed and flying' outranks a quiet accelerometer."""
    t, f, w = rest(80)
    may_rest = np.arange(80) >= 20
    assert np.flatnonzero(attitude.at_rest(t, f, w, may_rest))[0] == 50
    assert not attitude.at_rest(t, f, w, may_rest=False).any()
    assert (attitude.RestWatch().feed(t, f, w) == attitude.at_rest(t, f, w, may_rest=True)).all()


def test_a_bad_row_is_not_rest_and_ends_none() -> None:
    """A NaN among quiet samples is not known to rest; the samples around it are as if it were missing."""
    t, f, w = rest(60)
    f[10, 1], w[40, 0] = np.nan, np.inf
    assert np.flatnonzero(attitude.at_rest(t, f, w)).tolist() == [*range(30, 40), *range(41, 60)]


def test_two_samples_at_one_instant_are_no_step_backwards() -> None:
    """Doubled times are allowed: they add nothing to the motion, and end no rest."""
    t, f, w = rest(80)
    doubled = np.repeat(np.arange(80), 2)
    assert (attitude.at_rest(t[doubled], f[doubled], w[doubled]) == attitude.at_rest(t, f, w)[doubled]).all()
    f[:, 0] = 2.0
    once = attitude.dead_reckon(t, np.tile(LEVEL, (80, 1)), f)
    twice = attitude.dead_reckon(t[doubled], np.tile(LEVEL, (160, 1)), f[doubled])
    for part, full in zip(once, twice, strict=True):
        close(full, part[doubled], 1e-12)


# Dead reckoning


def test_constant_acceleration_is_integrated_exactly() -> None:
    """2 m/s^2 forward with the nose east: after 4 s 8 m/s and 16 m east, bounds 0.3 t and 0.15 t^2 (M22)."""
    t = np.linspace(0, 4, 81)
    q = np.tile(degrees(yaw=90), (81, 1))
    track = attitude.dead_reckon(t, q, attitude.specific_force(q, np.tile([0.0, 2.0, 0.0], (81, 1))))
    close(track.velocity_n_m_s, np.outer(2 * t, [0, 1, 0]), 1e-13)
    close(track.displacement_n_m, np.outer(t * t, [0, 1, 0]), 1e-13)
    close(track.velocity_bound_m_s, 0.3 * t)
    close(track.displacement_bound_m, 0.15 * t * t)
    velocity, displacement, velocity_bound, displacement_bound = track
    assert velocity.shape == displacement.shape == (81, 3)
    assert velocity_bound.shape == displacement_bound.shape == (81,)


def test_a_growing_acceleration_is_integrated_exactly() -> None:
    """Acceleration that grows by 1 m/s^3, in three samples: t^2/2 and t^3/6."""
    t = np.array([0.0, 1.0, 3.0])
    f = np.column_stack([t, 0 * t, np.full(3, -G)])
    track = attitude.dead_reckon(t, np.tile(LEVEL, (3, 1)), f)
    close(track.velocity_n_m_s[:, 0], t**2 / 2)
    close(track.displacement_n_m[:, 0], t**3 / 6)


def test_a_turning_vehicle_is_integrated_in_the_world() -> None:
    """The integrals are taken in NED, not in the turning body: 2 m/s^2 to the right bends the way round."""
    t = np.arange(0, 6, 0.01)
    yaw = 0.5 * t
    a_n = 2.0 * np.stack([-np.sin(yaw), np.cos(yaw), 0 * t], axis=-1)
    q = attitude.quaternion_from_rpy(roll_rad=0.2, pitch_rad=0.0, yaw_rad=yaw)
    track = attitude.dead_reckon(t, q, attitude.specific_force(q, a_n))
    close(track.velocity_n_m_s, 4.0 * np.stack([np.cos(yaw) - 1, np.sin(yaw), 0 * t], axis=-1), 1e-4)
    circle = 8.0 * np.stack([np.sin(yaw) - yaw, 1 - np.cos(yaw), 0 * t], axis=-1)
    close(track.displacement_n_m, circle, 1e-3)


def test_rest_restarts_velocity_displacement_and_bounds() -> None:
    """Four seconds of rest, two of 3 m/s^2, two of braking, four of rest: zero at rest, 12 m at the stop."""
    t = np.arange(0, 12.01, 0.02)
    north = np.where((t > 4) & (t <= 6), 3.0, 0.0) - np.where((t > 6) & (t <= 8), 3.0, 0.0)
    f = np.column_stack([north + 0.05, 0 * t, np.full(len(t), -G)])  # and a bias of 0.05 m/s^2
    track = attitude.dead_reckon(t, np.tile(LEVEL, (len(t), 1)), f)
    at = {second: int(np.searchsorted(t, second - 1e-9)) for second in (2, 3.5, 4, 6, 8, 9, 11.5)}
    assert track.velocity_n_m_s[at[2], 0] == pytest.approx(0.1, abs=1e-9)  # not yet known to rest
    for second in (3.5, 11.5):
        assert track.velocity_n_m_s[at[second]].tolist() == [0, 0, 0]
        assert track.displacement_n_m[at[second]].tolist() == [0, 0, 0]
        assert track.velocity_bound_m_s[at[second]] == track.displacement_bound_m[at[second]] == 0.0
    assert track.velocity_n_m_s[at[6], 0] == pytest.approx(6.1, abs=0.05)
    for second, speed, way in ((6, 6.0, 6.0), (8, 0.0, 12.0), (9, 0.0, 12.0)):
        i, since = at[second], second - 4
        assert track.velocity_bound_m_s[i] == pytest.approx(0.3 * since, abs=1e-9)
        assert track.displacement_bound_m[i] == pytest.approx(0.15 * since**2, abs=1e-9)
        assert abs(track.velocity_n_m_s[i, 0] - speed) < track.velocity_bound_m_s[i]
        assert abs(track.displacement_n_m[i, 0] - way) < track.displacement_bound_m[i]


def test_a_gentle_acceleration_is_not_rest() -> None:
    """1 m/s^2 for 5 s on a level vehicle leaves |f| within 0.3 m/s^2 of g, and is still a motion."""
    t = np.arange(0, 5.01, 0.1)
    level, f = np.tile(LEVEL, (len(t), 1)), np.tile([1.0, 0.0, -G], (len(t), 1))
    assert attitude.at_rest(t, f, np.zeros((len(t), 3)))[-1]
    assert attitude.dead_reckon(t, level, f).velocity_n_m_s[-1, 0] == pytest.approx(5.0)
    # An attitude that is wrong by 4 deg feigns 0.68 m/s^2, and is still at rest.
    tilted = np.tile(degrees(pitch=4), (len(t), 1))
    still = np.tile([0.0, 0.0, -G], (len(t), 1))
    assert attitude.dead_reckon(t, tilted, still).velocity_n_m_s[-1].tolist() == [0, 0, 0]


def test_a_turning_vehicle_does_not_rest() -> None:
    """Turning on the spot is no rest, whether the attitudes or the gyro say so; nor where others deny it."""
    t, f, w = rest(60)
    level = np.tile(LEVEL, (60, 1))
    turning = attitude.quaternion_from_rpy(roll_rad=0.0, pitch_rad=0.0, yaw_rad=np.radians(5) * t)
    assert attitude.dead_reckon(t, level, f).velocity_bound_m_s[-1] == 0.0
    assert attitude.dead_reckon(t, turning, f).velocity_bound_m_s[-1] == pytest.approx(0.3 * t[-1])
    assert attitude.dead_reckon(t, level, f, w=w + 0.1).velocity_bound_m_s[-1] == pytest.approx(0.3 * t[-1])
    assert attitude.dead_reckon(t, turning, f, w=w).velocity_bound_m_s[-1] == 0.0
    assert attitude.dead_reckon(t, level, f, may_rest=False).velocity_bound_m_s[-1] == pytest.approx(0.3 * t[-1])


def test_a_bad_row_is_bridged() -> None:
    """A row of NaN, or a zero quaternion, is NaN in all four results, and the others are as if it were missing."""
    rng = np.random.default_rng(25)
    t = np.arange(60) / 10.0
    q, f = random_quaternions(rng, 60), rng.normal(size=(60, 3))
    t[3], q[10], q[11, 2], f[20, 1] = np.nan, 0.0, np.inf, np.nan
    bad = [3, 10, 11, 20]
    track = attitude.dead_reckon(t, q, f)
    without = attitude.dead_reckon(*(np.delete(rows, bad, axis=0) for rows in (t, q, f)))
    for whole, part in zip(track, without, strict=True):
        assert np.isnan(whole[bad]).all()
        np.testing.assert_array_equal(np.delete(whole, bad, axis=0), part)


def test_a_bad_row_ends_no_rest() -> None:
    """A row of NaN between quiet ones tells no rate: the rest goes on, and with it the motion of zero."""
    t, f, _ = rest(60)
    q = np.tile(LEVEL, (60, 1))
    q[45] = np.nan
    track = attitude.dead_reckon(t, q, f)
    assert np.flatnonzero(track.velocity_bound_m_s == 0.0).tolist() == [0, *range(30, 45), *range(46, 60)]


def test_the_past_does_not_depend_on_the_future() -> None:
    """Cut anywhere, the result is the beginning of the whole result, bit by bit; none and one sample are fine."""
    rng = np.random.default_rng(26)
    t = np.cumsum(rng.uniform(0.05, 0.15, 200))
    q = attitude.quaternion_from_rotvec(0.0001 * rng.normal(size=(200, 3)))
    f = attitude.specific_force(q, np.where((t > 8)[:, None] & (t < 12)[:, None], 3.0, 0.0) * [1.0, 0.0, 0.0])
    whole = attitude.dead_reckon(t, q, f)
    assert (whole.velocity_bound_m_s[1:] == 0).any()
    for n in (0, 1, 2, 50, 133):
        for part, full in zip(attitude.dead_reckon(t[:n], q[:n], f[:n]), whole, strict=True):
            assert part.tobytes() == full[:n].tobytes()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t_s": [0.0, 2.0, 1.0]}, "t_s runs backwards"),
        ({"t_s": np.zeros((3, 1))}, r"t_s has shape \(3, 1\), expected \(n\)"),
        ({"q_nb": np.ones((2, 4))}, r"q_nb has shape \(2, 4\), expected \(3, 4\)"),
        ({"q_nb": np.ones((1, 3, 4))}, r"q_nb has shape \(1, 3, 4\), expected \(3, 4\)"),
        ({"f_b": np.ones((3, 2))}, r"f_b has shape \(3, 2\), expected \(3, 3\)"),
        ({"w": np.ones((4, 3))}, r"w has shape \(4, 3\), expected \(3, 3\)"),
        ({"may_rest": [True, False]}, r"may_rest has shape \(2,\), expected \(\) or \(3,\)"),
    ],
)
def test_series_that_do_not_fit_are_refused(changes: dict[str, npt.ArrayLike], message: str) -> None:
    """Time that runs backwards and series of other lengths are named."""
    fitting: dict[str, Any] = {"t_s": [0.0, 1.0, 2.0], "q_nb": np.ones((3, 4)), "f_b": np.ones((3, 3))}
    with pytest.raises(ValueError, match=message):
        attitude.dead_reckon(**(fitting | changes))


@pytest.mark.parametrize("shape", [(), (2,), (4,), (3, 1)])
def test_a_mask_of_rest_that_does_not_fit_is_refused(shape: tuple[int, ...]) -> None:
    """Where to restart is told for each sample, no more and no less."""
    with pytest.raises(ValueError, match=r"^resting has shape .*, expected \(3,\)$"):
        attitude.DeadReckoner().feed([0.0, 1.0, 2.0], np.ones((3, 4)), np.ones((3, 3)), np.zeros(shape, dtype=bool))
