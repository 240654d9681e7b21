"""Keeps what vehicles sent lately, and hands out the ten seconds on both sides of each alarm once they have passed.

Such a window, a *moment*, is a run of frames: from the vehicle's first message of these ten seconds up to, and without,
the first one behind them, of another boot, or after a silence. So its content does not depend on how the input was cut.
What is kept is bounded in time, in frames and in moments, whatever comes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Int64s, record
from gcs_bridge.events import AlarmRaised, Event, vehicle_of
from gcs_bridge.judging.observation import Observation
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.statements import ParameterSet, Statement

AROUND_US = 10_000_000
_LATE_US = 5_000_000  # events are told so much behind the time that they carry: by late frames, and by late neighbours
_MOST_FRAMES = 100_000  # of a moment, on either side of its alarm: for clocks that stand still
_MOST_OPEN = 64  # moments of a vehicle that wait for their end
_MOST_EVENTS = 10_000
_MOST_PARAMETERS = 4096
_OTHERS_BEFORE = 50  # what a vehicle said last before a moment, but for parameters


class Said(NamedTuple):
    """What a vehicle said of itself, and the boot and time, µs, of its last message before; None: there was none."""

    say: Statement
    boot: int | None
    t_boot_us: int | None


@record
class AlarmWindow:
    """The time around one alarm of a vehicle.

    `alarm` is the event that raised it, at `t_boot_us` of `boot`. The moment is made of its link's frames from number
    `first` up to, and without, `end`; with number `at` the vehicle's clock had come to the alarm. `observations` are
    what the checks were given of these frames; `events` those of the vehicle that carry a time of the moment. `said`
    is what was in force when it began (each parameter's value, the last texts and modes) and what was said in it.
    """

    vehicle: VehicleId
    alarm: AlarmRaised
    boot: int
    t_boot_us: int
    first: int
    at: int
    end: int
    observations: tuple[Observation, ...]
    events: tuple[Event, ...]
    said: tuple[Said, ...]


class AlarmWindows:
    """The moments of one link or recording.

    `observe` is to be given to `Monitor(observer=…)`, and the events of each call of the Monitor to `take`. An alarm
    has one moment, of its first raise; one that was raised while it was shelved has none.
    """

    def __init__(self) -> None:
        """Start with nothing kept."""
        self.missed = 0  # alarms without a moment, as too many were open
        self._vehicles: dict[VehicleId, _Vehicle] = {}

    def observe(self, observation: Observation) -> None:
        """Keep what was judged."""
        self._vehicle(observation.vehicle).keep(observation)

    def take(self, events: Iterable[Event]) -> list[AlarmWindow]:
        """Take the events that came of what was observed since the last call; return the moments that are over."""
        for event in events:
            if event.vehicle and event.boot_s is not None:
                vehicle = self._vehicle(vehicle_of(event))
                self.missed += not vehicle.hear(event)
        finished = [moment for vehicle in self._vehicles.values() for moment in vehicle.finished()]
        for vehicle in self._vehicles.values():
            vehicle.forget()
        return finished

    def advance(self, t_rx_us: int) -> list[AlarmWindow]:
        """Time has come to `t_rx_us`: return the moments of vehicles that have been silent for as long as a moment."""
        return [
            moment
            for vehicle in self._vehicles.values()
            if 0 <= vehicle.latest_rx_us < t_rx_us - AROUND_US
            for moment in vehicle.finished(nothing_follows=True)
        ]

    def finish(self) -> list[AlarmWindow]:
        """Nothing follows: return the moments that are left, as far as they came."""
        return [moment for vehicle in self._vehicles.values() for moment in vehicle.finished(nothing_follows=True)]

    def _vehicle(self, key: VehicleId) -> _Vehicle:
        return self._vehicles.setdefault(key, _Vehicle(key))


class _Open(NamedTuple):
    """A moment that is not over yet."""

    alarm: AlarmRaised
    boot: int
    t_boot_us: int
    since: int  # index up to which frames had come when it was opened


class _Vehicle:
    """What is kept of one vehicle."""

    def __init__(self, key: VehicleId) -> None:
        self.latest_rx_us = -1
        self._key = key
        self._kept: deque[Observation] = deque()
        self._events: deque[Event] = deque(maxlen=_MOST_EVENTS)
        self._open: list[_Open] = []
        self._boot: int | None = None
        self._latest_us: int | None = None  # the latest time within the boot
        self._last_us: int | None = None  # that of the last message
        self._frame_index = -1  # of the last frame
        self._said: deque[Said] = deque()  # beside what is kept
        self._parameters: dict[str, Said] = {}  # before that
        self._others: deque[Said] = deque(maxlen=_OTHERS_BEFORE)

    def keep(self, observation: Observation) -> None:
        segment = observation.segment
        self._kept.append(observation)
        self._hear(observation)
        self._frame_index = max(self._frame_index, *(int(of[-1]) for of in _frame_indices(observation)), -1)
        if len(segment.frame_index):
            latest_us = int(segment.t_boot_us.max())
            same = segment.boot == self._boot and self._latest_us is not None
            self._latest_us = max(latest_us, self._latest_us or 0) if same else latest_us
            self._boot, self._last_us = segment.boot, int(segment.t_boot_us[-1])
            self.latest_rx_us = max(self.latest_rx_us, int(segment.t_rx_us.max()))

    def _hear(self, observation: Observation) -> None:
        """Stamp what was said with the time of the message before it."""
        segment = observation.segment
        for say in observation.flight.statements:
            before = int(np.searchsorted(segment.frame_index, say.frame_index, side="right")) - 1
            if before >= 0:
                self._said.append(Said(say, segment.boot, int(segment.t_boot_us[before])))
            else:
                self._said.append(Said(say, self._boot, self._last_us))

    def hear(self, event: Event) -> bool:
        """Take an event; whether there was room for the moment that it may begin."""
        self._events.append(event)
        if not isinstance(event, AlarmRaised) or event.repeats:
            return True
        if len(self._open) < _MOST_OPEN:
            assert event.boot is not None
            self._open.append(_Open(event, event.boot, round(_boot_s(event) * 1e6), self._frame_index))
            return True
        return False

    def finished(self, *, nothing_follows: bool = False) -> list[AlarmWindow]:
        over = [one for one in self._open if nothing_follows or self._is_over(one)]
        self._open = [one for one in self._open if one not in over]
        return [self._moment(one) for one in over]

    def _is_over(self, one: _Open) -> bool:
        if self._boot != one.boot or self._latest_us is None:
            return self._boot is not None
        return (
            self._latest_us > one.t_boot_us + AROUND_US + _LATE_US or self._frame_index > one.since + 2 * _MOST_FRAMES
        )

    def _moment(self, one: _Open) -> AlarmWindow:
        first, at, end = self._frames(one)
        parts = (between(kept, first, end) for kept in self._kept if kept.segment.boot == one.boot)
        begin_s, end_s = (one.t_boot_us - AROUND_US) / 1e6, (one.t_boot_us + AROUND_US) / 1e6
        events = (event for event in self._events if event.boot == one.boot)
        return AlarmWindow(
            vehicle=self._key,
            alarm=one.alarm,
            boot=one.boot,
            t_boot_us=one.t_boot_us,
            first=first,
            at=at,
            end=end,
            observations=tuple(part for part in parts if any(len(of) for of in _frame_indices(part))),
            events=tuple(event for event in events if begin_s <= _boot_s(event) <= end_s),
            said=tuple(self._in_force(first, end)),
        )

    def _frames(self, one: _Open) -> tuple[int, int, int]:
        """Frames of a moment: its first one, that at which its alarm's time had come, the first one behind it."""
        segments = [kept.segment for kept in self._kept if kept.segment.boot == one.boot]
        next_boots = [kept.segment.frame_index for kept in self._kept if kept.segment.boot > one.boot]
        behind = min((int(of[0]) for of in next_boots if len(of)), default=self._frame_index + 1)
        if not any(len(segment.frame_index) for segment in segments):
            return behind, behind, behind
        frame_index = np.concatenate([segment.frame_index for segment in segments])
        t_us = np.concatenate([segment.t_boot_us for segment in segments])
        t_rx_us = np.concatenate([segment.t_rx_us for segment in segments])
        inside = np.flatnonzero(t_us >= one.t_boot_us - AROUND_US)
        reached = np.flatnonzero(t_us >= one.t_boot_us)
        at = int(frame_index[reached[0]]) if len(reached) else behind
        first = max(int(frame_index[inside[0]]), at - _MOST_FRAMES) if len(inside) else at
        # Behind a silence that began in the moment, it is over: nobody waits so long for its end.
        silent = np.zeros(len(t_us), np.bool_)
        silent[1:] = (np.diff(t_rx_us) > AROUND_US) & (t_rx_us[:-1] >= 0) & (t_us[1:] > one.t_boot_us)
        over = np.flatnonzero(((t_us > one.t_boot_us + AROUND_US) | silent) & (frame_index > first))
        end = min(behind, at + _MOST_FRAMES, *(int(frame_index[row]) for row in over[:1]))
        return first, min(at, end), end

    def _in_force(self, first: int, end: int) -> Iterator[Said]:
        """What had been said when the moment began, and what was said in it."""
        before = [said for said in self._said if said.say.frame_index < first]
        parameters = dict(self._parameters)
        parameters.update({said.say.name: said for said in before if isinstance(said.say, ParameterSet)})
        others = [*self._others, *(said for said in before if not isinstance(said.say, ParameterSet))]
        yield from sorted([*parameters.values(), *others[-_OTHERS_BEFORE:]], key=lambda said: said.say.frame_index)
        yield from (said for said in self._said if first <= said.say.frame_index < end)

    def forget(self) -> None:
        """Drop what no moment needs that is open or may still begin."""
        needed = [(one.boot, one.t_boot_us - AROUND_US, one.since) for one in self._open]
        if self._boot is not None and self._latest_us is not None:
            needed.append((self._boot, self._latest_us - AROUND_US - _LATE_US, self._frame_index))

        def is_needed(kept: Observation) -> bool:
            segment = kept.segment
            if not len(segment.frame_index):
                return False
            latest_us, last = int(segment.t_boot_us.max()), int(segment.frame_index[-1])
            return any(
                segment.boot == boot and latest_us >= from_us and last >= since - 2 * _MOST_FRAMES
                for boot, from_us, since in needed
            )

        while self._kept and not is_needed(self._kept[0]):
            self._kept.popleft()
        oldest = _frame_indices(self._kept[0]) if self._kept else []
        begin = min((int(of[0]) for of in oldest), default=self._frame_index + 1)
        while self._said and self._said[0].say.frame_index < begin:
            self._fold(self._said.popleft())
        while self._events and not _is_behind(self._events[0], needed):
            self._events.popleft()

    def _fold(self, said: Said) -> None:
        if isinstance(said.say, ParameterSet):
            self._parameters.pop(said.say.name, None)  # the one said last stands last
            self._parameters[said.say.name] = said
            if len(self._parameters) > _MOST_PARAMETERS:
                del self._parameters[next(iter(self._parameters))]
        else:
            self._others.append(said)


def _boot_s(event: Event) -> float:
    """When an event was that carries a boot time: others are not kept."""
    assert event.boot_s is not None
    return event.boot_s


def _is_behind(event: Event, needed: Iterable[tuple[int, int, int]]) -> bool:
    """Whether an event lies behind any of these boots' times."""
    return any(event.boot == boot and _boot_s(event) * 1e6 >= from_us for boot, from_us, _ in needed)


def _frame_indices(observation: Observation) -> list[Int64s]:
    """The indices of the frames in an observation, by kind, each in order of arrival; those that came at all."""
    flight = observation.flight
    every = (
        observation.segment.frame_index,
        np.empty(0, np.int64) if flight.imu is None else flight.imu.frame_index,
        flight.secondary.frame_index,
        np.array([say.frame_index for say in flight.statements], np.int64),
    )
    return [of for of in every if len(of)]


def between(observation: Observation, first: int, end: int) -> Observation:
    """What the frames from `first` up to, and without, `end` brought to an observation."""
    return replace(
        observation,
        segment=observation.segment.frames(first, end),
        pairs=observation.pairs.frames(first, end),
        disagreement=observation.disagreement.frames(first, end),
        flight=observation.flight.frames(first, end),
        corrected=observation.corrected.frames(first, end),
        notices=tuple(notice for notice in observation.notices if first <= notice.frame_index < end),
        positions=observation.positions.frames(first, end),
    )
