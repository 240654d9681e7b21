"""Decoded messages as Arrow has them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from gcs_bridge.errors import one_line

if TYPE_CHECKING:
    from gcs_bridge.recordings.batches import MessageBatch

__all__ = ["record_batch"]

_BESIDE = ("sysid", "compid", "t_rx_us", "frame_index")


def record_batch(batch: MessageBatch) -> pa.RecordBatch:
    """See `MessageBatch.to_arrow`."""
    n = len(batch)
    columns: dict[str, Any] = {
        "sysid": pa.array(np.full(n, batch.sysid, np.uint8)),
        "compid": pa.array(np.full(n, batch.compid, np.uint8)),
        "t_rx_us": pa.array(batch.t_rx_us, pa.int64(), mask=batch.t_rx_us <= 0),
        "frame_index": pa.array(batch.frame_index),
    }
    assert batch.fields.dtype.names is not None
    for name in batch.fields.dtype.names:
        columns[f"{name}_sent" if name in _BESIDE else name] = _column(batch.fields[name])
    return pa.RecordBatch.from_pydict(columns)


def _column(values: Any) -> pa.Array:
    if values.dtype.kind == "S":
        return pa.array([_text(value) for value in values.tolist()], pa.string())
    if values.ndim == 1:
        return pa.array(np.ascontiguousarray(values))
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _text(value: bytes) -> str:
    """A text from the air, up to its first zero, without control characters."""
    return one_line(value.partition(b"\0")[0].decode("utf-8", "replace"))
