"""What a dialect defines: per message its id, checksum seed, lengths and layout, read from pymavlink's tables.

Knows nothing of bytes on a wire. The tables are pymavlink's own, so both always mean the same messages.
"""

from __future__ import annotations

import importlib
import importlib.util
import marshal
import pkgutil
import sys
import zlib
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gcs_bridge import cache as files_kept

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
_STAMPS = ("time_boot_ms", "time_usec")


class Tables(NamedTuple):
    """The dialect as arrays, for the scan kernel: `row_of_id[msgid]` (−1: unknown), then one row a message.

    `field_end[row, length]` tells whether a payload cut to `length` ends WITHIN a field, at a FIELD_END, or BEYOND
    the last one; `stamped[row]` whether the sender's time is in the message, so that no two of them are alike.
    """

    row_of_id: npt.NDArray[np.int16]
    crc_extra: npt.NDArray[np.uint8]
    field_end: npt.NDArray[np.uint8]
    stamped: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Message:
    """One message of a dialect: `dtype` lays out its whole payload in wire order, extensions included."""

    name: str
    msgid: int
    crc_extra: int
    dtype: np.dtype[np.void]


class Definition(NamedTuple):
    """One message, as pymavlink defines it."""

    msgid: int
    crc_extra: int
    size: int  # bytes of the whole payload
    ends: tuple[int, ...]  # the payload's length up to and with each field
    fields: tuple[tuple[str, str, int], ...]  # name, numpy's type, and array length or 0, in wire order


Definitions = dict[str, tuple[int, int, int, tuple[int, ...], tuple[tuple[str, str, int], ...]]]
"""`Definition` of each message by its name: of plain tuples, which are quickly loaded."""
Enums = dict[str, dict[int, str]]
"""The names of each enum's values."""


class Dialect:
    """A named set of messages: `dialect["ATTITUDE"]` is a `Message`; KeyError where it defines no such message."""

    def __init__(self, name: str, definitions: Definitions, enums: Enums) -> None:
        """Take what pymavlink says."""
        self.name = name
        self._enums = enums
        self._definitions = {message: Definition(*told) for message, told in definitions.items()}
        self._name_of_id = {told.msgid: message for message, told in self._definitions.items()}
        row_of_id = np.full(max(self._name_of_id) + 1, -1, np.int16)
        row_of_id[list(self._name_of_id)] = np.arange(len(definitions))
        seeds = np.array([told.crc_extra for told in self._definitions.values()], np.uint8)
        sizes = np.array([told.size for told in self._definitions.values()])
        ends = [told.ends for told in self._definitions.values()]
        field_end = np.where(np.arange(256) < sizes[:, None], WITHIN, BEYOND).astype(np.uint8)
        field_end[np.repeat(np.arange(len(ends)), list(map(len, ends))), list(chain(*ends))] = FIELD_END
        stamped = [any(field[0] in _STAMPS for field in told.fields) for told in self._definitions.values()]
        self.tables = Tables(row_of_id, seeds, field_end, np.array(stamped))

    def __contains__(self, name: str) -> bool:
        return name in self._definitions

    def with_field(self, field: str) -> list[str]:
        """Names of the messages that have such a field."""
        return [name for name, told in self._definitions.items() if any(one[0] == field for one in told.fields)]

    def name_of(self, msgid: int) -> str | None:
        """Name of the message with this id, None where the dialect defines none."""
        return self._name_of_id.get(msgid)

    def enum_name(self, enum: str, value: int) -> str:
        """Name of an enum's value, in lower case and without the enum's own name; "unknown" where it has none."""
        entry = self._enums.get(enum, {}).get(value)
        return entry.removeprefix(f"{enum}_").lower() if entry else "unknown"

    @cache  # noqa: B019  # dialects live as long as the process: load_dialect keeps them
    def __getitem__(self, name: str) -> Message:
        told = self._definitions[name]
        return Message(name, told.msgid, told.crc_extra, _layout(name, told))


def _layout(name: str, message: Definition) -> np.dtype[np.void]:
    """The payload as a dtype."""
    fields: list[Any] = []
    for field, base, count in message.fields:
        if base == "S1":
            fields.append((field, f"S{max(count, 1)}"))
        else:
            fields.append((field, base, (count,)) if count else (field, base))
    layout = np.dtype(fields)
    if layout.itemsize != message.size:
        raise ValueError(f"{name} has {layout.itemsize} bytes here, {message.size} in pymavlink")
    return layout


@cache
def load_dialect(name: str = "all") -> Dialect:
    """The dialect `name` of the installed pymavlink (MAVLink 2); ValueError where pymavlink has none of that name.

    Pymavlink's module takes long to load, as it holds much more; so what is needed of it is kept from run to run.
    """
    kept_as = _kept_as(name)
    kept = None if kept_as is None else files_kept.read(kept_as)
    if kept is not None:
        return Dialect(name, *marshal.loads(kept))  # noqa: S302  # nobody else can have written it
    definitions, enums = _read_pymavlink(name)
    if kept_as is not None:
        files_kept.write(kept_as, marshal.dumps((definitions, enums)))
    return Dialect(name, definitions, enums)


def _kept_as(name: str) -> str | None:
    """The name under which a dialect is kept: another one for another file of pymavlink, or of this module."""
    package = importlib.util.find_spec("pymavlink")
    if package is None or package.origin is None or not name.isidentifier():
        return None
    module = Path(package.origin).parent / "dialects" / "v20" / f"{name}.py"
    try:
        status, by = module.stat(), zlib.crc32(Path(__file__).read_bytes())
    except OSError:
        return None
    made_of = f"{sys.version} {by} {module} {status.st_mtime_ns} {status.st_size}"
    return f"dialect.{name}-{zlib.crc32(made_of.encode()):08x}"


def _read_pymavlink(name: str) -> tuple[Definitions, Enums]:
    """What pymavlink's module says; ValueError where there is none."""
    try:
        if not name.isidentifier():
            raise ModuleNotFoundError
        module = importlib.import_module(f"pymavlink.dialects.v20.{name}")
        definitions = {str(message.msgname): _definition(message) for message in module.mavlink_map.values()}
        enums = {enum: {value: entry.name for value, entry in of.items()} for enum, of in module.enums.items()}
        return definitions, enums
    except (ModuleNotFoundError, AttributeError) as error:
        raise ValueError(f"unknown dialect {name!r}: the installed pymavlink has {', '.join(_names())}") from error


def _definition(message: Any) -> tuple[int, int, int, tuple[int, ...], tuple[tuple[str, str, int], ...]]:
    """Of pymavlink's class `message`."""
    wire_type = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    in_wire_order = zip(message.ordered_fieldnames, message.array_lengths, strict=True)
    fields = tuple((name, _WIRE_TYPES[wire_type[name]], count) for name, count in in_wire_order)
    ends = tuple(accumulate(int(base[-1]) * max(count, 1) for _, base, count in fields))
    return message.id, message.crc_extra, message.unpacker.size, ends, fields


def _names() -> list[str]:
    """The dialects of the installed pymavlink."""
    package = importlib.import_module("pymavlink.dialects.v20")
    return sorted(module.name for module in pkgutil.iter_modules(package.__path__))
