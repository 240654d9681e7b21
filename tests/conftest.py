"""Before the first test: the kernels are compiled, so that no process says so, or waits for it."""

import fcntl
import os

import pytest

pytest.register_assert_rewrite("tests.helpers")


@pytest.fixture(scope="session", autouse=True)
def _compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """One worker compiles; the others wait for it, and load what it has compiled."""
    from gcs_bridge import Monitor  # here: who only hands out tests to workers needs neither
    from tests.helpers import wire

    folder = tmp_path_factory.getbasetemp()
    with ((folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder) / "compiling").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        Monitor().feed_recording(wire.tlog(wire.flight(wire.Motion(2.0), 2.0)))
