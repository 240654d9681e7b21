"""Whether a vehicle is there, told as stories: lost five seconds behind its last frame, by the link's clock."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock
from gcs_bridge.telemetry.vehicle_presence import LOST_AFTER_US, Presence

START_US = 1_700_000_000_000_000
OWN, FOREIGN = True, False

Story = list[tuple[bool, int]]  # whose frame, receive ms


def told(story: Story, cuts: tuple[int, ...] = ()) -> list[tuple[int, bool, int]]:
    """(frame, lost, ms) of each change."""
    presence, found = Presence(), []
    rx = np.array([START_US + 1000 * ms for _, ms in story], np.int64)
    for lo, hi in pairwise([0, *cuts, len(story)]):
        if lo < hi:
            own = np.array([i for i in range(lo, hi) if story[i][0]], np.int64)
            found += list(presence.take(own, LinkClock(np.arange(lo, hi), rx[lo:hi])))
    return [(one.frame_index, one.lost, (one.t_rx_us - START_US) // 1000) for one in found]


def test_a_vehicle_that_speaks_is_there() -> None:
    """A frame each five seconds is just enough."""
    assert told([(OWN, ms) for ms in range(0, 60_000, 5000)]) == []


def test_nobody_is_lost_before_it_was_heard() -> None:
    """A link on which others have long been."""
    assert told([(FOREIGN, ms) for ms in range(0, 60_000, 1000)]) == []


def test_it_is_lost_with_the_first_frame_behind_five_seconds_and_back_with_its_own() -> None:
    """Told once, at the moment the five seconds were over."""
    story = [(OWN, 0), (FOREIGN, 5000), (FOREIGN, 5300), (FOREIGN, 9000), (OWN, 9500), (FOREIGN, 14_000)]
    assert told(story) == [(2, True, 5000), (4, False, 9500)]


def test_its_own_frame_tells_that_it_was_lost_where_the_link_was_silent() -> None:
    """Lost and back with one frame."""
    assert told([(OWN, 0), (OWN, 8000)]) == [(1, True, 5000), (1, False, 8000)]


def test_many_losses_in_one_batch_are_all_told() -> None:
    """More than one call has room for."""
    assert len(told([(OWN, 8000 * i) for i in range(100)])) == 2 * 99


@given(st.lists(st.tuples(st.booleans(), st.sampled_from([0, 40, 2000, 5001])), min_size=1, max_size=60), st.data())
def test_the_cut_into_batches_changes_nothing(steps: list[tuple[bool, int]], data: st.DataObject) -> None:
    """In any pieces, and frame by frame."""
    story: Story = [(own, int(ms)) for (own, _), ms in zip(steps, np.cumsum([s for _, s in steps]), strict=True)]
    cuts = tuple(sorted(data.draw(st.lists(st.integers(0, len(story)), max_size=8))))
    whole = told(story)
    assert told(story, cuts) == whole
    assert told(story, tuple(range(1, len(story)))) == whole


@pytest.mark.parametrize("heard_ms", [0, 777])
def test_before_its_deadline_nobody_need_ask(heard_ms: int) -> None:
    """Never before it was heard, then five seconds behind the last frame, and never while it is lost."""
    presence = Presence()
    assert presence.due_us == NEVER_US
    heard_us = START_US + 1000 * heard_ms
    own, none = np.array([0]), np.empty(0, np.int64)
    assert list(presence.take(own, LinkClock(np.array([0]), np.array([heard_us])))) == []
    assert presence.due_us == heard_us + LOST_AFTER_US + 1
    (lost,) = presence.take(none, LinkClock(np.array([1]), np.array([heard_us + LOST_AFTER_US + 1])))
    assert (lost.lost, presence.due_us) == (True, NEVER_US)
