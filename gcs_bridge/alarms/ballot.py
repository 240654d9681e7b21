"""The alarms of one vehicle within one boot: what of them kernels are given, and what has changed.

How samples become changes stands in `votes`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge.alarms.rated import Rated, Worst
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.state import Change, Signal, State
from gcs_bridge.alarms.votes import (
    ALARM,
    CHANGE,
    DETAIL,
    IS_LOW,
    NEXT,
    NO_SIGNAL,
    SHORT,
    SIGNALS,
    STATES,
    Votes,
    pass_signals,
    vote_all,
)


class AlarmChange(NamedTuple):
    """A change of the alarm at place `alarm` of the specs, with the frame that brought it about."""

    alarm: int
    frame_index: int
    change: Change


SlotNow = tuple[State, int, int, float, float]
"""Where an alarm is, by all samples that it was given: how many came of late (0: none within the boot), and of the
last one time, µs, value and limit. A plain tuple: one is made of each alarm whenever somebody looks."""


class Ballot:
    """The alarms of one vehicle within one boot, by the place of their specs."""

    def __init__(self, specs: Sequence[AlarmSpec]) -> None:
        """Start with every alarm normal."""
        self.specs = tuple(specs)
        self._place = {spec: place for place, spec in enumerate(self.specs)}
        n, recurring = len(self.specs), [spec for spec in self.specs if spec.recurring_window_s]
        most = max((spec.delays.counted_samples for spec in self.specs), default=1)
        self._votes = Votes(
            alarm=np.zeros(n, ALARM),
            recent=np.zeros((n, most, DETAIL + 5)),
            short=np.zeros((len(recurring), SHORT, 3), np.int64),
            signal=_NO_SIGNALS,
            change=np.empty(16, CHANGE),
            changes=np.zeros(1, np.int64),
        )
        alarm = self._votes.alarm
        for name in ("bad_samples", "counted_samples", "clear_below"):
            alarm[name] = [getattr(spec.delays, name) for spec in self.specs]
        for name in ("window", "on_delay", "off_delay"):
            alarm[f"{name}_us"] = [round(getattr(spec.delays, f"{name}_s") * 1e6) for spec in self.specs]
        alarm["recurring_window_us"] = [round(spec.recurring_window_s * 1e6) for spec in self.specs]
        alarm["short_row"] = [recurring.index(spec) if spec.recurring_window_s else -1 for spec in self.specs]
        self._shown = [self._votes.alarm[name] for name in ("state", "samples", "t_us", "value", "limit")]
        self._apart: Ballot | None = None  # the last one
        self._room = -1  # for so many changes at the least; −1: not known
        self._fresh = self._votes.alarm.copy()
        self._fresh["worst"], self._fresh["onset_us"] = -1.0, -1
        self.start_boot()

    def start_boot(self) -> None:
        """Begin anew, with every alarm normal."""
        self._votes.alarm[:] = self._fresh
        self._votes.recent[...] = 0.0
        self._votes.recent[..., IS_LOW] = 1.0
        self._signals: dict[int, list[tuple[int, int]]] = {}  # that kernels do not see yet

    def place_of(self, spec: AlarmSpec) -> int:
        """Where the alarm is; LookupError for one that is none of the vehicle's: it would never raise anything."""
        place = self._place.get(spec)
        if place is None:
            raise LookupError(f"check {spec.check}: its alarm {spec.name!r} is not among its alarm_specs")
        return place

    def signal(self, place: int, signals: Iterable[tuple[int, Signal | None]]) -> None:
        """Take signals, each with its frame, before the samples among which they came; None: tell where it is there."""
        more = [(frame_index, NO_SIGNAL if one is None else SIGNALS.index(one)) for frame_index, one in signals]
        if not more:
            return
        self._signals.setdefault(place, []).extend(more)

    def _give_signals(self) -> None:
        """Put them where kernels look for them, with those of the same alarm that no kernel has taken yet."""
        first, end = self._votes.alarm["signal"], self._votes.alarm["signals"]
        rows = self._votes.signal.tolist()
        for a, more in self._signals.items():
            some = sorted([*rows[first[a] : end[a]], *more], key=lambda one: one[0])
            first[a], end[a] = len(rows), len(rows) + len(some)
            rows += some
        self._signals.clear()
        self._votes, self._room = self._votes._replace(signal=np.array(rows, np.int64)), -1

    @contextmanager
    def apart(self) -> Iterator[Ballot]:
        """The same alarms, for checks that are judged in another thread meanwhile, and send no signals to theirs."""
        if self._signals:
            self._give_signals()
        change = np.empty(16, CHANGE) if self._apart is None else self._apart._votes.change
        self._apart = apart = copy(self)
        apart._votes, apart._room = self._votes._replace(change=change, changes=np.zeros(1, np.int64)), -1
        yield apart
        more = apart._votes.changes.item()
        if more:
            votes = self.votes(more)
            n = votes.changes.item()
            votes.change[n : n + more] = apart._votes.change[:more]
            votes.changes[0] += more

    def votes(self, samples: int) -> Votes:
        """What a kernel is given, with room for what `samples` votes may change."""
        if self._signals:
            self._give_signals()
        self._room -= 2 * samples
        if self._room < 0:
            self._make_room(samples)
        return self._votes

    def _make_room(self, samples: int) -> None:
        """See that there is as much as `votes` promises: few votes change anything, and what was promised is there."""
        needed = self._votes.changes.item() + 2 * samples + len(self._votes.signal)
        if needed > len(self._votes.change):
            change = np.empty(2 * needed, CHANGE)
            change[: self._votes.changes[0]] = self._votes.change[: self._votes.changes[0]]
            self._votes = self._votes._replace(change=change)
        self._room = len(self._votes.change) - needed

    def rate(self, spec: AlarmSpec, rated: Rated) -> None:
        """Give an alarm samples that no kernel has rated."""
        if len(rated):
            numbers = [np.ascontiguousarray(of, np.float64) for of in (rated.value, rated.limit, rated.detail)]
            vote_all(self.votes(len(rated)), self.place_of(spec), rated.frame_index, rated.t_boot_us, *numbers)

    def changes(self) -> list[AlarmChange]:
        """What has changed since this was asked last, signals included that no sample followed."""
        if self._signals or len(self._votes.signal):
            pass_signals(self.votes(0))
            self._votes.alarm["signal"] = self._votes.alarm["signals"] = 0
            self._votes = self._votes._replace(signal=_NO_SIGNALS)
        n = int(self._votes.changes[0])
        if not n:
            return []
        self._votes.changes[0] = 0
        return [
            AlarmChange(
                int(one["alarm"]),
                int(one["frame_index"]),
                Change(
                    before=STATES[one["before"]],
                    state=STATES[one["after"]],
                    by=None if one["by"] == NO_SIGNAL else SIGNALS[one["by"]],
                    t_boot_us=int(one["t_us"]),
                    worst=Worst(float(one["worst"]), one["worst_detail"].copy()),
                    onset_us=int(one["onset_us"]),
                ),
            )
            for one in self._votes.change[:n]
        ]

    def state(self, place: int) -> State:
        """Where the alarm is, by all samples that it was given."""
        return STATES[int(self._votes.alarm["state"][place])]

    def take_signal(self, place: int, signal: Signal) -> State:
        """Take a signal at once, between batches; return the state behind it."""
        alarm = self._votes.alarm
        alarm["state"][place] = NEXT[alarm["state"][place], SIGNALS.index(signal)]
        return self.state(place)

    def worst_value(self, place: int) -> float:
        """How large that of `worst` is."""
        return float(self._votes.alarm["worst"][place])

    def worst(self, place: int) -> Worst:
        """The peak of the alarm's present, or last, excursion."""
        alarm = self._votes.alarm[place]
        return Worst(float(alarm["worst"]), alarm["worst_detail"].copy())

    def now(self) -> Iterator[SlotNow]:
        """Where each alarm is, in the order of their places."""
        state, *numbers = (numbers.tolist() for numbers in self._shown)
        return zip(map(STATES.__getitem__, state), *numbers, strict=True)


_NO_SIGNALS: npt.NDArray[np.int64] = np.empty((0, 2), np.int64)
