"""What was undone in batches, and what of it holds for all of them."""

import numpy as np
import pytest

from gcs_bridge.expected.corrected import Corrected
from gcs_bridge.expected.correction import NOTHING, PITCH_TRIM, TRIM_FITTED, UNSURE, Correction

TRIM, VIEW = Correction(pitch_rad=0.05), Correction(view_rad=np.pi / 2)


def corrected(*applied: int, corrections: tuple[Correction, ...] = (NOTHING,), bits: tuple[int, ...] = ()) -> Corrected:
    n = len(applied)
    return Corrected(
        frame_index=np.arange(n),
        q_nb=np.zeros((n, 4)),
        causes=np.zeros(n, np.uint8),
        open=np.array(bits or (0,) * n, np.uint8),
        applied=np.array(applied, np.int64),
        corrections=corrections,
    )


def test_what_was_undone_in_each_batch_is_undone_in_all_together() -> None:
    """Whatever place a correction has in its own batch."""
    parts = [
        corrected(0, 0),
        corrected(1, 0, 1, corrections=(NOTHING, TRIM)),
        corrected(),
        corrected(2, 1, corrections=(NOTHING, TRIM, VIEW)),
        corrected(1, corrections=(NOTHING, VIEW)),
    ]
    whole = Corrected.joined(parts)
    rpy_rad = np.random.default_rng(1).uniform(-1.0, 1.0, (8, 3))
    by_part, at = [], 0
    for part in parts:
        by_part.append(part.undo(rpy_rad[at : at + len(part)], np.arange(len(part))))
        at += len(part)
    assert np.array_equal(whole.undo(rpy_rad, np.arange(8)), np.concatenate(by_part))
    assert [whole.corrections[place] for place in whole.applied] == [
        *(NOTHING, NOTHING, TRIM, NOTHING, TRIM, VIEW, TRIM, VIEW)
    ]


@pytest.mark.parametrize(
    ("bits", "in_all"),
    [((), None), ((UNSURE,), UNSURE), ((0, 0), 0), ((TRIM_FITTED, TRIM_FITTED), TRIM_FITTED), ((0, PITCH_TRIM), None)],
)
def test_what_is_open_in_all_samples(bits: tuple[int, ...], in_all: int | None) -> None:
    """The bits that all have alike; where they differ, or there is no sample, nothing holds for all."""
    assert corrected(*(0,) * len(bits), bits=bits).open_in_all == in_all


@pytest.mark.parametrize("before", [0.0, 1.0])
@pytest.mark.parametrize("bits", [(), (0, 0, 0), (UNSURE,) * 3, (UNSURE, 0, UNSURE), (0, UNSURE, UNSURE)])
def test_from_where_on_a_trim_may_be_in_it(bits: tuple[int, ...], before: float) -> None:
    """With each sample that says otherwise than the one before."""
    frames, values = corrected(*(0,) * len(bits), bits=bits).may_be_trim_from(before)
    expected, latest = [], before
    for frame, bit in enumerate(bits):
        if (now := float(bit == UNSURE)) != latest:
            expected.append((frame, now))
            latest = now
    assert list(zip(frames.tolist(), values.tolist(), strict=True)) == expected
