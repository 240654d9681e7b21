"""What the doctor tells, typed: the field names are the keys of the contract's JSON. Unknown is null, never 0."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from gcs_bridge.contract import plain

__all__ = [
    "SCHEMA",
    "Advice",
    "Ask",
    "Clock",
    "Examination",
    "Finding",
    "Level",
    "LinkFound",
    "Loss",
    "MachinePart",
    "Message",
    "Missing",
    "PartState",
    "Signing",
    "SigningState",
    "Station",
    "Vehicle",
]
SCHEMA: Literal["gcs-bridge/doctor/1"] = "gcs-bridge/doctor/1"
Finding = Literal["good", "missing", "wrong", "unusable"]
Level = Literal["unusable", "wrong", "missing", "advice", "note"]
SigningState = Literal["signed", "unsigned", "mixed"]
PartState = Literal["good", "mend", "absent", "unknown"]
LinkName = Annotated[str, Meta(description="URI of the link, or the file; undecodable bytes as \\xhh")]
Words = Annotated[str, Meta(description="the same in words")]


class LinkFound(Struct, frozen=True, kw_only=True):
    """A link or a recording: what came on it."""

    name: LinkName
    kind: Annotated[str, Meta(description="udpin, tcp, tcpin, mcast, serial; recording, or stream: one without times")]
    finding: Annotated[
        Finding,
        Meta(
            description="unusable: it cannot be opened, or brings no frame; wrong: what comes must not be relied on; "
            "missing: no vehicle, or one without ATTITUDE or ATTITUDE_QUATERNION"
        ),
    ]
    seconds: Annotated[float | None, Meta(description="listened to, or from the first receive time to the last")]
    bytes: int
    frames: Annotated[int, Meta(description="with a right checksum, copies included")]
    frames_per_s: float | None
    bad_crc: Annotated[int, Meta(description="frames whose checksum is wrong")]
    unverified: Annotated[int, Meta(description="frames of unknown ids, whose checksum cannot be told")]
    skipped_bytes: Annotated[int, Meta(description="in which no frame could be read")]
    duplicates: Annotated[int, Meta(description="frames that had come before")]
    signed: Annotated[int, Meta(description="frames that carry a signature")]


class Message(Struct, frozen=True, kw_only=True):
    """What came of one message of one sender."""

    count: Annotated[int, Meta(description="frames, copies included")]
    copies: Annotated[int, Meta(description="of them, those that had come before; no part of the rate")]
    rate_hz: Annotated[
        float | None, Meta(description="by receive time, Hz; silences of 2 s and more are no part of it")
    ]
    jitter_ms: Annotated[
        float | None, Meta(description="standard deviation of the time from one to the next, by receive time")
    ]
    age_s: Annotated[float | None, Meta(description="from the last one to the link's time at the end, s")]


class Loss(Struct, frozen=True, kw_only=True):
    """Frames that were lost on the way, by the sequence numbers; null where these cannot tell."""

    lost: int | None
    share: Annotated[float | None, Meta(description="of all that were sent")]
    text: Words


class Signing(Struct, frozen=True, kw_only=True):
    """Whether the frames carry signatures, and what these are worth by the key that was given."""

    state: SigningState
    signed: int
    unsigned: int
    verified: Annotated[int | None, Meta(description="signatures that are right and new; null: no key was given")]
    wrong: Annotated[int | None, Meta(description="signatures that are not right; null: no key was given")]
    text: Words


class Clock(Struct, frozen=True, kw_only=True):
    """The vehicle's clocks."""

    boots: Annotated[int, Meta(description="that were seen; 0: no message told the time since the start")]
    boot_s: Annotated[float | None, Meta(description="the latest time since the start, s")]
    utc: Annotated[str | None, Meta(description="as SYSTEM_TIME told it last, ISO 8601; null: the vehicle did not")]
    utc_behind_s: Annotated[float | None, Meta(description="by how much that is behind the receiver's clock, s")]
    text: Words


class Missing(Struct, frozen=True, kw_only=True):
    """One of the three messages that are compared, which does not come, and what brings it on this firmware."""

    message: str
    command: str
    where: Annotated[str, Meta(description="in which program to type the command")]


class Vehicle(Struct, frozen=True, kw_only=True):
    """A vehicle on a link."""

    link: LinkName
    sysid: int
    compid: int
    autopilot: Annotated[str, Meta(description="ardupilot, px4, …, unknown")]
    firmware: Annotated[str | None, Meta(description="version, as the vehicle told it; null: it did not")]
    type: Annotated[str, Meta(description="quadrotor, fixed_wing, …, unknown")]
    address: Annotated[str | None, Meta(description="host and port from which its datagrams come")]
    mavlink: Annotated[tuple[int, ...], Meta(description="versions of the protocol in which it sends")]
    frames: int
    messages: Annotated[dict[str, Message], Meta(description="by name; UNKNOWN_ID where the dialect has none")]
    loss: Loss
    signing: Signing
    clock: Clock
    missing: tuple[Missing, ...]


class Ask(Struct, frozen=True, kw_only=True):
    """A wish for a rate."""

    of: Annotated[tuple[int, int], Meta(description="system and component that is asked; 0: all")]
    what: Annotated[str, Meta(description="message, stream of messages, or parameter")]
    how: Annotated[str, Meta(description="message or command by which it is asked for")]
    rate_hz: Annotated[float | None, Meta(description="0: none at all; null: the firmware's own")]
    times: int


class Station(Struct, frozen=True, kw_only=True):
    """A sender that is no vehicle: a ground station, a radio, a companion."""

    link: LinkName
    sysid: int
    compid: int
    autopilot: str
    type: Annotated[str, Meta(description="gcs, onboard_controller, telemetry_radio, …, unknown")]
    frames: int
    messages: dict[str, Message]
    asks: Annotated[tuple[Ask, ...], Meta(description="whom it asks for which rates")]


class Advice(Struct, frozen=True, kw_only=True):
    """What there is to know, or to do, and the command to type, if there is one."""

    code: Annotated[str, Meta(description="a name that stays")]
    level: Annotated[Level, Meta(description="a link's finding is the worst of its advices'; advice and note are good")]
    text: str
    command: str | None
    link: Annotated[str | None, Meta(description="its name; null: of this machine")]
    vehicle: tuple[int, int] | None


class MachinePart(Struct, frozen=True, kw_only=True):
    """Something of this machine, and whether it is in order."""

    state: PartState
    text: str
    command: Annotated[str | None, Meta(description="to type, where it is to be mended")] = None


class Examination(Struct, frozen=True, kw_only=True):
    """What the doctor found."""

    schema: Literal["gcs-bridge/doctor/1"]
    version: Annotated[str, Meta(description="of gcs-bridge")]
    finding: Annotated[Finding, Meta(description="the worst of the links'")]
    links: tuple[LinkFound, ...]
    vehicles: tuple[Vehicle, ...]
    stations: Annotated[tuple[Station, ...], Meta(description="of each link the hundred that sent most")]
    advice: Annotated[tuple[Advice, ...], Meta(description="what matters most first")]
    machine: Annotated[dict[str, MachinePart], Meta(description="kernels, viewer, importer, groups, modem_manager, …")]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain Python values, fit for JSON; what is unknown is None."""
        return dict(plain(self))

    def to_json(self) -> str:
        """As one indented JSON object."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2).decode() + "\n"
