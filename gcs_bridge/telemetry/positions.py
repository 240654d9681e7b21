"""Where a vehicle says that it is: GLOBAL_POSITION_INT, LOCAL_POSITION_NED, GPS_RAW_INT (MAVLink common.xml).

Nothing is judged by it: it is read only where somebody looks on. Latitude and longitude are degrees (WGS84) times 1e7,
altitudes mm above mean sea level; LOCAL_POSITION_NED is in m from an origin of the vehicle's own. What the wire says to
be unknown is NaN, and so is 0° north 0° east, which autopilots send before they know. Whether a place can be true is
not asked here. Each is stamped with the boot time known when it came: the next timed message is not waited for.
"""

from __future__ import annotations

import numpy as np

from gcs_bridge.columns import Floats, FrameColumns, Int64s, record
from gcs_bridge.mavlink.decode import decode
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.telemetry.clocks import BOOT, FRAME_INDEX, T_BOOT_US, TimedMessages
from gcs_bridge.telemetry.messages import KIND, POSITIONS
from gcs_bridge.telemetry.sorting import Share, SortedFrames

__all__ = ["GLOBAL", "GPS", "LOCAL", "NO_POSITIONS", "PositionReader", "PositionSamples"]

GLOBAL, LOCAL, GPS = range(len(POSITIONS))
_FIX_3D = 3  # GPS_FIX_TYPE: what is less has no altitude, or nothing at all


@record
class PositionSamples(FrameColumns):
    """Positions, n, in order of arrival: `message` (n,) of POSITIONS, boot and times (n,) in µs.

    `geodetic` (n, 3): latitude and longitude in degrees, metres above mean sea level; `p_n_m` (n, 3): in NED, m. Of
    each row one of them is all NaN.
    """

    message: Int64s
    boot: Int64s
    t_boot_us: Int64s
    t_rx_us: Int64s
    geodetic: Floats
    p_n_m: Floats


def _none() -> PositionSamples:
    none, no_places = np.empty(0, np.int64), np.empty((0, 3))
    return PositionSamples(
        frame_index=none,
        message=none,
        boot=none,
        t_boot_us=none,
        t_rx_us=none,
        geodetic=no_places,
        p_n_m=no_places,
    )


NO_POSITIONS = _none()


class PositionReader:
    """Reads the positions of one vehicle."""

    def __init__(self, dialect: Dialect) -> None:
        """Remember the messages that the dialect has."""
        self._messages = [(KIND[name], i, dialect[name]) for i, name in enumerate(POSITIONS) if name in dialect]

    def read(self, batch: SortedFrames, share: Share, timed: TimedMessages) -> PositionSamples:
        """Those in the window, from the first boot time on that is known; `timed`: the vehicle's timed messages."""
        parts = []
        for kind, message, layout in self._messages:
            if share.counts[kind]:
                rows = batch.rows(share, kind)
                rows = rows[batch.in_window[rows]]
                frames = batch.frames[rows]
                values = decode(batch.buffer, frames, layout)
                missing = np.full((len(rows), 3), np.nan)
                local = message == LOCAL
                parts.append(
                    PositionSamples(
                        frame_index=batch.first + rows,
                        message=np.full(len(rows), message),
                        boot=np.full(len(rows), -1),
                        t_boot_us=np.full(len(rows), -1),
                        t_rx_us=frames["t_rx_us"].astype(np.int64),
                        geodetic=missing if local else _geodetic(values, message),
                        p_n_m=_columns(values, "x", "y", "z") if local else missing,
                    )
                )
        return _stamped(PositionSamples.in_arrival(parts), timed) if parts else NO_POSITIONS


def _stamped(positions: PositionSamples, timed: TimedMessages) -> PositionSamples:
    """Give each the boot and boot time of the timed message before it."""
    before_boot, before_us = timed.before
    boots = np.concatenate(([before_boot], timed.columns[BOOT]))
    times_us = np.concatenate(([before_us], timed.columns[T_BOOT_US]))
    place = np.searchsorted(timed.columns[FRAME_INDEX], positions.frame_index, side="right")
    positions.boot[:], positions.t_boot_us[:] = boots[place], times_us[place]
    return positions.where(positions.t_boot_us >= 0)


def _geodetic(values: np.ndarray, message: int) -> Floats:
    """Latitude, longitude (degrees) and altitude (m); NaN where they are not known."""
    geodetic = _columns(values, "lat", "lon", "alt") * (1e-7, 1e-7, 1e-3)
    latitude, longitude, _ = geodetic.T
    known = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0) & ((latitude != 0.0) | (longitude != 0.0))
    if message == GPS:
        known &= values["fix_type"] >= _FIX_3D
    geodetic[~known] = np.nan
    return geodetic


def _columns(values: np.ndarray, *names: str) -> Floats:
    return np.column_stack([values[name].astype(np.float64) for name in names])
