"""TOML files and flags → one frozen value; default < profile < file < flag.

In files, angles are degrees and their keys end in `_deg` (rates: `_deg_s`); here they become radians, once.
The structs below are the only list of keys, defaults and allowed ranges; `config/example.toml` explains them.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import FieldInfo, fields, replace

from gcs_bridge import resources
from gcs_bridge.errors import UsageError, one_line

__all__ = [
    "AlarmSettings",
    "AlignmentSettings",
    "BodyRatesSettings",
    "CheckSettings",
    "EulerQuaternionSettings",
    "FailOn",
    "GravitySettings",
    "GyroSettings",
    "KinematicsSettings",
    "MagHeadingSettings",
    "QuaternionNormSettings",
    "ResetSettings",
    "SecondaryEstimateSettings",
    "Settings",
    "SettingsError",
    "StreamSettings",
    "VehicleSettings",
    "load_settings",
    "profiles",
]

FailOn = Literal["warning", "alarm", "never"]

_Angle = Annotated[float, Meta(gt=0, le=math.pi)]
_Duration = Annotated[float, Meta(gt=0, le=3600)]
_Delay = Annotated[float, Meta(ge=0, le=3600)]
_Rate = Annotated[float, Meta(gt=0, le=100)]
_Share = Annotated[float, Meta(gt=0, lt=1)]
_Count = Annotated[int, Meta(ge=1, le=1000)]


class SettingsError(UsageError, ValueError):
    """A profile, file, key or value that cannot be used; one line that names it."""


class AlignmentSettings(Struct, frozen=True, kw_only=True):
    """How two streams become pairs at one instant."""

    max_gap_s: _Duration = 1.0
    same_instant_bound_rad: _Angle = math.radians(0.02)

    @property
    def max_gap_us(self) -> int:
        """The longest gap between samples that is bridged, µs."""
        return round(self.max_gap_s * 1e6)


class ResetSettings(Struct, frozen=True, kw_only=True):
    """When a step of the attitude is an estimator's reset."""

    step_rad: _Angle = math.radians(2.2)
    per_rate_s: Annotated[float, Meta(ge=0, le=1)] = 0.002


class AlarmSettings(Struct, frozen=True, kw_only=True):
    """Votes, delays and grouping of alarms, of every check that names no others."""

    bad_samples: _Count = 3
    counted_samples: _Count = 5
    window_s: _Duration = 5.0
    on_delay_s: _Delay = 1.0
    off_delay_s: _Delay = 2.0
    clear_below: Annotated[float, Meta(gt=0, le=1)] = 0.7
    repeat_s: _Delay = 30.0
    chatter_raises: _Count = 3
    chatter_window_s: _Duration = 60.0
    flood_raises: _Count = 10
    flood_window_s: _Duration = 600.0

    def __post_init__(self) -> None:
        if self.bad_samples > self.counted_samples:
            raise ValueError(
                f"bad_samples = {self.bad_samples} is more than counted_samples = {self.counted_samples}: "
                "the alarm could never be raised"
            )


class EulerQuaternionSettings(Struct, frozen=True, kw_only=True):
    """ATTITUDE against ATTITUDE_QUATERNION."""

    limit_rad: _Angle = math.radians(0.5)
    recurring_window_s: _Duration = 10.0
    usable_bound_rad: _Angle = math.radians(2.0)
    mean_limit_rad: _Angle = math.radians(0.3)
    mean_window_s: _Duration = 10.0
    mean_pairs: _Count = 8
    mean_hold_s: _Delay = 3.0


class QuaternionNormSettings(Struct, frozen=True, kw_only=True):
    """How far the norm of ATTITUDE_QUATERNION may be off 1."""

    warning: _Share = 1e-3
    alarm: _Share = 1e-2


class BodyRatesSettings(Struct, frozen=True, kw_only=True):
    """The rates of ATTITUDE against those of ATTITUDE_QUATERNION."""

    warning_rad_s: _Rate = math.radians(2.0)
    alarm_rad_s: _Rate = math.radians(10.0)


class KinematicsSettings(Struct, frozen=True, kw_only=True):
    """Each stream's rotation against its own rates; the limit of a step is [reset]'s."""

    slope_low: Annotated[float, Meta(gt=0, lt=1)] = 0.7
    slope_high: Annotated[float, Meta(gt=1, le=10)] = 1.4
    slope_window_s: _Duration = 10.0
    slope_least_hz: Annotated[float, Meta(gt=0, le=1000)] = 10.0
    slope_least_rad_s: _Rate = math.radians(5.0)


class GyroSettings(Struct, frozen=True, kw_only=True):
    """The IMU's gyro against the rates of the attitude, once its own bias is known."""

    warning_rad_s: _Rate = math.radians(5.0)
    alarm_rad_s: _Rate = math.radians(15.0)
    bias_time_s: _Duration = 30.0
    skipped_s: _Delay = 10.0
    usable_below_rad_s: Annotated[float, Meta(gt=0, le=1000)] = math.radians(1375.0)


class GravitySettings(Struct, frozen=True, kw_only=True):
    """The accelerometer's down against the attitude's, at rest; and in flight where they differ grossly."""

    warning_rad: _Angle = math.radians(5.0)
    alarm_rad: _Angle = math.radians(10.0)
    gross_rad: _Angle = math.radians(45.0)
    gross_window_s: _Duration = 3.0
    gross_below_rad_s: _Rate = math.radians(10.0)
    gross_bank_rad: _Angle = math.radians(30.0)
    still_below_m_s2: Annotated[float, Meta(gt=0, le=10)] = 0.3


class SecondaryEstimateSettings(Struct, frozen=True, kw_only=True):
    """AHRS2, the second estimate, against the first."""

    tilt_warning_rad: _Angle = math.radians(5.0)
    tilt_alarm_rad: _Angle = math.radians(10.0)
    heading_warning_rad: _Angle = math.radians(10.0)
    heading_alarm_rad: _Angle = math.radians(20.0)
    quiet_s: _Duration = 10.0
    quiet_below_rad_s: _Rate = math.radians(10.0)
    quiet_bank_rad: _Angle = math.radians(30.0)
    level_bank_rad: _Angle = math.radians(10.0)
    banked_times: Annotated[float, Meta(ge=1, le=10)] = 2.0
    skipped_s: _Delay = 30.0
    agreed_rad: _Angle = math.radians(5.0)
    agreed_s: _Duration = 10.0
    gross_rad: _Angle = math.radians(45.0)
    gross_s: _Delay = 5.0


class MagHeadingSettings(Struct, frozen=True, kw_only=True):
    """The compass against the attitude's heading: information, never an alarm."""

    information_rad: _Angle = math.radians(30.0)
    skipped_s: _Delay = 10.0
    quiet_below_rad_s: _Rate = math.radians(30.0)
    quiet_bank_rad: _Angle = math.radians(30.0)
    level_bank_rad: _Angle = math.radians(10.0)
    banked_times: Annotated[float, Meta(ge=1, le=10)] = 2.0


class StreamSettings(Struct, frozen=True, kw_only=True):
    """When a stream counts as stale, frozen or slow."""

    stale_periods: Annotated[float, Meta(gt=0, le=1000)] = 5.0
    stale_after_s: _Duration = 2.0
    frozen_after_s: _Duration = 2.0
    moved_rad: _Angle = math.radians(1.0)
    slow_below: Annotated[float, Meta(gt=0, lt=1)] = 0.5
    slow_after_s: _Duration = 5.0


class CheckSettings(Struct, frozen=True, kw_only=True):
    """The `check` command."""

    fail_on: FailOn = "alarm"


class VehicleSettings(Struct, frozen=True, kw_only=True):
    """What makes a vehicle."""

    attitude_run: _Count = 10


class TransmitSettings(Struct, frozen=True, kw_only=True):
    """As whom this program sends what it was asked to send."""

    system_id: Annotated[int, Meta(ge=1, le=254)] = 254
    component_id: Annotated[int, Meta(ge=1, le=255)] = 191


class Settings(Struct, frozen=True, kw_only=True):
    """Every setting; `Settings()` holds the built-in defaults."""

    alignment: AlignmentSettings = AlignmentSettings()
    reset: ResetSettings = ResetSettings()
    alarm: AlarmSettings = AlarmSettings()
    euler_quaternion: EulerQuaternionSettings = EulerQuaternionSettings()
    quaternion_norm: QuaternionNormSettings = QuaternionNormSettings()
    body_rates: BodyRatesSettings = BodyRatesSettings()
    kinematics: KinematicsSettings = KinematicsSettings()
    gyro: GyroSettings = GyroSettings()
    gravity: GravitySettings = GravitySettings()
    secondary_estimate: SecondaryEstimateSettings = SecondaryEstimateSettings()
    mag_heading: MagHeadingSettings = MagHeadingSettings()
    stream: StreamSettings = StreamSettings()
    check: CheckSettings = CheckSettings()
    vehicle: VehicleSettings = VehicleSettings()
    transmit: TransmitSettings = TransmitSettings()


def load_settings(
    profile: str = "default",
    config_file: Path | None = None,
    overrides: Mapping[str, Mapping[str, object]] | None = None,
) -> Settings:
    """Settings of a shipped profile, then a file, then flags, each changing what the former left.

    Raises SettingsError, whose one line names the file, the key and what would be right.
    """
    shipped = profiles()
    if profile not in shipped:
        raise SettingsError(f"unknown profile {profile!r}{_hint(profile, shipped)}")
    settings = Settings()
    for path in (shipped[profile], config_file):
        if path is not None:
            settings = _changed(settings, _read(path), origin=str(path))
    return _changed(settings, overrides or {}, origin="command line")


def profiles() -> dict[str, Path]:
    """The shipped profiles: name → file."""
    return {path.stem: path for path in sorted(resources.config_folder().glob("*.toml"))}


def _read(path: Path) -> dict[str, Any]:
    try:
        # Windows editors put a byte order mark first, which TOML does not know.
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}: name a TOML file that is there") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise SettingsError(f"{path}, line {line}: not UTF-8, so not TOML") from None
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers and nesting beyond Python's own limits included
        said = str(error)
        at = re.search(r"at line (\d+)", said)
        line = int(at[1]) if at else text.count("\n") + 1
        raise SettingsError(f"{path}, line {line}: not TOML: {re.sub(r' [(]at .*[)]$', '', said)}") from None


def _changed(settings: Settings, table: Mapping[str, object], *, origin: str) -> Settings:
    """The settings with what the table says; its keys are those of the files, in degrees."""
    sections: dict[str, Struct] = {field.name: getattr(settings, field.name) for field in fields(settings)}
    for name, values in table.items():
        if name not in sections:
            raise SettingsError(
                f"{origin}: unknown section [{name}]{_elsewhere(name, sections) or _hint(name, sections)}"
            )
        if not isinstance(values, Mapping):
            raise SettingsError(f"{origin}: {name} = {_shown(values)}: must be a section, [{name}]")
        known = _keys(sections[name])
        changes: dict[str, object] = {}
        for key, value in values.items():
            if key not in known:
                hint = _elsewhere(key, sections) or _hint(key, known)
                raise SettingsError(f"{origin}: unknown key {key!r} in [{name}]{hint}")
            try:
                changes[known[key].name] = _converted(value, known[key])
            except msgspec.ValidationError:
                raise SettingsError(
                    f"{origin}: [{name}] {key} = {_shown(value)}: must be {_allowed(known[key])}"
                ) from None
        try:
            sections[name] = replace(sections[name], **changes)
        except ValueError as error:  # values that are right each, but not together
            raise SettingsError(f"{origin}: [{name}] {error}") from None
    return replace(settings, **sections)


def _keys(section: Struct) -> dict[str, FieldInfo]:
    """A section's keys as files write them."""
    return {re.sub("_rad(?=$|_s$)", "_deg", field.name): field for field in fields(section)}


def _is_angle(field: FieldInfo) -> bool:
    return re.search("_rad(_s)?$", field.name) is not None


def _converted(value: object, field: FieldInfo) -> object:
    if _is_angle(field):
        value = math.radians(msgspec.convert(value, float))
    return msgspec.convert(value, field.type)


def _allowed(field: FieldInfo) -> str:
    """What a field's type and range allow, in words and in the file's unit."""
    kind = msgspec.inspect.type_info(field.type)
    if isinstance(kind, msgspec.inspect.LiteralType):
        return "one of " + ", ".join(f'"{value}"' for value in kind.values)
    said = "a whole number" if isinstance(kind, msgspec.inspect.IntType) else "a number"
    for word, bound in (("above", "gt"), ("at least", "ge"), ("below", "lt"), ("at most", "le")):
        limit = getattr(kind, bound, None)
        if limit is not None:
            said += f", {word} {math.degrees(limit) if _is_angle(field) else limit:g}"
    return said


def _elsewhere(key: str, sections: Mapping[str, Struct]) -> str:
    """A key in the wrong section, or in none, belongs somewhere."""
    homes = [f"[{name}]" for name, section in sections.items() if key in _keys(section)]
    return f"; the key {key} belongs in {' or '.join(homes)}" if homes else ""


def _hint(name: str, known: Iterable[str]) -> str:
    """The nearest right name, or all of them."""
    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {near[0]!r}?" if near else f"; known: {', '.join(known)}"


def _shown(value: object) -> str:
    try:
        text = one_line(repr(value))
    except ValueError:  # an integer with more digits than Python prints
        return "a huge number"
    return text if len(text) <= 40 else text[:39] + "…"
