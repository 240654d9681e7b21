"""Wires the stages: bytes → frames → samples → judged vehicles → events and report.

No I/O and no clock inside: bytes and receive times come as arguments. Live links and recordings go the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gcs_bridge.desk import Desk
from gcs_bridge.errors import UsageError
from gcs_bridge.events import Event, Notice, Rank, in_order, make_event
from gcs_bridge.judge import STREAMS, Observer, VehicleJudge
from gcs_bridge.liveness import LinkClock, latest_rx
from gcs_bridge.mavlink.dialect import Dialect, load_dialect
from gcs_bridge.mavlink.scan import FRAME, Bytes, Frames, RawFrame, Salvage, Scanner
from gcs_bridge.presence import Presence
from gcs_bridge.report import Report
from gcs_bridge.report.contract import worst_verdict
from gcs_bridge.settings import Settings, load_settings
from gcs_bridge.vehicles import VehicleBatch, VehicleReader

Int64s = npt.NDArray[np.int64]

_RECORDING = "recording"

Datagram = tuple[bytes, int]  # with its receive time, µs since 1970
_FRAME_BYTES = np.dtype((np.void, FRAME.itemsize))
FrameObserver = Callable[[int | str, Sequence[RawFrame]], None]


class Monitor:
    """Judges links and recordings as their bytes come.

    Fed with `feed` (a link's bytes) or `feed_recording` (a .tlog's), in pieces cut anywhere; the events that a piece
    brought about come back as dicts with the contract's keys. `close` returns the report.
    """

    def __init__(
        self,
        profile: str = "default",
        *,
        settings: Settings | None = None,
        dialect: str = "all",
        sysid: int | None = None,
        from_s: float | None = None,
        to_s: float | None = None,
        observer: Observer | None = None,
        on_frames: FrameObserver | None = None,
    ) -> None:
        """Take the settings of `profile`, or `settings`; judge `sysid` alone, or between two times after the start.

        `observer` is shown each vehicle's samples and pairs as they are judged; `on_frames` each link's frames as they
        came, before they are judged: whoever sent them, unknown ids included.
        Raises UsageError for an unknown profile or dialect.
        """
        self._settings = settings or load_settings(profile)
        self._dialect = open_dialect(dialect)
        self._sysid = sysid
        self._window_s = (from_s, to_s)
        self._observer = observer
        self._on_frames = on_frames
        self._links: dict[int | str, _Link] = {}

    def open_link(self, link: int, *, datagrams: bool = False) -> None:
        """Say before its first bytes that `link` brings datagrams: each `feed` is then one, with its borders."""
        if link in self._links:
            raise ValueError(f"link {link} is open already")
        self._new_link(link, timed=False, datagrams=datagrams)

    def feed(self, data: bytes | bytearray | memoryview, t_rx_us: int, link: int = 0) -> list[Event]:
        """Take the next bytes of a link, or one datagram, received at `t_rx_us` (µs since 1970; −1: unknown)."""
        found = self._links.get(link) or self._new_link(link, timed=False)
        return found.feed(data, t_rx_us)

    def feed_datagrams(self, datagrams: Sequence[Datagram], link: int = 0) -> list[Event]:
        """Take several datagrams of a link at once: the same as one `feed` each, at less cost."""
        found = self._links.get(link) or self._new_link(link, timed=False, datagrams=True)
        return found.feed_pieces(datagrams)

    def feed_recording(self, piece: bytes | bytearray | memoryview) -> list[Event]:
        """Take the next piece of a .tlog, cut anywhere; its records bring their receive times."""
        found = self._links.get(_RECORDING) or self._new_link(_RECORDING, timed=True)
        return found.feed(piece, -1)

    def advance(self, t_rx_us: int, link: int | None = None) -> list[Event]:
        """Time has come to `t_rx_us` and nothing came, on `link` or on any: tell of the deadlines that have passed."""
        quiet = self._links.values() if link is None else filter(None, [self._links.get(link)])
        return [event for one in quiet for event in one.advance(t_rx_us)]

    def acknowledge(self, alarm_id: str, t_rx_us: int) -> list[Event]:
        """Somebody has seen an alarm; UsageError for one that is not known, or was acknowledged before."""
        return self._answer(alarm_id, lambda desk, ordinal: desk.acknowledge(alarm_id, ordinal, t_rx_us))

    def shelve(self, alarm_id: str, t_rx_us: int, duration_s: float) -> list[Event]:
        """Tell nothing of an alarm, and of its returns, for `duration_s` of receive time; UsageError as above."""
        return self._answer(alarm_id, lambda desk, ordinal: desk.shelve(alarm_id, ordinal, t_rx_us, duration_s))

    def unshelve(self, alarm_id: str, t_rx_us: int) -> list[Event]:
        """Tell of an alarm again before its time; UsageError for one that is not shelved."""
        return self._answer(alarm_id, lambda desk, ordinal: desk.unshelve(alarm_id, ordinal, t_rx_us))

    def _answer(self, alarm_id: str, what: Callable[[Desk, int], Iterable[Notice]]) -> list[Event]:
        for link in self._links.values():
            for desk in link.desks():
                if desk.owns(alarm_id):
                    return _events(what(desk, link.frames))
        raise UsageError(f"unknown alarm {alarm_id!r}")

    def finish(self) -> list[Event]:
        """Nothing follows: decide what is still undecided, and tell what comes of it."""
        return [event for link in self._links.values() for event in link.finish()]

    def close(self) -> Report:
        """Nothing follows: report, one entry a link. Who wants the last events calls `finish` before."""
        self.finish()
        return Report(tuple(link.entry(str(name)) for name, link in self._links.items()))

    @property
    def window_is_empty(self) -> bool:
        """Whether frames were read, and none of them within the times to judge."""
        links = self._links.values()
        return any(link.frames for link in links) and not any(link.in_window for link in links)

    @property
    def span_s(self) -> float:
        """From the first receive time to the last, over all links."""
        return max((link.span_us for link in self._links.values()), default=0) / 1e6

    def _new_link(self, name: int | str, *, timed: bool, datagrams: bool = False) -> _Link:
        scanner = Scanner(self._dialect, timed=timed)
        link = _Link(scanner, datagrams, self._dialect, self._settings, self._sysid, self._window_s, self._observer)
        if self._on_frames is not None:
            link.on_frames = partial(self._on_frames, name)
        self._links[name] = link
        return link


def open_dialect(name: str) -> Dialect:
    """The dialect `name`; UsageError where pymavlink has none, or it lacks the messages that are compared."""
    try:
        dialect = load_dialect(name)
    except ValueError as error:
        raise UsageError(str(error)) from None
    missing = [stream for stream in STREAMS if stream not in dialect]
    if missing:
        raise UsageError(f"dialect {name!r} does not define {' and '.join(missing)}: nothing could be compared")
    return dialect


class _Vehicle:
    """One (system, component) of a link, which may turn out to be a vehicle."""

    def __init__(self, reader: VehicleReader, judge: VehicleJudge) -> None:
        self.reader = reader
        self.judge = judge
        self._presence = Presence()
        self._seen = False
        self._held: list[Notice] = []  # until it is known to be one

    def take(self, batch: VehicleBatch, ordinals: Int64s, link: LinkClock) -> list[Notice]:
        """Judge what a batch brought, in its frames `ordinals`."""
        return self._release([*self._turns(ordinals, link), *self.judge.take(batch, ordinals, link)])

    def advance(self, link: LinkClock) -> list[Notice]:
        """Time passed on the link and nothing of this vehicle came."""
        return self._release([*self._turns(np.empty(0, np.int64), link), *self.judge.advance(link)])

    def _turns(self, ordinals: Int64s, link: LinkClock) -> Iterator[Notice]:
        for turn in self._presence.take(ordinals, link):
            event = make_event(
                "vehicle_lost" if turn.lost else "vehicle_seen", self.reader.key, None, None, turn.t_rx_us
            )
            yield Notice(turn.ordinal, event, Rank.IDENTITY)

    def _release(self, notices: list[Notice]) -> list[Notice]:
        """The notices to pass on: those at which it is a vehicle; earlier ones come behind the news that it is one."""
        if not self._seen:
            self._held += notices
            if self.reader.seen is None:
                return []
            ordinal, t_rx_us = self.reader.seen
            self._seen = True
            seen = make_event("vehicle_seen", self.reader.key, 0, None, t_rx_us)
            held = (
                notice._replace(ordinal=max(notice.ordinal, ordinal))
                for notice in in_order(self._held)
                if notice.rank is not Rank.IDENTITY or notice.ordinal > ordinal  # was it lost before it was known?
            )
            notices = [Notice(ordinal, seen, Rank.IDENTITY), *held]
            self._held = []
        return [notice for notice in notices if self.reader.is_vehicle_at(notice.ordinal)]


class _Link:
    """One link or recording: its frames, the vehicles on it, its clock."""

    def __init__(
        self,
        scanner: Scanner,
        datagrams: bool,
        dialect: Dialect,
        settings: Settings,
        sysid: int | None,
        window_s: tuple[float | None, float | None],
        observer: Observer | None,
    ) -> None:
        self.frames = 0
        self.in_window = 0
        self.on_frames: Callable[[Sequence[RawFrame]], None] | None = None
        self._scanner = scanner
        self._datagrams = datagrams
        self._dialect = dialect
        self._settings = settings
        self._sysid = sysid
        self._window_s = window_s
        self._observer = observer
        self._start_us: int | None = None
        self._latest_rx_us = -1
        self._vehicles: dict[int, _Vehicle] = {}

    @property
    def span_us(self) -> int:
        return 0 if self._start_us is None else self._latest_rx_us - self._start_us

    def feed(self, data: bytes | bytearray | memoryview, t_rx_us: int, *, final: bool = False) -> list[Event]:
        return self.feed_pieces(((data, t_rx_us),), final=final)

    def feed_pieces(
        self, pieces: Sequence[tuple[bytes | bytearray | memoryview, int]], *, final: bool = False
    ) -> list[Event]:
        """Scan piece after piece, each with its own borders, and judge what they hold as one batch."""
        scanner = self._scanner
        found: list[Frames] = []
        buffers: list[Bytes] = []
        size = 0
        for data, t_rx_us in pieces:
            frames = scanner.scan(data, t_rx_us=t_rx_us, final=final or self._datagrams)
            if self.on_frames is not None and len(scanner.all_frames):
                self.on_frames(scanner.raw_frames())
            frames["payload"] += size  # the index in all buffers together
            found.append(frames)
            buffers.append(scanner.buffer)
            size += len(scanner.buffer)
        if not any(map(len, found)):
            return []
        if len(found) == 1:
            return _events(self._judge(found[0], buffers[0]))
        # As plain bytes: numpy takes long to join structured arrays.
        frames = np.concatenate([frames.view(_FRAME_BYTES) for frames in found]).view(FRAME)
        return _events(self._judge(frames, np.concatenate(buffers)))

    def advance(self, t_rx_us: int) -> list[Event]:
        if t_rx_us <= self._latest_rx_us:
            return []
        self._latest_rx_us = t_rx_us
        clock = LinkClock(np.array([self.frames]), np.array([t_rx_us]))
        return _events(notice for vehicle in self._vehicles.values() for notice in vehicle.advance(clock))

    def desks(self) -> Iterator[Desk]:
        return (vehicle.judge.desk for vehicle in self._vehicles.values())

    def finish(self) -> list[Event]:
        return [] if self._datagrams else self.feed(b"", self._latest_rx_us, final=True)

    def entry(self, name: str) -> dict[str, Any]:
        vehicles = [
            vehicle.judge.entry(vehicle.reader)
            for _, vehicle in sorted(self._vehicles.items())
            if vehicle.reader.is_vehicle
        ]
        salvage = self._scanner.salvage
        return {
            "path": name,
            "bytes": salvage.bytes,
            "verdict": worst_verdict(vehicle["verdict"] for vehicle in vehicles),
            "salvage": salvage_entry(salvage),
            "vehicles": vehicles,
        }

    def _judge(self, frames: Frames, buffer: Bytes) -> Iterator[Notice]:
        ordinals = np.arange(self.frames, self.frames + len(frames))
        self.frames += len(frames)
        latest_rx_us = latest_rx(frames["t_rx_us"], self._latest_rx_us)
        self._latest_rx_us = int(latest_rx_us[-1])
        if self._start_us is None and latest_rx_us[-1] > 0:
            self._start_us = int(frames["t_rx_us"][frames["t_rx_us"] > 0][0])  # a damaged first time reads as 0
        in_window = self._in_window(frames["t_rx_us"])
        self.in_window += int(in_window.sum())
        component = frames["sysid"].astype(np.int64) * 256 + frames["compid"]
        wanted = frames["duplicate"] == 0
        if self._sysid is not None:
            wanted &= frames["sysid"] == self._sysid
        clock = LinkClock(ordinals, latest_rx_us)
        present = np.flatnonzero(np.bincount(component[wanted])).tolist()
        for key in present:
            rows = np.flatnonzero(wanted & (component == key))
            vehicle = self._vehicles.get(key) or self._new_vehicle(key)
            batch = vehicle.reader.read(buffer, np.take(frames, rows), ordinals[rows], in_window[rows])
            yield from vehicle.take(batch, ordinals[rows], clock)
        for key in self._vehicles.keys() - set(present):
            vehicle = self._vehicles[key]
            yield from vehicle.advance(clock)

    def _new_vehicle(self, key: int) -> _Vehicle:
        sysid, compid = divmod(key, 256)
        reader = VehicleReader(sysid, compid, self._dialect, self._settings.vehicle)
        vehicle = _Vehicle(reader, VehicleJudge((sysid, compid), self._settings, self._observer))
        self._vehicles[key] = vehicle
        return vehicle

    def _in_window(self, t_rx_us: Int64s) -> npt.NDArray[np.bool_]:
        start_us = self._start_us or 0
        inside = np.ones(len(t_rx_us), np.bool_)
        from_s, to_s = self._window_s
        if from_s is not None:
            inside &= t_rx_us >= start_us + from_s * 1e6
        if to_s is not None:
            inside &= t_rx_us < start_us + to_s * 1e6
        return inside


def _events(notices: Iterable[Notice]) -> list[Event]:
    return [notice.event for notice in in_order(notices)]


def salvage_entry(salvage: Salvage) -> dict[str, Any]:
    """What was read of a link or file and what was not, for the report."""
    return {
        "frames": salvage.frames,
        "bad_crc": salvage.bad_crc,
        "repaired_crc": salvage.repaired_crc,
        "unverified": salvage.unverified,
        "skipped_bytes": salvage.skipped_bytes,
        "signed": salvage.signed,
        "duplicates": salvage.duplicates,
        "bad_times": salvage.bad_times,
        "read_fraction": salvage.read_fraction,
        "gap_count": salvage.gap_count,
        "gaps": [{"offset": offset, "bytes": length} for offset, length in salvage.gaps],
    }
