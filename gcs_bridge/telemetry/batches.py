"""What one batch of frames brought of one vehicle, with the place of each sample on its link.

Data alone: nothing is decided here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Int64Rows, Int64s, Mask, record
from gcs_bridge.telemetry.clocks import ClockChange
from gcs_bridge.telemetry.heard import HeardFrames
from gcs_bridge.telemetry.known import Known
from gcs_bridge.telemetry.positions import PositionSamples
from gcs_bridge.telemetry.samples import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    Ahrs2Samples,
    AttitudeSamples,
    ImuSamples,
    no_attitudes,
)
from gcs_bridge.telemetry.senders import SenderSign
from gcs_bridge.telemetry.statements import Statement

_MANY = 64  # rows, from which on numpy is faster than Python


@record
class BootSegment(FrameColumns):
    """What one batch brought of one vehicle within one boot.

    n messages with a believed boot time, in order of arrival: `message` (n,) index into TIMED, `t_boot_us`, `t_rx_us`,
    `frame_index` (n,) of the frame in its link, `lost`, `received` (n,) frames of the vehicle so far. Of them the
    attitudes are `euler` and `quaternion`, samples in the same order.
    """

    boot: int
    message: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    lost: Int64s
    received: Int64s
    euler: AttitudeSamples
    quaternion: AttitudeSamples

    def frames(self, first: int, end: int) -> Self:
        """What the frames from `first` up to, and without, `end` brought."""
        euler, quaternion = (samples.frames(first, end) for samples in (self.euler, self.quaternion))
        return replace(super().frames(first, end), euler=euler, quaternion=quaternion)

    @property
    def attitude(self) -> Mask:
        """Which messages (n,) are attitudes of the two streams."""
        return self.message < 2

    @property
    def valid_attitude(self) -> Mask:
        """Which messages (n,) are valid attitudes."""
        valid = np.zeros(len(self.message), np.bool_)
        valid[self.message == 0], valid[self.message == 1] = self.euler.valid, self.quaternion.valid
        return valid


def no_segment(boot: int) -> BootSegment:
    """A segment without messages."""
    none = np.empty(0, np.int64)
    return BootSegment(
        boot=boot,
        message=none,
        frame_index=none,
        t_boot_us=none,
        t_rx_us=none,
        lost=none,
        received=none,
        euler=no_attitudes(ATTITUDE),
        quaternion=no_attitudes(ATTITUDE_QUATERNION),
    )


@record
class VelocityChange(FrameColumns):
    """LOCAL_POSITION_NED, n: how fast the velocity changed since the one before, m/s² (n,)."""

    acceleration_m_s2: Floats


@record
class VehicleBatch:
    """What one batch brought of one vehicle: its boots in turn, clock changes, what it said of itself.

    `known`: of it, with the last of them; `frame_index` are the indices of its frames, `heard` tells of those in the
    window; `timed`: columns of its `TimedMessages`, in the window or not. `counted` holds the receive times, µs, of
    messages without a boot time of their own; `imu` and `secondary` what these carry; `senders` whether they are one
    sender's; `positions` where it was, empty unless that was asked for.
    """

    known: Known
    frame_index: Int64s
    heard: HeardFrames
    timed: Int64Rows
    senders: list[SenderSign]
    segments: list[BootSegment]
    clock_changes: list[ClockChange]
    counted: dict[str, Int64s]
    imu: dict[str, ImuSamples]
    secondary: Ahrs2Samples
    statements: list[Statement]
    motion: VelocityChange
    positions: PositionSamples

    @property
    def boots(self) -> set[int]:
        """Those within which it brought anything."""
        of_samples = [*(samples.boot for samples in self.imu.values()), self.secondary.boot]
        return {segment.boot for segment in self.segments}.union(*map(_different, of_samples))


def _different(boot: Int64s) -> set[int]:
    """The different boots (n,); np.unique would load a part of numpy that takes as long as judging some seconds."""
    if len(boot) < _MANY:
        return set(boot.tolist())
    first, last = int(boot.min()), int(boot.max())
    return {first} if first == last else set(boot.tolist())
