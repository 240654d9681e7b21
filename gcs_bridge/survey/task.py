"""What a worker does with one file: it brings it here if it is elsewhere, judges it, and gives back rows."""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from dataclasses import replace as replaced
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec

from gcs_bridge.contract import readable
from gcs_bridge.errors import GcsBridgeError, SourceError, UsageError, one_line
from gcs_bridge.files import INSIDE, file_of, write_file, writing
from gcs_bridge.pages.curves import Curves
from gcs_bridge.pages.files import page_name
from gcs_bridge.pages.page import page
from gcs_bridge.recordings.check import check_file
from gcs_bridge.recordings.packed import recordings_in
from gcs_bridge.report.schema import File
from gcs_bridge.settings import Settings
from gcs_bridge.survey.found import failing, is_url, opened_at, split_url, stamp_of
from gcs_bridge.survey.rows import Row, alarm_rows, check_rows, folder_of, recording_row, start_us

__all__ = ["MANIFEST", "Asked", "Pages", "Result", "Task", "survey_one"]

MANIFEST = "survey.json"
_PIECE = 2**20


@dataclass(frozen=True, kw_only=True)
class Pages:
    """Which recordings get a page, and where it goes: into the dataset's folder, if this machine has it, too."""

    folder: str
    token: str  # of the dataset that is meant
    every: bool  # not only those with an alarm or a warning


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What is the same for all files."""

    settings: Settings
    judged_by: Mapping[str, Any]  # arguments of a `Monitor`
    settings_digest: str
    pages: Pages | None = None


@dataclass(frozen=True, kw_only=True)
class Task:
    """One file, or with `inside` one recording in it; `known`: contents of its size that were judged."""

    asked: Asked
    path: str
    size: int | None = None
    stamp: str = ""
    before: str = ""  # the stamp of a file at that URL that was judged: with the same it need not be fetched
    inside: str | None = None
    known: frozenset[str] = frozenset()
    of: int = 1  # so many recordings are in the file
    content: str = ""  # of the file, where that is known

    def parts(self, names: Sequence[str], content: str) -> list[Task]:
        """A task of each recording in its file."""
        return [replaced(self, inside=name, of=len(names), content=content) for name in names]


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """What came of it: rows; or that it is known, holds several, or cannot be used."""

    recording: Row | None = None
    checks: list[Row] = []
    alarms: list[Row] = []
    known: str | None = None
    """The content, where that was judged already."""
    unchanged: bool = False
    """The file is the one that was judged before."""
    inside: list[str] = []
    """What is in it, where that is more than one recording: each is a task of its own."""
    content: str = ""
    """Of the file, with `inside`."""
    parts: list[Result] = []
    """What came of each of `inside`, where all were judged at once, as the file is not on this machine."""
    bytes: int = 0
    """That were read."""
    failure: str | None = None
    """Why it cannot be used, in one line."""
    stop: str | None = None
    """Why no other need be tried: what is asked for cannot be done, or nothing can be written."""


def survey_one(task: Task) -> Result:
    """Do it. Whatever goes wrong is part of the result: one file must not end the survey of a million."""
    return _told(task, None)


def _told(task: Task, here: tuple[Path, int, str] | None) -> Result:
    """The same; `here`: where the file is, its size and stamp, if that is known."""
    named = task.path if task.inside is None else f"{task.path}{INSIDE}{task.inside}"
    try:
        if here is not None:
            return _surveyed(task, named, *here)
        if task.before and _stamp_at(task.path) == task.before:
            return Result(unchanged=True)
        with _here(task) as found:
            result = _surveyed(task, named, *found)
            if not result.inside or not is_url(task.path):
                return result
            parts = [_told(part, found) for part in task.parts(result.inside, result.content)]
            return msgspec.structs.replace(result, parts=parts)
    except UsageError as error:
        return Result(stop=str(error))
    except GcsBridgeError as error:
        return Result(failure=one_line(str(error)))
    except MemoryError:
        return Result(failure=one_line(f"{named}: there is too little memory to judge it"))
    except OSError as error:
        return Result(failure=one_line(f"{named}: cannot be read: {error.strerror or error}"))
    except Exception as error:  # noqa: BLE001  # whatever it is, it is told as ours, and costs this recording alone
        said = f"{named}: a mistake of gcs-bridge, please report it: {type(error).__name__}: {error}"
        return Result(failure=one_line(said))


def _surveyed(task: Task, named: str, local: Path, size: int, stamp: str) -> Result:
    """The same of a file that is on this machine."""
    file, inside = (local, task.inside) if task.inside is not None else file_of(local)
    content, of = task.content or _digest(file), task.of
    if task.inside is None:
        names = recordings_in(file)
        if inside is None and len(names) > 1:
            return Result(inside=[str(name).partition(INSIDE)[2] for name in names], content=content)
        of = max(len(names), 1)
    if inside is not None:
        content = hashlib.blake2b(f"{content}{INSIDE}{inside}".encode("utf-8", "replace"), digest_size=16).hexdigest()
    if content in task.known:
        return Result(known=content, bytes=size)
    meant = file if inside is None else Path(f"{file}{INSIDE}{inside}")
    asked, curves = task.asked, Curves()
    pages = asked.pages if asked.pages is not None and _has(asked.pages.folder, asked.pages.token) else None
    try:
        entry = check_file(meant, asked.settings, **asked.judged_by, sinks=[] if pages is None else [curves])
    except SourceError as error:
        raise SourceError(str(error).replace(str(file), task.path)) from None
    except UsageError as error:  # it ends before --from, or has no times: others do not
        if asked.judged_by.get("from_s") is None and asked.judged_by.get("to_s") is None:
            raise
        raise SourceError(str(error).replace(str(file), task.path)) from None
    entry = msgspec.structs.replace(entry, path=readable(named))
    written = None if pages is None else _page(pages, entry, curves, content)
    known_by = {
        "content": content,
        "path": entry.path,
        "folder": folder_of(readable(task.path)),
        "start_utc": start_us(entry),
    }
    of_file = {
        "settings": asked.settings_digest,
        "file_bytes": size,
        "stamp": stamp,
        "recordings_in_file": of,
    }
    return Result(
        recording=recording_row(entry, known_by, written) | of_file,
        checks=check_rows(entry, known_by),
        alarms=alarm_rows(entry, known_by),
        bytes=size,
    )


@contextmanager
def _here(task: Task) -> Iterator[tuple[Path, int, str]]:
    """The file on this machine, its size and stamp; what is elsewhere is copied, and the copy goes again."""
    if not is_url(task.path):
        path = Path(task.path)
        try:
            status = file_of(path)[0].stat()
        except OSError:  # who reads it will tell
            yield path, task.size or 0, task.stamp
            return
        if not stat.S_ISREG(status.st_mode):
            raise SourceError(f"{path}: a pipe or device, not a file: copy what it gives into one")
        yield path, status.st_size, str(status.st_mtime_ns)
        return
    with tempfile.TemporaryDirectory(prefix="gcs-bridge-") as folder:
        url, inside = split_url(task.path)
        copy = Path(folder, url.rstrip("/").rpartition("/")[2] or "recording")
        with failing(f"{task.path}: cannot be read"):
            files, root = opened_at(url)
            stamp = task.stamp or stamp_of(files.info(root))
            files.get_file(root, str(copy))
        yield Path(f"{copy}{INSIDE}{inside}") if inside else copy, copy.stat().st_size, stamp


def _stamp_at(url: str) -> str:
    """The stamp of a file that is elsewhere; empty where it has none, or cannot be asked for: who fetches it tells."""
    try:
        with failing(url):
            files, root = opened_at(split_url(url)[0])
            return stamp_of(files.info(root))
    except SourceError:
        return ""


def _digest(path: Path) -> str:
    """Of all bytes of a file, 128 bits of BLAKE2; where it cannot be read, who judges it will tell why."""
    digest = hashlib.blake2b(digest_size=16)
    try:
        with path.open("rb", buffering=0) as file:
            while piece := file.read(_PIECE):
                digest.update(piece)
    except OSError:
        return ""
    return digest.hexdigest()


@lru_cache(maxsize=4)
def _has(folder: str, token: str) -> bool:
    """Whether the dataset that is meant is in a folder of this machine."""
    try:
        manifest = msgspec.json.decode(Path(folder, MANIFEST).read_bytes())
    except (OSError, msgspec.DecodeError):
        return False
    return isinstance(manifest, dict) and manifest.get("token") == token and os.access(folder, os.W_OK)


def _page(pages: Pages, entry: File, curves: Curves, content: str) -> str | None:
    """Write a recording's page, if it gets one; its place in the dataset. UsageError: it cannot be written."""
    if not pages.every and not any(vehicle.alarms for vehicle in entry.vehicles):
        return None
    place = f"pages/{content[:2]}/{page_name(entry.path)}-{content[:8]}.html"
    path = Path(pages.folder, place)
    with writing(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_file(page(entry, curves, back="../../index.html"), path)
    return place
