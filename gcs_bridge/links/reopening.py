"""A port that has gone is opened again, however long that takes."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from typing import Any

from gcs_bridge.errors import SourceError

__all__ = ["FIRST_DELAY_S", "Reopening", "longer"]
FIRST_DELAY_S, _LONGEST_DELAY_S = 0.5, 5.0
_TOLD_S = 3.0  # an outage is told of as it begins; why it lasts, once it lasts


def longer(delay_s: float) -> float:
    """The time to wait after one that was in vain."""
    return min(2 * delay_s, _LONGEST_DELAY_S)


class Reopening:
    """Opens a port again and again, at growing intervals, in a thread: to find that a host is off may take seconds."""

    def __init__(self, open_port: Callable[[], Any], delay_s: float) -> None:
        """Begin after `delay_s`. `open_port` raises SourceError where it cannot be opened yet."""
        self._open_port = open_port
        self._delay_s = delay_s
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._port: Any = None
        self._why: str | None = None
        self._told: set[str] = set()
        self._awake, self._wake = socket.socketpair()
        threading.Thread(target=self._run, name="reopening", daemon=True).start()

    def fileno(self) -> int:
        """A descriptor that can be read once there is something to `take`."""
        return self._awake.fileno()

    def take(self) -> Any:
        """The port, as soon as it is open: it is the taker's then; else None."""
        with self._lock:
            port, self._port = self._port, None
        if port is not None:
            self.close()
        return port

    def why(self) -> str | None:
        """Why it is not open yet, once that has lasted, and each reason once; None: nothing new."""
        why = self._why
        if why is None or why in self._told:
            return None
        self._told.add(why)
        return why

    def close(self) -> None:
        """Give up. The thread ends as soon as it can."""
        with self._lock:
            self._ended.set()
            port, self._port = self._port, None
            self._awake.close()
            self._wake.close()
        if port is not None:
            port.close()

    def _run(self) -> None:
        delay_s, waited_s = self._delay_s, 0.0
        while not self._ended.wait(delay_s):
            waited_s += delay_s
            delay_s = longer(delay_s)
            try:
                port = self._open_port()
            except SourceError as error:
                if waited_s > _TOLD_S:
                    self._why = str(error)
                continue
            with self._lock:
                if not self._ended.is_set():
                    self._port = port
                    self._wake.close()  # who waits for its other end wakes up: no byte is sent, not even here
                    return
            port.close()
