"""Whole processes, measured: their time, their memory, and what they say.

A process that measures stays small and imports none of the libraries: a child's peak memory, as the kernel tells it, is
never below its parent's at the start. Needs POSIX (`os.wait4`).
"""

from __future__ import annotations

import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

TOP = Path(__file__).parents[1]  # of the checkout


class Run(NamedTuple):
    """One finished process; `said` is its standard output."""

    wall_s: float
    cpu_s: float
    peak_mb: float
    said: str


class Spread(NamedTuple):
    """Of some repeated measurement."""

    median: float
    least: float
    most: float

    def show(self, digits: int) -> str:
        median, least, most = (f"{value:.{digits}f}" for value in self)
        return f"{median} ({least}…{most})"


def spread(values: Sequence[float]) -> Spread:
    return Spread(statistics.median(values), min(values), max(values))


def run(command: Sequence[str], environment: Mapping[str, str] | None = None) -> Run:
    """Run a command to its end; CalledProcessError, with what it said, where it fails."""
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as complained:
        begun_s = time.perf_counter()
        # No `with`: wait4 is what waits, and tells what was used.
        child = subprocess.Popen(command, stdout=said, stderr=complained, env=environment)
        try:
            _, status, used = os.wait4(child.pid, 0)
        except BaseException:  # whoever stops this process stops what it measures
            child.kill()
            raise
        wall_s = time.perf_counter() - begun_s
        child.returncode = os.waitstatus_to_exitcode(status)
        output, errors = (_text(said.fileno()), _text(complained.fileno()))
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, command, output, errors)
    peak_bytes = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return Run(wall_s, used.ru_utime + used.ru_stime, peak_bytes / 1e6, output)


def _text(descriptor: int) -> str:
    return os.pread(descriptor, os.fstat(descriptor).st_size, 0).decode("utf-8", "replace")


def output_of(command: Sequence[str]) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def gcs_bridge(*arguments: str) -> list[str]:
    """The command of this Python's own installation."""
    found = shutil.which("gcs-bridge", path=str(Path(sys.executable).parent))
    if found is None:
        raise SystemExit("gcs-bridge is not installed beside this Python: pip install -e .")
    return [found, *arguments]


def this_python(*arguments: str) -> list[str]:
    return [sys.executable, *arguments]


def describe_system() -> str:
    system = f"{platform.system()} {platform.machine()}"
    return f"{system}, {os.cpu_count()} CPUs, {platform.python_implementation()} {platform.python_version()}"


def describe_machine() -> str:
    """This Python's system, and the versions of what is measured in it."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("gcs-bridge", "numpy", "numba", "pymavlink"))
    return f"{describe_system()}; {packages}"
