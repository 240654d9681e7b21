"""What is known of a (system, component) once a batch of its frames was read; data alone.

Who reads may be a batch ahead of who judges: what is known goes with the batch.
"""

from __future__ import annotations

from typing import NamedTuple


class Known(NamedTuple):
    """What is known of a component with the last frame of a batch.

    `autopilot`, `type`: "unknown" where it does not say them. `received`, `lost`: frames that came, and that the
    sequence numbers miss; `heard_rx_us`: when the last one came, −1: unknown. `unbelieved`: how many messages of each
    of the two streams carried a time that was not believed. `seen`: index and receive time of the frame that first made
    it a vehicle; `standing`: from which frame on it is a vehicle, or is none; `is_decided`: which of both is known.
    """

    autopilot: str = "unknown"
    type: str = "unknown"
    received: int = 0
    lost: int = 0
    heard_rx_us: int = -1
    unbelieved: tuple[int, int] = (0, 0)
    seen: tuple[int, int] | None = None
    standing: tuple[tuple[int, bool], ...] = ()
    is_decided: bool = False

    @property
    def is_vehicle(self) -> bool:
        """Whether it is known to be a vehicle by then."""
        return bool(self.standing) and self.standing[-1][1]

    def is_vehicle_at(self, frame_index: int) -> bool:
        """Whether it was known to be a vehicle once the frame `frame_index` had come."""
        known = [is_one for since, is_one in self.standing if since <= frame_index]
        return bool(known) and known[-1]


NOTHING_KNOWN = Known()
