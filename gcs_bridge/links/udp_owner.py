"""Who holds a UDP port: told on Linux, from /proc, as far as this user may look."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

__all__ = ["udp_port_owner"]
_PROC = Path("/proc")


def udp_port_owner(port: int) -> str | None:
    """The program that has bound the UDP port, as `mavproxy.py (process 4711)`; None where it cannot be told."""
    sockets = {f"socket:[{inode}]" for inode in _inodes(port)}
    if not sockets:
        return None
    for process in _PROC.iterdir():
        if process.name.isdecimal() and sockets & set(_open_files(process)):
            return f"{_name(process)} (process {process.name})"
    return None


def _inodes(port: int) -> Iterator[str]:
    """Inodes of the sockets bound to the port; the tables' columns are in proc_pid_net(5)."""
    for table in ("udp", "udp6"):
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
