"""What is sent to a terminal: what it then shows, and that it is no more than differs."""

import random
import re

import pytest

from gcs_bridge.screen.canvas import Canvas, Role, one_cell
from gcs_bridge.screen.paint import Painter
from tests.helpers.seen_now import alarmed, drawn, scene, vehicle


class Paper:
    """A terminal that knows what is needed here: to go to a place, to blank all, and to write."""

    def __init__(self, width: int, height: int) -> None:
        self._rows = [[" "] * width for _ in range(height)]
        self._x = self._y = 0

    def take(self, data: bytes) -> None:
        for code, final, sign in re.findall(r"\x1b\[([0-9;]*)([A-Za-z])|([^\x1b])", data.decode()):
            if final == "H":
                self._y, self._x = (int(part) - 1 for part in code.split(";"))
            elif final == "J":
                self._rows = [[" "] * len(row) for row in self._rows]
            elif sign:
                self._rows[self._y][self._x] = sign
                self._x += 1
            else:
                assert final == "m"

    def text(self) -> str:
        return "\n".join("".join(row).rstrip() for row in self._rows)


def painter(colours: str | None = "256", encoding: str = "utf-8") -> Painter:
    return Painter(colours=colours, encoding=encoding)


def test_the_terminal_shows_what_was_drawn() -> None:
    """Picture upon picture, each sent as what differs from the one before."""
    chance, paper, paints = random.Random(3), Paper(80, 24), painter()
    for _ in range(30):
        of = scene([vehicle(1, (chance.uniform(-60, 60), chance.uniform(-30, 30), 5.0)), alarmed(2)])
        canvas = drawn(of)
        paper.take(paints.paint(canvas))
        assert paper.text() == canvas.text()


def test_what_stays_is_not_sent() -> None:
    """The same picture costs nothing, another number few bytes: a slow line must do."""
    paints = painter()
    first = len(paints.paint(drawn(scene([vehicle()]))))
    assert paints.paint(drawn(scene([vehicle()]))) == b""
    assert len(paints.paint(drawn(scene([vehicle(rpy_deg=(0.0, 0.0, 0.5))])))) < first / 10
    paints.forget()
    assert len(paints.paint(drawn(scene([vehicle()])))) == first


def test_another_size_is_painted_whole() -> None:
    """Nothing is left of what the terminal made of it."""
    paints, paper = painter(), Paper(120, 40)
    paints.paint(drawn(scene([vehicle()])))
    canvas = drawn(scene([vehicle()]), 120, 40)
    paper.take(paints.paint(canvas))
    assert paper.text() == canvas.text()


@pytest.mark.parametrize("colours", ["standard", "256", "truecolor", None])
def test_colours_only_where_they_are_wanted(colours: str | None) -> None:
    """Red and amber for what is new; without colours attributes and words alone (https://no-color.org)."""
    sent = painter(colours).paint(drawn(scene([alarmed(1), alarmed(2, severity="warning")]))).decode()
    codes = {number for code in re.findall(r"\x1b\[([0-9;]*)m", sent) for number in code.split(";") if number}
    if colours is None:
        assert codes <= {"0", "1", "2", "7"}  # bold, dim, reverse
        assert "7" in codes
    else:
        assert {"41", "43"} <= codes  # red and yellow behind
    assert "WARNING" in sent
    assert "CAUTION" in sent


def test_a_terminal_without_unicode() -> None:
    """Every sign becomes one of ASCII, in the same place."""
    canvas = drawn(scene([alarmed()]))
    sent = painter(None, "ascii").paint(canvas)
    assert sent.isascii()
    paper = Paper(80, 24)
    paper.take(sent)
    assert "! WARNING  1,1" in paper.text()
    assert "apart 25.000  of limit 0.500  ABOVE" in paper.text()  # a degree is no minute
    for drawn_row, shown_row in zip(canvas.text().splitlines(), paper.text().splitlines(), strict=True):
        assert len(drawn_row.rstrip("°")) == len(shown_row)
    assert "?" not in paper.text().replace("? help", "")


def test_text_from_the_air_takes_one_place_a_sign() -> None:
    """Control characters are spelled out, and what is wide or has no width, which would shift the rest of its row."""
    assert one_cell("a\x1b[31m\nb\u202e") == "a\\x1b[31m b\\u202e"
    assert one_cell("航e\u0301🚀") == "\\u822ae\\u0301\\U0001f680"


def test_nothing_is_drawn_outside() -> None:
    """A text is cut at the borders of its part, and its neighbours stay."""
    canvas = Canvas(10, 3)
    part = canvas.whole.part(2, 1, 4, 1)
    part.put(-2, 0, "abcdefghij", Role.STRONG)
    part.put(0, 1, "below")
    part.put(0, -1, "above")
    assert canvas.text() == "\n  cdef\n"
    assert canvas.whole.part(8, 2, 50, 50).width == 2
