"""Before the first test here: the kernels are compiled, so that no process says so, or waits for it."""

import pytest
from live_links import fixture, tlog_of

from gcs_bridge.monitor import Monitor


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    Monitor().feed_recording(tlog_of(fixture("d_plane_pitchtrim3", to_s=1)))
