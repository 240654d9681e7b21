"""What is needed of pymavlink's tables is kept from run to run, and read anew where they are others."""

from __future__ import annotations

import marshal
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gcs_bridge import cache
from gcs_bridge.mavlink import dialect


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where it is kept."""
    monkeypatch.setenv("GCS_BRIDGE_CACHE_DIR", str(tmp_path))
    forget()
    yield tmp_path
    monkeypatch.undo()
    forget()


def forget() -> None:
    cache.folders.cache_clear()
    cache.writable.cache_clear()
    dialect.load_dialect.cache_clear()


@pytest.mark.slow
def test_the_second_process_does_without_pymavlink(kept: Path) -> None:
    """The tables are the same, bit for bit."""
    program = """
import sys
from gcs_bridge.mavlink.dialect import load_dialect
dialect = load_dialect("common")
print("pymavlink" in sys.modules, *(table.tobytes().hex() for table in dialect.tables))
print(dialect["ATTITUDE"], dialect.name_of(30), dialect.enum_name("MAV_TYPE", 2), "AHRS2" in dialect)
"""
    environment = {**os.environ, "GCS_BRIDGE_CACHE_DIR": str(kept)}
    first, second = (
        subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
        for _ in range(2)
    )
    assert first.stdout.startswith("True ")
    assert second.stdout == first.stdout.replace("True", "False", 1)
    assert second.stdout.endswith("quadrotor False\n")


def test_what_is_kept_of_each_message_and_enum_is_what_pymavlink_says(kept: Path) -> None:
    """Also where the tables are those of the cache."""
    fresh = dialect.load_dialect("minimal")
    dialect.load_dialect.cache_clear()
    again = dialect.load_dialect("minimal")
    assert again is not fresh
    for name in fresh._definitions:
        assert again[name] == fresh[name]
    assert again._enums == fresh._enums
    for one, other in zip(again.tables, fresh.tables, strict=True):
        np.testing.assert_array_equal(one, other)


def test_another_file_of_pymavlink_is_read_anew(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An update changes its size or its time; so does another place, or another Python."""
    name = dialect._kept_as("minimal")
    assert name is not None
    dialect.load_dialect("minimal")
    assert [path.name for path in kept.iterdir()] == [name]
    stat = Path.stat

    def newer(path: Path, **options: bool) -> os.stat_result:
        status = stat(path, **options)
        if path.name != "minimal.py":
            return status
        return os.stat_result((*status[:6], status.st_size + 1, *status[7:]))

    monkeypatch.setattr(Path, "stat", newer)
    assert dialect._kept_as("minimal") != name
    monkeypatch.undo()
    assert dialect._kept_as("minimal") == name
    monkeypatch.setattr(sys, "version", "4.0")
    assert dialect._kept_as("minimal") != name


def test_where_nothing_can_be_kept_it_is_read_each_time(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a package without files, say, or to a folder that nobody can write."""
    monkeypatch.setattr(dialect, "_kept_as", lambda name: None)
    assert "HEARTBEAT" in dialect.load_dialect("minimal")
    assert not list(kept.iterdir())


def test_what_was_kept_is_used(kept: Path) -> None:
    """Else the tests above would show nothing."""
    name = dialect._kept_as("minimal")
    assert name is not None
    cache.write(name, marshal.dumps(({"MINE": (3, 4, 1, (1,), (("x", "<u1", 0),))}, {})))
    assert dialect.load_dialect("minimal").name_of(3) == "MINE"
