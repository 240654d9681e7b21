"""What came of one message: how many, how often, with what gaps, and how many went missing.

What is in them is not looked at here.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gcs_bridge.columns import Int64s, RunningMax
from gcs_bridge.contract import Stream

US_PER_S = 1e6
_SILENCE_US = 2_000_000  # a longer interval is a silence, and no part of the rate


@dataclass(kw_only=True)
class StreamCount:
    """What came of one message; times in µs on whatever clock the message is followed by."""

    count: int = 0
    invalid: int = 0
    lost: int | None = None
    max_gap_us: int | None = None
    _intervals: int = 0
    _spent_us: int = 0
    _silences: int = 0
    _silent_us: int = 0
    _latest_us: RunningMax = field(default_factory=RunningMax)
    _last_lost: int = 0

    def start_boot(self) -> None:
        """Begin a new boot: no interval leads there from the one before."""
        self._latest_us = RunningMax()

    def add(self, t_us: Int64s) -> Int64s:
        """Count samples by their times; return how far each lies behind all before it (below zero: it came late)."""
        self.count += len(t_us)
        steps = t_us - self._latest_us.feed(t_us)[:-1]
        ahead = steps[steps > 0]
        if len(ahead):
            self.max_gap_us = max(int(ahead.max()), self.max_gap_us or 0)
            regular = ahead[ahead <= _SILENCE_US]
            self._intervals += len(regular)
            self._spent_us += int(regular.sum())
            self._silences += len(ahead) - len(regular)
            self._silent_us += int(ahead.sum() - regular.sum())
        return steps

    def add_losses(self, steps: Int64s, period_us: Int64s, frames_lost: Int64s) -> None:
        """Count missing samples: as many as the interval has room for, and no more than the sequence misses frames."""
        if self.lost is None:
            self.lost, self._last_lost = 0, int(frames_lost[0])
        missing = np.diff(frames_lost, prepend=self._last_lost)
        room = np.where(period_us > 0, np.rint(steps / np.maximum(period_us, 1)).astype(np.int64) - 1, 0)
        self.lost += int(np.clip(room, 0, np.maximum(missing, 0)).sum())
        self.lost -= int(((steps <= 0) & (missing < 0)).sum())  # came late, and had been counted before
        self._last_lost = int(frames_lost[-1])

    @property
    def rate_hz(self) -> float | None:
        """Over the time in which it came; of a stream that is slower than silences are long, over all."""
        if self._intervals:
            return self._intervals / self._spent_us * US_PER_S
        return self._silences / self._silent_us * US_PER_S if self._silences else None

    def entry(self) -> Stream:
        """The stream's entry in the report."""
        return Stream(
            count=self.count,
            rate_hz=self.rate_hz,
            max_gap_s=None if self.max_gap_us is None else self.max_gap_us / US_PER_S,
            lost=self.lost,
            invalid=self.invalid,
        )
