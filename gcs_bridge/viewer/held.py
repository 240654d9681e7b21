"""What was observed of a vehicle and waits: each part of the picture is drawn as often as it needs to be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

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

    def take(self, holds_us: Sequence[float]) -> Iterator[tuple[int, Stretch]]:
        """The parts that were drawn so long ago, each with what waits for it."""
        count = len(self._observations)
        for part, hold_us in enumerate(holds_us):
            waiting = count - self._drawn[part]
            if waiting and (abs(self._now_us - self._drawn_us[part]) >= hold_us or waiting >= _MOST):
                stretch = Stretch(self._observations[-waiting:])
                self._drawn[part], self._drawn_us[part] = count, self._now_us
                yield part, stretch
        done = min(self._drawn)
        if done:
            del self._observations[:done]
            self._drawn = [drawn - done for drawn in self._drawn]
