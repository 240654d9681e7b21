"""The report as a page: what it says, what it cannot be made to do, and what a browser draws of it."""

import base64
import io
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from gcs_bridge.cli import main
from gcs_bridge.pages.curves import BootCurves, Curves
from gcs_bridge.pages.moment import drawn, projected
from gcs_bridge.pages.page import overview, page
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers import wire
from tests.helpers.everyday import one_in
from tests.helpers.paths import FIXTURES
from tests.helpers.report_entries import ALARM, DIAGNOSIS, file, vehicle
from tests.helpers.viewer_tools import has_browser

QUIETLY = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update"]
FLIGHT = (FIXTURES / "c_copter_4hz.tlog").read_bytes()


class Text(HTMLParser):
    """The text of a page, and its elements."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.tags: list[str] = []
        self.feed(re.sub(r"(?s)<(script|style)\b.*?</\1>", "", html))

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.words.append(data.strip())

    def __str__(self) -> str:
        return " ".join(filter(None, self.words))


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a flight with a mistake in it."""
    folder = tmp_path_factory.mktemp("page")
    (folder / "flight.tlog").write_bytes(inject(FLIGHT, [parse_fault("yaw_offset:30")], from_s=15))
    assert main(["check", str(folder / "flight.tlog"), "--output", str(folder / "flight.html"), "-q"]) == 1
    return folder / "flight.html"


@pytest.mark.slow
def test_the_verdict_comes_first_and_each_check_has_its_line(faulty: Path) -> None:
    """Cause, value and what to do; what was not judged, and why."""
    said = str(Text(faulty.read_text()))
    assert said.index("ALARM") < said.index("flight.tlog") < said.index("What was compared")
    assert re.search(r"Cause yaw_offset 30° \(certain\)", said)
    assert "To do" in said
    assert re.search(r"secondary_estimate NO COMPARE – – – AHRS2", said)


def test_it_asks_nobody_and_holds_the_curves(faulty: Path) -> None:
    """No address of another machine; both forms, and the disagreement that the fault makes."""
    html = faulty.read_text()
    assert not re.search(r"(src|href)=", re.sub(r"(?s)<script>.*?</script>", "", html))
    (boot,) = json.loads(re.search(r'id="curves">(.*?)</script>', html)[1])  # type: ignore[index]
    assert [len(boot[name]) for name in ("euler", "quaternion", "pairs")] == [4, 4, 5]
    t_s, angle = boot["pairs"][:2]
    assert max(angle) == pytest.approx(30.0, abs=0.01)
    assert boot["alarms"][0]["severity"] == "alarm"
    assert t_s[0] < boot["alarms"][0]["from"] < t_s[-1]
    yaw = [np.array(boot[name][3]) for name in ("euler", "quaternion")]
    assert np.abs(np.concatenate(yaw)).max() <= 180.0


def test_what_is_no_number_is_a_gap(tmp_path: Path) -> None:
    """An infinite pitch: the browser's JSON knows neither NaN nor Infinity, and would draw nothing at all."""
    flight = [
        (
            10**15 + t,
            wire.attitude(t // 1000, (np.inf if t == 2_500_000 else 0.0, np.inf if t == 2_500_000 else 0.1, 0.2)),
        )
        for t in range(10**6, 10**7, 100_000)
    ]
    flight.insert(0, (10**15, wire.heartbeat()))
    (tmp_path / "a.tlog").write_bytes(wire.tlog(flight))
    main(["check", str(tmp_path / "a.tlog"), "--output", str(tmp_path / "a.html"), "-q"])
    data = re.search(r'id="curves">(.*?)</script>', (tmp_path / "a.html").read_text())[1]  # type: ignore[index]
    (boot,) = json.loads(data, parse_constant=pytest.fail)
    t_s, _, pitch, _ = boot["euler"]
    assert [t for t, value in zip(t_s, pitch, strict=True) if value is None] == [2.5]


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(faulty: Path, tmp_path: Path) -> None:
    """No time of day, no place of a machine but the path that was given."""
    assert main(["check", str(faulty.with_name("flight.tlog")), "--output", str(tmp_path / "again.html"), "-q"]) == 1
    assert (tmp_path / "again.html").read_bytes() == faulty.read_bytes()


def test_text_from_outside_is_text() -> None:
    """Script and markup in names, reasons and what an alarm says; the end of the element that holds the curves."""
    hostile = "</script><script>alert(1)</script><img src=x onerror=alert(2)> \"'&\x1b[2J"
    alarm = {**ALARM, "what": hostile, "is_not": hostile, "diagnosis": {**DIAGNOSIS, "fix": hostile}}
    entry = file(vehicle("alarm", alarms=[alarm], type=hostile), verdict="alarm", path=f"{hostile}.tlog")
    for html in (page(entry, Curves()), overview([entry], ["a.html"], [hostile])):
        tags = Text(html).tags
        assert "img" not in tags
        assert html.count("<script") == (2 if "curves" in html else 0)
        assert "\x1b" not in html
        assert "</script><script>alert(1)</script>" in str(Text(html))


def test_several_recordings_have_an_overview_and_a_page_each(tmp_path: Path) -> None:
    """Two of one name, one that cannot be read: each has its line, and each page leads back."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    for folder in "ab":
        (tmp_path / folder / "flight.tlog").write_bytes(FLIGHT)
    (tmp_path / "noise.tlog").write_bytes(bytes(100))
    names = [str(tmp_path / name) for name in ("a", "b", "noise.tlog")]
    assert main(["check", *names, "--output", str(tmp_path / "all.html"), "-q"]) == 3
    html = (tmp_path / "all.html").read_text()
    links = re.findall(r'href="([^"]+)"', html)
    assert links == ["all-pages/flight.tlog.html", "all-pages/flight.tlog-2.html"]
    for link in links:
        assert 'href="../all.html"' in (tmp_path / link).read_text()
    assert "UNREAD" in html
    assert "noise.tlog" in html


def test_html_needs_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    """One line, 2."""
    assert main(["check", str(FIXTURES / "c_copter_4hz.tlog"), "--format", "html"]) == 2
    assert "--output" in capsys.readouterr().err


def test_the_moment_is_drawn_as_it_was() -> None:
    """Nose north and level: the nose's line ends where north's does. Right wing down: it is lower in the picture."""
    level = drawn(None, np.array([1.0, 0, 0, 0]))
    assert level is not None
    ends = {line.label or line.kind: line.points.split()[-1] for line in level.lines}
    assert ends["nose quaternion"] == ends["N"]
    banked = Rotation.from_euler("x", 40, degrees=True)
    wings = projected(banked.apply([[0.0, 0.8, 0.0], [0.0, -0.8, 0.0]]))
    flat = projected(np.array([[0.0, 0.8, 0.0], [0.0, -0.8, 0.0]]))
    assert wings[0, 1] > flat[0, 1]
    assert wings[1, 1] < flat[1, 1]
    assert drawn(None, np.array([np.nan, 0, 0, 0])) is None


@pytest.mark.slow
@has_browser
@pytest.mark.parametrize(("width", "scheme"), one_in(2, [(390, "light"), (1440, "dark")]))
def test_a_browser_draws_it_and_asks_nobody(faulty: Path, width: int, scheme: Any, tmp_path: Path) -> None:
    """No error of the script, no request but for the page, four plots that are not blank, and no sideways scroll."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=shutil.which("chromium"), args=QUIETLY)
        sheet = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        asked: list[str] = []
        wrong: list[str] = []
        sheet.on("request", lambda request: asked.append(request.url))
        sheet.on("pageerror", lambda error: wrong.append(str(error)))
        sheet.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        sheet.goto(faulty.as_uri())
        inked = sheet.evaluate(
            """() => Array.from(document.querySelectorAll("canvas")).map((canvas) =>
            new Set(new Uint32Array(canvas.getContext("2d")
              .getImageData(0, 0, canvas.width, canvas.height).data.buffer)).size)"""
        )
        scrolls = sheet.evaluate("document.documentElement.scrollWidth > innerWidth")
        browser.close()
    assert wrong == []
    assert asked == [faulty.as_uri()]
    assert len(inked) == 4
    assert min(inked) > 10
    assert not scrolls


@pytest.mark.slow
@has_browser
def test_a_heading_past_south_is_drawn_on_both_sides(tmp_path: Path) -> None:
    """From 155° to −155°: a line at the top for half of the time, one at the bottom for the rest, and none between."""
    from playwright.sync_api import sync_playwright

    curves, yaw_deg = Curves(), np.repeat([155.0, -155.0], 500)
    boot = curves.boots.setdefault((1, 1, 0), BootCurves())
    for form in (boot.euler, boot.quaternion):
        form.take(np.arange(1000) * 20_000, np.column_stack((0 * yaw_deg, 0 * yaw_deg, yaw_deg)))
    sheet = tmp_path / "page.html"
    sheet.write_text(page(file(vehicle("agree"), verdict="agree", path="a.tlog"), curves))
    with sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=shutil.which("chromium"), args=QUIETLY)
        shown = browser.new_page(viewport={"width": 1000, "height": 900}, color_scheme="light")
        shown.goto(sheet.as_uri())
        url = shown.evaluate('document.querySelectorAll("canvas")[2].toDataURL("image/png")')
        browser.close()
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))).astype(np.int64)
    coloured = np.abs(picture[..., 2] - picture[..., 0]) > 40  # blue or orange, as the curves are
    rows, columns = np.nonzero(coloured & (picture[..., 3] > 40))
    top, bottom = rows < len(picture) / 3, rows > len(picture) / 2.2
    assert np.all(top | bottom)
    assert columns[top].max() < columns[bottom].min()
    assert len(np.unique(columns)) > 0.85 * picture.shape[1]
