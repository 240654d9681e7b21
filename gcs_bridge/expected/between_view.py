"""One view of the vehicle where no pairs of one instant come: what pairs of neighbouring instants make of it.

They follow the rules of `view`, with noise and bound in place of a noise of nothing: so one pair says little, a fit
gets better with time, and what a trim may be has to be told from what it is not by more pairs.
"""

from __future__ import annotations

import math

import numpy as np

from gcs_bridge.expected.between import TELLS_RAD, BetweenPairs
from gcs_bridge.expected.between_fits import (
    LEAVES_IN_HOVER,
    Fitted,
    explains,
    fit_pitch,
    fit_trims,
    fit_view,
    refit_trims,
)
from gcs_bridge.expected.correction import AHRS_TRIM, PITCH_TRIM, VTOL_VIEW, Correction, CorrectionChange
from gcs_bridge.expected.knowledge import FirmwareConfig, left_of
from gcs_bridge.expected.pairs import IN_A_ROW
from gcs_bridge.expected.view import View

_TRY_FIRST = (3, 4, 6, 8, 12)  # denials after which a fit is tried,
_TRY_US, _TRY_SMALL_US = 250_000, 2_000_000  # and vehicle time between later attempts; where little is apart
_DENY_FIT, _DENY_FIT_US = 6, 1_000_000  # pairs in a row, for so long, that deny a fit for good: few oscillate so
_MOVES, _LATEST = 3.0, 16  # a fit made anew is within so many deviations of the one before, and fits so many pairs
_SMALL_RAD = math.radians(0.3)
_SAME_RAD = math.radians(0.002)  # a fit that moves by less is the same


def scan_between(
    view: View, pairs: BetweenPairs, told: FirmwareConfig, rival: Correction | None
) -> CorrectionChange | None:
    """Take pairs up to the first after which another correction holds, or another thing is known; None: take all."""
    memory, learnt = view.between, view.learnt[0]
    apart, scale = pairs.residual(view.correction), pairs.scale(view.noise_between_rad)
    for at, (angle, most, t_us) in enumerate(zip(apart.tolist(), scale.tolist(), pairs.t_us.tolist(), strict=True)):
        before, step = (view.unsure, view.settled), None
        if angle > most:
            memory.deny(t_us)
            learnt["between_agreements"] = 0
        else:
            memory.agree(tells=bool(pairs.bound_rad[at] <= TELLS_RAD))
            if not memory.denied:
                _agree(view, at_change=bool(pairs.free[at]))
        is_early = angle > most and memory.denied in _TRY_FIRST
        if memory.denied >= IN_A_ROW and (is_early or t_us >= memory.again_us):
            memory.again_us = t_us + (_TRY_US if angle > _SMALL_RAD + most else _TRY_SMALL_US)
            step = _denied(view, pairs[: at + 1], told, rival)
        elif t_us >= memory.refine_us:
            step = _refined(view, pairs[: at + 1])
        if step is not None or before != (view.unsure, view.settled) or memory.taken + at + 1 == IN_A_ROW:
            memory.keep(pairs[: at + 1])
            return step or CorrectionChange(at, view.correction, view.fitted)
    memory.keep(pairs)
    return None


def _agree(view: View, *, at_change: bool) -> None:
    """One more pair agrees, and could have told."""
    learnt = view.learnt[0]
    learnt["between_agreements"] += 1
    if learnt["between_agreements"] >= IN_A_ROW:
        learnt["is_confirmed"] = True
        view.settled |= not (view.comes_and_goes and at_change)


def _denied(view: View, more: BetweenPairs, told: FirmwareConfig, rival: Correction | None) -> CorrectionChange | None:
    """What holds instead of a correction that the last pairs deny."""
    memory, noise_rad, at = view.between, view.noise_between_rad, len(more) - 1
    run = memory.window(more, memory.denied_since_us)
    last = run[-IN_A_ROW:]

    def fits(other: Correction, but_for_rad: float = 0.0) -> bool:
        return bool((last.residual(other) <= last.scale(noise_rad) + but_for_rad).all())

    for other in view.expected:
        if other != view.correction and fits(other) and explains(run, other, noise_rad):
            return CorrectionChange(at, other)
    if rival is not None and not last.free.any() and fits(rival, left_of(rival)):
        return CorrectionChange(at, view.correction, view.fitted, gives_up=VTOL_VIEW)
    if view.by_between and (step := _refined(view, more)) is not None:
        return step
    if view.open & VTOL_VIEW and not view.fitted and (last.free.all() or not view.settled):
        fitted = fit_view(run, noise_rad)
        if fitted is not None and told.allows_view(np.array(fitted.correction.view_rad)):
            return _change(view, at, fitted, VTOL_VIEW)
    if (view.open | view.changeable) & PITCH_TRIM:
        fitted = fit_pitch(run, view.expected[0]._replace(pitch_rad=0.0), noise_rad)
        if fitted is not None and (_is_told_apart(fitted) or view.may_begin_with(PITCH_TRIM)):
            return _change(view, at, fitted, PITCH_TRIM)
    if view.open & AHRS_TRIM and not view.fitted & AHRS_TRIM:
        whole = memory.window(more, 0)
        start = Correction(view.expected[0].pitch_rad)
        fitted, memory.denies_trims = fit_trims(whole, len(whole) - len(run), start, noise_rad)
        if fitted is not None:
            return _change(view, at, fitted, AHRS_TRIM)
    lasts_us = int(more.t_us[-1]) - memory.denied_since_us
    is_denied = memory.denials >= _DENY_FIT and lasts_us >= _DENY_FIT_US
    if view.fitted and view.by_between and not view.proven and is_denied:
        return CorrectionChange(at, view.expected[0], gives_up=view.fitted)
    return None


def _refined(view: View, more: BetweenPairs) -> CorrectionChange | None:
    """The same fit made anew, by all that is remembered; None: it stays as it is."""
    memory, noise_rad, at = view.between, view.noise_between_rad, len(more) - 1
    memory.refined(int(more.t_us[-1]))
    window = memory.window(more, memory.since_us)
    fitted: Fitted | None = None
    if view.fitted == PITCH_TRIM:
        fitted = fit_pitch(window, view.expected[0]._replace(pitch_rad=0.0), noise_rad)
    elif view.fitted == AHRS_TRIM:
        fitted = refit_trims(window, view.correction, noise_rad)
    elif view.fitted == VTOL_VIEW:
        fitted = fit_view(window, noise_rad)
    if fitted is None or not _betters(fitted, view, window):
        return None
    moved = max(abs(a - b) for a, b in zip(fitted.correction, view.correction, strict=True))
    proves = _is_told_apart(fitted) and not view.proven
    return _change(view, at, fitted, view.fitted, refines=True) if moved > _SAME_RAD or proves else None


def _is_told_apart(fitted: Fitted) -> bool:
    return not fitted.like_mount and not fitted.like_sign


def _betters(fitted: Fitted, view: View, window: BetweenPairs) -> bool:
    """Whether a fit made anew is the same one: near to what was known, and good for the latest pairs as well."""
    memory = view.between
    before = Fitted(view.correction, memory.information, like_mount=False)
    leaves = LEAVES_IN_HOVER if view.fitted == VTOL_VIEW else 1.0
    latest = window[-_LATEST:]
    return before.moves(fitted.correction) <= _MOVES and explains(
        latest, fitted.correction, view.noise_between_rad, leaves=leaves
    )


def _change(view: View, at: int, fitted: Fitted, cause: int, *, refines: bool = False) -> CorrectionChange:
    view.between.information = fitted.information
    return CorrectionChange(
        at,
        fitted.correction,
        cause,
        between=True,
        refines=refines,
        like_mount=fitted.like_mount,
        like_sign=fitted.like_sign,
    )
