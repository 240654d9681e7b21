"""All vehicles at a glance: a chip each where there is little room, else a row each."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from gcs_bridge.judging.snapshot import VehicleNow
from gcs_bridge.screen.alerts import LOOKS, Alert, Level, id_of, level_of_vehicle, who
from gcs_bridge.screen.canvas import CHOSEN, Region, Role
from gcs_bridge.screen.history import disagreement_of
from gcs_bridge.screen.numbers import brief_attitude, measured
from gcs_bridge.telemetry.identity import VehicleId

__all__ = ["TABLE_WIDTH", "chip_rows", "draw_chips", "draw_table"]

TABLE_WIDTH = 60


def chip_rows(vehicles: Sequence[VehicleNow], width: int) -> int:
    """How many rows the chips take; none where there is but one vehicle."""
    if len(vehicles) < 2:
        return 0
    return -(-len(vehicles) // max(width // _chip_width(vehicles), 1))


def draw_chips(
    region: Region,
    vehicles: Sequence[VehicleNow],
    alerts: Sequence[Alert],
    chosen: VehicleId | None,
    lost: Collection[VehicleId],
) -> None:
    """Draw the vehicles one behind the other; of more than there is room for, those around the chosen one."""
    width = _chip_width(vehicles)
    in_a_row = max(region.width // width, 1)
    for y, row in enumerate(_rows_around(_place_of(vehicles, chosen) // in_a_row, region.height)):
        for x, vehicle in enumerate(vehicles[row * in_a_row : (row + 1) * in_a_row]):
            _draw_chip(region.part(x * width, y, width, 1), vehicle, alerts, lost, is_chosen=id_of(vehicle) == chosen)


def draw_table(
    region: Region,
    vehicles: Sequence[VehicleNow],
    alerts: Sequence[Alert],
    chosen: VehicleId | None,
    lost: Collection[VehicleId],
) -> None:
    """Draw a row a vehicle: how it stands, its attitude, its age, its disagreement with the limit."""
    if not region.height:
        return
    region.put(0, 0, f"{len(vehicles)} vehicles", Role.FAINT)
    region.put_right(39, 0, "attitude", Role.FAINT)
    region.put_right(46, 0, "age", Role.FAINT)
    region.put_right(TABLE_WIDTH - 1, 0, "apart/limit", Role.FAINT)
    rows = region.part(0, 1, region.width, region.height - 1)
    width = _chip_width(vehicles)
    for y, place in enumerate(_rows_around(_place_of(vehicles, chosen), rows.height)):
        if place >= len(vehicles):
            break
        vehicle = vehicles[place]
        _draw_chip(rows.part(0, y, width, 1), vehicle, alerts, lost, is_chosen=id_of(vehicle) == chosen)
        rows.put_right(39, y, brief_attitude(vehicle))
        rows.put_right(46, y, "?" if vehicle.age_s is None else f"{vehicle.age_s:.1f} s")
        apart = disagreement_of(vehicle)
        rows.put_right(TABLE_WIDTH - 1, y, "-" if apart is None else measured(apart))


def _rows_around(row: int, height: int) -> range:
    """The rows that are shown, so that `row` is among them."""
    first = max(row - height + 1, 0)
    return range(first, first + height)


def _place_of(vehicles: Sequence[VehicleNow], chosen: VehicleId | None) -> int:
    return next((place for place, vehicle in enumerate(vehicles) if id_of(vehicle) == chosen), 0)


def _chip_width(vehicles: Sequence[VehicleNow]) -> int:
    """A place for the mark, the name, a blank, and the word of four letters."""
    return max((len(who(id_of(vehicle))) for vehicle in vehicles), default=0) + 6


def _draw_chip(
    region: Region, vehicle: VehicleNow, alerts: Sequence[Alert], lost: Collection[VehicleId], *, is_chosen: bool
) -> None:
    name = who(id_of(vehicle))
    if is_chosen:
        region.put(0, 0, CHOSEN, Role.STRONG)
    end = region.put(1, 0, name, Role.STRONG if is_chosen else Role.PLAIN)
    word, role = _standing(vehicle, alerts, lost)
    region.put(end + 1, 0, word, role)


def _standing(vehicle: VehicleNow, alerts: Sequence[Alert], lost: Collection[VehicleId]) -> tuple[str, Role]:
    """How it stands in a word of at most four letters: what calls for attention, else what it came to."""
    if id_of(vehicle) in lost:
        return "LOST", Role.ADVISORY
    level = level_of_vehicle(alerts, id_of(vehicle))
    if level is not None and (level is not Level.ADVISORY or vehicle.verdict != "no_compare"):
        look = LOOKS[level]
        is_new = any(one.is_new for one in alerts if one.key.vehicle == id_of(vehicle) and one.level is level)
        return look.short, look.role if is_new else look.seen
    if vehicle.verdict == "no_compare":
        return "n/c", Role.ADVISORY
    is_shelved = any(one.is_shelved for one in alerts if one.key.vehicle == id_of(vehicle))
    return ("shlv", Role.FAINT) if is_shelved else ("ok", Role.GOOD)
