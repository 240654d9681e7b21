"""Before the first test: the kernels are compiled, so that no process says so, or waits for it."""

import pytest

pytest.register_assert_rewrite("tests.helpers")

from gcs_bridge import Monitor  # noqa: E402  the helpers' asserts are rewritten first
from tests.helpers import wire  # noqa: E402


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    Monitor().feed_recording(wire.tlog(wire.flight(wire.Motion(2.0), 2.0)))
