"""Which streams are alive, told as stories: deadlines worked by hand, and no cut into batches matters."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.settings import StreamSettings
from gcs_bridge.telemetry.link_clock import HEARD_US, NEVER_US, LinkClock
from gcs_bridge.telemetry.stream_liveness import OTHER, Liveness, StreamChange, Timeline
from tests.helpers.everyday import searched

START_US = 1_700_000_000_000_000
EULER, QUATERNION = 0, 1
FOREIGN = 3  # a frame of somebody else on the link

Message = tuple[int, int, int]  # what, boot ms (any for FOREIGN), receive ms


def told(
    story: Sequence[Message], cuts: Sequence[int] = (), period_ms: int = 100
) -> tuple[list[StreamChange], Liveness]:
    """What the vehicle's streams do while the link's frames come, cut into batches as the monitor cuts them."""
    liveness = Liveness(StreamSettings())  # five periods, two seconds at the least
    turns: list[StreamChange] = []
    rx = np.maximum.accumulate([START_US + 1000 * m[2] for m in story]) if story else np.empty(0, np.int64)
    heard = np.cumsum(np.minimum(np.diff(rx, prepend=rx[:1]), HEARD_US))
    for lo, hi in pairwise([0, *cuts, len(story)]):
        if lo == hi:
            continue
        frame_index = np.arange(lo, hi)
        clock = LinkClock(frame_index, rx[lo:hi], heard[lo:hi])
        mine = np.array([i for i in range(lo, hi) if story[i][0] != FOREIGN], np.int64)
        if len(mine):
            what = np.array([story[i][0] for i in mine])
            period = np.where(what == OTHER, -1, 1000 * period_ms)
            t_us = np.array([1000 * story[i][1] for i in mine])
            line = Timeline(
                frame_index=mine,
                stream=what,
                t_boot_us=t_us,
                t_rx_us=rx[mine],
                heard_us=heard[mine],
                period_us=period,
                rx_period_us=period,
                lost=np.zeros_like(mine),
                received=mine,
            )
            turns += liveness.take(line, clock)
        turns += liveness.pass_silence(clock)
    return turns, liveness


def moments(story: Sequence[Message], *, period_ms: int = 100) -> list[tuple[str, int, int]]:
    """(what, stream, boot ms) of each turn."""
    return [(turn.what, turn.stream, turn.t_boot_us // 1000) for turn in told(story, period_ms=period_ms)[0]]


def both(first_ms: int, last_ms: int, step_ms: int = 100) -> list[Message]:
    return [(k, t, t) for t in range(first_ms, last_ms + 1, step_ms) for k in (EULER, QUATERNION)]


STARTED = [("started", EULER, 0), ("started", QUATERNION, 0)]


def test_two_steady_streams_start_and_nothing_else_happens() -> None:
    """Ten minutes at 10 Hz: both alive from the first to the last sample."""
    turns, liveness = told(both(0, 600_000))
    assert [(turn.what, turn.stream, turn.t_boot_us) for turn in turns] == STARTED
    assert liveness.both_alive_us == 600_000_000


def test_a_stream_that_stops_is_stale_two_seconds_later() -> None:
    """The event carries the moment at which the deadline passed; both were alive until its last sample."""
    story = both(0, 5000) + [(EULER, t, t) for t in range(5100, 9000, 100)]
    turns, liveness = told(story)
    assert moments(story) == [*STARTED, ("stale", QUATERNION, 7000)]
    assert liveness.both_alive_us == 5_000_000
    assert story[turns[2].frame_index] == (EULER, 7100, 7100)  # noticed with the first message behind it


def test_a_slow_stream_may_be_silent_for_five_of_its_periods() -> None:
    """At one sample a second five seconds are allowed, not two."""
    story = both(0, 10_000, 1000) + [(EULER, t, t) for t in range(11_000, 17_000, 1000)]
    assert moments(story, period_ms=1000) == [*STARTED, ("stale", QUATERNION, 15_000)]


def test_a_stream_that_resumes_is_alive_again() -> None:
    """The silence between is no time in which both were alive."""
    story = both(0, 5000) + [(EULER, t, t) for t in range(5100, 9000, 100)] + both(9000, 10_000)
    turns, liveness = told(story)
    assert moments(story)[2:] == [("stale", QUATERNION, 7000), ("resumed", QUATERNION, 9000)]
    assert liveness.both_alive_us == 6_000_000
    assert len(turns) == 4


def test_a_stream_that_never_came_is_missing_after_two_seconds() -> None:
    """Statement once: a vehicle that sends no quaternion."""
    assert moments([(EULER, t, t) for t in range(0, 60_000, 100)]) == [
        ("started", EULER, 0),
        ("missing", QUATERNION, 2000),
    ]


def test_other_messages_keep_the_vehicles_time() -> None:
    """Both attitudes stop and SYSTEM_TIME goes on: stale on the vehicle's own clock."""
    story = both(0, 5000) + [(OTHER, t, t) for t in range(5500, 9000, 500)]
    assert moments(story)[2:] == [("stale", EULER, 7000), ("stale", QUATERNION, 7000)]


def test_where_all_of_a_vehicle_stops_the_link_tells() -> None:
    """Nothing more of this vehicle while another one's frames come: stale two seconds after the last, as received."""
    story = both(0, 5000) + [(FOREIGN, 0, t) for t in range(5050, 9000, 100)]
    turns, _ = told(story)
    assert [(turn.what, turn.stream) for turn in turns[2:]] == [("stale", EULER), ("stale", QUATERNION)]
    assert [turn.t_boot_us for turn in turns[2:]] == [7_000_000, 7_000_000]
    assert story[turns[2].frame_index] == (FOREIGN, 0, 7050)


def test_a_link_that_falls_silent_is_noticed_by_what_comes_next() -> None:
    """Ten seconds of nothing at all, then the vehicle again, its clock ten seconds on."""
    story = both(0, 5000) + both(15_000, 16_000)
    assert moments(story)[2:] == [
        ("stale", EULER, 7000),
        ("stale", QUATERNION, 7000),
        ("resumed", EULER, 15_000),
        ("resumed", QUATERNION, 15_000),
    ]
    assert told(story)[1].both_alive_us == 6_000_000


@pytest.mark.parametrize("pause_ms", [3000, 10_000, 600_000])
@pytest.mark.parametrize("first", [EULER, FOREIGN])
def test_a_receiver_that_pauses_is_nobodys_silence(pause_ms: int, first: int) -> None:
    """Nothing of anybody, and then the vehicle goes on 100 ms later by its own clock: no stream was silent."""
    behind = [(what, t, t + pause_ms) for what, t, _ in both(5100, 9000)]
    story = [*both(0, 5000), (first, 5050, 5050 + pause_ms), *behind]
    turns, liveness = told(story)
    assert [(turn.what, turn.t_boot_us) for turn in turns[2:]] == [("paused", 1000 * story[turns[2].frame_index][1])]
    assert turns[2].silent_us == pytest.approx(1000 * pause_ms, abs=100_000)
    assert liveness.both_alive_us == 9_000_000


def test_half_of_a_silence_may_be_the_receivers() -> None:
    """Ten seconds of nothing, in which the vehicle's clock went on by four: it was silent, and the receiver paused."""
    behind = [(what, t, t + 6000) for what, t, _ in both(9000, 12_000)]
    turns, _ = told(both(0, 5000) + behind)
    whats = [turn.what for turn in turns[2:]]
    assert whats == ["paused", "stale", "stale", "resumed", "resumed"]
    assert turns[2].silent_us == 6_000_000


def test_times_that_stand_still_are_none() -> None:
    """Samples go on with the time of one moment: stale two seconds later, resumed when it goes on."""
    stuck = [(what, 5000, t) for what, t, _ in both(5100, 12_000)]
    turns, liveness = told(both(0, 5000) + stuck + both(12_100, 13_000))
    assert [(turn.what, turn.stream, turn.t_boot_us // 1000) for turn in turns[2:]] == [
        ("stands", EULER, 5000),
        ("stands", QUATERNION, 5000),
        ("resumed", EULER, 12_100),
        ("resumed", QUATERNION, 12_100),
    ]
    assert [story_ms for turn in turns[2:4] for story_ms in [(both(0, 5000) + stuck)[turn.frame_index][2]]] == [
        7100
    ] * 2
    assert liveness.both_alive_us == 5_900_000


def test_samples_that_come_late_within_the_deadline_are_no_silence() -> None:
    """Reordered by 1.5 s: nobody was away."""
    story = both(0, 20_000)
    for i in range(10, len(story) - 40, 37):
        what, t, _ = story[i]
        story[i] = (what, max(t - 1500, 0), t)
    assert moments(story) == STARTED


def test_many_changes_in_one_batch_are_all_told() -> None:
    """A stream that stops for three seconds forty times: more than one call has room for."""
    story: list[Message] = []
    for begin in range(0, 240_000, 6000):
        story += both(begin, begin + 2000) + [(EULER, t, t) for t in range(begin + 2100, begin + 6000, 100)]
    whats = [turn.what for turn in told(story)[0]]
    assert whats == ["started", "started", *["stale", "resumed"] * 39, "stale"]


def test_before_its_deadline_nobody_need_ask() -> None:
    """Time alone changes nothing until two seconds behind the last message, and then never again."""
    _, liveness = told(both(0, 5000))
    due_us = 5_000_000 + 2_000_000 + 1
    assert liveness.due_us == due_us
    at = np.array([1000])
    for heard_us, whats in ((due_us - 1, []), (due_us, ["stale"] * 2)):
        passed = LinkClock(at, START_US + np.array([heard_us]), np.array([heard_us]))
        assert [change.what for change in liveness.pass_silence(passed)] == whats
    assert liveness.due_us == NEVER_US
    assert told([])[1].due_us == NEVER_US


def test_nothing_at_all_is_nothing() -> None:
    """No message, no turn, no time."""
    turns, liveness = told([])
    assert (turns, liveness.both_alive_us, liveness.both_alive) == ([], 0, False)


_steps = st.lists(
    st.tuples(
        st.sampled_from([EULER, QUATERNION, OTHER, FOREIGN]),
        st.sampled_from([0, 40, 100, 900, 1900, 2100, 6000]),  # both clocks go on by this
        st.sampled_from([0, 0, 0, 0, -500, -1900, -4700]),  # this one came so much too late
        st.sampled_from([0, 0, 0, 2500, 7000]),  # only the receive time goes on by this
        st.integers(1, 6),
    ),
    max_size=40,
)


@pytest.mark.slow
@searched(400)
@given(_steps, st.lists(st.integers(0, 240), max_size=10), st.sampled_from([40, 100, 700]))
def test_the_cut_into_batches_changes_nothing(
    steps: list[tuple[int, int, int, int, int]], cuts: list[int], period_ms: int
) -> None:
    """Whole, in pieces, or frame by frame: the same turns at the same times, the same time alive."""
    story: list[Message] = []
    now, rx = 10_000, 0
    for what, step, late, wait, count in steps:
        rx += wait
        for _ in range(count):
            now, rx = now + step, rx + step
            story.append((what, now + late, rx))
    whole, liveness = told(story, period_ms=period_ms)
    for pieces in (sorted(min(c, len(story)) for c in cuts), list(range(1, len(story)))):
        turns, in_pieces = told(story, pieces, period_ms)
        assert turns == whole
        assert in_pieces.both_alive_us == liveness.both_alive_us
        assert in_pieces.both_alive == liveness.both_alive
