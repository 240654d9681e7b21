"""A window's samples as they were sent → pairs of attitudes under a hypothesis, which is undone before they are paired.

The pairing is that of `gcs_bridge.pairing`: equal instants first, else the faster stream interpolated at the slower
one's times, each pair with the bound of that. Here all samples are known at once, their stamps may be set back by a
skew, and many hypotheses are compared on the same pairs: its kernel, which follows samples as they come, is of no use.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Columns, Floats, Int64s, Mask, record
from gcs_bridge.diagnosis.hypotheses import Hypothesis, Mistakes, Side, quaternion_of_rpy, undoing
from gcs_bridge.pairing.bounds import interpolation_bound_rad, turn_and_kin
from gcs_bridge.pairing.neighbours import first_at_or_behind
from gcs_bridge.settings import AlignmentSettings
from gcs_bridge.telemetry.samples import AttitudeSamples

EULER, QUATERNION = 0, 1
MAX_PAIRS = 2000
_FASTER = 1.25  # ratio of periods from which a stream counts as the slower one, as in the pairing's kernel
_SAME_S = 1e-6
AttitudeOf = Callable[[Floats, Int64s], Floats]
"""(angles (n, 3) rad, their rows in the window's samples (n,)) → q_nb (n, 4), expected differences undone."""


def plain_attitude(rpy_rad: Floats, _: Int64s) -> Floats:
    """The attitude of angles from which nothing is expected to differ."""
    return quaternion_of_rpy(rpy_rad)


@record
class Window:
    """What was sent from the onset of a disagreement on, all of one boot.

    `euler`, `quaternion`: the samples of both messages, as sent and in any order, valid or not. `attitude_of`: what the
    angles mean once the firmware's own differences are undone. `clean_before`: whether both forms agreed to the noise
    floor before. `reset`: whether both streams stepped together, against the rates. `autopilot` and `type` as in a
    report.
    """

    euler: AttitudeSamples
    quaternion: AttitudeSamples
    attitude_of: AttitudeOf = plain_attitude
    clean_before: bool = False
    reset: bool = False
    trims: tuple[str, ...] = ()


class Stream(NamedTuple):
    """A message's usable samples in order of time, n of them; `row` (n,) in the window's samples.

    `sent`: roll, pitch, yaw (n, 3), rad, or quaternions (n, 4), normalised and else as sent; `q_nb` (n, 4): what they
    mean if there is no mistake; rates (n, 3).
    """

    t_s: Floats
    sent: Floats
    q_nb: Floats
    w_b_rad_s: Floats
    row: Int64s


def streams(window: Window) -> tuple[Stream, Stream]:
    """Both messages' usable samples; of equal times the first. Times are seconds since the window's first sample."""
    both = (window.euler, window.quaternion)
    start_us = min((int(samples.t_boot_us.min()) for samples in both if len(samples)), default=0)
    assert window.euler.rpy_rad is not None
    rpy_rad, q = window.euler.rpy_rad, attitude.normalise(window.quaternion.q_nb)
    row, q_row = _usable(window.euler, rpy_rad), _usable(window.quaternion, q)
    return (
        _stream(window.euler, row, rpy_rad[row], window.attitude_of(rpy_rad[row], row), start_us),
        _stream(window.quaternion, q_row, q[q_row], q[q_row], start_us),
    )


def _usable(samples: AttitudeSamples, sent: Floats) -> Int64s:
    """The samples (n,) in order of time that are numbers, each time once."""
    row = np.flatnonzero(np.isfinite(sent).all(axis=1) & (np.abs(sent).max(axis=1, initial=0.0) < 1e6))
    _, first = np.unique(samples.t_boot_us[row], return_index=True)
    return row[first]


def _stream(samples: AttitudeSamples, row: Int64s, sent: Floats, q_nb: Floats, start_us: int) -> Stream:
    t_s = np.asarray((samples.t_boot_us[row] - start_us) * 1e-6)
    return Stream(t_s, sent, q_nb, samples.w_nb_b_rad_s[row], row)


class Comparison(NamedTuple):
    """k pairs under each of m hypotheses (m, k, …): attitudes, the angle between them, rad, and its bound, rad."""

    q_euler: Floats
    q_quaternion: Floats
    residual_rad: Floats
    bound_rad: Floats


@record
class Pairing(Columns):
    """Which samples make k pairs once the quaternion's stamps are set back by a skew.

    `slower`: EULER or QUATERNION; of it sample and the one before, `previous` (itself: there is none); of the other
    stream the samples at or before and behind that time, `before` and `after`; all (k,), as are the share `u` of the
    way from one to the other, and the gap `h_s` between them.
    """

    sample: Int64s
    previous: Int64s
    before: Int64s
    after: Int64s
    u: Floats
    h_s: Floats
    window: Window
    streams: tuple[Stream, Stream]
    slower: int
    same_bound_rad: float

    @property
    def t_s(self) -> Floats:
        """When (k,), s."""
        return self.streams[self.slower].t_s[self.sample]

    @property
    def same(self) -> Mask:
        """Which pairs (k,) are of one instant."""
        return np.asarray(self.before == self.after)

    def rates(self) -> Floats:
        """Body rates (k, 3) at the pairs, rad/s, as the Euler angles' message has them: no mistake turns them."""
        stream = self.streams[EULER]
        if self.slower == EULER:
            return stream.w_b_rad_s[self.sample]
        u = self.u[:, None]
        w: Floats = (1.0 - u) * stream.w_b_rad_s[self.before] + u * stream.w_b_rad_s[self.after]
        return w

    def compare(self, hypotheses: Sequence[Hypothesis]) -> Comparison:
        """The pairs under hypotheses that set no stamp back but by this pairing's skew."""
        apart = np.flatnonzero(~self.same)
        slow = self._attitudes(hypotheses, self.slower, np.concatenate((self.sample, self.previous[apart])))
        fast = self._attitudes(hypotheses, 1 - self.slower, np.concatenate((self.after, self.before[apart])))
        k = len(self)
        q_slow, q_fast = slow[:, :k], fast[:, :k]
        bound = np.full(q_slow.shape[:2], self.same_bound_rad)
        if len(apart):
            last, around = (slow[:, k:], q_slow[:, apart]), (fast[:, k:], q_fast[:, apart])
            q_fast[:, apart], more = self._interpolated(last, around, apart)
            bound[:, apart] += more
        both = (q_slow, q_fast) if self.slower == EULER else (q_fast, q_slow)
        return Comparison(*both, attitude.angle_between(*both), bound)

    def _attitudes(self, hypotheses: Sequence[Hypothesis], side: int, at: Int64s) -> Floats:
        """The attitudes (m, n, 4) of one message's samples at places (n,), under m hypotheses."""
        stream = self.streams[side]
        kind: Side = "rpy" if side == EULER else "quaternion"
        which = [hypothesis.of(kind) for hypothesis in hypotheses]
        made: dict[Mistakes, Floats] = {(): stream.q_nb[at]}
        new = list(dict.fromkeys(mine for mine in which if mine))
        if side == QUATERNION:
            made |= {mine: stream.sent[at] @ undoing(mine) for mine in new}
        elif new:  # in one call, which may be a costly one
            rpy_rad = np.concatenate([Hypothesis(mine).undone(stream.sent[at], kind) for mine in new])
            q_nb = self.window.attitude_of(rpy_rad, np.tile(stream.row[at], len(new)))
            made |= zip(new, np.split(q_nb, len(new)), strict=True)
        return np.stack([made[mine] for mine in which])

    def _interpolated(
        self, last: tuple[Floats, Floats], around: tuple[Floats, Floats], rows: Int64s
    ) -> tuple[Floats, Floats]:
        """The faster stream (m, n, 4) at the slower one's times, and the bound (m, n) of that, rad.

        `last`: the slower one's step that ends there; `around`: the faster one's samples on both sides; (m, n, 4) each.
        """
        own_stream, other = self.streams[self.slower], self.streams[1 - self.slower]
        before, after, u, h_s = self.before[rows], self.after[rows], self.u[rows], self.h_s[rows]
        previous, sample = self.previous[rows], self.sample[rows]
        w0, w1 = other.w_b_rad_s[before], other.w_b_rad_s[after]
        own0, own1 = own_stream.w_b_rad_s[previous], own_stream.w_b_rad_s[sample]
        q, w = attitude.hermite(*around, w0, w1, dt_s=h_s, u=u)
        _, kin_fast = turn_and_kin(*around, w0, w1, h_s)
        since_s = own_stream.t_s[sample] - own_stream.t_s[previous]
        _, kin_slow = turn_and_kin(*last, own0, own1, since_s)
        kin_slow[:, since_s == 0.0] = np.inf
        return q, interpolation_bound_rad(w0, w1, own1, w, kin_fast=kin_fast, kin_slow=kin_slow, h=h_s, u=u)


def pair(window: Window, alignment: AlignmentSettings) -> Pairing:
    """The window's pairs by their stamps, no more than MAX_PAIRS, evenly chosen."""
    of = streams(window)
    periods = [float(np.median(np.diff(stream.t_s))) if len(stream.t_s) > 1 else np.inf for stream in of]
    slower = EULER if periods[EULER] > _FASTER * periods[QUATERNION] else QUATERNION
    every = np.arange(len(of[slower].t_s))
    found, _ = _paired(window, of, slower, every, np.zeros(len(every)), alignment)
    if len(found) > MAX_PAIRS:
        found = found[np.linspace(0, len(found) - 1, MAX_PAIRS).astype(np.int64)]
    return found


def set_back(pairing: Pairing, skews_s: Floats, alignment: AlignmentSettings) -> tuple[Pairing, Int64s]:
    """Pairs of the same slower samples with the quaternion's stamps set back by each of some skews (n,), s.

    Beside them, which of the skews each belongs to (k,).
    """
    sample = np.tile(pairing.sample, len(skews_s))
    which = np.repeat(np.arange(len(skews_s)), len(pairing))
    found, kept = _paired(pairing.window, pairing.streams, pairing.slower, sample, skews_s[which], alignment)
    return found, which[kept]


def _paired(
    window: Window,
    of: tuple[Stream, Stream],
    slower: int,
    sample: Int64s,
    skew_s: Floats,
    alignment: AlignmentSettings,
) -> tuple[Pairing, Int64s]:
    """The pairs of some of the slower stream's samples (n,), skews (n,), and which of them have a partner."""
    slow, fast = of[slower], of[1 - slower]
    # Seen from the slower stream's stamps: a quaternion that is late by the skew was there before.
    t_s = slow.t_s[sample] + (skew_s if slower == EULER else -skew_s)
    after, same = first_at_or_behind(t_s, fast.t_s, within=_SAME_S)
    before = np.where(same, after, after - 1)
    kept = np.flatnonzero((after < len(fast.t_s)) & (before >= 0))
    before, after, same = before[kept], after[kept], same[kept]
    h_s = np.where(same, 1.0, fast.t_s[after] - fast.t_s[before])
    near = h_s <= alignment.max_gap_s
    kept, before, after, h_s = kept[near], before[near], after[near], h_s[near]
    sample, t_s = sample[kept], t_s[kept]
    u = np.where(before == after, 0.0, np.clip((t_s - fast.t_s[before]) / h_s, 0.0, 1.0))
    found = Pairing(
        window=window,
        streams=of,
        slower=slower,
        sample=sample,
        previous=np.maximum(sample - 1, 0),
        before=before,
        after=after,
        u=u,
        h_s=h_s,
        same_bound_rad=alignment.same_instant_bound_rad,
    )
    return found, kept
