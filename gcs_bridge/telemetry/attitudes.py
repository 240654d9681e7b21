"""ATTITUDE and ATTITUDE_QUATERNION from the wire: body axes (forward-right-down) in the local north-east-down frame.

Their speeds are body rates in rad/s (MAVLink common.xml).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gcs_bridge.attitude.compiled import put
from gcs_bridge.attitude.euler import quaternion_of_rpy
from gcs_bridge.columns import FloatRows, Int64Rows, Int64s, Mask
from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.decode import float_in, offsets
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.clocks import (
    BOOT,
    FRAME_INDEX,
    MESSAGE,
    ROW,
    T_BOOT_US,
    T_RX_US,
    TimedMessages,
)
from gcs_bridge.telemetry.messages import KIND
from gcs_bridge.telemetry.samples import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    AttitudeSamples,
    no_attitudes,
    room_for_attitudes,
)
from gcs_bridge.telemetry.sorting import Share, SortedFrames

NORM_TOLERANCE = 0.5  # a quaternion further from unit norm has no attitude left in it
EULER, QUATERNION = KIND[ATTITUDE], KIND[ATTITUDE_QUATERNION]
_RATES = ("rollspeed", "pitchspeed", "yawspeed")
_NO_EULER, _NO_QUATERNION = no_attitudes(ATTITUDE), no_attitudes(ATTITUDE_QUATERNION)


@helper
def _payload(frames: Any, buffer: Any, held: Any, row: Any) -> Any:
    """Where the payload of a timed message is: in the batch, or `held` of a batch before."""
    if row < 0:
        return held, np.int64(0), np.int64(held.size)
    return buffer, np.int64(frames[row].payload), np.int64(frames[row].length)


@helper
def turn_of_rpy(rpy_rad: Any, q_nb: Any, n: Any) -> Any:
    """Put down the quaternion of roll, pitch, yaw as sent: intrinsic Z-Y-X (M11), in any range; whether it is one."""
    roll, pitch, yaw = rpy_rad[n, 0], rpy_rad[n, 1], rpy_rad[n, 2]
    put(quaternion_of_rpy(roll, pitch, yaw), q_nb, n)
    return np.isfinite(roll) and np.isfinite(pitch) and np.isfinite(yaw)


@kernel
def _read_euler(
    frames: Frames,
    buffer: Bytes,
    held: Bytes,
    timed: Int64Rows,
    in_window: Mask,
    at: Int64s,
    frame_index: Int64s,
    boot: Int64s,
    t_boot_us: Int64s,
    t_rx_us: Int64s,
    q_nb: FloatRows,
    w_nb_b_rad_s: FloatRows,
    valid: Mask,
    rpy_rad: FloatRows,
) -> int:
    """Read each ATTITUDE of the timed messages; return how many there are."""
    n = 0
    for i in range(in_window.size):
        if timed[MESSAGE, i] == EULER and in_window[i]:
            payload = _payload(frames, buffer, held, timed[ROW, i])
            frame_index[n], boot[n] = timed[FRAME_INDEX, i], timed[BOOT, i]
            t_boot_us[n], t_rx_us[n] = timed[T_BOOT_US, i], timed[T_RX_US, i]
            for axis in range(3):
                rpy_rad[n, axis] = float_in(payload, at[axis])
                w_nb_b_rad_s[n, axis] = float_in(payload, at[3 + axis])
            valid[n] = turn_of_rpy(rpy_rad, q_nb, n)
            n += 1
    return n


@kernel
def _read_quaternion(
    frames: Frames,
    buffer: Bytes,
    held: Bytes,
    timed: Int64Rows,
    in_window: Mask,
    at: Int64s,
    frame_index: Int64s,
    boot: Int64s,
    t_boot_us: Int64s,
    t_rx_us: Int64s,
    q_nb: FloatRows,
    w_nb_b_rad_s: FloatRows,
    valid: Mask,
    repr_offset_q: FloatRows,
) -> int:
    """Read each ATTITUDE_QUATERNION of the timed messages; return how many there are. q1…q4 are w, x, y, z."""
    n = 0
    for i in range(in_window.size):
        if timed[MESSAGE, i] == QUATERNION and in_window[i]:
            payload = _payload(frames, buffer, held, timed[ROW, i])
            frame_index[n], boot[n] = timed[FRAME_INDEX, i], timed[BOOT, i]
            t_boot_us[n], t_rx_us[n] = timed[T_BOOT_US, i], timed[T_RX_US, i]
            norm2 = 0.0
            for k in range(4):
                q_nb[n, k] = float_in(payload, at[k])
                norm2 += q_nb[n, k] * q_nb[n, k]
                repr_offset_q[n, k] = float_in(payload, at[7] + 4 * k)
            valid[n] = abs(np.sqrt(norm2) - 1.0) <= NORM_TOLERANCE  # never where one is no number
            for axis in range(3):
                w_nb_b_rad_s[n, axis] = float_in(payload, at[4 + axis])
            n += 1
    return n


class AttitudeReader:
    """Reads the two attitude streams."""

    def __init__(self, dialect: Dialect) -> None:
        """Look up where the fields are."""
        self._euler_at = offsets(dialect[ATTITUDE], "roll", "pitch", "yaw", *_RATES)
        self._quaternion_at = offsets(dialect[ATTITUDE_QUATERNION], "q1", "q2", "q3", "q4", *_RATES, "repr_offset_q")

    def read(self, batch: SortedFrames, share: Share, timed: TimedMessages) -> tuple[AttitudeSamples, AttitudeSamples]:
        """The samples of both streams whose boot time is believed, as far as they are in the window.

        `repr_offset_q` is for displays and not applied.
        """
        held = len(timed.held) > 0
        euler = quaternion = None
        if n := share.counts[EULER] + held:
            euler = room_for_attitudes(ATTITUDE, n)
            assert euler.rpy_rad is not None
            euler = euler.first(
                _read_euler(
                    batch.frames,
                    batch.buffer,
                    timed.held,
                    timed.columns,
                    timed.in_window,
                    self._euler_at,
                    euler.frame_index,
                    euler.boot,
                    euler.t_boot_us,
                    euler.t_rx_us,
                    euler.q_nb,
                    euler.w_nb_b_rad_s,
                    euler.valid,
                    euler.rpy_rad,
                )
            )
        if n := share.counts[QUATERNION] + held:
            quaternion = room_for_attitudes(ATTITUDE_QUATERNION, n)
            assert quaternion.repr_offset_q is not None
            quaternion = quaternion.first(
                _read_quaternion(
                    batch.frames,
                    batch.buffer,
                    timed.held,
                    timed.columns,
                    timed.in_window,
                    self._quaternion_at,
                    quaternion.frame_index,
                    quaternion.boot,
                    quaternion.t_boot_us,
                    quaternion.t_rx_us,
                    quaternion.q_nb,
                    quaternion.w_nb_b_rad_s,
                    quaternion.valid,
                    quaternion.repr_offset_q,
                )
            )
        return euler or _NO_EULER, quaternion or _NO_QUATERNION
