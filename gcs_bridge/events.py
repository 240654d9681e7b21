"""What the bridge reports as it happens: plain dicts, ready for JSON, with the keys of the contract."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from enum import IntEnum
from typing import Any, NamedTuple

from gcs_bridge.telemetry.identity import VehicleId

Event = dict[str, Any]

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_EARLIEST_UTC_US = 946_684_800_000_000  # 2000-01-01: no receive time before it was set by a clock that knew the date


def utc(t_rx_us: int) -> str | None:
    """ISO 8601 of µs since 1970, None where the receiver's clock did not know the date."""
    if t_rx_us < _EARLIEST_UTC_US:
        return None
    return (_EPOCH + timedelta(microseconds=t_rx_us)).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class Rank(IntEnum):
    """Which of the events that one frame brought about comes first."""

    IDENTITY = 0
    CLOCK = 1
    OTHER = 2


class Notice(NamedTuple):
    """An event and its place: the index of the frame that brought it about."""

    frame_index: int
    event: Event
    rank: Rank = Rank.OTHER


def make_event(
    name: str, vehicle: VehicleId, boot: int | None, t_boot_us: int | None, t_rx_us: int, **more: Any
) -> Event:
    """The event `name` of `vehicle` at `t_boot_us` on its boot clock, received at `t_rx_us` (None, −1: unknown)."""
    boot_s = None if t_boot_us is None else t_boot_us / 1e6
    head = {"event": name, "vehicle": list(vehicle.address), "boot": boot, "boot_s": boot_s, "utc": utc(t_rx_us)}
    of_link = {} if vehicle.link is None else {"link": vehicle.link}
    return head | {"check": None} | more | of_link


def vehicle_of(event: Event) -> VehicleId:
    """Whose event it is; only of one that has a vehicle."""
    return VehicleId(event.get("link"), *event["vehicle"])


def in_order(notices: Iterable[Notice]) -> list[Notice]:
    """The notices in the order in which one frame after the other brought them about, a vehicle's beside each other."""
    return sorted(notices, key=lambda notice: (notice.frame_index, notice.event["vehicle"], notice.rank))
