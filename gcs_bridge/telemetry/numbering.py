"""The sequence numbers of one component: whether what they miss was lost, or whether they cannot tell.

One sender numbers its frames one by one, on each of its links apart. So two links that come together on one go back
and forth between two places of the count, and each goes on where it was left; frames that come late lead back a few
numbers, lost ones lead nowhere back. Where a router leaves out what nobody behind it wants, the numbers miss frames
that nobody lost: then messages that come evenly go on doing so.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Numbering"]
_WINDOW = 64  # frames that are looked back: a burst of one link between two of the other is shorter
_NEAR = 16  # numbers that frames may come late, or that are lost at once, on one link
_LEAST = 8  # times back and forth
_STANDS = 0.5  # share of the frames that have the number of the one before


class Numbering:
    """The sequence numbers of one component, in order of arrival."""

    def __init__(self) -> None:
        """Start before the first frame."""
        self._last = np.empty(0, np.uint8)
        self._frames = self._still = self._far = self._back = 0

    def add(self, seq: npt.NDArray[np.uint8]) -> None:
        """Take the numbers (n,) of the next frames, copies left out."""
        before = len(self._last)
        numbers = np.concatenate([self._last, seq])
        step = np.diff(numbers)[max(before - 1, 0) :].view(np.int8)  # round the circle, the short way
        self._frames += len(seq)
        self._still += int(np.count_nonzero(step == 0))
        far = np.flatnonzero(np.abs(step.astype(np.int16)) > _NEAR) + max(before, 1)
        if len(far):
            behind = far[:, None] - np.arange(2, _WINDOW)
            goes_on = (numbers[behind.clip(0)] == (numbers[far] - np.uint8(1))[:, None]) & (behind >= 0)
            self._far += len(far)
            self._back += int(np.count_nonzero(goes_on.any(axis=1)))
        self._last = numbers[-_WINDOW:].copy()

    @property
    def stands(self) -> bool:
        """Whether the sender does not number its frames."""
        return self._still > _STANDS * self._frames

    @property
    def is_of_several(self) -> bool:
        """Whether the frames are numbered apart: several links, or several senders, come together in one."""
        return self._back >= _LEAST and 2 * self._back >= self._far
