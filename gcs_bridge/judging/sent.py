"""What a vehicle sent lately of both streams, as the doctor wants it: kept whole, forgotten in time.

A live link brings some messages at a time, and what is asked of each batch would cost more than what is asked: batches
are joined, some dozens at a time; and that in two steps, so that no batch waits long for it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from gcs_bridge.checks.disagreement import Disagreement
from gcs_bridge.columns import Floats, FrameColumns, Int64s, Mask, record
from gcs_bridge.expected import Corrected
from gcs_bridge.pairing.pairs import Pairs
from gcs_bridge.telemetry.samples import AttitudeSamples

JOINED = 64  # batches, at most
_AT_ONCE = 16  # of them are joined first
_SHORT = 64  # rows; a longer batch is kept as it is


@record
class SentPairs(FrameColumns):
    """Of n pairs: `t_boot_us` (n,), `same_instant` (n,); how far apart, their limit, rad, and whether judged (n,)."""

    t_boot_us: Int64s
    same_instant: Mask
    apart_rad: Floats
    limit_rad: Floats
    judged: Mask

    @classmethod
    def of(cls, pairs: Pairs, found: Disagreement) -> SentPairs:
        """Those of one batch."""
        return cls(
            frame_index=pairs.frame_index,
            t_boot_us=pairs.t_boot_us,
            same_instant=pairs.same_instant,
            apart_rad=found.angle,
            limit_rad=found.limit,
            judged=found.judged,
        )

    @property
    def bad(self) -> Mask:
        """Which pairs (n,) are above their limit."""
        return np.asarray(self.judged & (self.apart_rad > self.limit_rad))


@record
class SentBatch:
    """What one batch, or several, brought of both streams within a boot.

    The samples as sent, with what was expected of them, and the pairs.
    """

    euler: AttitudeSamples
    corrected: Corrected
    quaternion: AttitudeSamples
    pairs: SentPairs

    @property
    def latest_us(self) -> int:
        """The latest time of any sample or pair in it."""
        every = self.euler, self.quaternion, self.pairs
        return max((int(of.t_boot_us.max()) for of in every if len(of)), default=-1)

    @classmethod
    def joined(cls, parts: Sequence[SentBatch]) -> SentBatch:
        """All of `parts`, one or more, one behind the other."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            euler=AttitudeSamples.joined([part.euler for part in parts]),
            corrected=Corrected.joined([part.corrected for part in parts]),
            quaternion=AttitudeSamples.joined([part.quaternion for part in parts]),
            pairs=SentPairs.joined([part.pairs for part in parts]),
        )


class Sent:
    """Of one vehicle within one boot."""

    def __init__(self) -> None:
        """Start with nothing sent."""
        self._joined: deque[tuple[int, SentBatch]] = deque()  # each with the latest time in it
        self._some: list[SentBatch] = []  # joined by some, that wait to be joined to more
        self._single: list[SentBatch] = []  # that wait to be joined

    def __len__(self) -> int:
        """How many pairs are kept."""
        return sum(len(batch.pairs) for batch in (*(batch for _, batch in self._joined), *self._some, *self._single))

    def keep(self, sent: SentBatch) -> bool:
        """Remember a batch; whether it is time to `forget`."""
        self._single.append(sent)
        is_long = len(sent.euler) + len(sent.quaternion) > _SHORT
        if is_long or len(self._single) >= _AT_ONCE:
            self._join_single()
        is_time = is_long or len(self._some) * _AT_ONCE >= JOINED
        if is_time:
            self._join()
        return is_time

    def forget(self, before_us: int) -> None:
        """What came before this boot time, µs, is needed no more."""
        while self._joined and self._joined[0][0] < before_us:
            self._joined.popleft()

    def since(self, from_us: int) -> list[SentBatch]:
        """All with something of this boot time, µs, or behind it, in order of arrival."""
        self._join()
        return [batch for latest_us, batch in self._joined if latest_us >= from_us]

    def _join_single(self) -> None:
        if self._single:
            self._some.append(SentBatch.joined(self._single))
            self._single.clear()

    def _join(self) -> None:
        self._join_single()
        if self._some:
            whole = SentBatch.joined(self._some)
            self._joined.append((whole.latest_us, whole))
            self._some.clear()
