"""Items made in another thread, one ahead: the same, in the same order, and no more of them at a time."""

from collections.abc import Iterator
from pathlib import Path
from threading import Event, Semaphore, Thread, active_count, get_ident

import msgspec
import pytest

import gcs_bridge
from gcs_bridge.recordings import source
from gcs_bridge.recordings.ahead import ahead, other_thread
from tests.helpers.everyday import one_in
from tests.helpers.paths import ROOT

DAMAGED = ROOT / "sitl_fixtures" / "h_lossy_dirty.tlog"


class Made:
    """Numbers from 0 on, which know how many of them were asked for; an error may be behind the last."""

    def __init__(self, last: int, error: Exception | None = None) -> None:
        self.last, self.error = last, error
        self.asked = 0

    def __iter__(self) -> Iterator[int]:
        for number in range(self.last + 1):
            self.asked += 1
            yield number
        if self.error is not None:
            raise self.error


@pytest.mark.parametrize("last", [-1, 0, 1, 100])
def test_the_same_items_in_their_order(last: int) -> None:
    """Nothing is lost at either end."""
    assert list(ahead(iter(Made(last)))) == list(range(last + 1))


def test_one_is_made_ahead_and_no_more() -> None:
    """Memory is bounded by two items, whatever their number."""
    made = Made(50)
    for number in ahead(iter(made)):
        assert made.asked <= number + 2


def test_one_other_thread_makes_them_all() -> None:
    """Each more would keep memory of its own."""
    made = Semaphore(0)

    def makers() -> Iterator[int]:
        for _ in range(50):
            made.release()
            yield get_ident()

    found = set()
    for number, maker in enumerate(ahead(makers())):
        if number == 0:
            made.acquire()  # the first one's, which this thread may have made
        else:
            found.add(maker)
        if number < 49:
            assert made.acquire(timeout=5.0)  # the next one is begun
    assert len(found) == 1
    assert get_ident() not in found


def test_who_asks_for_what_is_not_begun_does_it() -> None:
    """Nobody waits for a thread that does something else."""
    hold = Event()
    with other_thread() as other:
        held = other(lambda: hold.wait(5.0))
        assert other(get_ident)() == get_ident()
        hold.set()
        assert held()


def test_where_no_thread_can_be_had_this_one_does_it_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit of processes, which threads count to, makes it slower and nothing else."""
    monkeypatch.setattr(Thread, "start", refuse)
    assert list(ahead(iter(Made(20)))) == list(range(21))
    with other_thread() as other:
        assert other(get_ident)() == get_ident()


def refuse(_: Thread) -> None:
    """As Python does."""
    raise RuntimeError("can't start new thread")


def test_an_error_comes_in_its_place() -> None:
    """Behind the items that were made before it."""
    items = ahead(iter(Made(2, OSError("it is gone"))))
    assert [next(items) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(OSError, match="it is gone"):
        next(items)


def test_who_stops_early_leaves_no_thread_at_work() -> None:
    """The item that was being made is the last."""
    made = Made(1000)
    items = ahead(iter(made))
    before = active_count()
    assert next(items) == 0
    assert active_count() == before + 1
    items.close()  # type: ignore[attr-defined]  # it is a generator
    assert made.asked <= 2
    assert active_count() == before


@pytest.mark.slow
@pytest.mark.parametrize("piece", one_in(3, [701, 10_007, 10**9]))
def test_a_damaged_recording_is_judged_alike_in_two_threads_and_in_one(
    piece: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the size of the pieces: the report is the one that a Monitor makes of all of its bytes at once."""
    data = DAMAGED.read_bytes()[:150_000]
    path = tmp_path / "damaged.tlog"
    path.write_bytes(data)
    monkeypatch.setattr(source, "_CHUNK", piece)
    in_two = gcs_bridge.check(path).to_dict()["files"][0]
    monitor = gcs_bridge.Monitor()
    monitor.feed_recording(data)
    in_one = monitor.close().to_dict()["files"][0]
    assert in_two["salvage"]["skipped_bytes"] > 0
    assert msgspec.json.encode(in_two | {"path": ""}) == msgspec.json.encode(in_one | {"path": ""})
