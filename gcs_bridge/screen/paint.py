"""Makes of a canvas the bytes that bring a terminal from what it shows to what it shall show: no more than differ.

Colours and attributes are rich's work, which knows what the terminal can show.
"""

from __future__ import annotations

from functools import cache

from rich.color import ColorSystem
from rich.style import Style

from gcs_bridge.screen.canvas import Canvas, Role

__all__ = ["Painter"]

# Nothing is told by colour alone: what differs in colour differs in words, signs or attributes too.
_STYLES = {
    Role.PLAIN: "",
    Role.FAINT: "dim",
    Role.STRONG: "bold",
    Role.TITLE: "reverse",
    Role.WARNING: "bold bright_white on red",
    Role.CAUTION: "bold black on yellow",
    Role.ADVISORY: "cyan",
    Role.WARNING_SEEN: "red",
    Role.CAUTION_SEEN: "yellow",
    Role.GOOD: "green",
    Role.SKY: "bright_white on color(25)",
    Role.GROUND: "color(180) on color(94)",
    Role.EDGE: "color(94) on color(25)",
    Role.EDGE_UPSIDE_DOWN: "color(25) on color(94)",
    Role.CRAFT: "bold bright_yellow on black",
}
# Where there are no colours, or none are wanted.
_PLAIN_STYLES = {
    **_STYLES,
    Role.WARNING: "bold reverse",
    Role.CAUTION: "bold reverse",
    Role.EDGE_UPSIDE_DOWN: "reverse",
}
_TO_ASCII = str.maketrans("▁▂▃▄▅▆▇█░━┛┗·─╱╲│┄▲■●›°…←→↑↓⊗×−ωθ", "..::||##:=+++-/\\|-!*o> ~<>^vxx-wo")
_SYSTEMS = {"standard": ColorSystem.STANDARD, "256": ColorSystem.EIGHT_BIT, "truecolor": ColorSystem.TRUECOLOR}


class Painter:
    """Remembers what a terminal shows."""

    def __init__(self, *, colours: str | None, encoding: str) -> None:
        """Paint for a terminal that has these `colours`, by rich's name of their system, None: none or not wanted.

        Signs that are not in its `encoding` are replaced by those of ASCII.
        """
        self._system = _SYSTEMS.get(colours or "")
        self._encoding = encoding
        self._is_unicode = encoding.lower().replace("-", "").startswith("utf")
        self._shown: Canvas | None = None
        self._code = cache(self._codes_of)

    def forget(self) -> None:
        """The terminal shows something else: the next picture is painted whole."""
        self._shown = None

    def paint(self, canvas: Canvas) -> bytes:
        """What to send so that the terminal shows this."""
        shown, self._shown = self._shown, canvas
        whole = shown is None or (shown.width, shown.height) != (canvas.width, canvas.height)
        sent: list[str] = ["\x1b[0m\x1b[2J"] if whole else []
        for y in range(canvas.height):
            signs, roles = canvas.signs[y], canvas.roles[y]
            if whole or shown is None:
                first, last = 0, canvas.width
            elif signs == shown.signs[y] and roles == shown.roles[y]:
                continue
            else:
                before = list(zip(shown.signs[y], shown.roles[y], strict=True))
                first, last = _changed(before, list(zip(signs, roles, strict=True)))
            sent.append(f"\x1b[{y + 1};{first + 1}H{self._row(signs, roles, first, last)}")
        text = "".join(sent)
        return (text if self._is_unicode else text.translate(_TO_ASCII)).encode(self._encoding, "replace")

    def _row(self, signs: list[str], roles: list[Role], first: int, last: int) -> str:
        """A part of a row, each run of one role between its codes."""
        parts = []
        while first < last:
            end = first + 1
            while end < last and roles[end] is roles[first]:
                end += 1
            before, after = self._code(roles[first])
            parts.append(f"{before}{''.join(signs[first:end])}{after}")
            first = end
        return "".join(parts)

    def _codes_of(self, role: Role) -> tuple[str, str]:
        """What to send before and after signs of a role."""
        if self._system is None:
            style = Style.parse(_PLAIN_STYLES[role]).without_color
            rendered = style.render("X", color_system=ColorSystem.STANDARD)
        else:
            rendered = Style.parse(_STYLES[role]).render("X", color_system=self._system)
        before, _, after = rendered.partition("X")
        return before, after


def _changed(before: list[tuple[str, Role]], after: list[tuple[str, Role]]) -> tuple[int, int]:
    """From where to where two rows of one length differ."""
    first, last = 0, len(after)
    while before[first] == after[first]:
        first += 1
    while before[last - 1] == after[last - 1]:
        last -= 1
    return first, last
