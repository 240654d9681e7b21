"""Recordings inside of other files: gzip, zip, captures of a network, standard input.

Whatever it is becomes a file of its own, which nobody else sees and which goes when it is closed: what reads recordings
need not know. One that is meant among several in a file is named behind two colons: `logs.zip::flight.tlog`. Libraries
are loaded when there is something to unpack.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import IO, BinaryIO, NamedTuple

from gcs_bridge.errors import SourceError, one_line

__all__ = ["ARCHIVE", "PACKED", "STANDARD_INPUT", "SUFFIXES", "file_of", "recordings_in", "standard_input", "unpacked"]

SUFFIXES = (".tlog", ".raw", ".rlog", ".mavlink", ".pcap", ".pcapng")
"""Of recordings, in lower case."""
PACKED, ARCHIVE = ".gz", ".zip"
"""What may follow any of them, and what may hold them."""
STANDARD_INPUT = Path("-")
_INSIDE = "::"
_MOST_NAMED = 5
_CAPTURES = (
    *(
        b"\xa1\xb2\xc3\xd4",
        b"\xd4\xc3\xb2\xa1",
        b"\xa1\xb2\x3c\x4d",
        b"\x4d\x3c\xb2\xa1",
    ),  # pcap, either order and unit
    b"\x0a\x0d\x0d\x0a",  # pcapng
)


class _Wanted(NamedTuple):
    """What is read, and what of it is meant."""

    path: Path
    inside: str | None
    remarks: list[str]


def recordings_in(path: Path) -> list[Path]:
    """Each recording in a file, as `unpacked` and all that reads recordings take it: the file itself if it is one.

    None in an archive or capture without any. What cannot be looked into is given as it is: who reads it will tell why.
    """
    if path == STANDARD_INPUT or _INSIDE in str(path):
        return [path]
    try:
        with path.open("rb") as file:
            begins = file.read(4)
            if begins == b"PK\x03\x04":
                names = _members(file, path)
            elif begins in _CAPTURES:
                from gcs_bridge.recordings.capture import flows

                names = flows(file)
            else:
                return [path]
    except (OSError, ValueError, SourceError):
        return [path]
    return [path] * len(names) if len(names) < 2 else [Path(f"{path}{_INSIDE}{name}") for name in names]


def file_of(path: Path) -> tuple[Path, str | None]:
    """The file that a path means, and which of the recordings in it."""
    file, colons, inside = str(path).partition(_INSIDE)
    return (Path(file), inside) if colons and not path.exists() else (path, None)


@cache
def standard_input() -> BinaryIO:
    """All of standard input, kept to be read as often as needed. SourceError where it is a terminal."""
    if sys.stdin is None or sys.stdin.isatty():
        raise SourceError("-: standard input is a terminal: pipe a recording into it")
    return _spooled(sys.stdin.buffer)


@contextmanager
def unpacked(file: BinaryIO, path: Path, inside: str | None, remarks: list[str]) -> Iterator[BinaryIO]:
    """The recording in a file, open; the file itself if it is one. What of it was damaged is told in `remarks`.

    Raises SourceError where there is none, or more than one and none is named.
    """
    wanted = _Wanted(path, inside, remarks)
    with ExitStack() as stack:
        while True:
            file.seek(0)
            begins = file.read(4)
            file.seek(0)
            unpack = next((one for magic, one in _KINDS if begins.startswith(magic)), None)
            if unpack is None:
                break
            file = stack.enter_context(unpack(file, wanted))
        yield file


def _gunzip(file: BinaryIO, wanted: _Wanted) -> BinaryIO:
    import gzip
    import zlib

    kept = _spool()
    try:
        with gzip.GzipFile(fileobj=file) as packed:
            while data := packed.read1(2**18):
                kept.write(data)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        if not kept.tell():
            kept.close()
            raise SourceError(f"{wanted.path}: nothing of it can be unpacked: {one_line(str(error))}") from None
        wanted.remarks.append(f"the compressed file is damaged or cut off; what lies before that is judged ({error})")
    return kept


def _unzip(file: BinaryIO, wanted: _Wanted) -> BinaryIO:
    import zipfile
    import zlib

    name = _one_of(_members(file, wanted.path), wanted, "recording")
    try:
        with zipfile.ZipFile(file) as archive, archive.open(name) as packed:
            return _spooled(packed)
    except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError) as error:
        raise SourceError(f"{wanted.path}: {one_line(name)} cannot be unpacked: {one_line(str(error))}") from None


def _members(file: BinaryIO, path: Path) -> list[str]:
    """The recordings in an archive; a file that is alone in it is taken for one, whatever it is called."""
    import zipfile

    try:
        with zipfile.ZipFile(file) as archive:
            names = [one.filename for one in archive.infolist() if not one.is_dir()]
    except zipfile.BadZipFile as error:
        raise SourceError(f"{path}: a zip archive that cannot be read: {one_line(str(error))}") from None
    packed = (*SUFFIXES, *(suffix + PACKED for suffix in SUFFIXES))
    found = [name for name in names if name.lower().endswith(packed)]
    return found or (names if len(names) == 1 else [])


def _capture(file: BinaryIO, wanted: _Wanted) -> BinaryIO:
    from gcs_bridge.recordings.capture import flows, write_records

    try:
        flow = _one_of(flows(file), wanted, "flow of MAVLink over UDP")
        kept = _spool()
        wanted.remarks.extend(write_records(file, flow, kept))
        return kept
    except ValueError as error:
        raise SourceError(f"{wanted.path}: the capture cannot be read: {one_line(str(error))}") from None


def _one_of(names: list[str], wanted: _Wanted, what: str) -> str:
    """The one that is meant."""
    if wanted.inside in names:
        return str(wanted.inside)
    if wanted.inside is not None or len(names) > 1:
        named = ", ".join(f"{wanted.path}{_INSIDE}{name}" for name in names[:_MOST_NAMED])
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        lacks = "" if wanted.inside is None else f"no {what} {wanted.inside!r} in it; "
        raise SourceError(one_line(f"{wanted.path}: {lacks}name one of the {len(names)} in it: {named}{more}"))
    if not names:
        raise SourceError(f"{wanted.path}: no {what} in it")
    return names[0]


def _spool() -> BinaryIO:
    import tempfile

    return tempfile.TemporaryFile(prefix="gcs-bridge-")


def _spooled(source: IO[bytes]) -> BinaryIO:
    """All of it, in a file of its own."""
    import shutil

    kept = _spool()
    shutil.copyfileobj(source, kept)
    return kept


_KINDS: tuple[tuple[bytes, Callable[[BinaryIO, _Wanted], BinaryIO]], ...] = (
    (b"\x1f\x8b", _gunzip),
    (b"PK\x03\x04", _unzip),
    *((magic, _capture) for magic in _CAPTURES),
)
