"""What a viewer is: where what is judged is shown. This one shows nothing; the others are its kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from gcs_bridge.errors import UsageError
from gcs_bridge.sinks.base import Sink

if TYPE_CHECKING:  # none is needed to open a viewer
    from gcs_bridge.events import Event

__all__ = ["FORMS", "SUFFIX", "UTC", "WRITTEN", "Beside", "Say", "Viewer", "ViewerOptions", "ViewerSink", "ViewerSpec"]

Say = Callable[[str], None]

SUFFIX = ".rrd"
UTC = "utc"
"""The timeline of receive times."""
# The kinds of viewer, and how each is asked for; `viewer.open.OPENERS` opens them.
WRITTEN = {"auto": "auto", "native": "native", "web": "web", "save": f"save:FILE{SUFFIX}", "none": "none"}
*_FIRST, _LAST = WRITTEN.values()
FORMS = f"{', '.join(_FIRST)} or {_LAST}"


@dataclass(frozen=True)
class ViewerSpec:
    """What `--viewer` asks for: a kind of `WRITTEN`, and of one that is a file its path."""

    kind: str
    path: Path | None = None

    @classmethod
    def parse(cls, text: str) -> ViewerSpec:
        """The viewer that `auto`, `native`, `web`, `save:FILE.rrd` or `none` names; UsageError for anything else."""
        kind, colon, name = text.partition(":")
        takes_file = ":" in WRITTEN.get(kind, "")
        if kind not in WRITTEN or (colon and not takes_file):
            raise UsageError(f"--viewer {text}: must be {FORMS}")
        if not takes_file:
            return cls(kind)
        if Path(name).suffix != SUFFIX or not Path(name).stem:
            raise UsageError(
                f"--viewer {kind}:{name}: the name must end in {SUFFIX}, by which viewers know such a file"
            )
        return cls(kind, Path(name))


@dataclass(frozen=True)
class Beside:
    """One of several recordings that are shown side by side: `label` tells its vehicles from the others'.

    They meet on `timeline`, a name that all of them share: receive time, `UTC`, or the time since `zero`: an event of
    this one, a receive time (µs since 1970), or None: what is drawn of it first.
    """

    label: str
    timeline: str
    zero: Event | int | None = None


@dataclass(frozen=True, kw_only=True)
class ViewerOptions:
    """How a viewer is to be opened, whatever its kind.

    `say` is told in one line what people must know, such as the web viewer's address. `live`: rows come one by one, are
    shown at once and may go on for days; else they are recordings, and are kept whole. `sources` are files that are not
    to be written over. `server_memory_limit` is that of the history kept for viewers that come late, such as "256MiB".
    """

    say: Say
    sources: Sequence[Path] = ()
    live: bool = False
    server_memory_limit: str | None = None


class ViewerSink(Sink):
    """Takes what is told of one link session or recording. This one draws nothing; the others draw it."""

    def finish(self, at: Event | int | None = None) -> bool:
        """Nothing follows: lay the whole out, around `at` if given: an event's time, or a receive time (µs since 1970).

        Returns whether there was such a moment; else it is not laid out yet.
        """
        return at is None


class Viewer:
    """An open viewer, or none: a context manager that closes it.

    `kind` is what it became; `stays` whether this process serves the data, so that it must live while somebody looks.
    """

    kind: str = "none"
    stays: bool = False

    def recording(self, name: str) -> ViewerSink:
        """Where one link session, or one file, is drawn; a viewer shows one, or several side by side, but once."""
        return self.recordings(name, [None])[0]

    def recordings(self, name: str, several: Sequence[Beside | None]) -> list[ViewerSink]:  # noqa: ARG002  # nothing is drawn
        """Where each of several is drawn that are shown side by side as `name`; None: it is alone."""
        return [ViewerSink() for _ in several]

    def close(self) -> None:
        """Write out or hand over what is under way; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
