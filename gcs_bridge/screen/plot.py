"""A small plot of the disagreement over time: a bar a second, and the limit of that second as a line."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_bridge.screen.canvas import DEGREE, Region, Role
from gcs_bridge.screen.history import Second

__all__ = ["draw_plot", "top_of"]
_TOPS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.5, 10.0)
_BARS, _LIMIT = " ▁▂▃▄▅▆▇█", "┄"
_LABEL = 7  # characters


def top_of(seconds: Sequence[Second | None]) -> float:
    """The value at the upper border: a round one, below which every value fits, and about twice every limit.

    >>> top_of([Second(0.1, 0.52)]), top_of([Second(24.9, 0.6), None]), top_of([])
    (1.0, 30.0, 1.0)
    """
    there = [second for second in seconds if second is not None]
    most = max((max(second.value, 2 * second.limit) for second in there), default=1.0)
    decade = 1e-3
    while 10 * decade < most:
        decade *= 10
    # A limit that grows a little with the rates must not change the scale each second.
    return next((round(decade * top, 6) for top in _TOPS if most <= 1.1 * decade * top), 10 * decade)


def draw_plot(region: Region, seconds: Sequence[Second | None]) -> None:
    """Draw seconds, the latest at the right border; nothing where nothing was compared."""
    height = region.height
    if height < 1 or region.width < _LABEL + 3:
        return
    top = top_of(seconds[-(region.width - _LABEL) :])
    region.put_right(_LABEL - 1, 0, f"{top:g}{DEGREE}", Role.FAINT)
    if height > 1:
        region.put_right(_LABEL - 1, height - 1, f"0{DEGREE}", Role.FAINT)
    columns = region.part(_LABEL, 0, region.width - _LABEL, height)
    shown = seconds[-columns.width :]
    first = columns.width - len(shown)
    for x, second in enumerate(shown, first):
        if second is not None:
            _draw_second(columns, x, second, top)
    there = [second for second in shown if second is not None]
    if there and height > 2:
        row = _row_of(there[-1].limit, top, height)
        if 0 < row < height - 1:
            region.put_right(_LABEL - 1, row, "limit", Role.FAINT)


def _row_of(value: float, top: float, height: int) -> int:
    """The row that a value lies in; the first is 0."""
    return height - 1 - min(int(value / top * height), height - 1)


def _draw_second(columns: Region, x: int, second: Second, top: float) -> None:
    height, full = columns.height, len(_BARS) - 1
    parts = min(round(second.value / top * height * full), height * full)  # of a row
    limit_row = _row_of(second.limit, top, height)
    columns.put(x, limit_row, _LIMIT, Role.CAUTION_SEEN)
    role = Role.WARNING_SEEN if second.value > second.limit else Role.GOOD
    for row in range(height):
        part = parts - (height - 1 - row) * full
        if part > 0:
            columns.put(x, row, _BARS[min(part, full)], role)
