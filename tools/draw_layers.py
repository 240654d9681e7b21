"""Draws docs/layers.svg: the layers of the import contract, what each package is and imports, the way of the data.

python tools/draw_layers.py           # writes the picture; a second run changes nothing
python tools/draw_layers.py --check   # exit 1 if the picture is not what would be written

The layers and what may do no I/O come from pyproject.toml, the words from the first sentence of each docstring, the
imports from the code. Only the way of the data is told here.
"""

from __future__ import annotations

import ast
import math
import re
import sys
import textwrap
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "layers.svg"
PACKAGE = "gcs_bridge"

WAY = (
    ("bytes", ("links", "recordings")),
    ("frames", ("mavlink",)),
    ("samples", ("telemetry",)),
    ("expected differences undone", ("expected",)),
    ("pairs at one instant", ("pairing",)),
    ("residuals, rated", ("checks",)),
    ("alarms", ("alarms",)),
    ("the mistake behind them", ("diagnosis",)),
    ("events", ("judging",)),
    ("report", ("report",)),
    ("written and shown", ("sinks", "viewer", "evidence", "exporting", "pages")),
    ("passed on", ("sending", "metrics")),
)
"""What is handed on, in order, and the packages that make it."""

LEGEND = (
    ("quiet", "no socket, file, thread or clock inside, by contract"),
    ("box", "may do input and output, or only holds facts"),
)

# All lengths in pixels of the picture.
MARGIN, GAP = 24, 6
LAYERS_LEFT, LAYERS_WIDTH = 60, 690
WAY_LEFT, WAY_WIDTH = 786, 272
WIDTH = WAY_LEFT + WAY_WIDTH + MARGIN
TOP = 74
PADDING = 12
ROW = 4  # boxes at most, side by side
NAME_WIDTH, NUMBER_WIDTH, NAME_HEIGHT = 112, 30, 21
LINE_HEIGHT, SMALL_LINE_HEIGHT = 16, 14
STATION_HEIGHT, STATION_GAP = 42, 22
LETTER, SMALL_LETTER = 6.5, 5.6  # generous: the reader's font is not known

STYLE = """
  svg { --page: #ffffff; --ink: #1f2328; --soft: #59636e; --line: #c4ccd4; --quiet: #eef6f1; --quiet-line: #7fb596;
        --rim: #f6f8fa; --mark: #1f6feb; --on-mark: #ffffff; }
  @media (prefers-color-scheme: dark) {
    svg { --page: #0d1117; --ink: #e6edf3; --soft: #9aa4af; --line: #3d444d; --quiet: #12261e; --quiet-line: #2f6f4f;
          --rim: #161b22; --mark: #4493f8; --on-mark: #0d1117; }
  }
  text { font-family: system-ui, -apple-system, "Segoe UI", Helvetica, Arial, sans-serif; font-size: 12px;
         fill: var(--ink); }
  .page { fill: var(--page); }
  .box { fill: var(--rim); stroke: var(--line); }
  .quiet { fill: var(--quiet); stroke: var(--quiet-line); }
  .name { font-family: ui-monospace, SFMono-Regular, Menlo, Consolas, monospace; font-size: 14px; font-weight: 600; }
  .small { font-size: 10.5px; fill: var(--soft); }
  .title { font-size: 15px; font-weight: 600; }
  .arrow { stroke: var(--soft); stroke-width: 1.5; fill: none; }
  .head { fill: var(--soft); }
  .mark { fill: var(--mark); }
  .number { font-size: 11px; font-weight: 700; fill: var(--on-mark); text-anchor: middle; }
"""


@dataclass(frozen=True, kw_only=True)
class Room:
    """A package or module of the contract."""

    name: str
    does: str
    imports: tuple[str, ...]
    is_package: bool
    is_quiet: bool
    """No I/O and no clock inside, by contract."""

    def lines(self, width: float) -> tuple[list[str], list[str]]:
        """What it does and what it imports, broken for a box of that width in pixels."""
        inner = width - 2 * PADDING - (NAME_WIDTH + NUMBER_WIDTH if is_wide(width) else 0)
        imports = f"imports {', '.join(self.imports)}" if self.imports else ""
        return (
            textwrap.wrap(self.does, int(inner / LETTER), break_long_words=False),
            textwrap.wrap(imports, int(inner / SMALL_LETTER), break_long_words=False),
        )

    def height(self, width: float) -> int:
        """In pixels, of a box of that width."""
        does, imports = self.lines(width)
        name = 0 if is_wide(width) else NAME_HEIGHT
        return 2 * PADDING - 4 + name + LINE_HEIGHT * len(does) + SMALL_LINE_HEIGHT * len(imports)


def is_wide(width: float) -> bool:
    """Whether a box of that width has its name beside its text and not above it."""
    return width > LAYERS_WIDTH / 2


def first_sentence(docstring: str) -> str:
    """The docstring's beginning up to its first full stop, without it and without marks of code.

    >>> first_sentence("Links, e.g. by UDP:\\n   read by us. Never written to.")
    'Links, e.g. by UDP: read by us'
    """
    return re.split(r"\.(?:\s+(?=[A-Z`])|$)", " ".join(docstring.split()), maxsplit=1)[0].replace("`", "")


def source_of(name: str) -> Path:
    """The file that holds the docstring of a package or module of ours."""
    package = ROOT / PACKAGE / name / "__init__.py"
    return package if package.exists() else ROOT / PACKAGE / f"{name}.py"


def contracts() -> dict[str, dict[str, list[str]]]:
    """The import contracts of pyproject.toml by their ids."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return {contract["id"]: contract for contract in settings["tool"]["importlinter"]["contracts"]}


@cache
def rooms_by_layer() -> list[list[Room]]:
    """The layers from the top down, each with its packages and modules that exist."""
    rules = contracts()
    layers = [
        [name for name in re.findall(r"\w+", layer) if source_of(name).exists()] for layer in rules["layers"]["layers"]
    ]
    quiet = {name.removeprefix(f"{PACKAGE}.") for name in rules["no-io"]["source_modules"]}
    packages = [name for layer in layers for name in layer if source_of(name).name == "__init__.py"]
    graph = grimp.build_graph(PACKAGE, cache_dir=None)
    for name in packages:
        graph.squash_module(f"{PACKAGE}.{name}")

    def room(name: str) -> Room:
        found = graph.find_modules_directly_imported_by(f"{PACKAGE}.{name}")
        docstring = ast.get_docstring(ast.parse(source_of(name).read_text(encoding="utf-8")))
        return Room(
            name=name,
            does=first_sentence(docstring or ""),
            imports=tuple(other for other in packages if other != name and f"{PACKAGE}.{other}" in found),
            is_package=name in packages,
            is_quiet=name in quiet,
        )

    return [[room(name) for name in layer] for layer in layers if layer]


def text(x: float, y: float, words: str, style: str = "") -> str:
    """One line of text, its base line at y."""
    kind = f' class="{style}"' if style else ""
    return f'<text x="{x:g}" y="{y:g}"{kind}>{escape(words, quote=False)}</text>'


def box(x: float, y: float, width: float, height: float, style: str) -> str:
    """A rectangle with round corners."""
    corner = min(6, height / 4)
    return f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="{corner:g}" class="{style}"/>'


def number(x: float, y: float, value: int) -> Iterator[str]:
    """A number on a disc about a point: a station of the way of the data."""
    yield f'<circle cx="{x:g}" cy="{y:g}" r="9.5" class="mark"/>'
    yield text(x, y + 4, str(value), "number")


def arrow(x: float, top: float, bottom: float) -> Iterator[str]:
    """An arrow downwards."""
    yield f'<path d="M{x:g} {top:g}V{bottom - 6:g}" class="arrow"/>'
    yield f'<path d="M{x - 4:g} {bottom - 7:g}h8l-4 7z" class="head"/>'


def draw_room(room: Room, x: float, y: float, width: float, height: float) -> Iterator[str]:
    """A box: its name, what it does, what it imports, and its numbers on the way of the data."""
    yield box(x, y, width, height, "quiet" if room.is_quiet else "box")
    yield text(x + PADDING, y + PADDING + 11, room.name + ("/" if room.is_package else ".py"), "name")
    stations = [value for value, (_, makers) in enumerate(WAY, 1) if room.name in makers]
    for place, value in enumerate(reversed(stations)):
        yield from number(x + width - PADDING - 8 - 23 * place, y + PADDING + 7, value)
    does, imports = room.lines(width)
    left = x + PADDING + (NAME_WIDTH if is_wide(width) else 0)
    below = y + PADDING - 5 + (0 if is_wide(width) else NAME_HEIGHT)
    for line in does:
        below += LINE_HEIGHT
        yield text(left, below, line)
    for line in imports:
        below += SMALL_LINE_HEIGHT
        yield text(left, below + 2, line, "small")


def draw_layers(layers: Iterable[list[Room]]) -> tuple[list[str], float]:
    """All rows, and where the last one ends."""
    drawn: list[str] = []
    y: float = TOP
    for layer in layers:
        for row in rows_of(layer):
            width = (LAYERS_WIDTH - GAP * (len(row) - 1)) / len(row)
            height = max(room.height(width) for room in row)
            for place, room in enumerate(row):
                drawn += draw_room(room, LAYERS_LEFT + place * (width + GAP), y, width, height)
            y += height + GAP
        y += GAP
    return drawn, y - 2 * GAP


def rows_of(layer: list[Room]) -> Iterator[list[Room]]:
    """A layer in rows of about equal length."""
    rows = math.ceil(len(layer) / ROW)
    for row in range(rows):
        yield layer[len(layer) * row // rows : len(layer) * (row + 1) // rows]


def draw_way() -> Iterator[str]:
    """What is handed on from package to package, from the top down, and below it what the colours mean."""
    y = TOP
    for value, (what, makers) in enumerate(WAY, 1):
        yield box(WAY_LEFT, y, WAY_WIDTH, STATION_HEIGHT, "box")
        yield from number(WAY_LEFT + 22, y + STATION_HEIGHT / 2, value)
        yield text(WAY_LEFT + 42, y + 18, what)
        yield text(WAY_LEFT + 42, y + 33, ", ".join(makers), "small")
        if value < len(WAY):
            yield from arrow(WAY_LEFT + 22, y + STATION_HEIGHT + 3, y + STATION_HEIGHT + STATION_GAP - 3)
        y += STATION_HEIGHT + STATION_GAP
    y += 24
    yield text(WAY_LEFT, y, "Colours", "title")
    for style, words in LEGEND:
        y += 24
        yield box(WAY_LEFT, y - 10, 14, 12, style)
        for line in textwrap.wrap(words, int((WAY_WIDTH - 24) / LETTER)):
            yield text(WAY_LEFT + 24, y, line)
            y += LINE_HEIGHT
        y -= LINE_HEIGHT


def picture() -> str:
    """The whole picture as SVG."""
    layers = rooms_by_layer()
    strangers = {maker for _, makers in WAY for maker in makers} - {room.name for layer in layers for room in layer}
    if strangers:
        raise SystemExit(f"draw_layers: the way of the data names what no layer has: {', '.join(sorted(strangers))}")
    rows, bottom = draw_layers(layers)
    height = bottom + MARGIN
    size = f'width="{WIDTH:g}" height="{height:g}" viewBox="0 0 {WIDTH:g} {height:g}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img">',
        "<title>The layers of gcs_bridge, and the way of the data through them</title>",
        f"<style>{STYLE}</style>",
        f'<rect width="{WIDTH:g}" height="{height:g}" class="page"/>',
        text(LAYERS_LEFT, 36, "Layers", "title"),
        text(LAYERS_LEFT, 56, "A layer imports only from layers below it. The imports told are those of packages."),
        text(WAY_LEFT, 36, "The way of the data", "title"),
        text(WAY_LEFT, 56, "The numbers stand in the boxes, too."),
        *arrow(MARGIN + 10, TOP, bottom),
        *rows,
        *draw_way(),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def main() -> int:
    """Write the picture, or say whether it is up to date."""
    drawn = picture()
    if sys.argv[1:] == ["--check"]:
        if PICTURE.exists() and PICTURE.read_text(encoding="utf-8") == drawn:
            return 0
        print(f"{PICTURE.relative_to(ROOT)} is not current: python tools/draw_layers.py")
        return 1
    PICTURE.write_text(drawn, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
