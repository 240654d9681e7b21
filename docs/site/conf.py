"""How the documentation site is built, by Sphinx with MyST (Markdown) and furo.

pip install -e '.[docs]'
sphinx-build -W --keep-going -c docs/site . build/site   # open build/site/index.html: as a file, or from any server

The top of the checkout is the source, so each page has one home, where a forge shows it as well, and one set of links
serves both. A link that leads nowhere, or to a heading that is not there, is an error; so is a page that the navigation
(`contents.md`) leaves out. What is built asks no other host for anything, its search included.
"""

from pathlib import Path
from typing import Any

from gcs_bridge import __version__

project = "gcs-bridge"
author = "the authors of gcs-bridge"
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "README"
include_patterns = ["*.md", "docs/*.md", "benchmarks/*.md", "sitl_fixtures/README.md"]
exclude_patterns = [".*", "build", "dist", "docs/site"]
templates_path: list[str] = []

# --- pages: Markdown, its headings named as GitHub names them --------------------------------------------------------

myst_heading_anchors = 4

# --- docstrings: `names` in backquotes, types as they are written ----------------------------------------------------

default_role = "code"
autodoc_member_order = "bysource"
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # numpy's types and Python's own have no page here

# --- what it looks like ----------------------------------------------------------------------------------------------

html_theme = "furo"
html_title = "gcs-bridge"
html_static_path = ["style.css"]
html_css_files = ["style.css"]
html_extra_path = ["index.html"]
html_copy_source = False
highlight_language = "none"
smartquotes = False  # options begin with two hyphens


def setup(app: Any) -> None:
    """The README is the front page, and keeps to itself what only the site needs: the navigation."""
    contents = Path(__file__).with_name("contents.md")

    def with_contents(app: Any, name: str, source: list[str]) -> None:
        if name == root_doc:
            app.env.note_dependency(str(contents))
            source[0] += "\n" + contents.read_text(encoding="utf-8")

    app.connect("source-read", with_contents)
