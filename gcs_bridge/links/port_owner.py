"""Who holds a port or a device: told on Linux, from /proc, as far as this user may look."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

__all__ = ["device_owner", "is_running", "port_owner"]
_PROC = Path("/proc")


def port_owner(port: int, protocol: Literal["udp", "tcp"]) -> str | None:
    """The program that has bound the port, as `mavproxy.py (process 4711)`; None where it cannot be told."""
    sockets = {f"socket:[{inode}]" for inode in _inodes(port, protocol)}
    return next(_holders(sockets), None) if sockets else None


def device_owner(device: str) -> str | None:
    """The other program that has opened the device, by whatever name; None where it cannot be told."""
    return next(_holders({os.path.realpath(device)}, but=os.getpid()), None)


def is_running(name: str) -> bool:
    """Whether a program of this name runs, whoever's it is: of another user's it is not told what it holds."""
    short = name[:15]  # so much of it the system keeps
    return any(_first_line(process / "comm") == short for process in _processes())


def _holders(files: set[str], but: int | None = None) -> Iterator[str]:
    for process in _processes():
        if process.name != str(but) and files & set(_open_files(process)):
            yield f"{_name(process)} (process {process.name})"


def _processes() -> Iterator[Path]:
    if _PROC.is_dir():  # as on Linux alone
        yield from (process for process in _PROC.iterdir() if process.name.isdecimal())


def _first_line(file: Path) -> str:
    try:
        return file.read_text(errors="replace").strip()
    except OSError:  # it has ended by now
        return ""


def _inodes(port: int, protocol: str) -> Iterator[str]:
    """Inodes of the sockets bound to the port; the tables' columns are in proc_pid_net(5)."""
    for table in (protocol, f"{protocol}6"):
        try:
            rows = (_PROC / "net" / table).read_text().splitlines()[1:]
        except OSError:
            continue
        for row in rows:
            columns = row.split()
            if int(columns[1].rpartition(":")[2], 16) == port:
                yield columns[9]


def _open_files(process: Path) -> Iterator[str]:
    try:
        for descriptor in (process / "fd").iterdir():
            yield str(descriptor.readlink())
    except OSError:  # another user's, or gone by now
        return


def _name(process: Path) -> str:
    """The program's name; of an interpreted one the script's."""
    try:
        words = (process / "cmdline").read_bytes().decode(errors="replace").rstrip("\0").split("\0")
    except OSError:
        words = [""]
    names = [Path(word).name for word in words if not word.startswith("-")]
    interpreted = len(names) > 1 and names[0].startswith(("python", "node", "java", "perl", "ruby"))
    return names[1] if interpreted else (names[0] if names else "") or "a program"
