"""How many came, how often, with what gaps and losses: worked by hand, in any pieces."""

from itertools import pairwise

import numpy as np
import pytest

from gcs_bridge.telemetry.stream_counts import StreamCount

MS = 1000


def times(*ms: int) -> np.ndarray:
    return MS * np.array(ms, np.int64)


@pytest.mark.parametrize("cuts", [(), (1,), (1, 2, 3, 4)])
def test_a_silence_is_a_gap_and_no_part_of_the_rate(cuts: tuple[int, ...]) -> None:
    """Ten a second, once three seconds of nothing: the rate is that of the time in which it came."""
    count, t_us = StreamCount(), times(0, 100, 200, 3200, 3300)
    for lo, hi in pairwise([0, *cuts, len(t_us)]):
        count.add(t_us[lo:hi])
    entry = count.entry()
    assert (entry.count, entry.rate_hz, entry.max_gap_s, entry.lost, entry.invalid) == (5, 10.0, 3.0, None, 0)


def test_a_stream_slower_than_silences_has_its_rate_over_all() -> None:
    """One in four seconds."""
    count = StreamCount()
    count.add(times(0, 4000, 8000))
    assert count.rate_hz == 0.25


def test_nothing_or_one_has_no_rate() -> None:
    """Nor a gap."""
    count = StreamCount()
    count.add(times())
    count.add(times(700))
    assert (count.count, count.rate_hz, count.entry().max_gap_s) == (1, None, None)


def test_no_interval_leads_into_another_boot() -> None:
    """The clock starts anew, near zero."""
    count = StreamCount()
    count.add(times(50_000, 50_100))
    count.start_boot()
    count.add(times(1000, 1100))
    assert (count.count, count.rate_hz, count.entry().max_gap_s) == (4, 10.0, 0.1)


def taken(
    count: StreamCount,
    rows: list[tuple[int, int, int]],
    period_ms: int = 100,
    *,
    valid: bool = True,
    rx_ms: list[int] | None = None,
) -> None:
    """Samples of stream 1 (ms, frames lost so far) among others: (message, ms, lost)."""
    message, ms, lost = (np.array(column, np.int64) for column in zip(*rows, strict=True))
    of = np.full(int((message == 1).sum()), valid)
    count.add_stream(
        1,
        message,
        MS * ms,
        MS * ms if rx_ms is None else MS * np.array(rx_ms, np.int64),
        lost,
        np.full(len(rows), MS * period_ms),
        of,
    )


def test_as_many_are_lost_as_there_was_room_for_and_as_the_sequence_misses() -> None:
    """Three periods' room and five frames lost: two; later room for nine, and only one frame lost: one."""
    count = StreamCount()
    taken(count, [(1, 0, 7), (0, 50, 7), (1, 300, 12), (0, 900, 12), (1, 1300, 13), (1, 1400, 30)])
    assert count.entry().lost == 2 + 1 + 0
    assert count.count == 4


def test_one_that_comes_late_was_counted_before() -> None:
    """The sequence counts one less, and so does the stream: also where it never had room for a loss."""
    count = StreamCount()
    taken(count, [(1, 0, 0), (1, 200, 1)])
    assert count.entry().lost == 1
    taken(count, [(1, 100, 0)])
    assert count.entry().lost == 0
    taken(count, [(1, 150, -1)])
    assert count.entry().lost == -1


def test_samples_without_an_attitude_are_counted_as_such() -> None:
    """Two of four."""
    count = StreamCount()
    taken(count, [(1, 0, 0), (1, 100, 0)], valid=False)
    taken(count, [(1, 200, 0), (1, 300, 0)])
    assert (count.count, count.invalid) == (4, 2)


@pytest.mark.parametrize("stuck_ms", [0, 77_000])
def test_a_rate_is_told_by_receipt_where_the_times_stand_still(stuck_ms: int) -> None:
    """Twenty a second, all with one time, once three seconds of nothing: twenty a second."""
    count = StreamCount()
    rx_ms = [*range(0, 1000, 50), *range(4000, 5000, 50)]
    for part in (slice(0, 7), slice(7, None)):
        taken(count, [(1, stuck_ms, 0)] * len(rx_ms[part]), rx_ms=rx_ms[part])
    assert count.stands
    assert (count.count, count.rate_hz) == (40, 20.0)


def test_each_sample_twice_is_no_clock_that_stands() -> None:
    """Ten a second by their own times, whenever they came."""
    count = StreamCount()
    rows = [(1, ms, 0) for ms in range(0, 2000, 100) for _ in range(2)]
    taken(count, rows, rx_ms=list(range(len(rows))))
    assert not count.stands
    assert count.rate_hz == 10.0
