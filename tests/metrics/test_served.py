"""The port: who may read there, what is told when, and that nobody who reads holds up what is judged."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPResponse
from itertools import pairwise
from pathlib import Path

import pytest

from gcs_bridge.cli import main
from gcs_bridge.errors import SourceError
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.snapshot import Snapshot
from gcs_bridge.metrics import published
from gcs_bridge.metrics.served import MetricsServer
from tests.helpers import wire
from tests.helpers.live_links import Process, fixture, free_port, paced, wait_until
from tests.helpers.scraped import Scraped, assert_counters_went_on

LINK = "udpin:127.0.0.1:14550"
FLIGHT = wire.flight(wire.Motion(4.0, seed=3), 4.0)


class Looked:
    """A monitor that counts how often it is looked at; by whom."""

    def __init__(self) -> None:
        self.monitor = Monitor()
        self.monitor.open_link(0, datagrams=True)
        self.threads: list[int] = []

    def snapshot(self, *, most_vehicles: int | None = None) -> Snapshot:
        self.threads.append(threading.get_ident())
        return self.monitor.snapshot(most_vehicles=most_vehicles)


class Loop:
    """A server, and a thread that comes round for it as the live loop does; whoever holds `round` holds it up."""

    def __init__(self) -> None:
        self.looked = Looked()
        self.server = MetricsServer(0, [LINK])
        self.server.follow(self.looked)
        self.round = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self._records = iter(FLIGHT)

    def _run(self) -> None:
        while not self._stop.wait(0.005):
            with self.round:
                for t_us, data in [one for _, one in zip(range(5), self._records, strict=False)]:
                    self.looked.monitor.feed_datagrams([(data, t_us)], 0)
                self.server.run()

    @property
    def thread_id(self) -> int | None:
        return self._thread.ident

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.server.close()


@pytest.fixture
def loop(monkeypatch: pytest.MonkeyPatch) -> Iterator[Loop]:
    monkeypatch.setattr(published, "_PATIENCE_S", 30.0)  # on a busy machine too
    one = Loop()
    yield one
    one.close()


def opened(url: str, **headers: str) -> HTTPResponse:
    response = urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=60)
    assert isinstance(response, HTTPResponse)
    return response


def scraped(url: str) -> Scraped:
    with opened(url) as response:
        return Scraped(response.read().decode())


# --- what is told ----------------------------------------------------------------------------------------------------


def test_a_scrape(loop: Loop) -> None:
    """Prometheus's text, with this process beside it; OpenMetrics for who asks."""
    with opened(loop.server.url) as plain:
        assert plain.headers["Content-Type"].startswith("text/plain; version=")
        seen = Scraped(plain.read().decode())
    assert seen.one("link_up", link=LINK) == 1
    assert seen.one("build_info") == 1
    if sys.platform == "linux":
        assert seen.one("process_cpu_seconds_total") > 0
    with opened(loop.server.url, Accept="application/openmetrics-text; version=1.0.0") as other:
        assert other.headers["Content-Type"].startswith("application/openmetrics-text; version=1.0.0")
        assert other.read().endswith(b"# EOF\n")


@pytest.mark.slow
def test_the_loop_alone_looks_and_only_when_asked(loop: Loop, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody scrapes: nothing is looked at. However many do, it is the loop's thread, and once in a while."""
    time.sleep(0.05)
    assert loop.looked.threads == []
    monkeypatch.setattr(published, "_YOUNG_S", 1000.0)
    for _ in range(20):
        scraped(loop.server.url)
    assert loop.looked.threads == [loop.thread_id]


def test_a_loop_that_does_not_come_round_is_no_healthy_one(loop: Loop, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was known before is not told as if it were now: the scrape fails, until the loop goes on."""
    assert scraped(loop.server.url).one("link_up") == 1
    monkeypatch.setattr(published, "_YOUNG_S", 0.0)
    with loop.round, monkeypatch.context() as impatient:
        impatient.setattr(published, "_PATIENCE_S", 0.05)
        with pytest.raises(urllib.error.HTTPError) as refused:
            opened(loop.server.url)
        assert refused.value.code == 503
        assert b"nothing is known right now" in refused.value.read()
        refused.value.close()
    assert scraped(loop.server.url).one("link_up") == 1


@pytest.mark.slow
def test_many_at_once(loop: Loop, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole answers for all, and for none of them a counter that goes back, while frames come."""
    monkeypatch.setattr(published, "_YOUNG_S", 0.0)

    def read(_: int) -> list[Scraped]:
        return [scraped(loop.server.url) for _ in range(5)]

    with ThreadPoolExecutor(3) as readers:
        for seen in readers.map(read, range(3)):
            for before, after in pairwise(seen):
                assert_counters_went_on(before, after)


# --- who reads -------------------------------------------------------------------------------------------------------


def test_who_says_nothing_or_goes_holds_nobody_up(loop: Loop, capfd: pytest.CaptureFixture[str]) -> None:
    """No word, half a request, a reader who goes, bytes that are no HTTP: others are answered, nothing is printed."""
    address = ("127.0.0.1", int(loop.server.url.rpartition(":")[2].partition("/")[0]))
    with socket.create_connection(address):
        with socket.create_connection(address) as cut:
            cut.sendall(b"GET /met")
        with socket.create_connection(address) as gone:
            gone.sendall(b"GET /metrics HTTP/1.1\r\n\r\n")
        with socket.create_connection(address) as noise:
            noise.sendall(b"\xfd\x09\0\0\r\n\r\n")
            noise.settimeout(5)
            noise.recv(10)
        assert scraped(loop.server.url).one("link_up") == 1
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(loop.server.url, data=b"x", timeout=60)
        assert refused.value.code == 405
        refused.value.close()
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere 127.0.0.2 is no address of this machine")
def test_at_one_address_alone(loop: Loop) -> None:
    """At 127.0.0.1, not at any other of the machine."""
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", int(loop.server.url.rpartition(":")[2].partition("/")[0])))


@pytest.mark.slow
def test_a_closed_port_is_free_again(loop: Loop) -> None:
    """At once, also behind somebody who had read."""
    scraped(loop.server.url)
    port = int(loop.server.url.rpartition(":")[2].partition("/")[0])
    other = MetricsServer(0, [LINK])
    other.close()
    with pytest.raises(SourceError, match="is in use"):
        MetricsServer(port, [LINK])


# --- the option ------------------------------------------------------------------------------------------------------


def test_port_taken(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """One line with who has it, exit code 3, and no file is left behind."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        uri = f"udpin:127.0.0.1:{free_port()}"
        record = str(tmp_path / "live.tlog")
        assert main(["listen", uri, "--viewer", "none", "--record", record, "--metrics", str(port)]) == 3
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith(f"gcs-bridge: error: --metrics {port}: port {port} is in use")
    assert shown.err.count("\n") == 1
    if sys.platform == "linux":
        assert f"(process {os.getpid()})" in shown.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("port", ["65536", "-1", "x", "127.0.0.1:9000", ""])
def test_what_is_no_port(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, exit code 2."""
    assert main(["listen", "udpin:127.0.0.1:14550", f"--metrics={port}"]) == 2
    shown = capsys.readouterr()
    assert "--metrics" in shown.err
    assert shown.err.count("\n") == 1


@pytest.mark.slow
def test_nothing_of_it_is_loaded_unless_asked_for() -> None:
    """Neither Prometheus's library nor the standard library's server, by what every live command imports."""
    program = (
        "import sys, gcs_bridge.cli.listen, gcs_bridge.cli.live_run, gcs_bridge.links.loop; "
        "print([name for name in ('prometheus_client', 'wsgiref', 'gcs_bridge.metrics') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.slow
def test_listen_serves_what_it_judges() -> None:
    """A vehicle with a fault, over UDP, read from outside: the alarm is there, and SIGTERM still ends it with 0."""
    port, link_port = free_port(socket.SOCK_STREAM), free_port()
    frames = fixture("d_plane_pitchtrim3", to_s=12, fault="yaw_offset:25")
    url = f"http://127.0.0.1:{port}/metrics"
    options = ("--viewer", "none", "--metrics", str(port))
    with Process("listen", f"udpin:127.0.0.1:{link_port}", *options) as process:
        process.wait_for("link up")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, contextlib.suppress(ConnectionError):
            paced(frames, lambda data: sender.sendto(data, ("127.0.0.1", link_port)), 12)
        process.wait_for("ALARM")
        wait_until(lambda: scraped(url).state("euler_quaternion") == "alarm", 20)
        seen = scraped(url)
        process.signal(signal.SIGTERM)
        code, said = process.ended()
    assert (code, said) == (0, f"gcs-bridge: note: metrics are at {url}\n")
    assert seen.one("frames_total", vehicle="1.1", link=f"udpin:127.0.0.1:{link_port}") > 100
    assert seen.one("alarms_total", check="euler_quaternion", severity="alarm") == 1
