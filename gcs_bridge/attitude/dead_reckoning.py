"""Where a vehicle is known to rest, and how it moved since, by its accelerometer and attitude (M22, M23).

Here rows do depend on the rows before them, never on how those were cut into pieces.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude._rows import Array, Mask, numbers, shaped, vector
from gcs_bridge.attitude.gravity import G_M_S2, acceleration_ned, may_stand_still
from gcs_bridge.attitude.kinematics import body_rates_between
from gcs_bridge.attitude.quaternion import length

REST_FORCE_M_S2 = 0.3
"""At rest the length of the specific force is off g by less than this."""

REST_RATE_RAD_S: float = np.radians(2.9)
"""At rest the body turns slower than this."""

REST_TIME_S = 3.0
"""Rest is known once both have held for this long."""

REST_GAP_S = 1.0
"""Nothing is known of a gap longer than this: the time of rest starts anew."""

DRIFT_M_S2 = 0.3
"""b, the error of the acceleration that the drift's bounds b t and b t^2/2 allow for."""


# Components


def is_quiet(force: Array, rate: Array) -> Mask:
    """Whether |f_b|, m/s^2, and |w|, rad/s, are those of a body at rest."""
    return (np.abs(force - G_M_S2) < REST_FORCE_M_S2) & (rate < REST_RATE_RAD_S)


def stays_quiet(quiet: Mask, was_quiet: Mask, gap_s: Array) -> Mask:
    """Whether the time of rest goes on from the sample before, which was so long ago."""
    return quiet & was_quiet & (gap_s <= REST_GAP_S)


def rests_since(quiet: Mask, since_s: Array, t_s: Array) -> Mask:
    """Whether rest is known, where it has been quiet since then."""
    return quiet & (t_s - since_s >= REST_TIME_S)


# Samples


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
        quiet = is_quiet(force, rate) & _allowed(may_rest, len(t))
        resting = np.zeros(t.shape, dtype=bool)
        known = _in_turn(t, np.isfinite(t + force + rate), self._latest_s)
        if known.any():
            resting[known] = self._long_enough(t[known], quiet[known])
        return resting

    def _long_enough(self, t: Array, quiet: Mask) -> Mask:
        was_quiet = np.concatenate(([self._quiet], quiet[:-1]))
        began = np.where(stays_quiet(quiet, was_quiet, np.diff(t, prepend=self._latest_s)), -np.inf, t)
        since = np.maximum.accumulate(np.concatenate(([self._quiet_since_s], began)))[1:]
        self._latest_s, self._quiet, self._quiet_since_s = float(t[-1]), bool(quiet[-1]), float(since[-1])
        return rests_since(quiet, since, t)


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
