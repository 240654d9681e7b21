"""What an accelerometer says about attitude and motion (M21 to M23).

World NED, body FRD. Specific force f_b is what an ideal accelerometer reads, m/s^2: at rest and level [0, 0, -g].
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude._rows import Array, Mask, Vector, join, numbers, ray, rowwise, shaped, vector
from gcs_bridge.attitude.euler import angles_of, parsed
from gcs_bridge.attitude.kinematics import body_rates_between
from gcs_bridge.attitude.quaternion import TINY, conjugated, cross, length, turned

G_M_S2 = 9.80665
"""Standard gravity."""

REST_FORCE_M_S2 = 0.3
"""At rest the length of the specific force is off g by less than this."""

REST_RATE_RAD_S = np.radians(2.9)
"""At rest the body turns slower than this."""

REST_TIME_S = 3.0
"""Rest is known once both have held for this long."""

REST_GAP_S = 1.0
"""Nothing is known of a gap longer than this: the time of rest starts anew."""

REST_TILT_RAD = np.radians(5.0)
"""An attitude may be wrong by this much at rest, and then seems to accelerate at g sin(5 deg) = 0.85 m/s^2."""

DRIFT_M_S2 = 0.3
"""b, the error of the acceleration that the drift's bounds b t and b t^2/2 allow for."""


# Specific force and acceleration


@rowwise(q=(4,))
def body_down(q: npt.ArrayLike) -> Array:
    """Return the world's down seen from the body (..., 3), a unit vector, of q_nb (..., 4) (M17, M23): R_bn z.

    The norm of q is divided out, a zero or non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> body_down([1, 1, 0, 0]).round(12).tolist()  # rolled right by 90 degrees: down is to the right
    [0.0, 1.0, 0.0]
    """
    (w, x, y, z), norm2 = ray(q)
    double = 2.0 / norm2
    return join(double * (x * z - w * y), double * (y * z + w * x), 1.0 - double * (x * x + y * y))


@rowwise(f_b=(3,))
def down_from_specific_force(f_b: npt.ArrayLike) -> Array:
    """Return the down that an accelerometer at rest sees (..., 3), a unit vector in b, of f_b (..., 3) (M23): -f/|f|.

    Free fall shows no down: a zero row gives NaN, as does a non-finite one. Raises ValueError for a wrong shape.

    >>> down_from_specific_force([0, 0, -9.8]).tolist()
    [0.0, 0.0, 1.0]
    """
    x, y, z = vector(f_b)
    size = length((x, y, z))
    size = np.where(size > TINY, -size, np.nan)
    return join(x / size, y / size, z / size)


@rowwise(q_nb=(4,), f_b=(3,))
def accelerometer_tilt(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Array:
    """Return the angle (...), rad, in [0, pi], between the accelerometer's down and the attitude's (M23).

    At rest it is the error of one of them; in accelerated flight it is not. q_nb is (..., 4), f_b (..., 3) in any unit.
    Free fall, a zero q or a non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> float(np.degrees(accelerometer_tilt([1, 0, 0, 0], [0, -9.8, -9.8])).round(9))
    45.0
    """
    q, norm2 = ray(q_nb)
    zero = 0.0 * norm2
    down = turned(conjugated(q), norm2, (zero, zero, zero + 1.0))
    f = vector(f_b)
    angle = np.arctan2(length(cross(down, f)), -(down[0] * f[0] + down[1] * f[1] + down[2] * f[2]))
    return np.where(length(f) > TINY, angle, np.nan)


@rowwise(q_nb=(4,), a_n=(3,))
def specific_force(q_nb: npt.ArrayLike, a_n: npt.ArrayLike) -> Array:
    """Return the specific force f_b (..., 3), m/s^2, at the acceleration a_n (..., 3) (M21; Titterton, 3.2).

    f_b = R_bn (a_n - g_n): every force but gravity. q_nb is (..., 4), its norm is divided out. A zero q or a non-finite
    row gives NaN. Raises ValueError for a wrong shape.

    >>> specific_force([1, 0, 0, 0], [0, 0, 0]).tolist()  # at rest and level
    [0.0, 0.0, -9.80665]
    """
    q, norm2 = ray(q_nb)
    x, y, z = vector(a_n)
    return join(*turned(conjugated(q), norm2, (x, y, z - G_M_S2)))


@rowwise(q_nb=(4,), f_b=(3,))
def acceleration_ned(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Array:
    """Return the acceleration a_n (..., 3), m/s^2, NED, of the specific force f_b (..., 3) (M22): R_nb f_b + g_n.

    q_nb is (..., 4), its norm is divided out. A zero q or a non-finite row gives NaN. Raises ValueError for a wrong
    shape.

    >>> acceleration_ned([1, 0, 0, 0], [0, 0, 0]).tolist()  # free fall
    [0.0, 0.0, 9.80665]
    """
    return join(*_acceleration(q_nb, f_b))


@rowwise(q_nb=(4,), f_b=(3,))
def acceleration_level(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Array:
    """Return the acceleration a_h (..., 3), m/s^2, in the level frame: along the nose, to the right, down (M22).

    a_h = Ry(pitch) Rx(roll) f_b + [0, 0, g]. q_nb is (..., 4), its norm is divided out; f_b is (..., 3), m/s^2. A zero
    q or a non-finite row gives NaN. Raises ValueError for a wrong shape.

    >>> acceleration_level([1, 0, 0, 1], [2, 0, -9.80665]).round(9).tolist()  # forward stays forward at any yaw
    [2.0, 0.0, 0.0]
    """
    return _level(q_nb, _acceleration(q_nb, f_b))


@rowwise(q_nb=(4,), v_n=(3,))
def level_from_ned(q_nb: npt.ArrayLike, v_n: npt.ArrayLike) -> Array:
    """Return the level-frame components R_hn v_n (..., 3) of a vector v_n (..., 3): NED turned by the yaw alone (M22).

    q_nb is (..., 4), v_n in any unit. At pitch +-pi/2 the yaw is M5's. A zero q or a non-finite row gives NaN. Raises
    ValueError for a wrong shape.

    >>> level_from_ned([1, 0, 0, 1], [0, 5, 1]).round(12).tolist()  # flying east with the nose east
    [5.0, 0.0, 1.0]
    """
    return _level(q_nb, vector(v_n))


def _acceleration(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Vector:
    x, y, z = turned(*ray(q_nb), vector(f_b))
    return x, y, z + G_M_S2


def _level(q_nb: npt.ArrayLike, v_n: Vector) -> Array:
    yaw = angles_of(ray(q_nb)[0], parsed("ZYX"))[0]
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = v_n
    return join(c * x + s * y, c * y - s * x, z + 0.0 * c)


@rowwise(q_nb=(4,), mass_kg=())
def hover_thrust(q_nb: npt.ArrayLike, mass_kg: npt.ArrayLike) -> Array:
    """Return the thrust T (...), N, along -z of the body that carries the weight at an attitude (M23): m g / R33.

    It solves the vertical part of m a_n = R_nb [0, 0, -T] + m g_n = 0, m (...), kg. Level, T = m g: a result of -m g or
    0 there means that a sign or a frame is wrong. Beyond 90 degrees of tilt T is negative. No thrust carries the weight
    where the body's z lies level (R33 = 0): NaN, as in a zero or non-finite row. Raises ValueError for a wrong shape.

    >>> float(hover_thrust([1, 0, 0, 0], 2.0))
    19.6133
    """
    (_, x, y, _), norm2 = ray(q_nb)
    vertical = 1.0 - 2.0 / norm2 * (x * x + y * y)
    return numbers(mass_kg) * G_M_S2 / np.where(np.abs(vertical) > 1e-15, vertical, np.nan)


# Rest and dead reckoning: here rows do depend on the rows before them, never on how those were cut into pieces


def at_rest(t_s: npt.ArrayLike, f_b: npt.ArrayLike, w: npt.ArrayLike, may_rest: npt.ArrayLike = True) -> Mask:
    """Return where a vehicle is known to rest (n,), by the samples so far.

    | |f_b| - g | < 0.3 m/s^2 and |w| < 2.9 deg/s, both for 3 s without a gap above 1 s, and nothing else denies it:
    `may_rest`, a mask (n,) or one truth value, is for what other messages say (disarmed, landed, not accelerating). An
    accelerometer alone takes a steady cruise for rest. t_s is (n,), s, and must not run backwards; f_b (n, 3), m/s^2;
    w (n, 3), rad/s. A non-finite row is False and is passed over. A row never depends on later ones. Raises ValueError
    for a wrong shape or for time that runs backwards. `RestWatch` takes the samples as they come.

    >>> at_rest([0, 1, 2, 3, 4], [[0, 0, -9.8]] * 5, [[0, 0, 0]] * 5).tolist()
    [False, False, False, True, True]
    """
    _refuse_backwards(_times(t_s))
    return RestWatch().feed(t_s, f_b, w, may_rest)


class RestWatch:
    """`at_rest` for samples that come piece by piece: the pieces give what the whole gives, bit for bit."""

    def __init__(self) -> None:
        self._latest_s = -np.inf
        self._quiet = False  # at the latest sample
        self._quiet_since_s = -np.inf

    def feed(self, t_s: npt.ArrayLike, f_b: npt.ArrayLike, w: npt.ArrayLike, may_rest: npt.ArrayLike = True) -> Mask:
        """Return where the vehicle is known to rest (n,) among the next samples; arguments as in `at_rest`.

        A row that is older than one before it is False and is passed over, as a non-finite one is. Raises ValueError
        for a wrong shape.
        """
        t = _times(t_s)
        force = length(vector(shaped("f_b", f_b, len(t), 3)))
        rate = length(vector(shaped("w", w, len(t), 3)))
        quiet = (np.abs(force - G_M_S2) < REST_FORCE_M_S2) & (rate < REST_RATE_RAD_S) & _allowed(may_rest, len(t))
        resting = np.zeros(t.shape, dtype=bool)
        known = _in_turn(t, np.isfinite(t + force + rate), self._latest_s)
        if known.any():
            resting[known] = self._long_enough(t[known], quiet[known])
        return resting

    def _long_enough(self, t: Array, quiet: Mask) -> Mask:
        follows = np.concatenate(([self._quiet], quiet[:-1])) & (np.diff(t, prepend=self._latest_s) <= REST_GAP_S)
        began = np.where(quiet & follows, -np.inf, t)
        since = np.maximum.accumulate(np.concatenate(([self._quiet_since_s], began)))[1:]
        self._latest_s, self._quiet, self._quiet_since_s = float(t[-1]), bool(quiet[-1]), float(since[-1])
        return quiet & (t - since >= REST_TIME_S)


def _times(t_s: npt.ArrayLike) -> Array:
    return numbers(shaped("t_s", t_s, "n"))


def _refuse_backwards(t: Array) -> None:
    if (np.diff(t[np.isfinite(t)]) < 0.0).any():
        raise ValueError("t_s runs backwards: sort the samples by time, or cut them where the vehicle has rebooted")


def _allowed(may_rest: npt.ArrayLike, n: int) -> Mask:
    mask = np.asarray(may_rest, dtype=bool)
    if mask.shape not in ((), (n,)):
        raise ValueError(f"may_rest has shape {mask.shape}, expected () or ({n},)")
    return np.broadcast_to(mask, (n,))


def _in_turn(t: Array, known: Mask, latest_s: float) -> Mask:
    """Return the known rows (n,) that are not older than a known one before them."""
    newest = np.maximum.accumulate(np.concatenate(([latest_s], np.where(known, t, -np.inf))))
    return known & (t >= newest[:-1])


class DeadReckoning(NamedTuple):
    """Motion since the last rest, by integrals of the acceleration alone; the bounds say what that is worth."""

    velocity_n_m_s: Array
    """(n, 3), NED."""

    displacement_n_m: Array
    """(n, 3), NED."""

    velocity_bound_m_s: Array
    """(n,): b t."""

    displacement_bound_m: Array
    """(n,): b t^2/2."""


def dead_reckon(
    t_s: npt.ArrayLike,
    q_nb: npt.ArrayLike,
    f_b: npt.ArrayLike,
    *,
    w: npt.ArrayLike | None = None,
    may_rest: npt.ArrayLike = True,
) -> DeadReckoning:
    """Return velocity (n, 3), m/s, and displacement (n, 3), m, in NED since the last rest, and their bounds (n,) (M22).

    Integrals of a_n = R_nb f_b + g_n, taken as linear between samples. Both restart from zero where the vehicle rests:
    `at_rest`, and the attitude must not show an acceleration beyond what a tilt error of 5 degrees would feign. Before
    the first rest they count from the first sample. The bounds are b t and b t^2/2 with b = 0.3 m/s^2 and t the time
    since. They hold for a vehicle that did rest then; a gap is bridged by a straight line, for which they do not hold.

    t_s is (n,), s, and must not run backwards; q_nb (n, 4); f_b (n, 3), m/s^2; `w` (n, 3), rad/s, by default from the
    attitudes themselves; `may_rest` as in `at_rest`. A row whose time, attitude or force is not finite, or whose
    quaternion is zero, is NaN and is passed over. A row never depends on later ones. Raises ValueError for a wrong
    shape or for time that runs backwards. `DeadReckoner` takes the samples as they come.

    >>> forward = dead_reckon([0, 1, 2], [[1, 0, 0, 0]] * 3, [[2, 0, -9.80665]] * 3)
    >>> forward.velocity_n_m_s[-1].tolist(), forward.displacement_n_m[-1].round(12).tolist()
    ([4.0, 0.0, 0.0], [4.0, 0.0, 0.0])
    >>> [float(bound[-1]) for bound in forward[2:]]
    [0.6, 0.6]
    """
    t = _times(t_s)
    _refuse_backwards(t)
    n = len(t)
    q, f = shaped("q_nb", q_nb, n, 4), shaped("f_b", f_b, n, 3)
    may = _allowed(may_rest, n) & may_stand_still(q, f)
    known = np.isfinite(t) & np.isfinite(acceleration_ned(q, f)[:, 0])
    rates = _rates(t[known], q[known]) if w is None else shaped("w", w, n, 3)[known]
    resting = np.zeros(n, dtype=bool)
    resting[known] = RestWatch().feed(t[known], f[known], rates, may[known])
    return DeadReckoner().feed(t, q, f, resting)


@rowwise(q_nb=(4,), f_b=(3,))
def may_stand_still(q_nb: npt.ArrayLike, f_b: npt.ArrayLike) -> Mask:
    """Return where (...) the acceleration is no larger than an attitude wrong by 5 degrees would feign at rest.

    q_nb is (..., 4), f_b (..., 3), m/s^2. A zero q or a non-finite row gives False. Raises ValueError for a wrong
    shape.

    >>> may_stand_still([1, 0, 0, 0], [[0, 0, -9.8], [2, 0, -9.8]]).tolist()
    [True, False]
    """
    return np.asarray(length(_acceleration(q_nb, f_b)) < G_M_S2 * np.sin(REST_TILT_RAD))


class DeadReckoner:
    """`dead_reckon` for samples that come piece by piece: the pieces give what the whole gives, bit for bit."""

    def __init__(self) -> None:
        # The latest row, once there is one: arrays of length 1.
        self._t, self._since = np.empty(0), np.empty(0)
        self._a_n, self._velocity, self._displacement = np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3))

    def feed(
        self, t_s: npt.ArrayLike, q_nb: npt.ArrayLike, f_b: npt.ArrayLike, resting: npt.ArrayLike
    ) -> DeadReckoning:
        """Return the motion (n rows) of the next samples; arguments as in `dead_reckon`.

        `resting`, a mask (n,): where to restart; `RestWatch` and `may_stand_still` tell. A row that is older than one
        before it is NaN and is passed over, as a meaningless one is. Raises ValueError for a wrong shape.
        """
        t = _times(t_s)
        n = len(t)
        a_n = acceleration_ned(shaped("q_nb", q_nb, n, 4), shaped("f_b", f_b, n, 3))
        restart = np.asarray(resting, dtype=bool)
        if restart.shape != (n,):
            raise ValueError(f"resting has shape {restart.shape}, expected ({n},)")
        result = DeadReckoning(*(np.full(shape, np.nan) for shape in ((n, 3), (n, 3), (n,), (n,))))
        latest_s = float(self._t[0]) if len(self._t) else -np.inf
        known = _in_turn(t, np.isfinite(t) & np.isfinite(a_n[:, 0]), latest_s)
        if known.any():
            for whole, part in zip(result, self._moved(t[known], a_n[known], restart[known]), strict=True):
                whole[known] = part
        return result

    def _moved(self, t: Array, a_n: Array, restart: Mask) -> tuple[Array, Array, Array, Array]:
        carried = len(self._t)  # rows of before that lead these
        restart = np.concatenate((np.zeros(carried, dtype=bool), restart))
        restart[0] |= not carried
        t, a_n = np.concatenate((self._t, t)), np.concatenate((self._a_n, a_n))
        dt = np.diff(t)[:, None]
        velocity = _sums(self._velocity, 0.5 * dt * (a_n[:-1] + a_n[1:]), restart)
        steps = velocity[:-1] * dt + dt * dt / 6.0 * (2.0 * a_n[:-1] + a_n[1:])
        displacement = _sums(self._displacement, steps, restart)
        since = np.where(restart, t, -np.inf)
        since[:carried] = self._since
        since = np.maximum.accumulate(since)
        elapsed = t - since
        self._t, self._since, self._a_n = t[-1:].copy(), since[-1:].copy(), a_n[-1:].copy()
        self._velocity, self._displacement = velocity[-1:].copy(), displacement[-1:].copy()
        bounds = DRIFT_M_S2 * elapsed, 0.5 * DRIFT_M_S2 * elapsed * elapsed
        return velocity[carried:], displacement[carried:], bounds[0][carried:], bounds[1][carried:]


def _rates(t: Array, q: Array) -> Array:
    rates = np.zeros((len(t), 3))
    rates[1:] = body_rates_between(q[:-1], q[1:], np.diff(t))  # before the first there is nothing to tell
    return rates


def _sums(first: Array, steps: Array, restart: Mask) -> Array:
    """Return the sums (n, 3) of n - 1 steps, from zero again at each restart, else from `first` (1, 3) on.

    One addition after the other: the bits must not depend on the rows' number. What a restart leaves behind, damage
    included, is gone.
    """
    total = np.zeros((len(restart), 3))
    total[: len(first)] = first
    moving = ~restart
    moving[0] = False  # it is the start of a run, or what a run goes on from
    edges = np.flatnonzero(moving[1:] != moving[:-1]) + 1
    for begin, end in zip(edges[::2], [*edges[1::2], len(total)], strict=False):
        total[begin:end] = steps[begin - 1 : end - 1]
        np.add.accumulate(total[begin - 1 : end], axis=0, out=total[begin - 1 : end])
    return total
