"""What the bridge reports as it happens: one struct a kind of event, with the keys of the contract's JSON."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from enum import IntEnum
from typing import Annotated, Literal, NamedTuple, TypedDict

from msgspec import UNSET, Meta, Struct, UnsetType

from gcs_bridge.contract import (
    AlarmId,
    Axis,
    BootIndex,
    ClearedBoot,
    Diagnosis,
    GroupedBy,
    Heading,
    IsNot,
    Peak,
    RaisedBoot,
    RaisedUtc,
    Repeats,
    RotvecBody,
    Severity,
    Tilt,
    Unit,
    What,
)
from gcs_bridge.telemetry.identity import VehicleId

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_EARLIEST_UTC_US = 946_684_800_000_000  # 2000-01-01: no receive time before it was set by a clock that knew the date


def utc(t_rx_us: int) -> str | None:
    """ISO 8601 of µs since 1970, None where the receiver's clock did not know the date."""
    if t_rx_us < _EARLIEST_UTC_US:
        return None
    return (_EPOCH + timedelta(microseconds=t_rx_us)).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class Head(TypedDict):
    """What every event begins with."""

    vehicle: tuple[int, int] | None
    boot: int | None
    boot_s: float | None
    utc: str | None
    check: str | None
    link: int | UnsetType


def head(vehicle: VehicleId, boot: int | None, t_boot_us: int | None, t_rx_us: int, check: str | None = None) -> Head:
    """Of an event of `vehicle` at `t_boot_us` on its boot clock, received at `t_rx_us` (None, −1: unknown)."""
    return {
        "vehicle": vehicle.address,
        "boot": boot,
        "boot_s": None if t_boot_us is None else t_boot_us / 1e6,
        "utc": utc(t_rx_us),
        "check": check,
        "link": UNSET if vehicle.link is None else vehicle.link,
    }


class Event(Struct, frozen=True, kw_only=True, tag_field="event"):
    """Something that happened; a stale stream, a lost vehicle carry the time at which their deadline passed."""

    vehicle: Annotated[tuple[int, int] | None, Meta(description="system and component; null: of a link itself")]
    boot: BootIndex | None
    boot_s: Annotated[float | None, Meta(description="on the vehicle's boot clock, s")]
    utc: Annotated[str | None, Meta(description="receive time, ISO 8601; null where the receiver knew no date")]
    check: Annotated[str | None, Meta(description="name of the check that it is about")]
    link: Annotated[
        int | str | UnsetType,
        Meta(description="number of the link, absent on the first; in the lines of live links its name"),
    ] = UNSET

    @property
    def name(self) -> str:
        """The kind of event, as `event` in JSON."""
        return str(self.__struct_config__.tag)


class LinkUp(Event, frozen=True, kw_only=True, tag="link_up"):
    """A link is open."""


class LinkDown(Event, frozen=True, kw_only=True, tag="link_down"):
    """A link has gone; it is waited for, and `link_up` tells of its return."""

    reason: str


class Damage(Event, frozen=True, kw_only=True, tag="damage"):
    """Data were lost on this side of a link, no frame is found in what comes on it, or frames are not as signed."""

    reason: str
    dropped: Annotated[int, Meta(description="datagrams that this machine was too slow to take")]
    signature: Annotated[
        Literal["unsigned", "wrong", "replayed", "old"] | UnsetType,
        Meta(description="what is wrong with how frames are signed, told once a run of them; else absent"),
    ] = UNSET
    sender: Annotated[
        tuple[int, int] | UnsetType,
        Meta(description="system and component that these frames claim to be of; absent where it is about no frames"),
    ] = UNSET


class VehicleSeen(Event, frozen=True, kw_only=True, tag="vehicle_seen"):
    """A vehicle is there, or there again."""


class VehicleLost(Event, frozen=True, kw_only=True, tag="vehicle_lost"):
    """Nothing comes from a vehicle any more."""


class StreamEvent(Event, frozen=True, kw_only=True):
    """Something became of one message of a vehicle."""

    stream: Annotated[str, Meta(description="name of the message")]


class StreamStarted(StreamEvent, frozen=True, kw_only=True, tag="stream_started"):
    """The first message came."""


class StreamStale(StreamEvent, frozen=True, kw_only=True, tag="stream_stale"):
    """Messages come no more, or with times that stand still."""


class StreamResumed(StreamEvent, frozen=True, kw_only=True, tag="stream_resumed"):
    """Messages come again."""


class RateRequested(Event, frozen=True, kw_only=True, tag="rate_requested"):
    """Somebody asked for another rate of attitudes than was asked for last; it is the usual one from here on."""

    streams: Annotated[tuple[str, ...], Meta(description="names of the messages")]
    rate_hz: Annotated[float | None, Meta(description="0: none at all; null: the vehicle's own")]
    by: Annotated[tuple[int, int] | None, Meta(description="system and component; null: it was not seen who")]
    how: Annotated[str, Meta(description="message, command or parameter by which it was asked for")]
    instead_of: Annotated[tuple[int, int] | None, Meta(description="another station that had asked for another rate")]
    undo_each_other: Annotated[bool, Meta(description="whether these two stations undo each other's wishes")]
    reason: Annotated[str, Meta(description="the same in words")]


class ReceiverPaused(Event, frozen=True, kw_only=True, tag="receiver_paused"):
    """The receiver did not listen for a time, or its clock was set forward: less time passed on the vehicles."""

    pause_s: Annotated[float, Meta(description="how much less, s")]
    reason: Annotated[str, Meta(description="the same in words")]


class ClockEvent(Event, frozen=True, kw_only=True):
    """The boot clock did something else than go on."""

    step_s: Annotated[float | None, Meta(description="how far the clock stepped, s; null: no time was told since")]


class Reboot(ClockEvent, frozen=True, kw_only=True, tag="reboot"):
    """The vehicle restarted; it is the first event of the new boot."""


class ClockStep(ClockEvent, frozen=True, kw_only=True, tag="clock_step"):
    """The boot clock stepped, and the vehicle did not restart."""


class EstimatorReset(Event, frozen=True, kw_only=True, tag="estimator_reset"):
    """Both attitudes stepped together, against the gyro."""

    tilt: Annotated[float, Meta(description="of the new attitude seen from the old one, deg")]
    heading: Annotated[float | None, Meta(description="of the new attitude seen from the old one, deg")]
    explained_by: Annotated[tuple[str, ...], Meta(description="what the vehicle said right before")]


class NoCompare(Event, frozen=True, kw_only=True, tag="no_compare"):
    """A comparison cannot go on, as a source of it is missing."""

    reason: str


class CompareResumed(Event, frozen=True, kw_only=True, tag="compare_resumed"):
    """A comparison goes on."""


class Inop(Event, frozen=True, kw_only=True, tag="inop"):
    """A comparison cannot run although its sources are there."""

    reason: str | None


class DiagnosisMade(Event, frozen=True, kw_only=True, tag="diagnosis"):
    """Why an alarm stands, as far as it is known by now."""

    id: AlarmId
    severity: Severity
    diagnosis: Diagnosis


class AlarmEvent(Event, frozen=True, kw_only=True):
    """Something became of an alarm; the fields are those of the report's alarm."""

    id: AlarmId
    severity: Severity
    what: What
    is_not: IsNot
    raised_boot_s: RaisedBoot
    cleared_boot_s: ClearedBoot
    raised_utc: RaisedUtc
    unit: Unit
    peak: Peak
    axis: Axis
    tilt: Tilt
    heading: Heading
    rotvec_body: RotvecBody
    repeats: Repeats
    grouped: GroupedBy
    acknowledged: bool
    diagnosis: Diagnosis | None


class AlarmPending(AlarmEvent, frozen=True, kw_only=True, tag="alarm_pending"):
    """A disagreement that becomes an alarm if it lasts."""


class AlarmRaised(AlarmEvent, frozen=True, kw_only=True, tag="alarm_raised"):
    """An alarm stands."""


class AlarmCleared(AlarmEvent, frozen=True, kw_only=True, tag="alarm_cleared"):
    """An alarm stands no more."""

    reason: Annotated[str | UnsetType, Meta(description="reboot: it was never seen to go; else absent")] = UNSET


class AlarmAcknowledged(AlarmEvent, frozen=True, kw_only=True, tag="alarm_acknowledged"):
    """Somebody has seen the alarm."""


class AlarmShelved(AlarmEvent, frozen=True, kw_only=True, tag="alarm_shelved"):
    """Nothing is told of the alarm for a time."""

    until_utc: Annotated[str | None, Meta(description="receive time at which that ends, ISO 8601")]


class AlarmUnshelved(AlarmEvent, frozen=True, kw_only=True, tag="alarm_unshelved"):
    """The alarm is told of again."""


AnyEvent = (
    LinkUp
    | LinkDown
    | Damage
    | VehicleSeen
    | VehicleLost
    | StreamStarted
    | StreamStale
    | StreamResumed
    | RateRequested
    | ReceiverPaused
    | Reboot
    | ClockStep
    | EstimatorReset
    | NoCompare
    | CompareResumed
    | Inop
    | DiagnosisMade
    | AlarmPending
    | AlarmRaised
    | AlarmCleared
    | AlarmAcknowledged
    | AlarmShelved
    | AlarmUnshelved
)
"""Every kind of event, as a type to decode JSON lines into."""


class Rank(IntEnum):
    """Which of the events that one frame brought about comes first."""

    IDENTITY = 0
    CLOCK = 1
    OTHER = 2


class Notice(NamedTuple):
    """An event of a vehicle and its place: the index of the frame that brought it about."""

    frame_index: int
    event: Event
    rank: Rank = Rank.OTHER


def vehicle_of(event: Event) -> VehicleId:
    """Whose event it is; only of one that has a vehicle."""
    assert event.vehicle is not None
    return VehicleId(event.link if isinstance(event.link, int) else None, *event.vehicle)


def in_order(notices: Iterable[Notice]) -> list[Notice]:
    """The notices in the order in which one frame after the other brought them about, a vehicle's beside each other."""
    return sorted(notices, key=lambda notice: (notice.frame_index, notice.event.vehicle or (), notice.rank))
