"""What reports and events have in common, typed: the field names are the keys of the contract's JSON.

The JSON Schemas in `schema/` are made of these structs, their docstrings and descriptions: `python tools/schema.py`.
Numbers are plain ones, unknown is None (`known`), and text is such that it can be written (`readable`).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

Severity = Literal["warning", "alarm"]
Grouped = Literal["repeat", "chatter", "flood"]
Confidence = Literal["certain", "probable", "unknown"]
Value = float | tuple[float, ...] | None


class Stream(Struct, frozen=True, kw_only=True):
    """What came of one message."""

    count: Annotated[int, Meta(description="messages that came, those that could not be used included")]
    rate_hz: Annotated[float | None, Meta(description="over the time in which it came, Hz; silences are no part of it")]
    max_gap_s: Annotated[float | None, Meta(description="the longest time from one message to the next, s")]
    lost: Annotated[int | None, Meta(description="that went missing; null where it cannot be told")]
    invalid: Annotated[int, Meta(description="that held NaN, infinity or a quaternion of norm zero")]


class Distribution(Struct, frozen=True, kw_only=True):
    """How large the values were, in the check's unit; null where there was none."""

    median: float | None
    p95: float | None
    p99: float | None
    max: float | None


class ExplainedBy(Struct, frozen=True, kw_only=True):
    """A difference that the firmware makes on purpose, undone before judging."""

    cause: Annotated[str, Meta(description="ahrs_trim, pitch_trim or vtol_view")]
    value: Annotated[float | tuple[float, ...], Meta(description="in `unit`; of ahrs_trim about the body's x and y")]
    unit: str
    estimated: Annotated[bool, Meta(description="fitted to the data, as the vehicle did not tell it")]
    alternatives: Annotated[tuple[str, ...], Meta(description="what would explain as well what was fitted")]


class Diagnosis(Struct, frozen=True, kw_only=True):
    """Which mistake explains a disagreement. Value and residuals are what the mistake added: undoing it subtracts."""

    cause: Annotated[str, Meta(description="the cause, or two joined by +; unknown where nothing explains it")]
    causes: Annotated[tuple[str, ...], Meta(description="the same apart, in the order of undoing")]
    confidence: Confidence
    distinguishable: Annotated[bool, Meta(description="the motion seen tells the cause from all others")]
    candidates: Annotated[tuple[str, ...], Meta(description="at most four, each of which really fits, likeliest first")]
    side: Annotated[Literal[30, 31] | None, Meta(description="id of the message at fault; null if it can't be told")]
    value: Annotated[Value, Meta(description="in `unit`; x, y, z of mount_offset, x, y of ahrs_trim, in body axes")]
    unit: str | None
    residual: Annotated[float | None, Meta(description="median of what is left once the cause is undone, deg")]
    next_best: Annotated[float | None, Meta(description="the same of the best of all other causes, deg")]
    fix: Annotated[str, Meta(description="what to do about it, or which motion would tell the candidates apart")]


# Of an alarm, in the report and in its events.
AlarmId = Annotated[str, Meta(description="of the alarm, unique among all vehicles of all links")]
BootIndex = Annotated[int, Meta(description="which boot of the vehicle, from 0")]
What = Annotated[str, Meta(description="what the alarm says")]
IsNot = Annotated[str, Meta(description="what it is, and what it is no sign of")]
RaisedBoot = Annotated[float | None, Meta(description="first raise, s of boot time; null while it is pending")]
ClearedBoot = Annotated[float | None, Meta(description="s of boot time; null as long as it was not seen to go")]
RaisedUtc = Annotated[str | None, Meta(description="receive time of the first raise, ISO 8601")]
Unit = Annotated[str, Meta(description="of `peak`; empty where that says no more than that it is so")]
Peak = Annotated[float, Meta(description="the largest difference")]
Axis = Annotated[str | None, Meta(description="where the difference lies: tilt, heading, or about a body axis")]
Tilt = Annotated[float | None, Meta(description="deg, of the second attitude seen from the first")]
Heading = Annotated[float | None, Meta(description="deg, of the second seen from the first; null near the vertical")]
RotvecBody = Annotated[
    tuple[float, float, float] | None,
    Meta(description="the difference in body axes x, y, z: a rotation vector, deg, or rates, deg/s"),
]
Repeats = Annotated[int, Meta(description="further raises that belong to it")]
GroupedBy = Annotated[Grouped | None, Meta(description="why they belong to it")]


class Alarm(Struct, kw_only=True):
    """A warning or an alarm, with the difference at its peak."""

    id: AlarmId
    check: Annotated[str, Meta(description="name of the check that raised it")]
    severity: Severity
    boot: BootIndex
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


def known(value: float | None) -> float | None:
    """A plain number; None for NaN and infinity.

    >>> known(1.5), known(float("nan"))
    (1.5, None)
    """
    return None if value is None or not math.isfinite(value) else float(value)


def readable(text: str) -> str:
    r"""The text with undecodable bytes spelled out: names of files and devices may hold some.

    >>> readable("flight\udcff.tlog")
    'flight\\xff.tlog'
    """
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def plain(struct: Struct) -> Any:
    """A struct as JSON's own types: dicts, lists, numbers, None."""
    return msgspec.json.decode(msgspec.json.encode(struct))
