"""A real terminal: tmux, with a shell in it, whose screen can be read as text."""

from __future__ import annotations

import itertools
import os
import shlex
import shutil
import subprocess
from typing import Self

import pytest

from tests.helpers.live_links import PROGRAM, wait_until
from tests.helpers.paths import ROOT

__all__ = ["GCS_BRIDGE", "Tmux", "has_tmux"]

has_tmux = pytest.mark.skipif(not shutil.which("tmux"), reason="a real terminal: apt-get install tmux")
GCS_BRIDGE = shlex.join(PROGRAM)  # to be typed
_PROMPT = "ready> "
_numbers = itertools.count()


class Tmux:
    """A terminal of so many columns and rows; `shown()` is what is on it, without what hangs over at its right."""

    def __init__(self, width: int = 80, height: int = 24, **environment: str) -> None:
        self._server = ("tmux", "-L", f"gcs-bridge-{os.getpid()}-{next(_numbers)}", "-f", os.devnull)
        shell = (
            "env",
            f"PS1={_PROMPT}",
            "PYTHONPATH=" + str(ROOT),
            *(f"{k}={v}" for k, v in environment.items()),
            "sh",
        )
        self._tmux("-u", "new-session", "-d", "-x", str(width), "-y", str(height), "-c", str(ROOT), *shell)

    def __enter__(self) -> Self:
        self.wait_for(_PROMPT.strip())
        return self

    def __exit__(self, *_: object) -> None:
        subprocess.run([*self._server, "kill-server"], check=False, capture_output=True)

    def type(self, text: str) -> None:
        """Type a line."""
        self._tmux("send-keys", "-l", text)
        self.press("Enter")

    def press(self, *keys: str) -> None:
        """Press keys, by tmux's names of them."""
        self._tmux("send-keys", *keys)

    def resize(self, width: int, height: int) -> None:
        self._tmux("resize-window", "-x", str(width), "-y", str(height))

    def shown(self, *, codes: bool = False) -> str:
        """The screen's text; with the `codes` for colours and attributes if wanted."""
        return self._tmux("capture-pane", "-p", *(["-e"] if codes else []))

    def wait_for(self, *words: str, seconds: float = 30.0) -> str:
        """Wait until all of these are on the screen; return what is on it then."""
        found: list[str] = [""]

        def is_there() -> bool:
            found[0] = self.shown()
            return all(word in found[0] for word in words)

        try:
            wait_until(is_there, seconds)
        except AssertionError:
            pytest.fail(f"waited in vain for {words}; this is shown:\n{found[0]}")
        return found[0]

    def wait_for_prompt(self, seconds: float = 30.0) -> str:
        """Wait until the shell is asked again; return what is on the screen then."""
        wait_until(lambda: self.shown().rstrip().endswith(_PROMPT.strip()), seconds)
        return self.shown()

    def _tmux(self, *arguments: str) -> str:
        return subprocess.run([*self._server, *arguments], check=True, capture_output=True, text=True).stdout
