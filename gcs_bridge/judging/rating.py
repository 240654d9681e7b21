"""Gives every check of a vehicle its batch; large batches to two groups of checks at once, where somebody offers that.

Checks know nothing of each other, and each alarm is one check's alone: nothing that comes out depends on which thread
a check was judged in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

import numpy as np

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.checks.base import Check, ImuCheck
from gcs_bridge.checks.batch import CheckBatch
from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.checks.stream import StreamCheck
from gcs_bridge.events import Notice
from gcs_bridge.judging.boot import Boot
from gcs_bridge.judging.notices import breaks
from gcs_bridge.judging.start_up import StartUpChange
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import LinkClock

Made = TypeVar("Made")
_WORTH_IT = 3000  # messages: of fewer, it is not worth to wake a thread and to wait for it


class Beside(Protocol):
    """Begins something in another thread; what it returns waits for what comes of it, or raises what went wrong."""

    def __call__(self, make: Callable[[], Made], /) -> Callable[[], Made]:
        """Begin it."""


# What is judged here is about half of the work. Inertial checks send signals to their alarms: only one thread may.
_HERE = (ImuCheck, StreamCheck, EulerQuaternion)


def begun(make: Callable[[], Made], beside: Beside | None, messages: int) -> Callable[[], Made]:
    """What returns what `make` does: begun beside this thread by now, where somebody offers that and it is worth it."""
    return make if beside is None or messages < _WORTH_IT else beside(make)


class Rating:
    """The checks of one vehicle, and the ballot of their alarms."""

    def __init__(self, vehicle: VehicleId, checks: Sequence[Check], ballot: Ballot, beside: Beside | None) -> None:
        """Judge in this thread, or `beside` it too."""
        self._vehicle = vehicle
        self._checks = checks
        self._ballot = ballot
        self._beside = beside
        self._here = [check for check in checks if isinstance(check, _HERE)]
        self._there = [check for check in checks if not isinstance(check, _HERE)]

    def judge(
        self, boot: Boot, batch: CheckBatch, was_starting: bool, start_ups: Sequence[StartUpChange], link: LinkClock
    ) -> Iterator[Notice]:
        """Judge a batch; of one in some of which the attitude is not ready, only what is ready."""
        if was_starting or start_ups:
            yield from self._judge_what_is_ready(boot, batch, was_starting, start_ups, link)
            return
        if self._beside is not None and len(batch.line.frame_index) >= _WORTH_IT:
            self._judge_both(batch, self._beside)
        else:
            _judge(self._checks, batch, self._ballot)
        yield from breaks(self._vehicle, boot.index, self._checks, link)

    def _judge_both(self, batch: CheckBatch, beside: Beside) -> None:
        with self._ballot.apart() as apart:
            joined = beside(lambda: _judge(self._there, batch, apart))
            try:
                _judge(self._here, batch, self._ballot)
            finally:
                joined()

    def _judge_what_is_ready(
        self, boot: Boot, batch: CheckBatch, was_starting: bool, start_ups: Sequence[StartUpChange], link: LinkClock
    ) -> Iterator[Notice]:
        """What is not ready is left out where an attitude is compared."""
        begins: list[tuple[int, bool]] = [(0, was_starting)]
        begins += [(change.frame_index, change.starting) for change in start_ups]
        ends = [frame_index for frame_index, _ in begins[1:]] + [np.iinfo(np.int64).max]
        ready = [batch.frames(first, end) for (first, starting), end in zip(begins, ends, strict=True) if not starting]
        for check in self._checks:
            waits = check.compares and not isinstance(check, EulerQuaternion)  # its alarms alone wait
            for part in (ready or [batch.frames(0, 0)]) if waits else [batch]:
                check.judge(part, self._ballot)
                yield from breaks(self._vehicle, boot.index, [check], link)


def _judge(checks: Sequence[Check], batch: CheckBatch, ballot: Ballot) -> None:
    for check in checks:
        check.judge(batch, ballot)
