"""RAW_IMU, SCALED_IMU* and HIGHRES_IMU from the wire: specific force, angular rate and magnetic field in body axes.

They come in three scales, which are told apart here, and some on a clock of their own (MAVLink common.xml).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from gcs_bridge.columns import FloatRows, Floats, Int64Rows, Int64s, Mask, Records
from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.decode import float_in, int16_in, offsets, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.clocks import BOOT, FRAME_INDEX, OFFSET, ROW, T_BOOT_US, TimedMessages, on_boot_clock
from gcs_bridge.telemetry.imu_units import UnitResolver
from gcs_bridge.telemetry.messages import KIND, TIMED
from gcs_bridge.telemetry.samples import ImuSamples, room_for_imu
from gcs_bridge.telemetry.sorting import Share, SortedFrames

_AXES = [f"{axis}{of}" for of in ("acc", "gyro", "mag") for axis in "xyz"]


# Helpers of kernels carry no types: numba types them anew wherever they are compiled into one.


@helper
def _read_axes(payload, at, of, floats, scales, out, n):  # type: ignore[no-untyped-def]  # typed by numba
    """The three numbers of sensor `of`, as they are on the wire, times its scale."""
    for axis in range(3):
        field = at[3 * of + axis]
        out[n, axis] = (float_in(payload, field) if floats else np.float64(int16_in(payload, field))) * scales[of]


@kernel
def _read_imu(
    frames: Frames,
    buffer: Bytes,
    by_message: Int64s,
    start: int,
    end: int,
    first: int,
    in_window: Mask,
    at: Int64s,
    floats: bool,
    milliseconds: bool,
    scales: Floats,
    timed: Int64Rows,
    boot_before: int,
    us_before: int,
    offset: Annotated[Records, OFFSET],
    frame_index: Int64s,
    boot: Int64s,
    t_boot_us: Int64s,
    t_rx_us: Int64s,
    t_us: Int64s,
    f_b_m_s2: FloatRows,
    w_b_rad_s: FloatRows,
    m_b_gauss: FloatRows,
) -> int:
    """Read each IMU message from `start` to `end` of `by_message` in the window; return how many there are.

    `timed`: the timed messages of the component, and before them the boot and time last believed.
    """
    n = behind = 0
    for i in range(start, end):
        row = by_message[i]
        if not in_window[row]:
            continue
        frame = frames[row]
        payload = (buffer, np.int64(frame.payload), np.int64(frame.length))
        while behind < timed.shape[1] and timed[FRAME_INDEX, behind] < first + row:
            behind += 1
        if behind:
            boot_before, us_before = timed[BOOT, behind - 1], timed[T_BOOT_US, behind - 1]
        frame_index[n], boot[n], t_rx_us[n], t_boot_us[n] = first + row, boot_before, frame.t_rx_us, -1
        if milliseconds:  # it keeps the clock itself; of the two that show a change of it neither is a sample
            t_us[n] = unsigned_in(payload, at[9], 4) * 1000
            if behind < timed.shape[1] and timed[ROW, behind] == row:
                t_boot_us[n] = timed[T_BOOT_US, behind]
        else:
            t_us[n] = unsigned_in(payload, at[9], 8)
            if us_before >= 0:
                t_boot_us[n] = on_boot_clock(offset[0], boot_before, t_us[n], us_before)
        _read_axes(payload, at, 0, floats, scales, f_b_m_s2, n)
        _read_axes(payload, at, 1, floats, scales, w_b_rad_s, n)
        _read_axes(payload, at, 2, floats, scales, m_b_gauss, n)
        n += 1
    return n


class ImuReader:
    """Reads one IMU message of one vehicle."""

    def __init__(self, name: str, dialect: Dialect) -> None:
        """Start with nothing heard; `name` is one of IMU_MESSAGES."""
        message = dialect[name]
        self.kind = KIND[name]
        self._name = name
        self._milliseconds = name in TIMED
        self._at = offsets(message, *_AXES, "time_boot_ms" if self._milliseconds else "time_usec")
        self._floats = message.dtype[_AXES[0]].kind == "f"
        self._offset = np.zeros(1, OFFSET)
        self._units = UnitResolver(name)
        self._scales = _AS_SENT if self._units.units is None else np.array(self._units.units[:3])

    def read(
        self, batch: SortedFrames, share: Share, timed: TimedMessages, autopilot: str, autopilot_frame_index: int
    ) -> ImuSamples:
        """The samples in the window, on the vehicle's boot clock: −1 before its first time.

        `timed`: the vehicle's timed messages in the batch; `autopilot`: its name as told with that frame.
        """
        units = self._units.units
        samples = room_for_imu(self._name, "" if units is None else units.scale, share.count(self.kind))
        samples = samples.first(
            _read_imu(
                batch.frames,
                batch.buffer,
                batch.by_message,
                share.starts[self.kind],
                share.starts[self.kind + 1],
                batch.first,
                batch.in_window,
                self._at,
                self._floats,
                self._milliseconds,
                self._scales,
                timed.columns,
                *timed.before,
                self._offset,
                samples.frame_index,
                samples.boot,
                samples.t_boot_us,
                samples.t_rx_us,
                samples.t_us,
                samples.f_b_m_s2,
                samples.w_b_rad_s,
                samples.m_b_gauss,
            )
        )
        return samples if units is not None else self._resolved(samples, autopilot, autopilot_frame_index)

    def _resolved(self, samples: ImuSamples, autopilot: str, autopilot_frame_index: int) -> ImuSamples:
        """Samples as they were sent, in their units as far as these are known by now."""
        since = int(np.searchsorted(samples.frame_index, autopilot_frame_index))
        units, known_from = self._units.resolve(samples.f_b_m_s2, autopilot, since)
        if self._units.units is not None:
            self._scales = np.array(units[:3])
        for numbers, scale in zip((samples.f_b_m_s2, samples.w_b_rad_s, samples.m_b_gauss), units[:3], strict=True):
            numbers *= scale
            numbers[:known_from] = np.nan
        return replace(samples, scale=units.scale)


_AS_SENT: Floats = np.ones(3)
