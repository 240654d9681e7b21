"""Alarm stories as people live them, told by the monitor: what is announced when, and what an answer does to it."""

import functools
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Any
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_bridge import Monitor, diagnosis
from gcs_bridge.checks.quaternion_norm import QuaternionNorm
from gcs_bridge.diagnosis import Diagnosis, Window
from gcs_bridge.errors import UsageError
from tests.helpers import wire
from tests.helpers.craft import (
    BOOT_S,
    Change,
    Craft,
    Record,
    State,
    alarms,
    between,
    check,
    nothing,
    raw_imu,
    told,
    true,
    turned_in_world,
    watched,
    with_norm,
)
from tests.helpers.everyday import searched

Json = dict[str, Any]

HZ = 10.0
ID = "1.1-euler_quaternion-0-1"


def faulty(*spans_s: tuple[float, float], change: Change | None = None) -> Change:
    """A quaternion that is 25° of yaw off in each of these spans."""
    bad = turned_in_world(0, 0, 25) if change is None else change
    return lambda t_s, state: (bad if any(a <= t_s < b for a, b in spans_s) else true)(t_s, state)


def flown(*spans_s: tuple[float, float], seconds: float, **given: Any) -> list[Record]:
    return Craft(**{"quaternion": faulty(*spans_s), "hz": HZ, **given}).records(seconds)


@pytest.fixture(autouse=True, scope="module")
def _quick_doctor() -> Iterator[None]:
    """Alarms ask a doctor who knows no mistake, and says what it was shown: `tests/diagnosis` asks the real one."""

    def look(window: Window, _: Any) -> Diagnosis:
        shown = (of.t_boot_us.tolist() for of in (window.euler, window.quaternion))
        return Diagnosis(causes=("unknown",), values=((),), confidence="unknown", fix=str(list(shown)))

    with mock.patch.object(diagnosis, "diagnose", look):
        yield


class Watch:
    """Somebody who watches a flight and answers its alarms on the way."""

    def __init__(self, records: Iterable[Record]) -> None:
        self.monitor = Monitor()
        self._records = deque(records)

    def until(self, t_s: float, *, at_once: bool = True) -> list[Json]:
        """The alarms' events of what comes before this second, all at once or frame by frame."""
        piece = []
        while self._records and self._records[0][0] < rx_us(t_s):
            piece.append(wire.record(*self._records.popleft()))
        pieces = [b"".join(piece)] if at_once else piece
        events = [event for one in pieces for event in self.monitor.feed_recording(one)]
        return [event for event in events if event["event"].startswith("alarm_")]

    def rest(self) -> list[Json]:
        return self.until(1e6)

    def acknowledge(self, t_s: float, alarm_id: str = ID) -> list[Json]:
        return self.monitor.acknowledge(alarm_id, rx_us(t_s))

    def alarms(self) -> list[Json]:
        (vehicle,) = self.monitor.close().to_dict()["files"][0]["vehicles"]
        return alarms(vehicle)


def rx_us(t_s: float) -> int:
    return wire.START_US + round(t_s * 1e6)


def moments(events: Iterable[Json]) -> list[tuple[str, float | None]]:
    """What happened to alarms, and when, in seconds of flight."""
    return [
        (event["event"].removeprefix("alarm_"), None if event["boot_s"] is None else round(event["boot_s"] - BOOT_S, 3))
        for event in events
        if event["event"].startswith("alarm_")
    ]


# --- raised, cleared, taken back -------------------------------------------------------------------------------------


def test_taken_back_before_the_delay() -> None:
    """Bad for 0.9 s: pending, and never raised; nothing of it is in the report."""
    events, vehicle = watched(flown((5, 5.9), seconds=12))
    assert moments(events) == [("pending", 5.2)]
    assert alarms(vehicle) == []


def test_the_life_of_one_alarm() -> None:
    """Bad from 5 to 9 s: pending with the third sample, raised a second later, cleared 2 s behind the third good."""
    events, vehicle = watched(flown((5, 9), seconds=15))
    assert moments(events) == [("pending", 5.2), ("raised", 6.2), ("cleared", 11.2)]
    (alarm,) = alarms(vehicle)
    assert (alarm["id"], alarm["repeats"], alarm["grouped"], alarm["acknowledged"]) == (ID, 0, None, False)


def test_samples_for_an_alarm_that_is_not_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A check that rates samples for an alarm that it forgot to list is a mistake at once, not an alarm that is off."""
    made = QuaternionNorm.__init__

    def forgetful(self: QuaternionNorm, *settings: Any) -> None:
        made(self, *settings)
        self.alarm_specs = self.alarm_specs[:1]

    monkeypatch.setattr(QuaternionNorm, "__init__", forgetful)
    with pytest.raises(LookupError, match="quaternion_norm: its alarm 'zero' is not among its alarm_specs"):
        watched(flown((5, 9), seconds=12))


# --- repeats, chatter, flood -----------------------------------------------------------------------------------------


def test_a_repeat_within_thirty_seconds_is_the_same_alarm() -> None:
    """Raised at 6.2 s and again at 26.2 s: one alarm with one repeat, and its last end."""
    events, vehicle = watched(flown((5, 9), (25, 29), seconds=35))
    raised = told(events, "alarm_raised")
    assert [event["id"] for event in raised] == [ID, ID]
    assert [event["id"] for event in told(events, "alarm_pending")] == [ID, ID]
    assert [event["grouped"] for event in raised] == [None, "repeat"]
    (alarm,) = alarms(vehicle)
    assert (alarm["repeats"], alarm["raised_boot_s"]) == (1, pytest.approx(6.2))
    assert alarm["cleared_boot_s"] == pytest.approx(31.2)


@pytest.mark.slow
def test_again_after_thirty_seconds_is_another_alarm() -> None:
    """Raised at 6.2 s and again at 36.3 s: two alarms with names of their own."""
    found = alarms(watched(flown((5, 9), (35.1, 39), seconds=45))[1])
    assert len({alarm["id"] for alarm in found}) == 2
    assert [alarm["repeats"] for alarm in found] == [0, 0]
    assert [alarm["raised_boot_s"] for alarm in found] == pytest.approx([6.2, 36.3])


@pytest.mark.slow
def test_three_a_minute_are_a_chatter() -> None:
    """Raised at 6.2, 25.2 and 44.2 s: one alarm, told as chatter from the third on; back to itself a minute later."""
    events, vehicle = watched(flown((5, 8), (24, 27), (43, 46), (110, 113), seconds=120, hz=5.0))
    assert [event["grouped"] for event in told(events, "alarm_raised")] == [None, "repeat", "chatter", None]
    first, second = alarms(vehicle)
    assert (first["repeats"], first["grouped"]) == (2, "chatter")
    assert (second["repeats"], second["grouped"]) == (0, None)


@pytest.mark.slow
def test_ten_of_any_within_ten_minutes_are_a_flood() -> None:
    """Five excursions 31 s apart, each of norm and angle: the tenth raise is part of a flood, the ninth is not."""

    def both(t_s: float, state: State) -> Any:
        return with_norm(1.05)(t_s, turned_in_world(0, 0, 25)(t_s, state))

    spans = [(5 + 31 * i, 7 + 31 * i) for i in range(5)]
    quaternion = faulty(*spans, change=both)
    events, _ = watched(Craft(quaternion=quaternion, hz=5, second_hz=5).records(140))
    raised = [event for event in told(events, "alarm_raised") if event["severity"] == "alarm"]
    assert {event["check"] for event in raised} == {"euler_quaternion", "quaternion_norm"}
    assert [event["grouped"] for event in raised] == [None] * 9 + ["flood"]


# --- acknowledged, latched -------------------------------------------------------------------------------------------


def test_an_alarm_that_went_stays_until_it_is_acknowledged() -> None:
    """An alarm that has cleared unseen can still be acknowledged, once."""
    watch = Watch(flown((5, 9), seconds=20))
    watch.rest()
    (event,) = watch.acknowledge(21)
    assert (event["event"], event["id"], event["vehicle"]) == ("alarm_acknowledged", ID, [1, 1])
    assert event["utc"] == "2023-11-14T22:13:41.000Z"
    with pytest.raises(UsageError, match="acknowledged already"):
        watch.acknowledge(22)
    (alarm,) = watch.alarms()
    assert alarm["acknowledged"]
    assert alarm["cleared_boot_s"] == pytest.approx(11.2)


def test_acknowledged_while_it_stands() -> None:
    """Acknowledged at 7 s it stands on, clears as ever, and a return half a minute later is a new, unseen alarm."""
    watch = Watch(flown((5, 9), (40, 44), seconds=50))
    watch.until(7)
    assert moments(watch.acknowledge(7)) == [("acknowledged", None)]
    assert moments(watch.rest()) == [("cleared", 11.2), ("pending", 40.2), ("raised", 41.2), ("cleared", 46.2)]
    assert [alarm["acknowledged"] for alarm in watch.alarms()] == [True, False]


def test_a_repeat_must_be_acknowledged_again() -> None:
    """Acknowledged, gone and back within 30 s: it is unseen again, and can be acknowledged again."""
    watch = Watch(flown((5, 9), (15, 30), seconds=40))
    watch.until(7)
    watch.acknowledge(7)
    (raised,) = told(watch.until(20), "alarm_raised")
    assert (raised["id"], raised["grouped"], raised["acknowledged"]) == (ID, "repeat", False)
    (event,) = watch.acknowledge(20)
    assert event["acknowledged"]


@pytest.mark.slow
def test_a_return_of_an_unseen_alarm() -> None:
    """Gone unseen, latched, and back for longer than the delay: raised again; back for less: not."""
    watch = Watch(flown((5, 9), (15, 15.8), (20, 24), seconds=30))
    assert moments(watch.rest())[3:] == [("pending", 15.2), ("pending", 20.2), ("raised", 21.2), ("cleared", 26.2)]


@pytest.mark.slow
@pytest.mark.parametrize(("at_s", "said"), [(5.5, "not raised yet"), (3.0, "unknown alarm")])
def test_what_cannot_be_acknowledged(at_s: float, said: str) -> None:
    """An alarm that is only pending, and one that does not exist, is refused in one sentence that names it."""
    watch = Watch(flown((5, 9), seconds=12))
    watch.until(at_s)
    with pytest.raises(UsageError, match=f"{ID}.*{said}|{said}.*{ID}"):
        watch.acknowledge(at_s)
    assert ("raised", 6.2) in moments(watch.rest())


def test_what_is_pending_behind_a_latched_alarm_cannot_be_acknowledged() -> None:
    """The second excursion's own alarm is not raised yet at 40.5 s, whatever became of the first."""
    watch = Watch(flown((5, 9), (40, 44), seconds=50))
    (*_, pending) = watch.until(40.5)
    assert pending["event"] == "alarm_pending"
    with pytest.raises(UsageError, match="not raised yet"):
        watch.acknowledge(40.5, pending["id"])


@pytest.mark.slow
def test_an_alarm_of_another_vehicle_is_not_touched() -> None:
    """Two vehicles with the same fault: acknowledging one's alarm leaves the other's."""
    one = flown((5, 9), seconds=12)
    two = Craft(quaternion=faulty((5, 9)), hz=HZ, sysid=2).records(12)
    watch = Watch(sorted(one + two, key=lambda record: record[0]))
    watch.until(8)
    (event,) = watch.acknowledge(8, "2.1-euler_quaternion-0-1")
    assert event["vehicle"] == [2, 1]
    vehicles = watch.monitor.close().to_dict()["files"][0]["vehicles"]
    assert [vehicle["alarms"][0]["acknowledged"] for vehicle in vehicles] == [False, True]


# --- shelved ---------------------------------------------------------------------------------------------------------


def test_shelved_nothing_is_told() -> None:
    """Shelved at 7 s for a minute: its end and its return are not told; the report has both."""
    watch = Watch(flown((5, 9), (20, 24), seconds=30))
    watch.until(7)
    (event,) = watch.monitor.shelve(ID, rx_us(7), 60)
    assert (event["event"], event["id"], event["until_utc"]) == ("alarm_shelved", ID, "2023-11-14T22:14:27.000Z")
    assert watch.rest() == []
    (alarm,) = watch.alarms()
    assert (alarm["repeats"], alarm["cleared_boot_s"]) == (1, pytest.approx(26.2))


def test_shelving_one_alarm_leaves_the_others() -> None:
    """With the angle's alarm shelved, that of the norm is told."""
    quaternion = between(5, 9, turned_in_world(0, 0, 25), between(12, 15, with_norm(1.05)))
    watch = Watch(Craft(quaternion=quaternion, hz=HZ).records(20))
    watch.until(7)
    watch.monitor.shelve(ID, rx_us(7), 60)
    assert {event["check"] for event in watch.rest()} == {"quaternion_norm"}


@pytest.mark.slow
def test_unshelved_before_its_time() -> None:
    """Taken from the shelf while it stands, it is told anew; later it clears as ever."""
    watch = Watch(flown((5, 19), seconds=25))
    watch.until(7)
    watch.monitor.shelve(ID, rx_us(7), 60)
    assert watch.until(12) == []
    events = watch.monitor.unshelve(ID, rx_us(12))
    assert [(event["event"], event["id"]) for event in events] == [("alarm_unshelved", ID), ("alarm_raised", ID)]
    assert moments(watch.rest()) == [("cleared", 21.2)]
    with pytest.raises(UsageError, match="not shelved"):
        watch.monitor.unshelve(ID, rx_us(13))


def test_unshelved_when_it_is_gone() -> None:
    """Taken from the shelf after it went, nothing is raised."""
    watch = Watch(flown((5, 9), seconds=20))
    watch.until(7)
    watch.monitor.shelve(ID, rx_us(7), 60)
    watch.rest()
    assert [event["event"] for event in watch.monitor.unshelve(ID, rx_us(20))] == ["alarm_unshelved"]


@pytest.mark.slow
@pytest.mark.parametrize("at_once", [True, False])
def test_shelving_ends_wherever_the_pieces_are_cut(at_once: bool) -> None:
    """Shelved at 7 s for 5 s: at 12 s it is told as unshelved, still standing, and its end at 16.4 s as well."""
    watch = Watch(flown((5, 14), seconds=18, hz=5.0))
    watch.until(7)
    watch.monitor.shelve(ID, rx_us(7), 5)
    events = watch.until(1e6, at_once=at_once)
    assert [event["event"] for event in events] == ["alarm_unshelved", "alarm_raised", "alarm_cleared"]
    assert [event["utc"] for event in events] == [
        "2023-11-14T22:13:32.000Z",
        "2023-11-14T22:13:32.000Z",
        "2023-11-14T22:13:36.400Z",
    ]


@pytest.mark.slow
@pytest.mark.parametrize("at_once", [True, False])
def test_what_comes_behind_the_shelving_is_told(at_once: bool) -> None:
    """Shelved from 7 to 17 s: the return within is not told, that behind is."""
    watch = Watch(flown((5, 9), (12, 13.5), (20, 23), seconds=26, hz=5.0))
    watch.until(7)
    watch.monitor.shelve(ID, rx_us(7), 10)
    seen = moments(watch.until(1e6, at_once=at_once))
    assert seen == [("unshelved", None), ("pending", 20.4), ("raised", 21.4), ("cleared", 25.4)]


def test_shelving_ends_while_nothing_comes() -> None:
    """The end of the shelving is told when its time has come, even if no byte has."""
    watch = Watch(flown((5, 19), seconds=8))
    watch.rest()
    watch.monitor.shelve(ID, rx_us(8), 1.0)
    names = [event["event"] for event in watch.monitor.advance(rx_us(8.9))]
    assert "alarm_unshelved" not in names
    (event,) = told(watch.monitor.advance(rx_us(9.5)), "alarm_unshelved")
    assert event["utc"] == "2023-11-14T22:13:29.000Z"


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
def test_a_shelving_without_end(seconds: float) -> None:
    """Nothing is shelved for no time, or for ever."""
    watch = Watch(flown((5, 9), seconds=8))
    watch.rest()
    with pytest.raises(UsageError, match="must be above 0"):
        watch.monitor.shelve(ID, rx_us(8), seconds)


# --- sources that go -------------------------------------------------------------------------------------------------


def test_a_source_lost_while_pending() -> None:
    """Bad from 5.0 s, and from 5.8 s on the quaternion is gone: no compare; back and healthy at 12 s: no alarm."""
    quaternion = between(5, 5.8, turned_in_world(0, 0, 25), between(5.8, 12, nothing))
    events, vehicle = watched(Craft(quaternion=quaternion, hz=HZ).records(20))
    assert alarms(vehicle, "euler_quaternion") == []
    assert [event["event"] for event in told(events, "no_compare", "compare_resumed")] == [
        "no_compare",
        "compare_resumed",
    ]
    assert check(vehicle, "euler_quaternion")["verdict"] == "agree"


@pytest.mark.slow
@pytest.mark.parametrize("healthy", [True, False])
def test_a_source_lost_while_raised(healthy: bool) -> None:
    """Raised at 6.2 s, the quaternion gone from 8 to 14 s: the alarm stands, and clears only if it is healthy then."""
    off = turned_in_world(0, 0, 25)
    quaternion = between(5, 8, off, between(8, 14, nothing, between(14, 99, true if healthy else off)))
    events, vehicle = watched(Craft(quaternion=quaternion, hz=HZ).records(20))
    (alarm,) = alarms(vehicle, "euler_quaternion")
    assert alarm["raised_boot_s"] == pytest.approx(6.2)
    # At 14 s the votes from before the gap are older than 5 s: the first sample behind it is low alone.
    assert alarm["cleared_boot_s"] == (pytest.approx(14 + 2.0) if healthy else None)
    assert len([event for event in told(events, "alarm_raised") if event["check"] == "euler_quaternion"]) == 1


def test_a_source_lost_while_clearing() -> None:
    """Healthy from 8 to 9 s, gone till 14 s, then healthy again: the two seconds begin anew behind the gap."""
    quaternion = between(5, 8, turned_in_world(0, 0, 25), between(9, 14, nothing))
    (alarm,) = alarms(watched(Craft(quaternion=quaternion, hz=HZ).records(20))[1], "euler_quaternion")
    assert alarm["cleared_boot_s"] == pytest.approx(14 + 2.0)


def test_a_comparator_that_cannot_run() -> None:
    """A RAW_IMU without a known unit makes gyro and gravity INOP, and leaves the alarms of the others alone."""
    odd: Callable[[int, State], Any] = lambda ms, state: raw_imu(ms, state, per_g=777.0)
    records = flown((25, 29), seconds=35, imu=true, imu_message=odd, autopilot=wire.PX4)
    events, vehicle = watched(records)
    assert {event["check"] for event in told(events, "inop")} == {"gyro", "gravity"}
    assert [alarm["check"] for alarm in alarms(vehicle)] == ["euler_quaternion"]
    assert check(vehicle, "gyro")["verdict"] == "inop"


WHAT = ("pending", "raised", "cleared")


@pytest.mark.slow
def test_a_reboot_ends_an_alarm() -> None:
    """Raised in the first boot, which ends: cleared by the reboot, its end unknown; the second is its own."""
    first = flown((5, 99), seconds=10, boot_s=600.0)
    second = [(t_us + 12_000_000, frame) for t_us, frame in flown((5, 9), seconds=15, boot_s=2.0)]
    events, vehicle = watched(first + second)
    names = [(event["event"], event["boot"]) for event in told(events, *(f"alarm_{what}" for what in WHAT))]
    assert names == [(f"alarm_{what}", boot) for boot in (0, 1) for what in WHAT]
    (end,) = [event for event in told(events, "alarm_cleared") if event["boot"] == 0]
    assert (end["cleared_boot_s"], end["reason"]) == (None, "reboot")
    assert [(alarm["boot"], alarm["cleared_boot_s"]) for alarm in vehicle["alarms"]] == [
        (0, None),
        (1, pytest.approx(13.2)),
    ]


# --- however it is cut -----------------------------------------------------------------------------------------------


@functools.cache
def told_story() -> list[Record]:
    return flown((3, 5), (8, 9.5), (20, 24), seconds=28, hz=5.0)


def story(cuts: list[int]) -> tuple[list[Json], Json]:
    """The story in pieces of bytes, with an answer to its first alarm at the same place every time."""
    records = told_story()
    data = wire.tlog(records)
    at = len(wire.tlog(records[:75]))  # at 6.8 s, while the alarm clears
    monitor = Monitor()
    events: list[Json] = []
    edges = sorted({0, len(data), at, *(cut % len(data) for cut in cuts)})
    for begin, end in pairwise(edges):
        events += monitor.feed_recording(data[begin:end])
        if end == at:
            events += monitor.shelve(ID, rx_us(7), 5)
    return events, monitor.close().to_dict()["files"][0]["vehicles"][0]


@pytest.mark.slow
@searched(8)
@given(cuts=st.lists(st.integers(0, 10**6), max_size=60))
def test_any_cutting_tells_the_same_story(cuts: list[int]) -> None:
    """In pieces of any size the events and the report are the same, to the last bit, with an alarm on the shelf."""
    assert story(cuts) == whole_story()


@functools.cache
def whole_story() -> tuple[list[Json], Json]:
    return story([])
