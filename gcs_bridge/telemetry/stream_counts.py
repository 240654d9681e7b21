"""What came of one message: how many, how often, with what gaps, and how many went missing.

What is in them is not looked at here.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from gcs_bridge.columns import Int64s, Mask, Records
from gcs_bridge.contract import Stream
from gcs_bridge.jit import helper, kernel

US_PER_S = 1e6
SILENCE_US = 2_000_000  # a longer interval is a silence, and no part of the rate


class _Counts(NamedTuple):
    """What is counted of one message."""

    came: int
    invalid: int
    lost: int
    follows_losses: int  # whether losses are counted
    max_gap_us: int  # 0: no interval yet
    intervals: int
    spent_us: int
    silences: int
    silent_us: int
    began: int  # whether a sample came within the boot
    latest_us: int  # of them
    standing: int  # samples with the time of the one before
    # By receive time, for where the samples' own stands still.
    rx_us: int
    rx_intervals: int
    rx_spent_us: int
    last_lost: int


_COUNT = np.dtype([(name, "i8") for name in _Counts._fields])


@helper
def _count(of: Any, t_us: Any) -> Any:
    """Count a sample by its time; return how far it lies behind all before it (below zero: it came late)."""
    of.came += 1
    step_us = t_us - of.latest_us if of.began else 0
    if step_us > 0:
        of.max_gap_us = max(of.max_gap_us, step_us)
        if step_us <= SILENCE_US:
            of.intervals += 1
            of.spent_us += step_us
        else:
            of.silences += 1
            of.silent_us += step_us
    of.latest_us = max(of.latest_us, t_us) if of.began else t_us
    of.began = 1
    return step_us


@helper
def _count_receipt(of: Any, step_us: Any, t_rx_us: Any) -> Any:
    """Count the interval before a sample by its receive time; `step_us`: by its own."""
    rx_step_us = t_rx_us - of.rx_us
    of.standing += of.came > 1 and step_us == 0
    if of.came > 1 and of.rx_us >= 0 and 0 < rx_step_us <= SILENCE_US:
        of.rx_intervals += 1
        of.rx_spent_us += rx_step_us
    of.rx_us = t_rx_us


@helper
def _count_losses(of: Any, step_us: Any, period_us: Any, frames_lost: Any) -> Any:
    """Count missing samples: as many as the interval has room for, and no more than the sequence misses frames."""
    if not of.follows_losses:
        of.follows_losses, of.last_lost = 1, frames_lost
    missing = frames_lost - of.last_lost
    of.last_lost = frames_lost
    if missing > 0 and period_us > 0:
        of.lost += min(max(np.int64(np.rint(step_us / period_us)) - 1, 0), missing)
    elif missing < 0 and step_us <= 0:
        of.lost -= 1  # came late, and had been counted before


@kernel
def _count_all(count: Annotated[Records, _COUNT], t_us: Int64s) -> None:
    """Count samples by their times."""
    for i in range(t_us.size):
        _count(count[0], t_us[i])


@kernel
def _count_stream(
    count: Annotated[Records, _COUNT],
    stream: int,
    message: Int64s,
    t_us: Int64s,
    t_rx_us: Int64s,
    frames_lost: Int64s,
    period_us: Int64s,
    valid: Mask,
) -> None:
    """Count the messages that are of `stream`, of which `valid` holds one after the other."""
    of, n = count[0], 0
    for i in range(message.size):
        if message[i] == stream:
            step_us = _count(of, t_us[i])
            _count_receipt(of, step_us, t_rx_us[i])
            _count_losses(of, step_us, period_us[i], frames_lost[i])
            of.invalid += not valid[n]
            n += 1


class StreamCount:
    """What came of one message; times in µs on whatever clock the message is followed by."""

    def __init__(self) -> None:
        """Start before the first."""
        self._count = np.zeros(1, _COUNT)
        self._numbers = self._count.view(np.int64)  # the same, quicker to read

    def start_boot(self) -> None:
        """Begin a new boot: no interval leads there from the one before."""
        self._count["began"] = 0

    def add(self, t_us: Int64s) -> None:
        """Count samples by their times (n,)."""
        _count_all(self._count, t_us)

    def add_stream(
        self,
        stream: int,
        message: Int64s,
        t_us: Int64s,
        t_rx_us: Int64s,
        frames_lost: Int64s,
        period_us: Int64s,
        valid: Mask,
    ) -> None:
        """Count those of timed messages (n,) that are of `stream`, and what is missing between them.

        By their times, their receive times, the vehicle's frames that were lost so far, and the period as known then
        (−1: not); `valid` (k,) of the k that are of the stream.
        """
        _count_stream(self._count, stream, message, t_us, t_rx_us, frames_lost, period_us, valid)

    @property
    def _now(self) -> _Counts:
        return _Counts._make(self._numbers.tolist())

    @property
    def count(self) -> int:
        """How many came."""
        return self._now.came

    @property
    def invalid(self) -> int:
        """How many of them hold no attitude."""
        return self._now.invalid

    @property
    def latest_rx_us(self) -> int:
        """When the last one was received, −1: not known."""
        of = self._now
        return of.rx_us if of.follows_losses else of.latest_us  # all others are followed on receive time

    @property
    def stands(self) -> bool:
        """Whether most samples carry the time of the one before: there is no clock to tell them apart by."""
        return _stands(self._now)

    @property
    def rate_hz(self) -> float | None:
        """Over the time in which it came; of a stream that is slower than silences are long, over all.

        By receive time where its own stands still.
        """
        return _rate_hz(self._now)

    def entry(self) -> Stream:
        """The stream's entry in the report."""
        of = self._now
        return Stream(
            count=of.came,
            rate_hz=_rate_hz(of),
            max_gap_s=of.max_gap_us / US_PER_S if of.max_gap_us else None,
            lost=of.lost if of.follows_losses else None,
            invalid=of.invalid,
        )


def _stands(of: _Counts) -> bool:
    return 2 * of.standing > of.came


def _rate_hz(of: _Counts) -> float | None:
    if _stands(of):
        return of.rx_intervals / of.rx_spent_us * US_PER_S if of.rx_intervals else None
    if of.intervals:
        return of.intervals / of.spent_us * US_PER_S
    return of.silences / of.silent_us * US_PER_S if of.silences else None
