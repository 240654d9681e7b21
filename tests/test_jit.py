"""The compiled kernels: where their machine code is kept, and that a first compile is announced."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

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


def test_the_first_compile_is_announced_and_the_next_run_is_silent(tmp_path: Path) -> None:
    """One line on stderr before the wait; the machine code is kept for the next process."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", "import sys, gcs_bridge; gcs_bridge.check(sys.argv[1])", str(FIXTURE)]
    first, second = (
        subprocess.run(command, env=environment, capture_output=True, text=True, check=True) for _ in range(2)
    )
    assert first.stderr == "gcs-bridge: compiling its kernels, once on this machine (some seconds)\n"
    assert second.stderr == ""
