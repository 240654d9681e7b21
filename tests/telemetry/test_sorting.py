"""Whose frames are whose, told of frames made by hand: stable, numbered through, with the link's time and window."""

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.mavlink.scan import FRAME
from gcs_bridge.telemetry.messages import KIND, OTHER, TRANSFER, TRANSFERS
from gcs_bridge.telemetry.sorting import FrameSorter

START_US = 1_700_000_000_000_000
S = 1_000_000
MESSAGES = ["ATTITUDE", "HEARTBEAT", "RAW_IMU", "LOG_DATA", "MISSION_COUNT", "VFR_HUD"]  # the last one is not used
NO_BYTES = np.empty(0, np.uint8)

Sent = tuple[int, int, str]  # system, component, message


def frames_of(sent: list[Sent], t_rx_us: list[int] | None = None) -> np.ndarray:
    frames = np.zeros(len(sent), FRAME)
    for frame, (sysid, compid, name) in zip(frames, sent, strict=True):
        frame["sysid"], frame["compid"], frame["msgid"] = sysid, compid, load_dialect()[name].msgid
    frames["t_rx_us"] = START_US if t_rx_us is None else t_rx_us
    return frames


@pytest.mark.slow
@given(st.lists(st.tuples(st.integers(1, 3), st.integers(0, 2), st.sampled_from(MESSAGES)), min_size=1, max_size=60))
def test_each_component_has_its_frames_in_order_of_arrival_and_by_message(sent: list[Sent]) -> None:
    """Against plain lists: every frame is somebody's, once, and none has changed places with one of its own."""
    batch = FrameSorter(load_dialect()).sort(NO_BYTES, frames_of(sent))
    mine, of_kind = defaultdict(list), defaultdict(list)
    for row, (sysid, compid, name) in enumerate(sent):
        mine[sysid, compid].append(row)
        of_kind[sysid, compid, KIND.get(name, TRANSFER if name in TRANSFERS else OTHER)].append(row)
    assert {share.address: batch.frame_indices(share).tolist() for share in batch.shares} == mine
    for share in batch.shares:
        for kind in range(OTHER + 1):
            assert batch.rows(share, kind).tolist() == of_kind[*share.address, kind]
            assert share.counts[kind] == len(of_kind[*share.address, kind])


def test_duplicates_and_other_systems_are_nobodys() -> None:
    """They keep their number on the link all the same."""
    frames = frames_of([(1, 1, "ATTITUDE"), (1, 1, "ATTITUDE"), (2, 1, "ATTITUDE"), (1, 1, "HEARTBEAT")])
    frames["duplicate"][1] = 1
    sorter = FrameSorter(load_dialect(), sysid=1)
    (share,) = (batch := sorter.sort(NO_BYTES, frames)).shares
    assert (share.address, batch.frame_indices(share).tolist()) == ((1, 1), [0, 3])
    assert sorter.frames == 4
    assert sorter.sort(NO_BYTES, frames).first == 4


def test_what_others_ask_of_the_one_system_is_told_of_it() -> None:
    """The station's request is theirs to know; its other frames are nobody's."""
    sent = [(1, 1, "ATTITUDE"), (255, 190, "HEARTBEAT"), (255, 190, "REQUEST_DATA_STREAM"), (2, 1, "ATTITUDE")]
    batch = FrameSorter(load_dialect(), sysid=1).sort(NO_BYTES, frames_of(sent))
    assert {share.address: batch.frame_indices(share).tolist() for share in batch.shares} == {
        (1, 1): [0],
        (255, 190): [2],
    }


@pytest.mark.parametrize("cut", [False, True])
def test_a_silence_of_everything_counts_for_little(cut: bool) -> None:
    """A second and a half: it may be a receiver that does not listen; time that is known to pass counts whole."""
    seconds = [0.0, 0.5, 1.5, 11.5, 11.6, 9.0, 12.0]
    frames = frames_of([(1, 1, "ATTITUDE")] * len(seconds), [START_US + round(s * S) for s in seconds])
    sorter = FrameSorter(load_dialect())
    parts = [frames[i : i + 1] for i in range(len(frames))] if cut else [frames]
    heard = [t / S for part in parts for t in sorter.sort(NO_BYTES, np.ascontiguousarray(part)).clock.heard_us.tolist()]
    assert heard == pytest.approx([0, 0.5, 1.5, 3.0, 3.1, 3.1, 3.5])
    clock = sorter.pass_time(START_US + 22 * S)
    assert clock is not None
    assert clock.heard_us.tolist() == [3.5 * S + 10 * S]


def test_thousands_of_components_have_their_share() -> None:
    """More than anybody expected, and once more: each has its one frame, and the next batch begins anew."""
    sent = [(1 + i % 250, i // 250, "HEARTBEAT") for i in range(5000)]
    sorter = FrameSorter(load_dialect())
    for first in (0, 5000):
        batch = sorter.sort(NO_BYTES, frames_of(sent))
        assert [share.address for share in batch.shares] == [one[:2] for one in sent]
        assert [batch.frame_indices(share).tolist() for share in batch.shares] == [[first + i] for i in range(5000)]
    (share,) = sorter.sort(NO_BYTES, frames_of([(7, 7, "ATTITUDE")])).shares
    assert (share.address, share.counts[KIND["ATTITUDE"]]) == ((7, 7), 1)


def test_a_share_tells_what_was_heard_last() -> None:
    """The losses and the receive time of its own last frame, not of the link's."""
    frames = frames_of([(1, 1, "ATTITUDE"), (2, 1, "ATTITUDE")], [START_US, START_US + S])
    frames["lost"] = [3, 8]
    first, second = FrameSorter(load_dialect()).sort(NO_BYTES, frames).shares
    assert (first.lost, first.heard_us, second.lost, second.heard_us) == (3, START_US, 8, START_US + S)


@pytest.mark.parametrize("cut", [False, True])
def test_the_links_time_does_not_run_back_unless_its_clock_is_set(cut: bool) -> None:
    """Two seconds back is one record's fault, eleven are the clock's; the window counts from the first known time."""
    seconds = [-1, 0, 5, 3, 6, 20, 8, 9]
    t_rx_us = [-1 if s < 0 else START_US + s * S for s in seconds]
    sorter = FrameSorter(load_dialect(), window_s=(3.0, 9.0))
    frames = frames_of([(1, 1, "ATTITUDE")] * len(seconds), t_rx_us)
    parts = [frames[i : i + 1] for i in range(len(frames))] if cut else [frames]
    batches = [sorter.sort(NO_BYTES, np.ascontiguousarray(part)) for part in parts]
    latest = [t for batch in batches for t in batch.clock.latest_rx_us.tolist()]
    assert [(t - START_US) / S if t >= 0 else -1 for t in latest] == [-1, 0, 5, 5, 6, 20, 8, 9]
    inside = [bool(one) for batch in batches for one in batch.in_window]
    assert inside == [False, False, True, True, True, False, True, False]
    assert (sorter.inside, sorter.start_us, sorter.latest_rx_us) == (4, START_US, START_US + 9 * S)


@pytest.mark.parametrize("step_s", [3600, -3600, -2])
def test_a_clock_that_is_known_to_be_set_passes_no_time(step_s: int) -> None:
    """The link's time goes on from where the clock is; in what was heard of it nothing is missing or added."""
    sorter = FrameSorter(load_dialect())
    sorter.set_clock(START_US - 99 * S)  # before the first frame nobody knows a time
    assert sorter.latest_rx_us == -1
    (before_us,) = sorter.sort(NO_BYTES, frames_of([(1, 1, "ATTITUDE")], [START_US])).clock.heard_us.tolist()
    at_us = START_US + step_s * S
    sorter.set_clock(at_us)
    (after_us,) = sorter.sort(NO_BYTES, frames_of([(1, 1, "ATTITUDE")], [at_us])).clock.heard_us.tolist()
    assert after_us == before_us
    clock = sorter.pass_time(at_us + S)
    assert clock is not None
    assert (clock.latest_rx_us.tolist(), clock.heard_us.tolist()) == ([at_us + S], [before_us + S])


def test_time_that_passes_without_a_frame_belongs_to_the_next() -> None:
    """The clock of a silent link has the index of the frame to come; time that is no later is no news."""
    sorter = FrameSorter(load_dialect())
    sorter.sort(NO_BYTES, frames_of([(1, 1, "ATTITUDE")] * 3))
    clock = sorter.pass_time(START_US + S)
    assert clock is not None
    assert (clock.frame_index.tolist(), clock.latest_rx_us.tolist()) == ([3], [START_US + S])
    assert sorter.pass_time(START_US + S) is None
