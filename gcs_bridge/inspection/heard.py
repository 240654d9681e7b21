"""What an examination starts from: what was heard on a link or read of a recording, or why nothing could be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gcs_bridge.errors import SourceError
from gcs_bridge.events import Event
from gcs_bridge.judging.monitor import LinkCensus
from gcs_bridge.report.schema import File

__all__ = ["RECORDING", "SERIAL", "STREAM", "Heard", "Refused"]
RECORDING, STREAM = "recording", "stream"
"""The kinds of a file: with receive times, and without."""
SERIAL = "serial"


@dataclass(frozen=True, kw_only=True)
class Heard:
    """A link that was listened to, or a recording that was read: what was judged, counted and told of it.

    `typed`: how it is named on a command line. `seconds` that it was listened to; None of a file. `unreadable`: what
    it may be where no frame is found. `addresses`: by system, whence datagrams came.
    """

    name: str
    kind: str
    typed: str
    entry: File
    counted: LinkCensus
    events: Sequence[Event] = ()
    seconds: float | None = None
    unreadable: str = ""
    baud: int | None = None
    addresses: Mapping[int, Sequence[tuple[str, int]]] = field(default_factory=dict)

    @property
    def is_live(self) -> bool:
        """Whether it was listened to."""
        return self.seconds is not None


@dataclass(frozen=True, kw_only=True)
class Refused:
    """A link that could not be opened, or a file that could not be read."""

    name: str
    kind: str
    error: SourceError
