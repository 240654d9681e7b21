"""The expected differences of one vehicle, followed through its batches and boots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, last_where, record
from gcs_bridge.contract import ExplainedBy
from gcs_bridge.expected.between import BETWEEN_NOISE_RAD, BETWEEN_NOISE_VIEW_RAD, pairs_between
from gcs_bridge.expected.between_view import scan_between
from gcs_bridge.expected.correction import (
    AHRS_TRIM,
    CAUSE_NAMES,
    NOTHING,
    PITCH_TRIM,
    TRIM_FITTED,
    UNSURE,
    VTOL_VIEW,
    Correction,
    CorrectionChange,
)
from gcs_bridge.expected.felt import NO_FORCES, down_felt, forces_of
from gcs_bridge.expected.knowledge import FORWARD, HOVER, TAILSITTER_RAD, FirmwareConfig
from gcs_bridge.expected.pairs import (
    IN_A_ROW,
    NO_CLEAN_PAIRS,
    NO_EULER,
    NO_QUATERNION,
    NOISE_RAD,
    TAIL,
    VIEW_NOISE_RAD,
    CleanPairs,
    EulerRows,
    QuaternionRows,
    in_order,
    match,
    run_lengths,
)
from gcs_bridge.expected.quiet import (
    Samples,
    Tails,
    between_rows,
    euler_rows,
    fill_tails,
    new_tails,
    pair_rows,
    pass_quietly,
    quaternion_rows,
)
from gcs_bridge.expected.view import View
from gcs_bridge.telemetry.samples import AttitudeSamples, ImuSamples
from gcs_bridge.telemetry.statements import ModeSet, ParameterSet

_EFFECT_RAD = math.radians(0.02)  # what the bound of a same-instant pair swallows needs no explanation
_CHANGE_RAD = math.radians(0.5)  # across a change by more there is no step of the vehicle
_SAME_VALUE_RAD = math.radians(0.3)  # a fit that moves by less was refined
_MODE_LAG_US = 10_000_000  # a tailsitter changes its view when it has turned, seconds after the mode; 3.5 s were seen
_AHEAD_US = 1_000_000  # heartbeats come once a second: the view may change before the mode is told
_QUATERNION_AGE_S = 1.0
_VIEW_MATCH_RAD = math.radians(2.0)  # the latest quaternion, brought to the sample's time by its rates, may be off by
_FELT_RAD = math.radians(30.0)  # without a quaternion the accelerometer tells, which is off by so much in flight,
_FELT_APART = 2.0 * math.sin(math.radians(60.0) / 2.0)  # between views whose downs are this far from each other
_VIEW_MATCH_SHARE = 0.25  # so much, or by this share of what is between the views


@record
class Corrected(FrameColumns):
    """n Euler samples with the expected differences undone.

    `q_nb` (n, 4) [w, x, y, z], FRD to NED; `causes` (n,) bits PITCH_TRIM, AHRS_TRIM, VTOL_VIEW of what turned a sample
    by more than 0.02°; `open` (n,) bits of what may be in it, was not told and not fitted yet, UNSURE where that takes
    time, and TRIM_FITTED; `applied` (n,) which of the `corrections` was undone, the first of which is none.
    """

    q_nb: Floats
    causes: npt.NDArray[np.uint8]
    open: npt.NDArray[np.uint8]
    applied: Int64s
    corrections: tuple[Correction, ...]
    changes: Int64s | None = None

    def undo(self, rpy_rad: Floats, rows: Int64s) -> Floats:
        """What was undone at `rows` (n,) of the batch, undone in other angles (n, 3): q_nb (n, 4)."""
        q_nb = NOTHING.undo(rpy_rad)
        applied = self.applied[rows]
        for index in np.unique(applied[applied > 0]).tolist():
            mine = applied == index
            q_nb[mine] = self.corrections[index].undo(rpy_rad[mine])
        return q_nb

    @property
    def undoes(self) -> bool:
        """Whether anything was undone."""
        return len(self.corrections) > 1

    def may_be_trim_from(self, before: float) -> tuple[Int64s, Floats]:
        """Frames (k,) from which on AHRS_TRIM may still be found in what differs, 1, or may not, 0, unlike before."""
        may_be = ((self.open & UNSURE) != 0).astype(np.float64)
        changes = np.flatnonzero(np.diff(may_be, prepend=before))
        return self.frame_index[changes], may_be[changes]

    @property
    def untold(self) -> npt.NDArray[np.uint8]:
        """Bits (n,) PITCH_TRIM, AHRS_TRIM, VTOL_VIEW of what may be in a sample, was not told and not fitted yet."""
        return self.open & np.uint8(PITCH_TRIM | AHRS_TRIM | VTOL_VIEW)

    @property
    def trim_fitted(self) -> Mask:
        """Whether AHRS_TRIM was fitted (n,), and is known as well as if it had been told."""
        return np.asarray((self.open & TRIM_FITTED) != 0)

    @property
    def trim_b_rad(self) -> Floats:
        """AHRS_TRIM as it was undone in each of the samples: the turn (n, 3) from the body's axes to the IMU's."""
        return np.array([(one.trim_x_rad, one.trim_y_rad, 0.0) for one in self.corrections])[self.applied]


class _StepBetween(NamedTuple):
    """What a pair of neighbouring instants, completed by a frame, makes of a view."""

    frame_index: int
    t_us: int
    view: View
    step: CorrectionChange


@dataclass
class _Explanation:
    """A cause with its numbers, in the view in which it turned samples."""

    cause: int
    values_rad: tuple[float, ...]
    fitted: bool
    view: View
    fit: int  # of the view


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
        self._explanations: list[_Explanation] = []
        self._euler, self._quaternion = NO_EULER, NO_QUATERNION  # the latest in order, within this boot
        self._forces = NO_FORCES  # the latest, of what may be a plane
        self._on_tail = 0  # samples in a row in which one that hovers is felt to sit on its tail
        self._on_wings = False  # it was felt to be as ATTITUDE says in forward flight
        self._tails: Tails | None = None  # for the latest, and the pairs of the view: made when some come
        self._tails_hold = False  # whether they are there
        self._applied, self._changed = NOTHING, 0  # to the last sample, and how often that has changed
        self._done = -1  # frame_index up to which pairs were taken
        self._mode_since_us: int | None = None  # None: counted from the next sample
        self._shown: int | None = None  # the view of the latest sample, None: that of the mode
        self._astray_since_us = -1  # since when it is not that of the mode, −1 if it is

    def start_boot(self) -> None:
        """Forget what counts within one boot alone. Parameters, modes and what was fitted outlive it."""
        self._euler, self._quaternion, self._forces = NO_EULER, NO_QUATERNION, NO_FORCES
        self._tails_hold = False
        self._mode_since_us, self._shown, self._astray_since_us = None, None, -1
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
        return any(one.cause == VTOL_VIEW for one in self._explanations)

    def explanations(self) -> list[ExplainedBy]:
        """The report's `explained_by`: what turned samples by more than 0.02°, in order of time."""
        return [self._entry(one) for one in self._explanations]

    def _learn(self, what: ParameterSet | ModeSet) -> None:
        self._unload_tails()
        told, (forward, hover) = self._told, self._views
        before, could_hover, flew_forward = (told.view, told.autopilot), told.can_hover, told.custom_mode >= 0
        told.take(what)
        if (told.view, told.autopilot) != before:
            latest = [int(of.t_us[-1]) for of in (self._euler, self._quaternion) if len(of)]
            self._mode_since_us, self._astray_since_us = max(latest, default=None), -1
        if told.can_hover and not could_hover:
            self._shown = None
            told.view_refuted |= flew_forward and forward.denied  # what was there before comes from no VTOL mode
        self._expect()
        if told.can_hover and not could_hover:
            hover.take_over(forward)

    def _expect(self) -> None:
        told = self._told
        forward, hover = told.predicted(), told.predicted_view()
        self._views[FORWARD].expect(tuple(dict.fromkeys((forward, NOTHING))), told.open_causes())
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
                    yield from self._undo(_one_view(euler[rows]), done[0])
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
        if not self._told.may_sit_on_tail or len(self._quaternion) or not len(euler) or not len(self._forces):
            return None
        assert euler.rpy_rad is not None
        end = int(np.searchsorted(euler.frame_index, quaternion.frame_index[0])) if len(quaternion) else len(euler)
        rpy_rad = euler.rpy_rad[:end]
        felt = down_felt(self._forces, euler.frame_index[:end], euler.t_boot_us[:end])
        forward = self._views[FORWARD].correction
        on_wings, on_tail = (
            _norm(attitude.body_down(one.undo(rpy_rad)) - felt)
            for one in (forward, Correction(view_rad=TAILSITTER_RAD))
        )
        if self._told.view == FORWARD:
            self._on_wings |= bool(((on_wings <= _FELT_RAD) & (3.0 * on_wings < on_tail)).any())
            self._on_tail = 0
            return None
        is_on_tail = (on_tail <= _FELT_RAD) & (3.0 * on_tail < on_wings)
        in_a_row = run_lengths(is_on_tail, self._on_tail)
        enough = in_a_row >= IN_A_ROW
        if enough.any():
            return int(enough.argmax())
        self._on_tail = int(in_a_row[-1]) if end else self._on_tail
        return None

    def _pass_quietly(
        self, euler: AttitudeSamples, quaternion: AttitudeSamples, done: tuple[int, int]
    ) -> tuple[int, int]:
        """Take samples from `done` on up to the first that may be news; return up to which."""
        forward, hover = self._views
        expectation = None if self._told.can_hover or hover.fitted else forward.expectation()
        if expectation is None or (self._tails is None and len(self._euler) + len(self._quaternion) < _FEW):
            return done
        tails = self._tails = self._tails or new_tails()
        if not self._tails_hold:
            of = forward.between
            fill_tails(tails, self._euler, self._quaternion, (forward.recent, forward.sparse), (of.recent, of.sparse))
            self._tails_hold = True
        passed = np.array(done)
        pass_quietly(_euler_of(euler), _quaternion_of(quaternion), expectation, tails, forward.learnt, passed)
        e, q = passed.tolist()
        if e > done[0]:
            self._done = max(self._done, int(euler.frame_index[e - 1]))
            self._shown, self._astray_since_us = FORWARD, -1
        if q > done[1]:
            self._done = max(self._done, int(quaternion.frame_index[q - 1]))
        return e, q

    def _unload_tails(self) -> None:
        """Have the latest samples, and the pairs of the view, where a closer look wants them."""
        tails = self._tails
        if self._tails_hold and tails is not None:
            forward = self._views[FORWARD]
            self._euler, self._quaternion = euler_rows(tails.euler), quaternion_rows(tails.quaternion)
            forward.recent, forward.sparse = pair_rows(tails.recent), pair_rows(tails.sparse)
            between = forward.between
            between.recent, between.sparse = between_rows(tails.between), between_rows(tails.sparse_between)
            self._tails_hold = False

    def _look_at(
        self, euler: AttitudeSamples, quaternion: AttitudeSamples, untold: npt.NDArray[np.uint8]
    ) -> Iterator[tuple[Int64s, Floats, npt.NDArray[np.uint8], Correction]]:
        """As `_take`, sample by sample as far as it matters."""
        self._unload_tails()
        assert euler.rpy_rad is not None
        good = in_order(quaternion, self._quaternion)
        more = QuaternionRows(
            frame_index=quaternion.frame_index,
            t_us=quaternion.t_boot_us,
            q_nb=quaternion.q_nb,
            w_b_rad_s=quaternion.w_nb_b_rad_s,
        )
        quaternions = self._quaternion.then(more[good])
        good = in_order(euler, self._euler)
        start, end = 0, len(euler)
        while True:
            rest = slice(start, end)
            view, free, astray_since_us = self._choose(euler[rest], euler.rpy_rad[rest], quaternions)
            new = EulerRows(
                frame_index=euler.frame_index[rest],
                t_us=euler.t_boot_us[rest],
                rpy_rad=euler.rpy_rad[rest],
                w_b_rad_s=euler.w_nb_b_rad_s[rest],
                view=view,
                free=free,
            )
            eulers = self._euler.then(new[good[rest]])
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
            if count:
                self._shown, self._astray_since_us = int(view[count - 1]), int(astray_since_us[count - 1])
                self._euler = self._euler.then(new[:count][good[start : start + count]])
            if frame_index is None:
                break
            self._done, start = frame_index, start + count
        self._done = max([self._done, *(int(of[-1]) for of in (euler.frame_index, quaternion.frame_index) if len(of))])
        self._euler, self._quaternion = self._euler[-TAIL:], quaternions[-TAIL:]

    def _choose(
        self, euler: AttitudeSamples, rpy_rad: Floats, quaternions: QuaternionRows
    ) -> tuple[npt.NDArray[np.int8], Mask, Int64s]:
        """The view that each of n Euler samples shows, whether it may change there, since when it is not the mode's.

        The mode says which view it is. Around a change of mode the latest quaternion says it, brought to the sample's
        time by the body rates of both (which are the body's in every view). Only the down vectors are compared: yaw,
        and its resets, have no part in it.
        """
        t_us, n = euler.t_boot_us, len(euler)
        mode_view, hover = self._told.view, self._views[HOVER]
        usual = FORWARD if mode_view is None else mode_view
        view = np.full(n, usual, np.int8)
        free, astray_since_us = np.zeros(n, np.bool_), np.full(n, -1)
        if not self._told.can_hover or not n:
            return view, free, astray_since_us
        if self._mode_since_us is None:
            self._mode_since_us = int(t_us[0])
        free[:] = True if mode_view is None else t_us - self._mode_since_us <= _MODE_LAG_US
        unknown = self._told.open_view and not hover.fitted
        if (unknown and len(quaternions)) or hover.correction == self._views[FORWARD].correction:
            return view, free, astray_since_us
        downs = [attitude.body_down(one.correction.undo(rpy_rad)) for one in self._views]
        is_usual, astray = self._seen_as(usual, euler, downs, quaternions)
        decided = last_where(is_usual | astray)
        undecided = usual if self._shown is None else self._shown
        shown = np.where(decided >= 0, np.where(astray[decided], 1 - usual, usual), undecided)
        before = np.concatenate(([self._astray_since_us >= 0], astray[:-1]))
        begins = last_where(astray & ~before)
        astray_since_us = np.where(begins >= 0, t_us[begins], self._astray_since_us)
        astray_since_us[~astray] = -1
        ahead = astray & (t_us - astray_since_us <= _AHEAD_US)
        view[:] = np.where(free | ahead, shown, usual)
        return view, free, astray_since_us

    def _seen_as(
        self, usual: int, euler: AttitudeSamples, downs: list[Floats], quaternions: QuaternionRows
    ) -> tuple[Mask, Mask]:
        """Which Euler samples (n,) are seen to show the usual view, and which the other; `downs` (n, 3) of each view.

        By the latest quaternion; where there is none, by the accelerometer, if the views are so far from each other.
        """
        t_us, n = euler.t_boot_us, len(euler)
        down, off_most = np.full((n, 3), np.nan), np.full(n, _VIEW_MATCH_RAD)
        apart = _norm(downs[0] - downs[1])
        if len(quaternions):
            latest = np.searchsorted(quaternions.frame_index, euler.frame_index) - 1
            since_s = (t_us - quaternions.t_us[latest]) * 1e-6
            turn = 0.5 * (quaternions.w_b_rad_s[latest] + euler.w_nb_b_rad_s) * since_s[:, None]
            q_now = attitude.multiply(quaternions.q_nb[latest], attitude.quaternion_from_rotvec(turn))
            known = (latest >= 0) & (np.abs(since_s) <= _QUATERNION_AGE_S)
            down[known] = attitude.body_down(q_now)[known]
            off_most = np.maximum(_VIEW_MATCH_RAD, _VIEW_MATCH_SHARE * apart)
        unknown = np.isnan(down[:, 0]) & (apart >= _FELT_APART)
        if unknown.any() and len(self._forces):
            down[unknown] = down_felt(self._forces, euler.frame_index[unknown], t_us[unknown])
            off_most[unknown] = _FELT_RAD
        off = [_norm(one - down) for one in downs]
        known = np.minimum(*off) <= off_most
        is_usual, astray = (known & (3.0 * off[one] < off[1 - one]) for one in (usual, 1 - usual))
        return is_usual, astray

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
        values = dropped.values()
        self._explanations = [
            one
            for one in self._explanations
            if not (one.fitted and one.cause & given_up)
            and not (one.view is view and values.get(one.cause) == one.values_rad)
        ]
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
                turned = attitude.angle_between(without, q_nb) > _EFFECT_RAD
                causes[turned] |= cause
                if turned.any():
                    self._explain(cause, values_rad, view)
            yield start + rows, q_nb, causes, correction

    def _explain(self, cause: int, values_rad: tuple[float, ...], view: View) -> None:
        fitted = bool(view.fitted & cause) or (cause == VTOL_VIEW and self._told.sits_on_tail)
        new = _Explanation(cause, values_rad, fitted, view, view.fit)
        latest = max((at for at, one in enumerate(self._explanations) if one.cause == cause), default=None)
        if latest is not None:
            before = self._explanations[latest]
            moved = max(abs(a - b) for a, b in zip(before.values_rad, values_rad, strict=True))
            refined = before.view is view and before.fit == view.fit and before.fitted
            if moved == 0.0 or refined or (before.fitted and moved <= _SAME_VALUE_RAD):  # the same, better known
                self._explanations[latest] = new
                return
        self._explanations.append(new)

    def _entry(self, one: _Explanation) -> ExplainedBy:
        values_deg = tuple(round(float(math.degrees(value)), 4) for value in one.values_rad)
        alternatives: list[str] = []
        if one.fitted and one.view.correction.values().get(one.cause) == one.values_rad:
            alternatives = one.view.alternatives()
            if one.cause == VTOL_VIEW and not one.view.fitted:  # felt
                alternatives = [] if self._on_wings else ["mount_offset"]
        return ExplainedBy(
            cause=CAUSE_NAMES[one.cause],
            value=values_deg if len(values_deg) > 1 else values_deg[0],
            unit="deg",
            estimated=one.fitted,
            alternatives=tuple(alternatives),
        )


_FEW = 16  # samples: many a component sends no more, and the tails would take 40 kB of each
_CLOSELY = 64  # samples that are looked at before what follows may pass at once again


def _some(euler: AttitudeSamples, quaternion: AttitudeSamples, done: tuple[int, int], more: int) -> tuple[int, int]:
    """Up to which sample of each stream the next messages reach, with `more` samples of ATTITUDE."""
    e = min(done[0] + more, len(euler))
    if e == done[0]:
        return e, min(done[1] + more, len(quaternion))
    if e == len(euler):
        return e, len(quaternion)
    return e, max(int(np.searchsorted(quaternion.frame_index, euler.frame_index[e - 1], side="right")), done[1])


def _one_view(euler: AttitudeSamples) -> EulerRows:
    """Samples of a vehicle with one view."""
    assert euler.rpy_rad is not None
    n = len(euler)
    return EulerRows(
        frame_index=euler.frame_index,
        t_us=euler.t_boot_us,
        rpy_rad=euler.rpy_rad,
        w_b_rad_s=euler.w_nb_b_rad_s,
        view=np.zeros(n, np.int8),
        free=np.zeros(n, np.bool_),
    )


def _euler_of(euler: AttitudeSamples) -> Samples:
    assert euler.rpy_rad is not None
    return Samples(euler.frame_index, euler.t_boot_us, euler.rpy_rad, euler.w_nb_b_rad_s, euler.valid)


def _quaternion_of(quaternion: AttitudeSamples) -> Samples:
    return Samples(
        quaternion.frame_index, quaternion.t_boot_us, quaternion.q_nb, quaternion.w_nb_b_rad_s, quaternion.valid
    )


def _norm(v: Floats) -> Floats:
    return np.sqrt(v[:, 0] ** 2 + v[:, 1] ** 2 + v[:, 2] ** 2)
