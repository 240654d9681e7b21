"""The kinds of recording: by its suffix a file finds its reader, and which suffixes there are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_bridge.recordings.packed import SUFFIXES

if TYPE_CHECKING:  # what only looks for recordings in folders does not read them
    from gcs_bridge.recordings.source import Source

__all__ = ["READERS", "Reader", "open_recording"]

# Of a path and a dialect; the flag tells whether it is to be judged.
Reader = Callable[[Path, str, bool], AbstractContextManager["Source"]]


@contextmanager
def _telemetry(path: Path, dialect: str, judged: bool) -> Iterator[Source]:
    """MAVLink as it was received; whether with times is told by the content, whatever the suffix says."""
    from gcs_bridge.recordings.source import open_telemetry

    with open_telemetry(path, dialect, judged=judged) as source:
        yield source


# By lower-case suffix; what has another is read as telemetry too, and refused by its content.
READERS: dict[str, Reader] = dict.fromkeys(SUFFIXES, _telemetry)


def open_recording(path: Path, dialect: str = "all", *, judged: bool = True) -> AbstractContextManager[Source]:
    """The recording, open; SourceError where it cannot be used, also later while it is read."""
    return READERS.get(path.suffix.lower(), _telemetry)(path, dialect, judged)
