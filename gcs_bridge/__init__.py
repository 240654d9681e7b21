"""gcs-bridge: judges, shows and explains the attitude that a MAVLink vehicle reports.

The public face: `read`, `iter_batches` and `check` take a recording, `Monitor` takes bytes as they come, `attitude` is
the math.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from gcs_bridge._version import __version__

if TYPE_CHECKING:
    from gcs_bridge import attitude
    from gcs_bridge.api import Monitor
    from gcs_bridge.recordings.batches import iter_batches
    from gcs_bridge.recordings.check import check
    from gcs_bridge.recordings.read import read

__all__ = ["Monitor", "__version__", "attitude", "check", "iter_batches", "read"]

_HOME = {
    "Monitor": "gcs_bridge.api",
    "iter_batches": "gcs_bridge.recordings.batches",
    "check": "gcs_bridge.recordings.check",
    "read": "gcs_bridge.recordings.read",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for when it is asked for: the command line must start before numpy has."""
    if name == "attitude":
        return importlib.import_module("gcs_bridge.attitude")
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    raise AttributeError(f"module 'gcs_bridge' has no attribute {name!r}")
