"""This program as a station of its own: the relay, and all that is sent because somebody asked for it.

It is given frames and events as any sink, and a turn whenever the loop comes round. Everything goes out from here: with
nothing asked for there is no such station, and nothing else can send.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gcs_bridge.events import Event, Reboot, VehicleLost, VehicleSeen
from gcs_bridge.links.link import Link
from gcs_bridge.links.uri import SPEAK_FIRST
from gcs_bridge.mavlink.dialect import Dialect, load_dialect
from gcs_bridge.mavlink.envelope import Addresses, envelope
from gcs_bridge.mavlink.packer import Packer
from gcs_bridge.mavlink.scanner import Scanner
from gcs_bridge.mavlink.secrets import carries_key
from gcs_bridge.sending.asked import Asked
from gcs_bridge.sending.outlets import Heard, Outlet, open_outlet
from gcs_bridge.sending.rates import RateRequests, Who
from gcs_bridge.sending.texts import AlarmTexts
from gcs_bridge.sinks.base import Sink

if TYPE_CHECKING:
    from gcs_bridge.mavlink.scanner import RawFrame
    from gcs_bridge.settings import TransmitSettings

__all__ = ["Station"]
_BEAT_S = 1.0  # as MAVLink has it (mavlink.io, services/heartbeat.html)
_TELL_S = 60.0  # from one time that drops are told to the next
_SILENT_S = 5.0  # a link that must speak first, and hears nothing for so long, speaks again
_PEERS = 64  # whose bytes are read apart; more are forgotten and begun anew


@dataclass
class _Told:
    """How many drops were told, and when last."""

    dropped: int = 0
    at_s: float = field(default=-_TELL_S)


class Station(Sink):
    """Relays, answers, requests, texts and heartbeats of one run."""

    def __init__(
        self,
        asked: Asked,
        settings: TransmitSettings,
        links: Sequence[Link],
        *,
        dialect: str,
        note: Callable[[str], None],
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the relays; SourceError where one cannot be. `clock_s` never steps; `note` tells people one line."""
        self._asked = asked
        self._own = settings.system_id, settings.component_id
        self._links = links
        self._note = note
        self._clock_s = clock_s
        self._dialect: Dialect = load_dialect(dialect)
        self._addresses = Addresses(self._dialect)
        self._packers: dict[tuple[object, int], Packer] = {}
        self._told: dict[object, _Told] = {}
        self._refused = [0] * len(links)  # frames that a link did not take
        self._heard: list[set[int]] = [set() for _ in links]  # the systems on each link
        self._heard_s = [float("-inf")] * len(links)
        self._readers: dict[tuple[object, ...], Scanner] = {}
        self._texts = AlarmTexts()
        self._rates = None if asked.rates_hz is None else RateRequests(asked.rates_hz, self._own, self._dialect, note)
        self._beat_s = float("-inf")
        self._reads_frames = asked.both_ways or self._rates is not None
        self._speaks_first = [link.name.partition(":")[0] in SPEAK_FIRST for link in links]
        self._outlets: list[Outlet] = []
        with ExitStack() as opened:
            for uri in asked.relays:
                self._outlets.append(open_outlet(uri, note))
                opened.callback(self._outlets[-1].close)
            opened.pop_all()  # all could be opened
        if asked.transmits:
            for link in links:
                link.allow_sending()

    # --- a sink -----------------------------------------------------------------------------------------------------

    def frames(self, link: int | str, frames: Sequence[RawFrame]) -> None:
        """Pass them on, all but the secret."""
        number = link if isinstance(link, int) else 0
        now_s = self._clock_s()
        self._heard_s[number] = now_s
        passed = [frame.data for frame in frames if not carries_key(frame.data)]
        for outlet in self._outlets:
            outlet.send(passed)
        if self._reads_frames:
            self._heard[number].update(frame[5] if frame[0] == _V2 else frame[3] for frame in passed)
            if self._rates is not None:
                self._rates.frames(number, passed, now_s)

    def events(self, events: Sequence[Event]) -> None:
        """Take what became of vehicles and alarms."""
        now_s = self._clock_s()
        if self._rates is not None:
            for event in events:
                if isinstance(event, VehicleSeen | Reboot | VehicleLost) and event.vehicle is not None:
                    who = Who(event.link if isinstance(event.link, int) else 0, *event.vehicle)
                    if isinstance(event, VehicleLost):
                        self._rates.lost(who)
                    else:
                        self._rates.seen(who, now_s)
        if self._asked.texts:
            for said in self._texts.of(events, now_s):
                self._say(said.link, said.system, said.severity, said.text)

    def close(self) -> None:
        """Give the relays back."""
        for outlet in self._outlets:
            outlet.close()

    # --- a part of the loop -----------------------------------------------------------------------------------------

    def descriptors(self) -> list[int]:
        """What to wait on beside the links."""
        return [descriptor for outlet in self._outlets for descriptor in outlet.descriptors()]

    def run(self) -> None:
        """Do what has become due; waits for nobody."""
        now_s = self._clock_s()
        for place, outlet in enumerate(self._outlets):
            for heard in outlet.run(now_s):
                if self._asked.both_ways:
                    self._answer(place, heard, now_s)
            self._tell_drops(("relay", place), f"relay {outlet.name}", outlet.dropped, now_s)
        if self._rates is not None:
            for request in self._rates.due(now_s):
                packer = self._packer(request.to.link, self._own[0])
                self._send(request.to.link, request.packed(packer), request.to.system)
        if self._asked.transmits and now_s - self._beat_s >= _BEAT_S:
            self._beat_s = now_s
            self._beat(now_s)
        self._tell_drops("texts", "--statustext", self._texts.withheld, now_s)
        for number, refused in enumerate(self._refused):
            self._tell_drops(("link", number), f"{self._links[number].name}: what is sent to it", refused, now_s)

    def _beat(self, now_s: float) -> None:
        """Heartbeats: of a ground station where that was asked for, else where a link is silent until spoken to."""
        for number in range(len(self._links)):
            silent = self._speaks_first[number] and now_s - self._heard_s[number] > _SILENT_S
            if self._asked.as_gcs or silent:
                packer = self._packer(number, self._own[0])
                self._send(number, packer.heartbeat(ground_station=self._asked.as_gcs), 0)

    def _answer(self, place: int, heard: Heard, now_s: float) -> None:
        """A station on a relay has sent something: what is whole goes to the link of the one that it is meant for."""
        peer = (place, *heard.station)
        if peer not in self._readers:
            if len(self._readers) >= _PEERS:
                self._readers.clear()
            self._readers[peer] = Scanner(self._dialect, timed=False)
        reader = self._readers[peer]
        data = np.frombuffer(heard.data, np.uint8)
        reader.scan_chunks(data, np.array([data.size]), np.array([-1]), whole=heard.datagram)
        for frame in reader.raw_frames():
            if carries_key(frame.data):
                continue
            sent = envelope(frame.data)
            if self._rates is not None:
                self._rates.overhear(sent, now_s)
            system = self._addresses.target_system(sent.msgid, sent.payload)
            for number, systems in enumerate(self._heard):
                if not system or system in systems or not self._is_known(system):
                    self._send(number, frame.data, system if system in systems else 0)

    def _is_known(self, system: int) -> bool:
        return any(system in systems for systems in self._heard)

    def _say(self, link: int, system: int, severity: int, text: str) -> None:
        """A text about a vehicle: to the stations on the relays, else by way of the vehicle's link.

        As a component of that vehicle: QGroundControl shows no texts of any other system; MAVProxy, too, those of other
        components after `set target_component 0`.
        """
        if self._outlets:
            for place, outlet in enumerate(self._outlets):
                outlet.send([self._packer(("relay", place), system).text(severity, text)])
        else:
            self._send(link, self._packer(link, system).text(severity, text), system)

    def _send(self, number: int, frame: bytes, system: int) -> None:
        if not self._links[number].send(frame, system):
            self._refused[number] += 1

    def _packer(self, receiver: object, system: int) -> Packer:
        """Of our component in a system, for one receiver: each counts the sequence numbers that it gets."""
        key = receiver, system
        if key not in self._packers:
            self._packers[key] = Packer(system, self._own[1])
        return self._packers[key]

    def _tell_drops(self, key: object, where: str, dropped: int, now_s: float) -> None:
        told = self._told.setdefault(key, _Told())
        if dropped > told.dropped and now_s - told.at_s >= _TELL_S:
            self._note(f"{where}: {dropped - told.dropped} frames were dropped: more than it takes")
            told.dropped, told.at_s = dropped, now_s


_V2 = 0xFD
