"""Estimator resets: one step of the attitude that its rates deny, in every stream that shows it, and then calm again.

Two such steps in a row are no reset but a fault of the stream's kinematics, which is a check's affair.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats, any_true
from gcs_bridge.pairing.steps import Steps
from gcs_bridge.telemetry.link_clock import LinkClock
from gcs_bridge.telemetry.statements import FlagsSet, Statement, TextSaid

_ALIVE_US = 1_000_000  # a stream that came so lately must show the step too
_TEXTS = 8
_TEXT_AGE_US = 10_000_000
_TEXT_WORDS = ("yaw", "ekf", "lane", "ahrs", "estimator", "mag", "gyro", "attitude", "heading")


class _Step(NamedTuple):
    stream: int
    frame_index: int
    t0_us: int
    t1_us: int
    q0_nb: Floats
    q1_nb: Floats


class Reset(NamedTuple):
    """A reset of the estimator, known at the frame `frame_index`: between `t0_us` and `t1_us` of boot time.

    `tilt_rad`, `heading_rad` of the new attitude seen from the old one.
    """

    frame_index: int
    t0_us: int
    t1_us: int
    tilt_rad: float
    heading_rad: float


class Resets:
    """Finds resets in the steps of both streams, within one boot."""

    def __init__(self) -> None:
        """Start before the first step."""
        self._last_denied = [False, False]
        self._open: list[_Step | None] = [None, None]  # a lone denied step, until the next step shows that it was one
        self._alone: list[_Step | None] = [None, None]  # one that waits for the other stream's
        self._heard_us = [-_ALIVE_US, -_ALIVE_US]

    def take(self, steps: tuple[Steps, Steps]) -> list[Reset]:
        """Follow the next steps; return the resets that they complete."""
        if not (len(steps[0]) or len(steps[1])):
            return []
        events: list[tuple[int, int, int]] = []  # frame_index, stream, row: of steps at which something may happen
        for k in (0, 1):
            if not (any_true(steps[k].contradicts_rates) or self._last_denied[k] or self._open[k] is not None):
                continue
            denied = steps[k].contradicts_rates
            near = denied.copy()
            near[1:] |= denied[:-1]
            if len(near):
                near[0] |= self._last_denied[k] or self._open[k] is not None
            events += [(int(steps[k].frame_index[row]), k, row) for row in np.flatnonzero(near).tolist()]
        found: list[tuple[int, _Step]] = []  # and the frame with which it was
        for frame_index, k, row in sorted(events):
            step = self._step(k, steps[k], row, self._heard(1 - k, steps[1 - k], frame_index))
            if step is not None:
                found.append((frame_index, step))
        for k in (0, 1):
            if len(steps[k]):
                self._heard_us[k] = int(steps[k].t1_us[-1])
                self._last_denied[k] = bool(steps[k].contradicts_rates[-1])
        return _resets(found)

    def _heard(self, k: int, steps: Steps, frame_index: int) -> int:
        """When stream `k` was last heard, as of a frame."""
        row = int(np.searchsorted(steps.frame_index, frame_index, side="right")) - 1
        return int(steps.t1_us[row]) if row >= 0 else self._heard_us[k]

    def _step(self, k: int, steps: Steps, row: int, other_heard_us: int) -> _Step | None:
        """Follow one step; the one that turns out with it to be a reset."""
        frame_index = int(steps.frame_index[row])
        before = self._last_denied[k] if row == 0 else bool(steps.contradicts_rates[row - 1])
        if steps.contradicts_rates[row]:
            self._open[k] = None
            if not before:
                t0_us, t1_us = int(steps.t0_us[row]), int(steps.t1_us[row])
                self._open[k] = _Step(k, frame_index, t0_us, t1_us, steps.q0_nb[row].copy(), steps.q1_nb[row].copy())
            return None
        step, self._open[k] = self._open[k], None
        if step is None:
            return None
        other, self._alone[1 - k] = self._alone[1 - k], None
        if other is not None and other.t1_us > step.t0_us and step.t1_us > other.t0_us:
            return step
        if step.t1_us - other_heard_us >= _ALIVE_US:
            return step
        self._alone[k] = step
        return None


def _resets(found: list[tuple[int, _Step]]) -> list[Reset]:
    """The steps as resets: how far they went is asked for all of them at once, which takes as long as for one."""
    if not found:
        return []
    before, after = np.stack([step.q0_nb for _, step in found]), np.stack([step.q1_nb for _, step in found])
    tilts, headings = (angles.tolist() for angles in attitude.tilt_heading_between(before, after))
    return [
        Reset(frame_index, step.t0_us, step.t1_us, tilt, heading)
        for (frame_index, step), tilt, heading in zip(found, tilts, headings, strict=True)
    ]


class Statements:
    """What a vehicle said lately that may explain a reset."""

    def __init__(self) -> None:
        """Start with nothing said."""
        self._said: list[tuple[int, int, str]] = []  # frame_index, receive time, text

    def take(self, told: list[Statement], link: LinkClock) -> None:
        """Take the next statements; of those before this batch only the last few are kept."""
        self._said = self._said[-_TEXTS:]
        for say in told:
            if isinstance(say, TextSaid) and any(word in say.text.lower() for word in _TEXT_WORDS):
                self._said.append((say.frame_index, link.at(say.frame_index), say.text))
            elif isinstance(say, FlagsSet):
                self._said.append(
                    (say.frame_index, link.at(say.frame_index), f"{say.what} {say.before} -> {say.value}")
                )

    def before(self, frame_index: int, t_rx_us: int) -> list[str]:
        """The last ones that came with or before a frame, seconds before it at most."""
        known = [said for said in self._said if said[0] <= frame_index][-_TEXTS:]
        return [text for _, said_us, text in known if t_rx_us - said_us <= _TEXT_AGE_US]
