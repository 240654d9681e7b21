"""Where the shipped data are: inside the package in a wheel, at the top of the checkout otherwise."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from gcs_bridge.errors import UsageError

__all__ = ["config_folder", "demo_recording", "json_schema"]

_PACKAGE = Path(__file__).parent


def config_folder() -> Path:
    """The folder of the shipped profiles, one TOML file each."""
    return _shipped(in_wheel="config", in_checkout="config")


def demo_recording() -> Path:
    """The bundled recording of a simulated copter that flies a square; its two attitude messages agree."""
    return _shipped(in_wheel="demo.tlog", in_checkout="sitl_fixtures/a_copter_square.tlog")


def json_schema(of: Literal["report", "event", "doctor"]) -> Path:
    """The JSON Schema (draft 2020-12) of a report, of one event, or of what the doctor tells."""
    return _PACKAGE / "schema" / f"{of}.json"


def _shipped(*, in_wheel: str, in_checkout: str) -> Path:
    for path in (_PACKAGE / "_data" / in_wheel, _PACKAGE.parent / in_checkout):
        if path.exists():
            return path
    raise UsageError(f"{in_checkout} is missing from this installation: install gcs-bridge again")
