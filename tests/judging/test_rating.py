"""Large batches, judged in two threads: what comes out is what one thread says, to the last bit."""

import json
from collections.abc import Callable, Iterator
from typing import TypeVar

import pytest

from gcs_bridge.checks.quaternion_norm import QuaternionNorm
from gcs_bridge.judging import rating
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.judging.rating import Beside
from gcs_bridge.recordings.ahead import other_thread
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from tests.helpers.paths import FIXTURES

Made = TypeVar("Made")


class Counted:
    """Begins things in another thread, and counts them."""

    def __init__(self, other: Beside) -> None:
        self.begun = 0
        self._other = other

    def __call__(self, make: Callable[[], Made], /) -> Callable[[], Made]:
        self.begun += 1
        return self._other(make)


@pytest.fixture
def counted() -> Iterator[Counted]:
    """Things in another thread, which ends with the test."""
    with other_thread() as other:
        yield Counted(other)


def story(data: bytes, piece: int, counted: Counted | None = None) -> tuple[str, str]:
    """Events and report of a recording in pieces."""
    monitor = Monitor(beside=counted)
    events = [one for at in range(0, len(data), piece) for one in monitor.feed_recording(data[at : at + piece])]
    return repr(events), json.dumps(monitor.close().to_dict())


@pytest.mark.parametrize(
    ("name", "begin", "end", "fault", "shows"),
    [
        ("k8_stream_stops", 130_500, 144_600, None, "AlarmRaised"),  # 31 stops
        ("b_copter_acro", 0, 100_000, "quaternion_unnormalised", "check='quaternion_norm'"),
    ],
)
def test_two_threads_say_what_one_says(
    name: str,
    begin: int,
    end: int,
    fault: str | None,
    shows: str,
    counted: Counted,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Events, alarms, verdicts and numbers; streams that stop and come back send signals to alarms meanwhile."""
    monkeypatch.setattr(rating, "_WORTH_IT", 1)
    data = (FIXTURES / f"{name}.tlog").read_bytes()[begin:end]
    if fault is not None:
        data = inject(data, [parse_fault(fault)])
    one, both = story(data, 3_000), story(data, 3_000, counted)
    assert shows in one[0] + one[1]
    assert counted.begun > 3
    assert both == one


def test_what_goes_wrong_in_the_other_thread_is_raised(counted: Counted, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not swallowed, and not left behind in a thread."""

    def fail(*_: object) -> None:
        raise RuntimeError("it broke")

    monkeypatch.setattr(rating, "_WORTH_IT", 1)
    monkeypatch.setattr(QuaternionNorm, "judge", fail)
    data = (FIXTURES / "e_two_vehicles.tlog").read_bytes()[:60_000]
    with pytest.raises(RuntimeError, match="it broke"):
        story(data, 30_000, counted)


def test_few_messages_begin_no_thread(counted: Counted) -> None:
    """A live batch is short: a thread would take longer than all checks."""
    story((FIXTURES / "e_two_vehicles.tlog").read_bytes()[:60_000], 5_000, counted)
    assert counted.begun == 0
