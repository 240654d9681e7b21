"""Samples of one instant in two streams, against a search through all of them."""

import numpy as np
import pytest

from gcs_bridge.pairing.instants import Stamps, same_instants

Sample = tuple[int, int]  # frame, time


def expected(a: list[Sample], b: list[Sample], after: int, reach: int) -> list[tuple[int, int]]:
    """Every pair of equal times, by the frame that completes it, if the other was among the last `reach` by then."""
    found = []
    for i, (frame_a, t_a) in enumerate(a):
        for j, (frame_b, t_b) in enumerate(b):
            completed = max(frame_a, frame_b)
            if t_a != t_b or completed <= after:
                continue
            came = [sum(frame <= completed for frame, _ in of) for of in (a, b)]
            if came[0] - i <= reach and came[1] - j <= reach:
                found.append((completed, i, j))
    return [(i, j) for _, i, j in sorted(found)]


def matched(a: list[Sample], b: list[Sample], after: int, reach: int) -> list[tuple[int, int]]:
    stamps = [Stamps(*(np.array([one[k] for one in of], np.int64) for k in (0, 1))) for of in (a, b)]
    i, j = same_instants(stamps[0], stamps[1], after, reach)
    return list(zip(i.tolist(), j.tolist(), strict=True))


@pytest.mark.parametrize("seed", range(20))
def test_every_pair_once_as_it_is_completed(seed: int) -> None:
    """Streams of different rates, one behind the other or bunched, with instants that only one of them has."""
    rng = np.random.default_rng(seed)
    streams: tuple[list[Sample], list[Sample]] = ([], [])
    times = [sorted(rng.choice(40, 30, replace=False).tolist()) for _ in streams]
    frame = 0
    while any(times):
        k = int(rng.integers(2)) if all(times) else int(not times[0])
        for _ in range(min(int(rng.integers(1, 8)), len(times[k]))):
            streams[k].append((frame, times[k].pop(0)))
            frame += int(rng.integers(1, 3))
    for after in (-1, frame // 2, frame):
        for reach in (1, 4, 64):
            assert matched(*streams, after, reach) == expected(*streams, after, reach)


def test_streams_that_never_meet() -> None:
    """Nothing, and nothing of an empty one."""
    assert matched([(0, 10), (2, 30)], [(1, 20), (3, 40)], -1, 64) == []
    assert matched([], [(1, 20)], -1, 64) == matched([(1, 20)], [], -1, 64) == []
