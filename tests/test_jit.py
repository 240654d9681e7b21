"""The compiled kernels: where their machine code is kept, and that a first compile is announced."""

from __future__ import annotations

import importlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge import jit
from tests.helpers.paths import ROOT

FIXTURE = ROOT / "sitl_fixtures" / "b2_mixed_rates.tlog"


def test_a_cache_folder_is_found_where_neither_package_nor_home_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """numba refuses to cache there; it is pointed to the folder for temporary files instead."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(jit, "_writable", lambda folder: False)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    jit._ensure_cache_folder()
    assert Path(os.environ["NUMBA_CACHE_DIR"]).name.startswith("gcs-bridge-kernels-")


def test_a_writable_package_or_home_or_a_users_own_choice_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """numba's own choice of folder stands where it can work."""
    monkeypatch.setattr(os, "environ", dict(os.environ))
    os.environ.pop("NUMBA_CACHE_DIR", None)
    monkeypatch.setattr(jit, "_writable", lambda folder: "__pycache__" not in folder.parts)
    jit._ensure_cache_folder()
    assert "NUMBA_CACHE_DIR" not in os.environ
    monkeypatch.setattr(jit, "_writable", lambda folder: False)
    os.environ["NUMBA_CACHE_DIR"] = "/chosen"
    jit._ensure_cache_folder()
    assert os.environ["NUMBA_CACHE_DIR"] == "/chosen"


@pytest.mark.slow
def test_the_first_compile_is_announced_and_the_next_run_is_silent(tmp_path: Path) -> None:
    """One line on stderr before the wait; the machine code is kept for the next process.

    Of a copy of the package, with the machine code that lies beside it: all of it would take a minute to compile.
    """
    for name in ("gcs_bridge", "config"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.tmp.*"))
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    command = [sys.executable, "-c", "import sys, gcs_bridge; gcs_bridge.check(sys.argv[1])", str(FIXTURE)]

    def started() -> "subprocess.Popen[str]":
        return subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)

    def said() -> str:
        with started() as process:
            _, errors = process.communicate()
        assert process.returncode == 0, errors
        return errors

    def forget(kernels: str) -> None:
        for index in tmp_path.rglob(f"*.{kernels}-*.nbi"):
            index.unlink()

    compiling = "gcs-bridge: compiling its kernels, once on this machine (some seconds)\n"
    said()
    forget("slide")  # whichever is missing or out of date
    assert said() == compiling
    assert said() == ""
    forget("*")
    with started() as process:
        assert process.stderr is not None
        assert process.stderr.readline() == compiling
        process.kill()


def test_every_kernel_is_asked_about_by_the_package_that_it_is_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """No list of them is kept by hand: what the source compiles is known as soon as its module is imported."""
    written = {
        f"{path.relative_to(ROOT).with_suffix('').as_posix().replace('/', '.')}:{name}"
        for path in (ROOT / "gcs_bridge").rglob("*.py")
        for name in re.findall(r"^@kernel\ndef (\w+)", path.read_text("utf-8"), re.MULTILINE)
    }
    for one in written:
        importlib.import_module(one.split(":")[0])
    asked: list[str] = []

    def is_cached(compiled: Any) -> bool:
        asked.append(f"{compiled.__module__}:{compiled.__name__}")
        return True

    monkeypatch.setattr(jit, "_is_cached", is_cached)
    for package, expected in (
        ("gcs_bridge", written),
        ("gcs_bridge.mavlink", {one for one in written if one.startswith("gcs_bridge.mavlink.")}),
    ):
        asked.clear()
        assert not jit.needs_compiling(package)
        assert set(asked) == expected
        assert len(expected) > 2
