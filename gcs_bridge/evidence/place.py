"""Where evidence goes: DIR/<recording>/<alarm>/. A recording's folder is whole or not there."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable
from pathlib import Path

from gcs_bridge.errors import UsageError
from gcs_bridge.recordings.packed import name_of

__all__ = ["INDEX", "Folder", "Place"]

_MOST = 100  # alarms of a recording: more are told apart from a few, and not looked at
_MOST_OF_ALL = 500  # of a run: writing an .rrd costs 3 MB of memory for good (rerun 0.41)
INDEX = "evidence.json"  # what a folder holds; by it, one that may be replaced is known


class Place:
    """The folder that `--evidence` names, and within it one for each recording."""

    def __init__(self, path: Path, recordings: Iterable[Path]) -> None:
        """Refuse now what could not be written later, and touch nothing; UsageError says why."""
        self._path = path
        self._room = _MOST_OF_ALL
        self._folders = _folders(path, recordings)
        try:
            self._refuse()
        except OSError as error:  # it may not even be looked at
            raise UsageError(f"cannot write {path}: {error.strerror}") from None

    def folder(self, recording: Path, others: int = 0) -> Folder | None:
        """Where the evidence of one of the recordings goes, while that of so many others is not `taken` yet.

        None where there may be too little room for all of them: how much it has is known once they are done.
        """
        if others and self._room < _MOST * (others + 1):
            return None
        return Folder(self._folders[recording], min(self._room, _MOST))

    def taken(self, alarms: int) -> None:
        """Of a recording that is done, there is evidence of so many alarms."""
        self._room -= alarms

    def _refuse(self) -> None:
        if str(self._path) != str(self._path).encode("utf-8", "replace").decode():
            raise UsageError(f"cannot write {self._path}: its name is no UTF-8, and rerun writes to no such one")
        there = next(path for path in (self._path.absolute(), *self._path.absolute().parents) if path.exists())
        if not there.is_dir():
            raise UsageError(f"cannot write {self._path}: {there} is not a folder")
        if not os.access(there, os.W_OK | os.X_OK):
            raise UsageError(f"cannot write {self._path}: no permission in {there}")
        for folder in self._folders.values():
            if os.path.lexists(folder) and not (folder / INDEX).is_file():
                raise UsageError(f"cannot write {folder}: it is there, and no evidence: name another folder")


class Folder:
    """One recording's folder. It grows under another name, and replaces an earlier one as a whole."""

    def __init__(self, path: Path, room: int) -> None:
        """Touch nothing yet; there is room for so many alarms."""
        self.path = path
        self.left_out = 0  # alarms for which there was no room
        self._room = room
        self._count = 0

    @property
    def _growing(self) -> Path:
        return self.path.with_name(f".{self.path.name}.{os.getpid()}.partial")

    @property
    def is_there(self) -> bool:
        """Whether there is evidence already: of an earlier run, or now complete."""
        return self.path.is_dir()

    def new(self, name: str) -> Path | None:
        """A new folder in it for an alarm, None where there is no room left."""
        if self._count == self._room:
            self.left_out += 1
            return None
        self._count += 1
        path = self._growing / name
        path.mkdir(parents=True)
        return path

    def complete(self, index: bytes) -> None:
        """All is written: give the folder its name."""
        (self._growing / INDEX).write_bytes(index)
        if self.is_there:
            shutil.rmtree(self.path)
        self._growing.replace(self.path)

    def discard(self) -> None:
        """Leave nothing of what was not completed."""
        shutil.rmtree(self._growing, ignore_errors=True)


def _folders(path: Path, recordings: Iterable[Path]) -> dict[Path, Path]:
    """A folder for each recording, named like it; further ones of one name are numbered."""
    folders: dict[Path, Path] = {}
    taken: set[str] = set()
    for recording in recordings:
        # What no viewer or program could read as a name: bytes that are no UTF-8, control characters, separators.
        plain = re.sub(r'[\ud800-\udfff\x00-\x1f\x7f/\\:*?"<>|]', "_", name_of(recording)).lstrip(".") or "_"
        name, number = plain, 1
        while name.casefold() in taken:
            number += 1
            name = f"{plain}-{number}"
        taken.add(name.casefold())
        folders[recording] = path / name
    return folders
