"""Before the first test: the kernels are compiled, so that no process says so, or waits for it; no test is timed."""

import gc
import os
from collections.abc import Iterator

import hypothesis
import pytest

pytest.register_assert_rewrite("tests.helpers")


def pytest_xdist_auto_num_workers() -> int:
    """One more than processors: while one waits, for a second to pass or a program to start, others compute."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return processors + 1


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """What is collected stays to the end: the garbage collector need not look at it, now or in any test."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


# Their tests wait on real time, or on programs that they start.
_WAITING = ("tests/cli/test_listen.py", "tests/jit/", "tests/links/", "tests/sending/", "tests/sinks/", "tests/viewer/")


def pytest_configure(config: pytest.Config) -> None:
    """Hypothesis tries the same cases in every run, a third of those that are tried where sweeps are.

    New ones, by chance, where everything is run. By default a case that takes 0.2 s fails: on a busy machine each may.
    """
    from tests.helpers.everyday import ALL_CASES

    everything: bool = config.getoption("--sweeps")
    cases = ALL_CASES if everything or "sweep" in config.getoption("-m") else ALL_CASES // 3
    hypothesis.settings.register_profile("ours", deadline=None, derandomize=not everything, max_examples=cases)
    hypothesis.settings.load_profile("ours")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`pytest --sweeps` leaves nothing out."""
    parser.addoption("--sweeps", action="store_true", help="with every member of each heavy family, as CI does")


def _leave_out_sweeps(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Unless they are asked for, by `--sweeps`, by `-m` or by name."""
    if config.getoption("--sweeps") or "sweep" in config.getoption("-m") or any("::" in one for one in config.args):
        return
    sweeps = [item for item in items if item.get_closest_marker("sweep")]
    items[:] = [item for item in items if not item.get_closest_marker("sweep")]
    config.hook.pytest_deselected(items=sweeps)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """What waits begins first, each worker with its share of it: at the end no one waits alone for a last one.

    Each worker is given the next part of the list, and takes from the others once it has done that.
    """
    _leave_out_sweeps(config, items)
    workers: int = getattr(config, "workerinput", {}).get("workercount", 1)
    waiting = [item for item in items if item.nodeid.startswith(_WAITING)]
    others = [item for item in items if not item.nodeid.startswith(_WAITING)]
    share = -(-len(others) // workers)
    items[:] = [
        item
        for worker in range(workers)
        for item in (*waiting[worker::workers], *others[worker * share : (worker + 1) * share])
    ]


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """All kernels, however many workers begin at once: each compiles what no other does."""
    from gcs_bridge.jit import prepare

    prepare("gcs_bridge")
