"""Reads what was drawn, by rerun's own means: its reader of files, and its viewer without a window."""

import ctypes.util
import io
import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_bridge.contract import plain
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.viewer import open_viewer
from tests.helpers.processes import OWN_NUMBER

RERUN = (sys.executable, "-m", "rerun_cli")
QUIET = {**os.environ, "CI": "1", "RUST_LOG": "error"}  # CI: no welcome, and nothing is reported home

# A viewer binds its port some time after it was found free: each process of tests looks among 400 of its own.
_FIRST_PORT = 20_000 + 400 * (OWN_NUMBER % 30)
DATA_PORT, WEB_PORT, WINDOW_PORT, HEADLESS_PORT = range(_FIRST_PORT, _FIRST_PORT + 400, 100)

can_draw = pytest.mark.skipif(
    not (ctypes.util.find_library("vulkan") and any(Path("/usr/share/vulkan/icd.d").glob("*"))),
    reason="the viewer needs a graphics driver: apt-get install mesa-vulkan-drivers libvulkan1",
)
has_screen = pytest.mark.skipif(not shutil.which("Xvfb"), reason="apt-get install xvfb")
has_browser = pytest.mark.skipif(not shutil.which("chromium"), reason="apt-get install chromium")


Picture = NDArray[np.int64]  # height × width × RGB


class Drawn:
    """A .rrd as rerun's own reader sees it."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a file that was never closed has no index, and is said to be old
            reader = RrdReader(path)
            recordings = reader.recordings()
            self.names = [entry.application_id for entry in recordings]
            self.ids = [entry.recording_id for entry in recordings]
            self._chunks = list(reader.stream(store=recordings[0]))

    def rows(self, entity: str, component: str, timeline: str = "boot") -> tuple[NDArray[np.int64], list[Any]]:
        """The times (µs) and values of a component that changes, in order of time."""
        times: list[int] = []
        values: list[Any] = []
        for chunk in self._chunks:
            batch = chunk.to_record_batch()
            if chunk.entity_path == entity and not chunk.is_static and {component, timeline} <= set(batch.schema.names):
                times += batch.column(timeline).cast("int64").to_pylist()
                values += batch.column(component).to_pylist()
        order = np.argsort(times, kind="stable")
        return np.array(times, np.int64)[order] // 1000, [values[row] for row in order]

    def numbers(self, entity: str, component: str, timeline: str = "boot") -> tuple[NDArray[np.int64], Any]:
        """The same, as an array of one value a row."""
        times, values = self.rows(entity, component, timeline)
        return times, np.array([value[0] for value in values])

    def moved(self, entity: str, component: str) -> tuple[NDArray[np.int64], Any]:
        """The same of the frame of `entity`, as a live link's drawing tells those of all entities in one."""
        times, children = self.numbers("/frames", "Transform3D:child_frame")
        _, values = self.numbers("/frames", component)
        mine = children == f"tf#{entity}"
        return times[mine], values[mine]

    def fixed(self, entity: str, component: str) -> list[Any]:
        """The values of a component that never changes, in the order in which they were written."""
        batches = [chunk.to_record_batch() for chunk in self._chunks if chunk.is_static and chunk.entity_path == entity]
        return [
            value for one in batches if component in one.schema.names for value in one.column(component).to_pylist()
        ]

    def static(self) -> set[str]:
        """Entities with a part that never changes."""
        return {chunk.entity_path for chunk in self._chunks if chunk.is_static}

    def entities(self) -> set[str]:
        """All that something is drawn of."""
        return {chunk.entity_path for chunk in self._chunks}

    def timelines(self) -> set[str]:
        return {name for chunk in self._chunks for name in chunk.timeline_names}


def time_panel(path: Path) -> dict[str, Any]:
    """What the layout of a .rrd says of its time: by which timeline, from when to when, whether it plays."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    found: dict[str, Any] = {}
    for chunk in reader.stream(store=reader.blueprints()[-1]):
        if chunk.entity_path == "/time_panel":
            batch = chunk.to_record_batch()
            names = [name for name in batch.schema.names if name.startswith("TimePanelBlueprint:")]
            found |= {name.partition(":")[2]: batch.column(name).to_pylist()[-1][0] for name in names}
    return found


def drawn(data: bytes, path: Path, *, pieces: int = 1) -> tuple[Drawn, list[dict[str, Any]]]:
    """What is drawn of a recording fed in so many pieces, and its events."""
    events: list[dict[str, Any]] = []
    with open_viewer(f"save:{path}", say=pytest.fail) as viewer:
        sink = viewer.recording("by hand")
        monitor = Monitor(observer=sink.observe)
        for cut in np.array_split(np.frombuffer(data, np.uint8), pieces):
            told = monitor.feed_recording(cut.tobytes())
            sink.events(told)
            events += map(plain, told)
        sink.events(monitor.finish())
        sink.finish()
    return Drawn(path), events


def verify(path: Path) -> None:
    """`rerun rrd verify` finds nothing wrong."""
    command = [*RERUN, "rrd", "verify", str(path)]
    done = subprocess.run(command, env=QUIET, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


def eventually(what: Callable[[], Any], seconds: float = 60.0) -> Any:
    """The first true answer; what fails until then is tried again. So long as a busy machine may need."""
    ends_s = time.monotonic() + seconds
    last: BaseException | None = None
    while time.monotonic() < ends_s:
        try:
            if found := what():
                return found
        except Exception as error:  # noqa: BLE001  # the last one is told
            last = error
        time.sleep(0.1)
    raise AssertionError(f"not within {seconds:g} s; last: {last!r}")


class Headless:
    """A native viewer without a window, asked by the means that rerun gives for it."""

    def __init__(self, port: int, process: "subprocess.Popen[bytes]") -> None:
        from rerun.experimental import ViewerClient

        self.process = process
        self.client = eventually(lambda: self._answering(ViewerClient, port))

    @staticmethod
    def _answering(client: Any, port: int) -> Any:
        found = client.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        found.get_state()
        return found

    @staticmethod
    def _answer(ask: Callable[[], Any]) -> Any:
        """What it answers, asked again while it does not: on a busy machine a call may find no viewer in time."""
        return eventually(lambda: (ask(),))[0]

    def state(self) -> Any:
        return self._answer(self.client.get_state)

    def wait_for(self, timeline: str, time_us: int) -> Any:
        """The recording that reaches so far; waits until it is loaded."""

        def loaded() -> Any:
            state = self.client.get_state()
            for recording in state.recordings:
                for line in recording.timelines:
                    if line.name == timeline and line.end is not None and line.end // 1000 >= time_us:
                        return recording
            return None

        return eventually(loaded)

    def go_to(self, time_us: int, timeline: str = "boot") -> None:
        """Put the cursor to the time of a sample."""
        at = np.timedelta64(time_us, "us")
        self._answer(lambda: self.client.set_time(timeline, duration=at, play_state="paused"))
        self._at_ns = time_us * 1000

    def edge(self, entity: str) -> dict[str, Any]:
        """How the viewer places `entity` in its parent, at the cursor."""
        graph = self._answer(lambda: self.client.get_transform_graph(include_transforms=True))
        (found,) = [edge for edge in graph["edges"] if edge["child"] == f"tf#{entity}"]
        return dict(found)

    def matrix(self, entity: str) -> NDArray[np.float64]:
        """The rotation that takes components in `entity` to components in its parent."""

        def of_the_cursor() -> Any:
            edge = self.edge(entity)
            return edge["sample_time"].get("value") == str(self._at_ns) and edge["source"]["parent_from_child"]

        return np.array(eventually(of_the_cursor))[:3, :3]

    def views(self) -> list[str]:
        """The classes of its views, sorted."""
        return sorted(view.view_class for view in self.state().views)

    def shows(self, what: Callable[[Picture], object], only: str | None = None) -> None:
        """Wait for a screenshot, of the view of one class if asked, of which `what` asserts nothing in vain."""
        from PIL import Image

        def shown() -> bool:
            chosen = [view.view_id for view in self.client.get_state().views if view.view_class == only]
            png = self.client.take_screenshot(*chosen)
            what(np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(np.int64))
            return True

        eventually(shown)

    def errors(self) -> list[Any]:
        return [report for view in self.state().views for report in view.reports]


@contextmanager
def headless(source: str | Path, port: int, *more: str, size: str = "1400x900") -> Iterator[Headless]:
    """A viewer of a file, or of what is served at an address."""
    arguments = ["--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", size, *more]
    arguments += ["--connect"] if str(source).startswith("rerun+http") else []
    process = subprocess.Popen(
        [*RERUN, *arguments, str(source)],
        env=QUIET,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield Headless(port, process)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
