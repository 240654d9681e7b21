"""What a view remembers of pairs of neighbouring instants."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gcs_bridge.columns import Floats
from gcs_bridge.expected.between import NO_BETWEEN_PAIRS, BetweenPairs
from gcs_bridge.expected.pairs import IN_A_ROW, SPARSE_US

KEPT = 64  # pairs, and as many of one a second
NEVER_US = 2**62
_REFINE_FIRST_US, _REFINE_LAST_US = 1_000_000, 16_000_000  # after so much vehicle time a fit is made anew


@dataclass
class BetweenMemory:
    """What is remembered of the pairs within one boot."""

    recent: BetweenPairs = NO_BETWEEN_PAIRS
    sparse: BetweenPairs = NO_BETWEEN_PAIRS  # one a second
    taken: int = 0  # pairs, as far as it matters
    denied: int = 0  # pairs since the last that could tell and agreed: no healthy ones,
    denied_since_us: int = 0  # from the first of them on
    denials: int = 0  # of them in a row, without one that agrees for its wide bound
    again_us: int = 0  # when a fit is tried again
    denies_trims: bool = False  # no AHRS_TRIM makes this
    refine_us: int = NEVER_US  # when a fit is made anew,
    refine_every_us: int = _REFINE_FIRST_US
    since_us: int = 0  # by pairs from here on
    information: Floats = field(default_factory=lambda: np.zeros((3, 3)))  # of the fit, as in `Fitted`

    @property
    def comes(self) -> bool:
        """Whether such pairs come."""
        return self.taken >= IN_A_ROW

    def keep(self, pairs: BetweenPairs) -> None:
        """Remember pairs, behind what is remembered."""
        if len(pairs):
            self.recent, self.sparse = self._with(pairs)
            self.taken = min(self.taken + len(pairs), IN_A_ROW)

    def window(self, more: BetweenPairs, since_us: int) -> BetweenPairs:
        """What is remembered once `more` are kept, each pair once, in order of time, from a time on."""
        window, sparse = self._with(more)
        if len(window):
            window = sparse[sparse.t_us < window.t_us[0]].then(window)
        return window[window.t_us >= since_us]

    def _with(self, more: BetweenPairs) -> tuple[BetweenPairs, BetweenPairs]:
        """The latest pairs, and those of one a second, once `more` are among them: in however many pieces they came."""
        seen = self.recent.then(more)
        first = np.diff(seen.t_us // SPARSE_US, prepend=-1) != 0
        first[: len(self.recent)] = False
        return seen[-KEPT:], self.sparse.then(seen[first])[-KEPT:]

    def deny(self, t_us: int) -> None:
        """One more pair is no healthy one."""
        if not self.denied:
            self.denied_since_us = t_us
        self.denied += 1
        self.denials += 1

    def agree(self, *, tells: bool) -> None:
        """One more pair is a healthy one; whether its bound is so narrow that it tells."""
        self.denials = 0
        if tells:
            self.denied, self.denies_trims = 0, False

    def hold(self, t_us: int, *, fitted: bool, whole: bool) -> None:
        """Another correction holds; if it was fitted, to all pairs of the boot, or since the first that denied."""
        self.denied, self.denials, self.denies_trims = 0, 0, False
        if fitted:
            self.since_us = 0 if whole else self.denied_since_us
            self.begin_refining(t_us)

    def begin_refining(self, t_us: int) -> None:
        """A fit is to be made anew soon, and then less and less often."""
        self.refine_every_us, self.refine_us = _REFINE_FIRST_US, t_us + _REFINE_FIRST_US

    def refined(self, t_us: int) -> None:
        """It was made anew."""
        self.refine_every_us = min(2 * self.refine_every_us, _REFINE_LAST_US)
        self.refine_us = t_us + self.refine_every_us
