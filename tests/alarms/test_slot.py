"""One alarm between its samples and what is told of it: signals take effect where their frames are."""

import numpy as np

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.slot import AlarmSlot
from gcs_bridge.alarms.state import Announcement, AnnouncementSignal, Signal, State
from gcs_bridge.settings import AlarmSettings
from tests.helpers.alarms import Alarm, spec

AT_ONCE = AlarmSettings(bad_samples=1, counted_samples=1, on_delay_s=0.0, off_delay_s=0.0)


def samples(*values: float) -> Rated:
    """One a frame from frame 0 on, a second apart; above 1 is bad, any other is low."""
    value, frame_index = np.array(values), np.arange(len(values))
    return Rated(
        frame_index=frame_index,
        t_boot_us=1_000_000 * frame_index,
        value=value,
        limit=np.ones(len(value)),
        bad=value > 1,
        low=value <= 1,
        detail=np.full((len(values), 5), np.nan),
    )


def changes(rated: Rated | None, *signals: tuple[int, Signal | None]) -> list[tuple[int, str, float]]:
    found = Alarm(AT_ONCE).feed(rated, signals)
    return [(one.frame_index, one.change.state.value, one.change.worst.value) for one in found]


def test_a_signal_comes_between_the_samples() -> None:
    """Lost with frame 2, whose own sample comes behind it; of two signals the earlier frame is first."""
    assert changes(samples(0, 0, 5), (2, Signal.LOST)) == [(2, "no_compare", -1.0)]
    assert changes(samples(0, 0, 0, 5), (2, Signal.FOUND), (1, Signal.LOST)) == [
        (1, "no_compare", -1.0),
        (2, "normal", -1.0),
        (3, "pending", 5.0),
        (3, "raised", 5.0),
    ]


def test_a_signal_without_samples() -> None:
    """What changes nothing is not told."""
    assert changes(None, (7, Signal.LOST), (8, Signal.LOST)) == [(7, "no_compare", -1.0)]


def test_where_the_alarm_is_with_a_frame() -> None:
    """No signal asks for the peak so far: of the samples before that frame, not of those behind it."""
    found = changes(samples(5, 6, 9), (2, None))
    assert found == [(0, "pending", 5.0), (0, "raised", 5.0), (2, "raised", 6.0)]


def test_each_sample_counts_once() -> None:
    """What came before a signal is not taken again behind it."""
    assert changes(samples(5, 0, 0), (2, None)) == [
        (0, "pending", 5.0),
        (0, "raised", 5.0),
        (1, "clearing", 5.0),
        (1, "returned", 5.0),
        (2, "returned", 5.0),
    ]


def test_a_new_boot_forgets_all_but_the_shelf() -> None:
    """What was shelved stays so; what was suppressed is over with the boot."""
    made_up = spec(AT_ONCE)
    ballot = Ballot([made_up])
    slot = AlarmSlot(made_up, ballot)
    ballot.rate(made_up, samples(5))
    slot.state = State.RAISED
    slot.announce(AnnouncementSignal.SUPPRESS)
    slot.announce(AnnouncementSignal.SHELVE)
    ballot.start_boot()
    slot.start_boot()
    assert (slot.state, slot.announcement) == (State.NORMAL, Announcement.SHELVED)
    assert [state for state, *_ in ballot.now()] == [State.NORMAL]
