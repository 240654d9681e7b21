"""How biases and trims of each vehicle change from flight to flight: a line through its flights."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gcs_bridge.columns import Floats, Int64s
from gcs_bridge.survey.parts import read_table

__all__ = ["Drift", "drifts"]

_LEAST_FLIGHTS = 3
_MOST_VEHICLES = 20  # of each quantity, those that change most clearly
_MOST_POINTS = 100
_FLOOR = 0.02  # deg, deg/s: so much less than that is no change to anybody
_DAY_US = 86_400_000_000


class _Quantity(NamedTuple):
    """What is followed."""

    name: str
    unit: str
    check: str
    column: str


_QUANTITIES = (
    *(_Quantity(f"gyro bias {axis}", "deg/s", "gyro", f"bias_{axis}") for axis in "xyz"),
    _Quantity("pitch trim", "deg", "euler_quaternion", "pitch_trim_deg"),
    _Quantity("AHRS trim x", "deg", "euler_quaternion", "ahrs_trim_x_deg"),
    _Quantity("AHRS trim y", "deg", "euler_quaternion", "ahrs_trim_y_deg"),
    _Quantity("tilt at rest", "deg", "gravity", "residual_median"),
)


class Drift(msgspec.Struct, frozen=True, kw_only=True):
    """One quantity of one vehicle over its flights; times are of their starts, µs since 1970."""

    vehicle: str
    quantity: str
    unit: str
    flights: int
    first_us: int
    last_us: int
    median: float
    change: float
    """From the first to the last, along the line."""
    noise: float
    """Of the flights about the line: their standard deviation."""
    points: list[tuple[int, float]]
    """Time and value: of many flights some, evenly."""

    @property
    def clarity(self) -> float:
        """How clearly it changes: along the line against about it, and the more so the more flights there are."""
        return abs(self.change) / (self.noise + _FLOOR) * math.sqrt(self.flights)


def drifts(folder: Path, vehicle: re.Pattern[str] | None = None) -> list[Drift]:
    """Of the dataset in a folder, by quantity, what changed most clearly first.

    Vehicles are told apart by system and component, and by what `vehicle` matches in the recording's path (its first
    group, if it has one), or else by the folder that the recording lies in. Flights without a time tell nothing.
    """
    found: list[Drift] = []
    for quantity in _QUANTITIES:
        column = pc.field(quantity.column)
        where = (pc.field("check") == quantity.check) & column.is_valid() & pc.field("start_utc").is_valid()
        columns = ["path", "folder", "sysid", "compid", "start_utc", quantity.column]
        table = read_table(folder, "checks", columns, where)
        of_quantity = [
            _drift(quantity, name, t_us, values) for name, t_us, values in _by_vehicle(table, quantity.column, vehicle)
        ]
        found += sorted(of_quantity, key=lambda one: -one.clarity)[:_MOST_VEHICLES]
    return found


def _by_vehicle(table: pa.Table, column: str, vehicle: re.Pattern[str] | None) -> Iterator[tuple[str, Int64s, Floats]]:
    """Each vehicle with flights enough: its name, their times and values, in order of time."""
    if not len(table):
        return
    named = table["folder"] if vehicle is None else pa.array([_name(vehicle, path.as_py()) for path in table["path"]])
    address = pc.binary_join_element_wise(table["sysid"].cast(pa.string()), table["compid"].cast(pa.string()), ",")
    names = pc.dictionary_encode(pc.binary_join_element_wise(named, address, " ")).combine_chunks()
    which = names.indices.to_numpy()
    t_us = table["start_utc"].cast(pa.int64()).to_numpy()
    values = table[column].to_numpy()
    order = np.lexsort((t_us, which))
    starts = np.flatnonzero(np.diff(which[order], prepend=-1))
    for first, end in zip(starts, [*starts[1:], len(order)], strict=True):
        rows = order[first:end]
        if len(np.unique(t_us[rows])) >= _LEAST_FLIGHTS:
            yield names.dictionary[int(which[rows[0]])].as_py(), t_us[rows], values[rows]


def _name(vehicle: re.Pattern[str], path: str) -> str:
    match = vehicle.search(path)
    return "" if match is None else match[1] or "" if vehicle.groups else match[0]


def _drift(quantity: _Quantity, vehicle: str, t_us: Int64s, values: Floats) -> Drift:
    days = (t_us - t_us[0]) / _DAY_US
    slope, offset = np.polyfit(days, values, 1)
    shown = np.unique(np.linspace(0, len(values) - 1, _MOST_POINTS).astype(int))
    return Drift(
        vehicle=vehicle.strip(),
        quantity=quantity.name,
        unit=quantity.unit,
        flights=len(values),
        first_us=int(t_us[0]),
        last_us=int(t_us[-1]),
        median=float(np.median(values)),
        change=float(slope * days[-1]),
        noise=float(np.std(values - offset - slope * days)),
        points=[(int(t_us[at]), float(values[at])) for at in shown],
    )
