"""Start-up: until the estimator first says that its attitude is ready, what contradicts that attitude is no fault.

Told by EKF_STATUS_REPORT, ESTIMATOR_STATUS and SYS_STATUS. It comes once a boot, and never in flight: what was ready,
or armed, or took that long, is judged whatever its estimator says of itself later.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gcs_bridge.telemetry.batches import BootSegment
from gcs_bridge.telemetry.statements import LandedSet, ModeSet, ReadySet, Statement

_LONGEST_US = 120_000_000  # an estimator that is not ready by then may never be: DCM alone reports no flags at all
_ESTIMATORS = ("EKF_STATUS_REPORT", "ESTIMATOR_STATUS")  # SYS_STATUS calls healthy what has not started yet


class StartUpChange(NamedTuple):
    """Start-up begins, or ends, with a timed message; `source` says that the attitude is not ready."""

    frame_index: int
    t_boot_us: int
    starting: bool
    source: str


class StartUp:
    """Of one vehicle within one boot."""

    def __init__(self, first_us: int, said: Iterable[Statement]) -> None:
        """Start with the boot's first time; `said`: what held before it."""
        self._until_us = first_us + _LONGEST_US
        self._waits_for: list[str] = []
        self._ready: set[str] = set()
        self._is_over = False
        for say in said:
            if not (isinstance(say, ReadySet) and say.ready):  # what was ready before the boot need not be
                self._hear(say)
        self._was_starting = False

    def take(self, told: list[Statement], segment: BootSegment) -> list[StartUpChange]:
        """What the next statements and times change, each with the first timed message at or behind it."""
        if not len(segment.frame_index) or (self._is_over and not self._was_starting):
            return []
        changes = [self._change(0, segment)]
        reached = np.flatnonzero(segment.t_boot_us >= self._until_us)
        late = int(reached[0]) if len(reached) else len(segment.frame_index)
        for say in told:
            if isinstance(say, ReadySet | ModeSet | LandedSet):
                row = int(np.searchsorted(segment.frame_index, say.frame_index))
                if row >= late:
                    break
                self._hear(say)
                changes.append(self._change(row, segment))
        if late < len(segment.frame_index):
            self._end()
            changes.append(self._change(late, segment))
        return [change for change in changes if change is not None]

    def _change(self, row: int, segment: BootSegment) -> StartUpChange | None:
        starting = bool(self._waits_for)
        if starting == self._was_starting:
            return None
        self._was_starting = starting
        source = self._waits_for[0] if starting else ""
        return StartUpChange(int(segment.frame_index[row]), int(segment.t_boot_us[row]), starting, source)

    def _hear(self, say: Statement) -> None:
        if self._is_over:
            return
        if (isinstance(say, ModeSet) and say.armed) or (isinstance(say, LandedSet) and say.landed is False):
            self._end()
        elif isinstance(say, ReadySet):
            if not say.ready:
                if say.source not in self._ready and say.source not in self._waits_for:
                    self._waits_for.append(say.source)
                return
            self._ready.add(say.source)
            was_waiting = say.source in self._waits_for
            self._waits_for = [name for name in self._waits_for if name != say.source]
            if not self._waits_for and (was_waiting or say.source in _ESTIMATORS):
                self._end()

    def _end(self) -> None:
        self._is_over, self._waits_for = True, []
