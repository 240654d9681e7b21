"""The tables of an alarm's life, and stories of votes, delays, deadband.

Time is in the samples; every moment is worked by hand.
"""

from collections.abc import Hashable, Mapping, Sequence
from enum import Enum
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.state import (
    ANNOUNCEMENTS,
    TRANSITIONS,
    Announcement,
    AnnouncementSignal,
    Signal,
    State,
)
from gcs_bridge.settings import AlarmSettings
from tests.helpers.alarms import Alarm
from tests.helpers.everyday import searched

LIMIT = 1.0
RULES = AlarmSettings()
RECURRING_S = 10.0
GOOD, HIGH, BAD = 0.1, 0.9, 5.0  # below 70 % of the limit, between that and the limit, above the limit

Statement = list[tuple[int, str, str, float]]  # ms, state before, state, worst so far


def rated(story: Sequence[tuple[int, float]]) -> Rated:
    """(ms, value) as the check hands them over."""
    value = np.array([v for _, v in story], np.float64)
    t_us = np.array([t * 1000 for t, _ in story], np.int64)
    detail = value[:, None] * np.arange(1, 6)  # five numbers that tell whose they are
    return Rated(
        frame_index=np.arange(len(value)),
        t_boot_us=t_us,
        value=value,
        limit=np.full(len(value), LIMIT),
        bad=value > LIMIT,
        low=value <= 0.7 * LIMIT,
        detail=detail,
    )


def told(
    story: Sequence[tuple[int, float]], cuts: Sequence[int] = (), rules: AlarmSettings = RULES
) -> tuple[Statement, Alarm]:
    """Every change of state while the story is told, cut into batches; the places count through."""
    alarm = Alarm(rules, RECURRING_S)
    changes: Statement = []
    for lo, hi in pairwise([0, *cuts, len(story)]):
        for _, frame_index, change in alarm.feed(rated(story[lo:hi])):
            assert story[lo + frame_index][0] * 1000 <= change.t_boot_us  # later where that sample itself was late
            assert change.worst.detail.tolist() == [change.worst.value * n for n in range(1, 6)]
            changes.append((change.t_boot_us // 1000, change.before.value, change.state.value, change.worst.value))
    return changes, alarm


def moments(story: Sequence[tuple[int, float]], rules: AlarmSettings = RULES) -> list[tuple[int, str]]:
    return [(ms, state) for ms, _, state, _ in told(story, rules=rules)[0]]


def run(first_ms: int, last_ms: int, value: float, step_ms: int = 100) -> list[tuple[int, float]]:
    return [(t, value) for t in range(first_ms, last_ms + 1, step_ms)]


# --- the table -------------------------------------------------------------------------------------------------------

# After the specification: normal → pending (on-delay) → raised (unacknowledged | acknowledged) → clearing (off-delay)
# → returned; NO COMPARE when a source is missing or stale, INOP when the comparator cannot run. A dot: nothing changes.
TABLE = """
                       bad              between       low                    delayed   acknowledge           lost         broken       found
normal                 pending          .             .                      .         .                     no_compare   inop         .
pending                .                normal        normal                 raised    .                     no_compare   inop         .
raised                 .                .             clearing               .         acknowledged          .            .            .
acknowledged           .                .             clearing_acknowledged  .         .                     .            .            .
clearing               raised           raised        .                      returned  clearing_acknowledged raised       raised       .
clearing_acknowledged  acknowledged     acknowledged  .                      normal    .                     acknowledged acknowledged .
returned               returned_pending .             .                      .         normal                .            .            .
returned_pending       .                returned      returned               raised    pending               returned     returned     .
no_compare             .                .             .                      .         .                     .            inop         normal
inop                   .                .             .                      .         .                     .            .            normal
"""  # noqa: E501
SIGNALS, *ROWS = (line.split() for line in TABLE.strip().splitlines())
EXPECTED = {
    (row[0], signal): row[0] if to == "." else to for row in ROWS for signal, to in zip(SIGNALS, row[1:], strict=True)
}


def test_the_table_is_whole() -> None:
    """Every state meets every signal in the table above."""
    assert {state.value for state in State} == {state for state, _ in EXPECTED}
    assert {signal.value for signal in Signal} == {signal for _, signal in EXPECTED}


@pytest.mark.parametrize("signal", Signal, ids=lambda signal: signal.value)
@pytest.mark.parametrize("state", State, ids=lambda state: state.value)
def test_each_state_and_signal(state: State, signal: Signal) -> None:
    """What a signal does in a state is what the specification says, and nothing else."""
    alarm = Alarm(AlarmSettings())
    alarm.start_in(state)
    before, after = alarm.signal(signal)
    assert before is state
    assert after is alarm.state
    assert after.value == EXPECTED[state.value, signal.value]


# How it is announced, beside: suppressed by design and shelved, of ISA-18.2's states that hide an alarm.
ANNOUNCED = """
                     suppress            release   shelve              unshelve
told                 suppressed          .         shelved             .
suppressed           .                   told      shelved_suppressed  .
shelved              shelved_suppressed  .         .                   told
shelved_suppressed   .                   shelved   .                   suppressed
"""


def test_the_table_of_announcements() -> None:
    """Each way of announcing meets each signal as in the table above, and no row is missing or without effect."""
    signals, *rows = (line.split() for line in ANNOUNCED.strip().splitlines())
    expected = {(row[0], signal): to for row in rows for signal, to in zip(signals, row[1:], strict=True) if to != "."}
    assert {state.value for state in Announcement} == {row[0] for row in rows}
    assert {signal.value for signal in AnnouncementSignal} == set(signals)
    assert {(at.value, signal.value): to.value for (at, signal), to in ANNOUNCEMENTS.items()} == expected


@pytest.mark.parametrize(
    ("table", "start"), [(TRANSITIONS, State.NORMAL), (ANNOUNCEMENTS, Announcement.TOLD)], ids=["states", "announced"]
)
def test_no_state_without_a_way_in_and_out(table: Mapping[tuple[Any, Any], Any], start: Enum) -> None:
    """Every state can be reached from the first one, and the first one from every state; no row leads nowhere."""

    def reached(begin: Hashable) -> set[Hashable]:
        found, new = {begin}, [begin]
        while new:
            state = new.pop()
            for after in {to for (at, _), to in table.items() if at is state} - found:
                found.add(after)
                new.append(after)
        return found

    assert reached(start) == set(type(start))
    assert all(start in reached(state) for state in type(start))
    assert all(to is not at for (at, _), to in table.items())


# --- a story for every row -------------------------------------------------------------------------------------------

ACKNOWLEDGE, LOST, BROKEN, FOUND = Signal.ACKNOWLEDGE, Signal.LOST, Signal.BROKEN, Signal.FOUND
RAISING, CLEARING, GONE = (BAD, 2.0), (GOOD, 1.0), (GOOD, 4.0)  # a value, and for how many seconds
LATCHED = (RAISING, GONE)
# What happens, and the states that it brings; ten samples a second, the delays of the default settings.
STORIES: dict[str, tuple[tuple[tuple[float, float] | Signal, ...], str]] = {
    "taken back": (((BAD, 0.6), (GOOD, 1)), "pending normal"),
    "taken back by what is not quite good": (((BAD, 0.6), (HIGH, 1)), "pending normal"),
    "gone unseen, then seen": ((*LATCHED, ACKNOWLEDGE), "pending raised clearing returned normal"),
    "seen, then gone": (
        (RAISING, ACKNOWLEDGE, GONE),
        "pending raised acknowledged clearing_acknowledged normal",
    ),
    "seen while it clears": (
        (RAISING, CLEARING, ACKNOWLEDGE, GONE),
        "pending raised clearing clearing_acknowledged normal",
    ),
    "relapse": ((RAISING, CLEARING, RAISING), "pending raised clearing raised"),
    "half a relapse": ((RAISING, CLEARING, (HIGH, 1)), "pending raised clearing raised"),
    "relapse, seen": (
        (RAISING, ACKNOWLEDGE, CLEARING, RAISING),
        "pending raised acknowledged clearing_acknowledged acknowledged",
    ),
    "half a relapse, seen": (
        (RAISING, ACKNOWLEDGE, CLEARING, (HIGH, 1)),
        "pending raised acknowledged clearing_acknowledged acknowledged",
    ),
    "back behind a latch": (
        (*LATCHED, RAISING),
        "pending raised clearing returned returned_pending raised",
    ),
    "nearly back behind a latch": (
        (*LATCHED, (BAD, 0.6), (GOOD, 1)),
        "pending raised clearing returned returned_pending returned",
    ),
    "not quite gone behind a latch": (
        (*LATCHED, (BAD, 0.6), (HIGH, 1)),
        "pending raised clearing returned returned_pending returned",
    ),
    "the latch seen while it comes back": (
        (*LATCHED, (BAD, 0.6), ACKNOWLEDGE, RAISING),
        "pending raised clearing returned returned_pending pending raised",
    ),
    "lost and found": ((LOST, (GOOD, 1), FOUND), "no_compare normal"),
    "lost, then broken": ((LOST, BROKEN, FOUND), "no_compare inop normal"),
    "broken": ((BROKEN, FOUND), "inop normal"),
    "lost while pending": (((BAD, 0.6), LOST), "pending no_compare"),
    "broken while pending": (((BAD, 0.6), BROKEN), "pending inop"),
    "lost while it clears": ((RAISING, CLEARING, LOST), "pending raised clearing raised"),
    "broken while it clears": ((RAISING, CLEARING, BROKEN), "pending raised clearing raised"),
    "lost while it clears, seen": (
        (RAISING, ACKNOWLEDGE, CLEARING, LOST),
        "pending raised acknowledged clearing_acknowledged acknowledged",
    ),
    "broken while it clears, seen": (
        (RAISING, ACKNOWLEDGE, CLEARING, BROKEN),
        "pending raised acknowledged clearing_acknowledged acknowledged",
    ),
    "lost behind a latch": (
        (*LATCHED, (BAD, 0.6), LOST),
        "pending raised clearing returned returned_pending returned",
    ),
    "broken behind a latch": (
        (*LATCHED, (BAD, 0.6), BROKEN),
        "pending raised clearing returned returned_pending returned",
    ),
}


class Walked(Alarm):
    """An alarm that notes which rows of the table it takes, and where they lead."""

    def __init__(self) -> None:
        super().__init__(AlarmSettings())
        self.rows: list[tuple[State, Signal | None]] = []
        self.states: list[str] = []

    def hear(self, signal: Signal) -> None:
        before, after = self.signal(signal)
        if after is not before:
            self._note(before, signal, after)

    def live(self, first_ms: int, end_ms: int, value: float) -> None:
        for one in self.feed(rated(run(first_ms, end_ms - 100, value))):
            self._note(one.change.before, one.change.by, one.change.state)

    def _note(self, before: State, by: Signal | None, after: State) -> None:
        self.rows.append((before, by))
        self.states.append(after.value)


def walked(name: str) -> Walked:
    alarm, now_ms = Walked(), 0
    for step in STORIES[name][0]:
        if isinstance(step, Signal):
            alarm.hear(step)
            continue
        value, seconds = step
        end_ms = now_ms + round(seconds * 1000)
        alarm.live(now_ms, end_ms, value)
        now_ms = end_ms
    return alarm


@pytest.mark.parametrize("name", STORIES)
def test_a_story(name: str) -> None:
    """What happens brings these states, in this order, and no others."""
    assert walked(name).states == STORIES[name][1].split()


def test_the_stories_walk_every_row() -> None:
    """No row of the table is dead: each is taken in one of the stories above."""
    assert {row for name in STORIES for row in walked(name).rows} == set(TRANSITIONS)


# --- votes and delays ------------------------------------------------------------------------------------------------


def test_health_is_silent() -> None:
    """An hour of good samples: nothing is said."""
    assert told(run(0, 3_600_000, GOOD, 1000))[0] == []


def test_a_lasting_fault_is_pending_with_the_third_bad_sample_and_raised_a_second_later() -> None:
    """Bad from 10.0 s on, ten samples a second: pending at 10.2 s, raised at 11.2 s, once."""
    assert moments(run(0, 9900, GOOD) + run(10_000, 60_000, BAD)) == [(10_200, "pending"), (11_200, "raised")]


def test_three_of_five_suffice() -> None:
    """Every second sample bad on end: of five at most three are, and that is a vote."""
    story = [(t, BAD if i % 2 == 0 else GOOD) for i, (t, _) in enumerate(run(0, 20_000, 0.0))]
    assert moments(story)[0][1] == "pending"
    two_in_five = [(t, BAD if i % 5 in (0, 2) else GOOD) for i, (t, _) in enumerate(run(0, 20_000, 0.0))]
    assert moments(two_in_five) == []


@pytest.mark.parametrize("outliers", [1, 2])
def test_lone_outliers_raise_nothing(outliers: int) -> None:
    """One or two wild samples, 90 times the limit, every few seconds for minutes: no alarm, not even pending."""
    story = []
    for minute in range(20):
        start = minute * 10_000
        story += run(start, start + 9_900, GOOD)
        for i in range(outliers):
            story[-10 - i] = (story[-10 - i][0], 90.0)
    assert moments(story) == []


def test_a_fault_shorter_than_the_delay_is_taken_back() -> None:
    """Bad for 0.8 s: pending, then normal again, never raised."""
    story = run(0, 900, GOOD) + run(1000, 1800, BAD) + run(1900, 10_000, GOOD)
    assert moments(story) == [(1200, "pending"), (2100, "normal")]  # at 2.1 s three of the last five are good


def test_the_delay_starts_anew_after_it_was_taken_back() -> None:
    """Bad, good, bad: the second excursion waits for its own full second."""
    story = run(0, 800, BAD) + run(900, 1800, GOOD) + run(1900, 5000, BAD)
    assert moments(story) == [(200, "pending"), (1100, "normal"), (2100, "pending"), (3100, "raised")]


def test_the_third_short_excursion_raises() -> None:
    """Each votes for 0.6 s, 0.2 to 0.8 s behind its begin; 0.3 s into the third they have lasted 1.5 s together."""
    short = [[*run(t, t + 600, BAD), *run(t + 700, t + 1900, GOOD)] for t in (0, 2000, 4000)]
    taken_back = [(200, "pending"), (900, "normal"), (2200, "pending"), (2900, "normal")]
    assert moments(short[0] + short[1]) == taken_back
    story = [sample for one in short for sample in one]
    assert moments(story) == [*taken_back, (4200, "pending"), (4500, "raised"), (4900, "clearing")]
    onsets_us = [one.change.onset_us for one in Alarm(AlarmSettings(), RECURRING_S).feed(rated(story))]
    assert onsets_us[4:] == [4_000_000, 0, 0]  # once raised, it began with the first of them


def test_short_excursions_far_apart_raise_nothing() -> None:
    """The first of three is forgotten after ten seconds."""
    story = [pair for t in (0, 5000, 10_300) for pair in [*run(t, t + 600, BAD), *run(t + 700, t + 4900, GOOD)]]
    assert "raised" not in [state for _, state in moments(story)]


def test_an_alarm_clears_after_two_low_seconds() -> None:
    """Good from 5.0 s on: low with the third good sample at 5.2 s, cleared at 7.2 s."""
    story = run(0, 4900, BAD) + run(5000, 20_000, GOOD)
    assert moments(story) == [(200, "pending"), (1200, "raised"), (5200, "clearing"), (7200, "returned")]


def test_between_seventy_percent_and_the_limit_an_alarm_stays() -> None:
    """The deadband: 90 % of the limit neither raises an alarm nor lets one go."""
    assert moments(run(0, 60_000, HIGH)) == []
    story = run(0, 4900, BAD) + run(5000, 60_000, HIGH)
    assert moments(story) == [(200, "pending"), (1200, "raised")]


def test_a_value_that_swings_about_the_limit_raises_one_alarm() -> None:
    """Three seconds of fault, then ten minutes between 80 % and 120 % of the limit: one alarm, no chatter."""
    story = run(0, 2900, BAD) + [(t, 1.2 if t // 1000 % 2 else 0.8) for t, _ in run(3000, 600_000, 0.0)]
    assert moments(story) == [(200, "pending"), (1200, "raised")]


def test_a_relapse_while_clearing_is_the_same_alarm() -> None:
    """Low for 1.5 s, then bad again: still raised; the two seconds start anew."""
    story = run(0, 4900, BAD) + run(5000, 6500, GOOD) + run(6600, 8000, BAD) + run(8100, 20_000, GOOD)
    assert moments(story) == [
        (200, "pending"),
        (1200, "raised"),
        (5200, "clearing"),
        (6800, "raised"),
        (8300, "clearing"),
        (10_300, "returned"),
    ]


def test_a_value_in_the_deadband_while_clearing_stops_the_clearing() -> None:
    """Low for a second, then 90 % of the limit: raised as before, and the two seconds start anew."""
    story = run(0, 4900, BAD) + run(5000, 6000, GOOD) + run(6100, 7500, HIGH) + run(7600, 20_000, GOOD)
    assert moments(story)[2:] == [(5200, "clearing"), (6300, "raised"), (7800, "clearing"), (9800, "returned")]


def test_a_value_in_the_deadband_while_pending_takes_it_back() -> None:
    """Bad for 0.3 s, then 90 % of the limit for good: at 0.6 s but two of the last five are bad."""
    assert moments(run(0, 300, BAD) + run(400, 20_000, HIGH)) == [(200, "pending"), (600, "normal")]


def test_two_faults_are_two_alarms() -> None:
    """Each with its own peak: that of the first is forgotten."""
    story = run(0, 5000, 50.0) + run(5100, 20_000, GOOD) + run(20_100, 30_000, BAD)
    raised = [(ms, worst) for ms, _, state, worst in told(story)[0] if state == "raised"]
    assert raised == [(1200, 50.0), (21_300, BAD)]


def test_old_votes_expire() -> None:
    """At one sample in three seconds, those older than five seconds vote no more: three never come together."""
    assert moments(run(0, 100_000, BAD, 3000)) == []
    assert moments(run(0, 100_000, BAD, 2500)) == [(5000, "pending"), (7500, "raised")]
    assert moments(run(0, 100_000, BAD, 2501)) == []


def test_bad_samples_before_a_long_silence_do_not_count_after_it() -> None:
    """Two bad ones, a minute of nothing, one bad one: no vote."""
    assert moments([(0, BAD), (100, BAD), (60_000, BAD), (60_100, GOOD), (60_200, GOOD), (60_300, GOOD)]) == []


def test_a_pending_alarm_is_taken_back_where_the_votes_have_gone() -> None:
    """Silence is no second of fault: the first sample behind it alone cannot raise what was pending."""
    story = [*run(0, 200, BAD), (60_000, BAD), (60_100, GOOD)]
    assert moments(story) == [(200, "pending"), (60_000, "normal")]


def test_the_peak_is_the_largest_of_the_excursion() -> None:
    """Statement with what came with it, from the samples that made it pending on."""
    story = [(0, 2.0), (100, 9.0), (200, 3.0), *run(300, 1100, BAD), (1200, 30.0), *run(1300, 5000, BAD)]
    assert [(state, worst) for _, _, state, worst in told(story)[0]] == [("pending", 9.0), ("raised", 30.0)]
    assert told(story)[1].worst.value == 30.0


def test_an_outlier_from_before_the_window_is_not_the_peak() -> None:
    """90 degrees a minute ago, at a slow rate still among the last five samples, belong to no excursion of now."""
    story = [(0, 90.0), (60_000, BAD), (60_100, BAD), (60_200, BAD)]
    assert [(state, worst) for _, _, state, worst in told(story)[0]] == [("pending", BAD)]


def test_a_sample_that_comes_late_does_not_shorten_the_delay() -> None:
    """Reordered by 4.7 s: the alarm still waits its full second of fault."""
    story = [(9000, BAD), (9100, BAD), (4400, BAD), (9200, BAD), (9300, BAD), *run(9400, 12_000, BAD)]
    raised = [ms for ms, state in moments(story) if state == "raised"]
    assert raised[0] >= 10_000


def test_delays_and_votes_are_settings() -> None:
    """Two of three within the window, half a second on, one second off."""
    rules = AlarmSettings(bad_samples=2, counted_samples=3, on_delay_s=0.5, off_delay_s=1.0)
    story = run(0, 900, GOOD) + run(1000, 4900, BAD) + run(5000, 9000, GOOD)
    assert moments(story, rules) == [(1100, "pending"), (1600, "raised"), (5100, "clearing"), (6100, "returned")]


def test_without_delays_an_alarm_is_raised_and_cleared_at_once() -> None:
    """A delay of zero is allowed: pending and raised come with one sample."""
    story = run(0, 500, BAD) + run(600, 2000, GOOD)
    expected = [(200, "pending"), (200, "raised"), (800, "clearing"), (800, "returned")]
    assert moments(story, AlarmSettings(on_delay_s=0.0, off_delay_s=0.0)) == expected


_stories = st.lists(
    st.tuples(
        st.sampled_from([0, 40, 100, 500, 2600, 9000, -200, -4700]),
        st.sampled_from([GOOD, HIGH, BAD, 7.0]),
        st.integers(1, 12),
    ),
    max_size=30,
)


@pytest.mark.slow
@searched(300)
@given(_stories, st.lists(st.integers(0, 200), max_size=10))
def test_the_cut_into_batches_changes_nothing(parts: list[tuple[int, float, int]], cuts: list[int]) -> None:
    """Whole, in pieces, or sample by sample: the same changes at the same samples, with the same peaks."""
    story, now = [], 10_000
    for step, value, count in parts:
        for _ in range(count):
            now += step
            story.append((now, value))
    whole, alarm = told(story)
    for pieces in (sorted(min(c, len(story)) for c in cuts), list(range(1, len(story)))):
        changes, in_pieces = told(story, pieces)
        assert changes == whole
        assert in_pieces.state is alarm.state
        if alarm.state not in (State.NORMAL, State.RETURNED):
            assert in_pieces.worst.value == alarm.worst.value


@pytest.mark.slow
@searched(200)
@given(_stories)
def test_states_follow_one_another_as_the_standard_has_them(parts: list[tuple[int, float, int]]) -> None:
    """Never raised unless it was pending, nor gone unless it was clearing, never before its delay, and gone it stays
    latched: nobody acknowledges here.
    """
    story, now = [], 10_000
    for step, value, count in parts:
        for _ in range(count):
            now += abs(step)
            story.append((now, value))
    changes, _ = told(story)
    allowed = {
        ("normal", "pending"),
        ("pending", "normal"),
        ("pending", "raised"),
        ("raised", "clearing"),
        ("clearing", "raised"),
        ("clearing", "returned"),
        ("returned", "returned_pending"),
        ("returned_pending", "returned"),
        ("returned_pending", "raised"),
    }
    assert all((before, state) in allowed for _, before, state, _ in changes)
    assert all(a[2] == b[1] for a, b in pairwise(changes))
    for (pending_ms, _, state, _), (ms, _, following, _) in pairwise(changes):
        if state.endswith("pending") and following == "raised":
            assert ms - pending_ms >= 1000
        if (state, following) == ("clearing", "returned"):
            assert ms - pending_ms >= 2000


@pytest.mark.parametrize("forgotten", [False, True])
def test_bad_samples_that_are_forgotten_raise_nothing(forgotten: bool) -> None:
    """Three bad ones within 0.5 s, and a good one 1.1 s behind the last: the third vote and the on-delay raise it."""
    alarm = Alarm(RULES)
    alarm.feed(rated([(1000, BAD), (1250, BAD), (1500, BAD)]))
    states = [alarm.state]
    if forgotten:
        alarm.forget_samples()
    for more in ([(2600, GOOD)], [(2700 + 100 * i, BAD) for i in range(13)]):  # those behind count as ever
        alarm.feed(rated(more))
        states.append(alarm.state)
    assert states == [State.PENDING, State.NORMAL if forgotten else State.RAISED, State.RAISED]
