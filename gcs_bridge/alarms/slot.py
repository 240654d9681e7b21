"""One alarm of one vehicle: where it stands, how it is announced, and the records of its excursions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.record import AlarmRecord
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.state import (
    ANNOUNCEMENTS,
    PENDING,
    SHELVED,
    STANDING,
    SUPPRESSED,
    Alarm,
    Announcement,
    AnnouncementSignal,
    Change,
    Signal,
    State,
)


class AlarmSlot:
    """One alarm over all boots of a vehicle; but for being shelved, it begins anew with each."""

    def __init__(self, spec: AlarmSpec) -> None:
        """Start normal, and told."""
        self.spec = spec
        self.announcement = Announcement.TOLD
        self.start_boot()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        self.announce(AnnouncementSignal.RELEASE)
        self.alarm = Alarm(self.spec.delays, self.spec.recurring_window_s)
        self.state = State.NORMAL  # as of what has been told: within a batch, `alarm` is ahead of it
        self.record: AlarmRecord | None = None  # of the excursion that is pending or stands
        self.last: AlarmRecord | None = None  # the latest that was raised
        self.numbered = 0  # raises so far that were alarms of their own

    @property
    def is_pending(self) -> bool:
        """Whether it waits for its on-delay."""
        return self.state in PENDING

    @property
    def stands(self) -> bool:
        """Whether it was raised, suppressed or not, and has not gone."""
        return self.state in STANDING

    @property
    def is_repeat(self) -> bool:
        """Whether the excursion is the last alarm again, and so has its id."""
        return self.last is not None and self.record is not None and self.record.id == self.last.id

    @property
    def is_suppressed(self) -> bool:
        """Whether it stands beside an alarm of the same check, which says it already."""
        return self.announcement in SUPPRESSED

    @property
    def is_shelved(self) -> bool:
        """Whether somebody wants to hear nothing of it."""
        return self.announcement in SHELVED

    def announce(self, signal: AnnouncementSignal) -> None:
        """Take what may change how it is announced."""
        self.announcement = ANNOUNCEMENTS.get((self.announcement, signal), self.announcement)

    def advance(
        self, samples: Rated | None, signals: Iterable[tuple[int, Signal | None]]
    ) -> Iterator[tuple[int, Change]]:
        """Take samples and, between them, signals, each with its frame; yield what changes, with the frame of it.

        None is no signal: a change to the same state says then where the alarm is with that frame.
        """
        for frame_index, signal in sorted(signals, key=lambda one: one[0]):
            if samples is not None:
                until = int(np.searchsorted(samples.frame_index, frame_index))
                yield from self._feed(samples[:until])
                samples = samples[until:]
            before = after = self.alarm.state
            if signal is not None:
                before, after = self.alarm.signal(signal)
            if before is not after or signal is None:
                change = Change(place=-1, before=before, state=after, t_boot_us=0, worst=self.alarm.worst)
                yield frame_index, change
        if samples is not None:
            yield from self._feed(samples)

    def _feed(self, samples: Rated) -> Iterator[tuple[int, Change]]:
        for change in self.alarm.feed(samples):
            yield int(samples.frame_index[change.place]), change
