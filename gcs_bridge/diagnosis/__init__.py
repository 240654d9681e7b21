"""The convention doctor: which mistake makes the two attitude messages disagree.

`diagnose` takes the samples of both messages as they were sent from the onset of the disagreement on, undoes each
mistake of the causes' table on them, and names what leaves nothing. It never guesses: what the motion cannot tell apart
is named together, with the motion that would tell. A pure function of its window; it knows no alarms and no streams.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gcs_bridge import contract
from gcs_bridge.contract import Confidence, known
from gcs_bridge.diagnosis import wording as words
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.diagnosis.hypotheses import NO_MISTAKE, Hypothesis, Mistakes
from gcs_bridge.diagnosis.mistake import Value
from gcs_bridge.diagnosis.ranking import SHARP, HypothesisSearch, RatedHypothesis, Verdict
from gcs_bridge.diagnosis.single_stream import at_fault, frozen, norms, sends_euler_rates
from gcs_bridge.diagnosis.window import Window, pair, plain_attitude
from gcs_bridge.settings import AlignmentSettings
from gcs_bridge.telemetry.samples import AttitudeSamples

__all__ = ["Diagnosis", "Window", "diagnose", "diagnose_norm", "diagnose_rates", "plain_attitude"]

_MAX_CANDIDATES = 4
_LEAST_S = 1.0  # of data, before a constant or a lag is certain
_RATE_CHANGES_RAD_S = math.radians(2.0)
_LEAST_TURNING = 5  # pairs at another rate than the usual one
_NORM_OFF = 1e-3  # floats are within 2e-7 of norm 1


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Which mistake explains a disagreement.

    `causes` in the order of undoing, `values` beside them, each in its unit; `candidates`: all that explains and cannot
    be told apart, at most four, the likeliest first. `side`: the message at fault, None where it can't be told.
    `residual_deg`: the median of what is left; `next_best_deg`: what the best of the others would leave. `shape`: what
    the unexplained looks like.
    """

    causes: tuple[str, ...]
    confidence: Confidence
    candidates: tuple[str, ...] = ()
    values: tuple[Value, ...] = ()
    side: Literal[30, 31] | None = None
    residual_deg: float | None = None
    next_best_deg: float | None = None
    fix: str = ""
    shape: str | None = None

    @property
    def cause(self) -> str:
        """One name, or two joined by +."""
        return "+".join(self.causes)

    def entry(self) -> contract.Diagnosis:
        """As the report and the events show it."""
        told = [(name, value) for name, value in zip(self.causes, self.values, strict=True) if value]
        name, value = told[0] if told else ("", ())
        return contract.Diagnosis(
            cause=self.cause,
            causes=self.causes,
            confidence=self.confidence,
            distinguishable=len(self.candidates) == 1,
            candidates=self.candidates,
            side=self.side,
            value=float(value[0]) if len(value) == 1 else tuple(map(float, value)) or None,
            unit=(CAUSES[name].unit if name in CAUSES else "deg") or None if name else None,
            residual=known(self.residual_deg),
            next_best=known(self.next_best_deg),
            fix=self.fix,
        )


def diagnose(window: Window, alignment: AlignmentSettings | None = None) -> Diagnosis | None:
    """Name the mistake behind a window's disagreement; None: the two forms agree."""
    with np.errstate(invalid="ignore"):  # rates that are no numbers
        return _diagnosed(window, alignment or AlignmentSettings())


def diagnose_norm(quaternion: AttitudeSamples) -> Diagnosis | None:
    """Name what makes norms of quaternions wrong, whatever their directions say; None: they are 1."""
    length = norms(quaternion)
    off = length[np.abs(length - 1.0) > _NORM_OFF]
    if not len(off):
        return None
    least, middle, most = np.quantile(off, (0.05, 0.5, 0.95)).tolist()  # single ones may be damaged
    if most - least < _NORM_OFF * middle:
        return _named(Hypothesis((("quaternion_unnormalised", (middle,)),)), "certain", side=31)
    return _named(
        Hypothesis((("unknown", ()),)),
        "unknown",
        candidates=(),
        side=31,
        fix=f"No one factor explains norms from {least:.3g} to {most:.3g}: look for what changes single numbers of it.",
    )


def diagnose_rates(euler: AttitudeSamples, quaternion: AttitudeSamples) -> Diagnosis | None:
    """Name what makes the turns of the two messages, or of one, other than their rates say; None: no known mistake."""
    with np.errstate(invalid="ignore"):
        known = {side: sends_euler_rates(samples) for side, samples in ((30, euler), (31, quaternion))}
    told = [side for side, found in known.items() if found is not None]
    if not told or any(known[side] is False for side in told):
        return None
    return _named(Hypothesis((("euler_rates", ()),)), "certain")


def _diagnosed(window: Window, alignment: AlignmentSettings) -> Diagnosis | None:
    pairing = pair(window, alignment)
    length = norms(window.quaternion)
    usual = float(np.median(length)) if len(length) else 1.0
    off_norm = (("quaternion_unnormalised", (usual,)),) if abs(usual - 1.0) > _NORM_OFF else ()
    if not len(pairing):  # nothing to compare: what is left is the norm
        return _named(Hypothesis(off_norm), "certain", side=31) if off_norm else None
    stopped = frozen(pairing)
    if stopped is not None:
        name, moved = stopped
        return _named(Hypothesis(((name, ()),)), "certain" if moved else "probable", side=CAUSES[name].message)
    case = HypothesisSearch(pairing, alignment, clean=window.clean_before)
    if case.agrees():
        if off_norm:
            return _named(Hypothesis(off_norm), "certain", side=31, residual_rad=case.median_rad)
        if window.reset and case.tells:
            return _named(Hypothesis((("estimator_reset", ()),)), "probable", residual_rad=case.median_rad)
        return None
    verdict = case.decide()
    if verdict.found:
        return _explained(case, verdict, off_norm)
    return _unknown(case, verdict.next_best())


def _explained(case: HypothesisSearch, verdict: Verdict, off_norm: Mistakes) -> Diagnosis:
    """What explains; more than one where the motion cannot tell."""
    found = verdict.found
    best = min(found, key=lambda tried: tried.score)
    rest = [tried for tried in found if tried is not best][: _MAX_CANDIDATES - 1]
    tied = [tried.hypothesis for tried in found if tried is best or tried in rest]
    first = Hypothesis((*tied[0].mistakes, *off_norm))
    fix = words.advice(first)
    if len(tied) > 1:
        names = " or ".join(one.name for one in tied)
        motion = words.telling_motion([one.hypothesis for one in found], case.pairing)
        fix = f"Not told apart yet: {names}. {motion} If it is the first: {fix}"
    return _named(
        first,
        "certain" if len(tied) == 1 and best.score <= SHARP and _is_certain(case, first) else "probable",
        candidates=tuple(one.name for one in tied),
        side=at_fault(case.pairing, first) if len(tied) == 1 else None,
        residual_rad=next(tried.median_rad for tried in found if tried.hypothesis is tied[0]),
        next_best_rad=_left(verdict.next_best()),
        fix=fix,
    )


def _left(tried: RatedHypothesis | None) -> float | None:
    return None if tried is None else tried.median_rad


def _is_certain(case: HypothesisSearch, hypothesis: Hypothesis) -> bool:
    """A constant or a lag needs some time and a change of rate, else anything may look like it."""
    if not hypothesis.numbers:
        return True
    t_s, w = case.pairing.t_s, case.pairing.rates()
    spread = np.sqrt(np.square(w - np.nanmedian(w, axis=0)).sum(axis=1))
    return bool(t_s[-1] - t_s[0] >= _LEAST_S and (spread > _RATE_CHANGES_RAD_S).sum() >= _LEAST_TURNING)


def _unknown(case: HypothesisSearch, nearest: RatedHypothesis | None) -> Diagnosis:
    shape, fix = words.shape(case.pairing, case.as_sent), "Too little data yet to tell."
    if case.enough and nearest is not None:
        fix = (
            f"{CAUSES['unknown'].fix} It is {shape}; the nearest mistake, {nearest.hypothesis.name}, leaves "
            f"{math.degrees(nearest.median_rad):.2g}°."
        )
    if case.pairing.window.trims:
        fix += " The vehicle's trims were not told and may have a part in it: ask for its parameters."
    return Diagnosis(
        causes=("unknown",),
        values=((),),
        confidence="unknown",
        side=at_fault(case.pairing, NO_MISTAKE),
        residual_deg=math.degrees(case.median_rad),
        next_best_deg=None if nearest is None else math.degrees(nearest.median_rad),
        shape=shape,
        fix=fix,
    )


def _named(
    hypothesis: Hypothesis,
    confidence: Confidence,
    *,
    candidates: tuple[str, ...] | None = None,
    side: Literal[30, 31] | None = None,
    residual_rad: float | None = None,
    next_best_rad: float | None = None,
    fix: str | None = None,
) -> Diagnosis:
    return Diagnosis(
        causes=hypothesis.causes,
        values=tuple(value for _, value in hypothesis.mistakes),
        confidence=confidence,
        candidates=(hypothesis.name,) if candidates is None else candidates,
        side=side,
        residual_deg=None if residual_rad is None else math.degrees(residual_rad),
        next_best_deg=None if next_best_rad is None else math.degrees(next_best_rad),
        fix=words.advice(hypothesis) if fix is None else fix,
    )
