"""All frames of a vehicle, whatever is in them: when it was heard, while a transfer went on, or while it may restart.

A transfer is what autopilots send on request and in bulk: parameters, missions, files, logs. They slow their other
messages meanwhile, or stop them (ArduPilot: GCS_Common.cpp), and say nothing of it.
"""

from __future__ import annotations

import numpy as np

from gcs_bridge.columns import FrameColumns, Int64s, Mask, record
from gcs_bridge.jit import kernel
from gcs_bridge.telemetry.messages import KIND, TRANSFER
from gcs_bridge.telemetry.sorting import Kinds, Share, SortedFrames

_PARAMETER = KIND["PARAM_VALUE"]


@record
class HeardFrames(FrameColumns):
    """A vehicle's frames, n, in order of arrival.

    `heard_us` (n,) the time in which the link was heard up to each; `transfer` (n,) whether it is part of a transfer;
    `restarting` (n,) whether the vehicle may have restarted before it, and nothing has told its time since.
    """

    heard_us: Int64s
    transfer: Mask
    restarting: Mask


@kernel
def _hear(
    kind: Kinds,
    arrival: Int64s,
    in_window: Mask,
    start: int,
    end: int,
    first: int,
    link_heard_us: Int64s,
    restarts: Mask,
    frame_index: Int64s,
    heard_us: Int64s,
    transfer: Mask,
    restarting: Mask,
) -> int:
    """Look at the frames from `start` to `end` of `arrival` that are in the window; return how many there are."""
    n = 0
    for i in range(start, end):
        row = arrival[i]
        if in_window[row]:
            frame_index[n], heard_us[n] = first + row, link_heard_us[row]
            transfer[n] = kind[row] == TRANSFER or kind[row] == _PARAMETER
            restarting[n] = restarts[i - start]
            n += 1
    return n


def heard_frames(batch: SortedFrames, share: Share, restarting: Mask) -> HeardFrames:
    """One component's frames in the window; `restarting` (n,) of all of them."""
    n = share.end - share.start
    heard = HeardFrames(
        frame_index=np.empty(n, np.int64),
        heard_us=np.empty(n, np.int64),
        transfer=np.empty(n, np.bool_),
        restarting=np.empty(n, np.bool_),
    )
    found = _hear(
        batch.kind,
        batch.arrival,
        batch.in_window,
        share.start,
        share.end,
        batch.first,
        batch.clock.heard_us,
        restarting,
        heard.frame_index,
        heard.heard_us,
        heard.transfer,
        heard.restarting,
    )
    return heard if found == n else heard.first(found)


def no_frames() -> HeardFrames:
    """None at all."""
    none, nothing = np.empty(0, np.int64), np.empty(0, np.bool_)
    return HeardFrames(frame_index=none, heard_us=none, transfer=nothing, restarting=nothing)
