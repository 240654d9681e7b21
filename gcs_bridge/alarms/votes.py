"""The votes and delays of all alarms of a vehicle, compiled: a check's kernel gives each sample to its alarms itself.

Sample after sample, in order of arrival; what comes out are changes of state alone. The rules are those of `state`;
Python's side of it is `ballot`.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.alarms.state import CLEARING, PENDING, QUIET, TRANSITIONS, Signal, State
from gcs_bridge.columns import FloatRows, Floats, Int64Rows, Int64s, Records
from gcs_bridge.jit import helper, inlined, kernel

STATES, SIGNALS = tuple(State), tuple(Signal)
NEXT = np.array([[STATES.index(TRANSITIONS.get((one, by), one)) for by in SIGNALS] for one in STATES])
IS_PENDING, IS_CLEARING, IS_QUIET = (np.array([one in of for one in STATES]) for of in (PENDING, CLEARING, QUIET))
_BAD, _BETWEEN, _LOW, _DELAYED = (
    SIGNALS.index(one) for one in (Signal.BAD, Signal.BETWEEN, Signal.LOW, Signal.DELAYED)
)
NO_SIGNAL = -1
SHORT = 32  # excursions that were too short, of which as many can count together
_EXCURSIONS, _DELAYS = 3, 1.5  # so many, and so many on-delays long together, raise the alarm

ALARM = np.dtype(
    [
        ("state", "i8"),  # place in State
        ("now_us", "i8"),  # the latest sample's time: one that comes late does not turn the delays back
        ("since_us", "i8"),  # when the state began
        ("voted_us", "i8"),  # when the vote was bad last
        ("onset_us", "i8"),  # of the present excursion: its first bad sample
        ("worst", "f8"),  # and its largest value, with what came with that
        ("worst_detail", "f8", (5,)),
        ("samples", "i8"),
        ("next", "i8"),  # the place of the next one among the recent ones
        ("high", "i8"),  # how many of the recent ones are not low
        ("t_us", "i8"),  # the last sample, against its limit
        ("value", "f8"),
        ("limit", "f8"),
        ("shorts", "i8"),  # excursions that were too short, of late
        ("short_row", "i8"),  # where they are kept, −1: they are not
        ("signal", "i8"),  # the next of its signals
        ("signals", "i8"),  # the end of them
        # Of its spec.
        ("bad_samples", "i8"),
        ("counted_samples", "i8"),
        ("window_us", "i8"),
        ("on_delay_us", "i8"),
        ("off_delay_us", "i8"),
        ("recurring_window_us", "i8"),
        ("clear_below", "f8"),
    ]
)
CHANGE = np.dtype(
    [
        ("alarm", "i8"),
        ("frame_index", "i8"),
        ("before", "i8"),
        ("after", "i8"),
        ("by", "i8"),  # place in Signal
        ("t_us", "i8"),
        ("onset_us", "i8"),
        ("worst", "f8"),
        ("worst_detail", "f8", (5,)),
    ]
)
_T, _VALUE, _IS_BAD, IS_LOW, DETAIL = range(5)  # columns of `recent`; the detail has five


class Votes(NamedTuple):
    """What kernels are given of the alarms: all arrays, changed in place."""

    alarm: Annotated[Records, ALARM]  # (n,)
    recent: Annotated[Floats, 3]  # (n, counted, 9) a ring of the last samples each
    short: Annotated[Int64s, 3]  # (k, SHORT, 3) excursions that were taken back: onset, and from when to when pending
    signal: Int64Rows  # (m, 2) frame and place in Signal, those of one alarm together
    change: Annotated[Records, CHANGE]  # as many as there is room for
    changes: Int64s  # (1,) how many there are


@inlined
def vote(votes: Any, a: Any, frame_index: Any, t_us: Any, value: Any, limit: Any, detail: Any) -> Any:
    """Give the alarm `a` its next sample: bad above `limit`; `detail`, five numbers, counts where it is bad alone."""
    alarm = votes.alarm[a]
    if alarm.signal < alarm.signals:
        _pass_signals(votes, a, frame_index)
    alarm.t_us, alarm.value, alarm.limit = t_us, value, limit
    alarm.now_us = max(alarm.now_us, t_us)
    alarm.samples += 1
    at = alarm.next
    alarm.next = at + 1 if at + 1 < alarm.counted_samples else 0
    low = value <= alarm.clear_below * limit
    if not low or alarm.high or not IS_QUIET[alarm.state]:  # else all are low, and nothing can come of this one
        _count(votes, a, frame_index, at, value > limit, low, detail)


@helper
def forget_samples(votes: Any, a: Any) -> Any:
    """The samples of the alarm `a` so far have no vote any more: today they would be judged otherwise."""
    for i in range(votes.alarm[a].counted_samples):
        votes.recent[a, i, _IS_BAD], votes.recent[a, i, IS_LOW] = 0.0, 1.0
    votes.alarm[a].high = 0


@helper
def _count(votes: Any, a: Any, frame_index: Any, at: Any, bad: Any, low: Any, detail: Any) -> Any:
    """Take the alarm's latest sample among the recent ones, at place `at`, and see what they say together."""
    alarm, recent = votes.alarm[a], votes.recent[a]
    value = alarm.value
    alarm.high += np.int64(recent[at, IS_LOW] != 0.0) - np.int64(low)
    recent[at, _T], recent[at, _VALUE], recent[at, _IS_BAD], recent[at, IS_LOW] = alarm.t_us, value, bad, low
    if bad:
        for i in range(5):
            recent[at, DETAIL + i] = detail[i]
    n_bad = n_high = 0
    for i in range(alarm.counted_samples):
        if alarm.now_us - recent[i, _T] <= alarm.window_us:
            n_bad += recent[i, _IS_BAD] != 0.0
            n_high += recent[i, IS_LOW] == 0.0
    said = _BETWEEN
    if n_bad >= alarm.bad_samples:
        said = _BAD
    elif n_high < alarm.bad_samples:
        said = _LOW
    if IS_QUIET[alarm.state]:
        if said == _BAD:
            _begin(votes, a)
    elif bad and value > alarm.worst:
        alarm.worst = value
        for i in range(5):
            alarm.worst_detail[i] = detail[i]
    _go(votes, a, frame_index, said)
    waited_us = alarm.now_us - alarm.since_us
    if IS_PENDING[alarm.state]:
        alarm.voted_us = alarm.now_us
        if waited_us >= alarm.on_delay_us or _recurs(votes, a, waited_us):
            _go(votes, a, frame_index, _DELAYED)
    elif IS_CLEARING[alarm.state] and waited_us >= alarm.off_delay_us:
        _go(votes, a, frame_index, _DELAYED)


@helper
def _begin(votes: Any, a: Any) -> Any:
    """An excursion begins with the bad ones of the samples that voted for it."""
    alarm, recent, counted = votes.alarm[a], votes.recent[a], votes.alarm[a].counted_samples
    alarm.worst, alarm.onset_us = -np.inf, alarm.now_us
    for i in range(counted):
        at = (alarm.next + i) % counted  # the oldest first: of two alike it is the worst
        if recent[at, _IS_BAD] == 0.0 or alarm.now_us - recent[at, _T] > alarm.window_us:
            continue
        alarm.onset_us = min(alarm.onset_us, np.int64(recent[at, _T]))
        if recent[at, _VALUE] > alarm.worst:
            alarm.worst = recent[at, _VALUE]
            for j in range(5):
                alarm.worst_detail[j] = recent[at, DETAIL + j]


@helper
def _recurs(votes: Any, a: Any, waited_us: Any) -> Any:
    """Whether the pending excursion is one of several that were too short: a lag comes and goes."""
    alarm = votes.alarm[a]
    if alarm.short_row < 0:
        return False
    short = votes.short[alarm.short_row]
    left, lasted_us = 0, waited_us
    for i in range(alarm.shorts):
        if left or short[i, 1] >= alarm.now_us - alarm.recurring_window_us:
            for column in range(3):
                short[left, column] = short[i, column]
            lasted_us += short[left, 2] - short[left, 1]
            left += 1
    alarm.shorts = left
    if left < _EXCURSIONS - 1 or lasted_us < _DELAYS * alarm.on_delay_us:
        return False
    alarm.onset_us = short[0, 0]
    return True


@helper
def _go(votes: Any, a: Any, frame_index: Any, signal: Any) -> Any:
    """Take the alarm to its next state, if the signal leads to another one."""
    alarm = votes.alarm[a]
    before = alarm.state
    after = NEXT[before, signal]
    if after == before:
        return
    if IS_PENDING[before] and IS_QUIET[after] and alarm.short_row >= 0:
        short = votes.short[alarm.short_row]
        if alarm.shorts == SHORT:
            alarm.shorts -= 1
            for i in range(alarm.shorts):
                for column in range(3):
                    short[i, column] = short[i + 1, column]
        short[alarm.shorts, 0], short[alarm.shorts, 1], short[alarm.shorts, 2] = (
            alarm.onset_us, alarm.since_us, alarm.voted_us,
        )  # fmt: skip
        alarm.shorts += 1
    alarm.since_us = alarm.now_us
    alarm.state = after
    _write(votes, a, frame_index, before, signal, alarm.now_us)


@helper
def _write(votes: Any, a: Any, frame_index: Any, before: Any, by: Any, t_us: Any) -> Any:
    """Put down where the alarm is with a frame, and what it was before."""
    alarm, change = votes.alarm[a], votes.change[votes.changes[0]]
    votes.changes[0] += 1
    change.alarm, change.frame_index, change.before, change.after = a, frame_index, before, alarm.state
    change.by, change.t_us, change.onset_us, change.worst = by, t_us, alarm.onset_us, alarm.worst
    for i in range(5):
        change.worst_detail[i] = alarm.worst_detail[i]


@helper
def _pass_signals(votes: Any, a: Any, frame_index: Any) -> Any:
    """Take the signals that came up to a frame, before its own sample; what is no signal tells where the alarm is."""
    alarm = votes.alarm[a]
    while alarm.signal < alarm.signals and votes.signal[alarm.signal, 0] <= frame_index:
        at, by = votes.signal[alarm.signal]
        alarm.signal += 1
        before = alarm.state
        if by != NO_SIGNAL:
            alarm.state = NEXT[before, by]
        if alarm.state != before or by == NO_SIGNAL:
            _write(votes, a, at, before, by, 0)


@kernel
def pass_signals(votes: Votes) -> None:
    """Take all signals that no sample followed."""
    for a in range(votes.alarm.size):
        if votes.alarm[a].signal < votes.alarm[a].signals:
            _pass_signals(votes, a, np.iinfo(np.int64).max)


@kernel
def vote_all(
    votes: Votes, a: int, frame_index: Int64s, t_us: Int64s, value: Floats, limit: Floats, detail: FloatRows
) -> None:
    """Give the alarm `a` samples (n,) with their details (n, 5)."""
    for i in range(value.size):
        vote(
            votes,
            a,
            frame_index[i],
            t_us[i],
            value[i],
            limit[i],
            (detail[i, 0], detail[i, 1], detail[i, 2], detail[i, 3], detail[i, 4]),
        )
