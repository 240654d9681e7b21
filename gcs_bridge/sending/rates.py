"""`--request-rates`: asks vehicles for the messages that are compared, shows what they answer, and whether it holds.

One question at a time, as an answer does not say what it answers. It is asked again when another station has undone
it, which the vehicle itself is asked about where it can tell. No socket and no clock: time is an argument.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from enum import Enum, auto
from typing import NamedTuple

from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.envelope import Envelope, envelope
from gcs_bridge.mavlink.packer import GET_MESSAGE_INTERVAL, SET_MESSAGE_INTERVAL, Packer

__all__ = ["RateRequests", "Request", "Who"]
_ATTITUDES = (30, 31)
# HIGHRES_IMU is what PX4 has; others have RAW_IMU, or one of these. In the order in which they are tried.
_IMUS_OF_PX4, _IMUS = (105, 26), (27, 26, 105)
_PX4 = 12  # MAV_AUTOPILOT_PX4
_ATTEMPTS, _ANSWER_S = 3, 1.0
_SETTLE_S = 1.0  # from an answer to the rate that it promises
_WINDOW_S, _WINDOW_MESSAGES = 3.0, 5  # a rate is taken over so long, and as long as so many should take
_FALLEN = 0.6  # share of the rate that was reached: what is below it in two windows has changed
# From one time that it is asked again to the next: of two stations that undo each other's wish one should tire.
_AGAIN_S, _LONGEST_AGAIN_S = 10.0, 300.0
_IN_VAIN = 2
_OVERHEARD_S = 20.0  # a wish of another station explains what changes within this time
_VEHICLES = 32  # more are not asked: whoever forges senders should not make us send
# Autopilots slow their streams by themselves while these are under way: parameters, missions, files, logs.
_TRANSFERS = frozenset((22, 39, 40, 47, 51, 73, 110, 118, 120))
_HEARTBEAT, _COMMAND_ACK, _COMMAND_LONG, _MESSAGE_INTERVAL, _REQUEST_DATA_STREAM = 0, 77, 76, 244, 66
_ACCEPTED, _TEMPORARILY_REJECTED, _DENIED, _IN_PROGRESS = 0, 1, 2, 5  # MAV_RESULT


class Who(NamedTuple):
    """A vehicle, and the number of the link that it is on."""

    link: int
    system: int
    component: int

    def __str__(self) -> str:
        return f"{self.system},{self.component}"


class Request(NamedTuple):
    """What is to be sent: how often `msgid` should come, or None: ask how often it does."""

    to: Who
    msgid: int
    interval_us: int | None

    def packed(self, packer: Packer) -> bytes:
        """As a frame."""
        if self.interval_us is None:
            return packer.get_interval(self.to.system, self.to.component, self.msgid)
        return packer.set_interval(self.to.system, self.to.component, self.msgid, self.interval_us)


class _State(Enum):
    WANTED = auto()  # to be asked for
    HELD = auto()  # it was granted, and its rate is watched
    DOUBTED = auto()  # its rate has fallen: what does the vehicle say?
    GIVEN_UP = auto()  # refused, or never answered


_OPEN = (_State.WANTED, _State.DOUBTED)


class _Wish:
    """One message of one vehicle."""

    def __init__(self, msgids: Sequence[int]) -> None:
        self.msgids = list(msgids)  # the first one that the firmware has
        self.state = _State.WANTED
        self.attempts = 0
        self.count = 0  # in the present window
        self.began_s = 0.0
        self.rate_hz = 0.0  # of the last one
        self.held_hz = 0.0  # what it should come at
        self.fallen = 0  # windows in a row in which it did not
        self.vain = 0  # times that it was asked again for no sure reason, and nothing came of it
        self.again_s = _AGAIN_S
        self.not_before_s = -math.inf

    @property
    def msgid(self) -> int:
        return self.msgids[0]


class _Vehicle:
    """One vehicle, and the question that is under way."""

    def __init__(self, who: Who, now_s: float) -> None:
        self.who = who
        self.since_s = now_s
        self.autopilot: int | None = None
        self.wishes: list[_Wish] = []
        self.asked: _Wish | None = None
        self.asked_s = 0.0
        self.beat_s = self.transfer_s = -math.inf  # when a heartbeat came last, and a part of a transfer
        self.tells_intervals = True
        self.overheard: tuple[str, float] | None = None  # who asked for something else, and when


class RateRequests:
    """The wishes of all vehicles; `due` tells what is to be sent, `say` what people should know."""

    def __init__(self, rate_hz: float, own: tuple[int, int], dialect: Dialect, say: Callable[[str], None]) -> None:
        """Ask for `rate_hz`, as the system and component `own`."""
        self._rate_hz = rate_hz
        self._interval_us = round(1e6 / rate_hz)
        self._window_s = max(_WINDOW_S, _WINDOW_MESSAGES / rate_hz)
        self._own = own
        self._dialect = dialect
        self._say = say
        self._vehicles: dict[Who, _Vehicle] = {}
        self._full = False

    def seen(self, who: Who, now_s: float) -> None:
        """A vehicle is there, there again, or has restarted, and so forgotten: it is asked."""
        if who not in self._vehicles and len(self._vehicles) >= _VEHICLES:
            if not self._full:
                self._full = True
                self._say(f"rates were asked of {_VEHICLES} vehicles; further ones are not asked")
            return
        autopilot = self._vehicles[who].autopilot if who in self._vehicles else None
        self._vehicles[who] = _Vehicle(who, now_s)
        self._vehicles[who].autopilot = autopilot

    def lost(self, who: Who) -> None:
        """Nothing comes from a vehicle: it is not asked until it is there again."""
        if who in self._vehicles:
            self._vehicles[who] = _Vehicle(who, math.inf)

    def frames(self, link: int, frames: Sequence[bytes], now_s: float) -> None:
        """Frames of a link, whoever sent them."""
        for frame in frames:
            sent = envelope(frame)
            vehicle = self._vehicles.get(Who(link, sent.system, sent.component))
            if vehicle is not None:
                self._from_vehicle(vehicle, sent, now_s)
            elif sent.msgid in (_REQUEST_DATA_STREAM, _COMMAND_LONG):
                self.overhear(sent, now_s)

    def overhear(self, sent: Envelope, now_s: float) -> None:
        """A message of another ground station, on a link or on a relay, which may be a wish for other rates."""
        if sent.msgid == _REQUEST_DATA_STREAM:
            target = _fields(sent.payload, "<HBBBB")[1]
        elif sent.msgid == _COMMAND_LONG:
            *_, command, target, _, _ = _fields(sent.payload, "<7fHBBB")
            if command != SET_MESSAGE_INTERVAL:
                return
        else:
            return
        if (sent.system, sent.component) != self._own:
            for vehicle in self._vehicles.values():
                if target in (0, vehicle.who.system):
                    vehicle.overheard = f"{sent.system},{sent.component}", now_s

    def due(self, now_s: float) -> list[Request]:
        """What is to be sent now."""
        return [request for vehicle in self._vehicles.values() if (request := self._next(vehicle, now_s)) is not None]

    # --- what the vehicle sends -------------------------------------------------------------------------------------

    def _from_vehicle(self, vehicle: _Vehicle, sent: Envelope, now_s: float) -> None:
        if sent.msgid == _HEARTBEAT:
            vehicle.autopilot = _fields(sent.payload, "<I5B")[2]
            vehicle.beat_s = now_s
        elif sent.msgid == _COMMAND_ACK:
            self._answered(vehicle, sent.payload, now_s)
        elif sent.msgid == _MESSAGE_INTERVAL:
            interval_us, msgid = _fields(sent.payload, "<iH")
            self._told(vehicle, interval_us, msgid, now_s)
        elif sent.msgid in _TRANSFERS:
            vehicle.transfer_s = now_s
        for wish in vehicle.wishes:
            wish.count += sent.msgid == wish.msgid

    def _answered(self, vehicle: _Vehicle, payload: bytes, now_s: float) -> None:
        command, result, _, _, system, component = _fields(payload, "<HBBiBB")
        wish = vehicle.asked
        to_us = system in (0, self._own[0]) and component in (0, self._own[1])
        if wish is None or not to_us or result == _IN_PROGRESS:
            return
        if command == GET_MESSAGE_INTERVAL and wish.state is _State.DOUBTED:
            if result != _ACCEPTED:
                vehicle.tells_intervals = False
                self._undone(vehicle, wish, now_s, sure=False)
            return  # else the MESSAGE_INTERVAL follows, or came before
        if command != SET_MESSAGE_INTERVAL or wish.state is not _State.WANTED:
            return
        said = self._dialect.enum_name("MAV_RESULT", result).replace("_", " ")
        if result == _TEMPORARILY_REJECTED and wish.attempts < _ATTEMPTS:
            return  # it is asked again when the time for an answer is over
        vehicle.asked = None
        self._say(f"{vehicle.who}: {self._name(wish)} at {self._rate_hz:g} Hz: {said}{_WHY.get(result, '')}")
        if result == _ACCEPTED:
            self._hold(wish, self._rate_hz, now_s + _SETTLE_S)
        elif result not in (_TEMPORARILY_REJECTED, _DENIED) and len(wish.msgids) > 1:
            wish.msgids.pop(0)
            wish.attempts = 0
        else:
            wish.state = _State.GIVEN_UP

    def _told(self, vehicle: _Vehicle, interval_us: int, msgid: int, now_s: float) -> None:
        wish = vehicle.asked
        if wish is None or wish.state is not _State.DOUBTED or wish.msgid != msgid:
            return
        if not interval_us:  # it does not know
            vehicle.tells_intervals = False
            self._undone(vehicle, wish, now_s, sure=False)
        elif abs(interval_us - self._interval_us) > max(1000, self._interval_us // 10):  # autopilots count in whole ms
            self._undone(vehicle, wish, now_s, sure=True)
        else:
            vehicle.asked = None
            self._say(
                f"{vehicle.who}: {self._name(wish)} comes at {wish.rate_hz:.3g} Hz, though the vehicle "
                f"means to send it at {self._rate_hz:g} Hz: the link takes no more"
            )
            self._hold(wish, wish.rate_hz, now_s)

    # --- what is asked ----------------------------------------------------------------------------------------------

    def _next(self, vehicle: _Vehicle, now_s: float) -> Request | None:
        if not vehicle.wishes:
            patience_s = 2 * _ANSWER_S if vehicle.autopilot is None else 0.0  # a heartbeat tells which IMU it has
            if now_s < vehicle.since_s + patience_s:
                return None
            imus = _IMUS_OF_PX4 if vehicle.autopilot == _PX4 else _IMUS
            vehicle.wishes = [*(_Wish([msgid]) for msgid in _ATTITUDES), _Wish(imus)]
        for held in vehicle.wishes:
            self._look_at(vehicle, held, now_s)
        if vehicle.asked is not None:
            if now_s < vehicle.asked_s + _ANSWER_S:
                return None
            self._unanswered(vehicle, vehicle.asked, now_s)
        wish = vehicle.asked or next((one for one in vehicle.wishes if one.state in _OPEN), None)
        if wish is None:
            return None
        vehicle.asked, vehicle.asked_s = wish, now_s
        wish.attempts += 1
        return Request(vehicle.who, wish.msgid, None if wish.state is _State.DOUBTED else self._interval_us)

    def _unanswered(self, vehicle: _Vehicle, wish: _Wish, now_s: float) -> None:
        """The time for an answer is over: is it asked once more, or is that all?"""
        if wish.attempts < _ATTEMPTS:
            return
        if wish.state is _State.DOUBTED:
            vehicle.tells_intervals = False
            self._undone(vehicle, wish, now_s, sure=False)
            return
        vehicle.asked = None
        wish.state = _State.GIVEN_UP
        self._say(
            f"{vehicle.who}: {self._name(wish)} at {self._rate_hz:g} Hz: no answer; is the link one-way, or does the "
            "vehicle take commands only signed, or only from its own ground station?"
        )

    def _look_at(self, vehicle: _Vehicle, wish: _Wish, now_s: float) -> None:
        """At the end of a window: has the rate fallen?"""
        began_s, lasts_s = wish.began_s, now_s - wish.began_s
        if wish.state is not _State.HELD or lasts_s < self._window_s:
            return
        wish.rate_hz = wish.count / lasts_s
        wish.began_s, wish.count = now_s, 0
        if vehicle.transfer_s >= began_s or vehicle.beat_s < began_s:
            return  # it is slow on purpose, or not heard at all
        if wish.rate_hz >= _FALLEN * wish.held_hz:
            wish.fallen = wish.vain = 0
            return
        wish.fallen += 1
        overheard = self._by(vehicle, now_s) is not None
        if (wish.fallen < 2 and not overheard) or now_s < wish.not_before_s or vehicle.asked is not None:
            return
        if overheard or not vehicle.tells_intervals:
            self._undone(vehicle, wish, now_s, sure=overheard)
        else:
            wish.state = _State.DOUBTED
            wish.attempts = 0

    def _undone(self, vehicle: _Vehicle, wish: _Wish, now_s: float, *, sure: bool) -> None:
        """Ask again. Where nothing but the rate tells, it may be the link: it is not asked for ever in vain."""
        vehicle.asked = None
        slow = f"{vehicle.who}: {self._name(wish)} comes at {wish.rate_hz:.3g} Hz"
        wish.vain = 0 if sure else wish.vain + 1
        if wish.vain > _IN_VAIN:
            self._say(f"{slow}, however often it is asked for {self._rate_hz:g} Hz: not asked again")
            self._hold(wish, wish.rate_hz, now_s)
            return
        by = self._by(vehicle, now_s) or "another station"
        self._say(f"{slow}: {by} {'has' if sure else 'may have'} changed it; asked again")
        wish.state = _State.WANTED
        wish.attempts = 0
        wish.not_before_s = now_s + wish.again_s
        wish.again_s = min(2 * wish.again_s, _LONGEST_AGAIN_S)

    def _hold(self, wish: _Wish, rate_hz: float, from_s: float) -> None:
        """From here on it should come at this rate."""
        wish.state = _State.HELD
        wish.held_hz, wish.fallen = rate_hz, 0
        wish.began_s, wish.count = from_s, 0

    def _by(self, vehicle: _Vehicle, now_s: float) -> str | None:
        """The station that was heard to ask for something else."""
        if vehicle.overheard is None or now_s - vehicle.overheard[1] > _OVERHEARD_S:
            return None
        return f"the station {vehicle.overheard[0]}"

    def _name(self, wish: _Wish) -> str:
        return self._dialect.name_of(wish.msgid) or f"message {wish.msgid}"


_WHY = {_DENIED: ": the firmware allows no such rate"}


def _fields(payload: bytes, layout: str) -> tuple[int, ...]:
    """The fields of a payload in wire order; its trailing zeros may have been cut off."""
    size = struct.calcsize(layout)
    return struct.unpack(layout, payload[:size].ljust(size, b"\0"))
