"""What each check of a vehicle says as it goes on, and the vehicle's flight mode: lanes on a timeline of states.

    vehicle/1.1/verdict/euler_quaternion …   of each check that has judged anything, or could not
    vehicle/1.1/mode                         flight mode, and whether armed

A batch is observed before its events are told. So what changes is kept until then, and follows in order of time.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, groupby
from typing import NamedTuple

import numpy as np
import rerun as rr

from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.columns import Int64s
from gcs_bridge.events import (
    AlarmCleared,
    AlarmEvent,
    AlarmPending,
    AlarmRaised,
    AlarmShelved,
    AlarmUnshelved,
    CompareResumed,
    Event,
    Inop,
    NoCompare,
    Reboot,
)
from gcs_bridge.expected import CAUSE_NAMES
from gcs_bridge.judging.observation import Observation
from gcs_bridge.mavlink.modes import mode_name
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.statements import ModeSet
from gcs_bridge.viewer.palette import ALARM, NOT_YET, OK, UNKNOWN, WARNING, Colour
from gcs_bridge.viewer.rows import Shown
from gcs_bridge.viewer.scene import path_of
from gcs_bridge.viewer.times import Instant, instant_of

__all__ = ["Lanes"]

_EXPLAINED: Colour = (66, 133, 200)
_PENDING: Colour = (240, 215, 80)
_MODE_COLOURS: tuple[Colour, ...] = ((70, 100, 130), (110, 90, 140), (60, 120, 120), (120, 120, 80), (90, 90, 90))
_MOST_MODES = 100  # that have colours: anybody may send any number of them
_NOTHING, _AGREE = "nothing judged yet", "agree"


def _explained(causes: int) -> str:
    """That both agree once that is undone which the firmware does on purpose."""
    names = [name for bit, name in CAUSE_NAMES.items() if causes & bit]
    return "agree, explained by " + " and ".join(names) if names else _AGREE


_CAUSES = [sum(some) for n in range(1, len(CAUSE_NAMES) + 1) for some in combinations(CAUSE_NAMES, n)]
_COLOURS: dict[str, Colour] = {
    _NOTHING: NOT_YET,
    _AGREE: OK,
    **dict.fromkeys(map(_explained, _CAUSES), _EXPLAINED),
    "no compare": UNKNOWN,
    "inop": UNKNOWN,
    "pending": _PENDING,
    "warning": WARNING,
    "alarm": ALARM,
}
_CAPITALS = ("no compare", "inop", "warning", "alarm")


class _Judged(NamedTuple):
    """A check judges from now on."""

    check: str


class _Undone(NamedTuple):
    """What is undone in the Euler angles from now on, as bits."""

    causes: int


class _TakenBack(NamedTuple):
    """A pending alarm passed."""

    id: str


class _Change(NamedTuple):
    moment: Instant
    what: Event | _Judged | _Undone | _TakenBack


class _Lane:
    """One check."""

    def __init__(self) -> None:
        self.configured = False  # how its states look has been told
        self.start_boot()

    def start_boot(self) -> None:
        self.shown = ""  # on the boot's own timeline
        self.judges = False
        self.silent = ""  # or the word for it
        self.pending: set[str] = set()  # ids
        self.raised: dict[str, str] = {}  # severity by id

    def state(self, causes: int) -> str:
        if self.raised:
            return "alarm" if "alarm" in self.raised.values() else "warning"
        if self.pending:
            return "pending"
        return self.silent or (_explained(causes) if self.judges else _NOTHING)

    def hear(self, event: Event) -> None:
        match event:
            case AlarmPending():
                self.pending.add(event.id)
            case AlarmRaised():
                self.pending.clear()
                self.raised[event.id] = event.severity
            case AlarmUnshelved(raised_boot_s=float(), cleared_boot_s=None):
                self.raised[event.id] = event.severity
            case AlarmCleared() | AlarmShelved():
                self.raised.pop(event.id, None)
            case NoCompare() | Inop():
                self.pending.clear()
                self.silent = "no compare" if isinstance(event, NoCompare) else "inop"
            case CompareResumed():
                self.silent = ""


class Lanes:
    """Follows the checks of one vehicle."""

    def __init__(self, key: VehicleId) -> None:
        """Start with nothing shown."""
        self._key = key
        self._lanes: dict[str, _Lane] = {}
        self._waiting: list[_Change] = []
        self._boot: int | None = None
        self._judged: dict[str, int] = {}  # by each check, up to now
        self._judging: set[str] = set()  # checks that have judged something in this boot
        self._causes_seen = 0  # of the last sample
        self._causes = 0  # as shown
        self._latest = Instant(0, None, -1)
        self._mode = ""
        self._modes_seen: list[str] = []

    def observe(self, observation: Observation) -> Iterator[Shown]:
        """What a batch shows, but for what waits for its events."""
        segment = observation.segment
        if segment.boot != self._boot:
            self._boot = segment.boot
            self._judging.clear()
        boot = segment.boot
        for name, count in observation.judged.items():
            if count > self._judged.get(name, 0) and name not in self._judging:
                first = _first(observation, name)
                if first is not None:
                    self._judging.add(name)
                    self._wait(boot, *first, _Judged(name))
        self._judged.update(observation.judged)
        causes = observation.corrected.causes
        if len(causes) and (self._causes_seen or causes.any()):
            for row in np.flatnonzero(np.diff(causes.astype(np.int64), prepend=self._causes_seen)).tolist():
                at = int(segment.euler.t_boot_us[row]), int(segment.euler.t_rx_us[row])
                self._wait(boot, *at, _Undone(int(causes[row])))
            self._causes_seen = int(causes[-1])
        for one in observation.taken_back:
            row = min(int(np.searchsorted(segment.t_boot_us, one.t_boot_us)), len(segment.t_rx_us) - 1)
            self._wait(boot, one.t_boot_us, int(segment.t_rx_us[row]) if row >= 0 else -1, _TakenBack(one.id))
        yield from self._modes(observation)

    def hear(self, event: Event) -> None:
        """An event of the vehicle."""
        if event.check is not None or isinstance(event, Reboot):
            self._waiting.append(_Change(instant_of(event), event))

    def settle(self) -> Iterator[Shown]:
        """All that is to be told of what was observed has been told: show it, in order of time."""
        waiting, self._waiting = self._waiting, []
        # A reboot is told with the message that bears it out: what its boot judged up to then belongs behind it.
        waiting.sort(key=lambda one: (one.moment.boot, not isinstance(one.what, Reboot), one.moment.t_boot_us or 0))
        for _, together in groupby(waiting, key=lambda one: (one.moment.boot, one.moment.t_boot_us)):
            changes = list(together)
            for change in changes:
                self._take(change.what)
            yield from self._show(changes[-1].moment)

    def _take(self, what: Event | _Judged | _Undone | _TakenBack) -> None:
        match what:
            case _Judged(check=check):
                self._lane(check).judges = True
            case _Undone(causes=causes):
                self._causes = causes
            case _TakenBack():
                for lane in self._lanes.values():
                    lane.pending.discard(what.id)
            case Reboot():
                self._causes = 0
                for lane in self._lanes.values():
                    lane.start_boot()
            case AlarmEvent() | NoCompare() | Inop() | CompareResumed():
                self._lane(str(what.check)).hear(what)

    def _show(self, moment: Instant) -> Iterator[Shown]:
        """The lanes that have another state now."""
        if moment.t_boot_us is None:  # not told: not before what is known
            before = self._latest
            moment = moment._replace(t_boot_us=before.t_boot_us if before.boot == moment.boot else 0)
        self._latest = moment
        for name, lane in self._lanes.items():
            state = lane.state(self._causes if name == EulerQuaternion.name else 0)
            if state != lane.shown:
                if not lane.configured:
                    lane.configured = True
                    yield Shown(moment, [(self._path(name), _CONFIGURATION)], static=True)
                lane.shown = state
                yield Shown(moment, [(self._path(name), rr.StateChange(state=state))])

    def _modes(self, observation: Observation) -> Iterator[Shown]:
        segment = observation.segment
        for say in observation.flight.statements:
            if isinstance(say, ModeSet) and len(segment.frame_index):
                row = min(int(np.searchsorted(segment.frame_index, say.frame_index)), len(segment.frame_index) - 1)
                moment = Instant(segment.boot, int(segment.t_boot_us[row]), int(segment.t_rx_us[row]))
                mode = mode_name(say.autopilot, say.type, say.custom_mode)
                mode += ", armed" if say.armed else ", disarmed"
                if mode != self._mode:
                    self._mode = mode
                    path = path_of(self._key, "mode")
                    if mode not in self._modes_seen[:_MOST_MODES]:
                        self._modes_seen.append(mode)
                        yield Shown(moment, [(path, _of_modes(self._modes_seen[:_MOST_MODES]))], static=True)
                    yield Shown(moment, [(path, rr.StateChange(state=mode))])

    def _wait(self, boot: int, t_boot_us: int, t_rx_us: int, what: _Judged | _Undone | _TakenBack) -> None:
        self._waiting.append(_Change(Instant(boot, t_boot_us, t_rx_us), what))

    def _lane(self, check: str) -> _Lane:
        return self._lanes.setdefault(check, _Lane())

    def _path(self, check: str) -> str:
        return path_of(self._key, "verdict", check)


_CONFIGURATION = rr.StateConfiguration(
    values=list(_COLOURS),
    labels=[state.upper() if state in _CAPITALS else state for state in _COLOURS],
    colors=list(_COLOURS.values()),
)


def _of_modes(modes: list[str]) -> rr.StateConfiguration:
    """Colours that are no alarm's, each mode's its own for a while."""
    colours = [_MODE_COLOURS[at % len(_MODE_COLOURS)] for at in range(len(modes))]
    return rr.StateConfiguration(values=modes, colors=colours)


def _first(observation: Observation, check: str) -> tuple[int, int] | None:
    """The boot and receive time of the first of a batch's samples that a check judges; None: of none yet.

    Of the two forms it is the first pair that agrees: what is apart may turn out to be as it should.
    """
    segment, flight = observation.segment, observation.flight
    sources: list[tuple[Int64s, Int64s]] = [(segment.t_boot_us, segment.t_rx_us)]
    if check == EulerQuaternion.name:
        found = observation.disagreement
        agrees = found.judged & (found.angle <= found.limit)
        sources = [(observation.pairs.t_boot_us[agrees], observation.pairs.t_rx_us[agrees])]
    elif check in ("gravity", "gyro", "mag_heading"):
        sources.append((flight.imu_with_attitude.t_boot_us, flight.imu_with_attitude.t_rx_us))
    elif check == "secondary_estimate":
        sources.append((flight.secondary.t_boot_us, flight.secondary.t_rx_us))
    elif check == "quaternion_norm":
        sources.append((segment.quaternion.t_boot_us, segment.quaternion.t_rx_us))
    for t_boot_us, t_rx_us in reversed(sources):
        if len(t_boot_us):
            return int(t_boot_us[0]), int(t_rx_us[0])
    return None
