"""Plays recorded frames to a UDP port of this machine, at the pace at which they were received."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Sequence
from types import TracebackType

from gcs_bridge.mavlink.scanner import RawFrame

__all__ = ["Player"]


class Player:
    """Sends each frame as a datagram to 127.0.0.1 while the `with` block runs, `speed` times as fast as it was."""

    def __init__(self, frames: Sequence[RawFrame], port: int, *, speed: float = 1.0) -> None:
        """Take the frames in the order of their times."""
        self._frames = frames
        self._address = ("127.0.0.1", port)
        self._speed = speed
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._play, name="player", daemon=True)

    def __enter__(self) -> Player:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()

    def _play(self) -> None:
        began_s = time.monotonic()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for frame in self._frames:
                due_s = began_s + (frame.t_rx_us - self._frames[0].t_rx_us) / 1e6 / self._speed
                if self._ended.wait(max(due_s - time.monotonic(), 0)):
                    return
                sender.sendto(frame.data, self._address)
