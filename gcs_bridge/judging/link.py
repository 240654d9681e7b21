"""One link or recording: its frames, the vehicles on it, its clock; where its bytes come from is not known here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gcs_bridge.alarms.manager import AlarmManager
from gcs_bridge.chunks import Chunk, Chunks, Framing
from gcs_bridge.columns import Int64s
from gcs_bridge.contract import readable
from gcs_bridge.events import Event, Notice, Rank, VehicleLost, VehicleSeen, head, in_order
from gcs_bridge.judging.observation import Observation, Observer
from gcs_bridge.judging.snapshot import LinkNow, VehicleNow
from gcs_bridge.judging.vehicle import VehicleJudge
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scan import Bytes, Frames
from gcs_bridge.mavlink.scanner import RawFrame, Salvage, Scanner
from gcs_bridge.report import schema
from gcs_bridge.report.verdicts import worst_verdict
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.batches import VehicleBatch
from gcs_bridge.telemetry.component import VehicleReader
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import LinkClock, latest_rx
from gcs_bridge.telemetry.vehicle_presence import Presence

Datagram = tuple[bytes, int]  # with its receive time, µs since 1970
FrameObserver = Callable[[int | str, Sequence[RawFrame]], None]


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What is judged of every link, by what, and who looks on; `window_s`: between these times after the start."""

    settings: Settings
    dialect: Dialect
    sysid: int | None
    window_s: tuple[float | None, float | None]
    observer: Observer | None


class LinkVehicle:
    """One (system, component) of a link, which may turn out to be a vehicle."""

    def __init__(self, vehicle: VehicleId, judged: Judged) -> None:
        """Start with nothing heard; the observer is shown what is judged, once it is known to be a vehicle's."""
        self._observer = judged.observer
        self._observed: list[Observation] = []  # and not shown yet
        self.reader = VehicleReader(vehicle, judged.dialect, judged.settings.vehicle)
        self.judge = VehicleJudge(vehicle, judged.settings, self._observed.append if judged.observer else None)
        self._presence = Presence()
        self._seen = False
        self._held: list[Notice] = []  # until it is known to be one

    def take(self, batch: VehicleBatch, frame_indices: Int64s, link: LinkClock) -> list[Notice]:
        """Judge what a batch brought, in its frames `frame_indices`."""
        notices = [*self._turns(frame_indices, link), *self.judge.take(batch, frame_indices, link)]
        self._show()
        return self._release(notices)

    def _show(self) -> None:
        """Show what was judged, unless it is not known yet whose it is, or known to be no vehicle's."""
        if self.reader.is_vehicle and self._observer is not None:
            for observation in self._observed:
                self._observer(observation)
        if self.reader.is_decided:
            self._observed.clear()

    def advance(self, link: LinkClock) -> list[Notice]:
        """Time passed on the link and nothing of this vehicle came."""
        return self._release([*self._turns(np.empty(0, np.int64), link), *self.judge.advance(link)])

    def _turns(self, frame_indices: Int64s, link: LinkClock) -> Iterator[Notice]:
        for turn in self._presence.take(frame_indices, link):
            kind = VehicleLost if turn.lost else VehicleSeen
            event = kind(**head(self.reader.vehicle, None, None, turn.t_rx_us))
            yield Notice(turn.frame_index, event, Rank.IDENTITY)

    def _release(self, notices: list[Notice]) -> list[Notice]:
        """The notices to pass on: those at which it is a vehicle; earlier ones come behind the news that it is one."""
        if not self._seen:
            self._held += notices
            if self.reader.seen is None:
                return []
            frame_index, t_rx_us = self.reader.seen
            self._seen = True
            seen = VehicleSeen(**head(self.reader.vehicle, 0, None, t_rx_us))
            held = (
                notice._replace(frame_index=max(notice.frame_index, frame_index))
                for notice in in_order(self._held)
                if notice.rank is not Rank.IDENTITY
                or notice.frame_index > frame_index  # was it lost before it was known?
            )
            notices = [Notice(frame_index, seen, Rank.IDENTITY), *held]
            self._held = []
        return [notice for notice in notices if self.reader.is_vehicle_at(notice.frame_index)]


class Link:
    """One link or recording: its frames, the vehicles on it, its clock."""

    def __init__(self, judged: Judged, framing: Framing, *, number: int | None) -> None:
        """Start before its first byte; `number` is None on the first link, and on a recording."""
        self.frames = 0
        self.in_window = 0
        self.on_frames: Callable[[Sequence[RawFrame]], None] | None = None
        self._judged = judged
        self._scanner = Scanner(judged.dialect, timed=framing is Framing.RECORDS)
        self._datagrams = framing is Framing.DATAGRAM
        self._number = number
        self.is_open = True
        self._start_us: int | None = None
        self._latest_rx_us = -1
        self._vehicles: dict[int, LinkVehicle] = {}

    @property
    def span_us(self) -> int:
        """From the first receive time to the last, µs."""
        return 0 if self._start_us is None else self._latest_rx_us - self._start_us

    def take(self, chunks: Chunks, *, final: bool = False) -> list[Event]:
        """Scan the chunks and judge what they hold as one batch; the link's own framing holds, not theirs."""
        scanner = self._scanner
        frames = scanner.scan_chunks(chunks.data, chunks.ends, chunks.t_rx_us, whole=self._datagrams, final=final)
        if self.on_frames is not None and len(scanner.all_frames):
            self.on_frames(scanner.raw_frames())
        return events_of(self._judge(frames, scanner.buffer)) if len(frames) else []

    def open(self, *, datagrams: bool) -> None:
        """It is there again, and goes on counting where it left off."""
        self._datagrams = datagrams
        self.is_open = True

    def close(self, t_rx_us: int) -> list[Event]:
        """It has ended at `t_rx_us`: half a frame is given up; its vehicles fall silent as time passes."""
        self.is_open = False
        return [*self.finish(), *self.advance(t_rx_us)]

    def advance(self, t_rx_us: int) -> list[Event]:
        """Time has come to `t_rx_us` and nothing came."""
        if t_rx_us <= self._latest_rx_us:
            return []
        self._latest_rx_us = t_rx_us
        clock = LinkClock(np.array([self.frames]), np.array([t_rx_us]))
        return events_of(notice for vehicle in self._vehicles.values() for notice in vehicle.advance(clock))

    def alarm_managers(self) -> Iterator[AlarmManager]:
        """Of its vehicles."""
        return (vehicle.judge.alarm_manager for vehicle in self._vehicles.values())

    def now(self, name: int | str) -> tuple[LinkNow, list[VehicleNow]]:
        """What is known now of the link `name` and of its vehicles."""
        salvage = self._scanner.salvage
        link = LinkNow(
            name=name,
            is_open=self.is_open,
            frames=salvage.frames,
            bytes=salvage.bytes,
            bad_crc=salvage.bad_crc,
            skipped_bytes=salvage.skipped_bytes,
        )
        vehicles = [vehicle for _, vehicle in sorted(self._vehicles.items()) if vehicle.reader.is_vehicle]
        return link, [vehicle.judge.now(vehicle.reader, self._latest_rx_us) for vehicle in vehicles]

    def finish(self) -> list[Event]:
        """Nothing follows."""
        if self._datagrams:
            return []
        return self.take(Chunks.of([Chunk(b"", self._latest_rx_us, Framing.STREAM)]), final=True)

    def entry(self, name: str) -> schema.File:
        """The link's entry in the report."""
        vehicles = [
            vehicle.judge.entry(vehicle.reader)
            for _, vehicle in sorted(self._vehicles.items())
            if vehicle.reader.is_vehicle
        ]
        salvage = self._scanner.salvage
        return schema.File(
            path=readable(name),
            bytes=salvage.bytes,
            verdict=worst_verdict(vehicle.verdict for vehicle in vehicles),
            salvage=salvage_entry(salvage),
            vehicles=tuple(vehicles),
        )

    def _judge(self, frames: Frames, buffer: Bytes) -> Iterator[Notice]:
        frame_indices = np.arange(self.frames, self.frames + len(frames))
        self.frames += len(frames)
        latest_rx_us = latest_rx(frames["t_rx_us"], self._latest_rx_us)
        self._latest_rx_us = int(latest_rx_us[-1])
        if self._start_us is None and latest_rx_us[-1] > 0:
            self._start_us = int(frames["t_rx_us"][frames["t_rx_us"] > 0][0])  # a damaged first time reads as 0
        in_window = self._in_window(frames["t_rx_us"])
        self.in_window += int(in_window.sum())
        component = frames["sysid"].astype(np.int64) * 256 + frames["compid"]
        wanted = frames["duplicate"] == 0
        if self._judged.sysid is not None:
            wanted &= frames["sysid"] == self._judged.sysid
        clock = LinkClock(frame_indices, latest_rx_us)
        present = np.flatnonzero(np.bincount(component[wanted])).tolist()
        for key in present:
            rows = np.flatnonzero(wanted & (component == key))
            vehicle = self._vehicles.get(key) or self._new_vehicle(key)
            batch = vehicle.reader.read(buffer, np.take(frames, rows), frame_indices[rows], in_window[rows])
            yield from vehicle.take(batch, frame_indices[rows], clock)
        for key in self._vehicles.keys() - set(present):
            vehicle = self._vehicles[key]
            yield from vehicle.advance(clock)

    def _new_vehicle(self, key: int) -> LinkVehicle:
        vehicle_id = VehicleId(self._number, *divmod(key, 256))
        vehicle = LinkVehicle(vehicle_id, self._judged)
        self._vehicles[key] = vehicle
        return vehicle

    def _in_window(self, t_rx_us: Int64s) -> npt.NDArray[np.bool_]:
        start_us = self._start_us or 0
        inside = np.ones(len(t_rx_us), np.bool_)
        from_s, to_s = self._judged.window_s
        if from_s is not None:
            inside &= t_rx_us >= start_us + from_s * 1e6
        if to_s is not None:
            inside &= t_rx_us < start_us + to_s * 1e6
        return inside


def events_of(notices: Iterable[Notice]) -> list[Event]:
    """The events alone, in order."""
    return [notice.event for notice in in_order(notices)]


def salvage_entry(salvage: Salvage) -> schema.Salvage:
    """What was read of a link or file and what was not, for the report."""
    return schema.Salvage(
        frames=salvage.frames,
        bad_crc=salvage.bad_crc,
        repaired_crc=salvage.repaired_crc,
        unverified=salvage.unverified,
        skipped_bytes=salvage.skipped_bytes,
        signed=salvage.signed,
        duplicates=salvage.duplicates,
        bad_times=salvage.bad_times,
        read_fraction=salvage.read_fraction,
        gap_count=salvage.gap_count,
        gaps=tuple(schema.Gap(offset=offset, bytes=length) for offset, length in salvage.gaps),
    )
