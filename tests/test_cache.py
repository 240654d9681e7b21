"""Where machine code is kept, and whose files are trusted: what is loaded from them runs as the user."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_bridge import cache

NAME = "somewhere.kernel-0123"
not_windows = pytest.mark.skipif(sys.platform == "win32", reason="Windows has other rights")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The one that is chosen."""
    chosen = tmp_path / "chosen"
    monkeypatch.setenv("GCS_BRIDGE_CACHE_DIR", str(chosen))
    forget()
    yield chosen
    monkeypatch.undo()
    forget()


def forget() -> None:
    cache.folders.cache_clear()
    cache.writable.cache_clear()


def test_what_was_written_is_read(folder: Path) -> None:
    """Byte for byte, from a file that others may read and only its owner may write; nothing else is left there."""
    assert cache.read(NAME) is None
    assert not cache.is_kept(NAME)
    cache.write(NAME, b"code\n\0\xff")
    assert cache.read(NAME) == b"code\n\0\xff"
    assert cache.is_kept(NAME)
    assert [path.name for path in folder.iterdir()] == [NAME]
    assert not (folder / NAME).stat().st_mode & 0o022


@not_windows
def test_a_file_that_others_may_write_is_passed_over(folder: Path) -> None:
    """By its group, or by everybody."""
    cache.write(NAME, b"code")
    for mode in (0o664, 0o646):
        (folder / NAME).chmod(mode)
        assert cache.read(NAME) is None
    (folder / NAME).chmod(0o644)
    assert cache.read(NAME) == b"code"


@not_windows
def test_so_is_a_folder_that_others_may_write(folder: Path) -> None:
    """Nothing is read from it or written to it: in a shared folder anybody could have put the file there."""
    cache.write(NAME, b"code")
    folder.chmod(0o777)
    forget()
    assert cache.read(NAME) is None
    assert cache.writable() is None
    cache.write("another", b"code")
    assert not (folder / "another").exists()


@not_windows
def test_so_is_what_belongs_to_somebody_else(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of root's is trusted, one of another user's is not."""
    cache.write(NAME, b"code")
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    forget()
    assert (cache.read(NAME) == b"code") == (mine == 0)
    monkeypatch.setattr(cache, "_ROOT", -1)
    assert cache.read(NAME) is None
    assert cache.writable() is None


@not_windows
def test_a_folder_behind_a_link_is_none(folder: Path, tmp_path: Path) -> None:
    """In a shared folder somebody may have put it there, to have others write where they should not."""
    (tmp_path / "elsewhere").mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    assert cache.writable() is None
    cache.write(NAME, b"code")
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.parametrize("damage", [lambda code: code[:-1], lambda code: code[:-1] + b"?", lambda code: b""])
def test_a_damaged_file_is_none(folder: Path, damage: object) -> None:
    """Cut off, changed or empty; it is written anew."""
    cache.write(NAME, b"machine code")
    path = folder / NAME
    path.write_bytes(damage(path.read_bytes()))  # type: ignore[operator]
    assert cache.read(NAME) is None
    cache.write(NAME, b"machine code")
    assert cache.read(NAME) == b"machine code"


def test_a_file_under_another_name_is_none(folder: Path) -> None:
    """Another kernel's code is not called with this one's arguments."""
    cache.write(NAME, b"code")
    (folder / NAME).rename(folder / "somewhere.other-0123")
    assert cache.read("somewhere.other-0123") is None


def test_where_nothing_can_be_written_nothing_is_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No error: it is compiled again in the next process."""
    folder.write_text("a file")
    assert cache.writable() is None
    cache.write(NAME, b"code")
    assert cache.read(NAME) is None
    with cache.claimed(NAME) as ours:
        assert ours

    folder.unlink()
    forget()
    monkeypatch.setattr(Path, "open", full)
    cache.write(NAME, b"code")
    monkeypatch.undo()
    assert cache.read(NAME) is None
    assert not list(folder.iterdir())


def full(*_: object, **__: object) -> None:
    raise OSError("the disk is full")


def test_older_versions_of_a_kernel_go_after_a_while(folder: Path) -> None:
    """Those of the same kernel, when it is compiled anew; others stay."""
    for name in ("a.kernel-1", "a.kernel-2", "a.kernels-1"):
        cache.write(name, b"code")
    long_ago_s = time.time() - 91 * 86_400
    for name in ("a.kernel-1", "a.kernels-1"):
        os.utime(folder / name, (long_ago_s, long_ago_s))
    cache.write("a.kernel-3", b"code")
    assert sorted(path.name for path in folder.iterdir()) == ["a.kernel-2", "a.kernel-3", "a.kernels-1"]


@not_windows
def test_the_folders_in_their_order(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Beside the source, as Python keeps its own; at the user's; at last where temporary files are."""
    monkeypatch.delenv("GCS_BRIDGE_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path / "tmp"))
    monkeypatch.setattr(cache, "_BESIDE_SOURCE", tmp_path / "source")
    beside, home, temporary = (
        tmp_path / "source",
        tmp_path / "home/gcs-bridge",
        tmp_path / f"tmp/gcs-bridge-{os.geteuid()}",
    )

    def written(**attributes: object) -> Path | None:
        forget()
        for name, value in attributes.items():
            monkeypatch.setattr(sys, name, value)
        return cache.writable()

    forget()
    assert cache.folders() == (beside, home, temporary)
    assert written(dont_write_bytecode=False) == beside
    assert written(dont_write_bytecode=True) == home
    (tmp_path / "home").rename(tmp_path / "away")
    (tmp_path / "home").write_text("no folder")
    assert written() == temporary
    forget()


@not_windows
def test_among_processes_one_compiles() -> None:
    """Another one is told no until that is done; a claim ends with its process, however that ended."""
    claim = "from gcs_bridge import cache\nwith cache.claimed('one') as ours: print(ours, flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", claim], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "True\n"
        with cache.claimed("one") as ours, cache.claimed("two") as another:
            assert (ours, another) == (False, True)
        other.kill()
        other.wait()
    with cache.claimed("one") as ours:
        assert ours
