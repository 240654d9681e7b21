"""Pages as files: one recording's page alone, of several an overview with a page each in a folder beside it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from urllib.parse import quote

from gcs_bridge.files import write_file, writing
from gcs_bridge.pages.curves import Curves
from gcs_bridge.pages.page import overview, page
from gcs_bridge.report.schema import File

__all__ = ["page_name", "write_pages"]


def write_pages(output: Path, entries: Sequence[File], curves: Mapping[str, Curves], refused: Sequence[str]) -> None:
    """Write the page of some recordings to `output`; `curves` by the entries' paths. UsageError: it cannot be."""
    if len(entries) == 1 and not refused:
        (entry,) = entries
        write_file(page(entry, curves[entry.path]), output)
        return
    folder = output.with_name(f"{output.stem}-pages")
    with writing(folder):
        folder.mkdir(exist_ok=True)
    names = _names(entries)
    for entry, name in zip(entries, names, strict=True):
        write_file(page(entry, curves[entry.path], back=f"../{quote(output.name)}"), folder / name)
    links = [f"{quote(folder.name)}/{quote(name)}" for name in names]
    write_file(overview(entries, links, refused), output)


def page_name(path: str) -> str:
    """How the page of the recording at a path is called, without an ending: any file system can have that."""
    return re.sub(r"[^\w.-]+", "_", PurePath(path).name).strip("._") or "recording"


def _names(entries: Sequence[File]) -> list[str]:
    """A file name for each, no two alike on any file system."""
    names: list[str] = []
    taken: set[str] = set()
    for entry in entries:
        stem = page_name(entry.path)
        name, n = stem, 1
        while name.lower() in taken:
            n += 1
            name = f"{stem}-{n}"
        taken.add(name.lower())
        names.append(f"{name}.html")
    return names
