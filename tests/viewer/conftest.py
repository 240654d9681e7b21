"""The tests of the viewer use the helpers of the folder above, and find the kernels compiled."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1]))


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """So that no process says that it compiles, or waits for it."""
    import wire

    from gcs_bridge.monitor import Monitor

    Monitor().feed_recording(wire.tlog(wire.flight(wire.Motion(2.0), 2.0)))
