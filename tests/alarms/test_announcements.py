"""How alarms are announced, by a manager that is fed by hand: suppressed beside a severer one, and shelved.

Without delays and votes: each step is one frame, a second behind the last, that brings a sample for each alarm.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from gcs_bridge.alarms.manager import AlarmManager, AlarmTransition, SignalAt
from gcs_bridge.alarms.rated import Rated
from gcs_bridge.alarms.slot import AlarmSlot
from gcs_bridge.alarms.spec import AlarmSpec
from gcs_bridge.alarms.state import ANNOUNCEMENTS, Announcement, AnnouncementSignal, Signal
from gcs_bridge.errors import UsageError
from gcs_bridge.events import Notice
from gcs_bridge.settings import AlarmSettings
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import LinkClock
from tests.helpers import wire

GOOD, BAD = 0.1, 5.0
WARNING_ID, ALARM_ID = "1.1-level-warning-0-1", "1.1-level-0-1"
Told = list[tuple[str, str]]  # what, and of which alarm

AT_ONCE = AlarmSettings(bad_samples=1, counted_samples=1, on_delay_s=0.0, off_delay_s=0.0)
ALARM = AlarmSpec(
    check="level",
    name="alarm",
    id_part="level",
    severity="alarm",
    what="far too high",
    not_a_sign_of="not of a leak",
    unit="1",
    delays=AT_ONCE,
)
WARNING = replace(ALARM, name="warning", id_part="level-warning", severity="warning", what="too high")
OTHER = replace(ALARM, check="flow", id_part="flow", what="no flow")  # of another check


class Desk:
    """A manager of three alarms, and what it has to say of each second."""

    def __init__(self) -> None:
        self.manager = AlarmManager(VehicleId(None, 1, 1), (WARNING, ALARM, OTHER), AlarmSettings())
        self.second = 0
        self.asked: list[tuple[str, str]] = []

    def tell(self, warning: float = GOOD, alarm: float = GOOD, other: float = GOOD, *signals: Signal) -> Told:
        """One frame with a sample of each, and with what became of the first check's sources."""
        at = np.array([self.second])
        link = LinkClock(at, wire.START_US + 1_000_000 * at, 1_000_000 * at)
        values = ((WARNING, warning), (ALARM, alarm), (OTHER, other))
        marks = [SignalAt(frame_index=self.second, check="level", signal=signal) for signal in signals]
        self.manager.begin(marks, link)
        for spec, value in values:
            self.manager.ballot.rate(spec, one(value, self.second))
        told = short(self.manager.tell(link, self._ask))
        self.second += 1
        return told

    def _ask(self, moment: AlarmTransition) -> Iterable[Notice]:
        self.asked.append((moment.what, moment.record.id))
        return ()

    def announced(self, spec: AlarmSpec = WARNING) -> Announcement:
        return next(slot.announcement for slot in self.manager._slots if slot.spec is spec)

    def shelve(self, alarm_id: str = WARNING_ID, seconds: float = 1000.0) -> Told:
        return short(self.manager.shelve(alarm_id, self.second, self._now_us(), seconds))

    def unshelve(self, alarm_id: str = WARNING_ID) -> Told:
        return short(self.manager.unshelve(alarm_id, self.second, self._now_us()))

    def _now_us(self) -> int:
        return wire.START_US + 1_000_000 * self.second


def one(value: float, second: int) -> Rated:
    at, values = np.array([second]), np.array([value])
    return Rated(
        frame_index=at,
        t_boot_us=1_000_000 * at,
        value=values,
        limit=np.ones(1),
        bad=values > 1,
        low=values <= 1,
        detail=np.full((1, 5), np.nan),
    )


def short(notices: Iterable[Notice]) -> Told:
    entries = [msgspec.to_builtins(notice.event) for notice in notices]
    return [(entry["event"].removeprefix("alarm_"), entry["id"]) for entry in entries]


def both(*what: str, alarm_id: str) -> Told:
    return [(each, alarm_id) for each in what]


# --- a story for every row -------------------------------------------------------------------------------------------


def suppressed_and_released(desk: Desk) -> None:
    """The alarm says it; when it goes, the warning says by itself what is left, and then that it goes."""
    assert desk.tell(warning=BAD, alarm=BAD) == both("pending", "raised", alarm_id=ALARM_ID)
    assert desk.announced() is Announcement.SUPPRESSED
    assert desk.tell(warning=BAD) == [("cleared", ALARM_ID), ("raised", WARNING_ID)]
    assert desk.announced() is Announcement.TOLD
    assert desk.tell() == both("cleared", alarm_id=WARNING_ID)


def suppressed_to_its_end(desk: Desk) -> None:
    """A warning that goes before its alarm was never told, is in no report, and nobody asked why."""
    desk.tell(warning=BAD, alarm=BAD)
    assert desk.tell(alarm=BAD) == []
    assert desk.announced() is Announcement.TOLD
    assert desk.tell() == both("cleared", alarm_id=ALARM_ID)
    assert [record.id for record in desk.manager.alarms] == [ALARM_ID]
    assert desk.asked == [("raised", ALARM_ID), ("goes", ALARM_ID)]


def shelved_and_asked_for(desk: Desk) -> None:
    """Nothing is told of what is on the shelf; taken from it, it says that it stands."""
    assert desk.tell(warning=BAD) == both("pending", "raised", alarm_id=WARNING_ID)
    assert desk.shelve() == both("shelved", alarm_id=WARNING_ID)
    assert desk.announced() is Announcement.SHELVED
    assert desk.tell() == desk.tell(warning=BAD) == []
    assert desk.unshelve() == both("unshelved", "raised", alarm_id=WARNING_ID)
    assert desk.announced() is Announcement.TOLD
    assert desk.tell() == both("cleared", alarm_id=WARNING_ID)


def shelved_for_a_time(desk: Desk) -> None:
    """Shelved for 1.5 s behind the first: the second frame from then on ends it."""
    desk.tell(warning=BAD)
    desk.shelve(seconds=1.5)
    assert desk.tell() == desk.tell() == []
    assert desk.announced() is Announcement.SHELVED
    assert desk.tell() == both("unshelved", alarm_id=WARNING_ID)
    assert desk.announced() is Announcement.TOLD


def shelved_then_suppressed(desk: Desk) -> None:
    """On the shelf and raised beside its alarm; released from that it is raised, which the report has, but not told."""
    desk.tell(warning=BAD)
    desk.shelve()
    desk.tell()
    assert desk.tell(warning=BAD, alarm=BAD) == both("pending", "raised", alarm_id=ALARM_ID)
    assert desk.announced() is Announcement.SHELVED_SUPPRESSED
    assert [record.repeats for record in desk.manager.alarms] == [0, 0]
    assert desk.tell(warning=BAD) == both("cleared", alarm_id=ALARM_ID)
    assert desk.announced() is Announcement.SHELVED
    assert [record.repeats for record in desk.manager.alarms] == [1, 0]


def suppressed_then_shelved(desk: Desk) -> None:
    """On the shelf for a while only: it is still said by its alarm, and told when that goes."""
    desk.tell(warning=BAD)
    desk.tell()
    desk.tell(warning=BAD, alarm=BAD)
    assert desk.shelve() == both("shelved", alarm_id=WARNING_ID)
    assert desk.announced() is Announcement.SHELVED_SUPPRESSED
    assert ("unshelved", WARNING_ID) in desk.unshelve()
    assert desk.announced() is Announcement.SUPPRESSED
    assert desk.tell(warning=BAD) == [("cleared", ALARM_ID), ("raised", WARNING_ID)]


STORIES = (
    suppressed_and_released,
    suppressed_to_its_end,
    shelved_and_asked_for,
    shelved_for_a_time,
    shelved_then_suppressed,
    suppressed_then_shelved,
)


@pytest.mark.parametrize("story", STORIES, ids=lambda story: story.__name__)
def test_a_story(story: Callable[[Desk], None]) -> None:
    """As each of them says."""
    story(Desk())


def test_the_stories_walk_every_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """No row of the table is dead: each is taken in one of the stories above."""
    rows = set()
    announce = AlarmSlot.announce

    def noted(slot: AlarmSlot, signal: AnnouncementSignal) -> None:
        rows.add((slot.announcement, signal))
        announce(slot, signal)

    monkeypatch.setattr(AlarmSlot, "announce", noted)
    for story in STORIES:
        story(Desk())
    assert rows >= set(ANNOUNCEMENTS)


# --- what else there is to suppressed and shelved --------------------------------------------------------------------


def test_a_warning_that_was_told_stays_told() -> None:
    """An alarm that comes later hides neither its warning nor the warning's end."""
    desk = Desk()
    desk.tell(warning=BAD)
    assert desk.tell(warning=BAD, alarm=BAD) == both("pending", "raised", alarm_id=ALARM_ID)
    assert desk.announced() is Announcement.TOLD
    assert desk.tell(alarm=BAD) == both("cleared", alarm_id=WARNING_ID)


def test_another_check_suppresses_nothing() -> None:
    """Severe ones first, each for itself."""
    told = Desk().tell(warning=BAD, other=BAD)
    assert told == both("pending", "raised", alarm_id="1.1-flow-0-1") + both("pending", "raised", alarm_id=WARNING_ID)


def test_a_reboot_ends_what_was_told_alone() -> None:
    """A suppressed warning is not told as cleared by a reboot, and begins anew behind it; the shelf stays."""
    desk = Desk()
    desk.tell(warning=BAD, alarm=BAD)
    assert short(desk.manager.end_boot(desk.second, 0, 0)) == both("cleared", alarm_id=ALARM_ID)
    desk.shelve(ALARM_ID)
    desk.manager.start_boot(1)
    assert (desk.announced(WARNING), desk.announced(ALARM)) == (Announcement.TOLD, Announcement.SHELVED)
    assert desk.tell(alarm=BAD) == []
    assert [record.id for record in desk.manager.alarms] == [ALARM_ID, "1.1-level-1-1"]


def test_a_shelf_that_ends_in_a_later_boot_without_the_alarm() -> None:
    """Of what was not raised since there is nothing to tell."""
    desk = Desk()
    desk.tell(alarm=BAD)
    desk.shelve(ALARM_ID, seconds=1.5)
    desk.manager.start_boot(1)
    assert [desk.tell() for _ in range(4)] == [[]] * 4
    assert desk.announced(ALARM) is Announcement.TOLD


def test_a_shelf_that_ends_in_a_later_boot_beside_an_alarm() -> None:
    """Suppressed there, the warning was not raised yet: nothing is told before its alarm goes."""
    desk = Desk()
    desk.tell(warning=BAD)
    desk.shelve(seconds=1.5)
    desk.manager.start_boot(1)
    assert desk.tell(warning=BAD, alarm=BAD) == both("pending", "raised", alarm_id="1.1-level-1-1")
    assert desk.tell(BAD, BAD) == desk.tell(BAD, BAD) == []
    assert desk.announced() is Announcement.SUPPRESSED
    assert desk.tell(warning=BAD) == [("cleared", "1.1-level-1-1"), ("raised", "1.1-level-warning-1-1")]


def test_what_is_not_on_the_shelf_cannot_be_taken_from_it() -> None:
    """Refused in a sentence that names it."""
    desk = Desk()
    desk.tell(alarm=BAD)
    with pytest.raises(UsageError, match=f"{ALARM_ID}: not shelved"):
        desk.unshelve(ALARM_ID)


def test_a_comparator_that_cannot_run_raises_nothing() -> None:
    """Signals reach the alarms of their check alone; found again, it is as before."""
    desk = Desk()
    assert desk.tell(GOOD, GOOD, BAD, Signal.BROKEN) == both("pending", "raised", alarm_id="1.1-flow-0-1")
    assert desk.tell(BAD, BAD, BAD) == []
    assert desk.tell(BAD, BAD, BAD, Signal.FOUND) == both("pending", "raised", alarm_id=ALARM_ID)


# --- the specs -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stranger", [replace(ALARM, name="alrm"), replace(ALARM)], ids=["mistyped", "twin"])
def test_samples_for_an_unknown_alarm_are_an_error(stranger: AlarmSpec) -> None:
    """A spec that the manager was not given would never raise anything: it says so at once, and tells nothing."""
    desk = Desk()
    with pytest.raises(LookupError, match=f"level: its alarm '{stranger.name}' is not among its alarm_specs"):
        desk.manager.ballot.rate(stranger, one(BAD, 0))
    assert desk.manager.alarms == []


def test_an_alarm_says_what_its_spec_says() -> None:
    """Its record has the spec's words and unit."""
    desk = Desk()
    desk.tell(alarm=BAD)
    (record,) = desk.manager.alarms
    assert (record.check, record.severity, record.what) == ("level", "alarm", "far too high")
    assert (record.is_not, record.unit, record.peak) == ("not of a leak", "1", BAD)
