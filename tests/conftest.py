"""Before the first test: the kernels are compiled, so that no process says so, or waits for it; no test is timed."""

import hypothesis
import pytest

# By default a case that takes 0.2 s fails: on a busy machine each of them may.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")
pytest.register_assert_rewrite("tests.helpers")


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """All kernels, however many workers begin at once: each compiles what no other does."""
    from gcs_bridge.jit import prepare

    prepare("gcs_bridge")
