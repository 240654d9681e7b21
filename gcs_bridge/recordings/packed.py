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
from pathlib import Path, PurePath
from typing import IO, BinaryIO, NamedTuple

from gcs_bridge.errors import SourceError, one_line
from gcs_bridge.files import INSIDE, file_of

__all__ = [
    "LOOKED_FOR",
    "PACKED",
    "STANDARD_INPUT",
    "SUFFIXES",
    "name_of",
    "recordings_in",
    "standard_input",
    "unpacked",
]

SUFFIXES = (".tlog", ".raw", ".rlog", ".mavlink", ".pcap", ".pcapng")
"""Of recordings, in lower case."""
PACKED, ARCHIVE = ".gz", ".zip"
"""What may follow any of them, and what may hold them."""
LOOKED_FOR = (*SUFFIXES, *(suffix + PACKED for suffix in SUFFIXES), ARCHIVE)
"""How the files end that are taken for recordings where a folder is searched."""
STANDARD_INPUT = Path("-")
_MOST_NAMED = 5
_MOST_LAYERS = 8  # of packing: there are archives that hold themselves
_ZIPS = (b"PK\x03\x04", b"PK\x05\x06")  # the second has nothing in it
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
    if INSIDE in str(path):
        return [path]
    try:
        if path == STANDARD_INPUT:
            names = _names_in(standard_input(), path)
        else:
            with path.open("rb") as file:
                names = _names_in(file, path)
    except (OSError, ValueError, SourceError):
        return [path]
    if names is None or len(names) == 1:
        return [path]
    return [Path(f"{path}{INSIDE}{name}") for name in names]


def name_of(path: Path) -> str:
    """A recording's name without folder and endings, for what is made of it."""
    file, inside = file_of(path)
    if file == STANDARD_INPUT and inside is None:
        return "stdin"
    name = PurePath(inside or file).name
    name = name[: -len(PACKED)] if name.lower().endswith(PACKED) else name
    return PurePath(name).stem if inside is None or name.lower().endswith(SUFFIXES) else name


def _names_in(file: BinaryIO, path: Path) -> list[str] | None:
    """What is in an archive or capture; None for what is none."""
    file.seek(0)
    begins = file.read(4)
    if begins in _ZIPS:
        return _members(file, path)
    if begins in _CAPTURES:
        from gcs_bridge.recordings.capture import flows

        return flows(file)
    return None


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
        for _ in range(_MOST_LAYERS + 1):
            file.seek(0)
            begins = file.read(4)
            file.seek(0)
            unpack = next((one for magic, one in _KINDS if begins.startswith(magic)), None)
            if unpack is None:
                yield file
                return
            file = stack.enter_context(unpack(file, wanted))
        raise SourceError(f"{path}: packed more than {_MOST_LAYERS} times over: unpack it first")


def _gunzip(file: BinaryIO, wanted: _Wanted) -> BinaryIO:
    import gzip
    import zlib

    with _spool() as kept:
        try:
            with gzip.GzipFile(fileobj=file) as packed:
                while data := packed.read1(2**18):
                    kept.write(data)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            if not kept.tell():
                raise SourceError(f"{wanted.path}: nothing of it can be unpacked: {one_line(str(error))}") from None
            wanted.remarks.append(f"the compressed file is damaged or cut off; what lies before is judged ({error})")
        return kept


def _unzip(file: BinaryIO, wanted: _Wanted) -> BinaryIO:
    import zipfile

    name = _one_of(_members(file, wanted.path), wanted, "recording")
    with (
        _damage_told(f"{wanted.path}: {one_line(name)} cannot be unpacked"),
        zipfile.ZipFile(file) as archive,
        archive.open(name) as packed,
    ):
        return _spooled(packed)


@contextmanager
def _damage_told(what: str) -> Iterator[None]:
    """SourceError for what a damaged archive makes zipfile raise: it trusts the bytes that it is given."""
    import lzma
    import struct
    import zipfile
    import zlib

    of_libraries = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error)
    of_bytes_taken_for_others = (ValueError, LookupError, ArithmeticError, RuntimeError, EOFError)
    try:
        yield
    except (*of_libraries, *of_bytes_taken_for_others) as error:
        raise SourceError(f"{what}: {one_line(str(error))}") from None


def _members(file: BinaryIO, path: Path) -> list[str]:
    """The recordings in an archive; a file that is alone in it is taken for one, whatever it is called."""
    import zipfile

    with _damage_told(f"{path}: a zip archive that cannot be read"), zipfile.ZipFile(file) as archive:
        names = [one.filename for one in archive.infolist() if not one.is_dir()]
    packed = (*SUFFIXES, *(suffix + PACKED for suffix in SUFFIXES))
    found = [name for name in names if name.lower().endswith(packed)]
    return found or (names if len(names) == 1 else [])


def _capture(file: BinaryIO, wanted: _Wanted) -> BinaryIO:
    from gcs_bridge.recordings.capture import write_records

    with _spool() as kept:
        try:
            flows, remarks = write_records(file, wanted.inside, kept)
        except ValueError as error:
            raise SourceError(f"{wanted.path}: the capture cannot be read: {one_line(str(error))}") from None
        _one_of(flows, wanted, "flow of MAVLink over UDP")
        wanted.remarks.extend(remarks)
        return kept


def _one_of(names: list[str], wanted: _Wanted, what: str) -> str:
    """The one that is meant."""
    if wanted.inside in names:
        return str(wanted.inside)
    if wanted.inside is not None or len(names) > 1:
        option_like = "-- " * (wanted.path == STANDARD_INPUT)  # behind two dashes nothing is taken for an option
        named = ", ".join(f"{option_like}{wanted.path}{INSIDE}{name}" for name in names[:_MOST_NAMED])
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        lacks = "" if wanted.inside is None else f"no {what} {wanted.inside!r} in it; "
        raise SourceError(one_line(f"{wanted.path}: {lacks}name one of the {len(names)} in it: {named}{more}"))
    if not names:
        raise SourceError(f"{wanted.path}: no {what} in it")
    return names[0]


@contextmanager
def _spool() -> Iterator[BinaryIO]:
    """A file of our own, which stays open unless filling it fails."""
    import tempfile

    with ExitStack() as stack:
        yield stack.enter_context(tempfile.TemporaryFile(prefix="gcs-bridge-"))
        stack.pop_all()


def _spooled(source: IO[bytes]) -> BinaryIO:
    """All of it, in a file of its own."""
    import shutil

    with _spool() as kept:
        shutil.copyfileobj(source, kept)
        return kept


_KINDS: tuple[tuple[bytes, Callable[[BinaryIO, _Wanted], BinaryIO]], ...] = (
    (b"\x1f\x8b", _gunzip),
    *((magic, _unzip) for magic in _ZIPS),
    *((magic, _capture) for magic in _CAPTURES),
)
