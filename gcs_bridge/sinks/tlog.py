"""Records a link as a .tlog: before each frame its receive time, eight bytes, big-endian, µs since 1970."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_bridge.mavlink.scanner import RawFrame
from gcs_bridge.sinks.file import LiveFile

__all__ = ["TlogRecorder"]


class TlogRecorder:
    """Takes frames as `Monitor(on_frames=…)` shows them and writes them byte for byte, every batch at once."""

    def __init__(self, file: LiveFile) -> None:
        """Append to `file`."""
        self._file = file

    def record(self, _link: int | str, frames: Sequence[RawFrame]) -> None:
        """Write the frames; those of several links go into the one file, in the order in which they are read."""
        self._file.append(b"".join(t_rx_us.to_bytes(8, "big") + data for t_rx_us, data in frames))
