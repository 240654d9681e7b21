"""How a viewer is opened, and every way in which that is refused: one clear line, and never a wait."""

import contextlib
import os
import socket
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gcs_bridge.cli import main
from gcs_bridge.cli.replay_run import _Clock, _Pace
from gcs_bridge.errors import UsageError
from gcs_bridge.viewer import ViewerSpec, processes
from gcs_bridge.viewer.base import WRITTEN
from gcs_bridge.viewer.open import OPENERS
from gcs_bridge.viewer.processes import free_port
from tests.helpers import wire
from tests.helpers.paths import FIXTURES
from tests.helpers.processor import awake_s
from tests.helpers.viewer_tools import DATA_PORT, WEB_PORT, eventually

Start = Callable[..., "subprocess.Popen[bytes]"]
RECORDING = str(FIXTURES / "c_copter_4hz.tlog")


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test opens a window on somebody's screen."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("SSH_CONNECTION", raising=False)


@pytest.fixture
def started() -> Iterator[Start]:
    """Starts gcs-bridge in a process of its own, which ends with the test."""
    ports = f"served._DATA_PORT, served._WEB_PORT = {DATA_PORT}, {WEB_PORT}"
    code = f"import sys; from gcs_bridge.viewer import served; {ports}; "
    code += "from gcs_bridge.cli import main; sys.exit(main(sys.argv[1:]))"
    with contextlib.ExitStack() as stack:

        def start(*arguments: str) -> "subprocess.Popen[bytes]":
            command = [sys.executable, "-c", code, *arguments]
            process = stack.enter_context(
                subprocess.Popen(command, stderr=subprocess.PIPE, env={**os.environ, "CI": "1"})
            )
            stack.callback(process.kill)
            return process

        yield start


@pytest.mark.parametrize("text", ["auto", "native", "web", "none"])
def test_each_kind_of_viewer_has_a_name(text: str) -> None:
    """What the contract lists is understood."""
    assert ViewerSpec.parse(text) == ViewerSpec(text)


def test_a_file_to_be_written_follows_save() -> None:
    """Colons in its name belong to it."""
    assert ViewerSpec.parse("save:a:b.rrd").path == Path("a:b.rrd")


@pytest.mark.parametrize("text", ["", "window", "save", "save:", "save:a.txt", "save:.rrd", "web:9090", "Auto"])
def test_other_viewers_are_refused(text: str) -> None:
    """In one line that names what was given."""
    with pytest.raises(UsageError, match="--viewer"):
        ViewerSpec.parse(text)


def test_each_kind_of_viewer_has_its_opener() -> None:
    """What can be asked for can be opened, and nothing else."""
    assert list(OPENERS) == list(WRITTEN)


def test_none_shows_nothing_and_needs_no_rerun() -> None:
    """A viewer that nobody wants costs nothing: rerun is not even imported."""
    code = (
        "import sys\n"
        "from gcs_bridge.viewer import open_viewer\n"
        "with open_viewer('none', say=print) as viewer:\n"
        "    assert viewer.recording('x').finish() and not viewer.stays\n"
        "assert 'rerun' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("command", [["replay"], ["replay", "--viewer", "web"], ["replay", "--viewer", "save:a.rrd"]])
def test_without_rerun_what_only_draws_is_refused(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a machine that was spared it: one line, which tells how it comes."""
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main([*command, RECORDING]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "rerun is not installed: pip install rerun-sdk" in line


@pytest.mark.slow
def test_without_rerun_all_else_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A link is listened to, and told why there is no picture; evidence is tables without one."""
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["listen", f"udpin:127.0.0.1:{free_port(19_300)}", "--duration", "0.1", "--plain"]) == 0
    assert "no picture: rerun is not installed: pip install rerun-sdk" in capsys.readouterr().err
    recording = str(FIXTURES / "k8_stream_stops.tlog")
    assert main(["check", recording, "--evidence", str(tmp_path), "-q"]) == 1
    kinds = {path.suffix for path in tmp_path.rglob("*") if path.is_file()}
    assert kinds == {".json", ".md", ".parquet"}
    (page,) = tmp_path.rglob("summary.md")
    assert "moment.rrd" not in page.read_text()


def test_a_window_without_a_display_is_refused_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    """Rerun itself would try for 11 s and then say nothing."""
    began_s = awake_s()
    assert main(["replay", RECORDING, "--viewer", "native"]) == 2
    assert awake_s() - began_s < 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "display" in line


@pytest.mark.parametrize("where", ["missing/a.rrd", "folder.rrd"])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_read(
    where: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit code 2."""
    (tmp_path / "folder.rrd").mkdir()
    assert main(["replay", "not there", "--viewer", f"save:{tmp_path / where}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "cannot write" in line


def test_the_recording_itself_is_not_written_over(tmp_path: Path) -> None:
    """Even if somebody gave it the suffix of the viewer's files."""
    source = tmp_path / "a.rrd"
    source.write_bytes(Path(RECORDING).read_bytes())
    assert main(["replay", str(source), "--viewer", f"save:{source}"]) == 2
    assert source.read_bytes() == Path(RECORDING).read_bytes()


def test_a_failed_replay_leaves_an_earlier_file_alone(tmp_path: Path) -> None:
    """Nothing is opened for writing before there is something to write."""
    target = tmp_path / "a.rrd"
    target.write_bytes(b"earlier")
    assert main(["replay", str(tmp_path / "missing.tlog"), "--viewer", f"save:{target}"]) == 3
    assert target.read_bytes() == b"earlier"


def test_a_taken_port_is_passed_over() -> None:
    """The next free one is used."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        taken = listener.getsockname()[1]
        assert free_port(taken) > taken


def test_no_free_port_is_told_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, before anything is read."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        taken = listener.getsockname()[1]
        monkeypatch.setattr(processes, "_PORTS_TRIED", 1)
        with pytest.raises(UsageError, match=rf"{taken} to {taken} are taken: end what listens there, or use save:"):
            free_port(taken)


@pytest.mark.slow
def test_a_page_whose_port_is_taken_meanwhile_is_told() -> None:
    """Whoever was quicker: it is one line that says what to do, and nothing else ends."""
    said: list[str] = []
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        taken = listener.getsockname()[1]
        page = processes.Page(taken, "rerun+http://127.0.0.1:1/proxy", said.append)
        eventually(lambda: said)
        page.close()
    (line,) = said
    assert f"page at port {taken} failed" in line
    assert "start anew, or use save:FILE.rrd" in line


def test_a_viewer_that_reads_too_slowly_is_not_waited_for_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The server goes on handing over for as long as somebody reads; who ends the program does not wait for that."""
    import rerun

    from gcs_bridge.viewer import open_viewer, served

    read, unregistered = threading.Event(), list[bool]()

    class Slow:
        def flush(self, timeout_sec: float) -> None:
            raise RuntimeError("timed out")

        def disconnect(self) -> None:
            read.wait(20)

    monkeypatch.setattr(served, "_END_S", 0.1)
    monkeypatch.setattr(rerun, "unregister_shutdown", lambda: unregistered.append(True))
    viewer = open_viewer("web", say=pytest.fail, live=True)
    assert isinstance(viewer, served.ServedViewer)
    viewer._recording = Slow()  # type: ignore[assignment]
    viewer.close()
    assert not read.is_set()
    assert unregistered == [True]
    read.set()


@pytest.mark.slow
def test_no_display_gives_the_page_s_address_and_a_signal_ends_it(started: Start) -> None:
    """`auto` without a display: one line with the address of a page, which is there; SIGTERM ends it."""
    process = started("replay", RECORDING, "-q")
    assert process.stderr is not None
    line = process.stderr.readline().decode()
    assert line.startswith("gcs-bridge: note: viewer: no display here; open http://127.0.0.1:")
    address = line.split()[-1]
    page = eventually(lambda: urllib.request.urlopen(address, timeout=2).read())
    assert b"<html" in page.lower()
    assert b"Ctrl-C" in process.stderr.readline()
    process.terminate()
    assert process.wait(30) == 0
    assert process.stderr.read() == b""
    process.stderr.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(address, timeout=2)


@pytest.mark.slow
def test_the_page_s_server_ends_with_a_killed_process(started: Start) -> None:
    """Not even kill −9 leaves it behind."""
    process = started("replay", RECORDING, "-q", "--viewer", "web")
    assert process.stderr is not None
    address = process.stderr.readline().decode().split()[-1]
    eventually(lambda: urllib.request.urlopen(address, timeout=2).read())
    process.kill()
    process.wait()
    process.stderr.close()

    def gone() -> bool:
        try:
            urllib.request.urlopen(address, timeout=2)
        except OSError:
            return True
        return False

    eventually(gone)


@pytest.mark.parametrize("at", ["soon", "-1", "nan", ""])
def test_a_moment_that_is_none_is_refused(at: str) -> None:
    """`--at` takes `alarm` or seconds."""
    assert main(["replay", RECORDING, "--viewer", "none", "--at", at]) == 2


def test_a_moment_past_the_end_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As `--from` past the end is."""
    assert main(["replay", RECORDING, "--viewer", f"save:{tmp_path / 'a.rrd'}", "--at", "999"]) == 2
    assert "past its end" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_no_alarm_to_open_at_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is opened at its beginning, and that is said."""
    assert main(["replay", RECORDING, "--viewer", f"save:{tmp_path / 'a.rrd'}", "--at", "alarm"]) == 0
    assert "no alarm" in capsys.readouterr().err


def test_a_recording_without_attitude_has_nothing_to_show(tmp_path: Path) -> None:
    """Exit code 4, as for `check`; with a viewer that stays, it does not stay."""
    source = tmp_path / "idle.tlog"
    source.write_bytes(wire.tlog([(wire.START_US + i * 10**6, wire.heartbeat(seq=i)) for i in range(10)]))
    assert main(["replay", str(source), "--viewer", "none", "-q"]) == 4


def test_a_paced_replay_keeps_the_recording_s_time() -> None:
    """At twice the speed 10 s take 5 s; pieces get longer where many bytes are little time; a long pause is cut."""

    class Clock:
        now_s = 0.0
        span_s = 0.0

        def sleep(self, seconds: float) -> None:
            self.now_s += seconds

    clock = Clock()
    due = _Clock(2.0, now_s=lambda: clock.now_s, sleep=clock.sleep)
    pace = _Pace(clock, due)  # type: ignore[arg-type]  # asks no more
    for span_s in (0.01, 0.02, 0.03):
        clock.span_s = span_s
        pace.keep()
    assert pace.chunk_bytes() == 512
    while clock.span_s < 10:
        clock.span_s += 0.1
        pace.keep()
    assert clock.now_s == pytest.approx(clock.span_s / 2)
    clock.span_s += 3600
    before_s = clock.now_s
    pace.keep()
    assert clock.now_s - before_s == pytest.approx(5.0)
