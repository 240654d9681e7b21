"""The first run on a machine compiles, and says so; later ones load what is there, whoever else does the same."""

from __future__ import annotations

import importlib
import io
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_bridge import cache
from gcs_bridge.jit import preparation, prepare
from gcs_bridge.jit.kernels import KERNELS
from tests.helpers.paths import ROOT

COUNT = 5
SAID = "gcs-bridge: compiling its kernels, once on this machine (some seconds)\n"
# Tells on standard output whether numba was loaded for it.
RUN = """
import sys
from gcs_bridge.jit import prepare
import {package}.some, {package}.more
prepare("{package}")
assert [one() for one in (*{package}.some.ALL, *{package}.more.ALL)] == [1, 2, 3, 4, 5]
print("numba" in sys.modules)
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A package of a few small kernels, found by the module path, and a cache of its own."""
    name = f"package_{abs(hash(tmp_path))}"
    folder = tmp_path / "source" / name
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    for module, numbers in (("some", (1, 2, 3)), ("more", (4, 5))):
        kernels = "".join(f"@kernel\ndef give_{number}() -> int:\n    return {number}\n\n" for number in numbers)
        names = ", ".join(f"give_{number}" for number in numbers)
        (folder / f"{module}.py").write_text(f"from gcs_bridge.jit import kernel\n\n{kernels}ALL = [{names}]\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path / "source"), str(ROOT)]))
    monkeypatch.syspath_prepend(tmp_path / "source")
    monkeypatch.setenv("GCS_BRIDGE_CACHE_DIR", str(tmp_path / "cache"))
    forget()
    count = len(KERNELS)
    yield name
    del KERNELS[count:]
    monkeypatch.undo()
    forget()


def forget() -> None:
    cache.folders.cache_clear()
    cache.writable.cache_clear()


def started(package: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", RUN.format(package=package)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def told_by(process: subprocess.Popen[str]) -> tuple[str, str]:
    """On standard output and on standard error."""
    out, error = process.communicate(timeout=120)
    assert process.returncode == 0, error
    return out, error


def kept() -> list[Path]:
    return sorted(path for path in Path(os.environ["GCS_BRIDGE_CACHE_DIR"]).iterdir() if path.name != "gcs-bridge.lock")


@pytest.mark.slow  # four processes, two of which compile
def test_the_first_run_says_so_and_the_next_is_silent_and_needs_no_numba(package: str) -> None:
    """One line where standard error is no terminal; what is missing is compiled again, and nothing else."""
    assert told_by(started(package))[1] == SAID
    before = kept()
    assert len(before) == COUNT
    assert told_by(started(package)) == ("False\n", "")
    before[0].unlink()
    times = [path.stat().st_mtime_ns for path in before[1:]]
    assert told_by(started(package)) == ("True\n", SAID)
    assert kept() == before
    assert [path.stat().st_mtime_ns for path in before[1:]] == times
    assert told_by(started(package)) == ("False\n", "")


@pytest.mark.slow
@pytest.mark.sweep
def test_two_first_runs_at_once_share_the_work_and_a_later_one_finds_all_of_it(package: str) -> None:
    """Each kernel is compiled by one of four processes: two runs, and the helpers that each of them starts."""
    both = [started(package), started(package)]
    for process in both:
        assert told_by(process)[1] == SAID
    assert len(kept()) == COUNT
    assert told_by(started(package)) == ("False\n", "")


@pytest.mark.sweep
@pytest.mark.slow
def test_a_new_version_is_compiled_anew_and_the_old_one_goes_on_beside_it(package: str, tmp_path: Path) -> None:
    """Whatever the times of the files say: pip may write older ones over newer ones."""
    told_by(started(package))
    source = tmp_path / "source" / package / "some.py"
    status, text = source.stat(), source.read_text()
    source.write_text(text.replace("return 2", "one = 1\n    return one + one"))
    os.utime(source, ns=(status.st_atime_ns - 10**10, status.st_mtime_ns - 10**10))
    assert told_by(started(package)) == ("True\n", SAID)
    assert Counter(path.name.partition("-")[0] for path in kept())[f"{package}.some.give_2"] == 2
    source.write_text(text)
    assert told_by(started(package)) == ("False\n", "")


@pytest.mark.slow
def test_on_a_terminal_a_line_tells_how_far_it_is_and_goes(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It leaves nothing behind."""

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    for module in ("some", "more"):
        importlib.import_module(f"{package}.{module}")
    prepare(package)
    lines = terminal.getvalue().split("\r")
    what = "gcs-bridge: compiling its kernels, once on this machine"
    assert lines[1 : COUNT + 2] == [f"{what}: {done} of {COUNT}" for done in range(COUNT + 1)]
    assert set(lines[-2]) == {" "}
    assert len(lines[-2]) == len(lines[-3])
    assert lines[-1] == ""


def test_a_kernel_that_nobody_prepared_is_compiled_when_it_is_called(
    package: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Silently, and alone."""
    some = importlib.import_module(f"{package}.some")
    assert some.ALL[0]() == 1
    assert [path.name.partition("-")[0] for path in kept()] == [f"{package}.some.give_1"]
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_without_a_helper_it_takes_longer_and_that_is_all(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No other process can be started, or it ends at once; what somebody else claims for ever is compiled here too."""

    def refused(*_: object, **__: object) -> None:
        raise OSError("no more processes")

    for module in ("some", "more"):
        importlib.import_module(f"{package}.{module}")
    last = KERNELS[-1].name
    held = f"from gcs_bridge import cache\nwith cache.claimed({last!r}) as ours: print(ours, flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", held], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"True\n"
        monkeypatch.setattr(preparation, "_PATIENCE_S", 0.2)
        monkeypatch.setattr(preparation, "_helper", refused)
        prepare(package)
        other.kill()
    assert len(kept()) == COUNT


@pytest.mark.slow
def test_the_whole_program_is_prepared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what was compiled for these tests, the kernels that were imported judge a recording: without a word, or numba.

    Wherever the package lies.
    """
    importlib.import_module("gcs_bridge.recordings.check")
    prepare("gcs_bridge")
    codes = {one.name: cache.read(one.name) for one in KERNELS if one.__module__.startswith("gcs_bridge.")}
    assert len(codes) > 20
    monkeypatch.setenv("GCS_BRIDGE_CACHE_DIR", str(tmp_path))
    forget()
    try:
        for name, code in codes.items():
            assert code is not None, name
            cache.write(name, code)
    finally:
        monkeypatch.undo()
        forget()
    environment = {**os.environ, "GCS_BRIDGE_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    program = "import sys, gcs_bridge; gcs_bridge.check(sys.argv[1]); print('numba' in sys.modules)"
    command = [sys.executable, "-c", program, str(ROOT / "sitl_fixtures" / "b2_mixed_rates.tlog")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("False\n", "")
