"""What radios tell of their buffers: by that autopilots slow their streams, and nothing else on the link says so.

A radio sends RADIO_STATUS (older: RADIO) about once a second, with how much of its buffer is free. ArduPilot lengthens
the interval of each message by up to 2 s while that is little, step by step, and shortens it so again
(GCS_MAVLINK::handle_radio_status); PX4 multiplies its rates (Mavlink::update_radio_status). Which radio a vehicle hears
is not known here: whatever one of the link says may be meant.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.telemetry.messages import KIND, RADIOS
from gcs_bridge.telemetry.sorting import Share, SortedFrames

Address = tuple[int, int]

# ArduPilot, by how much of the buffer is free, in per cent.
_LITTLE, _VERY_LITTLE, _ENOUGH, _PLENTY = 50, 20, 90, 95
_LONGER_MS, _MUCH_LONGER_MS, _SHORTER_MS, _MUCH_SHORTER_MS = 20, 60, 20, 40
_LONGEST_MS, _STILL_LONG_MS = 2000, 200  # from there on no longer; and above it shorter by the larger step
# PX4, the same.
_HALF, _LOW, _CRITICAL = 50, 35, 25
_FASTER, _SLOWER, _MUCH_SLOWER, _SLOWEST = 1.025, 0.975, 0.8, 0.01
_MOST_RADIOS = 16  # that are followed: anybody can send a frame under any number


class Slowdown(NamedTuple):
    """From a radio's frame on streams may be slowed, or are no more; `longer_us`: by so much ArduPilot's intervals."""

    frame_index: int
    by: Address
    slowed: bool
    longer_us: int

    def is_for(self, _vehicle: Address) -> bool:
        """Whether the vehicle is meant: each on the link may be."""
        return True


class _Radio:
    """How an ArduPilot and a PX4 answer to one radio."""

    def __init__(self) -> None:
        """Start at full rates."""
        self.longer_ms, self._share = 0, 1.0

    @property
    def slows(self) -> bool:
        """Whether either is slowed."""
        return self.longer_ms > 0 or self._share < 1.0

    def hear(self, free: int) -> None:
        """Take how much of its buffer is free, per cent."""
        if free < _LITTLE and self.longer_ms < _LONGEST_MS:
            self.longer_ms += _MUCH_LONGER_MS if free < _VERY_LITTLE else _LONGER_MS
        elif free > _PLENTY and self.longer_ms > _STILL_LONG_MS:
            self.longer_ms -= _MUCH_SHORTER_MS
        elif free > _ENOUGH:
            self.longer_ms = max(self.longer_ms - _SHORTER_MS, 0)
        if free < _CRITICAL:
            self._share *= _MUCH_SLOWER
        elif free < _LOW:
            self._share *= _SLOWER
        elif free > _HALF:
            self._share *= _FASTER
        self._share = min(max(self._share, _SLOWEST), 1.0)


class RadioFlow:
    """The radios of one link."""

    def __init__(self) -> None:
        """Start with none heard."""
        self._radios: dict[Address, _Radio] = {}
        self._told = (False, 0)

    def read(self, batch: SortedFrames, share: Share, dialect: Dialect) -> Iterator[Slowdown]:
        """Take what one component says of its buffer in a batch; yield what that changes, in order of arrival."""
        found: list[tuple[int, int]] = []
        for name in RADIOS:
            if name in dialect and share.counts[KIND[name]]:
                rows = batch.rows(share, KIND[name])
                sent = decode(batch.buffer, batch.frames[rows], dialect[name])
                found += zip((batch.first + rows).tolist(), sent["txbuf"].tolist(), strict=True)
        for frame_index, free in sorted(found):
            yield from self._hear(frame_index, share.address, free)

    def _hear(self, frame_index: int, by: Address, free: int) -> Iterator[Slowdown]:
        radio = self._radios.get(by)
        if radio is None:
            if len(self._radios) == _MOST_RADIOS:
                return
            radio = self._radios[by] = _Radio()
        radio.hear(free)
        slows = [one for one in self._radios.values() if one.slows]
        told = bool(slows), 1000 * max((one.longer_ms for one in slows), default=0)
        if told != self._told:
            self._told = told
            yield Slowdown(frame_index, by, *told)
