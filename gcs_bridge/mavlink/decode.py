"""Frames to structured arrays: all payloads of one message gathered at once. What a field means is not known here."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import numpy.typing as npt

from gcs_bridge.jit import kernel
from gcs_bridge.mavlink.dialect import Message
from gcs_bridge.mavlink.scan import Bytes, Frames


@kernel
def gather(buf: Bytes, payload: npt.NDArray[np.int32], length: npt.NDArray[np.int32], out: Annotated[Bytes, 2]) -> None:
    """Copy each payload into its row of `out`; what the wire cut off (trailing zeros) is zero again."""
    size = out.shape[1]
    for row in range(payload.size):
        taken = min(length[row], size)  # a newer dialect's frame may be longer than ours
        for i in range(taken):
            out[row, i] = buf[payload[row] + i]
        for i in range(taken, size):
            out[row, i] = 0


def decode(buffer: Bytes, frames: Frames, message: Message) -> npt.NDArray[np.void]:
    """The fields of `frames`, all of them `message`, as one structured array; `buffer` is what they were found in."""
    out = np.empty((len(frames), message.dtype.itemsize), np.uint8)
    gather(buffer, np.ascontiguousarray(frames["payload"]), np.ascontiguousarray(frames["length"]), out)
    return out.view(message.dtype)[:, 0]
