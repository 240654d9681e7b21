"""Whether a vehicle is there, told as stories: lost when the link was heard for five seconds behind its last frame."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.telemetry.clocks import FRAME_INDEX, T_BOOT_US
from gcs_bridge.telemetry.link_clock import HEARD_US, NEVER_US, LinkClock
from gcs_bridge.telemetry.vehicle_presence import LOST_AFTER_US, Presence

START_US = 1_700_000_000_000_000
OWN, FOREIGN = True, False

Story = list[tuple[bool, int]]  # whose frame, receive ms
UNTOLD = -1


def told(story: Story, cuts: tuple[int, ...] = (), boot_ms: Sequence[int] = ()) -> list[tuple[int, bool, int]]:
    """(frame, lost, ms) of each change; `boot_ms` of each frame, UNTOLD: it carries no time, as all without these."""
    presence, found = Presence(), []
    rx = np.array([START_US + 1000 * ms for _, ms in story], np.int64)
    heard = np.cumsum(np.minimum(np.diff(rx, prepend=rx[:1]), HEARD_US))
    for lo, hi in pairwise([0, *cuts, len(story)]):
        if lo < hi:
            own = np.array([i for i in range(lo, hi) if story[i][0]], np.int64)
            of = [i for i in own.tolist() if boot_ms and boot_ms[i] != UNTOLD]
            timed = np.zeros((8, len(of)), np.int64)
            timed[FRAME_INDEX], timed[T_BOOT_US] = of, [1000 * boot_ms[i] for i in of]
            found += list(presence.take(own, LinkClock(np.arange(lo, hi), rx[lo:hi], heard[lo:hi]), timed))
    return [(one.frame_index, one.lost, (one.t_rx_us - START_US) // 1000) for one in found]


def test_a_vehicle_that_speaks_is_there() -> None:
    """A frame each five seconds is just enough."""
    assert told([(OWN, ms) for ms in range(0, 60_000, 5000)]) == []


def test_nobody_is_lost_before_it_was_heard() -> None:
    """A link on which others have long been."""
    assert told([(FOREIGN, ms) for ms in range(0, 60_000, 1000)]) == []


def test_it_is_lost_with_the_first_frame_behind_five_seconds_and_back_with_its_own() -> None:
    """Told once, at the moment the five seconds were over."""
    foreign = [(FOREIGN, ms) for ms in range(500, 9500, 500)]
    story = [(OWN, 0), *foreign, (OWN, 9500), (FOREIGN, 10_000)]
    assert story[11] == (FOREIGN, 5500)
    assert told(story) == [(11, True, 5000), (19, False, 9500)]


def behind_a_gap(gap_ms: int, passed_ms: int, *, between: int = 0) -> tuple[Story, list[int]]:
    """Ten frames a second, then nothing of anybody, in which the vehicle's clock goes on by so much.

    `between`: frames that carry no time and come before the first that does.
    """
    ms = [*range(0, 1000, 100), *range(900 + gap_ms, 3000 + gap_ms, 100)]
    boot_ms = [t if t < 1000 else t - gap_ms + passed_ms for t in ms]
    boot_ms[10 : 10 + between] = [UNTOLD] * between
    return [(OWN, t) for t in ms], boot_ms


@pytest.mark.parametrize("between", [0, 1, 12])
@pytest.mark.parametrize("gap_ms", [6000, 10_000, 600_000])
def test_where_the_link_was_silent_its_own_clock_tells(gap_ms: int, between: int) -> None:
    """Its clock went on as long: it was lost, and is back. It went on by 100 ms: the receiver did not listen."""
    story, boot_ms = behind_a_gap(gap_ms, gap_ms, between=between)
    assert told(story, boot_ms=boot_ms) == [(10 + between, True, 5900), (10 + between, False, 900 + gap_ms)]
    story, boot_ms = behind_a_gap(gap_ms, 100, between=between)
    assert told(story, boot_ms=boot_ms) == []


def test_a_vehicle_that_tells_no_time_was_lost() -> None:
    """Five seconds behind the silence nothing else can be told."""
    story = [(OWN, ms) for ms in (0, *range(8000, 15_000, 500))]
    assert told(story) == [(12, True, 5000), (12, False, 8000)]


def test_many_losses_in_one_batch_are_all_told() -> None:
    """More than one call has room for."""
    once = [(OWN, 0), *((FOREIGN, ms) for ms in range(500, 7000, 500))]
    assert len(told([(own, ms + 7000 * i) for i in range(100) for own, ms in once])) == 2 * 99 + 1


@pytest.mark.slow
@given(st.lists(st.tuples(st.booleans(), st.sampled_from([0, 40, 2000, 5001])), min_size=1, max_size=60), st.data())
def test_the_cut_into_batches_changes_nothing(steps: list[tuple[bool, int]], data: st.DataObject) -> None:
    """In any pieces, and frame by frame."""
    story: Story = [(own, int(ms)) for (own, _), ms in zip(steps, np.cumsum([s for _, s in steps]), strict=True)]
    cuts = tuple(sorted(data.draw(st.lists(st.integers(0, len(story)), max_size=8))))
    passed = data.draw(st.lists(st.sampled_from([0, 40, 5001]), min_size=len(story), max_size=len(story)))
    boot_ms = [UNTOLD if data.draw(st.booleans()) else int(ms) for ms in np.cumsum(passed)]
    whole = told(story, boot_ms=boot_ms)
    assert told(story, cuts, boot_ms) == whole
    assert told(story, tuple(range(1, len(story))), boot_ms) == whole


@pytest.mark.parametrize("heard_ms", [0, 777])
def test_before_its_deadline_nobody_need_ask(heard_ms: int) -> None:
    """Never before it was heard, then five seconds behind the last frame, and never while it is lost."""
    presence = Presence()
    assert presence.due_us == NEVER_US
    rx_us, heard_us = START_US + 1000 * heard_ms, 1000 * heard_ms
    own, none = np.array([0]), np.empty(0, np.int64)
    assert list(presence.take(own, LinkClock(np.array([0]), np.array([rx_us]), np.array([heard_us])))) == []
    assert presence.due_us == heard_us + LOST_AFTER_US + 1
    passed = np.array([LOST_AFTER_US + 1])
    (lost,) = presence.take(none, LinkClock(np.array([1]), rx_us + passed, heard_us + passed))
    assert (lost.lost, presence.due_us) == (True, NEVER_US)
