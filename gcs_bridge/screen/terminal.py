"""The terminal itself: taken and given back, written to without waiting, its size and its keys. POSIX alone.

Nothing here may hold up who listens: a terminal that takes nothing (Ctrl-S, a stalled SSH connection) is left alone
until it does, and pictures are left out meanwhile. So it is opened anew: if standard output did not wait, neither would
that of the shell, which is the same.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import signal
import sys
from types import FrameType, TracebackType
from typing import Any, Self

if sys.platform != "win32":
    import termios
    import tty

__all__ = ["Terminal"]

_LAST_WORDS_S = 0.5  # so long it is waited for a terminal that takes nothing, when it is given back
_FALLBACK_SIZE = (80, 24)
# Another screen, without wrapping and without a cursor; and back, from whatever attributes. It is blanked before that:
# what is left of it after a resize would come along in tmux.
_TAKE, _GIVE_BACK = b"\x1b[?1049h\x1b[?7l\x1b[?25l", b"\x1b[0m\x1b[2J\x1b[?25h\x1b[?7h\x1b[?1049l"


class Terminal:
    """The terminal that standard output is: a context manager that takes it and gives it back, whatever happens.

    Ctrl-Z gives it back, and `resume` takes it again. One that has gone (`has_gone`) is not touched any more.
    """

    def __init__(self, descriptor: int) -> None:
        """Take the terminal behind `descriptor`, which is this object's own and does not block, when it is entered."""
        self._descriptor = descriptor
        self._before: Any = None  # its attributes; None: it is not taken
        self._unsent = b""
        self._handler: Any = None
        self.has_gone = False

    @classmethod
    def of_stdout(cls) -> Terminal | None:
        """That of standard output; None where that is none, or not ours: another's, or in the background."""
        if sys.platform == "win32":
            return None
        try:
            if not sys.stdout.isatty():
                return None
            path = os.ttyname(sys.stdout.fileno())
            descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except (OSError, ValueError):  # a container may have a terminal without a name
            return None
        terminal = cls(descriptor)
        if terminal._is_ours():
            return terminal
        os.close(descriptor)
        return None

    def __enter__(self) -> Self:
        self._handler = signal.getsignal(signal.SIGTSTP)
        if self._handler is not signal.SIG_IGN:  # who started us would not know how to go on
            signal.signal(signal.SIGTSTP, self._on_stop)
        self.resume()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.signal(signal.SIGTSTP, self._handler)
        self._give_back()
        os.close(self._descriptor)
        self.has_gone = True

    @property
    def is_taken(self) -> bool:
        """Whether it may be drawn on."""
        return self._before is not None and not self.has_gone

    @property
    def takes_more(self) -> bool:
        """Whether it has taken all that was written."""
        return not self._unsent

    def fileno(self) -> int:
        """To be waited for, where it is taken."""
        return self._descriptor

    def resume(self) -> bool:
        """Take the terminal, if it is ours now and was not taken; whether it was: it shows nothing then."""
        if self._before is not None or self.has_gone or not self._is_ours():
            return False
        try:
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor, termios.TCSANOW)  # keys come at once; Ctrl-C and Ctrl-Z go on being signals
        except (OSError, termios.error):
            self.has_gone = True
            return False
        self._unsent = b""
        self.write(_TAKE)
        return True

    def size(self) -> tuple[int, int]:
        """Its columns and rows."""
        try:
            columns, rows = os.get_terminal_size(self._descriptor)
        except OSError:
            return _FALLBACK_SIZE
        return (columns, rows) if columns and rows else _FALLBACK_SIZE  # one that does not know says 0

    def write(self, data: bytes = b"") -> None:
        """Send what it takes at once, and keep the rest for the next time."""
        self._unsent += data
        if not self._unsent or not self.is_taken:
            return
        try:
            self._unsent = self._unsent[os.write(self._descriptor, self._unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self.has_gone = True

    def read(self) -> bytes:
        """What was typed."""
        if not self.is_taken:
            return b""
        try:
            data = os.read(self._descriptor, 1024)
        except BlockingIOError:
            return b""
        except OSError as error:
            self.has_gone = error.errno != errno.EINTR
            return b""
        self.has_gone = not data  # its other end has closed: it would be readable for ever
        return data

    def _is_ours(self) -> bool:
        """Whether this process is in its foreground; a terminal of another session has none that we could see."""
        try:
            return os.tcgetpgrp(self._descriptor) == os.getpgrp()
        except OSError:
            return False

    def _on_stop(self, _number: int, _frame: FrameType | None) -> None:
        """Ctrl-Z: give it back and stop. What follows is done after `fg` or `bg`; `resume` then takes it again."""
        self._give_back()
        signal.signal(signal.SIGTSTP, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTSTP)
        signal.signal(signal.SIGTSTP, self._on_stop)

    def _give_back(self) -> None:
        if self._before is None:
            return
        before, self._before = self._before, None
        if self.has_gone:
            return
        # What was cut off in the middle of a sequence would spoil the next one.
        rest = self._unsent + _GIVE_BACK
        with contextlib.suppress(OSError, termios.error):
            while rest and select.select([], [self._descriptor], [], _LAST_WORDS_S)[1]:
                rest = rest[os.write(self._descriptor, rest) :]
            termios.tcsetattr(self._descriptor, termios.TCSANOW, before)
            termios.tcflush(self._descriptor, termios.TCIFLUSH)  # keys were meant for us
