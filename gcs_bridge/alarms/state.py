"""The life of an alarm (after ISA-18.2 and EEMUA 191): its states, how it is announced, and what moves it, as tables.

When a disagreement becomes an alarm, and when the alarm goes, is decided by votes and delays: time is the vehicle's and
comes with the samples. A sample is bad above its limit and low below a share of it; alarms start and end by a vote over
the last samples, so that a lone outlier does neither. What comes and goes, each time for less than the on-delay, can be
told to count together.
How an alarm is announced goes beside its state: what is shelved or suppressed lives on as if it were told.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from gcs_bridge.alarms.rated import Worst


class State(Enum):
    """Of one alarm."""

    __hash__ = object.__hash__  # each is one object; Enum's own is computed anew with every look into a set or a table

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

    __hash__ = object.__hash__  # as State's

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
LATCHED = frozenset({State.RETURNED, State.RETURNED_PENDING})
STANDING = frozenset({State.RAISED, State.ACKNOWLEDGED, State.CLEARING, State.CLEARING_ACKNOWLEDGED})
SUPPRESSED = frozenset({Announcement.SUPPRESSED, Announcement.SHELVED_SUPPRESSED})
SHELVED = frozenset({Announcement.SHELVED, Announcement.SHELVED_SUPPRESSED})
CLEARING = frozenset({State.CLEARING, State.CLEARING_ACKNOWLEDGED})
MOVING = PENDING | CLEARING
QUIET = frozenset(State) - PENDING - STANDING


class Change(NamedTuple):
    """A change of state, and what brought it about, None: nothing did, it tells where the alarm is.

    `worst` is the excursion's peak so far, `onset_us` the time of its first bad sample.
    """

    before: State
    state: State
    by: Signal | None
    t_boot_us: int
    worst: Worst
    onset_us: int = -1
