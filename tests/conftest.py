"""Before the first test: the kernels are compiled, so that no process says so, or waits for it."""

import pytest

pytest.register_assert_rewrite("tests.helpers")

from gcs_bridge import Monitor  # noqa: E402, F401  with it come all kernels
from gcs_bridge.jit import prepare  # noqa: E402


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    prepare("gcs_bridge")
