"""The documentation site: built strictly, whole, and at home on phones; what a browser asks for stays here."""

import importlib.util
import os
import runpy
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

import pytest

from tests.helpers.paths import ROOT
from tests.helpers.viewer_tools import has_browser
from tools.site_pages import PAGES

pytestmark = [
    pytest.mark.slow,
    pytest.mark.sweep,  # a build of its own: a step of .ci/run
    pytest.mark.skipif(importlib.util.find_spec("furo") is None, reason="needs the extra 'docs'"),
]

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

QUIETLY = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update"]


def built(source: Path, to: Path) -> subprocess.CompletedProcess[str]:
    """The site of a checkout, strictly."""
    line = [
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-c",
        "docs/site",
        "-d",
        str(to / "doctrees"),
        ".",
        str(to / "site"),
    ]
    return subprocess.run(
        [sys.executable, *line],
        cwd=source,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the built pages."""
    folder = tmp_path_factory.mktemp("built")
    ended = built(ROOT, folder)
    assert ended.returncode == 0, ended.stderr
    return folder / "site"


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """A Chromium that shows files."""
    playwright = pytest.importorskip("playwright.sync_api", reason="pip install playwright (no browser of its own)")
    with playwright.sync_playwright() as tools:
        opened = tools.chromium.launch(executable_path=shutil.which("chromium"), args=QUIETLY)
        yield opened
        opened.close()


class Files(SimpleHTTPRequestHandler):
    """Serves a folder, and says nothing of it."""

    def log_message(self, *_args: object) -> None:
        """Keep quiet."""


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """Where the site is served, by this machine to itself."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Files, directory=str(site))) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture
def page(browser: "Browser", address: str, request: pytest.FixtureRequest) -> Iterator["Page"]:
    """A phone's page, or as wide as asked for; nothing on it failed, and nothing was asked of any other place."""
    context = browser.new_context(base_url=address, viewport={"width": getattr(request, "param", 390), "height": 850})
    context.set_default_timeout(120_000)  # a busy machine is no fault of the page's
    opened = context.new_page()
    asked: list[str] = []
    failed: list[str] = []
    opened.on("request", lambda request: asked.append(request.url))
    opened.on("pageerror", lambda error: failed.append(str(error)))
    yield opened
    context.close()
    assert [url for url in asked if not url.startswith((address, "data:"))] == []
    assert failed == []


def test_every_page_is_there_and_no_link_is_broken(site: Path) -> None:
    """Built with warnings as errors: what a page refers to, it finds; and the site has all that the tests look at."""
    for name in PAGES:
        assert (site / name).with_suffix(".html").is_file(), name
    conf = runpy.run_path(str(ROOT / "docs/site/conf.py"))
    named = {path.relative_to(ROOT).as_posix() for one in conf["include_patterns"] for path in ROOT.glob(one)}
    assert named == set(PAGES)


def test_a_broken_link_is_an_error(tmp_path: Path) -> None:
    """A page that is not there, a heading that is not there, a page that no navigation leads to: each is told."""
    shutil.copytree(ROOT / "docs" / "site", tmp_path / "docs" / "site")
    (tmp_path / "docs" / "site" / "contents.md").write_text("")
    (tmp_path / "README.md").write_text("# Here\n\n[there](docs/gone.md), [below](#nowhere), [beside](docs/page.md)\n")
    (tmp_path / "docs" / "page.md").write_text("# Beside\n")
    ended = built(tmp_path, tmp_path)
    assert ended.returncode != 0
    for said in ("docs/gone.md", "nowhere", "page.md: WARNING: document isn't included in any toctree"):
        assert said in ended.stderr


@has_browser
def test_no_page_is_wider_than_a_phone(page: "Page") -> None:
    """At 390 px nothing is scrolled sideways but what has a frame of its own: tables, code, the drawing of layers."""
    for name in PAGES:
        page.goto(name.replace(".md", ".html"))
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
        assert page.evaluate("[...document.images].every(image => image.complete && image.naturalWidth > 0)"), name


@has_browser
@pytest.mark.parametrize("page", [1440], indirect=True)
def test_the_front_page_leads_on_and_the_search_finds(page: "Page") -> None:
    """The first address leads to the README, its links to pages, and a word that is looked for to where it stands."""
    page.goto("index.html")
    page.wait_for_url("**/README.html")
    page.locator("article").get_by_role("link", name="My attitude looks wrong").click()
    page.wait_for_url("**/docs/wrong-attitude.html")
    page.get_by_placeholder("Search").fill("tailsitter")
    page.get_by_placeholder("Search").press("Enter")
    page.locator("#search-results").get_by_role("link", name="My attitude looks wrong").first.wait_for()
