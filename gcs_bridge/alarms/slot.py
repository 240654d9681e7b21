"""One alarm of one vehicle: where it stands, how it is announced, and the records of its excursions."""

from __future__ import annotations

from gcs_bridge.alarms.ballot import Ballot
from gcs_bridge.alarms.rated import Worst
from gcs_bridge.alarms.record import AlarmRecord, scale_of
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.state import (
    ANNOUNCEMENTS,
    PENDING,
    SHELVED,
    STANDING,
    SUPPRESSED,
    Announcement,
    AnnouncementSignal,
    Signal,
    State,
)


class AlarmSlot:
    """One alarm over all boots of a vehicle; but for being shelved, it begins anew with each."""

    def __init__(self, spec: AlarmSpec, ballot: Ballot) -> None:
        """Start normal, and told; `ballot` is where its samples are counted."""
        self.spec = spec
        self.scale = scale_of(spec.unit)
        self.announcement = Announcement.TOLD
        self._ballot, self.place = ballot, ballot.place_of(spec)
        self.start_boot()

    def start_boot(self) -> None:
        """Forget what counts within one boot alone."""
        self.announce(AnnouncementSignal.RELEASE)
        self.state = State.NORMAL  # as of what has been told: within a batch, the ballot is ahead of it
        self.record: AlarmRecord | None = None  # of the excursion that is pending or stands
        self.last: AlarmRecord | None = None  # the latest that was raised
        self._shown: tuple[AlarmRecord | None, float] = None, 0.0  # the worst of which record
        self.numbered = 0  # raises so far that were alarms of their own

    @property
    def worst(self) -> Worst:
        """The peak of its excursion, by all samples that it was given."""
        return self._ballot.worst(self.place)

    def show_worst(self) -> None:
        """Have its record show that, where it has become larger."""
        record, value = self._shown
        now = self._ballot.worst_value(self.place)
        if self.record is not None and (self.record is not record or now != value):
            self._shown = self.record, now
            self.record.show(self.worst)

    def acknowledge(self) -> None:
        """Somebody has seen it."""
        self.state = self._ballot.take_signal(self.place, Signal.ACKNOWLEDGE)

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
