"""When a disagreement becomes an alarm, and when the alarm goes: votes, delays and a table of transitions.

Time is the vehicle's and comes with the samples. A sample is bad above its limit and low below a share of it; alarms
start and end by a vote over the last samples, so that a lone outlier does neither (after ISA-18.2 and EEMUA 191).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.settings import EulerQuaternionSettings


class State(Enum):
    """Of one alarm."""

    NORMAL = "normal"
    PENDING = "pending"  # above the limit, waiting for the on-delay
    RAISED = "raised"
    CLEARING = "clearing"  # low, waiting for the off-delay


class Vote(Enum):
    """What the last samples say together."""

    BAD = "bad"
    BETWEEN = "between"
    LOW = "low"


# State and vote → next state. A delay that has run out turns PENDING into RAISED and CLEARING into NORMAL.
TRANSITIONS = {
    (State.NORMAL, Vote.BAD): State.PENDING,
    (State.NORMAL, Vote.BETWEEN): State.NORMAL,
    (State.NORMAL, Vote.LOW): State.NORMAL,
    (State.PENDING, Vote.BAD): State.PENDING,
    (State.PENDING, Vote.BETWEEN): State.NORMAL,
    (State.PENDING, Vote.LOW): State.NORMAL,
    (State.RAISED, Vote.BAD): State.RAISED,
    (State.RAISED, Vote.BETWEEN): State.RAISED,
    (State.RAISED, Vote.LOW): State.CLEARING,
    (State.CLEARING, Vote.BAD): State.RAISED,
    (State.CLEARING, Vote.BETWEEN): State.RAISED,
    (State.CLEARING, Vote.LOW): State.CLEARING,
}


class Worst(NamedTuple):
    """The largest value of an excursion, and the detail that came with it."""

    value: float
    detail: npt.NDArray[np.float64]


class Change(NamedTuple):
    """A change of state, at sample `place` of the batch; `worst` is the excursion's peak so far."""

    place: int
    before: State
    state: State
    t_boot_us: int
    worst: Worst


@dataclass(frozen=True)
class Rated:
    """n samples against their limits: time, value, whether bad and whether low (never both), and a detail a sample."""

    t_boot_us: npt.NDArray[np.int64]
    value: npt.NDArray[np.float64]
    bad: npt.NDArray[np.bool_]
    low: npt.NDArray[np.bool_]
    detail: npt.NDArray[np.float64]


class _Sample(NamedTuple):
    t_us: int
    bad: bool
    low: bool
    worst: Worst


class Alarm:
    """The alarm of one check of one vehicle within one boot."""

    def __init__(self, settings: EulerQuaternionSettings) -> None:
        """Start in NORMAL, with no sample."""
        self.state = State.NORMAL
        self._settings = settings
        self._on_delay_us = round(settings.on_delay_s * 1e6)
        self._off_delay_us = round(settings.off_delay_s * 1e6)
        self._window_us = round(settings.window_s * 1e6)
        self._recent: deque[_Sample] = deque(maxlen=settings.counted_samples)
        self._now_us = 0  # the latest sample's time: one that comes late does not turn the delays back
        self._since_us = 0
        self.worst = Worst(-1.0, np.empty(0))  # of the present excursion

    def feed(self, samples: Rated) -> Iterator[Change]:
        """Take counted samples in order; yield each change of state."""
        bad_at = np.flatnonzero(samples.bad)
        index = 0
        while index < len(samples.bad):
            if self.state is State.NORMAL and not any(sample.bad for sample in self._recent):
                # Nothing can happen before the next bad sample: only those right before it still have a vote.
                following = np.searchsorted(bad_at, index)
                skip_to = int(bad_at[following]) if following < len(bad_at) else len(samples.bad)
                index = max(index, skip_to - self._settings.counted_samples)
                self._now_us = max(self._now_us, int(samples.t_boot_us[:skip_to].max(initial=0)))
                while index < skip_to:
                    self._recent.append(_sample(samples, index))
                    index += 1
                if index == len(samples.bad):
                    return
            yield from self._take(index, _sample(samples, index))
            index += 1

    def _take(self, index: int, sample: _Sample) -> Iterator[Change]:
        self._now_us = max(self._now_us, sample.t_us)
        self._recent.append(sample)
        voters = [voter for voter in self._recent if self._now_us - voter.t_us <= self._window_us]
        following = TRANSITIONS[self.state, self._vote(voters)]
        if self.state is State.NORMAL and following is State.PENDING:
            self.worst = max((voter.worst for voter in voters), key=lambda worst: worst.value)
        elif sample.worst.value > self.worst.value:
            self.worst = sample.worst
        yield from self._go(index, following)
        waited_us = self._now_us - self._since_us
        if self.state is State.PENDING and waited_us >= self._on_delay_us:
            yield from self._go(index, State.RAISED)
        elif self.state is State.CLEARING and waited_us >= self._off_delay_us:
            yield from self._go(index, State.NORMAL)

    def _go(self, index: int, state: State) -> Iterator[Change]:
        if state is self.state:
            return
        before, self.state, self._since_us = self.state, state, self._now_us
        yield Change(index, before, state, self._now_us, self.worst)

    def _vote(self, voters: list[_Sample]) -> Vote:
        needed = self._settings.bad_samples
        if sum(voter.bad for voter in voters) >= needed:
            return Vote.BAD
        return Vote.LOW if sum(not voter.low for voter in voters) < needed else Vote.BETWEEN


def _sample(samples: Rated, index: int) -> _Sample:
    worst = Worst(float(samples.value[index]), samples.detail[index])
    return _Sample(int(samples.t_boot_us[index]), bool(samples.bad[index]), bool(samples.low[index]), worst)
