"""Records a link as a .tlog: before each frame its receive time, eight bytes, big-endian, µs since 1970."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gcs_bridge.sinks.file import FileSink

if TYPE_CHECKING:
    from gcs_bridge.mavlink.scanner import RawFrame

__all__ = ["TlogRecorder"]


class TlogRecorder(FileSink):
    """Takes frames and writes them byte for byte, every batch at once."""

    def frames(self, _link: int | str, frames: Sequence[RawFrame]) -> None:
        """Write the frames; those of several links go into the one file, in the order in which they are read."""
        self._file.append(b"".join(t_rx_us.to_bytes(8, "big") + data for t_rx_us, data in frames))
