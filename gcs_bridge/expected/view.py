"""One view of the vehicle: which correction holds in it, by what was told and by what the pairs of one instant say."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gcs_bridge.columns import Floats, Int64s, Mask
from gcs_bridge.expected.between_fits import MOST_PITCH_RAD
from gcs_bridge.expected.between_memory import NEVER_US, BetweenMemory
from gcs_bridge.expected.correction import (
    AHRS_TRIM,
    NOTHING,
    PITCH_TRIM,
    TRIM_FITTED,
    UNSURE,
    VTOL_VIEW,
    Correction,
    CorrectionChange,
)
from gcs_bridge.expected.knowledge import FirmwareConfig, left_of
from gcs_bridge.expected.pairs import (
    BANK_RAD,
    IN_A_ROW,
    NO_CLEAN_PAIRS,
    NOISE_RAD,
    RECENT,
    SECOND_ORDER,
    SPARSE_US,
    TOLD_APART,
    TRIM_PAIRS,
    CleanPairs,
    fit_trims,
    in_a_row,
    like_mount,
    like_sign,
    pitch_axis,
    run_lengths,
    turn_about,
)
from gcs_bridge.expected.quiet import LEARNT, Expectation

_SAME_FIT_RAD = math.radians(0.3)  # by which pairs of one instant may better a fit to others
_FIT_FIRST = (3, 4, 6, 8)  # denials after which two numbers are fitted,
_FIT_EVERY_US = 250_000  # and vehicle time between later attempts
_Y_AXIS = np.array([[0.0, 1.0, 0.0]])  # of the body: to the right


class View:
    """One view of the vehicle: the correction that holds in it, and what the pairs of one instant make of that."""

    def __init__(self, noise_rad: float, noise_between_rad: float, *, comes_and_goes: bool) -> None:
        """Start with nothing told; a view that comes and goes may be new wherever the views may change."""
        self.noise_between_rad = noise_between_rad  # of pairs of neighbouring instants, beside their bound
        self.comes_and_goes = comes_and_goes
        self.correction = NOTHING
        self.fitted = 0  # causes of it that were fitted
        self.proven = False  # the motion has told the fit from other forms: what denies it now is a fault beside it
        self.switched = False  # a fitted view was seen to go with the mode
        self.settled = False  # both forms agreed before: a new difference may be a fault
        self._noise_rad = noise_rad
        self._pitch_moves_rad = 2.0 * TOLD_APART * noise_rad  # so much, and the fit is no wrong sign
        self.learnt = np.zeros(1, LEARNT)
        self.learnt["lowest_rad"], self.learnt["highest_rad"] = math.inf, -math.inf
        self.expected: tuple[Correction, ...] = (NOTHING,)  # what was told, and what may hold instead of it
        self.open = 0  # causes that may be fitted
        self.changeable = 0  # causes that were told, and may be fitted where the motion tells them from all else
        self.fit = 0  # which fit it is; the same as long as it is only refined
        self.found = 0  # how often a trim was fitted that was none before
        self.by_between = False  # it rests on pairs of neighbouring instants
        self.between = BetweenMemory()
        self.recent = self.sparse = NO_CLEAN_PAIRS  # the latest pairs, and one a second
        self._denials = 0  # pairs in a row, up to the last one kept,
        self._denied_since_us = 0  # from the first of them on
        self._scanned = (np.empty(0, np.int64), np.empty(0, np.int64))  # the same up to each pair scanned

    def start_boot(self) -> None:
        """Pairs of the boot before say nothing any more; the correction still holds, as parameters do."""
        self.recent = self.sparse = NO_CLEAN_PAIRS
        self._denials, self.learnt["agreements"], self.learnt["between_agreements"] = 0, 0, 0
        information = self.between.information
        self.between = BetweenMemory(information=information)
        if self.by_between:
            self.between.begin_refining(0)

    def take_over(self, other: View) -> None:
        """The latest pairs, which were taken for the other view's, may have been this one's."""
        self.recent = other.recent
        self.between, other.between = other.between, BetweenMemory()
        self._denials, self.learnt["agreements"] = 0, 0
        if len(other.recent):
            self._denials = int(run_lengths(self._denied(other.recent), 0)[-1])

    @property
    def untold(self) -> int:
        """Causes that may be in the angles and are not undone: not told, not fitted, and nothing has ruled them out."""
        return self.open & ~self.fitted & ~(AHRS_TRIM if self.learnt["is_banked"][0] else 0)

    @property
    def bits(self) -> int:
        """What is known of each sample that shows this view, as `Corrected.open` has it."""
        sure = self.fitted & AHRS_TRIM and not self.by_between
        return self.untold | (UNSURE if self.unsure else 0) | (TRIM_FITTED if sure else 0)

    def denied_for_us(self, now_us: int) -> int:
        """For how long the latest pairs have denied the correction; 0: they do not."""
        exact, between = self._denials >= IN_A_ROW, self.between.denied >= IN_A_ROW
        since_us = [self._denied_since_us] * exact + [self.between.denied_since_us] * between
        return now_us - min(since_us, default=now_us)

    @property
    def unsure(self) -> bool:
        """Whether an AHRS_TRIM may still be found, which takes pairs of neighbouring instants some time."""
        may_be = self.open & AHRS_TRIM and not self.fitted & AHRS_TRIM
        return bool(may_be and self.between.comes and not self.between.denies_trims)

    def expect(self, expected: tuple[Correction, ...], open_causes: int, changeable: int = 0) -> None:
        """Something was told: what it predicts holds from now on, unless it says nothing new here."""
        if (expected, open_causes, changeable) == (self.expected, self.open, self.changeable):
            return
        may_be_fitted = open_causes | changeable
        fit_stands = self.fitted and not self.fitted & ~may_be_fitted and expected[0] == self.expected[0]
        if not fit_stands and (expected[0] != self.expected[0] or self.fitted):
            self._hold(CorrectionChange(0, expected[0]))
        self.expected, self.open, self.changeable = expected, open_causes, changeable

    def scan(self, pairs: CleanPairs, told: FirmwareConfig, rival: Correction | None) -> CorrectionChange | None:
        """Find the first of the pairs after which another correction holds; nothing is remembered yet.

        `rival` is a fitted correction of the other view: if it holds in this one as well, it is none.
        """
        if not len(pairs):
            return None
        denied = self._denied(pairs)
        denials = run_lengths(denied, self._denials)
        agreements = run_lengths(~denied, self.learnt["agreements"][0])
        self._scanned = denials, agreements
        steps = [CorrectionChange(at, self.correction, self.fitted) for at in self._learns(pairs, denials, agreements)]
        hot = denials >= IN_A_ROW
        if not hot.any():
            return min(steps, key=lambda step: step.at, default=None)
        seen, n = self.recent.then(pairs), len(hot)

        def first(where: Mask) -> int | None:
            where = where[-n:] & hot
            return int(where.argmax()) if where.any() else None

        for other in self.expected:
            at = None if other == self.correction else first(in_a_row(seen.residual(other) <= self._noise_rad))
            if at is not None:
                steps.append(CorrectionChange(at, other))
        if rival is not None:
            at = first(in_a_row((seen.residual(rival) <= self._noise_rad + left_of(rival)) & ~seen.free))
            if at is not None:
                steps.append(CorrectionChange(at, self.correction, self.fitted, gives_up=VTOL_VIEW))
        if self.open & VTOL_VIEW and (not self.fitted or self.by_between):
            turn, fits = turn_about(seen.apart(NOTHING), _Y_AXIS, self._noise_rad)
            fits &= self._refines(turn, self.correction.view_rad)
            at = first(fits & (seen.free | (not self.settled) | self.by_between) & told.allows_view(turn))
            if at is not None:
                steps.append(CorrectionChange(at, Correction(view_rad=float(turn[at - n])), VTOL_VIEW))
        if (self.open | self.changeable) & PITCH_TRIM:
            base = self.expected[0]._replace(pitch_rad=0.0)
            turn, fits = turn_about(seen.apart(base), pitch_axis(seen, base), NOISE_RAD)
            pitch = seen.rpy_rad[:, 1]
            moved = np.zeros(len(pitch), np.bool_)
            moved[2:] = np.abs(pitch[2:] - pitch[:-2]) > self._pitch_moves_rad
            told_apart = moved & ~in_a_row(like_mount(seen, turn))
            allowed = told_apart | self.may_begin_with(PITCH_TRIM)
            if self.by_between:
                allowed |= self._refines(turn, self.correction.pitch_rad)
            at = first(fits & allowed & (np.abs(turn) <= MOST_PITCH_RAD))
            if at is not None:
                steps.append(CorrectionChange(at, base._replace(pitch_rad=float(turn[at - n])), PITCH_TRIM))
        if self.open & AHRS_TRIM:
            steps += self._trims(seen, denials, min((step.at for step in steps), default=n))
        if self.fitted and not self.proven and not self.by_between:
            steps.append(CorrectionChange(int(hot.argmax()), self.expected[0], gives_up=self.fitted))
        return min(steps, key=lambda step: step.at, default=None)

    def keep(self, pairs: CleanPairs, step: CorrectionChange | None) -> Correction:
        """Remember the first of the pairs that were scanned; the last of them has made the step.

        Returns the correction that is dropped, if no pairs ever confirmed it.
        """
        if not len(pairs):
            return NOTHING
        denials, agreements = (counts[: len(pairs)] for counts in self._scanned)
        self.settled |= bool(self._settling(pairs, agreements).any())
        self.learnt["is_banked"] |= _banking(pairs, agreements).any()
        self._denials, self.learnt["agreements"] = int(denials[-1]), agreements[-1]
        if 0 < self._denials <= len(pairs):
            self._denied_since_us = int(pairs.t_us[-self._denials])
        self.learnt["is_confirmed"] |= (agreements >= IN_A_ROW).any()
        self._test(pairs[denials == 0])
        seen = self.recent.then(pairs)
        self.sparse = self.sparse.then(seen[self._one_a_second(seen)])[-RECENT:]
        self.recent = seen[-RECENT:]
        if step is None or step.correction == self.correction:
            return NOTHING
        dropped = NOTHING if self.learnt["is_confirmed"][0] or self.fitted else self.correction
        self._hold(step)
        self._test(self.recent[-IN_A_ROW:])
        return dropped

    def expectation(self) -> Expectation | None:
        """What the pairs must show to be no news; None: each of them may be."""
        if (self.fitted and not self.proven) or self._denials or self.between.denied:
            return None
        return Expectation(
            *self.correction,
            limit_rad=TOLD_APART * self._noise_rad,
            settled=self.settled,
            wants_bank=bool(self.open & AHRS_TRIM and not self.learnt["is_banked"][0]),
            fitted=self.fitted != 0,
            noise_between_rad=self.noise_between_rad,
            counts_between=not self.between.comes,
            refine_us=self.between.refine_us,
        )

    def may_begin_with(self, cause: int) -> bool:
        """Whether a cause may be fitted though the motion does not tell it from a mistake: nobody told, nor agreed."""
        return bool(self.open & cause) and not self.settled and not self.fitted

    def alternatives(self) -> list[str]:
        """What else the pairs may be, instead of what was fitted to them."""
        if self.fitted & VTOL_VIEW:
            return [] if self.switched else ["mount_offset"]
        return ["mount_offset"] * int(self.learnt["like_mount"][0]) + ["pitch_sign"] * int(self.learnt["like_sign"][0])

    def _refines(self, turn: Floats, fitted_rad: float) -> Mask:
        """Where turns (n,) only better a fit to pairs of neighbouring instants; everywhere if there is none."""
        return np.asarray((np.abs(turn - fitted_rad) <= _SAME_FIT_RAD) | (not self.by_between))

    def _test(self, good: CleanPairs) -> None:
        """Learn from pairs that confirm a fit what else it could be."""
        if not self.fitted or self.by_between or not len(good):
            return
        learnt, trim, pitch = self.learnt[0], self.correction.pitch_rad, good.rpy_rad[:, 1]
        learnt["like_mount"] &= like_mount(good, trim).all()
        learnt["like_sign"] &= like_sign(good, trim).all()
        learnt["lowest_rad"] = min(learnt["lowest_rad"], pitch.min())
        learnt["highest_rad"] = max(learnt["highest_rad"], pitch.max())
        moved = learnt["highest_rad"] - learnt["lowest_rad"] > self._pitch_moves_rad
        self.proven |= bool(moved and not learnt["like_mount"])

    def keep_between(self, step: CorrectionChange, t_us: int) -> Correction:
        """Make a step that a pair of neighbouring instants, at `t_us`, asks for; returns as `keep` does."""
        if step.correction == self.correction and step.fitted == self.fitted:
            return NOTHING
        dropped = NOTHING if self.learnt["is_confirmed"][0] or self.fitted or step.refines else self.correction
        self._hold(step)
        self.between.hold(t_us, fitted=step.between, whole=bool(step.fitted & AHRS_TRIM))
        return dropped

    def _hold(self, step: CorrectionChange) -> None:
        learnt, proven = self.learnt, not step.like_mount and not step.like_sign
        if step.refines:
            self.correction, self.proven = step.correction, self.proven or proven
            learnt["like_mount"] &= step.like_mount
            learnt["like_sign"] &= step.like_sign
            return
        if step.correction != self.correction:
            learnt["is_banked"] = False
        self.fit += 1
        self.found += bool(step.fitted & (PITCH_TRIM | AHRS_TRIM))
        self.correction, self.fitted, self.by_between = step.correction, step.fitted, step.between
        self.proven, self.switched = step.fitted == AHRS_TRIM or (step.between and proven), False
        learnt["like_mount"] = learnt["like_sign"] = bool(step.fitted & PITCH_TRIM)
        if step.between:
            learnt["like_mount"], learnt["like_sign"] = step.like_mount, step.like_sign
        learnt["lowest_rad"], learnt["highest_rad"] = math.inf, -math.inf
        self.settled |= bool(step.gives_up)  # what deceived once has to be told apart the next time
        self._denials, learnt["agreements"], learnt["between_agreements"] = 0, 0, 0
        self.between.denied = self.between.denials = 0
        if not step.between:
            self.between.refine_us = NEVER_US
        learnt["is_confirmed"] = False

    def _denied(self, pairs: CleanPairs) -> Mask:
        return pairs.residual(self.correction) > TOLD_APART * self._noise_rad

    def _settling(self, pairs: CleanPairs, agreements: Int64s) -> Mask:
        settling = agreements >= IN_A_ROW
        return settling & ~pairs.free if self.comes_and_goes else settling

    def _learns(self, pairs: CleanPairs, denials: Int64s, agreements: Int64s) -> Iterator[int]:
        """The first pairs that settle the view, and that prove its fit: what they make known holds behind them."""
        if not self.settled and (settling := self._settling(pairs, agreements)).any():
            yield int(settling.argmax())
        if not self.learnt["is_banked"][0] and self.open & AHRS_TRIM and (banking := _banking(pairs, agreements)).any():
            yield int(banking.argmax())
        if self.fitted and not self.proven:
            pitch, good = pairs.rpy_rad[:, 1], denials == 0
            low = np.minimum.accumulate(np.where(good, pitch, math.inf))
            high = np.maximum.accumulate(np.where(good, pitch, -math.inf))
            moved = (
                np.maximum(high, self.learnt["highest_rad"][0]) - np.minimum(low, self.learnt["lowest_rad"][0])
                > self._pitch_moves_rad
            )
            banked = np.logical_or.accumulate(good & ~like_mount(pairs, self.correction.pitch_rad))
            if (proves := moved & (banked | (not self.learnt["like_mount"][0]))).any():
                yield int(proves.argmax())

    def _one_a_second(self, seen: CleanPairs) -> Int64s:
        """Places in `seen` of the first pair of each second, where it is new."""
        before = len(self.recent)
        return np.flatnonzero(np.diff(seen.t_us // SPARSE_US, prepend=-1)[before:]) + before

    def _trims(self, seen: CleanPairs, denials: Int64s, end: int) -> list[CorrectionChange]:
        """Fit AHRS_TRIM to the latest pairs; the first fit before pair `end`, if any.

        While it fails it is tried a few times a second: the difference grows with the bank, slower than that.
        """
        before, old = len(seen) - len(denials), len(self.sparse)
        both, pitch_rad = self.sparse.then(seen), self.expected[0].pitch_rad
        rotvec = both.apart(Correction(pitch_rad))
        begins = np.concatenate((np.arange(old), old + self._one_a_second(seen)))
        due = np.isin(denials, _FIT_FIRST) | (np.diff(seen.t_us // _FIT_EVERY_US, prepend=0)[before:] != 0)
        about_x, size = np.abs(rotvec[old + before :, 0]), np.sqrt((rotvec[old + before :] ** 2).sum(axis=1))
        due &= (denials >= IN_A_ROW) & (about_x <= SECOND_ORDER * size + NOISE_RAD)
        for at in np.flatnonzero(due[:end]).tolist():
            to = old + before + at + 1
            lengths = (RECENT, RECENT // 2, TRIM_PAIRS) if denials[at] < RECENT else (RECENT,)
            windows = [np.arange(max(to - length, old), to) for length in lengths]
            for window in (np.concatenate((begins[begins < to][-RECENT:], windows[0])), *windows):
                fitted = fit_trims(both[window], rotvec[window], pitch_rad)
                if fitted is not None:
                    return [CorrectionChange(at, fitted, AHRS_TRIM)]
        return []


def _banking(pairs: CleanPairs, agreements: Int64s) -> Mask:
    """Pairs (n,) in which an AHRS_TRIM that was not undone would have shown."""
    return np.asarray((agreements >= IN_A_ROW) & (np.abs(pairs.rpy_rad[:, 0]) > BANK_RAD))
