"""When two hypotheses are one mistake, and which of several is the likelier, before any pair is looked at."""

from __future__ import annotations

import numpy as np

from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.diagnosis.hypotheses import SIMPLE, TRIMS, Hypothesis, apart_rad

_NAMED_RAD, NAMED_MS = np.radians(0.2), 2.0  # what is this near to a simpler mistake gets its name


def by_name(hypothesis: Hypothesis) -> Hypothesis:
    """A constant turn that is nearly a mistake without a value is that mistake."""
    if not hypothesis.numbers:
        return hypothesis
    return next((simple for simple in SIMPLE if alike(simple, hypothesis)), hypothesis)


def alike(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are nearly the same for every motion."""
    return abs(one.skew_ms - other.skew_ms) < NAMED_MS and apart_rad(one, other) < _NAMED_RAD


def same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether only one of two hypotheses need be named: they mean the same, and either both or none is a mistake."""
    return bool(one.mistaken) == bool(other.mistaken) and alike(one, other)


def same_mistake(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are nearly the same but for their trims."""
    return alike(*(Hypothesis(tuple(of for of in each.mistakes if of[0] not in TRIMS)) for each in (one, other)))


def covers(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether the first is the second or has it as a special case."""
    same = one.mistaken == other.mistaken or (one.name, other.name) == ("world_offset", "yaw_offset")
    return same or alike(one, other)


_ORDER = {name: place for place, name in enumerate(CAUSES)}


def likeliest(hypothesis: Hypothesis) -> tuple[int, int, list[int]]:
    """Few mistakes before many, few numbers before many, then the table's order: what is often met stands first there.

    A trim is no mistake: alone it comes first.
    """
    return (
        len(hypothesis.mistaken),
        hypothesis.numbers,
        sorted(_ORDER.get(name, len(_ORDER)) for name in hypothesis.causes),
    )
