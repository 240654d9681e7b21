"""How what is seen is shown: in a window, in a browser, as a file, or not at all."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

from gcs_bridge.errors import UsageError
from gcs_bridge.events import Event
from gcs_bridge.files import refuse_unwritable
from gcs_bridge.judging.observation import Observation

__all__ = ["Say", "Viewer", "ViewerSink", "ViewerSpec", "open_viewer"]

Kind = Literal["auto", "native", "web", "save", "none"]
Say = Callable[[str], None]

SUFFIX = ".rrd"


@dataclass(frozen=True)
class ViewerSpec:
    """What `--viewer` asks for."""

    kind: Kind
    path: Path | None = None

    @classmethod
    def parse(cls, text: str) -> ViewerSpec:
        """The viewer that `auto`, `native`, `web`, `save:FILE.rrd` or `none` names; UsageError for anything else."""
        match text.partition(":"):
            case ("auto" | "native" | "web" | "none") as kind, "", "":
                return cls(kind)
            case "save", _, name if Path(name).suffix == SUFFIX and Path(name).stem:
                return cls("save", Path(name))
            case "save", _, name:
                raise UsageError(
                    f"--viewer save:{name}: the name must end in {SUFFIX}, by which viewers know such a file"
                )
        raise UsageError(f"--viewer {text}: must be auto, native, web, save:FILE{SUFFIX} or none")


class ViewerSink:
    """Takes what a Monitor tells of one link or recording. This one draws nothing; the others draw it."""

    def observe(self, observation: Observation) -> None:
        """Take samples and their comparison; to be given to `Monitor(observer=…)`. Waits for no viewer."""

    def event(self, event: Event) -> None:
        """Take an event as the Monitor returns it."""

    def finish(self, at: Literal["alarm"] | int | None = None) -> bool:
        """Nothing follows: lay the whole out, around `at` if given: the first alarm, or a receive time (µs since 1970).

        Returns whether there was such a moment.
        """
        return at is None


class Viewer:
    """An open viewer, or none: a context manager that closes it.

    `kind` is what it became; `stays` whether this process serves the data, so that it must live while somebody looks.
    """

    kind: Kind = "none"
    stays: bool = False

    def recording(self, name: str) -> ViewerSink:  # noqa: ARG002  # subclasses name it
        """Where one link session, or one file, is drawn."""
        return ViewerSink()

    def close(self) -> None:
        """Write out or hand over what is under way; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_viewer(
    spec: ViewerSpec | str,
    *,
    say: Say,
    sources: Sequence[Path] = (),
    live: bool = False,
    server_memory_limit: str | None = None,
) -> Viewer:
    """Open a viewer; it never waits for one to come.

    `say` is told in one line what people must know, such as the web viewer's address. `live`: rows come one by one, are
    shown at once and may go on for days; else they are recordings, and are kept whole. `sources` are files that are not
    to be written over. `server_memory_limit` is that of the history kept for viewers that come late, such as "256MiB".

    Raises UsageError where there is no display for `native`, no port, or the file cannot be written.
    """
    spec = spec if isinstance(spec, ViewerSpec) else ViewerSpec.parse(spec)
    if spec.kind == "none":
        return Viewer()
    if spec.path is not None:
        refuse_unwritable(spec.path, sources=list(sources))
        from gcs_bridge.viewer.saved import SavedViewer

        return SavedViewer(spec.path, live=live)
    native = has_display()
    if spec.kind == "native" and not native:
        raise UsageError("--viewer native: there is no display here (DISPLAY and WAYLAND_DISPLAY are empty); try web")
    from gcs_bridge.viewer.served import ServedViewer

    why = "" if native or spec.kind == "web" else "no display here; "
    kind: Literal["native", "web"] = "native" if native and spec.kind != "web" else "web"
    return ServedViewer(kind, say=say, why=why, live=live, server_memory_limit=server_memory_limit)


def has_display() -> bool:
    """Whether a window can be opened; without a display, the viewer's start would hang instead of failing."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
