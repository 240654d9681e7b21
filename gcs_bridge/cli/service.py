"""What a service manager is told, and what it asks for: systemd's notices, and SIGHUP."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from types import FrameType, TracebackType
from typing import Any

__all__ = ["Hangup", "Notifier"]
_READY, _WATCHDOG, _STOPPING = "READY=1", "WATCHDOG=1", "STOPPING=1"


class Notifier:
    """Tells systemd that the program is ready, that its loop still comes round, and that it ends (sd_notify(3)).

    It says nothing where nobody has asked: NOTIFY_SOCKET names who has, WATCHDOG_USEC how often.
    """

    def __init__(self) -> None:
        """Take both out of the environment: programs that are started from here are not meant."""
        address = os.environ.pop("NOTIFY_SOCKET", "")
        within_us = os.environ.pop("WATCHDOG_USEC", "")
        meant = os.environ.pop("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self._address = "\0" + address[1:] if address.startswith("@") else address
        # Twice within the time, so that one that comes late is no reason to be killed.
        self._every_s = int(within_us) / 2e6 if within_us.isdecimal() and meant else None
        self._due_s = 0.0

    def descriptors(self) -> Sequence[int]:
        """None to wait on."""
        return ()

    def run(self) -> None:
        """The loop has come round."""
        if self._every_s is not None and time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + self._every_s
            self._tell(_WATCHDOG)

    def ready(self) -> None:
        """Links and files are open, and it begins to listen."""
        self._tell(_READY)

    def stopping(self) -> None:
        """It ends."""
        self._tell(_STOPPING)

    def _tell(self, what: str) -> None:
        if not self._address or sys.platform == "win32":
            return
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)  # a manager that is busy must not hold up what is listened to
            sender.sendto(what.encode(), self._address)


class Hangup:
    """Turns SIGHUP into a wish to open the files anew; where a terminal has closed, into a wish to end."""

    def __init__(self, reopen: Callable[[], None], end: Callable[[], None]) -> None:
        """`reopen` and `end` are called in the loop, not in the signal's handler."""
        self._reopen = reopen
        self._end = end
        self._asked = False
        self._had_terminal = _has_terminal()
        self._before: Any = None

    def __enter__(self) -> Hangup:
        if hasattr(signal, "SIGHUP"):
            self._before = signal.signal(signal.SIGHUP, self._on_signal)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if hasattr(signal, "SIGHUP"):
            signal.signal(signal.SIGHUP, self._before)

    def descriptors(self) -> Sequence[int]:
        """None to wait on: a signal ends the wait by itself, or the loop's tick does."""
        return ()

    def run(self) -> None:
        """Grant the wish."""
        if self._asked:
            self._asked = False
            if self._had_terminal and not _has_terminal():
                self._end()
            else:
                self._reopen()

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._asked = True


def _has_terminal() -> bool:
    """Whether there is a terminal that could close."""
    if os.name != "posix":
        return False
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK))
    except OSError:
        return False
    return True
