"""What was observed of a vehicle and waits: each part of the picture is drawn as often as it needs to be."""

from __future__ import annotations

from gcs_bridge.judging.observation import Observation
from gcs_bridge.viewer.stretch import Stretch

__all__ = ["Held"]

_MOST = 64  # observations, where no time passes: of batches without a message that tells it
_NEVER_US = 1 << 60


class Held:
    """Of one vehicle in one boot."""

    def __init__(self, parts: int) -> None:
        """Start with nothing; the picture has so many parts."""
        self._observations: list[Observation] = []
        self._drawn = [0] * parts  # so many of them
        self._drawn_us = [-_NEVER_US] * parts  # the boot time then
        self._now_us = -_NEVER_US

    @property
    def boot(self) -> int | None:
        """Of what waits; None: nothing does."""
        return self._observations[0].segment.boot if self._observations else None

    def add(self, observation: Observation) -> None:
        """One more waits."""
        self._observations.append(observation)
        if len(observation.segment.t_boot_us):
            self._now_us = int(observation.segment.t_boot_us[-1])

    def waits_us(self, part: int) -> int:
        """How long ago the part was drawn for which something waits; −1: nothing does."""
        waiting = len(self._observations) - self._drawn[part]
        if not waiting:
            return -1
        return _NEVER_US if waiting >= _MOST else abs(self._now_us - self._drawn_us[part])

    def take(self, part: int) -> Stretch:
        """What waits for the part, which is drawn now."""
        stretch = Stretch(self._observations[self._drawn[part] :])
        self._drawn[part], self._drawn_us[part] = len(self._observations), self._now_us
        done = min(self._drawn)
        if done:
            del self._observations[:done]
            self._drawn = [drawn - done for drawn in self._drawn]
        return stretch
