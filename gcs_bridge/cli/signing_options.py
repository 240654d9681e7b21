"""`--signing-key-file` and `--unsigned`: by which key frames are verified, and what is done with the others.

The key is read from a file, never taken from the command line, which every user of the machine can see.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gcs_bridge.cli.terminal import complain
from gcs_bridge.errors import UsageError

if TYPE_CHECKING:  # loaded where there is a key
    from gcs_bridge.mavlink.signing import SigningKey

__all__ = ["key_of", "signing_key_option", "signing_options"]

_Command = TypeVar("_Command", bound=Callable[..., Any])
_KEY_BYTES, _HEX_DIGITS = 32, 64
_READ_BYTES = 4096  # a key with blanks around it is shorter
_WANTED = "a signing key is 32 bytes, or 64 hex digits (of a pass phrase: its SHA-256)"
_ADVICE = {
    FileNotFoundError: ": look at the path",
    PermissionError: ": ask its owner",
    IsADirectoryError: ": name the file in it",
}


def signing_options(command: _Command) -> _Command:
    """Give a command the two options, as `signing_key_file` and `unsigned`."""
    command = click.option(
        "--unsigned",
        type=click.Choice(["accept", "flag", "reject"]),
        help="What is done with frames not signed by that key: used, used and told of, not used.  [flag]",
    )(command)
    return signing_key_option(command)


def signing_key_option(command: _Command) -> _Command:
    """Give a command the first of them alone."""
    return click.option(
        "--signing-key-file",
        type=click.Path(path_type=Path, readable=False),
        metavar="FILE",
        help="Verify MAVLink signatures by the key in it: 32 bytes, or 64 hex digits.",
    )(command)


def key_of(key_file: Path | None, unsigned: str | None) -> SigningKey | None:
    """The key that frames are verified by; None: by none. UsageError where `unsigned` needs one, or it is no key.

    Warns of a key that others may read.
    """
    if key_file is None:
        if unsigned in ("flag", "reject"):
            raise UsageError(f"--unsigned {unsigned} needs --signing-key-file: without a key nothing is verified")
        return None
    from gcs_bridge.mavlink.signing import SigningKey

    return SigningKey(_key_in(key_file))


def _key_in(path: Path) -> bytes:
    """The 32 bytes; what is wrong with a file is told without what it holds."""
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            content = file.read(_READ_BYTES)
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise UsageError(f"{path}: no signing key can be read: {what}{_ADVICE.get(type(error), '')}") from None
    key = _bytes_of(content)
    if key is None:
        size = f"more than {_READ_BYTES - 1}" if len(content) == _READ_BYTES else str(len(content))
        digits = ", which are not all hex digits" if len(content.strip()) == _HEX_DIGITS else ""
        raise UsageError(f"{path}: holds {size} bytes{digits}: {_WANTED}")
    if os.name == "posix" and stat.S_ISREG(mode) and mode & (stat.S_IRGRP | stat.S_IROTH):
        complain(f"{path}: other users of this machine may read the signing key: chmod 600 {path}", kind="warning")
    return key


def _bytes_of(content: bytes) -> bytes | None:
    """The key that a file holds: its bytes, or those that its hex digits mean; None: neither."""
    if len(content) == _KEY_BYTES:
        return content
    digits = content.strip()
    if len(digits) != _HEX_DIGITS:
        return None
    try:
        return bytes.fromhex(digits.decode("ascii"))
    except ValueError:
        return None
