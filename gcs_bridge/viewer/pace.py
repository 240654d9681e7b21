"""Whether viewers take what is drawn as fast as it is: what they do not take would fill the memory.

rerun's server (0.41) keeps what a slow viewer has not taken yet, without a limit; one that is stopped it leaves alone
after half a minute. Whether anything waits is told by a flush, which ends when all has gone on.
"""

from __future__ import annotations

import threading

import rerun as rr

from gcs_bridge.viewer.base import Say

__all__ = ["Pace"]
_EACH_S, _WITHIN_S = 1.0, 2.0  # so often it is looked at, and so long a flush may take


class Pace:
    """Looks at a recording that is served, again and again, in a thread."""

    def __init__(self, recording: rr.RecordingStream, say: Say) -> None:
        """Begin; `say` is told once, from that thread, that something is left out."""
        self.is_kept = True  # else nothing more is to be drawn for now
        self._recording = recording
        self._say = say
        self._told = False
        self._ended = threading.Event()
        threading.Thread(target=self._look, daemon=True).start()

    def end(self) -> None:
        """Look no more."""
        self._ended.set()

    def _look(self) -> None:
        while not self._ended.wait(_EACH_S):
            try:
                self._recording.flush(timeout_sec=_WITHIN_S)
                self.is_kept = True
            except RuntimeError:  # rerun's: not within that time
                self.is_kept = False
                if not self._told and not self._ended.is_set():
                    self._told = True
                    self._say("viewer: it reads too slowly; what it cannot take is left out of it")
