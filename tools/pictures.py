"""Makes the pictures of docs/pictures.md and the README's animation, of the recordings in sitl_fixtures.

    python tools/pictures.py                  all of them anew, into docs/pictures
    python tools/pictures.py --all FOLDER     each scene in both themes and both sizes, to be looked at

Draws with rerun's own viewer. It needs a graphics driver and, for the light theme, a display without a screen; on a
machine without a graphics card: apt-get install mesa-vulkan-drivers libvulkan1 xvfb. The report's page: chromium
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, chdir, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from gcs_bridge.cli import main as gcs_bridge
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.observation import Observation
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer.processes import free_port
from gcs_bridge.viewer.stretch import Stretch
from gcs_bridge.viewer.trail import Origins, Trail
from gcs_bridge.viewer.trail_views import trail_views

HERE = Path(__file__).resolve().parent.parent
FIXTURES, TARGET = HERE / "sitl_fixtures", HERE / "docs" / "pictures"
SMALL, LARGE = "1280x800", "2560x1440"
MOST_BYTES, MOST_ANIMATION_BYTES = 300_000, 1_500_000
FAULT, FROM_S = "yaw_offset:25", 62.0
_PATIENCE_S = 60.0
_SETTLED_S = 2.5  # for the camera to arrive and the plots to be drawn
_SAVED_S = 150.0  # so long a viewer may take to write its settings: it does so each half minute
_START_US = 8  # the bytes of a record's time


class Scene(NamedTuple):
    """What is shown: a recording, and when: seconds of its boot or, of several clocks, behind its first record.

    `at`: what `replay --at` is given. `trail`: the view of the trail alone.
    """

    recording: Callable[[], bytes]
    seconds: float
    common_clock: bool = False
    at: str | None = None
    trail: bool = False


class Picture(NamedTuple):
    """A picture of the docs."""

    scene: str
    size: str = SMALL
    theme: str = "dark"


def fixture(name: str) -> bytes:
    """A recording."""
    return (FIXTURES / f"{name}.tlog").read_bytes()


def faulty() -> bytes:
    """The square with a quaternion that is turned."""
    return inject(fixture("a_copter_square"), [parse_fault(FAULT)], from_s=FROM_S)


def three_boots() -> bytes:
    """A vehicle that restarts, and once more."""
    records = list(records_of(fixture("f_reboot")))
    gaps = [later[0] - earlier[0] for earlier, later in pairwise(records)]
    again = records[int(np.argmax(gaps)) + 1 :]
    return joined([*records, *moved(again, records[-1][0] + 3_000_000)])


def fleet() -> bytes:
    """Three vehicles of one recording and two of another, at the same time."""
    three = list(records_of(fixture("k5_three_vehicles")))
    two = list(records_of(fixture("e_two_vehicles")))
    return joined(sorted([*three, *moved(two, three[0][0] + 16_000_000)], key=lambda record: record[0]))


Record = tuple[int, bytes]


def records_of(data: bytes) -> Iterator[Record]:
    """Receive time, µs, and frame of each record; MAVLink 2, as in all recordings used here."""
    at = 0
    while at < len(data):
        size = _START_US + 12 + data[at + 9] + 13 * (data[at + 10] & 1)
        yield int.from_bytes(data[at : at + _START_US], "big"), data[at + _START_US : at + size]
        at += size


def moved(records: list[Record], start_us: int) -> list[Record]:
    """The same, from another time on."""
    return [(t_us - records[0][0] + start_us, frame) for t_us, frame in records]


def joined(records: list[Record]) -> bytes:
    """Records as a recording."""
    return b"".join(t_us.to_bytes(_START_US, "big") + frame for t_us, frame in records)


SCENES = {
    "copter": Scene(lambda: fixture("a_copter_square"), 76.4),
    "trail": Scene(lambda: fixture("a_copter_square"), 85.0, trail=True),
    "tailsitter": Scene(lambda: fixture("d_tailsitter"), 101.0),
    "two": Scene(lambda: fixture("e_two_vehicles"), 11.0, common_clock=True),
    "boots": Scene(three_boots, 38.0, common_clock=True),
    "alarm": Scene(faulty, 76.4, at="alarm"),
    "fleet": Scene(fleet, 27.0, common_clock=True),
}
PICTURES = {
    "copter": Picture("copter"),
    "trail": Picture("trail", "900x560"),
    "tailsitter": Picture("tailsitter"),
    "two-vehicles": Picture("two"),
    "three-boots": Picture("boots"),
    "alarm-light": Picture("alarm", theme="light"),
    "fleet-of-five": Picture("fleet", LARGE),
}


def draw(scene: Scene, folder: Path) -> list[Path]:
    """The files that a viewer is to open for a scene."""
    recording, drawn = folder / "flight.tlog", folder / "flight.rrd"
    recording.write_bytes(scene.recording())
    at = [] if scene.at is None else ["--at", scene.at]
    if code := gcs_bridge(["replay", str(recording), "--viewer", f"save:{drawn}", "-q", *at]):
        raise SystemExit(code)
    return [drawn, only_trail(recording, folder / "trail.rbl")] if scene.trail else [drawn]


def only_trail(recording: Path, layout: Path) -> Path:
    """A layout of the trail alone."""
    import rerun.blueprint as rrb

    trails: dict[VehicleId, Trail] = {}
    origins = Origins()

    def follow(observation: Observation) -> None:
        key = observation.vehicle
        list(trails.setdefault(key, Trail(key, len(trails), origins)).feed(Stretch([observation])))

    monitor = Monitor(observer=follow)
    monitor.feed_recording(recording.read_bytes())
    monitor.finish()
    reaches = {key: trail.reach for key, trail in trails.items() if trail.reach is not None}
    world = trail_views(reaches, live=False)[0]
    panels = (rrb.TimePanel(state="collapsed"), rrb.SelectionPanel(state="hidden"), rrb.BlueprintPanel(state="hidden"))
    page = rrb.Blueprint(world, *panels, auto_views=False, auto_layout=False)
    page.save("gcs-bridge-flight-tlog", str(layout))
    return layout


class Viewer:
    """A viewer of files, at a size; a light one needs a display."""

    def __init__(self, files: list[Path], size: str, *more: str, home: Path | None = None, display: str = "") -> None:
        """Start it, and wait until the files are loaded."""
        port = free_port(19_700)
        arguments = ["--bind", "127.0.0.1", "--port", str(port), "--window-size", size, *more, *map(str, files)]
        if not display:
            arguments.insert(0, "--headless")
        environment = {**os.environ, "RUST_LOG": "error", "CI": "1", "DISPLAY": display}
        if home is not None:
            environment["XDG_DATA_HOME"] = str(home)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rerun_cli", *arguments],
            env=environment,
            stdin=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            self._client = self._loaded(f"rerun+http://127.0.0.1:{port}/proxy")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End it."""
        os.killpg(self._process.pid, 9)
        self._process.wait()

    def show(self, scene: Scene, picture: Path, *, seconds: float | None = None, settled_s: float = _SETTLED_S) -> None:
        """Take a picture of a moment."""
        at_us = round((scene.seconds if seconds is None else seconds) * 1e6)
        if scene.common_clock:
            (start_ns,) = {
                line.start
                for one in self._client.get_state().recordings
                for line in one.timelines
                if line.name == "utc" and line.start is not None
            }
            stamp = np.datetime64(int(start_ns) // 1000 + at_us, "us")
            self._client.set_time("utc", timestamp=stamp, play_state="paused")
        else:
            self._client.set_time("boot", duration=np.timedelta64(at_us, "us"), play_state="paused")
        time.sleep(settled_s)
        self._client.save_screenshot(str(picture))

    def play(self) -> None:
        """Let the time go on."""
        (first, *_) = self._client.get_state().recordings
        boot = next(line for line in first.timelines if line.name == "boot")
        start = np.timedelta64(boot.start or 0, "ns")
        self._client.set_time("boot", duration=start, play_state="playing")

    @staticmethod
    def _loaded(address: str) -> ViewerClient:
        ends_s = time.monotonic() + _PATIENCE_S
        while time.monotonic() < ends_s:
            time.sleep(0.2)
            try:
                client = ViewerClient.connect(address)
                state = client.get_state()
            except ConnectionError:  # it has not started yet
                continue
            if any(line.end for recording in state.recordings for line in recording.timelines) and not state.loading:
                return client
        raise SystemExit(f"no viewer within {_PATIENCE_S:g} s: is there a graphics driver?")


@contextmanager
def display() -> Iterator[str]:
    """A display without a screen."""
    with subprocess.Popen(
        ["Xvfb", "-displayfd", "1", "-screen", "0", f"{LARGE}x24"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as screen:
        assert screen.stdout is not None
        try:
            yield f":{screen.stdout.readline().decode().strip()}"
        finally:
            screen.terminate()


def make_light(home: Path, shown: str, files: list[Path]) -> None:
    """Settings of a viewer in which its theme is light; rerun 0.41 takes it from nowhere else, and only whole ones."""
    settings = home / "rerun" / "app.ron"
    viewer = Viewer(files, SMALL, "--persist-state", home=home, display=shown)
    ends_s = time.monotonic() + _SAVED_S
    viewer.play()  # what stands still is not drawn, and what is not drawn is not saved
    while not settings.exists() and time.monotonic() < ends_s:
        time.sleep(1.0)
    viewer.close()
    text = settings.read_text()
    light = "theme_preference:Light,fallback_theme:Light"
    settings.write_text(text.replace("theme_preference:System,fallback_theme:Dark", light))


class Studio:
    """Takes pictures of scenes, each drawn once."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        """Work in a folder; what is opened is closed with the stack."""
        self._stack, self._folder = stack, folder
        self._files: dict[str, list[Path]] = {}
        self._display = ""
        self._home = folder / "home"

    def files(self, name: str) -> list[Path]:
        """What a viewer opens for a scene."""
        if name not in self._files:
            folder = self._folder / name
            folder.mkdir()
            self._files[name] = draw(SCENES[name], folder)
        return self._files[name]

    def take(self, picture: Picture, target: Path) -> None:
        """Take a picture, as WebP: lossless where that is small enough."""
        files, scene = self.files(picture.scene), SCENES[picture.scene]
        if picture.theme == "light":
            if not self._display:
                self._display = self._stack.enter_context(display())
                make_light(self._home, self._display, files)
            viewer = Viewer(files, picture.size, "--persist-state", home=self._home, display=self._display)
        else:
            viewer = Viewer(files, picture.size)
        raw = self._folder / "picture.png"
        try:
            viewer.show(scene, raw)
        finally:
            viewer.close()
        save(Image.open(raw).convert("RGB"), target)

    def animate(self, name: str, seconds: tuple[float, float], target: Path, *, frames: int, frame_ms: int) -> None:
        """A looping picture of a scene, from one time to another."""
        viewer, raw, pictures = Viewer(self.files(name), SMALL), self._folder / "frame.png", []
        try:
            viewer.show(SCENES[name], raw, seconds=seconds[0])  # for the camera to arrive
            for at_s in np.linspace(*seconds, frames):
                viewer.show(SCENES[name], raw, seconds=float(at_s), settled_s=0.5)
                pictures.append(Image.open(raw).convert("RGB").resize((960, 600), Image.Resampling.LANCZOS))
        finally:
            viewer.close()
        durations = [frame_ms] * (frames - 1) + [2500]
        first, *rest = pictures
        first.save(target, save_all=True, append_images=rest, duration=durations, loop=0, quality=62, method=6)
        told(target, MOST_ANIMATION_BYTES)


def report_page(target: Path) -> None:
    """The report as a page, as Chromium shows it: an alarm above, curves below."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, chdir(folder), sync_playwright() as tools:
        flight, page, picture = (Path(folder) / f"flight.{ending}" for ending in ("tlog", "html", "png"))
        flight.write_bytes(faulty())
        gcs_bridge(["check", "-q", flight.name, "--output", page.name])
        browser = tools.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        shown = browser.new_page(viewport={"width": 1280, "height": 1860})
        shown.goto(page.as_uri())
        shown.screenshot(path=picture)
        browser.close()
        save(Image.open(picture), target)


def save(picture: Image.Image, target: Path) -> None:
    """Write a picture with few colours: what is drawn has few."""
    target.parent.mkdir(parents=True, exist_ok=True)
    picture.save(target, quality=82, method=6)
    told(target, MOST_BYTES)


def told(target: Path, most_bytes: int) -> None:
    """Say how large it is; too large is a mistake."""
    size = target.stat().st_size
    sys.stdout.write(f"{target}: {size} bytes\n")
    if size > most_bytes:
        raise SystemExit(f"{target} is too large: {size} bytes")


def main() -> None:
    """Take them all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", type=Path, metavar="FOLDER", help="every scene in both themes and both sizes")
    parser.add_argument("names", nargs="*", help="these alone: demo, report, " + ", ".join(PICTURES))
    options = parser.parse_args()
    with ExitStack() as stack:
        studio = Studio(stack, Path(stack.enter_context(tempfile.TemporaryDirectory())))
        if options.all:
            for name in SCENES:
                for theme in ("dark", "light"):
                    for size in (SMALL, LARGE):
                        studio.take(Picture(name, size, theme), options.all / f"{name}-{theme}-{size}.webp")
            return
        for name, picture in PICTURES.items():
            if not options.names or name in options.names:
                studio.take(picture, TARGET / f"{name}.webp")
        if not options.names or "report" in options.names:
            report_page(TARGET / "report.webp")
        if not options.names or "demo" in options.names:
            studio.animate("alarm", (56.0, 78.0), TARGET / "demo.webp", frames=56, frame_ms=180)


if __name__ == "__main__":
    main()
