"""One link or recording: its frames, the vehicles on it, its clock; where its bytes come from is not known here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gcs_bridge.alarms.manager import AlarmManager
from gcs_bridge.chunks import Chunk, Chunks, Framing
from gcs_bridge.contract import readable
from gcs_bridge.events import Event, Notice, ReceiverPaused, in_order
from gcs_bridge.judging.link_vehicle import Judged, LinkVehicle
from gcs_bridge.judging.signing_watch import SigningWatch
from gcs_bridge.judging.snapshot import LinkNow, VehicleNow
from gcs_bridge.mavlink.scanner import RawFrame, Salvage, Scanner
from gcs_bridge.mavlink.signing import SignatureCounts
from gcs_bridge.report import schema
from gcs_bridge.report.verdicts import worst_verdict
from gcs_bridge.telemetry.batches import VehicleBatch
from gcs_bridge.telemetry.census import Census
from gcs_bridge.telemetry.component import VehicleReader
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock
from gcs_bridge.telemetry.others import OfOthers, Others
from gcs_bridge.telemetry.roster import Roster
from gcs_bridge.telemetry.sorting import FrameSorter, SortedFrames

Datagram = tuple[bytes, int]  # with its receive time, µs since 1970
FrameObserver = Callable[[int | str, Sequence[RawFrame]], None]
MOST_BRIEF, MOST_BRIEF_NOW = 1000, 64  # vehicles heard too briefly to be judged that are listed, in a report and live
MOST_OTHERS = 100  # that the report lists; all are counted
LEAST_COPIED, COPIED_SHARE = 20, 0.9  # frames, and of the copies that there would be, for each to come so often


class ScannedBatch(NamedTuple):
    """Frames, sorted; None: there was no whole one. `done`: bytes of the link so far.

    `heard` is what was read of each of the batch's shares, `said` what others said that matters to vehicles.
    """

    batch: SortedFrames | None
    heard: Sequence[VehicleBatch]
    said: Sequence[OfOthers]
    done: int
    raw: Sequence[RawFrame]
    signing: Sequence[Notice]  # what there is to tell of how frames are signed


class Link:
    """One link or recording: its frames, the vehicles on it, its clock."""

    def __init__(self, judged: Judged, framing: Framing, *, number: int | None, census: Census | None = None) -> None:
        """Start before its first byte; `number` is None on the first link, and on a recording.

        `census` is told of every frame.
        """
        self.on_frames: Callable[[Sequence[RawFrame]], None] | None = None
        self._judged = judged
        self._scanner = Scanner(judged.dialect, timed=framing is Framing.RECORDS, signing=judged.signing)
        self._signing = SigningWatch(judged.signing, number)
        self._datagrams = framing is Framing.DATAGRAM
        self._number = number
        self.is_open = True
        self.census = census
        self._sorter = FrameSorter(judged.dialect, judged.sysid, judged.window_s)
        self._roster = Roster(judged.dialect)
        self._others = Others(judged.dialect)
        self._readers: dict[tuple[int, int], VehicleReader] = {}
        self._vehicles: dict[tuple[int, int], LinkVehicle] = {}
        self._paused_us = -1  # until when the last pause of the receiver was that was told of
        self._due_us = np.empty(0, np.int64)  # of each of them, when time alone may change something

    @property
    def frames(self) -> int:
        """How many frames came so far, and were not refused."""
        return self._sorter.frames

    @property
    def found(self) -> int:
        """How many were found, those included that are refused for their signature."""
        return self._scanner.frames

    @property
    def in_window(self) -> int:
        """How many of them within the times that are judged."""
        return self._sorter.inside

    @property
    def latest_rx_us(self) -> int:
        """The receive time so far, µs since 1970; −1: not known yet."""
        return self._sorter.latest_rx_us

    @property
    def line_ends(self) -> str | None:
        """Which line ends were turned into others, as if the bytes were text; None: there is no sign of it."""
        return self._scanner.salvage.line_ends

    @property
    def span_us(self) -> int:
        """From the first receive time to the last, µs."""
        start_us = self._sorter.start_us
        return 0 if start_us is None else self._sorter.latest_rx_us - start_us

    def take(self, chunks: Chunks, *, final: bool = False) -> list[Event]:
        """Scan the chunks and judge what they hold as one batch; the link's own framing holds, not theirs."""
        return self.judge(self.scan(chunks, final=final))

    def scan(self, chunks: Chunks, *, final: bool = False) -> ScannedBatch:
        """The frames that the chunks complete, and what is in them.

        Another thread may call this while those before are judged: what it changes is not used there.
        """
        scanner = self._scanner
        frames = scanner.scan_chunks(chunks.data, chunks.ends, chunks.t_rx_us, whole=self._datagrams, final=final)
        if self.census is not None:
            self.census.take(scanner)
        raw = scanner.raw_frames() if self.on_frames is not None and len(scanner.all_frames) else ()
        signing = self._signing.look(scanner, self._sorter.frames)
        if not len(frames):
            return ScannedBatch(None, (), (), scanner.read, raw, signing)
        batch = self._sorter.sort(scanner.buffer, frames)
        self._roster.note(batch.buffer, batch.frames)
        heard = [self._reader(share.address).read(batch, share) for share in batch.shares]
        return ScannedBatch(batch, heard, self._others.read(batch), scanner.read, raw, signing)

    def _reader(self, address: tuple[int, int]) -> VehicleReader:
        reader = self._readers.get(address)
        if reader is None:
            judged, vehicle = self._judged, VehicleId(self._number, *address)
            positions = judged.observer is not None
            reader = VehicleReader(vehicle, judged.dialect, judged.settings.vehicle, positions=positions)
            self._readers[address] = reader
        return reader

    def judge(self, scanned: ScannedBatch) -> list[Event]:
        """Judge frames as one batch."""
        if scanned.raw and self.on_frames is not None:
            self.on_frames(scanned.raw)
        judged = [] if scanned.batch is None else self._judge(scanned, scanned.batch)
        return events_of([*scanned.signing, *judged])

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
        clock = self._sorter.pass_time(t_rx_us)
        return [] if clock is None else events_of(self._pass_time(clock))

    @property
    def calm_s(self) -> float:
        """As `Monitor.calm_s`, of the vehicles that are here and judged."""
        return min((calm_s for one in self._vehicles.values() if (calm_s := one.calm_s) is not None), default=0.0)

    @property
    def asked(self) -> LinkVehicle | None:
        """A vehicle about which a question to its doctor is open, if there is any."""
        return next((vehicle for vehicle in self._vehicles.values() if vehicle.is_asked), None)

    def answer(self) -> list[Event]:
        """Have a doctor answer one question."""
        vehicle = self.asked
        return [] if vehicle is None else events_of(vehicle.answer())

    def set_clock(self, t_rx_us: int) -> None:
        """The clock of receive times was set to `t_rx_us`."""
        self._sorter.set_clock(t_rx_us)

    def alarm_managers(self) -> Iterator[AlarmManager]:
        """Of its vehicles; what is done with them may change what is due."""
        self._due_us[:] = 0
        managers = (vehicle.alarm_manager for vehicle in self._vehicles.values())
        return (manager for manager in managers if manager is not None)

    def now(self, name: int | str, most: int | None) -> tuple[LinkNow, list[VehicleNow]]:
        """What is known now of the link `name` and of its vehicles: of all, or of the `most` that came first."""
        salvage = self._scanner.salvage
        vehicles = self._listed(MOST_BRIEF_NOW) if most is None else self._first_judged(most)
        link = LinkNow(
            name=name,
            is_open=self.is_open,
            frames=salvage.frames,
            bytes=salvage.bytes,
            bad_crc=salvage.bad_crc,
            skipped_bytes=salvage.skipped_bytes,
            unlisted=self._claimed - len(vehicles),
        )
        return link, [vehicle.judge.now(vehicle.known, self._sorter.latest_rx_us) for vehicle in vehicles]

    def finish(self) -> list[Event]:
        """Nothing follows."""
        if self._datagrams:
            return []
        return self.take(Chunks.of([Chunk(b"", self._sorter.latest_rx_us, Framing.STREAM)]), final=True)

    def entry(self, name: str) -> schema.File:
        """The link's entry in the report."""
        vehicles = [vehicle.judge.entry(vehicle.known) for vehicle in self._listed(MOST_BRIEF)]
        salvage = self._scanner.salvage
        listed = {(vehicle.sysid, vehicle.compid) for vehicle in vehicles}
        others = [one for one in self._roster.heard() if one.address not in listed]
        most = sorted(others, key=lambda one: -one.frames)[:MOST_OTHERS]
        return schema.File(
            path=readable(name),
            bytes=salvage.bytes,
            verdict=worst_verdict(vehicle.verdict for vehicle in vehicles),
            salvage=salvage_entry(salvage, self._remarks(salvage)),
            vehicles=tuple(vehicles),
            others=tuple(schema.Station(**one._asdict()) for one in sorted(most)),
            other_count=len(others),
        )

    def _listed(self, most_brief: int) -> list[LinkVehicle]:
        """The vehicles in their order; those heard too briefly to be judged only where they are no more than that."""
        vehicles = [vehicle for _, vehicle in sorted(self._vehicles.items()) if vehicle.known.is_vehicle]
        if sum(vehicle.is_brief for vehicle in vehicles) <= most_brief:
            return vehicles
        return [vehicle for vehicle in vehicles if not vehicle.is_brief]

    def _first_judged(self, most: int) -> list[LinkVehicle]:
        """Of the vehicles that came for long enough the first ones: in the order in which there was enough of them."""
        found = [
            (vehicle.judged_from, address)
            for address, vehicle in self._vehicles.items()
            if vehicle.judged_from is not None and vehicle.known.is_vehicle
        ]
        return [self._vehicles[address] for _, address in sorted(found)[:most]]

    @property
    def _claimed(self) -> int:
        """How many claim to be vehicles."""
        return sum(vehicle.known.is_vehicle for vehicle in self._vehicles.values())

    def _remarks(self, salvage: Salvage) -> Iterator[str]:
        """What there is to say of how the bytes came."""
        if salvage.line_ends is not None:
            yield (
                f"a text conversion has turned {salvage.line_ends} in it, as if it were text: what that broke is lost; "
                "copy it anew as binary"
            )
        vehicles = self._listed(MOST_BRIEF)
        for vehicle in vehicles:
            repeated = self._scanner.repeated(*vehicle.vehicle.address)
            told = copies(vehicle.known.received, repeated)
            if told is not None:
                yield f"{told}, by {{}},{{}}: it counts once".format(*vehicle.vehicle.address)
        unlisted = self._claimed - len(vehicles)
        if unlisted:
            yield f"{unlisted} that claim to be vehicles were heard too briefly to be judged, and are not listed"
        wanted = self._judged.sysid
        if wanted is not None and all(one.sysid != wanted for one in self._roster.heard()):
            present = sorted({one.sysid for one in self._roster.heard()})
            yield f"system {wanted} was not heard; there are {', '.join(map(str, present)) or 'none'}"

    def _judge(self, scanned: ScannedBatch, batch: SortedFrames) -> list[Notice]:
        return self._tell_pauses_once(list(self._judge_batch(scanned, batch)), batch.clock)

    def _tell_pauses_once(self, notices: list[Notice], clock: LinkClock) -> list[Notice]:
        """Of the vehicles that show that the receiver paused, the first one alone is told of."""
        pauses = [one for one in notices if isinstance(one.event, ReceiverPaused)]
        for one in in_order(pauses):
            assert isinstance(one.event, ReceiverPaused)
            at_us = clock.at(one.frame_index) if one.frame_index >= clock.frame_index[0] else self._paused_us
            if at_us - one.event.pause_s * 1e6 < self._paused_us:
                notices.remove(one)
            self._paused_us = max(self._paused_us, at_us)
        return notices

    def _judge_batch(self, scanned: ScannedBatch, batch: SortedFrames) -> Iterator[Notice]:
        said = scanned.said
        if said:
            there = {share.address for share in batch.shares}
            for address, vehicle in self._vehicles.items():
                if address not in there:
                    yield from vehicle.hear(said)
        for share, heard in zip(batch.shares, scanned.heard, strict=True):
            vehicle = self._vehicles.get(share.address) or self._new_vehicle(share.address)
            yield from vehicle.take(heard, batch, share, said)
            self._due_us[vehicle.place] = vehicle.due_us
        yield from self._pass_time(batch.clock)

    def _pass_time(self, clock: LinkClock) -> Iterator[Notice]:
        """Tell of the deadlines that have passed of vehicles of which nothing came."""
        due = np.flatnonzero(self._due_us <= clock.heard_us[-1])
        if len(due):
            vehicles = list(self._vehicles.values())
            for place in due.tolist():
                yield from vehicles[place].advance(clock)
                self._due_us[place] = vehicles[place].due_us

    def _new_vehicle(self, address: tuple[int, int]) -> LinkVehicle:
        vehicle_id = VehicleId(self._number, *address)
        vehicle = LinkVehicle(vehicle_id, self._judged, len(self._vehicles))
        self._vehicles[address] = vehicle
        self._due_us = np.append(self._due_us, NEVER_US)
        return vehicle


def events_of(notices: Iterable[Notice]) -> list[Event]:
    """The events alone, in order."""
    return [notice.event for notice in in_order(notices)]


def copies(received: int, repeated: int) -> str | None:
    """How often each frame of a component came, as far as that is so: `repeated` frames beside those `received`.

    >>> copies(1000, 998), copies(1000, 2000), copies(1000, 3), copies(4, 4)
    ('each frame came twice', 'each frame came 3 times', None, None)
    """
    times = round(1 + repeated / received) if received else 1
    if received < LEAST_COPIED or times < 2 or 1 + repeated / received < COPIED_SHARE * times:
        return None
    return "each frame came twice" if times == 2 else f"each frame came {times} times"


def signatures_entry(counts: SignatureCounts) -> schema.Signatures:
    """What the signatures came to, for the report."""
    return schema.Signatures(
        valid=counts.holds,
        unsigned=counts.unsigned,
        wrong=counts.wrong,
        replayed=counts.replayed,
        old=counts.old,
        refused=counts.refused,
    )


def salvage_entry(salvage: Salvage, remarks: Iterable[str] = ()) -> schema.Salvage:
    """What was read of a link or file and what was not, for the report."""
    return schema.Salvage(
        frames=salvage.frames,
        bad_crc=salvage.bad_crc,
        repaired_crc=salvage.repaired_crc,
        unverified=salvage.unverified,
        skipped_bytes=salvage.skipped_bytes,
        signed=salvage.signed,
        signatures=None if salvage.signatures is None else signatures_entry(salvage.signatures),
        duplicates=salvage.duplicates,
        bad_times=salvage.bad_times,
        read_fraction=salvage.read_fraction,
        remarks=tuple(remarks),
        gap_count=salvage.gap_count,
        gaps=tuple(schema.Gap(offset=offset, bytes=length) for offset, length in salvage.gaps),
    )
