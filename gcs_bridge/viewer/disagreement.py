"""How the two attitudes of a vehicle lie apart: ghost, axis and arc; once diagnosed, the triad without the mistake.

All follows from what was judged, frame by frame, and so does not depend on how the input was cut.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import rerun as rr

from gcs_bridge import attitude
from gcs_bridge.alarms.record import axis_of
from gcs_bridge.checks.disagreement import Disagreement
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.columns import Floats, any_true
from gcs_bridge.contract import Diagnosis
from gcs_bridge.diagnosis.hypotheses import ROWS, TRIMS, Hypothesis
from gcs_bridge.diagnosis.wording import amount
from gcs_bridge.events import AlarmCleared, AlarmEvent, DiagnosisMade
from gcs_bridge.judging.observation import Observation
from gcs_bridge.pairing.neighbours import in_order
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.rows import Rows, Shown
from gcs_bridge.viewer.scene import ARC_M, AXIS_M, Part, corrected_parts, ghost_parts, path_of
from gcs_bridge.viewer.times import Instant, Times, instant_of, pair_times

__all__ = ["Apart", "undoing"]
_ARC_POINTS = 17
_NEAR_AXIS = math.cos(math.radians(30.0))  # the nose this near to the axis draws no arc to be seen: the right wing does
_SILENT_US = 1_000_000  # so long without a pair, a stream may have been found silent; it takes longer than this
_EVER = np.iinfo(np.int64).max
_NORM = "quaternion_unnormalised"  # turns nothing


class Undoing(NamedTuple):
    """The mistake that a diagnosis names, and what to call it."""

    mistake: Hypothesis
    name: str


def undoing(diagnosis: Diagnosis) -> Undoing | None:
    """What undoes the mistake that a report's diagnosis names; None: nothing does, or what it says is too little."""
    rows = [ROWS.get(name) for name in diagnosis.causes if name != _NORM]
    mistakes = [row for row in rows if row not in TRIMS.values()]
    if mistakes and not any(row is not None and row.acts_on == "rpy" for row in mistakes):
        rows = mistakes  # a trim of the angles has no part in what is wrong with the quaternion
    causes = [row for row in rows if row is not None and row.undo is not None and row.acts_on != "rates"]
    valued = [row for row in causes if row.parameter.count]
    if not causes or len(causes) < len(rows) or len(valued) > 1:  # a diagnosis tells the value of one cause alone
        return None
    told = diagnosis.value
    value = told if isinstance(told, tuple) else () if told is None else (told,)
    words = [f"{row.name} {amount(row, value)}" if row in valued else row.name for row in causes]
    ties = diagnosis.candidates[1:]
    mistake = Hypothesis(tuple((row.name, value if row in valued else ()) for row in causes))
    return Undoing(mistake, " or ".join(["+".join(words), *ties]))


class Apart:
    """Follows the disagreement of one vehicle, and makes rows and parts of it."""

    def __init__(self, key: VehicleId) -> None:
        """Start with nothing to be seen."""
        self._key = key
        self._apart, self._corrected = path_of(key, "body", "apart"), path_of(key, "body", "corrected")
        self._boot: int | None = None
        self._was_open = False  # something was apart, ever
        self._start_boot()

    def _start_boot(self) -> None:
        self._latest_us = -1
        self._is_open = False  # the latest pair is apart
        self._undoings: dict[str, Undoing | None] = {}  # of the alarms that stand, by id

    @property
    def _undoing(self) -> Undoing | None:
        """Of the alarm that was diagnosed last."""
        return next(reversed(self._undoings.values()), None)

    def feed(self, observation: Observation) -> Iterator[Rows | Shown]:
        """What a batch adds."""
        segment = observation.segment
        if segment.boot != self._boot:
            if len(segment.t_boot_us):
                yield from self._leave_boot(Instant(segment.boot, int(segment.t_boot_us[0]), int(segment.t_rx_us[0])))
            self._boot = segment.boot
            self._start_boot()
        if len(observation.pairs):
            yield from self._open(observation)
        if self._undoing is not None or observation.notices:
            yield from self._correct(observation)

    def silent(self, moment: Instant) -> Iterator[Shown]:
        """Nothing is compared from now on until the next pair; it may have come already."""
        if self._was_open:
            yield Shown(moment, [_nothing(self._apart)])

    def told(self, event: DiagnosisMade | AlarmEvent) -> Iterator[Shown]:
        """A diagnosis, or an alarm that went, or is shelved: then nothing more is told of it, not even that it went."""
        before = self._undoing
        self._undoings.pop(event.id, None)
        if isinstance(event, DiagnosisMade):
            self._undoings[event.id] = undoing(event.diagnosis)
        after = self._undoing
        if after is not None and after != before:
            yield Shown(instant_of(event), list(corrected_parts(self._key, f"{after.name} undone")))
        elif after is None and before is not None:
            yield Shown(instant_of(event), [_nothing(self._corrected)])

    def _leave_boot(self, moment: Instant) -> Iterator[Shown]:
        yield from self.silent(moment)
        if self._undoing is not None:
            yield Shown(moment, [_nothing(self._corrected)])

    def _open(self, observation: Observation) -> Iterator[Rows | Shown]:
        """Ghost, axis and arc, where two attitudes of one instant are apart by more than their limit."""
        pairs, found = observation.pairs, observation.disagreement
        if not (self._is_open or any_true(found.judged & (found.angle > found.limit))):  # so with nearly all
            self._latest_us = max(self._latest_us, int(pairs.t_boot_us.max()))
            return
        known = in_order(pairs.t_boot_us, self._latest_us)
        if not len(known):
            return
        apart = (found.judged & (found.angle > found.limit))[known]
        t_boot_us, before_us = pairs.t_boot_us[known], self._latest_us
        was_open = np.concatenate(([self._is_open], apart[:-1]))
        self._latest_us, self._is_open = int(t_boot_us[-1]), bool(apart[-1])
        if not (apart.any() or was_open.any()):
            return
        times = pair_times(observation)
        silent = np.diff(t_boot_us, prepend=before_us) > _SILENT_US  # it may have been cleared
        for change in np.flatnonzero((apart != was_open) | (apart & silent)).tolist():
            parts = ghost_parts(self._apart) if apart[change] else [_nothing(self._apart)]
            yield Shown(times.moment(int(known[change])), list(parts))
        rows = known[apart]
        if len(rows):
            self._was_open = True
            yield self._rows(times[rows], pairs.q_euler[rows], found[rows])

    def _rows(self, times: Times, q_euler: Floats, found: Disagreement) -> Rows:
        parts = np.column_stack((found.tilt, found.heading, found.rotvec_body))
        labels = [f"{math.degrees(angle):.1f}° {axis_of(part)}" for angle, part in zip(found.angle, parts, strict=True)]
        return Rows(
            times,
            attitudes={f"{self._apart}/ghost": q_euler},
            arrows={f"{self._apart}/axis": AXIS_M * found.rotvec_world / found.angle[:, None]},
            strips={f"{self._apart}/arc": _arcs(q_euler, found.rotvec_body)},
            labels={f"{self._apart}/arc": np.array(labels)},
        )

    def _correct(self, observation: Observation) -> Iterator[Rows | Shown]:
        """The attitudes without the mistake, from the frame on that told it."""
        since = 0
        for frame_index, event, _ in observation.notices:
            if event.check == EulerQuaternion.name and isinstance(event, DiagnosisMade | AlarmCleared):
                yield from self._corrections(observation, since, frame_index)
                yield from self.told(event)
                since = frame_index
        yield from self._corrections(observation, since)

    def _corrections(self, observation: Observation, since: int, until: int = _EVER) -> Iterator[Rows]:
        if self._undoing is None:
            return
        mistake, segment = self._undoing.mistake, observation.segment
        samples = segment.euler if mistake.of("rpy") else segment.quaternion
        rows = np.flatnonzero(samples.valid & (samples.frame_index >= since) & (samples.frame_index < until))
        if not len(rows):
            return
        samples, t_ms = samples[rows], samples.t_boot_us[rows] / 1e3
        if samples.rpy_rad is not None:
            # Of mistakes on both sides: what the quaternion says if it is made from the right angles.
            q_nb = observation.corrected.undo(mistake.undone(samples.rpy_rad, "rpy"), rows)
            q_nb, t_ms = mistake.apply(q_nb, "quaternion"), mistake.apply(t_ms, "time")
        else:
            q_nb = mistake.undone(attitude.normalise(samples.q_nb), "quaternion")
            t_ms = mistake.undone(t_ms, "time")
        # A stamp that was late is put right on the boot clock; received it was when it was.
        t_boot_us = np.maximum(np.round(1e3 * t_ms).astype(np.int64), 0)
        yield Rows(
            Times(boot=segment.boot, t_boot_us=t_boot_us, t_rx_us=samples.t_rx_us),
            attitudes={self._corrected: q_nb},
        )


def _arcs(q_euler: Floats, rotvec_body: Floats) -> Floats:
    """From one nose to the other (n, points, 3), in NED: the way of the turn, on a cone about its axis.

    Of right wings, where the nose lies too near to the axis to go anywhere.
    """
    along_x = np.abs(rotvec_body[:, 0]) > _NEAR_AXIS * np.linalg.norm(rotvec_body, axis=1)
    arm = np.where(along_x[:, None], [0.0, ARC_M, 0.0], [ARC_M, 0.0, 0.0])
    way = np.linspace(0.0, 1.0, _ARC_POINTS)[:, None] * rotvec_body[:, None, :]
    turned = attitude.rotate(attitude.quaternion_from_rotvec(way), np.broadcast_to(arm[:, None], way.shape))
    return attitude.rotate(np.repeat(q_euler[:, None], _ARC_POINTS, axis=1), turned)


def _nothing(path: str) -> Part:
    return path, rr.Clear(recursive=True)
