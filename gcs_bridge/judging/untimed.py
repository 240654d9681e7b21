"""What came of a vehicle, or was said to it, and carries no time: frames, requests for rates, signs of two senders.

All are looked at with the messages among which they came. Behind the last one frames, and what others said, are looked
at by themselves; the signs wait for the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from gcs_bridge.telemetry.batches import VehicleBatch
from gcs_bridge.telemetry.heard import HeardFrames, no_frames
from gcs_bridge.telemetry.others import OfOthers
from gcs_bridge.telemetry.radio_flow import Slowdown
from gcs_bridge.telemetry.rate_requests import RateChange, RateRequest, RateWishes
from gcs_bridge.telemetry.senders import SenderSign
from gcs_bridge.telemetry.statements import ParameterSet

_NO_FRAMES = no_frames()
_MOST_SIGNS = 10_000  # that can wait for a message with a time


class Untimed:
    """Of one vehicle: what was not looked at yet."""

    def __init__(self) -> None:
        """Start with nothing."""
        self._heard = _NO_FRAMES  # of the batch
        self._wishes = RateWishes()
        self._said: list[OfOthers] = []
        self._signs: list[SenderSign] = []

    def bring(self, batch: VehicleBatch) -> None:
        """Take the frames of the next batch, whatever they carry, and signs of more than one sender."""
        self._heard = batch.heard
        self._signs = [*self._signs, *batch.senders][-_MOST_SIGNS:]

    def take(self, said: Iterable[OfOthers], parameters: Iterable[ParameterSet]) -> Iterator[RateChange]:
        """Take what others said, and which parameters came; yield what rates were asked for that way."""
        said = list(said)
        self._said += [one for one in said if isinstance(one, Slowdown)]
        for change in self._wishes.take((one for one in said if isinstance(one, RateRequest)), parameters):
            self._said.append(change.request)
            yield change

    @property
    def has_frames(self) -> bool:
        """Whether frames of the batch are left."""
        return len(self._heard) > 0

    def said_until(self, frame_index: int) -> list[OfOthers]:
        """What others said that was not looked at yet, up to a frame: new rates, and what slows streams."""
        if not self._said:
            return []
        told = [one for one in self._said if one.frame_index <= frame_index]
        self._said = [one for one in self._said if one.frame_index > frame_index]
        return told

    def heard_until(self, frame_index: int | None) -> HeardFrames:
        """Those of the batch's frames that were not looked at yet, before one of them, or all."""
        heard = self._heard
        if frame_index is None:
            self._heard = _NO_FRAMES
            return heard
        end = int(np.searchsorted(heard.frame_index, frame_index))
        self._heard = heard[end:]
        return heard[:end]

    @property
    def has_signs(self) -> bool:
        """Whether signs of more than one sender wait."""
        return bool(self._signs)

    def signs_until(self, frame_index: int) -> list[SenderSign]:
        """The signs that were not looked at yet, up to a frame."""
        told = [sign for sign in self._signs if sign.frame_index <= frame_index]
        self._signs = self._signs[len(told) :]
        return told
