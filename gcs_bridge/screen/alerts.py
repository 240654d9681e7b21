"""What calls for attention: which word, colour and sign it has, and what comes first.

The words are those of flight decks (14 CFR 25.1322, FAA AC 25.1322-1): a *warning* wants to be acted on at once and is
red, a *caution* to be known at once and acted on later and is amber, an *advisory* to be known and is neither. What
events and reports call an alarm is a warning here, what they call a warning is a caution. Each has a sign and a word
besides its colour.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from gcs_bridge.alarms.state import CLEARING, LATCHED, SHELVED, STANDING, SUPPRESSED, State
from gcs_bridge.judging.snapshot import AlarmNow, AttitudeNow, CheckNow, Snapshot, VehicleNow
from gcs_bridge.screen.canvas import Role
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.samples import STREAMS

__all__ = ["LOOKS", "Alert", "AlertKey", "Level", "alerts_of", "id_of", "level_of_vehicle", "who"]

_ACKNOWLEDGED = frozenset({State.ACKNOWLEDGED, State.CLEARING_ACKNOWLEDGED})


class Level(IntEnum):
    """How much attention something calls for, most first."""

    WARNING = 0
    CAUTION = 1
    ADVISORY = 2


class Look(NamedTuple):
    """How a level is shown, where nobody has acknowledged it and where somebody has; `short`: in four letters."""

    sign: str
    word: str
    short: str
    role: Role
    seen: Role


LOOKS = {
    Level.WARNING: Look("▲", "WARNING", "WARN", Role.WARNING, Role.WARNING_SEEN),
    Level.CAUTION: Look("■", "CAUTION", "CAUT", Role.CAUTION, Role.CAUTION_SEEN),
    Level.ADVISORY: Look("●", "ADVISORY", "ADVI", Role.ADVISORY, Role.ADVISORY),
}
_LEVELS = {"alarm": Level.WARNING, "warning": Level.CAUTION}  # by severity


class AlertKey(NamedTuple):
    """Which alert it is, as long as it lasts."""

    vehicle: VehicleId
    check: str
    name: str


@dataclass(frozen=True, kw_only=True)
class Alert:
    """One thing that calls for attention; `alarm`: what it is, where somebody can say something to it."""

    key: AlertKey
    level: Level
    text: str
    state: str
    is_new: bool = False  # nobody has acknowledged it
    is_shelved: bool = False
    alarm: AlarmNow | None = None

    @property
    def role(self) -> Role:
        """How it looks."""
        look = LOOKS[self.level]
        return Role.FAINT if self.is_shelved else look.role if self.is_new else look.seen


def id_of(vehicle: VehicleNow) -> VehicleId:
    """Who it is."""
    return VehicleId(vehicle.link, vehicle.sysid, vehicle.compid)


def who(vehicle: VehicleId) -> str:
    """A vehicle in few characters: on the first link by its numbers alone.

    >>> who(VehicleId(None, 1, 1)), who(VehicleId(2, 1, 1))
    ('1,1', '1,1@2')
    """
    link = "" if vehicle.link is None else f"@{vehicle.link}"
    return f"{vehicle.sysid},{vehicle.compid}{link}"


def alerts_of(snapshot: Snapshot, lost: Collection[VehicleId], shelved_until: Mapping[str, str]) -> list[Alert]:
    """All that calls for attention, what does so most first; what is shelved last.

    `lost`: vehicles of which nothing comes any more; `shelved_until`: the time at which that ends, by an alarm's id.
    """
    found = [
        alert
        for vehicle in snapshot.vehicles
        for alert in (*_alarms(vehicle, shelved_until), *_advisories(vehicle, is_lost=id_of(vehicle) in lost))
    ]
    return sorted(found, key=lambda alert: (alert.is_shelved, alert.level, not alert.is_new))


def level_of_vehicle(alerts: Collection[Alert], vehicle: VehicleId) -> Level | None:
    """The worst of what a vehicle calls for attention with; None: nothing."""
    return min((one.level for one in alerts if one.key.vehicle == vehicle and not one.is_shelved), default=None)


def _alarms(vehicle: VehicleNow, shelved_until: Mapping[str, str]) -> Iterator[Alert]:
    for check in vehicle.checks:
        for alarm in check.alarms:
            latched = alarm.state in LATCHED
            if alarm.announcement in SUPPRESSED or not (latched or alarm.state in STANDING):
                continue
            is_shelved = alarm.announcement in SHELVED
            is_new = alarm.state not in _ACKNOWLEDGED
            yield Alert(
                key=AlertKey(id_of(vehicle), check.name, alarm.name),
                level=_LEVELS[alarm.severity],
                text=check.name if alarm.name in ("pairs", "alarm", "warning") else f"{check.name} {alarm.name}",
                state=_shelved(alarm, shelved_until) if is_shelved else _state(alarm, latched=latched, is_new=is_new),
                is_new=is_new,
                is_shelved=is_shelved,
                alarm=alarm,
            )


def _state(alarm: AlarmNow, *, latched: bool, is_new: bool) -> str:
    if latched:
        return "gone, not ack'd"
    if alarm.state in CLEARING:
        return "going, not ack'd" if is_new else "going, ack'd"
    return "NOT ACK'D" if is_new else "acknowledged"


def _shelved(alarm: AlarmNow, shelved_until: Mapping[str, str]) -> str:
    until = shelved_until.get(alarm.id or "", "")
    return f"shelved to {until}" if until else "shelved"


def _advisories(vehicle: VehicleNow, *, is_lost: bool) -> Iterator[Alert]:
    """What cannot be judged, and why as far as it shows: silence never looks like health."""
    key = id_of(vehicle)
    if is_lost:
        yield Alert(key=AlertKey(key, "", "lost"), level=Level.ADVISORY, text="LOST: nothing comes from it", state="")
        return
    for name, attitude in zip(STREAMS, (vehicle.attitude, vehicle.attitude_quaternion), strict=True):
        if attitude is not None and (wrong := _wrong_with(attitude)):
            yield Alert(key=AlertKey(key, name, wrong), level=Level.ADVISORY, text=f"{name} {wrong}", state="")
    for state, words in ((State.NO_COMPARE, "NO COMPARE"), (State.INOP, "INOP")):
        if names := [check.name for check in vehicle.checks if _is(check, state)]:
            text = f"{words} now: {', '.join(names)}"
            yield Alert(key=AlertKey(key, "", words), level=Level.ADVISORY, text=text, state="")
    if vehicle.verdict == "no_compare":
        text = "NO COMPARE: not enough of its attitude was compared yet"
        yield Alert(key=AlertKey(key, "", "never"), level=Level.ADVISORY, text=text, state="")


def _wrong_with(attitude: AttitudeNow) -> str:
    if not attitude.alive:
        return "silent"
    return "" if attitude.valid else "holds no attitude"


def _is(check: CheckNow, state: State) -> bool:
    return bool(check.alarms) and all(alarm.state is state for alarm in check.alarms)
