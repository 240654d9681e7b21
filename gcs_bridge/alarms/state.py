"""The life of an alarm (after ISA-18.2 and EEMUA 191): its states, how it is announced, and what moves it, as tables.

When a disagreement becomes an alarm, and when the alarm goes, is decided by votes and delays: time is the vehicle's and
comes with the samples. A sample is bad above its limit and low below a share of it; alarms start and end by a vote over
the last samples, so that a lone outlier does neither. What comes and goes, each time for less than the on-delay, can be
told to count together.
How an alarm is announced goes beside its state: what is shelved or suppressed lives on as if it were told.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

import numpy as np

from gcs_bridge.alarms.rated import Rated, Worst
from gcs_bridge.settings import AlarmSettings


class State(Enum):
    """Of one alarm."""

    NORMAL = "normal"
    PENDING = "pending"  # above the limit, waiting for the on-delay
    RAISED = "raised"  # and nobody has acknowledged it
    ACKNOWLEDGED = "acknowledged"
    CLEARING = "clearing"  # low, waiting for the off-delay
    CLEARING_ACKNOWLEDGED = "clearing_acknowledged"
    RETURNED = "returned"  # gone, and nobody had acknowledged it: latched until somebody does
    RETURNED_PENDING = "returned_pending"  # latched, and above the limit again
    NO_COMPARE = "no_compare"  # a source is missing or stale
    INOP = "inop"  # the comparator cannot run


class Signal(Enum):
    """What may change an alarm's state."""

    BAD = "bad"  # what the last samples say together
    BETWEEN = "between"
    LOW = "low"
    DELAYED = "delayed"  # the state's delay has run out, or need not be waited for again
    ACKNOWLEDGE = "acknowledge"
    LOST = "lost"  # a source went stale
    BROKEN = "broken"  # a source cannot be used
    FOUND = "found"  # all sources are there again


_S, _T = State, Signal
# State and signal → next state; what is not here changes nothing. A raised alarm whose source goes stays raised:
# nothing has shown that the fault is gone.
TRANSITIONS = {
    (_S.NORMAL, _T.BAD): _S.PENDING,
    (_S.NORMAL, _T.LOST): _S.NO_COMPARE,
    (_S.NORMAL, _T.BROKEN): _S.INOP,
    (_S.PENDING, _T.BETWEEN): _S.NORMAL,
    (_S.PENDING, _T.LOW): _S.NORMAL,
    (_S.PENDING, _T.DELAYED): _S.RAISED,
    (_S.PENDING, _T.LOST): _S.NO_COMPARE,
    (_S.PENDING, _T.BROKEN): _S.INOP,
    (_S.RAISED, _T.LOW): _S.CLEARING,
    (_S.RAISED, _T.ACKNOWLEDGE): _S.ACKNOWLEDGED,
    (_S.ACKNOWLEDGED, _T.LOW): _S.CLEARING_ACKNOWLEDGED,
    (_S.CLEARING, _T.BAD): _S.RAISED,
    (_S.CLEARING, _T.BETWEEN): _S.RAISED,
    (_S.CLEARING, _T.LOST): _S.RAISED,
    (_S.CLEARING, _T.BROKEN): _S.RAISED,
    (_S.CLEARING, _T.DELAYED): _S.RETURNED,
    (_S.CLEARING, _T.ACKNOWLEDGE): _S.CLEARING_ACKNOWLEDGED,
    (_S.CLEARING_ACKNOWLEDGED, _T.BAD): _S.ACKNOWLEDGED,
    (_S.CLEARING_ACKNOWLEDGED, _T.BETWEEN): _S.ACKNOWLEDGED,
    (_S.CLEARING_ACKNOWLEDGED, _T.LOST): _S.ACKNOWLEDGED,
    (_S.CLEARING_ACKNOWLEDGED, _T.BROKEN): _S.ACKNOWLEDGED,
    (_S.CLEARING_ACKNOWLEDGED, _T.DELAYED): _S.NORMAL,
    (_S.RETURNED, _T.BAD): _S.RETURNED_PENDING,
    (_S.RETURNED, _T.ACKNOWLEDGE): _S.NORMAL,
    (_S.RETURNED_PENDING, _T.BETWEEN): _S.RETURNED,
    (_S.RETURNED_PENDING, _T.LOW): _S.RETURNED,
    (_S.RETURNED_PENDING, _T.DELAYED): _S.RAISED,
    (_S.RETURNED_PENDING, _T.LOST): _S.RETURNED,
    (_S.RETURNED_PENDING, _T.BROKEN): _S.RETURNED,
    (_S.RETURNED_PENDING, _T.ACKNOWLEDGE): _S.PENDING,
    (_S.NO_COMPARE, _T.FOUND): _S.NORMAL,
    (_S.NO_COMPARE, _T.BROKEN): _S.INOP,
    (_S.INOP, _T.FOUND): _S.NORMAL,
}


class Announcement(Enum):
    """How an alarm is announced, whatever its state."""

    TOLD = "told"  # what happens to it is told
    SUPPRESSED = "suppressed"  # it stands beside an alarm of the same check, which says it already
    SHELVED = "shelved"  # somebody wants to hear nothing of it for a time, later boots included
    SHELVED_SUPPRESSED = "shelved_suppressed"


class AnnouncementSignal(Enum):
    """What may change how an alarm is announced."""

    SUPPRESS = "suppress"  # it was raised beside an alarm of the same check
    RELEASE = "release"  # that one is gone, or this one
    SHELVE = "shelve"
    UNSHELVE = "unshelve"  # somebody asked for it, or the time has run out


_A, _N = Announcement, AnnouncementSignal
# The same for how it is announced. What was told once is not suppressed later: only a raise can be.
ANNOUNCEMENTS = {
    (_A.TOLD, _N.SUPPRESS): _A.SUPPRESSED,
    (_A.TOLD, _N.SHELVE): _A.SHELVED,
    (_A.SUPPRESSED, _N.RELEASE): _A.TOLD,
    (_A.SUPPRESSED, _N.SHELVE): _A.SHELVED_SUPPRESSED,
    (_A.SHELVED, _N.SUPPRESS): _A.SHELVED_SUPPRESSED,
    (_A.SHELVED, _N.UNSHELVE): _A.TOLD,
    (_A.SHELVED_SUPPRESSED, _N.RELEASE): _A.SHELVED,
    (_A.SHELVED_SUPPRESSED, _N.UNSHELVE): _A.SUPPRESSED,
}

PENDING = frozenset({State.PENDING, State.RETURNED_PENDING})
STANDING = frozenset({State.RAISED, State.ACKNOWLEDGED, State.CLEARING, State.CLEARING_ACKNOWLEDGED})
SUPPRESSED = frozenset({Announcement.SUPPRESSED, Announcement.SHELVED_SUPPRESSED})
SHELVED = frozenset({Announcement.SHELVED, Announcement.SHELVED_SUPPRESSED})
_CLEARING = frozenset({State.CLEARING, State.CLEARING_ACKNOWLEDGED})
_QUIET = frozenset(State) - PENDING - STANDING
_RECURRING_EXCURSIONS, _RECURRING_DELAYS = 3, 1.5  # so many, and so many on-delays long together, raise the alarm


class Change(NamedTuple):
    """A change of state, at sample `place` of the batch.

    `worst` is the excursion's peak so far, `onset_us` the time of the first of the bad samples that made it pending.
    """

    place: int
    before: State
    state: State
    t_boot_us: int
    worst: Worst
    onset_us: int = -1


class _Sample(NamedTuple):
    t_us: int
    bad: bool
    low: bool
    worst: Worst


class _Short(NamedTuple):
    """An excursion that was taken back: its first bad sample, and since when and until when it was pending."""

    onset_us: int
    since_us: int
    until_us: int


class Alarm:
    """One alarm of one check of one vehicle within one boot."""

    def __init__(self, settings: AlarmSettings, recurring_window_s: float = 0.0) -> None:
        """Start with no sample. Within `recurring_window_s` excursions that are too short count together; 0: never."""
        self.state = State.NORMAL
        self._settings = settings
        self._on_delay_us = round(settings.on_delay_s * 1e6)
        self._off_delay_us = round(settings.off_delay_s * 1e6)
        self._window_us = round(settings.window_s * 1e6)
        self._recurring_window_us = round(recurring_window_s * 1e6)
        self._recent: deque[_Sample] = deque(maxlen=settings.counted_samples)
        self._now_us = 0  # the latest sample's time: one that comes late does not turn the delays back
        self._since_us = 0
        self._voted_us = 0  # when the vote was bad last
        self._short: list[_Short] = []  # a few: and each deque, even an empty one, takes 0.8 kB
        self.worst = Worst(-1.0, np.empty(0))  # of the present excursion
        self._onset_us = -1

    def feed(self, samples: Rated) -> Iterator[Change]:
        """Take counted samples in order; yield each change of state."""
        index, count = 0, len(samples.bad)
        if not count:
            return
        bad_at = np.flatnonzero(samples.bad)
        while index < count:
            if self.state in _QUIET and not any(sample.bad for sample in self._recent):
                # Nothing can happen before the next bad sample: only those right before it still have a vote.
                following = np.searchsorted(bad_at, index)
                skip_to = int(bad_at[following]) if following < len(bad_at) else count
                index = max(index, skip_to - self._settings.counted_samples)
                self._now_us = max(self._now_us, int(samples.t_boot_us[:skip_to].max(initial=0)))
                while index < skip_to:
                    self._recent.append(_sample(samples, index))
                    index += 1
                if index == count:
                    return
            yield from self._take(index, _sample(samples, index))
            index += 1

    def signal(self, signal: Signal) -> tuple[State, State]:
        """Take a signal that is no sample; return the state before and after it."""
        before = self.state
        self.state = TRANSITIONS.get((before, signal), before)
        return before, self.state

    def _take(self, index: int, sample: _Sample) -> Iterator[Change]:
        self._now_us = max(self._now_us, sample.t_us)
        self._recent.append(sample)
        voters = [voter for voter in self._recent if self._now_us - voter.t_us <= self._window_us]
        vote = self._vote(voters)
        if self.state in _QUIET and vote is Signal.BAD:
            self.worst = max((voter.worst for voter in voters if voter.bad), key=lambda worst: worst.value)
            self._onset_us = min(voter.t_us for voter in voters if voter.bad)
        elif sample.bad and sample.worst.value > self.worst.value:
            self.worst = sample.worst
        yield from self._go(index, vote)
        waited_us = self._now_us - self._since_us
        if self.state in PENDING:
            self._voted_us = self._now_us
            if waited_us >= self._on_delay_us or self._recurs(waited_us):
                yield from self._go(index, Signal.DELAYED)
        elif self.state in _CLEARING and waited_us >= self._off_delay_us:
            yield from self._go(index, Signal.DELAYED)

    def _recurs(self, waited_us: int) -> bool:
        """Whether the pending excursion is one of several that were too short: a lag comes and goes."""
        while self._short and self._short[0].since_us < self._now_us - self._recurring_window_us:
            del self._short[0]
        lasted_us = waited_us + sum(one.until_us - one.since_us for one in self._short)
        if len(self._short) < _RECURRING_EXCURSIONS - 1 or lasted_us < _RECURRING_DELAYS * self._on_delay_us:
            return False
        self._onset_us = self._short[0].onset_us
        return True

    def _go(self, index: int, signal: Signal) -> Iterator[Change]:
        before, after = self.signal(signal)
        if after is not before:
            if before in PENDING and after in _QUIET:
                self._short.append(_Short(self._onset_us, self._since_us, self._voted_us))
            self._since_us = self._now_us
            yield Change(index, before, after, self._now_us, self.worst, self._onset_us)

    def _vote(self, voters: list[_Sample]) -> Signal:
        needed = self._settings.bad_samples
        if sum(voter.bad for voter in voters) >= needed:
            return Signal.BAD
        return Signal.LOW if sum(not voter.low for voter in voters) < needed else Signal.BETWEEN


def _sample(samples: Rated, index: int) -> _Sample:
    worst = Worst(float(samples.value[index]), samples.detail[index])
    return _Sample(int(samples.t_boot_us[index]), bool(samples.bad[index]), bool(samples.low[index]), worst)
