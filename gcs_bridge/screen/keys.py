"""The keys: what a terminal sends for each, and what each is for."""

from __future__ import annotations

import re
from collections.abc import Iterator
from enum import Enum

__all__ = ["HELP", "HINTS", "SHELVE_S", "Key", "KeyReader"]


class Key(Enum):
    """What somebody wants."""

    NEXT_VEHICLE = "next vehicle"
    PREVIOUS_VEHICLE = "previous vehicle"
    NEXT_ALERT = "next alert"
    PREVIOUS_ALERT = "previous alert"
    ACKNOWLEDGE = "acknowledge"
    ACKNOWLEDGE_ALL = "acknowledge all"
    SHELVE = "shelve"
    UNSHELVE = "unshelve"
    BELL = "bell"
    REDRAW = "redraw"
    HELP = "help"
    QUIT = "quit"


_KEYS = {
    "\x1b[C": Key.NEXT_VEHICLE,
    "\x1b[D": Key.PREVIOUS_VEHICLE,
    "\x1b[B": Key.NEXT_ALERT,
    "\x1b[A": Key.PREVIOUS_ALERT,
    "\t": Key.NEXT_VEHICLE,
    "\x1b[Z": Key.PREVIOUS_VEHICLE,
    "l": Key.NEXT_VEHICLE,
    "h": Key.PREVIOUS_VEHICLE,
    "j": Key.NEXT_ALERT,
    "k": Key.PREVIOUS_ALERT,
    "a": Key.ACKNOWLEDGE,
    "A": Key.ACKNOWLEDGE_ALL,
    "s": Key.SHELVE,
    "u": Key.UNSHELVE,
    "b": Key.BELL,
    "\x0c": Key.REDRAW,
    "r": Key.REDRAW,
    "?": Key.HELP,
    "q": Key.QUIT,
}
HINTS = "←→ vehicle  ↑↓ alarm  a acknowledge  s shelve  u unshelve  ? help  q quit"
SHELVE_S = 600.0
HELP = (
    "← →  h l  Tab    another vehicle",
    "↑ ↓  k j         another alarm",
    "a                acknowledge the chosen alarm: somebody has seen it",
    "A                acknowledge all of them",
    "s                shelve it: nothing is told of it for ten minutes",
    "u                unshelve it",
    "b                the terminal's bell on or off",
    "r  Ctrl-L        draw the screen anew",
    "q  Ctrl-C        end, with the summary",
    "Ctrl-Z           stop, until fg; nothing is heard meanwhile",
    "?                this page; any key leaves it",
    "",
    "▲ WARNING   act at once: an alarm in reports and events",
    "■ CAUTION   know at once, act later: a warning in reports and events",
    "● ADVISORY  know: silent, lost, NO COMPARE, INOP",
    "An alarm is not ack'd, acknowledged, or gone and not ack'd; or shelved.",
    "Roll, pitch and yaw take the vehicle's body (FRD) to the world (NED).",
)
# What a key sends: CSI and SS3 sequences, of which the latter are cursor keys in another mode, else one character.
_SENT = re.compile(r"\x1b\[[0-9;?]*[ -/]*[@-~]|\x1bO.|\x1b[^\[O\x1b]|\x1b(?=\x1b)|[^\x1b]", re.DOTALL)
_LONGEST = 16  # a sequence; what is longer is none


class KeyReader:
    """Makes keys of what a terminal sends, cut anywhere; what is no key of ours is dropped."""

    def __init__(self) -> None:
        """Start with nothing sent."""
        self._rest = ""

    def read(self, data: bytes) -> Iterator[Key]:
        """Yield the keys that are whole by now."""
        text, end = self._rest + data.decode("utf-8", "replace"), 0
        while match := _SENT.match(text, end):
            end = match.end()
            sent = match[0].replace("\x1bO", "\x1b[", 1)
            if sent in _KEYS:
                yield _KEYS[sent]
        self._rest = text[end:] if len(text) - end < _LONGEST else ""
