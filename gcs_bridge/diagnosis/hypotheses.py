"""What may be behind a disagreement: mistakes of the causes' table, alone or two at a time, and how they are undone."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from gcs_bridge.attitude import (
    angle_between,
    multiply,
    quaternion_from_rotvec,
    quaternion_from_rpy,
    rpy_from_quaternion,
)
from gcs_bridge.columns import Floats
from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.diagnosis.mistake import Cause, Parameter, Value
from gcs_bridge.expected.correction import Correction

Mistakes = tuple[tuple[str, Value], ...]
Side = Literal["rpy", "quaternion", "time"]


def _with_ahrs_trim(rpy_rad: npt.NDArray[Any], trim_deg: Value) -> Floats:
    """What ArduPilot sends for attitudes that the quaternion has as they are."""
    x, y = np.radians(trim_deg)
    q_nb = multiply(quaternion_of_rpy(rpy_rad), quaternion_from_rotvec((x, y, 0.0)))
    return np.asarray(rpy_from_quaternion(q_nb) - (x, y, 0.0))


def _corrected(rpy_rad: npt.NDArray[Any], correction: Correction) -> Floats:
    """The angles of the attitudes that some angles stand for."""
    return np.asarray(rpy_from_quaternion(correction.undo(rpy_rad)))


PITCH_TRIM = Cause(
    name="pitch_trim",
    message=30,
    acts_on="rpy",
    falsify=lambda rpy, trim_deg: rpy - np.radians([0.0, *trim_deg, 0.0]),
    undo=lambda rpy, trim_deg: rpy + np.radians([0.0, *trim_deg, 0.0]),
    parameter=Parameter(unit="deg", most=15.0),
    fix="For this PTCH_TRIM_DEG must be {value}, which was not told: ask for the parameter.",
    origin="ArduPlane's pitch trim, which ATTITUDE has and the quaternion has not.",
)
AHRS_TRIM = Cause(
    name="ahrs_trim",
    message=30,
    acts_on="rpy",
    falsify=_with_ahrs_trim,
    undo=lambda rpy, trim_deg: _corrected(rpy, Correction(0.0, *np.radians(trim_deg).tolist())),
    parameter=Parameter(unit="deg", count=2, most=10.0),
    fix="For this AHRS_TRIM_X and AHRS_TRIM_Y must be {value}, which was not told: ask for the parameters.",
    origin="ArduPilot's trim of the board: taken off ATTITUDE's angles, and turned out of the quaternion.",
)
VTOL_VIEW = Cause(
    name="vtol_view",
    message=30,
    acts_on="rpy",
    falsify=lambda rpy, view_deg: _corrected(rpy, Correction(view_rad=-math.radians(view_deg[0]))),
    undo=lambda rpy, view_deg: _corrected(rpy, Correction(view_rad=math.radians(view_deg[0]))),
    parameter=Parameter(unit="deg", most=100.0),
    fix="For this the view of the hovering plane must be pitched by {value} (Q_TRIM_PITCH, and 90° on tailsitters), "
    "which was not told: ask for the parameters.",
    origin="ATTITUDE of a plane that hovers, which shows a pitched body; the quaternion does not.",
)
TRIMS = {row.name: row for row in (PITCH_TRIM, AHRS_TRIM, VTOL_VIEW)}
"""Trims and views: no mistakes, so not in the table; but where nobody tells them they look like one, or hide one."""

ROWS = {**CAUSES, **TRIMS}
"""All that a hypothesis may name."""


@dataclass(frozen=True)
class Hypothesis:
    """Mistakes with their values, in the order of undoing; none at all: that both messages are right."""

    mistakes: Mistakes = ()

    @property
    def causes(self) -> tuple[str, ...]:
        """The mistakes' names."""
        return tuple(name for name, _ in self.mistakes)

    @property
    def rows(self) -> tuple[Cause, ...]:
        """The mistakes' rows in the table."""
        return tuple(ROWS[name] for name in self.causes)

    @property
    def name(self) -> str:
        """As a report names it."""
        return "+".join(self.causes)

    @property
    def mistaken(self) -> tuple[str, ...]:
        """The names of what is a mistake: no trims."""
        return tuple(name for name in self.causes if name not in TRIMS)

    @property
    def numbers(self) -> int:
        """How many numbers had to be found for it."""
        return sum(sum(number != 0.0 for number in value) for _, value in self.mistakes)

    @property
    def skew_ms(self) -> float:
        """By how much the quaternion's stamps are late."""
        return sum(value[0] for name, value in self.mistakes if name == "time_skew")

    def and_then(self, name: str, *value: float) -> Hypothesis:
        """This, and `name` undone after it."""
        return Hypothesis((*self.mistakes, (name, value)))

    @property
    def free(self) -> int:
        """How many numbers it has beside a lag."""
        return sum(len(value) for name, value in self.mistakes if name != "time_skew")

    def moved(self, by: Sequence[float]) -> Hypothesis:
        """The same with other numbers: each, but a lag, by so much more."""
        more = iter(by)
        return Hypothesis(
            tuple(
                (name, value if name == "time_skew" else tuple(number + next(more) for number in value))
                for name, value in self.mistakes
            )
        )

    def of(self, side: Side) -> Mistakes:
        """The mistakes of one side alone."""
        return tuple(mine for mine in self.mistakes if ROWS[mine[0]].acts_on == side)

    def undone(self, samples: Floats, side: Side) -> Floats:
        """What was sent on one side → what should have been: angles (n, 3), rad; quaternions (n, 4); times (n,), ms."""
        for row, (_, value) in zip(self.rows, self.mistakes, strict=True):
            if row.acts_on == side:
                assert row.undo is not None
                samples = row.undo(samples, value)
        return samples

    def apply(self, samples: Floats, side: Side) -> Floats:
        """The way back: what should be sent → what is sent."""
        for row, (_, value) in zip(reversed(self.rows), reversed(self.mistakes), strict=True):
            if row.acts_on == side:
                assert row.falsify is not None
                samples = row.falsify(samples, value)
        return samples


NO_MISTAKE = Hypothesis()


def _of(*names: str) -> Hypothesis:
    return Hypothesis(tuple((name, ()) for name in names))


_SINGLE = tuple(
    _of(row.name)
    for row in CAUSES.values()
    if row.undo is not None and row.parameter.count == 0 and row.acts_on != "rates"  # of no attitude
)

SIMPLE = (
    *_SINGLE,
    _of("quaternion_xyzw", "quaternion_conjugate"),
    _of("euler_xyz_order", "quaternion_conjugate"),  # all three signs
    _of("roll_sign", "pitch_sign"),
    _of("roll_sign", "yaw_sign"),  # pitch and yaw together are nwu_flu
)
"""What has no value: the table's rows, and the pairs of them that are made as easily as one."""


@functools.lru_cache(maxsize=512)
def undoing(mistakes: Mistakes) -> Floats:
    """What undoes mistakes of the quaternion, as all of them are linear in it: q_nb = sent @ this (4, 4)."""
    return Hypothesis(mistakes).undone(np.eye(4), "quaternion")


@functools.cache
def doubles() -> tuple[Hypothesis, ...]:
    """Any two mistakes without a value, in either order; what is the same for every motion only once."""
    seen = {_signature(hypothesis) for hypothesis in (NO_MISTAKE, *SIMPLE)}
    found = []
    for hypothesis in _pairs():
        signature = _signature(hypothesis)
        if signature not in seen:
            seen.add(signature)
            found.append(hypothesis)
    return tuple(found)


def _pairs() -> Iterator[Hypothesis]:
    for one in _SINGLE:
        for other in _SINGLE:
            if one is not other:
                yield Hypothesis((*one.mistakes, *other.mistakes))


# Some attitudes in general position: no two mistakes look alike on all of them.
_ATTITUDES_RPY = np.array([(0.37 * i, 0.61 * np.sin(1.7 * i), 0.83 * i * i % 3.0 - 1.5) for i in range(1, 9)])


@functools.lru_cache(maxsize=512)
def _agreeing(hypothesis: Hypothesis) -> Floats:
    """The quaternions (n, 4) that agree with some fixed angles under a hypothesis; asked again for each comparison."""
    return hypothesis.apply(quaternion_of_rpy(hypothesis.undone(_ATTITUDES_RPY, "rpy")), "quaternion")


def _signature(hypothesis: Hypothesis) -> bytes:
    """Equal for hypotheses that are the same for every motion: these quaternions, without their sign."""
    q = _agreeing(hypothesis)
    return (np.round(q[:, :, None] * q[:, None, :], 6) + 0.0).tobytes()


def apart_rad(one: Hypothesis, other: Hypothesis) -> float:
    """How far two hypotheses without a lag are from being the same, in general position, rad."""
    return float(np.max(angle_between(_agreeing(one), _agreeing(other))))


def quaternion_of_rpy(rpy_rad: npt.NDArray[Any]) -> Floats:
    """Roll, pitch, yaw (..., 3), rad → q_nb (..., 4): the plain reading, intrinsic Z-Y-X (M11)."""
    return quaternion_from_rpy(roll_rad=rpy_rad[..., 0], pitch_rad=rpy_rad[..., 1], yaw_rad=rpy_rad[..., 2])
