"""The pages of the documentation, and what stands in them."""

import re
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/*.md", "benchmarks/*.md", "sitl_fixtures/README.md")
    for path in sorted(ROOT.glob(pattern))
]
"""As `include_patterns` of docs/site/conf.py has them: a test holds the two together."""


class Block(NamedTuple):
    """A block of code: its language ("" where none is named), its text, and the line of the page where that begins."""

    language: str
    text: str
    line: int


class Command(NamedTuple):
    """A command, and what the page shows of what it says: None where it shows nothing."""

    line: str
    shown: str | None


@cache
def _parsed(page: str) -> list[Token]:
    return MarkdownIt("commonmark").enable("table").parse((ROOT / page).read_text(encoding="utf-8"))


@cache
def _code(page: str) -> list[Token]:
    """The page's blocks of code alone: what stands within its lines is not looked at, which takes half of the time."""
    parser = MarkdownIt("commonmark").enable("table").disable("inline")
    tokens = parser.parse((ROOT / page).read_text(encoding="utf-8"))
    return [token for token in tokens if token.type in ("fence", "code_block")]


def blocks(page: str, *languages: str) -> list[Block]:
    """The page's blocks of code in these languages, in all where none is named; what is only indented is a shell's."""
    found = [
        Block(token.info.split(" ")[0] if token.type == "fence" else "sh", token.content, (token.map or [0])[0] + 1)
        for token in _code(page)
    ]
    return [block for block in found if not languages or block.language in languages]


def inline_code(page: str) -> Iterator[str]:
    """What stands in backquotes within the page's prose and tables."""
    for token in _parsed(page):
        yield from (child.content for child in token.children or () if child.type == "code_inline")


def commands(block: Block) -> list[Command]:
    """The commands of a block: of a console what follows each prompt; of a shell each line, or all of it as one."""
    if block.language == "console":
        pieces = re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]
        return [Command(line, shown or None) for line, _, shown in (piece.partition("\n") for piece in pieces)]
    lines = block.text.strip().splitlines()
    if re.search(r"^(for|while|if) |\\$", block.text, re.MULTILINE):
        return [Command(block.text.strip(), None)]
    return [Command(line, None) for line in lines if line and not line.startswith("#")]


def all_commands() -> Iterator[tuple[str, Command]]:
    """Every command of every page, each with its page."""
    for page in PAGES:
        for block in blocks(page, "console", "sh"):
            for one in commands(block):
                yield page, one


def as_shown(shown: str) -> re.Pattern[str]:
    """What the page shows, as a pattern: `…` alone on a line is any lines, and within a line anything."""
    lines = shown.rstrip("\n").split("\n")
    return re.compile(
        "".join(r"(?:.*\n)*" if line == "…" else ".*".join(map(re.escape, line.split("…"))) + "\n" for line in lines)
    )


class Link(NamedTuple):
    """Where a link or a picture within the project leads: a file of the checkout, and a heading of it ("": none)."""

    target: str
    anchor: str


def links(page: str) -> Iterator[Link]:
    """The page's links and pictures that stay within the project."""
    for token in _parsed(page):
        for child in token.children or ():
            written = child.attrs.get("href") if child.type == "link_open" else child.attrs.get("src")
            if written is not None and "://" not in str(written):
                path, _, anchor = str(written).partition("#")
                target = ((ROOT / page).parent / path).resolve() if path else ROOT / page
                yield Link(target.relative_to(ROOT).as_posix(), anchor)


def anchors(page: str) -> set[str]:
    """Of the page's headings, as GitHub and MyST make them."""
    tokens = _parsed(page)
    titles = [
        "".join(child.content for child in inline.children or ())
        for heading, inline in pairwise(tokens)
        if heading.type == "heading_open"
    ]
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}
