"""Which mistakes explain a window: each is undone, and has to leave nothing.

A hypothesis *explains* if what is left is within the noise and the bounds of the pairs, on all pairs and on those that
disagree as sent (a fault that shows in turns only must be explained there). Among hypotheses that explain, those that
leave about the same are *tied*: the motion cannot tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Floats, Int64s, Mask
from gcs_bridge.diagnosis import fits
from gcs_bridge.diagnosis.hypotheses import (
    AHRS_TRIM,
    NO_MISTAKE,
    SIMPLE,
    TRIMS,
    VTOL_VIEW,
    Hypothesis,
    doubles,
)
from gcs_bridge.diagnosis.likeness import NAMED_MS, by_name, covers, likeliest, same, same_mistake
from gcs_bridge.diagnosis.window import Comparison, Pairing, set_back
from gcs_bridge.settings import AlignmentSettings

# Explained: by the median and the 90 % quantile of residual/(0.05° + 3 bound), and by the score, which is the latter
# with the noise floor in place of the 0.05°. What explains is tied: within the bounds, better is not truer.
_MEDIAN, _P90, _SCORE = 1.0, 2.0, 1.0
_FLOOR_CLEAN_RAD, _FLOOR_RAD = np.radians(0.003), np.radians(0.03)
_SCREEN = 3.0  # how much worse a hypothesis may look on some of the pairs to be tried on all
# The right hypothesis scores less, but for one time in fifty. A worse one must stand up to two mistakes, and gives way
# to those that score so many times less; of two mistakes nothing worse is believed.
SHARP, _GIVES_WAY = 0.25, 5.0
# Wide bounds excuse no median of so many times the best one's, which shows what the alignment's error really is, and of
# so many noise floors.
_EXCUSED, _EXCUSED_FLOORS = 3.0, 2.0
_BETTER = 0.5  # a hypothesis scores below this share of what no mistake at all scores
_BAD_PAIRS = 3  # as many as the alarm asks for
_SOME, _FEW = 240, 80  # pairs to screen and fit by, and to search by
_LEAST, _LEAST_FITTED, _LEAST_TWO = 5, 8, 20  # pairs to name: one mistake, nothing but fits of numbers, two mistakes
_EARLY = 2  # pairs that may lie on both sides of the onset: interpolated between an attitude before and one after it
_NEAR_RAD = np.radians(3.0)  # a lag not yet refined leaves no more
_PITCHED = fits.MOUNT_ABOUT_ONE[1]  # about the body's y
_ABOUT_ONE, _ABOUT_ANY = (fits.YAW, *fits.MOUNT_ABOUT_ONE), (fits.MOUNT, fits.WORLD)
_TELLS_RAD = np.radians(2.0)  # a bound below it excuses no mistake that anyone makes
_TRIM_RAD = np.radians(10.0)  # as much as a trim may make
_BAD_RAD = np.radians(0.5)  # beyond the bound: a pair disagrees as sent


@dataclass(frozen=True)
class RatedHypothesis:
    """A hypothesis and what it leaves: the median residual, rad, whether it explains or may, and the score of ties."""

    hypothesis: Hypothesis
    median_rad: float
    explains: bool
    maybe: bool
    score: float


class Verdict(NamedTuple):
    """`found`: what explains and cannot be told apart, the likeliest first; `tried`: all, what leaves least first."""

    found: list[RatedHypothesis]
    tried: list[RatedHypothesis]

    def next_best(self) -> RatedHypothesis | None:
        """What leaves least beside what was found: neither the same nor a mistake that has it as a special case."""
        found = [one.hypothesis for one in self.found]
        return next((one for one in self.tried if not any(covers(one.hypothesis, of) for of in found)), None)


class HypothesisSearch:
    """One window's pairs, and the hypotheses tried on them."""

    def __init__(self, pairing: Pairing, alignment: AlignmentSettings, *, clean: bool) -> None:
        """Look at the pairs as sent, from the first that disagrees on: an onset may have been seen too early."""
        found = pairing.compare([NO_MISTAKE])
        onset = _onset(found.residual_rad[0], found.bound_rad[0])
        pairing = pairing[onset:]
        self.pairing = pairing
        self._alignment = alignment
        self._trims = pairing.window.trims
        self._floor_rad = _FLOOR_CLEAN_RAD if clean else _FLOOR_RAD
        self.as_sent = Comparison(*(values[:, onset:] for values in found))
        residual, bound = self.as_sent.residual_rad[0], self.as_sent.bound_rad[0]
        self.bad: Mask = residual > _BAD_RAD + bound
        self._bad_samples = pairing.sample[self.bad]
        self._some = pairing[_spread(self.bad, _SOME)]
        self._few = pairing[_spread(self.bad, _FEW)]
        self._skew_s = fits.skew_by_rates(self._few)
        (self._as_sent,) = self._rated([NO_MISTAKE], pairing, self.as_sent)

    @property
    def median_rad(self) -> float:
        """The median disagreement as sent, NaN without a pair."""
        known = self.as_sent.residual_rad[0]
        known = known[np.isfinite(known)]
        return float(np.median(known)) if len(known) else np.nan

    def agrees(self) -> bool:
        """Whether there is nothing to explain."""
        return self._as_sent.explains and self.bad.sum() < _BAD_PAIRS

    @property
    def tells(self) -> bool:
        """Whether most of the pairs could show a mistake: no bound is as wide as one."""
        bound_rad = self.as_sent.bound_rad[0]
        return bool((bound_rad < _TELLS_RAD).mean() > 0.5)

    @property
    def pairs(self) -> int:
        """How many pairs could be compared."""
        return int(np.isfinite(self.as_sent.bound_rad).sum())

    @property
    def enough(self) -> bool:
        """Whether two mistakes could be told, or that it is none of the known ones."""
        return self.pairs >= _LEAST_TWO

    def decide(self) -> Verdict:
        """Try what is simple first; what is less so only where that explains nothing."""
        some = self._some
        one = fits.turned(some, [NO_MISTAKE], _ABOUT_ONE)
        one += self._skewed()
        tried = self._tried([*SIMPLE, *one])
        if self._trims:
            tried += self._tried(self._trimmed(tried[: len(SIMPLE)]))
        found = self._tied(tried)
        if all(one.hypothesis.numbers and one.hypothesis.name != "yaw_offset" for one in found):
            # Until the vehicle turns, what looks like a turn of the body about one axis may be one of the world.
            tried += self._tried(fits.turned(some, [NO_MISTAKE], _ABOUT_ANY))
            found = self._tied(tried)
        if self._trims:
            more = self._tried(self._trimmed_and_one(found))
            found = _with_trims(found, self._tied(more))
            tried += more
        sharp = SHARP / _GIVES_WAY if self._hidden else SHARP
        for make in (self._two, self._two_turned, self._turned_about_any_axis):
            best = _best(found)
            if best > SHARP:
                more = self._tried(make())
                found += [one for one in self._tied(more) if one.score < min(sharp, best / _GIVES_WAY)]
                tried += more
        rest = sorted((one for one in tried if one.median_rad < np.inf), key=lambda one: one.median_rad)
        return Verdict(found if self._believes(found) else [], rest)

    def _believes(self, found: Sequence[RatedHypothesis]) -> bool:
        """Whether there are pairs enough, and what explains does it well enough."""
        if _best(found) > SHARP and (self._hidden or not self.enough):
            return False  # a trim may have its part in what is left, or two mistakes, which could not be tried
        least = _LEAST_TWO if self._hidden else _LEAST_FITTED
        # Few pairs deny a number, and too few to rest on it.
        return self.pairs >= least or not all(one.hypothesis.numbers for one in found)

    @property
    def _hidden(self) -> bool:
        """Whether there may be a trim of two numbers, which lends a fit to much that is wrong."""
        return AHRS_TRIM.name in self._trims

    # Hypotheses with a trim that was not told

    def _trimmed(self, simple: Sequence[RatedHypothesis]) -> list[Hypothesis]:
        """A trim alone, and beside each simple mistake that leaves no more than one can make."""
        near = [one.hypothesis for one in (self._as_sent, *simple) if one.median_rad < _TRIM_RAD]
        views = fits.turned(self._some, [NO_MISTAKE], [_PITCHED]) if VTOL_VIEW.name in self._trims else []
        made = [NO_MISTAKE.and_then(VTOL_VIEW.name, view.mistakes[0][1][1]) for view in views]
        return made + self._fit_trims(self._few, near)

    def _fit_trims(self, pairing: Pairing, bases: Sequence[Hypothesis]) -> list[Hypothesis]:
        trims = (trim for trim in self._trims if trim != VTOL_VIEW.name)  # that is no small turn
        return [one for trim in trims for one in fits.trimmed(pairing, bases, trim)]

    def _trimmed_and_one(self, found: Sequence[RatedHypothesis]) -> list[Hypothesis]:
        """A trim beside a turn, and beside a lag, where what was found so far does not exclude them."""
        told = {name for one in found if one.score <= SHARP for name in one.hypothesis.mistaken}
        made: list[Hypothesis] = []
        if not told or any(one.hypothesis.numbers and "time_skew" not in one.hypothesis.causes for one in found):
            turns = fits.turned(self._few, [NO_MISTAKE], (fits.YAW, *_ABOUT_ANY))
            made += self._fit_trims(self._few, turns)
        if self._skew_s and (not told or "time_skew" in told):
            skewed = self._refined(self._fit_trims(self._back(self._few, self._skew_s), [NO_MISTAKE]))
            made += [one for one in skewed if abs(one.skew_ms) > NAMED_MS]
        return made

    # Hypotheses of two mistakes

    def _two(self) -> list[Hypothesis]:
        made = [*doubles(), *fits.turned(self._few, SIMPLE, _ABOUT_ONE)]
        return [*made, *self._refined(SIMPLE)]

    def _two_turned(self) -> list[Hypothesis]:
        return self._skewed_and_turned(_ABOUT_ONE)

    def _turned_about_any_axis(self) -> list[Hypothesis]:
        return [*fits.turned(self._few, SIMPLE, _ABOUT_ANY), *self._skewed_and_turned(_ABOUT_ANY)]

    def _skewed(self) -> list[Hypothesis]:
        """A lag alone, from both ways to find one."""
        starts = {fits.skew_by_attitude(self._few, self._alignment, NO_MISTAKE), self._skew_s}
        return [self._refine(NO_MISTAKE, start) for start in sorted(start for start in starts if start)]

    def _skewed_and_turned(self, turns: Sequence[fits.ConstantRotation]) -> list[Hypothesis]:
        """A lag and a constant turn."""
        if not self._skew_s:
            return []
        found = self._refined(fits.turned(self._back(self._few, self._skew_s), [NO_MISTAKE], turns))
        return [  # each is seen better with the other undone
            self._refine(turned, 1e-3 * one.skew_ms)
            for one in found
            for turned in fits.turned(self._back(self._few, 1e-3 * one.skew_ms), [NO_MISTAKE], turns)
        ]

    def _refined(self, bases: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Those of the bases that might explain with the stamps set back as the rates tell, with the lag refined."""
        if not self._skew_s:
            return []
        skewed = [base.and_then("time_skew", 1e3 * self._skew_s) for base in bases]
        tried = self._rate(skewed, self._few)
        near = [i for i, one in enumerate(tried) if one.median_rad < _NEAR_RAD]
        return [self._refine(bases[i], self._skew_s) for i in near]

    def _refine(self, base: Hypothesis, start_s: float) -> Hypothesis:
        skew_s = fits.refined_skew(self._few, self._alignment, base, start_s)
        return Hypothesis((("time_skew", (1e3 * skew_s,)), *base.mistakes))

    # Rating

    def _tried(self, hypotheses: Sequence[Hypothesis]) -> list[RatedHypothesis]:
        """The hypotheses rated: by few of the pairs, by some and by all where the former say that they may explain."""
        tried = self._rate(hypotheses, self._few)
        for pairing in (self._some, self.pairing):
            if len(pairing) > len(self._few):
                again = iter(self._rate([one.hypothesis for one in tried if one.maybe], pairing))
                tried = [next(again) if one.maybe else one for one in tried]
        return tried

    def _back(self, pairing: Pairing, skew_s: float) -> Pairing:
        return set_back(pairing, np.array([skew_s]), self._alignment)[0] if skew_s else pairing

    def _rate(self, hypotheses: Sequence[Hypothesis], pairing: Pairing) -> list[RatedHypothesis]:
        rated: dict[Hypothesis, RatedHypothesis] = {}
        for skew_ms in {hypothesis.skew_ms for hypothesis in hypotheses}:
            group = [hypothesis for hypothesis in hypotheses if hypothesis.skew_ms == skew_ms]
            shifted = self._back(pairing, 1e-3 * skew_ms)
            rated |= zip(group, self._rated(group, shifted, shifted.compare(group)), strict=True)
        return [rated[hypothesis] for hypothesis in hypotheses]

    def _rated(self, hypotheses: Sequence[Hypothesis], pairing: Pairing, found: Comparison) -> list[RatedHypothesis]:
        residual, bound = found.residual_rad, found.bound_rad
        known = np.isfinite(residual) & np.isfinite(bound)
        sets = (known, known & np.isin(pairing.sample, self._bad_samples))
        scaled = residual / fits.scale_rad(bound)
        floored = residual / (self._floor_rad + 3.0 * bound)
        median, p90 = (_worst(scaled, sets, share) for share in (0.5, 0.9))
        score = _worst(floored, sets, 0.9)
        left = _quantile(residual, known, 0.5)
        enough = known.sum(axis=1) >= [_least_pairs(hypothesis) for hypothesis in hypotheses]
        return [
            RatedHypothesis(
                hypothesis,
                float(left[i]) if enough[i] else np.inf,
                bool(enough[i] and median[i] < _MEDIAN and p90[i] < _P90 and score[i] <= _SCORE),
                bool(enough[i] and median[i] < _SCREEN * _MEDIAN and p90[i] < _SCREEN * _P90),
                float(score[i]) if enough[i] else np.inf,
            )
            for i, hypothesis in enumerate(hypotheses)
        ]

    def _tied(self, tried: Sequence[RatedHypothesis]) -> list[RatedHypothesis]:
        """Those that explain, and better than no mistake at all; of hypotheses that mean the same the simplest.

        What is undone in vain may turn so wildly that the bounds excuse it: it must leave no more than there was.
        """
        most_rad = max(self._as_sent.median_rad, self._floor_rad)
        good = [one for one in tried if one.explains and one.score < _BETTER * self._as_sent.score]
        good = [one for one in good if one.median_rad <= most_rad]
        if not good:
            return []
        best = min(good, key=lambda one: one.score)
        excused_rad = max(_EXCUSED * best.median_rad, _EXCUSED_FLOORS * self._floor_rad)
        tied = [one for one in good if one.median_rad <= excused_rad]
        unique: dict[str, RatedHypothesis] = {}
        for one in sorted(tied, key=lambda one: (*likeliest(one.hypothesis)[:2], one.score)):
            named = replace(one, hypothesis=by_name(one.hypothesis))
            if not any(same(named.hypothesis, other.hypothesis) for other in unique.values()):
                unique.setdefault(named.hypothesis.name, named)
        return sorted(unique.values(), key=lambda one: likeliest(one.hypothesis))


def _onset(residual_rad: Floats, bound_rad: Floats) -> int:
    """The first pair that disagrees; of bad ones without a first or two that may lie on both sides of the onset."""
    disagrees, bad = residual_rad > fits.scale_rad(bound_rad), residual_rad > _BAD_RAD + bound_rad
    if not bad.any():
        return int(np.argmax(disagrees))
    first = int(np.argmax(bad))
    return first + int(np.argmax(disagrees[first : first + _EARLY + 1]))


def _with_trims(found: Sequence[RatedHypothesis], trimmed: Sequence[RatedHypothesis]) -> list[RatedHypothesis]:
    """What explains, and what explains sharply beside a trim, which is no second mistake.

    What that betters it replaces. Else it is tied if it takes no more numbers, or gives the same mistake other ones.
    """
    sharp = [one for one in trimmed if one.score <= SHARP]
    better = [one for one in sharp if one.score < _best(found) / _GIVES_WAY]
    kept: list[RatedHypothesis] = []
    for one in (*(one for one in found if one.score <= SHARP or not better), *sharp):
        alike = [other for other in kept if other.hypothesis.mistaken == one.hypothesis.mistaken]
        if any(one.score < _BETTER * other.score for other in alike):
            kept = [*(other for other in kept if other not in alike), one]
        elif alike:
            news = not any(same_mistake(one.hypothesis, other.hypothesis) for other in alike)
            kept += [one] if news else []
        elif one in found or one in better or all(one.hypothesis.numbers <= of.hypothesis.numbers for of in kept):
            kept.append(one)
    return sorted(kept, key=lambda one: likeliest(one.hypothesis))


def _best(found: Sequence[RatedHypothesis]) -> float:
    return min((one.score for one in found), default=np.inf)


def _least_pairs(hypothesis: Hypothesis) -> int:
    if len(hypothesis.mistaken) > 1 and hypothesis not in SIMPLE:
        return _LEAST_TWO
    return _LEAST_FITTED if any(name in TRIMS for name in hypothesis.causes) else _LEAST


def _worst(values: Floats, sets: Sequence[Mask], share: float) -> Floats:
    """The largest of a quantile over several sets."""
    return np.asarray(np.fmax.reduce([_quantile(values, of, share) for of in sets]))


def _quantile(values: Floats, of: Mask, share: float) -> Floats:
    """A quantile of each row (m, k), of its marked places; NaN where these are too few to count."""
    if not values.shape[1]:
        return np.full(len(values), np.nan)
    ordered = np.sort(np.where(of, values, np.inf), axis=1)
    count = of.sum(axis=1)
    place = np.rint(share * np.maximum(count - 1, 0)).astype(np.int64)
    return np.where(count >= _LEAST, np.take_along_axis(ordered, place[:, None], axis=1)[:, 0], np.nan)


def _spread(bad: Mask, count: int) -> Int64s:
    """Places of at most `count` pairs: half of them evenly chosen, half evenly among those that disagree as sent."""
    every = np.arange(len(bad))
    if len(bad) <= count:
        return every
    return np.union1d(_evenly(every, count // 2), _evenly(np.flatnonzero(bad), count // 2))


def _evenly(rows: Int64s, count: int) -> Int64s:
    return rows[np.linspace(0, len(rows) - 1, min(count, len(rows))).astype(np.int64)]
