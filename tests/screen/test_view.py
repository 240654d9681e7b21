"""What keys and events do to the view, without a terminal: it looks at a Monitor of which everything is known."""

import functools
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_bridge.errors import UsageError
from gcs_bridge.events import Event
from gcs_bridge.judging.monitor import Monitor
from gcs_bridge.recordings.faults import parse_fault
from gcs_bridge.recordings.inject import inject
from gcs_bridge.screen import view
from gcs_bridge.sinks.event_lines import ReadableLines
from tests.helpers import wire

ALARM = "1.1-euler_quaternion-0-1"


class Paper:
    """Stands in for the terminal: what is typed next, and what was written."""

    def __init__(self) -> None:
        self.typed, self.written = b"", b""
        self.is_taken, self.has_gone, self.takes_more = True, False, True

    def __enter__(self) -> "Paper":
        return self

    def __exit__(self, *_: object) -> None:
        self.is_taken = False

    def fileno(self) -> int:
        return 99

    def size(self) -> tuple[int, int]:
        return 80, 40

    def resume(self) -> bool:
        return False

    def read(self) -> bytes:
        typed, self.typed = self.typed, b""
        return typed

    def write(self, data: bytes = b"") -> None:
        self.written += data


class Desk:
    """A view on a Monitor, the clock, and what was told to all sinks."""

    def __init__(self, monitor: Monitor, *, rings: bool = False) -> None:
        self.monitor, self.paper, self.told = monitor, Paper(), list[Event]()
        self.ended, self.now_s = False, 1000.0
        line = ReadableLines(["a link"], detail=0)
        terminal: Any = self.paper
        self.view = view.View(terminal, title="x", line=line, colours=None, encoding="utf-8", rings=rings)

    def tell(self, events: list[Event]) -> None:
        self.told += events
        self.view.events(events)

    def end(self) -> None:
        self.ended = True

    def press(self, keys: bytes) -> str:
        """What was written since, with the keys' answer."""
        self.paper.typed, self.paper.written = keys, b""
        for _ in range(2):
            self.now_s += 0.3
            self.view.run()
        return self.paper.written.decode()


@functools.cache
def flight() -> tuple[tuple[int, bytes], ...]:
    healthy = wire.flight(wire.Motion(7.0, seed=3), 7.0)
    return tuple(wire.records(inject(wire.tlog(healthy), [parse_fault("yaw_offset:25")], from_s=3.0)))


def set_up(of: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(**{**vars(time), "monotonic": lambda: of.now_s})
    monkeypatch.setattr("gcs_bridge.screen.view.time", clock)
    monkeypatch.setattr("gcs_bridge.screen.stray.StrayLines.catch", lambda self: None)  # standard error is pytest's


@contextmanager
def desk(monkeypatch: pytest.MonkeyPatch, **options: Any) -> Iterator[Desk]:
    """One whose alarm was raised, and which has looked."""
    made = Desk(Monitor(), **options)
    set_up(made, monkeypatch)
    with made.view.watching(made.monitor, made.tell, made.end):
        made.view.events(made.monitor.feed_datagrams([(data, t_us) for t_us, data in flight()]))
        yield made


def state(of: Desk) -> tuple[str, str]:
    """Of the alarm."""
    (check,) = [one for one in of.monitor.snapshot().vehicles[0].checks if one.name == "euler_quaternion"]
    return check.alarms[0].state.value, check.alarms[0].announcement.value


def test_keys_speak_to_the_chosen_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    """Acknowledged, shelved and unshelved, and every sink is told; what cannot be is said, and nothing else happens."""
    with desk(monkeypatch) as at:
        assert "NOT ACK'D" in at.press(b"")
        assert state(at) == ("raised", "told")
        assert f"acknowledged: {ALARM}" in at.press(b"a")
        assert state(at) == ("acknowledged", "told")
        assert "acknowledged already" in at.press(b"a")
        assert "not shelved" in at.press(b"u")
        at.press(b"s")
        assert state(at) == ("acknowledged", "shelved")
        at.press(b"u")
        assert [event.name for event in at.told] == [
            "alarm_acknowledged",
            "alarm_shelved",
            "alarm_unshelved",
            "alarm_raised",
        ]
        assert not at.ended
        at.press(b"q")
        assert at.ended


def test_all_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """`A` acknowledges what is not acknowledged yet, once."""
    with desk(monkeypatch) as at:
        at.press(b"")
        at.press(b"AA")
        at.press(b"A")
        assert [event.name for event in at.told].count("alarm_acknowledged") == len(at.told) >= 1


def test_nothing_to_speak_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything came, every key is answered or does nothing."""
    made = Desk(Monitor())
    set_up(made, monkeypatch)
    with made.view.watching(made.monitor, made.tell, made.end):
        assert "there is no alarm" in made.press(b"\x1b[A\x1b[B\x1b[C\x1b[Dlhjk\tAusrb?aa")
    assert made.told == []


def test_help_hides_nothing_that_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    """A key typed on the page of help takes that away, and speaks to no alarm."""
    with desk(monkeypatch) as at:
        assert "another vehicle" in at.press(b"?")
        assert "NOT ACK'D" in at.press(b"a")
        assert at.told == []


def test_the_bell_rings_until_somebody_has_seen_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """For each alarm, and again each ten seconds; not where it is not wanted, and not for what is acknowledged."""
    for rings in (True, False):
        with desk(monkeypatch, rings=rings) as at:
            assert (b"\a" in at.paper.written) is rings
            at.now_s += 5
            assert "\a" not in at.press(b"")
            at.now_s += 10
            assert ("\a" in at.press(b"")) is rings
            at.press(b"a")
            at.now_s += 20
            assert "\a" not in at.press(b"")
            assert "bell on" in at.press(b"bb" if rings else b"b")


def test_what_is_told_is_clean(monkeypatch: pytest.MonkeyPatch) -> None:
    """Text from the air cannot speak to the terminal."""
    with desk(monkeypatch) as at:
        at.press(b"")
        monkeypatch.setattr(at.view, "_line", lambda event: "evil \x1b]0;x\x07 \x1b[2J 航")
        at.press(b"a")
        shown = at.press(b"r")
        assert "\\x1b]0;x\\x07" in shown
        assert "\x1b]" not in shown
        assert shown.count("\x1b[2J") == 1  # the painter's own


def test_a_terminal_that_falls_behind_gets_no_second_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is looked at all the same, and drawn once it takes something again."""
    with desk(monkeypatch) as at:
        at.press(b"")
        at.paper.takes_more = False
        assert at.press(b"?") == ""
        at.paper.takes_more = True
        assert "another vehicle" in at.press(b"")


def test_an_unknown_alarm_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the Monitor refuses is one line, and the run goes on."""
    with desk(monkeypatch) as at:
        at.press(b"")

        def refuse(alarm_id: str, t_rx_us: int) -> list[Event]:
            raise UsageError(f"unknown alarm '{alarm_id}'")

        monkeypatch.setattr(at.monitor, "acknowledge", refuse)
        assert "unknown alarm" in at.press(b"a")
