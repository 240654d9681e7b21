"""Where rows are kept so that nothing is judged twice, whatever ends the survey: a folder, written by one at a time.

What is judged is first appended to a journal, a line a recording, and outlives the process from then on. Once there is
enough of it, or at the end, it becomes a part of each table; the journal goes when the last of them is there. A journal
that is found is what a survey left that was ended: it goes on with that.

All of a folder was judged by one version and settings. What others judged is moved to `earlier/`, and back when they
are asked for again.
"""

from __future__ import annotations

import os
import secrets
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

import msgspec

from gcs_bridge.errors import UsageError
from gcs_bridge.files import file_of, write_file, writing
from gcs_bridge.report.verdicts import fails
from gcs_bridge.settings import FailOn
from gcs_bridge.survey.found import Candidate, is_url, split_url
from gcs_bridge.survey.parts import TABLES, parts_of, read_table, rows_in, write_part
from gcs_bridge.survey.rows import Row
from gcs_bridge.survey.task import MANIFEST, Result

__all__ = ["Dataset", "codes_of", "exit_code_of"]

_SCHEMA = "gcs-bridge/survey/1"
_JOURNAL = ".journal-{}.jsonl"
_PART = 1000  # recordings of a part: a million are a thousand files a table
_MOVED = (*TABLES, "pages")
_MOST_KNOWN = 1000  # contents that a worker is told at most: with more of one size it judges, and we see then


class _Manifest(msgspec.Struct, kw_only=True):
    """What a folder holds."""

    schema: str
    version: str
    settings: str
    token: str
    moving_from: str | None = None
    """Whose tables are being moved away, where that was not done."""

    @property
    def key(self) -> str:
        return f"{self.version}-{self.settings}"


class _File(NamedTuple):
    """What is known of a file that was judged."""

    size: int
    stamp: str
    missing: int  # recordings in it that were not judged
    codes: frozenset[str]  # as in `codes_of`


class Dataset:
    """A folder with the tables; close it in the end. UsageError where it cannot be read or written, at any time."""

    def __init__(self, folder: Path, version: str, settings: str) -> None:
        """Open or make it, for what this version judges by these settings (a digest)."""
        self.folder = folder
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise UsageError(f"cannot write {folder}: no permission")
        self._lock = _locked(folder)
        self._journal, self._number, self._in_part = -1, 0, 0
        try:
            self._arrange(_Manifest(schema=_SCHEMA, version=version, settings=settings, token=secrets.token_hex(8)))
            self._files: dict[str, _File] = {}
            self._contents: dict[str, str] = {}  # and where each was found
            self._by_size: dict[int, list[str]] = {}
            self._pending: list[Result] = []
            self._load()
        except BaseException:
            os.close(self._lock)
            raise

    def __len__(self) -> int:
        """How many recordings it has."""
        return len(self._contents)

    def __enter__(self) -> Dataset:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Make parts of what is in the journal, if there is room for them, and give it back."""
        try:
            if kind is None:
                self.flush()
            else:
                with suppress(UsageError):
                    self.flush()
        finally:
            if self._journal >= 0:
                os.close(self._journal)
            os.close(self._lock)

    @property
    def token(self) -> str:
        """By which a worker knows that a folder of its machine is this one."""
        return self._manifest.token

    def codes(self, candidate: Candidate) -> frozenset[str] | None:
        """What came of a file that has not changed since it was judged; None: judge it."""
        file = self._files.get(_holder(candidate.path))
        unchanged = file is not None and (file.size, file.stamp) == (candidate.size, candidate.stamp)
        return file.codes if file is not None and unchanged and candidate.stamp and file.missing <= 0 else None

    def stamp(self, path: str) -> str:
        """The stamp of the file of this path that was judged, as a whole; empty where there is none."""
        file = self._files.get(_holder(path))
        return "" if file is None or file.missing > 0 else file.stamp

    def known(self, size: int | None) -> frozenset[str]:
        """Contents of files of that size that were judged, or some of them."""
        return frozenset(self._by_size.get(size or -1, ())[-_MOST_KNOWN:])

    def codes_of_file(self, path: str) -> frozenset[str]:
        """What came of a file that was judged."""
        return self._files[_holder(path)].codes

    def codes_of_content(self, content: str) -> frozenset[str]:
        """What came of a content that was judged."""
        return self.codes_of_file(self._contents[content])

    def add(self, result: Result) -> bool:
        """Keep what was judged; False: there is the same content already."""
        assert result.recording is not None
        if result.recording["content"] in self._contents:
            return False
        self._append(msgspec.json.encode(result) + b"\n")
        self._pending.append(result)
        self._index(result.recording)
        if self._in_part + len(self._pending) >= _PART:
            self.flush()
        return True

    def flush(self) -> None:
        """Make of what is in the journal a part of each table."""
        if self._pending:
            contents = [result.recording["content"] for result in self._pending if result.recording is not None]
            rows = {
                "alarms": [row for result in self._pending for row in result.alarms],
                "checks": [row for result in self._pending for row in result.checks],
                "recordings": [result.recording for result in self._pending if result.recording is not None],
            }
            for table in TABLES:
                write_part(self._part(table), rows[table], contents, table)
            self._pending = []
        self._start_part()

    # --- the journal -------------------------------------------------------------------------------------------------

    def _start_part(self) -> None:
        """Go on behind what is in parts: in the last of them while there is room in it."""
        if self._journal >= 0:
            os.close(self._journal)
            self._journal = -1
        self._journal_path.unlink(missing_ok=True)
        self._in_part = rows_in(self._part("recordings"))
        if self._in_part >= _PART:
            self._number, self._in_part = self._number + 1, 0

    def _append(self, line: bytes) -> None:
        path = self._journal_path
        with writing(path):
            if self._journal < 0:
                self._journal = os.open(
                    path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o666
                )
            before = os.fstat(self._journal).st_size
            rest = memoryview(line)
            try:
                while rest:
                    rest = rest[os.write(self._journal, rest) :]
            except OSError:
                os.ftruncate(self._journal, before)
                raise

    @property
    def _journal_path(self) -> Path:
        """It lies with the recordings, and is moved with them; a name that begins with a dot is no part to anybody."""
        return self.folder / "recordings" / _JOURNAL.format(f"{self._number:06d}")

    def _part(self, table: str) -> Path:
        return self.folder / table / f"part-{self._number:06d}.parquet"

    def _load(self) -> None:
        """What was judged before."""
        columns = ["content", "path", "file_bytes", "stamp", "recordings_in_file", "verdict", "compared"]
        for batch in read_table(self.folder, "recordings", columns).to_batches():
            for row in batch.to_pylist():
                self._index(row)
        parts = parts_of(self.folder, "recordings")
        self._number = int(parts[-1].stem.partition("-")[2]) if parts else 0
        left = sorted((self.folder / "recordings").glob(_JOURNAL.format("*")))
        if left:
            self._number = int(left[-1].stem.rpartition("-")[2])
            self._take(left[-1])
        self.flush()

    def _take(self, journal: Path) -> None:
        """What an ended survey left: whole lines; of the last one it may have written a piece."""
        with writing(journal):
            content = journal.read_bytes()
        for line in content.split(b"\n")[:-1]:
            try:
                result = msgspec.json.decode(line, type=Result)
            except msgspec.DecodeError:
                continue  # is judged anew
            if result.recording is not None:
                self._pending.append(result)
                if result.recording["content"] not in self._contents:
                    self._index(result.recording)

    def _index(self, row: Row) -> None:
        content, path, size, stamp = row["content"], row["path"], row["file_bytes"], row["stamp"]
        holder, codes = _holder(path), codes_of(row["verdict"], compared=row["compared"])
        self._contents[content] = path
        self._by_size.setdefault(size, []).append(content)
        before = self._files.get(holder)
        if before is None or (before.size, before.stamp) != (size, stamp):
            before = _File(size, stamp, row["recordings_in_file"], frozenset())
        self._files[holder] = before._replace(missing=before.missing - 1, codes=before.codes | codes)

    # --- whose it is -------------------------------------------------------------------------------------------------

    def _arrange(self, ours: _Manifest) -> None:
        """Let the tables be those of this version and settings, whatever ended the last try to do so."""
        path = self.folder / MANIFEST
        there = _manifest_in(path)
        if there is None and any((self.folder / name).exists() for name in _MOVED):
            raise UsageError(f"{self.folder}: there is something in it that is no survey of ours: name another folder")
        if there is not None and there.moving_from is not None:
            self._move(there.moving_from, there.key)
            there.moving_from = None
        if there is not None and there.key == ours.key:
            ours = there
        elif there is not None:
            ours.moving_from = there.key
            self._write_manifest(ours)
            self._move(there.key, ours.key)
            ours.moving_from = None
        for name in _MOVED:
            with writing(self.folder / name):
                (self.folder / name).mkdir(exist_ok=True)
        self._manifest = ours
        self._write_manifest(ours)

    def _move(self, old: str, new: str) -> None:
        """Move one's tables away, and another's here; each of them once, however often this is tried."""
        earlier = self.folder / "earlier"
        with writing(earlier):
            for name in _MOVED:
                here, away, back = self.folder / name, earlier / old / name, earlier / new / name
                if here.exists() and not away.exists():
                    away.parent.mkdir(parents=True, exist_ok=True)
                    here.replace(away)
                if back.exists() and not here.exists():
                    back.replace(here)

    def _write_manifest(self, manifest: _Manifest) -> None:
        write_file(msgspec.json.format(msgspec.json.encode(manifest)) + b"\n", self.folder / MANIFEST)


@cache  # of a million recordings most are alike
def codes_of(verdict: str, *, compared: bool) -> frozenset[str]:
    """What matters of a recording for how the survey ends."""
    return frozenset({verdict}) | (frozenset() if compared else frozenset({"uncompared"}))


def exit_code_of(codes: frozenset[str], fail_on: FailOn) -> int:
    """1: an alarm (or a warning, if that is to fail), 4: an attitude that was compared with nothing, else 0."""
    if fail_on == "never":
        return 0
    if any(fails(code, fail_on) for code in codes):
        return 1
    return 4 if "uncompared" in codes else 0


def _holder(path: str) -> str:
    """The file that holds a recording."""
    return split_url(path)[0] if is_url(path) else str(file_of(Path(path))[0])


def _manifest_in(path: Path) -> _Manifest | None:
    try:
        manifest = msgspec.json.decode(path.read_bytes(), type=_Manifest)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except msgspec.MsgspecError:
        raise UsageError(f"{path}: is no survey of ours: name another folder by --output") from None
    if manifest.schema != _SCHEMA:
        raise UsageError(f"{path}: its schema is {manifest.schema!r}, not {_SCHEMA!r}: name another folder by --output")
    return manifest


def _locked(folder: Path) -> int:
    """The lock of a folder, held; UsageError where another process holds it."""
    path = folder / ".lock"
    with writing(path):
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    if sys.platform != "win32":
        import fcntl

        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            raise UsageError(f"{folder}: another survey is writing to it: wait for its end, or name another") from None
        except OSError:  # this file system has no locks
            pass
    return lock
