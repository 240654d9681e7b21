"""Which recordings there are: files, what folders hold, and the same at any URL that fsspec knows."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from gcs_bridge.errors import SourceError, UsageError, one_line
from gcs_bridge.files import INSIDE, file_of
from gcs_bridge.recordings.packed import LOOKED_FOR, STANDARD_INPUT, SUFFIXES

__all__ = ["Candidate", "failing", "find", "is_url", "opened_at", "split_url", "stamp_of"]

_EXTRA = "pip install 'gcs-bridge[remote]'"
_CONNECT_S, _READ_S = 10, 60  # so long a server may take, so that none holds a survey up
_STAMPS = ("ETag", "etag", "Last-Modified", "LastModified", "mtime", "updated", "last_modified")
"""What file systems call what changes with a file, the surest first."""
_ADVICE = (
    ("credentials", "name a profile (AWS_PROFILE), or set FSSPEC_S3_ANON=true for what is public"),
    ("token", "log in anew, or name another profile (AWS_PROFILE)"),
    ("403", "ask its owner, or give the credentials that may read it"),
    ("Forbidden", "ask its owner, or give the credentials that may read it"),
)


class Candidate(NamedTuple):
    """A file that is taken for a recording, or holds some."""

    path: str
    """As it was named, or found below what was named: a path of this machine, or a URL."""
    size: int | None = None
    """Bytes; None: not known yet."""
    stamp: str = ""
    """By which, with path and size, it is known not to have changed; empty: not known yet."""


def is_url(path: str) -> bool:
    """Whether it is for fsspec to open, as `s3://bucket/flight.tlog` is."""
    return "://" in path


def split_url(url: str) -> tuple[str, str | None]:
    """A URL, and which of the recordings in that file is meant; fsspec's own chains, `zip://…::s3://…`, stay whole."""
    file, _, inside = url.rpartition(INSIDE)
    return (file, inside) if file and not is_url(inside) else (url, None)


def find(paths: Iterable[str]) -> Iterator[Candidate | SourceError]:
    """The files named and those in the folders named, each once; and what cannot be searched.

    UsageError for a kind of URL that nothing is installed for.
    """
    seen: set[str] = set()
    for path in paths:
        for one in _at_url(path) if is_url(path) else _local(path):
            if isinstance(one, SourceError):
                yield one
            elif one.path not in seen:
                seen.add(one.path)
                yield one


def _local(path: str) -> Iterator[Candidate | SourceError]:
    if path == str(STANDARD_INPUT):
        yield SourceError("-: standard input is not surveyed: name files, folders or URLs, or let check judge it")
        return
    if not os.path.isdir(path):
        yield _looked_at(path)
        return
    unreadable: list[OSError] = []
    nothing = True
    for folder, below, names in os.walk(path, onerror=unreadable.append):
        below.sort()
        for name in sorted(names):
            file = str(Path(folder, name))
            if name.lower().endswith(LOOKED_FOR) and os.path.isfile(file):
                nothing = False
                yield _looked_at(file)
    yield from (SourceError(f"{error.filename}: cannot be searched: {error.strerror}") for error in unreadable)
    if nothing and not unreadable:
        yield SourceError(f"{path}: no recording in this folder (looked for {', '.join(SUFFIXES)}, packed ones too)")


def _looked_at(path: str) -> Candidate:
    """A file of this machine; who reads it will tell why it cannot be looked at."""
    try:
        status = file_of(Path(path))[0].stat()
    except OSError:
        return Candidate(path)
    return Candidate(path, status.st_size, str(status.st_mtime_ns))


def _at_url(url: str) -> Iterator[Candidate | SourceError]:
    files, root = opened_at(url)
    if url.lower().endswith(LOOKED_FOR) or INSIDE in url:
        yield Candidate(url)
        return
    nothing = True
    try:
        with failing(f"{url}: cannot be searched"):
            for folder, _, names in files.walk(root, detail=True, on_error="raise"):
                for name, told in sorted(names.items()):
                    if name.lower().endswith(LOOKED_FOR):
                        nothing = False
                        yield Candidate(files.unstrip_protocol(f"{folder.rstrip('/')}/{name}"), *_told(told))
    except SourceError as error:
        yield error
        return
    if nothing:
        yield SourceError(f"{url}: no recording there (looked for {', '.join(SUFFIXES)}, packed ones too)")


def opened_at(url: str) -> tuple[Any, str]:
    """The file system of a URL, and what the URL is called in it; UsageError where there is none for it."""
    try:
        import fsspec
    except ImportError as error:
        raise UsageError(f"{url}: needs fsspec ({error}): {_EXTRA}") from None
    protocol = url.partition("://")[0].rpartition(INSIDE)[2]
    try:
        files, root = fsspec.core.url_to_fs(url, **_patience(protocol, fsspec.config.conf))
    except ImportError as error:
        raise UsageError(f"{url}: nothing is installed for {protocol}:// ({one_line(str(error))}): {_EXTRA}") from None
    except ValueError as error:
        raise UsageError(f"{url}: {one_line(str(error))}") from None
    return files, root


def _patience(protocol: str, configured: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """How long a server is waited for, where the user's own configuration of fsspec does not tell."""
    key: str
    value: dict[str, Any]
    if protocol in ("http", "https"):
        import aiohttp

        key = "client_kwargs"
        value = {"timeout": aiohttp.ClientTimeout(None, sock_connect=_CONNECT_S, sock_read=_READ_S)}
    elif protocol in ("s3", "s3a"):
        key = "config_kwargs"
        value = {"connect_timeout": _CONNECT_S, "read_timeout": _READ_S, "retries": {"max_attempts": 2}}
    else:
        return {}
    return {} if key in configured.get(protocol, {}) else {key: value}


def stamp_of(told: dict[str, Any]) -> str:
    """What of what a file system tells of a file changes with it; empty where nothing does."""
    return next((str(told[name]).strip('"') for name in _STAMPS if told.get(name)), "")


def _told(told: dict[str, Any]) -> tuple[int | None, str]:
    return told.get("size"), stamp_of(told)


@contextmanager
def failing(what: str) -> Iterator[None]:
    """SourceError, with what could not be done, for whatever a file system of fsspec's raises; UsageError stays one."""
    try:
        yield
    except UsageError:
        raise
    except Exception as error:  # noqa: BLE001  # botocore's, aiohttp's and others' errors have no class in common
        raise SourceError(f"{what}: {_why_not(error)}") from None


def _why_not(error: BaseException) -> str:
    """Why something at a URL cannot be read, in one line, and what to do about it where that is known."""
    cause = error.__cause__  # fsspec says of a server that does not answer that there is no such file
    if isinstance(error, TimeoutError) or isinstance(cause, TimeoutError):
        said = f"the server does not answer (it was waited for {_READ_S} s)"
    elif isinstance(error, FileNotFoundError):
        said = "no such file" if cause is None else one_line(str(cause)) or type(cause).__name__
    else:
        said = one_line(str(error)) or type(error).__name__
    advice = next((advice for sign, advice in _ADVICE if sign.lower() in said.lower()), None)
    return f"{said}: {advice}" if advice else said
