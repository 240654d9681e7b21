"""Before the first test: the kernels are compiled, so that no process says so, or waits for it."""

import pytest

pytest.register_assert_rewrite("tests.helpers")


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """All kernels, however many workers begin at once: each compiles what no other does."""
    from gcs_bridge.jit import prepare

    prepare("gcs_bridge")
