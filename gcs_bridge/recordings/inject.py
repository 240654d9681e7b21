"""Put a known fault into a recording: a mistake of the causes' table, or a fault of the link.

A fault is a set of edits, each of which replaces some bytes; every other byte stays as it was, damage included. What a
fault may touch are the records (time and frame) whose checksum is right. Several faults are made one after the other,
each in what the one before left.

A falsified frame gets its checksum anew, and in MAVLink 2 a payload without trailing zeros, as that version demands.
Sequence numbers are never changed: what `loss` and `thin` leave out is missing there too. A signed frame can't be
signed again without the key: falsified, it loses its signature and the flag that announces it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from gcs_bridge.diagnosis.causes import CAUSES
from gcs_bridge.errors import GcsBridgeError, SourceError, UsageError
from gcs_bridge.files import refuse_unwritable, write_file
from gcs_bridge.mavlink.dialect import load_dialect
from gcs_bridge.recordings.edits import Edit, RecordingFrames, Scope, falsified, frames_in, scope_of, spliced
from gcs_bridge.recordings.faults import Fault
from gcs_bridge.recordings.link_faults import LINK_FAULTS
from gcs_bridge.recordings.source import opened

__all__ = [
    "Made",
    "StreamAbsentError",
    "inject",
    "inject_file",
]


class StreamAbsentError(GcsBridgeError):
    """The recording is good, but what should be falsified is not in it."""

    exit_code: ClassVar[int] = 4


class Made(NamedTuple):
    """A fault that was made: the number of messages (or of bytes, as `became` says), and what became of them."""

    fault: Fault
    number: int
    became: str


def inject(
    data: bytes,
    faults: Sequence[Fault],
    *,
    dialect: str = "all",
    sysid: int | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    seed: int = 0,
) -> bytes:
    """The recording `data` (a .tlog's bytes) with the faults in it, made in their order.

    `sysid` restricts them to one system. `from_s` and `to_s` are seconds after the first record's time: records in
    [from_s, to_s) are touched. `truncate` alone knows neither. What is left to chance is the same for the same `seed`.

    Several faults in one call are the same as one call each, on what the one before left; only seconds count from the
    first of all records here.

    Raises UsageError for a dialect, message or interval that can't be, SourceError where no frame is valid, and
    StreamAbsentError where there is nothing to falsify.
    """
    return _injected(data, faults, dialect=dialect, sysid=sysid, from_s=from_s, to_s=to_s, seed=seed)[0]


def _injected(
    data: bytes,
    faults: Sequence[Fault],
    *,
    dialect: str,
    sysid: int | None,
    from_s: float | None,
    to_s: float | None,
    seed: int,
) -> tuple[bytes, list[Made]]:
    """As `inject`, with what was made."""
    try:
        table = load_dialect(dialect)
    except ValueError as error:
        raise UsageError(str(error)) from None
    records = frames_in(data, table)
    if not len(records.frames):
        raise SourceError("not one valid MAVLink frame: this is no telemetry recording with record times (.tlog)")
    scope = scope_of(records.frames, sysid=sysid, from_s=from_s, to_s=to_s)
    made = []
    for fault in faults:
        edits = sorted(_edits(records, scope, fault, np.random.default_rng(seed)))
        link = LINK_FAULTS.get(fault.name)
        made.append(Made(fault, link.count(edits) if link else len(edits), link.became if link else "messages changed"))
        data = spliced(data, edits)
        records = frames_in(data, table)
    return data, made


def inject_file(
    source: Path,
    target: Path,
    faults: Sequence[Fault],
    *,
    dialect: str = "all",
    sysid: int | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    seed: int = 0,
) -> list[Made]:
    """Write a copy of the recording `source` with the faults in it to `target`, as a whole or not at all.

    The arguments and errors are those of `inject`; a `source` that can't be read is a SourceError, a `target` that
    can't be written, or is the source itself, a UsageError. Returns what was made, fault by fault.
    """
    refuse_unwritable(target, sources=[source])
    with opened(source, []) as file:
        file.seek(0)
        data = file.read()
    try:
        falsified, made = _injected(data, faults, dialect=dialect, sysid=sysid, from_s=from_s, to_s=to_s, seed=seed)
    except GcsBridgeError as error:
        raise type(error)(f"{source}: {error}") from None
    write_file(falsified, target)
    return made


def _edits(records: RecordingFrames, scope: Scope, fault: Fault, chance: np.random.Generator) -> Iterable[Edit]:
    """What the fault does to the records in the scope."""
    if fault.name == "truncate":
        return LINK_FAULTS[fault.name].edits(records, fault.value, fault.message, chance)
    touched = records.where(scope.holds(records.frames))
    names = _messages(fault)
    for name in names:
        if name not in records.dialect:
            raise UsageError(f"the dialect {records.dialect.name} has no message {name!r}")
    of = {name: touched.where(touched.frames["msgid"] == records.dialect[name].msgid) for name in names}
    if not any(len(one.frames) for one in of.values()) and (names or not len(touched.frames)):
        raise StreamAbsentError(f"no {' or '.join(names) or 'record'}{scope.text} in the recording: nothing to falsify")
    if fault.name in LINK_FAULTS:
        return LINK_FAULTS[fault.name].edits(of.get(fault.message or "", touched), fault.value, fault.message, chance)
    cause = CAUSES[fault.name]
    return [edit for name, one in of.items() for edit in falsified(one, records.dialect[name], cause, fault.value)]


def _messages(fault: Fault) -> tuple[str, ...]:
    """The messages that the fault touches, none: all."""
    if fault.name in LINK_FAULTS:
        return () if fault.message is None else (fault.message,)
    return tuple({30: "ATTITUDE", 31: "ATTITUDE_QUATERNION"}[message] for message in CAUSES[fault.name].messages)
