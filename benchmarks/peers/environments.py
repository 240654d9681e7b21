"""The peers, and an environment of its own for each: made once below a folder, then kept from run to run.

Versions are pinned here and nowhere else: all that a reader's speed hangs on. What cannot be installed raises
NotInstalledError with a reason in words; what pip or the compiler said of it is kept in the environment's folder.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks import COMPARED
from benchmarks.processes import TOP, output_of, this_python

DRIVERS = Path(__file__).parent / "drivers"
MADE = "made"  # a file that stands in an environment as soon as it is whole
LOG = "log.txt"


class NotInstalledError(Exception):
    """A peer that is left out, and why."""


class Peer(NamedTuple):
    """A Python package that reads recordings; `steps` are the arguments of `pip install`, one call each."""

    name: str
    version: str
    driver: str
    steps: tuple[str, ...]

    @property
    def versions(self) -> str:
        """What pip is told to install, in words: the package, then the others."""
        own = f"{self.name}=={self.version}"
        others = (word for step in self.steps for word in step.split() if "==" in word and word != own)
        return ": ".join(filter(None, (own, ", ".join(others)))).replace("==", " ")


PEERS = (
    Peer(
        "fasttlogparser",
        "1.1.1",
        "fasttlogparser_reads.py",
        # From source, without isolation: its build wants pip itself, cmake, and a C++ compiler of the system.
        (
            (
                "numpy==2.4.6 lxml==6.1.3 future==1.0.0 scikit-build-core==1.1.2 pybind11==3.1.0 packaging==26.4 "
                "pathspec==1.1.1 cmake==3.31.10 ninja==1.13.2"
            ),
            "--no-build-isolation --no-deps fasttlogparser==1.1.1",
        ),
    ),
    Peer(
        "signalviewer-lite",
        "1.14.0",
        "signalviewer_reads.py",
        (
            (
                "signalviewer-lite==1.14.0 pymavlink==2.4.50 pyserial==3.5 numpy==2.4.6 pandas==3.1.1 scipy==1.17.1 "
                "fastapi==0.165.0 pydantic==2.14.4 uvicorn==0.54.0 python-multipart==0.0.34"
            ),
        ),
    ),
    Peer("pymavlink", "2.4.50", "pymavlink_reads.py", ("pymavlink==2.4.50 fastcrc==0.5.0 lxml==6.1.3",)),
    Peer(
        "mavpose",
        "0.4.0",
        "mavpose_reads.py",
        ("mavpose==0.4.0 pymavlink==2.4.50 fastcrc==0.5.0 pandas==3.1.1 numpy==2.4.6 pyarrow==26.0.1 pyulog==1.3.0",),
    ),
)


def python_of(peer: Peer, folder: Path) -> Path:
    """The Python of the peer's environment below `folder`, which is made where it is missing or another's."""
    tag = f"{peer.name}-{peer.version}-{sys.implementation.cache_tag}-{_digest(*peer.steps)}"
    home = folder / tag
    if not (home / MADE).exists():
        _make_venv(home)
        for step in peer.steps:
            _pip(home, step.split())
        (home / MADE).touch()
    return home / "bin" / "python"


def python_of_wheel(folder: Path) -> Path:
    """The Python of an environment that has this checkout's gcs-bridge installed as a wheel, built anew."""
    home = folder / f"gcs-bridge-{sys.implementation.cache_tag}"
    if not (home / MADE).exists():
        _make_venv(home)
    _pip(home, [str(TOP)])  # and what it depends on
    _pip(home, ["--force-reinstall", "--no-deps", str(TOP)])  # the same version may be of other source
    (home / MADE).touch()
    return home / "bin" / "python"


def walker(folder: Path) -> Path:
    """The record walker in C, compiled; it counts COMPARED."""
    compiler = _compiler()
    table = output_of(this_python(str(DRIVERS / "crc_extras.py"), *COMPARED))
    source = (DRIVERS / "walker.c").read_text("utf-8")
    home = folder / f"walker-{_digest(table, source, describe_compiler())}"
    program = home / "walker"
    if not program.exists():
        home.mkdir(parents=True, exist_ok=True)
        (home / "crc_extras.h").write_text(table, "utf-8")
        _logged(home, [compiler, "-O3", f"-I{home}", "-o", str(program), str(DRIVERS / "walker.c")], "compiling it")
    return program


def describe_compiler() -> str:
    """The C compiler's name and version, and how it is called."""
    return output_of([_compiler(), "--version"]).splitlines()[0] + ", -O3"


def _compiler() -> str:
    found = next(filter(None, map(shutil.which, (os.environ.get("CC", ""), "cc", "gcc", "clang"))), None)
    if found is None:
        raise NotInstalledError("there is no C compiler: cc, gcc or clang")
    return found


def _digest(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:8]


def _make_venv(home: Path) -> None:
    shutil.rmtree(home, ignore_errors=True)
    home.mkdir(parents=True)
    _logged(home, [sys.executable, "-m", "venv", str(home)], "python -m venv")


def _pip(home: Path, arguments: Sequence[str]) -> None:
    wanted = " ".join(word for word in arguments if not word.startswith(("-", "/")))
    command = [str(home / "bin" / "python"), "-m", "pip", "install", "--disable-pip-version-check", *arguments]
    _logged(home, command, f"pip install {wanted}".strip())


def _logged(home: Path, command: Sequence[str], what: str) -> None:
    """Run a command, what it says kept in the environment's log; NotInstalledError where it fails."""
    path = os.pathsep.join([str(home / "bin"), os.environ.get("PATH", os.defpath)])
    with (home / LOG).open("ab") as log:
        done = subprocess.run(command, stdout=log, stderr=log, env={**os.environ, "PATH": path}, check=False)
    if done.returncode:
        print(f"{what} fails: see {home / LOG}", file=sys.stderr)
        raise NotInstalledError(f"{what} fails")
