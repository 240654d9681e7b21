"""Everything below an entity that somebody else has chosen: paths, frames, and the layout that shows them."""

from __future__ import annotations

from typing import Any

import rerun as rr
import rerun.blueprint as rrb

__all__ = ["FRAME", "frame_below", "move_below", "path_below"]

FRAME = "tf#/"
"""rerun's name of an entity's own frame is this, and then its path."""


def path_below(prefix: str, path: str) -> str:
    """An entity's path; nothing is moved by an empty prefix.

    >>> path_below("flights/first", "axes/labels"), path_below("flights/first", "/"), path_below("", "/")
    ('flights/first/axes/labels', 'flights/first', '/')
    """
    return "/".join(part for part in (prefix, path.strip("/")) if part) or "/"


def frame_below(prefix: str, frame: rr.CoordinateFrame) -> rr.CoordinateFrame:
    """The same for an entity's frame, given by its name."""
    assert frame.frame is not None
    (name,) = frame.frame.as_arrow_array().to_pylist()
    return rr.CoordinateFrame(f"{FRAME}{path_below(prefix, name.removeprefix(FRAME))}")


def move_below(prefix: str, part: Any) -> None:
    """The same for all views below `part` of a layout, a container or a view."""
    if isinstance(part, rrb.Container):
        for inner in part.contents:
            move_below(prefix, inner)
        return
    part.origin = f"/{path_below(prefix, part.origin)}"
    contents = [part.contents] if isinstance(part.contents, str) else part.contents
    part.contents = [_query_below(prefix, query) for query in contents]
    overridden = part.visualizer_overrides.items()
    part.visualizer_overrides = {f"/{path_below(prefix, path)}": override for path, override in overridden}


def _query_below(prefix: str, query: str) -> str:
    sign, space, path = query.rpartition(" ")
    return query if path.startswith("$origin") else f"{sign}{space}/{path_below(prefix, path)}"
