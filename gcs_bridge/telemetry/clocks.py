"""A vehicle's boot clock: unwraps `time_boot_ms`, tells reboots from reordering, and doubts a time that stands alone.

Milliseconds since boot wrap after 49.7 days (a step of about −2³²), restart near zero with a reboot, and step back by a
few seconds where frames were reordered. Every rule looks at what came before and at nothing else, so a live link and a
recording, in pieces of any size, give the same times.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s, Mask, RunningMax, running_max

WRAP_US = 2**32 * 1000
REORDER_US = 6_000_000  # seen: 4.7 s in a recording that is otherwise good
YOUNG_US = 15_000_000  # a boot this young that falls silent and comes back earlier was a restart, not reordered frames
YOUNG_REORDER_US = 500_000
RESTART_SILENCE_US = 1_000_000
JUMP_US = 60_000_000  # a longer step forward needs the receive time, or a second message, to be believed


class ClockChange(NamedTuple):
    """Where a clock did something else than go on: `place` in the batch, the new time, and how far it stepped."""

    place: int
    boot: int
    kind: str  # "reboot" or "clock_step"
    t_boot_us: int
    step_us: int


class Release(NamedTuple):
    """The message right before `place` in the batch (place 0: the last of the batch before) is believed after all."""

    place: int
    boot: int
    t_boot_us: int


@dataclass(frozen=True)
class BootTimes:
    """Times of one batch, shape (n,): the boot of each message, µs since that boot, and which times are believed."""

    boot: Int64s
    t_boot_us: Int64s
    believed: Mask
    changes: tuple[ClockChange, ...] = ()
    released: tuple[Release, ...] = ()


class _Change(NamedTuple):
    kind: str
    first_us: int  # time of the message that was doubted
    step_us: int


class BootClock:
    """The boot clock of one vehicle, fed with `time_boot_ms` in order of arrival."""

    def __init__(self) -> None:
        """Start before the first message."""
        self.boot = 0
        self.latest_us: int | None = None  # latest believed time in this boot
        self._epoch_us = 0
        self._rx_us = 0
        self._doubted_us: int | None = None

    @property
    def doubts(self) -> bool:
        """Whether the last message waits for a second one to confirm it."""
        return self._doubted_us is not None

    def read(self, time_boot_ms: npt.NDArray[np.uint32], t_rx_us: Int64s) -> BootTimes:
        """Times of the next messages; `t_rx_us` is −1 where the receive time is unknown.

        The first message behind a reboot, or behind a jump, is not believed before a second one confirms it: then it
        is `released`.
        """
        n = len(time_boot_ms)
        boot, t_boot_us, believed = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.bool_)
        changes: list[ClockChange] = []
        released: list[Release] = []
        place, ahead = 0, n
        while place < n:
            times = self._plain(time_boot_ms[place : place + ahead], t_rx_us[place : place + ahead])
            until = place + len(times)
            looked = ahead
            ahead = 4 * ahead if len(times) == ahead else 16  # not far where something odd came lately
            boot[place:until], t_boot_us[place:until], believed[place:until] = self.boot, times, True
            if until > place:
                self.latest_us = max(int(times.max()), self.latest_us or 0)
                self._rx_us = int(t_rx_us[until - 1])
            if until < min(place + looked, n):
                t_boot_us[until], change = self._read_next(int(time_boot_ms[until]), int(t_rx_us[until]))
                boot[until], believed[until] = self.boot, self._doubted_us is None
                if change is not None:
                    changes.append(ClockChange(until, self.boot, change.kind, change.first_us, change.step_us))
                    released.append(Release(until, self.boot, change.first_us))
                until += 1
            place = until
        return BootTimes(boot, t_boot_us, believed, tuple(changes), tuple(released))

    def _plain(self, time_boot_ms: npt.NDArray[np.uint32], t_rx_us: Int64s) -> Int64s:
        """Times of the messages up to the first that needs a closer look: the common case, at once."""
        if self._doubted_us is not None:
            return np.empty(0, np.int64)
        t = time_boot_ms.astype(np.int64) * 1000 + self._epoch_us
        latest = running_max(t, t[0] if self.latest_us is None else self.latest_us)[:-1] if len(t) else t
        step = t - latest
        silence = np.diff(t_rx_us, prepend=self._rx_us)
        restart = (step < -YOUNG_REORDER_US) & (latest < YOUNG_US) & (silence >= RESTART_SILENCE_US)
        odd = np.flatnonzero((step < -REORDER_US) | (step > JUMP_US) | restart)
        return t[: odd[0]] if len(odd) else t

    def _read_next(self, ms: int, rx: int) -> tuple[int, _Change | None]:
        latest = self.latest_us if self.latest_us is not None else ms * 1000
        elapsed = rx - self._rx_us if rx >= 0 and self._rx_us >= 0 else 0
        furthest = max(JUMP_US, 2 * elapsed)
        t = ms * 1000 + self._epoch_us
        if -REORDER_US <= t + WRAP_US - latest <= furthest:
            t += WRAP_US  # past the wrap; the epoch follows once this is believed
        elif self._epoch_us and -REORDER_US <= t - WRAP_US - latest <= furthest:
            t -= WRAP_US  # from before the wrap, late
        step = t - latest
        young = latest < YOUNG_US and elapsed >= RESTART_SILENCE_US
        change = None
        if not -(YOUNG_REORDER_US if young or self.doubts else REORDER_US) <= step <= furthest:
            doubted = self._doubted_us
            if doubted is None or not -REORDER_US <= ms * 1000 - doubted <= JUMP_US:
                self._doubted_us = ms * 1000
                return t, None
            if step < 0:  # a second message from the past: the vehicle has started anew
                self.boot += 1
                t = ms * 1000
                change = _Change("reboot", doubted, step)
            else:
                change = _Change("clock_step", doubted + t - ms * 1000, step)
        self._doubted_us = None
        self._rx_us = rx
        self.latest_us = max(change.first_us, t) if change else max(latest, t)
        self._epoch_us = self.latest_us // WRAP_US * WRAP_US
        return t, change


class OffsetClock:
    """Maps the own clock of a message (`time_usec`) to the boot clock of its vehicle, within one boot.

    A clock that is near the boot clock at first is the boot clock: others count from 1970, or from a start seconds to
    hours away. Of these the smallest offset is the nearest to the true one, as no message is heard before its stamp.
    """

    def __init__(self) -> None:
        """Start with no message."""
        self._same: bool | None = None
        self._ahead_us = RunningMax()  # of the boot clock

    def map(self, t_us: Int64s, latest_us: Int64s) -> Int64s:
        """Boot times (n,), µs, of messages at `t_us` (n,) on their clock, when the boot clock said `latest_us` (n,)."""
        ahead_us = latest_us - t_us
        if self._same is None and len(ahead_us):
            self._same = abs(int(ahead_us[0])) < SAME_CLOCK_US
        return t_us if self._same else np.asarray(t_us + self._ahead_us.feed(ahead_us)[1:])


SAME_CLOCK_US = 1_000_000
