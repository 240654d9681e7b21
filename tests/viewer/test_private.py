"""Who can get at what is shown: this machine alone; and what a page that somebody else wrote can do there."""

import contextlib
import http.client
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_bridge.viewer import open_viewer, processes
from tests.helpers.viewer_tools import DATA_PORT, RERUN, WEB_PORT, WINDOW_PORT, eventually, has_screen

SERVICE = "/rerun.sdk_comms.v1alpha1.MessageProxyService/"
GRPC_WEB = {"Content-Type": "application/grpc-web+proto", "X-Grpc-Web": "1"}
NOTHING = bytes(5)  # an empty message
STRANGERS = ("http://evil.example", "null", "http://localhost.evil.example", "https://app.rerun.io")
NEIGHBOURS = ("http://localhost:3000", "http://127.0.0.1:8000")


@pytest.fixture
def served() -> Iterator[tuple[int, int]]:
    """The web viewer with a recording; the ports of data and page."""
    said: list[str] = []
    with open_viewer("web", say=said.append, live=True) as viewer:
        viewer.recording("by hand")
        port = int(said[0].split("127.0.0.1%3A")[1].split("%2F")[0])
        web_port = int(said[0].split("127.0.0.1:")[1].split("/")[0])
        eventually(lambda: asked(web_port, "GET", "/", None)[0] == 200)
        eventually(lambda: asked(port, "OPTIONS", SERVICE + "ReadMessages", None)[0])
        yield port, web_port


def asked(
    port: int, method: str, path: str, origin: str | None, headers: dict[str, str] | None = None, body: bytes = b""
) -> tuple[int, dict[str, str]]:
    """The answer to one request, as a browser sends it for a page of `origin`."""
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=10)) as connection:
        connection.request(method, path, body, {**(headers or {}), **({"Origin": origin} if origin else {})})
        answer = connection.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}


def listening() -> dict[int, set[str]]:
    """By port, the addresses at which this machine listens, as Linux writes them."""
    found: dict[int, set[str]] = {}
    for table in ("tcp", "tcp6"):
        for row in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            columns = row.split()
            address, port = columns[1].split(":")
            if columns[3] == "0A":
                found.setdefault(int(port, 16), set()).add(address)
    return found


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="told by /proc alone")
def test_the_page_and_its_data_are_for_this_machine(served: tuple[int, int]) -> None:
    """Both listen at 127.0.0.1, and nowhere else."""
    for port in served:
        assert listening()[port] == {"0100007F"}


@pytest.mark.slow
@has_screen
def test_the_window_s_port_is_for_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same of the port at which a window is told where to stand."""
    with subprocess.Popen(["Xvfb", "-displayfd", "1"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as screen:
        assert screen.stdout is not None
        monkeypatch.setenv("DISPLAY", f":{screen.stdout.readline().decode().strip()}")
        others = set(listening())  # other viewers of this machine, and of tests beside this one
        try:
            with open_viewer("native", say=lambda _: None, live=True) as viewer:
                viewer.recording("by hand")
                mine = range(WINDOW_PORT, WINDOW_PORT + 100)
                eventually(lambda: [port for port in listening() if port in mine and port not in others])
                now = {port: at for port, at in listening().items() if DATA_PORT <= port < WINDOW_PORT + 100}
                ours = {port: at for port, at in now.items() if port not in others}
        finally:
            screen.terminate()
    assert len(ours) >= 2
    assert set().union(*ours.values()) == {"0100007F"}


@pytest.mark.slow
def test_what_a_page_of_another_origin_can_do(served: tuple[int, int]) -> None:
    """A stranger's page can neither read nor write: the browser asks first, and is not told yes; what it may send
    without asking is refused. A page of this machine can do both, whatever its port: docs/field.md says so.
    """
    port, _ = served
    ask = {"Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "content-type,x-grpc-web"}
    for method in ("ReadMessages", "WriteMessages"):
        for origin in STRANGERS:
            assert "access-control-allow-origin" not in asked(port, "OPTIONS", SERVICE + method, origin, ask)[1]
            told = asked(port, "POST", SERVICE + method, origin, GRPC_WEB, NOTHING)[1]
            assert "access-control-allow-origin" not in told
            for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
                assert asked(port, "POST", SERVICE + method, origin, {"Content-Type": kind}, NOTHING)[0] == 400
        for origin in NEIGHBOURS:
            assert asked(port, "OPTIONS", SERVICE + method, origin, ask)[1]["access-control-allow-origin"] == origin


# --- nothing is reported home ----------------------------------------------------------------------------------------


def reports_kept(home: Path) -> list[Path]:
    """What rerun keeps of what it reports or is about to."""
    return [path for path in home.rglob("*analytics*") if "rerun" in path.parts]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The home of somebody who has never used rerun, on a machine that asks for its reports."""
    for name in ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    return tmp_path


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="kept elsewhere on other systems")
def test_rerun_would_report_by_itself(home: Path) -> None:
    """So that the next test means something: started by anybody else, it keeps what it is going to report."""
    with subprocess.Popen(
        [*RERUN, "--serve-web", "--bind", "127.0.0.1", "--web-viewer-port", str(WEB_PORT), "--port", str(DATA_PORT)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ) as process:
        try:
            eventually(lambda: reports_kept(home))
        finally:
            os.killpg(process.pid, signal.SIGKILL)  # with the program that it starts


@pytest.mark.slow
def test_nothing_is_reported_by_what_the_bridge_starts(home: Path, served: tuple[int, int]) -> None:
    """Neither by the page's server nor by this process."""
    time.sleep(1)
    assert reports_kept(home) == []


def test_both_programs_are_started_without_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """The window as well as the page's server, whatever the environment says."""
    started: list[dict[str, str]] = []

    class Started:
        def __init__(self, *_: object, env: dict[str, str], **__: object) -> None:
            started.append(env)

        def wait(self) -> int:
            return 0

    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    monkeypatch.setenv("CI", "")
    monkeypatch.setattr(subprocess, "Popen", Started)
    processes.Window("rerun+http://127.0.0.1:1/proxy", pytest.fail)
    processes.Page(1, "rerun+http://127.0.0.1:1/proxy", pytest.fail)
    assert [(env["CI"], "FORCE_RERUN_ANALYTICS" in env) for env in started] == [("1", False)] * 2
