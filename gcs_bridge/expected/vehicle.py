"""The expected differences of one vehicle, followed through its batches and boots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.contract import ExplainedBy
from gcs_bridge.expected.between import BETWEEN_NOISE_RAD, BETWEEN_NOISE_VIEW_RAD, pairs_between
from gcs_bridge.expected.between_view import scan_between
from gcs_bridge.expected.corrected import Corrected
from gcs_bridge.expected.correction import (
    NOTHING,
    UNSURE,
    VTOL_VIEW,
    Correction,
    CorrectionChange,
)
from gcs_bridge.expected.explanations import EFFECT_RAD, Explanations
from gcs_bridge.expected.felt import NO_FORCES, Seat, forces_of
from gcs_bridge.expected.knowledge import FORWARD, HOVER, FirmwareConfig
from gcs_bridge.expected.latest import Latest, one_view
from gcs_bridge.expected.pairs import (
    NO_CLEAN_PAIRS,
    NOISE_RAD,
    TAIL,
    VIEW_NOISE_RAD,
    CleanPairs,
    EulerRows,
    QuaternionRows,
    in_order,
    match,
)
from gcs_bridge.expected.shown_view import ShownView
from gcs_bridge.expected.view import View
from gcs_bridge.telemetry.samples import AttitudeSamples, ImuSamples
from gcs_bridge.telemetry.statements import ModeSet, ParameterSet

_CHANGE_RAD = math.radians(0.5)  # across a change by more there is no step of the vehicle
_TOLD_LATE_US = 3_500_000  # a mode is told at once, and each second: of these a link may lose three


class _StepBetween(NamedTuple):
    """What a pair of neighbouring instants, completed by a frame, makes of a view."""

    frame_index: int
    t_us: int
    view: View
    step: CorrectionChange


class Expected:
    """The differences that one vehicle's firmware makes, followed through its batches and boots."""

    def __init__(self) -> None:
        """Start with nothing told."""
        self._told = FirmwareConfig()
        self._news: list[ParameterSet | ModeSet] = []
        self._views = (
            View(NOISE_RAD, BETWEEN_NOISE_RAD, comes_and_goes=False),
            View(VIEW_NOISE_RAD, BETWEEN_NOISE_VIEW_RAD, comes_and_goes=True),
        )
        self._explanations = Explanations()
        self._latest = Latest()
        self._forces = NO_FORCES  # the latest, of what may be a plane
        self._seat = Seat()
        self._applied, self._changed = NOTHING, 0  # to the last sample, and how often that has changed
        self._found = 0  # how often a trim was fitted
        self._found_at: list[int] = []  # the frames with which that was in this batch
        self._done = -1  # frame_index up to which pairs were taken
        self._shown = ShownView()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone. Parameters, modes and what was fitted outlive it."""
        self._latest.start_boot()
        self._forces = NO_FORCES
        self._shown.start_boot()
        for view in self._views:
            view.start_boot()

    def told(self, what: Iterable[ParameterSet | ModeSet]) -> None:
        """Take what arrived in this batch, in order of arrival, before `correct` of the same batch."""
        self._news += what

    def correct(self, euler: AttitudeSamples, quaternion: AttitudeSamples, imu: ImuSamples | None = None) -> Corrected:
        """Undo the expected differences in a batch of Euler samples.

        The frames say the order of arrival among both, the inertial samples, and with what was told.
        """
        if imu is not None and self._told.may_be_plane:
            self._forces = forces_of(imu, self._forces)
        q_nb, causes, untold = euler.q_nb, np.zeros(len(euler), np.uint8), np.zeros(len(euler), np.uint8)
        applied, corrections = np.zeros(len(euler), np.int64), [NOTHING]
        news, self._news = self._news, []
        self._found_at = []
        done = [0, 0]
        for what in [*news, None]:
            if what is not None and not self._told.is_new(what):
                continue
            upto = [len(euler), len(quaternion)]
            if what is not None:
                upto = [int(np.searchsorted(of.frame_index, what.frame_index)) for of in (euler, quaternion)]
            if upto != done and not self._told.makes_none:
                e, q = slice(done[0], upto[0]), slice(done[1], upto[1])
                whole = upto == [len(euler), len(quaternion)] and done == [0, 0]
                samples = (euler, quaternion) if whole else (euler[e], quaternion[q])
                for rows, corrected, turned_by, correction in self._take(*samples, untold[e]):
                    if q_nb is euler.q_nb:
                        q_nb = q_nb.copy()
                    q_nb[done[0] + rows], causes[done[0] + rows] = corrected, turned_by
                    applied[done[0] + rows] = len(corrections)
                    corrections.append(correction)
            done = upto
            if what is not None:
                self._learn(what)
        return Corrected(
            frame_index=euler.frame_index,
            q_nb=q_nb,
            causes=causes,
            open=untold,
            applied=applied,
            corrections=tuple(corrections),
            changes=self._changes(applied, corrections),
            found_at=tuple(self._found_at),
        )

    def _changes(self, applied: Int64s, corrections: list[Correction]) -> Int64s | None:
        """How often what is undone has changed up to each sample; None: never."""
        if len(corrections) == 1 and self._applied == NOTHING and not self._changed:
            return None
        values = np.array([self._applied, *(corrections[index] for index in applied.tolist())])
        changes = self._changed + np.cumsum((np.abs(np.diff(values, axis=0)) > _CHANGE_RAD).any(axis=1))
        if len(applied):
            self._applied, self._changed = corrections[int(applied[-1])], int(changes[-1])
        return changes

    @property
    def explains(self) -> bool:
        """Whether anything was undone that shows."""
        return bool(self._explanations)

    @property
    def undoes_view(self) -> bool:
        """Whether a view was undone that shows."""
        return self._explanations.has(VTOL_VIEW)

    def explanations(self) -> list[ExplainedBy]:
        """The report's `explained_by`: what turned samples by more than 0.02°, in order of time."""
        return self._explanations.entries(on_wings=self._seat.on_wings)

    def _learn(self, what: ParameterSet | ModeSet) -> None:
        self._latest.unload(self._views[FORWARD])
        told, (forward, hover) = self._told, self._views
        before, could_hover, flew_forward = (told.view, told.autopilot), told.can_hover, told.custom_mode >= 0
        latest = [int(of.t_us[-1]) for of in (self._latest.euler, self._latest.quaternion) if len(of)]
        told.take(what)
        if (told.view, told.autopilot) != before:
            self._shown.change_mode(max(latest, default=None))
        if told.can_hover and not could_hover:
            self._shown.forget_latest()
            # What was there long before comes from no VTOL mode.
            told.view_refuted |= flew_forward and forward.denied_for_us(max(latest, default=0)) > _TOLD_LATE_US
        self._expect()
        if told.can_hover and not could_hover:
            hover.take_over(forward)

    def _expect(self) -> None:
        told = self._told
        forward, hover = told.predicted(), told.predicted_view()
        may_hold = tuple(dict.fromkeys((forward, NOTHING)))
        self._views[FORWARD].expect(may_hold, told.open_causes(), told.changeable_causes())
        self._views[HOVER].expect(tuple(dict.fromkeys((hover, forward, NOTHING))), told.open_view)

    def _take(
        self, euler: AttitudeSamples, quaternion: AttitudeSamples, untold: npt.NDArray[np.uint8]
    ) -> Iterator[tuple[Int64s, Floats, npt.NDArray[np.uint8], Correction]]:
        """Take samples among which nothing was told; yield rows that are corrected, q_nb, causes and correction.

        `untold` (n,), of the Euler samples, is filled. What is no news passes at once; around what is, a closer look is
        taken.
        """
        n, done, more = (len(euler), len(quaternion)), (0, 0), _CLOSELY
        while done != n:
            upto = self._pass_quietly(euler, quaternion, done)
            more = 2 * more if upto == done else _CLOSELY
            if upto[0] > done[0]:
                forward, rows = self._views[FORWARD], slice(done[0], upto[0])
                untold[rows] = forward.bits
                if forward.correction != NOTHING:
                    yield from self._undo(one_view(euler[rows]), done[0])
            if upto == n:
                return
            done, upto = upto, _some(euler, quaternion, upto, more)
            parts = euler[done[0] : upto[0]], quaternion[done[1] : upto[1]]
            felt = self._feel_tail(*parts)
            if felt is not None:  # look at what came up to there first
                upto = done[0] + felt + 1, done[1]
                parts = parts[0][: felt + 1], parts[1][:0]
            for at, q_nb, causes, correction in self._look_at(*parts, untold[done[0] : upto[0]]):
                yield done[0] + at, q_nb, causes, correction
            if felt is not None:
                self._told.sits_on_tail = True
                self._expect()
            done = upto

    def _feel_tail(self, euler: AttitudeSamples, quaternion: AttitudeSamples) -> int | None:
        """The row of the Euler samples with which a plane that hovers is felt to be a tailsitter, if any is.

        Nothing told whether it is one, and no quaternion tells its view.
        """
        told = self._told
        if not told.may_sit_on_tail or len(self._latest.quaternion) or not len(euler) or not len(self._forces):
            return None
        forward = self._views[FORWARD].correction
        return self._seat.feel(euler, quaternion, self._forces, forward, hovers=told.view != FORWARD)

    def _pass_quietly(
        self, euler: AttitudeSamples, quaternion: AttitudeSamples, done: tuple[int, int]
    ) -> tuple[int, int]:
        """Take samples from `done` on up to the first that may be news; return up to which."""
        forward, hover = self._views
        expectation = None if self._told.can_hover or hover.fitted else forward.expectation()
        if expectation is None:
            return done
        e, q = self._latest.pass_quietly(euler, quaternion, done, forward, expectation)
        if e > done[0]:
            self._done = max(self._done, int(euler.frame_index[e - 1]))
            self._shown.follow(FORWARD, -1)
        if q > done[1]:
            self._done = max(self._done, int(quaternion.frame_index[q - 1]))
        return e, q

    def _look_at(
        self, euler: AttitudeSamples, quaternion: AttitudeSamples, untold: npt.NDArray[np.uint8]
    ) -> Iterator[tuple[Int64s, Floats, npt.NDArray[np.uint8], Correction]]:
        """As `_take`, sample by sample as far as it matters."""
        self._latest.unload(self._views[FORWARD])
        assert euler.rpy_rad is not None
        good = in_order(quaternion, self._latest.quaternion)
        more = QuaternionRows(
            frame_index=quaternion.frame_index,
            t_us=quaternion.t_boot_us,
            q_nb=quaternion.q_nb,
            w_b_rad_s=quaternion.w_nb_b_rad_s,
        )
        quaternions = self._latest.quaternion.then(more[good])
        good = in_order(euler, self._latest.euler)
        start, end = 0, len(euler)
        while True:
            rest = slice(start, end)
            view, free, astray_since_us = self._shown.choose(
                euler[rest], quaternions, self._forces, self._told, self._views
            )
            new = EulerRows(
                frame_index=euler.frame_index[rest],
                t_us=euler.t_boot_us[rest],
                rpy_rad=euler.rpy_rad[rest],
                w_b_rad_s=euler.w_nb_b_rad_s[rest],
                view=view,
                free=free,
            )
            eulers = self._latest.euler.then(new[good[rest]])
            pairs, views = match(eulers, quaternions, self._done)
            parts = [pairs[views == view] for view in (FORWARD, HOVER)] if views.any() else [pairs, NO_CLEAN_PAIRS]
            steps = self._scan(parts)
            frame_indices = [int(part.frame_index[step.at]) for part, step in zip(parts, steps, strict=True) if step]
            frame_index = min(frame_indices, default=None)
            forward, hover = self._views
            bits = forward.bits, hover.bits & ~UNSURE | forward.bits & UNSURE
            between = self._scan_between(eulers, quaternions, parts, frame_index)
            if between is not None:
                frame_index = between.frame_index
            count = (
                end - start if frame_index is None else int(np.searchsorted(new.frame_index, frame_index, side="right"))
            )
            untold[start : start + count] = np.where(view[:count] == FORWARD, *bits)
            yield from self._undo(new[:count], start)
            self._keep(parts, steps, frame_index)
            if between is not None:
                step, of = between.step, between.view
                self._forget(of, step.gives_up, of.keep_between(step, between.t_us))
            if frame_index is not None:
                self._note_found(frame_index)
            if count:
                self._shown.follow(int(view[count - 1]), int(astray_since_us[count - 1]))
                self._latest.euler = self._latest.euler.then(new[:count][good[start : start + count]])
            if frame_index is None:
                break
            self._done, start = frame_index, start + count
        self._done = max([self._done, *(int(of[-1]) for of in (euler.frame_index, quaternion.frame_index) if len(of))])
        self._latest.euler, self._latest.quaternion = self._latest.euler[-TAIL:], quaternions[-TAIL:]

    def _note_found(self, frame_index: int) -> None:
        """With a frame a trim may have been fitted."""
        found = sum(view.found for view in self._views)
        if found != self._found:
            self._found = found
            self._found_at.append(frame_index)

    def _scan(self, parts: list[CleanPairs]) -> list[CorrectionChange | None]:
        """The first change that the pairs of each view make in it."""
        return [
            view.scan(part, self._told, rival)
            for view, part, rival in zip(self._views, parts, self._rivals(), strict=True)
        ]

    def _rivals(self) -> tuple[Correction | None, None]:
        """For each view, a fitted correction of the other that is none if it holds in this one as well."""
        hover = self._views[HOVER]
        return (hover.correction if hover.fitted and not hover.switched else None, None)

    def _scan_between(
        self,
        euler: EulerRows,
        quaternion: QuaternionRows,
        parts: list[CleanPairs],
        until: int | None,
    ) -> _StepBetween | None:
        """Take pairs of neighbouring instants up to the first that makes a change, before the frame `until`."""
        exact = tuple(view.recent.then(part) for view, part in zip(self._views, parts, strict=True))
        pairs, views = pairs_between(euler, quaternion, self._done, exact)
        if until is not None:
            upto = int(np.searchsorted(pairs.frame_index, until))
            pairs, views = pairs[:upto], views[:upto]
        bounds = [0, *(np.flatnonzero(np.diff(views)) + 1).tolist(), len(pairs)]
        for first, end in pairwise(bounds):
            if first == end:
                continue
            index, part = int(views[first]), pairs[first:end]
            view = self._views[index]
            step = scan_between(view, part, self._told, self._rivals()[index])
            if step is not None:
                return _StepBetween(int(part.frame_index[step.at]), int(part.t_us[step.at]), view, step)
        return None

    def _keep(self, parts: list[CleanPairs], steps: list[CorrectionChange | None], frame_index: int | None) -> None:
        """Remember the pairs up to the frame `frame_index`, and the step that one of the views made there."""
        for view, part, step in zip(self._views, parts, steps, strict=True):
            made = step if step is not None and part.frame_index[step.at] == frame_index else None
            upto = (
                len(part) if frame_index is None else int(np.searchsorted(part.frame_index, frame_index, side="right"))
            )
            self._forget(view, 0 if made is None else made.gives_up, view.keep(part[:upto], made))

    def _forget(self, view: View, given_up: int, dropped: Correction) -> None:
        """A view gave up causes that were fitted, or dropped a correction that no pairs ever confirmed."""
        self._explanations.forget(view, given_up, dropped)
        if given_up & VTOL_VIEW:
            self._told.view_refuted = True
            self._expect()
        forward, hover = self._views
        if hover.fitted and forward.settled and forward.correction != hover.correction:
            hover.switched = True

    def _undo(self, euler: EulerRows, start: int) -> Iterator[tuple[Int64s, Floats, npt.NDArray[np.uint8], Correction]]:
        """Correct samples by the view that each one shows; yield as `_take` does, rows counted from `start`."""
        for index, view in enumerate(self._views):
            rows = np.flatnonzero(euler.view == index)
            correction = view.correction
            if correction == NOTHING or not len(rows):
                continue
            rpy_rad = euler.rpy_rad[rows]
            q_nb = correction.undo(rpy_rad)
            causes = np.zeros(len(rows), np.uint8)
            for cause, values_rad in correction.values().items():
                without = correction.without(cause).undo(rpy_rad)
                turned = attitude.angle_between(without, q_nb) > EFFECT_RAD
                causes[turned] |= cause
                if turned.any():
                    fitted = bool(view.fitted & cause) or (cause == VTOL_VIEW and self._told.sits_on_tail)
                    self._explanations.explain(cause, values_rad, view, fitted=fitted)
            yield start + rows, q_nb, causes, correction


_CLOSELY = 64  # samples that are looked at before what follows may pass at once again


def _some(euler: AttitudeSamples, quaternion: AttitudeSamples, done: tuple[int, int], more: int) -> tuple[int, int]:
    """Up to which sample of each stream the next messages reach, with `more` samples of ATTITUDE."""
    e = min(done[0] + more, len(euler))
    if e == done[0]:
        return e, min(done[1] + more, len(quaternion))
    if e == len(euler):
        return e, len(quaternion)
    return e, max(int(np.searchsorted(quaternion.frame_index, euler.frame_index[e - 1], side="right")), done[1])
