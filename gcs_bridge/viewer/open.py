"""Chooses how what is seen is shown: in a window, in a browser, as a file, or not at all.

rerun is imported only when a viewer that needs it is opened.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from importlib import util
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_bridge.errors import UsageError
from gcs_bridge.files import refuse_unwritable
from gcs_bridge.sinks.base import Plan
from gcs_bridge.viewer.base import Say, Viewer, ViewerOptions, ViewerSpec

if TYPE_CHECKING:
    from gcs_bridge.sinks.base import Sink, SinkContext

__all__ = ["INSTALL", "OPENERS", "has_display", "is_installed", "open_viewer", "plan_viewer"]

INSTALL = "pip install rerun-sdk"
"""What brings the viewer where it was left out: it takes half of the room of all that is installed with it."""


def open_viewer(
    spec: ViewerSpec | str,
    *,
    say: Say,
    sources: Sequence[Path] = (),
    live: bool = False,
    server_memory_limit: str | None = None,
) -> Viewer:
    """Open a viewer; it never waits for one to come. The arguments are those of `ViewerOptions`.

    Raises UsageError where there is no display for `native`, no port, or the file cannot be written; where rerun is not
    installed, unless something live goes on without a picture as well.
    """
    spec = spec if isinstance(spec, ViewerSpec) else ViewerSpec.parse(spec)
    options = ViewerOptions(say=say, sources=sources, live=live, server_memory_limit=server_memory_limit)
    if not is_installed() and spec.kind != "none" and not (spec.kind == "auto" and live):
        raise UsageError(f"--viewer {spec.kind}: rerun is not installed: {INSTALL}")
    return OPENERS[spec.kind](spec, options)


def plan_viewer(text: str) -> Plan | None:
    """The sink of a live run that draws it in the viewer `text`; None where that is `none`."""
    spec = ViewerSpec.parse(text)

    def open_sink(context: SinkContext) -> Sink:
        viewer = context.stack.enter_context(open_viewer(spec, say=context.note, live=True))
        return viewer.recording(context.title)

    return None if spec.kind == "none" else Plan(open_sink)


def is_installed() -> bool:
    """Whether there is a viewer at all; asked without loading it."""
    return util.find_spec("rerun") is not None


def has_display() -> bool:
    """Whether a window can be opened; without a display, the viewer's start would hang instead of failing."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _auto(spec: ViewerSpec, options: ViewerOptions) -> Viewer:
    if not is_installed():
        options.say(f"no picture: rerun is not installed: {INSTALL}")
        return Viewer()
    return _native(spec, options) if has_display() else _web(spec, options, why="no display here; ")


def _native(_: ViewerSpec, options: ViewerOptions) -> Viewer:
    if not has_display():
        raise UsageError("--viewer native: there is no display here (DISPLAY and WAYLAND_DISPLAY are empty); try web")
    from gcs_bridge.viewer.served import ServedViewer

    return ServedViewer("native", options)


def _web(_: ViewerSpec, options: ViewerOptions, *, why: str = "") -> Viewer:
    from gcs_bridge.viewer.served import ServedViewer

    return ServedViewer("web", options, why=why)


def _save(spec: ViewerSpec, options: ViewerOptions) -> Viewer:
    assert spec.path is not None
    refuse_unwritable(spec.path, sources=list(options.sources))
    from gcs_bridge.viewer.saved import SavedViewer

    return SavedViewer(spec.path, live=options.live)


def _none(_: ViewerSpec, __: ViewerOptions) -> Viewer:
    return Viewer()


# By what `viewer.base.WRITTEN` calls them.
OPENERS: dict[str, Callable[[ViewerSpec, ViewerOptions], Viewer]] = {
    "auto": _auto,
    "native": _native,
    "web": _web,
    "save": _save,
    "none": _none,
}
