"""The compiled kernels: where their machine code is kept, and that a first compile is announced."""

from __future__ import annotations

import importlib
import os
import re
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
    """One line on stderr before the wait; the machine code is kept for the next process."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", "import sys, gcs_bridge; gcs_bridge.check(sys.argv[1])", str(FIXTURE)]

    def said() -> str:
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stderr

    compiling = "gcs-bridge: compiling its kernels, once on this machine (some seconds)\n"
    assert said() == compiling
    assert said() == ""
    for name in ("rate_norms", "judge_steps"):  # whichever is missing or out of date
        (index,) = tmp_path.rglob(f"*.{name}-*.nbi")
        index.unlink()
        assert said() == compiling, name
    assert said() == ""


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
