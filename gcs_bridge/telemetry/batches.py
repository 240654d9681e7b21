"""What one batch of frames brought of one vehicle, with the place of each sample on its link.

Data alone: nothing is decided here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Floats, Int64s, Mask
from gcs_bridge.telemetry.clocks import ClockChange
from gcs_bridge.telemetry.samples import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    AttitudeSamples,
    ImuSamples,
    no_attitudes,
)
from gcs_bridge.telemetry.statements import Statement

# Messages whose time_boot_ms keeps the clock; the first two are the streams that are compared.
TIMED = (ATTITUDE, ATTITUDE_QUATERNION, "SYSTEM_TIME", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")


@dataclass(frozen=True)
class BootSegment:
    """What one batch brought of one vehicle within one boot.

    n messages with a believed boot time, in order of arrival: `message` (n,) index into TIMED, `t_boot_us`, `t_rx_us`,
    `frame_index` (n,) of the frame in its link, `lost`, `received` (n,) frames of the vehicle so far. Of them the
    attitudes are `euler` and `quaternion`, samples in the same order.
    """

    boot: int
    message: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    frame_index: Int64s
    lost: Int64s
    received: Int64s
    euler: AttitudeSamples
    quaternion: AttitudeSamples

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
    attitudes = no_attitudes(ATTITUDE), no_attitudes(ATTITUDE_QUATERNION)
    return BootSegment(boot, none, none, none, none, none, none, *attitudes)


class ClockNotice(NamedTuple):
    """A clock's change and the frame that showed it."""

    change: ClockChange
    frame_index: int
    t_rx_us: int


class ImuBatch(NamedTuple):
    """IMU samples, n, and the indices (n,) of their frames."""

    samples: ImuSamples
    frame_index: Int64s


class Ahrs2Batch(NamedTuple):
    """Attitudes of the second estimate, n, whose time lies between the timed messages on both sides of them.

    `frame_index` (n,) of the frame behind, by which the time was known; `gap_us` (n,) between the two.
    """

    samples: AttitudeSamples
    frame_index: Int64s
    gap_us: Int64s


class VelocityChange(NamedTuple):
    """LOCAL_POSITION_NED, n: `frame_index` (n,) and how fast the velocity changed since the one before, m/s² (n,)."""

    frame_index: Int64s
    acceleration_m_s2: Floats


@dataclass(frozen=True)
class VehicleBatch:
    """What one batch brought of one vehicle: its boots in turn, clock changes, what it said of itself.

    `heard` are the indices of its frames in the window. `counted` holds the receive times, µs, of messages
    without a boot time of their own; `imu` and `secondary` what these carry.
    """

    heard: Int64s
    segments: list[BootSegment]
    clock_changes: list[ClockNotice]
    counted: dict[str, Int64s]
    imu: dict[str, ImuBatch]
    secondary: Ahrs2Batch
    statements: list[Statement]
    motion: VelocityChange
