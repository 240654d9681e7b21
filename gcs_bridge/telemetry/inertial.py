"""RAW_IMU, SCALED_IMU* and HIGHRES_IMU from the wire: specific force, angular rate and magnetic field in body axes.

They come in three scales, which are told apart here, and some on a clock of their own (MAVLink common.xml).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from gcs_bridge.columns import Floats, Int64Rows, Int64s, Mask, Records
from gcs_bridge.jit import kernel
from gcs_bridge.mavlink.decode import float_in, int16_in, offsets, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.clocks import BOOT, FRAME_INDEX, ROW, T_BOOT_US, TimedMessages
from gcs_bridge.telemetry.imu_units import UnitResolver, Units
from gcs_bridge.telemetry.messages import KIND, TIMED
from gcs_bridge.telemetry.other_clocks import OFFSET, on_boot_clock
from gcs_bridge.telemetry.samples import ImuSamples
from gcs_bridge.telemetry.sorting import Share, SortedFrames

_AXES = [f"{axis}{of}" for of in ("acc", "gyro", "mag") for axis in "xyz"]

# What no sensor measures is damage: once in a sum, it would be told as a fault for the rest of the flight.
_MOST_M_S2, _MOST_OTHER = 2000.0, 100.0  # rad/s and gauss


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
    measured: Annotated[Floats, 3],
) -> int:
    """Read each IMU message from `start` to `end` of `by_message` in the window; return how many there are.

    `timed`: the timed messages of the component, and before them the boot and time last believed. `measured` (3, n, 3):
    what the three sensors say, times their `scales`.
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
        for sensor in range(3):
            for axis in range(3):
                field = at[3 * sensor + axis]
                value = float_in(payload, field) if floats else np.float64(int16_in(payload, field))
                if floats and abs(value) > (_MOST_M_S2 if sensor == 0 else _MOST_OTHER):
                    value = np.nan
                measured[sensor, n, axis] = value * scales[sensor]
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
        n = share.counts[self.kind]
        frame_index, boot, t_boot_us, t_rx_us, t_us = (np.empty(n, np.int64) for _ in range(5))
        measured = np.empty((3, n, 3))
        found = _read_imu(
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
            frame_index,
            boot,
            t_boot_us,
            t_rx_us,
            t_us,
            measured,
        )
        units = self._units.units
        if units is None:
            since = int(np.searchsorted(frame_index[:found], autopilot_frame_index))
            units = self._resolve(measured[:, :found], autopilot, since)
        force, rates, field = measured
        return ImuSamples(
            frame_index=frame_index,
            boot=boot,
            t_boot_us=t_boot_us,
            t_rx_us=t_rx_us,
            t_us=t_us,
            f_b_m_s2=force,
            w_b_rad_s=rates,
            m_b_gauss=field,
            source=self._name,
            scale=units.scale,
        ).first(found)

    def _resolve(self, measured: Floats, autopilot: str, since: int) -> Units:
        """Bring numbers (3, n, 3) as they were sent into units, as far as these are known by now: NaN before."""
        units, known_from = self._units.resolve(measured[0], autopilot, since)
        scales = np.array(units[:3])
        measured *= scales[:, None, None]
        measured[:, :known_from] = np.nan
        if self._units.units is not None:
            self._scales = scales
        return units


_AS_SENT: Floats = np.ones(3)
