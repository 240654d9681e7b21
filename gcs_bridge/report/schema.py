"""A report's parts, typed: the field names are the keys of the contract's JSON, as in `contract`."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from gcs_bridge.contract import Alarm, BootIndex, Distribution, ExplainedBy, Stream

__all__ = [
    "Boot",
    "Check",
    "CheckVerdict",
    "EstimatorReset",
    "File",
    "Gap",
    "Salvage",
    "Signatures",
    "Station",
    "Vehicle",
    "Verdict",
]

Verdict = Literal["agree", "warning", "alarm", "no_compare"]
CheckVerdict = Literal["agree", "explained", "warning", "alarm", "no_compare", "inop"]


class Gap(Struct, frozen=True, kw_only=True):
    """Bytes in which no frame could be read."""

    offset: Annotated[int, Meta(description="of the first one, in the file or link")]
    bytes: int


class Signatures(Struct, frozen=True, kw_only=True):
    """What frames' signatures came to, by the key that was given."""

    valid: Annotated[int, Meta(description="frames whose signature and time are right")]
    unsigned: Annotated[int, Meta(description="frames without a signature")]
    wrong: Annotated[int, Meta(description="frames that were signed by another key, or changed")]
    replayed: Annotated[int, Meta(description="frames whose time is not later than that of one before of their stream")]
    old: Annotated[int, Meta(description="frames of a new stream, more than a minute behind the newest")]
    refused: Annotated[int, Meta(description="frames that are none of the valid, and were not used")]


class Salvage(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What was read of a file or link, and what was not."""

    frames: Annotated[int, Meta(description="verified and repaired ones of known ids, duplicates included")]
    bad_crc: Annotated[int, Meta(description="frames whose checksum is wrong")]
    repaired_crc: Annotated[int, Meta(description="frames that were whole but for the checksum, and are used")]
    unverified: Annotated[int, Meta(description="frames of unknown ids, whose checksum cannot be told")]
    skipped_bytes: Annotated[int, Meta(description="bytes in gaps")]
    signed: Annotated[int, Meta(description="frames that carry a signature, whatever it is worth")]
    signatures: Annotated[Signatures | None, Meta(description="null: not verified, as no key was given")]
    duplicates: Annotated[int, Meta(description="frames that came before, and were not used")]
    bad_times: Annotated[int, Meta(description="records whose receive time was damaged, and was not used")]
    read_fraction: Annotated[float | None, Meta(description="share of the bytes that were read; null without any")]
    remarks: Annotated[
        tuple[str, ...],
        Meta(description="what else there is to say of how the bytes came, in words; absent without any"),
    ] = ()
    gap_count: int
    gaps: Annotated[tuple[Gap, ...], Meta(description="the first hundred")]


class Boot(Struct, frozen=True, kw_only=True):
    """From one restart of the vehicle to the next."""

    index: BootIndex
    first_boot_s: Annotated[float | None, Meta(description="boot time of the first message, s; null: none was told")]
    last_boot_s: Annotated[float | None, Meta(description="boot time of the latest message, s; null: none was told")]
    start_utc: Annotated[str | None, Meta(description="receive time at which the boot clock was zero, ISO 8601")]


class EstimatorReset(Struct, frozen=True, kw_only=True):
    """Both attitudes stepped together, against the gyro: as the event of that name."""

    boot: BootIndex
    boot_s: Annotated[float | None, Meta(description="boot time of the first attitude behind it, s")]
    utc: Annotated[str | None, Meta(description="receive time at which it was known, ISO 8601")]
    tilt: Annotated[float, Meta(description="of the new attitude seen from the old one, deg")]
    heading: Annotated[float | None, Meta(description="of the new attitude seen from the old one, deg")]
    explained_by: Annotated[tuple[str, ...], Meta(description="what the vehicle said right before")]


class Check(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What one check found. `raw` is before, `residual` after the differences made on purpose were undone."""

    name: str
    verdict: CheckVerdict
    reason: Annotated[str, Meta(description="of the verdict, in words")]
    unit: Annotated[str, Meta(description="of the distributions")]
    coverage: Annotated[float | None, Meta(description="share of the time with both sources that was really judged")]
    pairs: Annotated[int, Meta(description="samples, or pairs of samples, that were judged")]
    same_instant: Annotated[int | None, Meta(description="of the pairs, those whose two samples are of one instant")]
    residual: Distribution
    raw: Distribution
    tilt: Distribution | None
    heading: Distribution | None
    lag_ms: Annotated[float | None, Meta(description="above 0: the quaternion's stamp is late; null without motion")]
    explained_by: tuple[ExplainedBy, ...]
    bias: Annotated[
        tuple[float, float, float] | None,
        Meta(
            description="of the gyro in body axes, in `unit`, at the end: followed, not judged; absent in other checks"
        ),
    ] = None


class Vehicle(Struct, frozen=True, kw_only=True):
    """A vehicle, by the worst of its alarms; without any, by whether its attitude was compared with anything."""

    sysid: int
    compid: int
    autopilot: Annotated[str, Meta(description="ardupilot, px4, …, unknown")]
    type: Annotated[str, Meta(description="quadrotor, fixed_wing, …, unknown")]
    verdict: Verdict
    boots: tuple[Boot, ...]
    streams: Annotated[dict[str, Stream], Meta(description="by name of the message")]
    checks: Annotated[tuple[Check, ...], Meta(description="every one that exists, no_compare included")]
    alarms: Annotated[tuple[Alarm, ...], Meta(description="in the order of their first raise")]
    resets: Annotated[tuple[EstimatorReset, ...], Meta(description="of the estimator, the first hundred")] = ()


class Station(Struct, frozen=True, kw_only=True):
    """A sender that is no vehicle of the report: a ground station, a companion, or a system that was not asked for."""

    sysid: int
    compid: int
    autopilot: Annotated[str, Meta(description="as its last heartbeat says, unknown without any")]
    type: Annotated[str, Meta(description="as its last heartbeat says, unknown without any")]
    frames: int


class File(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A recording or a link, by the worst of its vehicles."""

    path: Annotated[str, Meta(description="file, or URI of the link; undecodable bytes as \\xhh")]
    bytes: int
    verdict: Verdict
    salvage: Salvage
    vehicles: tuple[Vehicle, ...]
    others: Annotated[
        tuple[Station, ...], Meta(description="who else was heard: the hundred that sent most; absent without any")
    ] = ()
    other_count: Annotated[int, Meta(description="how many they are in all; absent without any")] = 0
