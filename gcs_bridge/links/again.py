"""What is done about a link that has gone: it is waited for, however long that takes."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from gcs_bridge.errors import SourceError

if TYPE_CHECKING:
    from gcs_bridge.links.link import Link

__all__ = ["FIRST_DELAY_S", "Awaited", "Reopening", "longer"]
FIRST_DELAY_S, _LONGEST_DELAY_S = 0.5, 5.0
_TOLD_S = 3.0  # an outage is told of as it begins; why it lasts, once it lasts


def longer(delay_s: float) -> float:
    """The time to wait after one that was in vain."""
    return min(2 * delay_s, _LONGEST_DELAY_S)


class Awaited:
    """A link that has gone and may return."""

    def fileno(self) -> int | None:
        """The descriptor that can be read once there is something to `take`; None: ask from time to time."""
        raise NotImplementedError

    def take(self) -> Link | None:
        """The link, as soon as it is there again. It is the taker's then."""
        raise NotImplementedError

    def close(self) -> None:
        """Wait no longer."""
        raise NotImplementedError

    def why(self) -> str | None:
        """Why it is not there yet, each reason once; None: nothing new."""
        return None


class Reopening(Awaited):
    """Opens a link again and again, at growing intervals, in a thread: to find that a host is off may take seconds."""

    def __init__(self, open_link: Callable[[], Link], delay_s: float) -> None:
        """Begin after `delay_s`."""
        self._open_link = open_link
        self._delay_s = delay_s
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._link: Link | None = None
        self._why: str | None = None
        self._told: set[str] = set()
        self._awake, self._wake = socket.socketpair()
        threading.Thread(target=self._run, name="reopening", daemon=True).start()

    def fileno(self) -> int | None:
        """That of a socket to which the thread writes."""
        return self._awake.fileno()

    def take(self) -> Link | None:
        """The link that was opened."""
        with self._lock:
            link, self._link = self._link, None
        if link is not None:
            self.close()
        return link

    def close(self) -> None:
        """Leave the thread to its end, which it finds by itself."""
        with self._lock:
            self._ended.set()
            link, self._link = self._link, None
            self._awake.close()
            self._wake.close()
        if link is not None:
            link.close()

    def why(self) -> str | None:
        """What kept it from being opened, once that has lasted."""
        why = self._why
        if why is None or why in self._told:
            return None
        self._told.add(why)
        return why

    def _run(self) -> None:
        delay_s, waited_s = self._delay_s, 0.0
        while not self._ended.wait(delay_s):
            waited_s += delay_s
            delay_s = longer(delay_s)
            try:
                link = self._open_link()
            except SourceError as error:
                if waited_s > _TOLD_S:
                    self._why = str(error)
                continue
            with self._lock:
                if not self._ended.is_set():
                    self._link = link
                    self._wake.send(b"!")
                    return
            link.close()
