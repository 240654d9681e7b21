"""How what the loop's thread knows gets to the threads of a server: asked for, and handed over whole.

The loop gives a new snapshot only when somebody waits for one, and at most once a second. It waits for nobody, and no
lock is held while anything is judged or looked at.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from threading import Condition
from typing import NamedTuple

from gcs_bridge.judging.snapshot import Snapshot
from gcs_bridge.telemetry.identity import VehicleId

__all__ = ["Exchange", "Published", "Raised", "Raises"]
_YOUNG_S = 1.0  # what is no older is given to whoever asks next
_PATIENCE_S = 2.0  # the loop comes round four times a second; what takes longer does not listen either


class Raised(NamedTuple):
    """Whose alarms, and of which severity, are counted."""

    vehicle: VehicleId
    check: str
    severity: str


Raises = Mapping[Raised, int]


class Published(NamedTuple):
    """What is known at one time, and is never changed behind it; `raises`: alarms so far."""

    snapshot: Snapshot
    raises: Raises


class Exchange:
    """Where the loop's thread leaves what is known, and others find it."""

    def __init__(self) -> None:
        """Start with nothing known."""
        self._changed = Condition()
        self._wanted = False
        self._latest: Published | None = None
        self._latest_s = float("-inf")

    def give(self, take: Callable[[], Published]) -> None:
        """In the loop's thread: hand over what `take` returns, if somebody waits for it."""
        if not self._wanted:
            return
        published = take()
        with self._changed:
            self._latest, self._latest_s, self._wanted = published, time.monotonic(), False
            self._changed.notify_all()

    def get(self) -> Published | None:
        """In any other thread: what is known now, a second ago at most; None where the loop gives nothing."""
        asked_s = time.monotonic()

        def is_young() -> bool:
            return self._latest_s >= asked_s - _YOUNG_S

        with self._changed:
            if not is_young():
                self._wanted = True
                self._changed.wait_for(is_young, _PATIENCE_S)
            return self._latest if is_young() else None
