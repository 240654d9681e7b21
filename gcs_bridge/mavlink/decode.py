"""Payloads to numbers: field by field inside kernels, or all fields of one message at once as a structured array.

What the wire cut off a payload (trailing zeros) is zero again. What a field means is not known here.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from gcs_bridge.columns import Int64s
from gcs_bridge.jit import helper, kernel
from gcs_bridge.mavlink.dialect import Message
from gcs_bridge.mavlink.scan import Bytes, Frames, integer_at

# A `payload` is a tuple of the buffer that it lies in, its first byte there, and its length.


@helper
def unsigned_in(payload: Any, offset: Any, size: Any) -> Any:
    """The unsigned integer of `size` bytes at `offset`; of eight bytes as int64."""
    buf, at, length = payload
    if offset + size <= length:  # by itself: of a size that is known, the loop is unrolled
        return integer_at(buf, at + offset, size)
    return integer_at(buf, at + offset, length - offset)


@helper
def int16_in(payload: Any, offset: Any) -> Any:
    """The signed integer of two bytes at `offset`."""
    value = unsigned_in(payload, offset, 2)
    return value - ((value & 0x8000) << 1)


@helper
def float_in(payload: Any, offset: Any) -> Any:
    """The float of four bytes at `offset`, as float64."""
    return np.float64(np.uint32(unsigned_in(payload, offset, 4)).view(np.float32))


def place_of(message: Message, field: str) -> tuple[int, int]:
    """Where in the payload a field begins, and how many bytes it has."""
    fields = message.dtype.fields
    assert fields is not None  # every message has some
    layout, offset = fields[field][:2]
    return offset, layout.itemsize


@cache
def offsets(message: Message, *fields: str) -> Int64s:
    """Where in the payload each of the fields begins, for kernels."""
    return np.array([place_of(message, name)[0] for name in fields], np.int64)


@kernel
def gather(buf: Bytes, payload: npt.NDArray[np.int32], length: npt.NDArray[np.int32], out: Annotated[Bytes, 2]) -> None:
    """Copy each payload into its row of `out`."""
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
