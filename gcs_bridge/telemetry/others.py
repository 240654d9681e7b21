"""What other senders on a link say that matters to a vehicle: rates that are asked for, and what slows its streams."""

from __future__ import annotations

from collections.abc import Iterator

from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.telemetry.messages import OTHERS_KINDS
from gcs_bridge.telemetry.radio_flow import RadioFlow, Slowdown
from gcs_bridge.telemetry.rate_requests import RateRequest, rate_requests
from gcs_bridge.telemetry.sorting import SortedFrames

OfOthers = RateRequest | Slowdown


class Others:
    """The senders of one link, as far as vehicles are to know what they say."""

    def __init__(self, dialect: Dialect) -> None:
        """Start with nothing said."""
        self._dialect = dialect
        self._radio_flow = RadioFlow()

    def read(self, batch: SortedFrames) -> list[OfOthers]:
        """What they say in a batch, in order of arrival."""
        return sorted(self._of(batch), key=lambda one: one.frame_index)

    def _of(self, batch: SortedFrames) -> Iterator[OfOthers]:
        for share in batch.shares:
            if share.has_any(OTHERS_KINDS):
                yield from rate_requests(batch, share, self._dialect)
                yield from self._radio_flow.read(batch, share, self._dialect)
