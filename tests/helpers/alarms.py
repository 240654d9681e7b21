"""One alarm by itself, without a manager."""

from collections.abc import Iterable

import numpy as np

from gcs_bridge.alarms.ballot import AlarmChange, Ballot
from gcs_bridge.alarms.rated import Rated, Worst
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.state import Signal, State
from gcs_bridge.alarms.votes import forget_samples
from gcs_bridge.settings import AlarmSettings


def spec(delays: AlarmSettings, recurring_window_s: float = 0.0) -> AlarmSpec:
    """Of a check that is made up."""
    return AlarmSpec(
        check="made_up",
        name="alarm",
        id_part="made_up",
        severity="alarm",
        what="it is bad",
        not_a_sign_of="not of anything else",
        unit="1",
        delays=delays,
        recurring_window_s=recurring_window_s,
    )


class Alarm:
    """A ballot with one alarm on it."""

    def __init__(self, delays: AlarmSettings, recurring_window_s: float = 0.0) -> None:
        self._spec = spec(delays, recurring_window_s)
        self._ballot = Ballot([self._spec])

    @property
    def state(self) -> State:
        return self._ballot.state(0)

    def start_in(self, state: State) -> None:
        """Be in this state, however one gets there."""
        self._ballot.votes(0).alarm["state"][0] = list(State).index(state)

    @property
    def worst(self) -> Worst:
        return self._ballot.worst(0)

    def feed(self, rated: Rated | None, signals: Iterable[tuple[int, Signal | None]] = ()) -> list[AlarmChange]:
        """Take samples and, between them, signals, each with its frame; what changes."""
        self._ballot.signal(0, signals)
        if rated is not None:
            self._ballot.rate(self._spec, rated)
        return self._ballot.changes()

    def forget_samples(self) -> None:
        """Its samples so far have no vote any more."""
        votes = self._ballot.votes(0)
        forget_samples(votes._replace(alarm=votes.alarm.view(np.recarray)), 0)  # as kernels see it

    def signal(self, signal: Signal) -> tuple[State, State]:
        """Take a signal at once; the state before it and behind it."""
        return self.state, self._ballot.take_signal(0, signal)
