"""What of recordings is judged, and how: the options that every command for recordings has."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from gcs_bridge.cli.signing_options import key_of, signing_options
from gcs_bridge.errors import UsageError

if TYPE_CHECKING:  # loaded when there is something to judge
    from gcs_bridge.settings import Settings

__all__ = ["Selection", "selection_options", "settings_options"]

_ROUNDS = 300_000
_Command = TypeVar("_Command", bound=Callable[..., Any])


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The options of `selection_options`, as given. UsageError for times that are none, or in the wrong order."""

    sysid: int | None
    from_s: float | None
    to_s: float | None
    signing_key_file: Path | None
    unsigned: str | None
    profile: str
    config: Path | None
    dialect: str

    def __post_init__(self) -> None:
        for option, value in (("--from", self.from_s), ("--to", self.to_s)):
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise UsageError(f"{option} {value:g}: must be seconds after the recording's start, 0 or more")
        if self.to_s is not None and self.to_s <= (self.from_s or 0.0):
            raise UsageError(f"--to {self.to_s:g} is not after --from {self.from_s or 0.0:g}: nothing would be judged")

    def settings(self, changed: Mapping[str, Any] | None = None) -> Settings:
        """The settings asked for. UsageError for what is wrong in them."""
        from gcs_bridge.settings import load_settings

        return load_settings(self.profile, self.config, changed)

    def window(self) -> dict[str, Any]:
        """What of a recording is judged, as arguments of a `Monitor`."""
        return {"dialect": self.dialect, "sysid": self.sysid, "from_s": self.from_s, "to_s": self.to_s}

    def digest(self) -> str:
        """Of all that a judgement depends on beside the recording and this version: the same for the same, short."""
        import hashlib

        import msgspec

        of_settings = msgspec.to_builtins(self.settings())
        del of_settings["check"]  # how a run ends is no part of what is judged
        key: str | None = None
        if self.signing_key_file is not None:  # slowly: who reads the digest must not be able to try pass phrases
            content = self.signing_key_file.read_bytes()
            key = hashlib.pbkdf2_hmac("sha256", content, b"gcs-bridge settings", _ROUNDS).hex()
        of_all = (of_settings, sorted(self.window().items()), self.unsigned, key)
        return hashlib.blake2b(msgspec.json.encode(of_all, order="sorted"), digest_size=6).hexdigest()

    def verified(self) -> dict[str, Any]:
        """By which key frames are verified, as arguments of a `Monitor`. UsageError where it is none."""
        return {"signing_key": key_of(self.signing_key_file, self.unsigned), "unsigned": self.unsigned}


def selection_options(does: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Give a command that `does` something with recordings the options of a `Selection`, as its `selection`."""

    def give(command: Callable[..., int]) -> Callable[..., int]:
        @wraps(command)
        def gathered(**given: Any) -> int:
            chosen = Selection(**{field.name: given.pop(field.name) for field in fields(Selection)})
            return command(selection=chosen, **given)

        start = "S seconds after the recording's start."
        for option in (
            settings_options,
            signing_options,
            click.option("--to", "to_s", type=float, metavar="S", help=f"End {start}"),
            click.option("--from", "from_s", type=float, metavar="S", help=f"Begin {start}"),
            click.option("--sysid", type=click.IntRange(1, 255), metavar="N", help=f"{does} this system alone."),
        ):
            gathered = option(gathered)
        return gathered

    return give


def settings_options(command: _Command) -> _Command:
    """Give a command `profile`, `config` and `dialect`."""
    config = click.Path(path_type=Path, readable=False)
    for option in (
        click.option("--dialect", default="all", metavar="NAME", help="MAVLink dialect to read with.  [all]"),
        click.option("--config", type=config, metavar="FILE", help="TOML with settings of your own."),
        click.option("--profile", default="default", metavar="NAME", help="Shipped settings: default, ci.  [default]"),
    ):
        command = option(command)
    return command
