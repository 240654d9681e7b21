"""Recordings at URLs, from real servers on this machine: what is there, what is known, and what cannot be read."""

import http.server
import importlib
import os
import socket
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_bridge.errors import SourceError, UsageError
from gcs_bridge.survey.found import find
from tests.helpers.paths import FIXTURES
from tests.helpers.surveyed import rows, surveyed

FLIGHT = FIXTURES / "d_tailsitter_tumble.tlog"
DATA = FLIGHT.read_bytes()
NAMES = ("one.tlog", "below/two.tlog", "below/packed.zip::three.tlog", "below/packed.zip::four.tlog")


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """What the servers serve: four recordings, two of them in an archive, and something else."""
    folder = tmp_path / "served"
    (folder / "below").mkdir(parents=True)
    (folder / "one.tlog").write_bytes(DATA)
    (folder / "below" / "two.tlog").write_bytes(DATA[:-1] + b"\0")
    with zipfile.ZipFile(folder / "below" / "packed.zip", "w") as archive:
        archive.writestr("three.tlog", DATA[:-1] + b"\1")
        archive.writestr("four.tlog", DATA[:-1] + b"\2")
    (folder / "readme.txt").write_text("no recording")
    return folder


@pytest.fixture
def asked_for() -> list[str]:
    """What was asked of the server, as `GET /one.tlog`."""
    return []


@pytest.fixture
def web(files: Path, asked_for: list[str]) -> Iterator[str]:
    """A web server of these files."""
    pytest.importorskip("aiohttp", reason="the remote extra installs it")

    class Handler(http.server.SimpleHTTPRequestHandler):
        def __init__(self, *args: Any) -> None:
            super().__init__(*args, directory=str(files))

        def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
            asked_for.append(f"{self.command} {self.path}")

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  # as it is called
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.slow
def test_over_http(web: str, tmp_path: Path, asked_for: list[str]) -> None:
    """A folder that the server lists, and a file of it by name; known again without being sent again."""
    out = tmp_path / "out"
    ran = surveyed([f"{web}/", f"{web}/one.tlog"], out)
    assert (ran.failures, ran.judged) == ([], 4)
    found = {row["path"]: row["bytes"] for row in rows(out, "recordings")}
    assert found == {f"{web}/{name}": len(DATA) for name in NAMES}
    asked_for.clear()
    again = surveyed([f"{web}/"], out)
    assert (again.judged, again.known) == (0, 3)
    assert not [line for line in asked_for if line.startswith("GET") and line.endswith((".tlog", ".zip"))]


@pytest.mark.slow
def test_what_cannot_be_read_over_http(web: str, tmp_path: Path) -> None:
    """One line each, and nothing else is lost."""
    with socket.socket() as silent:  # it has a port, and listens to nobody
        silent.bind(("127.0.0.1", 0))
        closed = f"http://127.0.0.1:{silent.getsockname()[1]}/x.tlog"
        ran = surveyed([f"{web}/gone.tlog", f"{web}/nowhere/", closed, f"{web}/one.tlog"], tmp_path)
    assert ran.judged == 1
    nowhere, gone, refused = ran.failures
    assert gone.startswith(f"{web}/gone.tlog: cannot be read: ")
    assert "Cannot connect" in refused
    assert nowhere.startswith(f"{web}/nowhere/: cannot be searched: ")
    assert not any("\n" in line or "Traceback" in line for line in ran.failures)


def test_a_kind_of_url_that_nobody_knows() -> None:
    """It is wrong usage, and told before anything is done."""
    with pytest.raises(UsageError, match="nix"):
        list(find(["nix://x/y.tlog"]))


def test_what_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is told which extra has it."""
    known = importlib.import_module("fsspec.registry").known_implementations
    monkeypatch.setitem(known, "s4", {"class": "nowhere.S4", "err": "install nowhere"})
    with pytest.raises(UsageError, match=r"nothing is installed for s4://.*gcs-bridge\[remote\]"):
        list(find(["s4://bucket/flight.tlog"]))


def test_any_file_system(files: Path, tmp_path: Path) -> None:
    """Of fsspec: files of this machine, by their URL."""
    ran = surveyed([f"file://{files}"], tmp_path / "out")
    assert (ran.judged, ran.failures) == (4, [])


@pytest.fixture
def s3(files: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """moto's S3 server with these files in a bucket."""
    pytest.importorskip("s3fs", reason="the remote extra installs it")
    moto = pytest.importorskip("moto.server", reason="the test extra installs it")
    import s3fs

    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "someone")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "something")
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    s3fs.S3FileSystem.clear_instance_cache()
    store = s3fs.S3FileSystem()
    store.mkdir("bucket")
    store.put(f"{files}/", "bucket/logs/", recursive=True)
    yield "s3://bucket/logs"
    s3fs.S3FileSystem.clear_instance_cache()
    server.stop()


@pytest.mark.slow
@pytest.mark.sweep
def test_over_s3(s3: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All below a prefix; known again by their ETags; without credentials it is told what to do."""
    import s3fs

    out = tmp_path / "out"
    ran = surveyed([s3], out)
    assert (ran.failures, ran.judged) == ([], 4)
    assert {row["path"] for row in rows(out, "recordings")} == {f"{s3}/{name}" for name in NAMES}
    again = surveyed([s3, "s3://bucket/gone.tlog", "s3://nobodys/"], out)
    assert (again.judged, again.known, len(again.failures)) == (0, 3, 2)
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    s3fs.S3FileSystem.clear_instance_cache()
    (failure,) = find([s3])
    assert isinstance(failure, SourceError)
    assert "AWS_PROFILE" in str(failure)
