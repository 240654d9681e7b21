"""A grid of characters, each with the role that it plays; what does not fit is cut off, so that any size will do.

It is drawn in the signs of Unicode; `paint` finds others for a terminal that has none of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from rich.cells import cell_len

from gcs_bridge.errors import one_line

__all__ = ["CHOSEN", "DEGREE", "OMITTED", "Canvas", "Region", "Role", "one_cell"]

CHOSEN, DEGREE, OMITTED = "›", "°", "…"


class Role(IntEnum):
    """What a character is for; `paint` decides how that looks."""

    PLAIN = 0
    FAINT = 1
    STRONG = 2
    TITLE = 3
    WARNING = 4
    CAUTION = 5
    ADVISORY = 6
    WARNING_SEEN = 7  # acknowledged
    CAUTION_SEEN = 8
    GOOD = 9
    SKY = 10
    GROUND = 11
    EDGE = 12  # between the two: the character is of the ground, what is behind it of the sky
    EDGE_UPSIDE_DOWN = 13  # the other way round
    CRAFT = 14  # the vehicle itself, before sky or ground


def one_cell(text: str) -> str:
    r"""The text as one line of signs that take one place each; all others are spelled out.

    >>> one_cell("a\x1b[2J 航 e\u0301")
    'a\\x1b[2J \\u822a e\\u0301'
    """
    return "".join(c if cell_len(c) == 1 else c.encode("unicode_escape").decode() for c in one_line(text))


class Canvas:
    """`height` rows of `width` characters, and the role of each."""

    def __init__(self, width: int, height: int) -> None:
        """Start blank."""
        self.width, self.height = width, height
        self.signs = [[" "] * width for _ in range(height)]
        self.roles = [[Role.PLAIN] * width for _ in range(height)]

    @property
    def whole(self) -> Region:
        """All of it."""
        return Region(self, 0, 0, self.width, self.height)

    def text(self) -> str:
        """What is written on it, a line a row, with nothing of how it looks."""
        return "\n".join("".join(row).rstrip() for row in self.signs)


@dataclass(frozen=True)
class Region:
    """A part of a canvas with places of its own: (0, 0) is its upper left; nothing is drawn beyond its borders."""

    canvas: Canvas
    left: int
    top: int
    width: int
    height: int

    def part(self, x: int, y: int, width: int, height: int) -> Region:
        """A part of it, as much of that as lies within."""
        x, y = min(max(x, 0), self.width), min(max(y, 0), self.height)
        width, height = max(min(width, self.width - x), 0), max(min(height, self.height - y), 0)
        return Region(self.canvas, self.left + x, self.top + y, width, height)

    def put(self, x: int, y: int, text: str, role: Role = Role.PLAIN) -> int:
        """Write a text whose characters take one place each; return the place behind it."""
        end = x + len(text)
        if 0 <= y < self.height:
            first, last = max(x, 0), min(end, self.width)
            if first < last:
                row, begin, stop = self.top + y, self.left + first, self.left + last
                self.canvas.signs[row][begin:stop] = text[first - x : last - x]
                self.canvas.roles[row][begin:stop] = [role] * (stop - begin)
        return end

    def put_cut(self, x: int, y: int, text: str, role: Role = Role.PLAIN) -> int:
        """The same of a text that shows where it was cut off, if it was."""
        room = self.width - x
        return self.put(x, y, text if len(text) <= room else text[: max(room - 1, 0)] + OMITTED, role)

    def put_right(self, end: int, y: int, text: str, role: Role = Role.PLAIN) -> None:
        """Write a text that ends before the place `end`."""
        self.put(end - len(text), y, text, role)

    def paint(self, x: int, y: int, width: int, role: Role) -> None:
        """Give a part of a row another role; the characters stay."""
        part = self.part(x, y, width, 1)
        if part.height:
            self.canvas.roles[part.top][part.left : part.left + part.width] = [role] * part.width
