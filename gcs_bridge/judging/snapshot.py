"""What is known now, for whoever looks on while links are listened to: cheap, and nothing is changed by it."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta, Struct

from gcs_bridge.alarms.ballot import SlotNow
from gcs_bridge.alarms.slot import AlarmSlot
from gcs_bridge.alarms.state import LATCHED, Announcement, State
from gcs_bridge.contract import Severity, Stream, plain
from gcs_bridge.report.schema import CheckVerdict, Verdict
from gcs_bridge.telemetry.samples import AttitudeSamples

Vector = tuple[float, float, float]
AgeS = Annotated[float | None, Meta(description="s from when it was received to the link's time; null: unknown")]


class AttitudeNow(Struct, frozen=True, kw_only=True):
    """The latest attitude of one message, as it was sent."""

    t_boot_s: float
    age_s: AgeS
    alive: Annotated[bool, Meta(description="the stream is not stale")]
    valid: Annotated[bool, Meta(description="false where it holds NaN, infinity or a quaternion of norm zero")]
    q_nb: Annotated[tuple[float, float, float, float], Meta(description="w, x, y, z, body (FRD) to world (NED)")]
    rpy_rad: Annotated[Vector | None, Meta(description="roll, pitch, yaw as sent; null of ATTITUDE_QUATERNION")]
    w_nb_b_rad_s: Annotated[Vector, Meta(description="body rates, rad/s")]


class AlarmNow(Struct, frozen=True, kw_only=True, gc=False):
    """One alarm of a check: the latest sample against its limit, both in `unit`, and how the alarm stands."""

    name: str
    severity: Severity
    unit: str
    t_boot_s: Annotated[float | None, Meta(description="of the latest sample; null: none came in this boot")]
    value: float | None
    limit: float | None
    state: State
    announcement: Announcement
    id: Annotated[str | None, Meta(description="of the alarm that is pending, stands, or has gone unacknowledged")]
    peak: float | None


class CheckNow(Struct, frozen=True, kw_only=True, gc=False):
    """One check: its verdict so far, and its alarms."""

    name: str
    verdict: CheckVerdict
    alarms: tuple[AlarmNow, ...]


class VehicleNow(Struct, frozen=True, kw_only=True):
    """One vehicle of one link."""

    link: Annotated[int | None, Meta(description="null: the first one, or a recording")]
    sysid: int
    compid: int
    autopilot: str
    type: str
    verdict: Verdict
    boot: Annotated[int | None, Meta(description="from 0; null before the first message with a time")]
    t_boot_s: Annotated[float | None, Meta(description="the latest time of this boot")]
    age_s: AgeS
    received: Annotated[int, Meta(description="frames")]
    lost: Annotated[int, Meta(description="frames that the sequence numbers miss")]
    attitude: AttitudeNow | None
    attitude_quaternion: AttitudeNow | None
    streams: dict[str, Stream]
    message_age_s: Annotated[dict[str, AgeS], Meta(description="of the last one of each of these streams")]
    checks: tuple[CheckNow, ...]


class LinkNow(Struct, frozen=True, kw_only=True):
    """One link or recording: what was read of it."""

    name: Annotated[int | str, Meta(description="its number, or recording")]
    is_open: bool
    frames: int
    bytes: int
    bad_crc: int
    skipped_bytes: int
    unlisted: Annotated[int, Meta(description="components that claim to be vehicles and are not listed")]


class Snapshot(Struct, frozen=True, kw_only=True):
    """All links and vehicles, as of now."""

    links: tuple[LinkNow, ...]
    vehicles: tuple[VehicleNow, ...]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain Python values, fit for JSON; what is unknown is None."""
        entry: dict[str, Any] = plain(self)
        return entry


def attitude_now(samples: AttitudeSamples | None, t_rx_us: int, *, alive: bool) -> AttitudeNow | None:
    """The last of some samples."""
    if samples is None:
        return None
    came_us = samples.t_rx_us.item(-1)
    return AttitudeNow(
        t_boot_s=samples.t_boot_us.item(-1) / 1e6,
        age_s=(t_rx_us - came_us) / 1e6 if came_us >= 0 else None,
        alive=alive,
        valid=samples.valid.item(-1),
        q_nb=tuple(samples.q_nb[-1].tolist()),
        rpy_rad=None if samples.rpy_rad is None else tuple(samples.rpy_rad[-1].tolist()),
        w_nb_b_rad_s=tuple(samples.w_nb_b_rad_s[-1].tolist()),
    )


def alarm_now(slot: AlarmSlot, now: SlotNow) -> AlarmNow:
    """One alarm, as its ballot has it now."""
    spec, scale = slot.spec, slot.scale
    state, samples, t_boot_us, value, limit = now
    record = slot.last if state in LATCHED else slot.record
    return AlarmNow(
        name=spec.name,
        severity=spec.severity,
        unit=spec.unit,
        t_boot_s=t_boot_us / 1e6 if samples else None,
        value=value * scale if samples else None,
        limit=limit * scale if samples else None,
        state=state,
        announcement=slot.announcement,
        id=None if record is None else record.id,
        peak=None if record is None else record.peak,
    )
