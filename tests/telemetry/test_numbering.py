"""What sequence numbers are worth, told as stories of links."""

import random
from collections.abc import Iterable

import numpy as np
import pytest

from gcs_bridge.telemetry.numbering import Numbering
from tests.helpers.everyday import one_in


def numbered(seqs: Iterable[int], cut: int = 10_000) -> Numbering:
    numbers = np.array([seq % 256 for seq in seqs], np.uint8)
    kept = Numbering()
    for start in range(0, len(numbers), cut):
        kept.add(numbers[start : start + cut])
    return kept


def lossy(share: float, count: int = 5000, seed: int = 1) -> list[int]:
    dice = random.Random(seed)
    return [seq for seq in range(count) if dice.random() >= share]


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.6])
def test_losses_are_losses(share: float) -> None:
    """However many they are: one link, numbered."""
    kept = numbered(lossy(share))
    assert (kept.is_of_several, kept.stands) == (False, False)


def test_frames_that_come_late_are_of_one_link() -> None:
    """Each tenth one changes places with the one before it."""
    seqs = list(range(5000))
    for at in range(10, len(seqs), 10):
        seqs[at - 1], seqs[at] = seqs[at], seqs[at - 1]
    assert not numbered(seqs).is_of_several


def test_a_restart_is_of_one_link() -> None:
    """The numbers begin anew, some times."""
    assert not numbered([*range(300), *range(700), *range(90), *range(500)]).is_of_several


def test_outages_are_of_one_link() -> None:
    """A hundred times nothing comes for a while: each fourth or so leads back to numbers that came just before."""
    dice, seq = random.Random(5), 0
    seqs: list[int] = []
    for _ in range(100):
        seqs += range(seq, seq + 80)
        seq += 80 + dice.randrange(20, 5000)
    assert not numbered(seqs).is_of_several


@pytest.mark.parametrize("cut", one_in(2, [10_000, 7, 1]))
@pytest.mark.parametrize("burst", [1, 5, 40])
def test_two_links_that_are_merged(burst: int, cut: int) -> None:
    """They come in turn, one frame or one burst each, and some are lost: however the bytes were cut."""
    one, other = lossy(0.02, 2000, 1), [seq + 100 for seq in lossy(0.02, 2000, 2)]
    merged = [seq for at in range(0, 1900, burst) for of in (one, other) for seq in of[at : at + burst]]
    assert numbered(merged, cut).is_of_several


def test_a_sender_that_numbers_nothing() -> None:
    """All frames have the number 0."""
    assert numbered([0] * 100).stands
    assert not numbered(range(100)).stands
