"""How fast a vehicle's velocity changes, from one LOCAL_POSITION_NED to the next (m/s, MAVLink common.xml)."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from gcs_bridge.columns import Floats, Int64s, Records
from gcs_bridge.jit import kernel
from gcs_bridge.mavlink.decode import float_in, offsets, unsigned_in
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.telemetry.batches import VelocityChange
from gcs_bridge.telemetry.messages import KIND
from gcs_bridge.telemetry.sorting import Share, SortedFrames

_NAME = "LOCAL_POSITION_NED"
_KIND = KIND[_NAME]
_GAP_S = 2.0
_LAST = np.dtype([("t_s", "f8"), ("velocity_m_s", "f8", (3,))])
_NONE = VelocityChange(frame_index=np.empty(0, np.int64), acceleration_m_s2=np.empty(0))


@kernel
def _follow(
    frames: Frames,
    buffer: Bytes,
    by_message: Int64s,
    start: int,
    end: int,
    first: int,
    at: Int64s,
    last: Annotated[Records, _LAST],
    frame_index: Int64s,
    acceleration_m_s2: Floats,
) -> None:
    """Read each LOCAL_POSITION_NED from `start` to `end` of `by_message`."""
    before = last[0]
    for i in range(start, end):
        row = by_message[i]
        payload = (buffer, np.int64(frames[row].payload), np.int64(frames[row].length))
        t_s = unsigned_in(payload, at[3], 4) * 1e-3
        change2 = 0.0
        for axis in range(3):
            speed = float_in(payload, at[axis])
            change2 += (speed - before.velocity_m_s[axis]) ** 2
            before.velocity_m_s[axis] = speed
        dt_s = t_s - before.t_s
        before.t_s = t_s
        frame_index[i - start] = first + row
        acceleration_m_s2[i - start] = np.sqrt(change2) / dt_s if 0.0 < dt_s <= _GAP_S else np.nan


class VelocityReader:
    """Reads LOCAL_POSITION_NED of one vehicle."""

    def __init__(self, dialect: Dialect) -> None:
        """Start with nothing heard."""
        self._at = offsets(dialect[_NAME], "vx", "vy", "vz", "time_boot_ms") if _NAME in dialect else None
        self._last = np.zeros(1, _LAST)
        self._last["t_s"] = np.nan  # none yet

    def read(self, batch: SortedFrames, share: Share) -> VelocityChange:
        """Each of the messages; NaN for the first one, and behind a gap of 2 s."""
        n = share.counts[_KIND]
        if not n or self._at is None:
            return _NONE
        frame_index, acceleration_m_s2 = np.empty(n, np.int64), np.empty(n)
        _follow(
            batch.frames,
            batch.buffer,
            batch.by_message,
            share.starts[_KIND],
            share.starts[_KIND + 1],
            batch.first,
            self._at,
            self._last,
            frame_index,
            acceleration_m_s2,
        )
        return VelocityChange(frame_index=frame_index, acceleration_m_s2=acceleration_m_s2)
