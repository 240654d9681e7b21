"""What a dialect defines: per message its id, checksum seed, lengths and layout, read from pymavlink's tables.

Knows nothing of bytes on a wire. The tables are pymavlink's own, so both always mean the same messages.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

# MAVLink's wire types as little-endian numpy types (mavlink.io, guide/serialization.html).
_WIRE_TYPES = {
    "char": "S1",
    "uint8_t": "<u1",
    "int8_t": "<i1",
    "uint16_t": "<u2",
    "int16_t": "<i2",
    "uint32_t": "<u4",
    "int32_t": "<i4",
    "uint64_t": "<u8",
    "int64_t": "<i8",
    "float": "<f4",
    "double": "<f8",
}


WITHIN, FIELD_END, BEYOND = 0, 1, 2


class Tables(NamedTuple):
    """The dialect as arrays, for the scan kernel: `row_of_id[msgid]` (−1: unknown), then one row a message.

    `field_end[row, length]` tells whether a payload cut to `length` ends WITHIN a field, at a FIELD_END, or BEYOND
    the last one.
    """

    row_of_id: npt.NDArray[np.int16]
    crc_extra: npt.NDArray[np.uint8]
    field_end: npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Message:
    """One message of a dialect: `dtype` lays out its whole payload in wire order, extensions included."""

    name: str
    msgid: int
    crc_extra: int
    dtype: np.dtype[np.void]


class Dialect:
    """A named set of messages: `dialect["ATTITUDE"]` is a `Message`; KeyError where it defines no such message."""

    def __init__(self, name: str, classes: dict[int, Any], enums: dict[str, dict[int, Any]]) -> None:
        """Take pymavlink's message classes by id, and its enums."""
        self.name = name
        self._enums = enums
        self._class_of_name = {message.msgname: message for message in classes.values()}
        self._name_of_id = {message.id: str(message.msgname) for message in classes.values()}
        row_of_id = np.full(max(classes) + 1, -1, np.int16)
        row_of_id[list(classes)] = np.arange(len(classes))
        seeds = np.array([message.crc_extra for message in classes.values()], np.uint8)
        field_end = np.full((len(classes), 256), BEYOND, np.uint8)
        for row, message in enumerate(classes.values()):
            field_end[row, : message.unpacker.size] = WITHIN
            field_end[row, _field_ends(message)] = FIELD_END
        self.tables = Tables(row_of_id, seeds, field_end)

    def __contains__(self, name: str) -> bool:
        return name in self._class_of_name

    def name_of(self, msgid: int) -> str | None:
        """Name of the message with this id, None where the dialect defines none."""
        return self._name_of_id.get(msgid)

    def enum_name(self, enum: str, value: int) -> str:
        """Name of an enum's value, in lower case and without the enum's own name; "unknown" where it has none."""
        entry = self._enums.get(enum, {}).get(value)
        return entry.name.removeprefix(f"{enum}_").lower() if entry else "unknown"

    @cache  # noqa: B019  dialects live as long as the process: load_dialect keeps them
    def __getitem__(self, name: str) -> Message:
        message = self._class_of_name[name]
        return Message(name, message.id, message.crc_extra, _layout(message))


def _fields(message: Any) -> Iterator[tuple[str, str, int]]:
    """(name, numpy type, array length or 0) of each field of pymavlink's class `message`, in wire order."""
    wire_type = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    for name, count in zip(message.ordered_fieldnames, message.array_lengths, strict=True):
        yield name, _WIRE_TYPES[wire_type[name]], count


def _field_ends(message: Any) -> list[int]:
    """The payload's length up to and with each field."""
    return list(accumulate(int(base[-1]) * max(count, 1) for _, base, count in _fields(message)))


def _layout(message: Any) -> np.dtype[np.void]:
    """The payload of pymavlink's class `message` as a dtype."""
    fields: list[Any] = []
    for name, base, count in _fields(message):
        if base == "S1":
            fields.append((name, f"S{max(count, 1)}"))
        else:
            fields.append((name, base, (count,)) if count else (name, base))
    layout = np.dtype(fields)
    if layout.itemsize != message.unpacker.size:
        raise ValueError(f"{message.msgname} has {layout.itemsize} bytes here, {message.unpacker.size} in pymavlink")
    return layout


@cache
def load_dialect(name: str = "all") -> Dialect:
    """The dialect `name` of the installed pymavlink (MAVLink 2); ValueError where pymavlink has none of that name."""
    try:
        if not name.isidentifier():
            raise ModuleNotFoundError
        module = importlib.import_module(f"pymavlink.dialects.v20.{name}")
        return Dialect(name, module.mavlink_map, module.enums)
    except (ModuleNotFoundError, AttributeError) as error:
        raise ValueError(f"unknown dialect {name!r}: the installed pymavlink has {', '.join(_names())}") from error


def _names() -> list[str]:
    """The dialects of the installed pymavlink."""
    package = importlib.import_module("pymavlink.dialects.v20")
    return sorted(module.name for module in pkgutil.iter_modules(package.__path__))
