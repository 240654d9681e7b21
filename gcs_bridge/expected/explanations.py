"""The report's `explained_by`: what turned samples by more than shows, by which numbers, and where these are from.

A fit that is refined, or a value that is told after it was fitted, is one explanation; another value is another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_bridge.contract import ExplainedBy
from gcs_bridge.expected.correction import (
    CAUSE_NAMES,
    VTOL_VIEW,
    Correction,
)
from gcs_bridge.expected.view import View

EFFECT_RAD = math.radians(0.02)  # what the bound of a same-instant pair swallows needs no explanation
_SAME_VALUE_RAD = math.radians(0.3)  # a fit that moves by less was refined


@dataclass
class _Explanation:
    """A cause with its numbers, in the view in which it turned samples."""

    cause: int
    values_rad: tuple[float, ...]
    fitted: bool
    view: View
    fit: int  # of the view


class Explanations:
    """Of one vehicle, in order of time."""

    def __init__(self) -> None:
        """Start with nothing explained."""
        self._all: list[_Explanation] = []

    def __bool__(self) -> bool:
        """Whether anything was undone that shows."""
        return bool(self._all)

    def has(self, cause: int) -> bool:
        """Whether one of them is this cause."""
        return any(one.cause == cause for one in self._all)

    def explain(self, cause: int, values_rad: tuple[float, ...], view: View, *, fitted: bool) -> None:
        """A cause with these numbers turned samples in a view; the same one, better known, takes its place."""
        new = _Explanation(cause, values_rad, fitted, view, view.fit)
        latest = max((at for at, one in enumerate(self._all) if one.cause == cause), default=None)
        if latest is not None:
            before = self._all[latest]
            moved = max(abs(a - b) for a, b in zip(before.values_rad, values_rad, strict=True))
            refined = before.view is view and before.fit == view.fit and before.fitted
            if moved == 0.0 or refined or (before.fitted and moved <= _SAME_VALUE_RAD):  # the same, better known
                self._all[latest] = new
                return
        self._all.append(new)

    def forget(self, view: View, given_up: int, dropped: Correction) -> None:
        """Those that were fitted are none any more where a view gave up their causes, or dropped their correction."""
        values = dropped.values()
        self._all = [
            one
            for one in self._all
            if not (one.fitted and one.cause & given_up)
            and not (one.view is view and values.get(one.cause) == one.values_rad)
        ]

    def entries(self, *, on_wings: bool) -> list[ExplainedBy]:
        """The report's `explained_by`; `on_wings`: the vehicle was felt to be as ATTITUDE says in forward flight."""
        return [_entry(one, on_wings=on_wings) for one in self._all]


def _entry(one: _Explanation, *, on_wings: bool) -> ExplainedBy:
    values_deg = tuple(round(float(math.degrees(value)), 4) for value in one.values_rad)
    alternatives: list[str] = []
    if one.fitted and one.view.correction.values().get(one.cause) == one.values_rad:
        alternatives = one.view.alternatives()
        if one.cause == VTOL_VIEW and not one.view.fitted:  # felt
            alternatives = [] if on_wings else ["mount_offset"]
    return ExplainedBy(
        cause=CAUSE_NAMES[one.cause],
        value=values_deg if len(values_deg) > 1 else values_deg[0],
        unit="deg",
        estimated=one.fitted,
        alternatives=tuple(alternatives),
    )
