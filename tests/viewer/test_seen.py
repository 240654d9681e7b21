"""What the viewer itself makes of it: its transforms, its picture, its page; and viewers that come and go."""

import io
import os
import shutil
import signal
import socket
import subprocess
import time
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun.blueprint as rrb
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from gcs_bridge.cli import main
from gcs_bridge.events import AlarmRaised
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer import ViewerSink, open_viewer
from gcs_bridge.viewer.airframes import NOSE
from gcs_bridge.viewer.bodies import bodies_view
from gcs_bridge.viewer.processes import free_port
from gcs_bridge.viewer.served import ServedViewer
from gcs_bridge.viewer.sink import RerunSink
from tests.helpers import wire
from tests.helpers.paths import FIXTURES
from tests.helpers.processor import awake_s
from tests.helpers.projected import expected_deg, seen_deg
from tests.helpers.viewer_tools import (
    HEADLESS_PORT,
    Drawn,
    Headless,
    Picture,
    can_draw,
    eventually,
    has_browser,
    has_screen,
    headless,
)

TOLERANCE = 1e-6  # of a rotation matrix's entries: the wire's numbers are float32
BODY = "/vehicle/1.1/body"
PANELS = ["2D", "3D", "StateTimeline", "TextDocument", "TextLog"]  # and plots


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test opens a window on somebody's screen."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("CI", "1")  # rerun's program reports nothing home


@pytest.fixture
def port() -> int:
    return free_port(HEADLESS_PORT)


def feed(monitor: Monitor, sink: ViewerSink, records: list[tuple[int, bytes]]) -> None:
    """Five frames at a time, as a link that is read each tenth of a second brings them."""
    for i in range(0, len(records), 5):
        some = records[i : i + 5]
        sink.events(monitor.feed(b"".join(frame for _, frame in some), some[-1][0]))


@pytest.mark.slow
@can_draw
def test_the_viewer_turns_bodies_as_scipy_does(tmp_path: Path, port: int) -> None:
    """At chosen instants of an acro flight, through the pole too, the viewer's own matrices are SciPy's, for both."""
    path = tmp_path / "a.rrd"
    assert main(["replay", str(FIXTURES / "b_copter_acro.tlog"), "--viewer", f"save:{path}", "-q"]) == 0
    recording = Drawn(path)
    with headless(path, port) as viewer:
        for source in ("quaternion", "euler"):
            boot_us, xyzw = recording.numbers(f"{BODY}/{source}", "Transform3D:quaternion")
            viewer.wait_for("boot", int(boot_us[-1]))
            for row in np.linspace(0, len(boot_us) - 1, 6, dtype=int):
                viewer.go_to(int(boot_us[row]))
                seen = viewer.matrix(f"{BODY}/{source}")
                assert seen == pytest.approx(Rotation.from_quat(xyzw[row]).as_matrix(), abs=TOLERANCE)
        assert viewer.errors() == []


@pytest.mark.slow
@can_draw
def test_yaw_90_turns_the_nose_east_and_down_is_drawn_downwards(tmp_path: Path, port: int) -> None:
    """By hand: yaw 90° puts forward on east and right on south; and in the picture the blue arrow points down."""
    records = []
    for i in range(50):
        ms = 1000 + 40 * i
        now = wire.START_US + 40_000 * i
        records += [
            (now, wire.attitude(ms, (0.0, 0.0, np.pi / 2))),
            (now, wire.attitude_quaternion(ms, (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))),
        ]
    path = tmp_path / "a.rrd"
    with open_viewer(f"save:{path}", say=pytest.fail) as saved:
        sink = saved.recording("yaw 90")
        feed(Monitor(observer=sink.observe), sink, records)
        sink.finish()
    with headless(path, port) as viewer:
        viewer.wait_for("boot", 2_960_000)
        viewer.go_to(2_960_000)
        for source in ("quaternion", "euler"):
            R_nb = viewer.matrix(f"{BODY}/{source}")
            forward, right, down = R_nb.T
            assert forward == pytest.approx([0, 1, 0], abs=TOLERANCE)
            assert right == pytest.approx([-1, 0, 0], abs=TOLERANCE)
            assert down == pytest.approx([0, 0, 1], abs=TOLERANCE)

        def down_is_downwards(picture: Picture) -> None:
            rows_of_blue, columns_of_blue = np.nonzero(about(picture, (70, 130, 255), within=60))
            rows_of_nose, columns_of_nose = np.nonzero(about(picture, NOSE, within=60))
            assert len(rows_of_blue) > 50
            assert len(rows_of_nose) > 50
            below = np.abs(columns_of_blue - columns_of_nose.mean()) < 110  # the body's arrow, not the world's
            assert rows_of_blue[below].mean() > rows_of_nose.mean() + 20

        viewer.shows(down_is_downwards, only="3D")


@pytest.mark.slow
@can_draw
def test_the_layout_shows_everything_without_a_click(tmp_path: Path, port: int) -> None:
    """Bodies, horizon, lanes, alarms, events, four plots of attitude; in tabs nine, trail and map; an alarm is red."""
    source = tmp_path / "turned.tlog"
    flown = (FIXTURES / "a_copter_square.tlog").read_bytes()
    source.write_bytes(inject(flown, [parse_fault("yaw_offset:25")], from_s=12))
    path = tmp_path / "a.rrd"
    assert main(["replay", str(source), "--viewer", f"save:{path}", "-q"]) == 0
    with headless(path, port) as viewer:
        viewer.wait_for("boot", 100_000_000)
        viewer.go_to(30_000_000)
        eventually(lambda: viewer.views() == sorted([*PANELS, "3D", "Map", *["TimeSeries"] * 13]))

        def all_is_there(picture: Picture) -> None:
            assert picture.shape[:2] == (900, 1400)
            assert about(picture, (229, 57, 53), within=60).sum() > 2000  # the lane of the alarm
            for colour in ((90, 200, 250), (255, 175, 60), (38, 84, 148)):  # lines of both sources, and the sky
                assert about(picture, colour, within=40).sum() > 200

        viewer.shows(all_is_there)
        assert viewer.errors() == []


def begin_us(viewer: Headless) -> int:
    """Of what it has been given so far."""
    (line,) = [line for line in viewer.state().recordings[0].timelines if line.name == "boot"]
    return int(line.start) // 1000


def assert_complete(viewer: Headless) -> None:
    """It shows the flight from the first sample to the last, in its place, with all panels, at an instant as it was."""
    viewer.wait_for("boot", 15_800_000)
    eventually(lambda: begin_us(viewer) == 10_000_000)
    eventually(lambda: viewer.edge(BODY)["sample_time"] == {"kind": "static"})
    eventually(lambda: viewer.views() == [*PANELS, *["TimeSeries"] * 7])
    viewer.go_to(12_000_000)
    expected = wire.Motion(6.0).rotation(2.0).as_matrix()
    assert viewer.matrix(f"{BODY}/euler") == pytest.approx(expected, abs=TOLERANCE)


@pytest.mark.slow
@can_draw
def test_late_two_at_once_killed_and_restarted_viewers_see_it_all(port: int) -> None:
    """They come after the last sample; one of two is killed, the other does not mind, and the next is complete, too."""
    with serving() as viewer:
        sink = viewer.recording("late")
        feed(Monitor(observer=sink.observe), sink, wire.flight(wire.Motion(6.0), 6.0))
        with headless(viewer.url, port) as one:
            with headless(viewer.url, free_port(port + 1)) as other:
                assert_complete(one)
                assert_complete(other)
            assert_complete(one)  # the other was killed
            with headless(viewer.url, free_port(port + 2)) as again:
                assert_complete(again)


@pytest.mark.slow
@can_draw
def test_a_late_viewer_sees_what_never_changes_though_the_history_is_full(port: int) -> None:
    """The server forgets old samples first; the scene and its layout stay."""
    with serving("1MiB") as viewer:
        sink = viewer.recording("full")
        feed(Monitor(observer=sink.observe), sink, wire.flight(wire.Motion(25.0), 25.0))
        with headless(viewer.url, port) as late:
            late.wait_for("boot", 34_000_000)
            assert begin_us(late) > 15_000_000  # it began at 10 s
            eventually(lambda: late.edge(BODY)["sample_time"] == {"kind": "static"})
            late.go_to(34_000_000)
            wxyz = wire.Motion(25.0).wxyz(24.0)
            assert late.matrix(f"{BODY}/quaternion") == pytest.approx(
                Rotation.from_quat(wxyz[[1, 2, 3, 0]]).as_matrix(), abs=TOLERANCE
            )


GROWN = 2_000_000  # bytes; the server's history of 25 s of flight would be twice as much


class Flight:
    """500 messages a second, drawn as fast as they can be; remembers for how long each batch waited for somebody.

    Waiting for a processor does not count: that is the other tests' doing.
    """

    def __init__(self, viewer: Any, seconds: float) -> None:
        flight = wire.flight(wire.Motion(seconds), seconds, euler_hz=250.0, quaternion_hz=250.0)
        self._batches = iter([flight[i : i + 50] for i in range(0, len(flight), 50)])  # 0.1 s, as of a live link
        self._sink = viewer.recording("flight")
        self._monitor = Monitor(observer=self._sink.observe)
        self.waited_s: list[float] = []

    def fly(self, seconds: int) -> int:
        """How many bytes the process has grown by."""
        before = resident_bytes()
        for _ in range(seconds):
            for batch in islice(self._batches, 10):
                began_s = awake_s()
                self._sink.events(self._monitor.feed(b"".join(frame for _, frame in batch), batch[-1][0]))
                self.waited_s.append(awake_s() - began_s)
                time.sleep(0.002)
        return resident_bytes() - before

    def adds_nothing(self) -> bool:
        """Whether 25 seconds do not; once more, as a busy machine may not have put away by then what came before."""
        return any(self.fly(25) < GROWN for _ in range(2))

    def assert_that_nobody_waited(self) -> None:
        """A viewer that is waited for holds up every batch from then on; rerun's own threads may, here and there, wait
        for a processor on a busy machine.
        """
        late = [waited_s for waited_s in self.waited_s if waited_s > 0.1]
        assert len(late) <= len(self.waited_s) / 50
        assert sum(late) < 5.0


@pytest.mark.slow
@pytest.mark.sweep
@can_draw
def test_no_viewer_or_a_killed_one_neither_stops_nor_slows_nor_grows_us(port: int) -> None:
    """Once the server's history is full, a flight adds nothing: nobody looking, and after who looked died."""
    with serving("1MiB") as viewer:
        flight = Flight(viewer, 130.0)
        flight.fly(25)
        assert flight.adds_nothing()
        with headless(viewer.url, port) as watching:
            watching.wait_for("boot", 50_000_000)
            flight.fly(5)
        assert flight.adds_nothing()
        flight.assert_that_nobody_waited()
        assert eventually(lambda: socket.create_connection(("127.0.0.1", viewer._port), 1)).close() is None


@pytest.mark.slow
@can_draw
def test_a_viewer_that_reads_no_more_neither_stops_nor_slows_nor_grows_us(port: int) -> None:
    """The worst kind: it is stopped for ten seconds of flight, and then killed."""
    with serving("1MiB") as viewer:
        flight = Flight(viewer, 40.0)
        flight.fly(10)
        full = resident_bytes()
        with headless(viewer.url, port) as watching:
            watching.wait_for("boot", 5_000_000)
            flight.fly(5)
            os.killpg(watching.process.pid, signal.SIGSTOP)
            flight.fly(10)
        flight.fly(5)
        flight.assert_that_nobody_waited()
        assert eventually(lambda: resident_bytes() < 1.03 * full)  # once a busy machine has put away what came before


@pytest.mark.slow
@can_draw
@has_screen
def test_a_window_opens_at_the_alarm_and_its_end_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`native` on a real screen: the cursor stands at the alarm. Killed, it is told in one line, and we go on."""
    flown = inject((FIXTURES / "c_copter_4hz.tlog").read_bytes(), [parse_fault("yaw_offset:25")], from_s=10)
    said: list[str] = []
    screen = subprocess.Popen(["Xvfb", "-displayfd", "1", "-screen", "0", "1400x900x24"], stdout=subprocess.PIPE)
    assert screen.stdout is not None
    try:
        monkeypatch.setenv("DISPLAY", f":{int(screen.stdout.readline())}")
        with open_viewer("auto", say=said.append) as viewer:
            assert viewer.kind == "native"
            assert isinstance(viewer, ServedViewer)
            sink = viewer.recording("window")
            monitor = Monitor(observer=sink.observe)
            told = monitor.feed_recording(flown)
            sink.events(told)
            raised = next(event for event in told if isinstance(event, AlarmRaised))
            assert sink.finish(raised)
            assert raised.boot_s is not None
            at_ns = round(raised.boot_s * 1e9)
            window = viewer._window
            assert window is not None
            seen = Headless(window._port, window.process)
            eventually(lambda: seen.client.get_state().recordings[0].current_time == at_ns)
            os.killpg(window.process.pid, signal.SIGKILL)
            eventually(lambda: len(said) == 2)
            assert "failure" in said[1]
    finally:
        screen.terminate()
        screen.wait()
        screen.stdout.close()


def still(rpy_deg: tuple[float, float, float], from_s: int, seconds: int) -> list[tuple[int, bytes]]:
    """A vehicle that holds an attitude, by both messages."""
    turned = Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True)
    records = []
    for i in range(25 * seconds):
        ms = 1000 * from_s + 40 * i
        now_us = wire.START_US + 1000 * ms
        records += [
            (now_us, wire.attitude(ms, np.radians(rpy_deg))),
            (now_us, wire.attitude_quaternion(ms, wire.wxyz(turned))),
        ]
    return records


@pytest.mark.slow
@pytest.mark.sweep
@can_draw
@has_browser
def test_the_page_shows_the_attitudes_in_a_browser_and_asks_no_other_machine() -> None:
    """In real Chromium the axes of a body point where a camera sees them, and elsewhere once it has turned.

    Nothing that the page asks for would leave this machine: what the browser refuses by itself never comes so far.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="pip install playwright (no browser of its own)")
    said: list[str] = []
    strangers: list[str] = []
    flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    flags += ["--js-flags=--no-wasm-tier-up --no-wasm-dynamic-tiering"]  # for some seconds, compiled quickly is enough
    with open_viewer("web", say=said.append, live=True) as viewer:
        sink = viewer.recording("page")
        assert isinstance(sink, RerunSink)
        monitor = Monitor(observer=sink.observe)
        only_bodies = rrb.Blueprint(
            bodies_view([VehicleId(None, 1, 1)]),
            rrb.TimePanel(timeline="utc", play_state="following", state="collapsed"),
            collapse_panels=True,
        )
        (address,) = [word for word in said[0].split() if word.startswith("http")]
        with playwright.sync_playwright() as tool:
            browser = tool.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
            page = browser.new_page(viewport={"width": 640, "height": 480})

            def route(request: Any) -> None:
                if request.request.url.startswith(("http://127.0.0.1:", "blob:", "data:")):
                    request.continue_()
                else:
                    strangers.append(request.request.url)
                    request.abort()

            page.route("**/*", route)
            page.goto(f"{address}&renderer=webgl&theme=dark&persist=0")
            for from_s, rpy_deg in ((1, (20.0, -15.0, 130.0)), (3, (15.0, 10.0, -100.0))):
                feed(monitor, sink, still(rpy_deg, from_s, 2))
                sink._world.recording.send_blueprint(only_bodies)  # the plots would take most of the time
                expected = expected_deg(Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True))

                def points_there(expected: list[float] = expected) -> bool:
                    png = page.screenshot(timeout=120_000)
                    apart = np.subtract(seen_deg(pixels(png)), expected)
                    assert np.abs((apart + 180) % 360 - 180).max() < 5, apart
                    return True

                eventually(points_there, 180)
            browser.close()
    assert strangers == []


def serving(memory: str | None = None) -> ServedViewer:
    viewer = open_viewer("web", say=lambda _: None, live=True, server_memory_limit=memory)
    assert isinstance(viewer, ServedViewer)
    return viewer


def pixels(png: bytes) -> NDArray[np.int64]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(np.int64)


def about(picture: NDArray[np.int64], colour: tuple[int, int, int], *, within: int) -> NDArray[np.bool_]:
    """Which pixels are near a colour."""
    near: NDArray[np.bool_] = np.abs(picture - np.array(colour)).max(axis=2) <= within
    return near


def resident_bytes() -> int:
    with Path("/proc/self/statm").open() as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGESIZE")
