"""The ballot of a vehicle's alarms: signals count once, and alarms may be given their samples in two threads."""

import numpy as np
from msgspec.structs import replace

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.state import Signal
from gcs_bridge.settings import AlarmSettings
from tests.helpers.alarms import spec

AT_ONCE = AlarmSettings(bad_samples=1, counted_samples=1, on_delay_s=0.0, off_delay_s=0.0)
PATIENT = replace(AT_ONCE, on_delay_s=100.0)


def bad(*frame_indices: int) -> Rated:
    """Bad samples with these frames, a second apart."""
    n = len(frame_indices)
    return Rated(
        frame_index=np.array(frame_indices),
        t_boot_us=1_000_000 * np.array(frame_indices),
        value=np.full(n, 5.0),
        limit=np.ones(n),
        bad=np.ones(n, np.bool_),
        low=np.zeros(n, np.bool_),
        detail=np.full((n, 5), np.nan),
    )


def changes(ballot: Ballot) -> list[tuple[int, int, str]]:
    return [(one.alarm, one.frame_index, one.change.state.value) for one in ballot.changes()]


def test_a_signal_that_a_sample_followed_is_not_taken_again() -> None:
    """Lost and found before the sample that makes it pending: a signal that comes later leaves it so."""
    patient = spec(PATIENT)
    ballot = Ballot([patient])
    ballot.signal(0, [(0, Signal.LOST), (1, Signal.FOUND)])
    ballot.rate(patient, bad(2))
    ballot.signal(0, [(9, None)])
    assert changes(ballot) == [(0, 0, "no_compare"), (0, 1, "normal"), (0, 2, "pending"), (0, 9, "pending")]


def test_signals_of_two_turns_are_taken_in_the_order_of_their_frames() -> None:
    """What no sample followed yet waits beside what is new."""
    patient = spec(PATIENT)
    ballot = Ballot([patient])
    ballot.signal(0, [(5, Signal.LOST)])
    ballot.votes(1)
    ballot.signal(0, [(3, Signal.BROKEN), (7, Signal.FOUND)])
    ballot.rate(patient, bad(6))
    assert changes(ballot) == [(0, 3, "inop"), (0, 7, "normal")]


def test_alarms_that_another_thread_votes_on() -> None:
    """Each has its own samples and its signals, and all that changed is told by the one ballot, batch after batch."""
    first, second = spec(AT_ONCE), spec(PATIENT)
    ballot = Ballot([first, second])
    ballot.signal(1, [(0, Signal.LOST), (1, Signal.FOUND)])
    with ballot.apart() as apart:
        apart.rate(second, bad(2))
        ballot.rate(first, bad(4))
    assert sorted(changes(ballot)) == [
        (0, 4, "pending"),
        (0, 4, "raised"),
        (1, 0, "no_compare"),
        (1, 1, "normal"),
        (1, 2, "pending"),
    ]
    with ballot.apart() as apart:
        apart.rate(second, bad(200))
    assert changes(ballot) == [(1, 200, "raised")]
    with ballot.apart():
        pass
    assert changes(ballot) == []
