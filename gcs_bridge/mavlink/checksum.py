"""The checksum of one frame, for who makes frames; the scan has its own part of it."""

from __future__ import annotations

import numpy as np

from gcs_bridge.jit import kernel
from gcs_bridge.mavlink.scan import Bytes, crc_of, crc_with_byte


@kernel
def frame_crc(buf: Bytes, start: int, stop: int, crc_extra: int) -> int:
    """The checksum of a frame whose header behind the magic byte starts at `start` and whose payload ends at `stop`."""
    return crc_with_byte(crc_of(buf, start, stop, np.int64(0xFFFF)), np.int64(crc_extra))  # type: ignore[no-any-return]  # numba types it
