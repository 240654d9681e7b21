"""How the two attitudes of a vehicle lie apart: ghost, axis and arc; once diagnosed, the triad without the mistake.

All follows from what was judged, frame by frame, and so does not depend on how the input was cut.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import rerun as rr

from gcs_bridge import attitude
from gcs_bridge.causes import CAUSES
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.checks.protocol import in_order
from gcs_bridge.desk import axis_of
from gcs_bridge.diagnosis.hypotheses import Hypothesis
from gcs_bridge.diagnosis.words import amount
from gcs_bridge.events import Event
from gcs_bridge.judge import Observation
from gcs_bridge.samples import AttitudeSamples
from gcs_bridge.viewer.rows import Moment, Rows, Times
from gcs_bridge.viewer.scene import ARC_M, AXIS_M, Key, Part, corrected_parts, ghost_parts, path_of

__all__ = ["Apart", "Shown", "undoing"]

Floats = npt.NDArray[np.float64]
Int64s = npt.NDArray[np.int64]

_ARC_POINTS = 17
_NEAR_AXIS = math.cos(math.radians(30.0))  # the nose this near to the axis draws no arc to be seen: the right wing does
_NORM = "quaternion_unnormalised"  # turns nothing


class Shown(NamedTuple):
    """From a moment on, other parts are shown."""

    moment: Moment
    parts: list[Part]


class Undoing(NamedTuple):
    """The mistake that a diagnosis names, and what to call it."""

    mistake: Hypothesis
    name: str


def undoing(diagnosis: Mapping[str, Any]) -> Undoing | None:
    """What undoes the mistake that a report's diagnosis names; None: nothing does, or what it says is too little."""
    rows = [CAUSES.get(name) for name in diagnosis["causes"] if name != _NORM]
    causes = [row for row in rows if row is not None and row.undo is not None]
    valued = [row for row in causes if row.parameter.count]
    if not causes or len(causes) < len(rows) or len(valued) > 1:  # a diagnosis tells the value of one cause alone
        return None
    told = diagnosis["value"]
    value = tuple(told) if isinstance(told, list) else () if told is None else (told,)
    words = [f"{row.name} {amount(row, value)}" if row in valued else row.name for row in causes]
    ties = diagnosis["candidates"][1:]
    mistake = Hypothesis(tuple((row.name, value if row in valued else ()) for row in causes))
    return Undoing(mistake, " or ".join(["+".join(words), *ties]))


class Apart:
    """Follows the disagreement of one vehicle, and makes rows and parts of it."""

    def __init__(self, key: Key) -> None:
        """Start with nothing to be seen."""
        self._path = path_of(key, "body", "apart")
        self._boot: int | None = None
        self._forget()

    def _forget(self) -> None:
        self._latest_us = -1
        self._is_open = False  # the ghost is shown
        self._undoings: dict[str, Undoing | None] = {}  # of the alarms that stand, by id
        self._undoing: Undoing | None = None

    def feed(self, observation: Observation) -> Iterator[Rows | Shown]:
        """What a batch adds."""
        segment = observation.segment
        if segment.boot != self._boot:
            if self._boot is not None and len(segment.t_boot_us):
                yield from self.end(Moment(segment.boot, int(segment.t_boot_us[0]), int(segment.t_rx_us[0])))
            self._boot = segment.boot
            self._forget()
        if len(observation.pairs):
            yield from self._open(observation)
        if self._undoing is not None or observation.notices:
            yield from self._correct(observation)

    def end(self, moment: Moment) -> Iterator[Shown]:
        """Nothing is compared any more: what was shown goes."""
        if self._is_open or self._undoing is not None:
            yield Shown(moment, [(self._path, rr.Clear(recursive=True))])
        self._is_open, self._undoing = False, None

    def cleared(self, alarm_id: str, moment: Moment) -> Iterator[Shown]:
        """An alarm went, if it is not known yet: with a boot, or by time alone."""
        if self._undoings.pop(alarm_id, None) is not None:
            yield from self._changed(moment)

    def _open(self, observation: Observation) -> Iterator[Rows | Shown]:
        """Ghost, axis and arc, while the pairs are apart by more than their limit."""
        pairs, found = observation.pairs, observation.disagreement
        known = in_order(pairs.t_boot_us, self._latest_us)
        if not len(known):
            return
        self._latest_us = int(pairs.t_boot_us[known[-1]])
        apart = (found.judged & (found.angle > found.limit))[known]
        if not (apart.any() or self._is_open):
            return
        times = observation.pair_times()
        before = np.concatenate(([self._is_open], apart[:-1]))
        self._is_open = bool(apart[-1])
        for change in np.flatnonzero(apart != before).tolist():
            parts: list[Part] = [(self._path, rr.Clear(recursive=True))]
            shown = [*ghost_parts(self._path), *self._corrected_parts()] if apart[change] else parts
            yield Shown(times.moment(int(known[change])), shown)
        rows = known[apart]
        if len(rows):
            yield self._rows(times[rows], pairs.q_euler[rows], found, rows)
