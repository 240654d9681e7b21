"""The view as a sink of a live run: it looks a few times a second, draws, and does what the keys say.

It runs in the listener's own thread between two batches, and waits for nothing there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, TypeVar

from gcs_bridge.errors import UsageError
from gcs_bridge.events import AlarmRaised, Event
from gcs_bridge.judging.snapshot import Snapshot
from gcs_bridge.links.wall_clock import now_us
from gcs_bridge.screen.alerts import Alert, AlertKey, Level, alerts_of, id_of
from gcs_bridge.screen.canvas import Canvas, one_cell
from gcs_bridge.screen.history import History, disagreement_of
from gcs_bridge.screen.keys import SHELVE_S, Key, KeyReader
from gcs_bridge.screen.memory import Memory
from gcs_bridge.screen.page import Scene, draw_page
from gcs_bridge.screen.paint import Painter
from gcs_bridge.screen.stray import StrayLines
from gcs_bridge.screen.terminal import Terminal
from gcs_bridge.sinks.base import Sink
from gcs_bridge.telemetry.identity import VehicleId

__all__ = ["View", "Watched"]

_T = TypeVar("_T")
_LOOK_S = 0.25
_ANSWER_S = 0.05  # a key is answered within this time, and held down costs no more than this often
_SHARE = 0.04  # of a processor: where a look costs much, as of very many vehicles, there are fewer of them
_MESSAGE_S = 5.0
_RING_AGAIN_S = 10.0  # as long as a warning is not acknowledged
_MOST_VEHICLES = 64  # of a link that are looked at: senders can be made up by the ten thousand


class Watched(Protocol):
    """What is looked at, and told what people say to alarms: a Monitor."""

    def snapshot(self, *, most_vehicles: int | None = None) -> Snapshot:
        """What is known now, of each link no more than so many vehicles."""

    def acknowledge(self, alarm_id: str, t_rx_us: int) -> list[Event]:
        """Somebody has seen an alarm."""

    def shelve(self, alarm_id: str, t_rx_us: int, duration_s: float) -> list[Event]:
        """Tell nothing of an alarm for a time."""

    def unshelve(self, alarm_id: str, t_rx_us: int) -> list[Event]:
        """Tell of an alarm again."""


class View(Sink):
    """Draws on a terminal what a Monitor knows, and takes the keys; between `watching` and its end."""

    def __init__(
        self,
        terminal: Terminal,
        *,
        title: str,
        line: Callable[[Event], str | None],
        colours: str | None,
        encoding: str,
        rings: bool,
    ) -> None:
        """Draw nothing yet; `line`: an event as people read it, None where they do not want to."""
        self._terminal = terminal
        self._title = one_cell(title)
        self._line = line
        self._painter = Painter(colours=colours, encoding=encoding)
        self._keys = KeyReader()
        self._stray = StrayLines()
        self._memory = Memory()
        self._histories: dict[VehicleId, History] = {}
        self._snapshot = Snapshot(links=(), vehicles=())
        self._alerts: list[Alert] = []
        self._chosen: VehicleId | None = None
        self._chosen_alert: AlertKey | None = None
        self._shows_help = False
        self._message, self._message_ends_s = "", 0.0
        self._rings, self._ring_due_s = rings, 0.0
        self._due_s = self._looked_s = 0.0

    @contextmanager
    def watching(
        self, watched: Watched, tell: Callable[[list[Event]], None], end: Callable[[], None]
    ) -> Iterator[None]:
        """Take the terminal for the time of a run; `tell` every sink what keys bring about, `end` the run for `q`."""
        self._watched, self._tell, self._end = watched, tell, end
        try:
            with self._terminal:
                self.catch_notes()
                yield
        finally:
            self.close()

    def catch_notes(self) -> None:
        """Show from now on what would go to standard error: what is told before it draws would be hidden behind it."""
        self._stray.catch()

    def close(self) -> None:
        """Write to standard error what would have gone there."""
        self._stray.release()

    def events(self, events: Sequence[Event]) -> None:
        """Keep what they tell, and ring for an alarm."""
        self._memory.take(events)
        for event in events:
            is_alarm = isinstance(event, AlarmRaised)
            if line := self._line(event):
                self._memory.tell(line, is_alarm=is_alarm)
            if is_alarm:
                self._ring()

    def descriptors(self) -> Sequence[int]:
        """The keys."""
        return [self._terminal.fileno()] if self._terminal.is_taken else []

    def run(self) -> None:
        """Do what was typed, and draw anew if it is time to."""
        for line in self._stray.read():
            self._memory.tell(line, is_note=True)
        if self._terminal.has_gone:
            self._stray.release()
            return
        now_s = time.monotonic()
        if not self._terminal.is_taken:  # stopped, and maybe going on again
            self._stray.release()
            if now_s < self._due_s:
                return
            if not self._terminal.resume():
                self._due_s = now_s + _LOOK_S
                return
            self._stray.catch()
            self._painter.forget()
        for key in self._keys.read(self._terminal.read()):
            self._do(key)
            self._due_s = min(self._due_s, self._looked_s + _ANSWER_S)
        self._terminal.write()
        if now_s >= self._due_s:
            began_s = time.thread_time()  # work, not waiting: on a busy machine a look takes longer and costs no more
            self._look(now_s)
            self._draw(now_s)
            took_s = time.thread_time() - began_s
            self._looked_s, self._due_s = now_s, now_s + max(_LOOK_S, took_s / _SHARE)

    def _look(self, now_s: float) -> None:
        """Take what is known now."""
        self._snapshot = self._watched.snapshot(most_vehicles=_MOST_VEHICLES)
        self._alerts = alerts_of(self._snapshot, self._memory.lost, self._memory.shelved_until)
        vehicles = [id_of(vehicle) for vehicle in self._snapshot.vehicles]
        for vehicle, now in zip(vehicles, self._snapshot.vehicles, strict=True):
            if vehicle in self._histories or disagreement_of(now) is not None:
                self._histories.setdefault(vehicle, History()).look(now, now_s)
        if self._chosen not in vehicles:
            self._chosen = vehicles[0] if vehicles else None
        keys = [alert.key for alert in self._alerts]
        if self._chosen_alert not in keys:
            self._chosen_alert = keys[0] if keys else None
        unseen = any(one.level is Level.WARNING and one.is_new and not one.is_shelved for one in self._alerts)
        if unseen and now_s >= self._ring_due_s:
            self._ring()

    def _draw(self, now_s: float) -> None:
        """Draw it, unless the terminal has not taken the last picture yet."""
        if not self._terminal.takes_more:
            return
        canvas = Canvas(*self._terminal.size())
        scene = Scene(
            title=self._title,
            clock=time.strftime("%H:%M:%SZ", time.gmtime()),
            snapshot=self._snapshot,
            alerts=self._alerts,
            chosen=self._chosen,
            chosen_alert=self._chosen_alert,
            memory=self._memory,
            histories=self._histories,
            message=self._message if now_s < self._message_ends_s else "",
            rings=self._rings,
            shows_help=self._shows_help,
        )
        draw_page(canvas, scene)
        self._terminal.write(self._painter.paint(canvas))

    def _ring(self) -> None:
        self._ring_due_s = time.monotonic() + _RING_AGAIN_S
        if self._rings and self._terminal.takes_more:
            self._terminal.write(b"\a")

    def _do(self, key: Key) -> None:
        """Do what a key is for; on the page of help it takes that away, and does nothing that is not seen."""
        if self._shows_help and key is not Key.QUIT:
            self._shows_help = False
            return
        match key:
            case Key.NEXT_VEHICLE | Key.PREVIOUS_VEHICLE:
                vehicles = [id_of(vehicle) for vehicle in self._snapshot.vehicles]
                self._chosen = _beside(vehicles, self._chosen, 1 if key is Key.NEXT_VEHICLE else -1)
            case Key.NEXT_ALERT | Key.PREVIOUS_ALERT:
                keys = [alert.key for alert in self._alerts]
                self._chosen_alert = _beside(keys, self._chosen_alert, 1 if key is Key.NEXT_ALERT else -1)
                if self._chosen_alert is not None:
                    self._chosen = self._chosen_alert.vehicle
            case Key.ACKNOWLEDGE:
                self._answer("acknowledged", self._watched.acknowledge)
            case Key.ACKNOWLEDGE_ALL:
                for alert in self._alerts:
                    if alert.is_new and not alert.is_shelved:
                        self._answer("acknowledged", self._watched.acknowledge, alert)
            case Key.SHELVE:
                self._answer("shelved", lambda alarm_id, t_rx_us: self._watched.shelve(alarm_id, t_rx_us, SHELVE_S))
            case Key.UNSHELVE:
                self._answer("unshelved", self._watched.unshelve)
            case Key.BELL:
                self._rings = not self._rings
                self._say(f"bell {'on' if self._rings else 'off'}")
            case Key.REDRAW:
                self._painter.forget()
            case Key.HELP:
                self._shows_help = True
            case Key.QUIT:
                self._end()

    def _answer(self, done: str, say: Callable[[str, int], list[Event]], alert: Alert | None = None) -> None:
        """Say something to an alarm, the chosen one unless another is given; and to people what came of it."""
        alert = alert or next((one for one in self._alerts if one.key == self._chosen_alert), None)
        if alert is None or alert.alarm is None or alert.alarm.id is None:
            self._say("no alarm is chosen: ↑↓ choose one" if self._alerts else "there is no alarm")
            return
        try:
            events = say(alert.alarm.id, now_us())
        except UsageError as error:
            self._say(str(error))
            return
        self._say(f"{done}: {alert.alarm.id}")
        self._tell(events)

    def _say(self, message: str) -> None:
        self._message, self._message_ends_s = one_cell(message), time.monotonic() + _MESSAGE_S


def _beside(all_of_them: Sequence[_T], one: _T | None, step: int) -> _T | None:
    """The next or previous one, round the ends."""
    if not all_of_them:
        return None
    place = all_of_them.index(one) + step if one in all_of_them else 0
    return all_of_them[place % len(all_of_them)]
