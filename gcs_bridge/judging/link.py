"""One link or recording: its frames, the vehicles on it, its clock; where its bytes come from is not known here."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gcs_bridge.alarms.manager import AlarmManager
from gcs_bridge.chunks import Chunk, Chunks, Framing
from gcs_bridge.columns import Int64Rows, Int64s, record
from gcs_bridge.contract import readable
from gcs_bridge.events import Event, Notice, Rank, ReceiverPaused, VehicleLost, VehicleSeen, head, in_order
from gcs_bridge.judging.observation import Observation, Observer
from gcs_bridge.judging.snapshot import LinkNow, VehicleNow
from gcs_bridge.judging.vehicle import VehicleJudge
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.scanner import RawFrame, Salvage, Scanner
from gcs_bridge.report import schema
from gcs_bridge.report.verdicts import worst_verdict
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.batches import VehicleBatch
from gcs_bridge.telemetry.clocks import NO_TIMES
from gcs_bridge.telemetry.component import VehicleReader
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock
from gcs_bridge.telemetry.messages import KIND
from gcs_bridge.telemetry.rate_requests import RateRequest, asks, rate_requests
from gcs_bridge.telemetry.roster import Roster
from gcs_bridge.telemetry.samples import STREAMS
from gcs_bridge.telemetry.sorting import FrameSorter, Share, SortedFrames
from gcs_bridge.telemetry.vehicle_presence import Presence

Datagram = tuple[bytes, int]  # with its receive time, µs since 1970
FrameObserver = Callable[[int | str, Sequence[RawFrame]], None]


@record
class Judged:
    """What is judged of every link, by what, and who looks on; `window_s`: between these times after the start."""

    settings: Settings
    dialect: Dialect
    sysid: int | None
    window_s: tuple[float | None, float | None]
    observer: Observer | None


class Scanned(NamedTuple):
    """Frames, sorted; None: there was no whole one. `done`: bytes of the link so far."""

    batch: SortedFrames | None
    done: int
    raw: Sequence[RawFrame]


class LinkVehicle:
    """One (system, component) of a link, which may turn out to be a vehicle.

    What judges it is large, and anybody can send a frame under any number: it is made with the second attitude of a
    stream, or once enough else came, and is given then what came before. Nothing is told of it before that frame but
    that the vehicle is there.
    """

    def __init__(self, vehicle: VehicleId, judged: Judged, place: int) -> None:
        """Start with nothing heard; the observer is shown what is judged, once it is known to be a vehicle's.

        `place`: how many others the link has found before it.
        """
        self.place = place
        self._judged = judged
        self._observer = judged.observer
        self._observed: deque[Observation] = deque(maxlen=_MOST_OBSERVED)  # and not shown yet
        self.reader = VehicleReader(vehicle, judged.dialect, judged.settings.vehicle)
        self._judge: VehicleJudge | None = None
        self._waiting: list[Callable[[VehicleJudge], Iterable[Notice]]] = []  # for it: how it is given what came
        self._waits_since_us, self._waited_s = NEVER_US, 0  # since its last frame; NEVER: nothing had a time yet
        self._attitudes = [0, 0]  # that came, by stream, while it waits
        self._told_from: int | None = None  # the frame from which on what is judged is told
        self._early: list[Notice] | None = []  # until then
        self._presence = Presence()
        self._first_frame_index: int | None = None
        self._seen = False
        self._held: list[Notice] = []  # until it is known to be one

    @property
    def is_brief(self) -> bool:
        """Whether it was heard too briefly to be judged."""
        return self._told_from is None

    @property
    def judge(self) -> VehicleJudge:
        """What judges it, by all that came so far; it is made where it waits for more."""
        if self._judge is None:
            observer = self._observed.append if self._observer else None
            self._judge = judge = VehicleJudge(self.reader.vehicle, self._judged.settings, observer)
            assert self._early is not None
            for hand in self._waiting:
                self._early += hand(judge)
            self._waiting.clear()
        return self._judge

    @property
    def alarm_manager(self) -> AlarmManager | None:
        """Its alarms, if it is judged."""
        return None if self._judge is None else self._judge.alarm_manager

    def take(self, batch: SortedFrames, share: Share, requests: Sequence[RateRequest] = ()) -> list[Notice]:
        """Judge its share of a batch, and what others asked of it meanwhile."""
        if self._first_frame_index is None:
            self._first_frame_index = int(batch.frame_indices(share)[0])
        heard, clock, asked = self.reader.read(batch, share), batch.clock, self._of(requests)
        turns = list(self._turns(heard.frame_index, clock, heard.timed))
        if self._told_from is None:
            self._told_from = self._first_told(heard, batch, share)
        if self._judge is None and self._told_from is None:
            self._waiting.append(lambda judge: judge.take(heard, heard.frame_index, clock, asked))
            if heard.segments or self._waits_since_us != NEVER_US:
                self._waits_since_us, self._waited_s = int(clock.heard_us[-1]), 0
            return self._release(turns)
        told = self._told(list(self.judge.take(heard, heard.frame_index, clock, asked)))
        self._show()
        return self._release([*turns, *told])

    def _first_told(self, heard: VehicleBatch, batch: SortedFrames, share: Share) -> int | None:
        """The frame of its share with which enough came of it, None where that is not so yet."""
        frames = []
        for stream, name in enumerate(STREAMS):
            before, count = self._attitudes[stream], share.count(KIND[name])
            self._attitudes[stream] += count
            if before < JUDGED_ATTITUDES <= before + count:
                frames.append(batch.first + int(batch.rows(share, KIND[name])[JUDGED_ATTITUDES - 1 - before]))
        received = self.reader.received
        if received >= JUDGED_FRAMES:
            frames.append(int(heard.frame_index[JUDGED_FRAMES - 1 - received]))
        return min(frames, default=None)

    def _told(self, judged: list[Notice]) -> list[Notice]:
        """Of what was judged, that which is told by now: what came before the first frame of that, with it."""
        if self._early is None:
            return judged
        self._early += judged
        first = self._told_from
        if first is None:
            return []
        early, self._early = in_order(self._early), None
        return [notice._replace(frame_index=max(notice.frame_index, first)) for notice in early]

    def ask(self, requests: Sequence[RateRequest]) -> list[Notice]:
        """Others asked for rates, in a batch that brought nothing of this vehicle."""
        asked = self._of(requests)
        if not asked:
            return []
        if self._judge is not None:
            return self._release(self._told(list(self._judge.ask(asked))))
        if len(self._waiting) < _MOST_WAITING:
            self._waiting.append(lambda judge: judge.ask(asked))
        return []

    def _of(self, requests: Sequence[RateRequest]) -> Sequence[RateRequest]:
        """Those that are meant for it, and came when it was there."""
        since = self._first_frame_index
        if not requests or since is None:
            return ()
        address = self.reader.vehicle.address
        return [one for one in requests if one.is_for(address) and one.by != address and one.frame_index > since]

    @property
    def due_us(self) -> int:
        """The time on the link, as it is heard, from which on time alone may change something."""
        if self._judge is not None:
            return min(self._presence.due_us, self._judge.due_us)
        if self._waits_since_us == NEVER_US or self._waited_s >= _LONGEST_WAIT_S:
            return self._presence.due_us
        return min(self._presence.due_us, self._waits_since_us + (self._waited_s + 1) * 1_000_000)

    def _wait(self, link: LinkClock) -> None:
        """Time passed on the link: what will judge it is to know, second by second, as long as deadlines may pass."""
        if self._waited_s < _LONGEST_WAIT_S:
            self._waiting.append(lambda judge: judge.advance(link))
            self._waited_s += 1

    def _show(self) -> None:
        """Show what was judged, unless it is not known yet whose it is, or known to be no vehicle's."""
        if self.reader.is_vehicle and self._observer is not None:
            for observation in self._observed:
                self._observer(observation)
        if self.reader.is_decided:
            self._observed.clear()

    def advance(self, link: LinkClock) -> list[Notice]:
        """Time passed on the link and nothing of this vehicle came."""
        turns = list(self._turns(_NO_FRAMES, link))
        if self._judge is None:
            if self._waits_since_us + (self._waited_s + 1) * 1_000_000 <= link.heard_us[-1]:
                self._wait(link)
            return self._release(turns)
        return self._release([*turns, *self._told(list(self._judge.advance(link)))])

    def _turns(self, frame_indices: Int64s, link: LinkClock, timed: Int64Rows = NO_TIMES) -> Iterator[Notice]:
        for turn in self._presence.take(frame_indices, link, timed):
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


_NO_FRAMES: Int64s = np.empty(0, np.int64)
JUDGED_ATTITUDES, JUDGED_FRAMES = 2, 32  # of one stream, and of all: with either a component is judged
_MOST_OBSERVED = 256  # batches: of who may be a vehicle for longer, the latest alone are shown
_MOST_WAITING = 128  # requests are kept for it no longer
_LONGEST_WAIT_S = 12  # behind a frame the longest deadline, see stream_liveness, has passed
MOST_BRIEF, MOST_BRIEF_NOW = 1000, 64  # vehicles heard too briefly to be judged that are listed, in a report and live
MOST_OTHERS = 100  # that the report lists; all are counted
LEAST_COPIED, COPIED_SHARE = 20, 0.9  # frames, and of the copies that there would be, for each to come so often


class Link:
    """One link or recording: its frames, the vehicles on it, its clock."""

    def __init__(self, judged: Judged, framing: Framing, *, number: int | None) -> None:
        """Start before its first byte; `number` is None on the first link, and on a recording."""
        self.on_frames: Callable[[Sequence[RawFrame]], None] | None = None
        self._judged = judged
        self._scanner = Scanner(judged.dialect, timed=framing is Framing.RECORDS)
        self._datagrams = framing is Framing.DATAGRAM
        self._number = number
        self.is_open = True
        self._sorter = FrameSorter(judged.dialect, judged.sysid, judged.window_s)
        self._roster = Roster(judged.dialect)
        self._vehicles: dict[tuple[int, int], LinkVehicle] = {}
        self._paused_us = -1  # until when the last pause of the receiver was that was told of
        self._due_us = np.empty(0, np.int64)  # of each of them, when time alone may change something

    @property
    def frames(self) -> int:
        """How many frames came so far."""
        return self._sorter.frames

    @property
    def in_window(self) -> int:
        """How many of them within the times that are judged."""
        return self._sorter.inside

    @property
    def span_us(self) -> int:
        """From the first receive time to the last, µs."""
        start_us = self._sorter.start_us
        return 0 if start_us is None else self._sorter.latest_rx_us - start_us

    def take(self, chunks: Chunks, *, final: bool = False) -> list[Event]:
        """Scan the chunks and judge what they hold as one batch; the link's own framing holds, not theirs."""
        return self.judge(self.scan(chunks, final=final))

    def scan(self, chunks: Chunks, *, final: bool = False) -> Scanned:
        """The frames that the chunks complete; another thread may call this while those before are judged."""
        scanner = self._scanner
        frames = scanner.scan_chunks(chunks.data, chunks.ends, chunks.t_rx_us, whole=self._datagrams, final=final)
        raw = scanner.raw_frames() if self.on_frames is not None and len(scanner.all_frames) else ()
        batch = self._sorter.sort(scanner.buffer, frames) if len(frames) else None
        return Scanned(batch, scanner.read, raw)

    def judge(self, scanned: Scanned) -> list[Event]:
        """Judge frames as one batch."""
        if scanned.raw and self.on_frames is not None:
            self.on_frames(scanned.raw)
        return [] if scanned.batch is None else events_of(self._judge(scanned.batch))

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

    def alarm_managers(self) -> Iterator[AlarmManager]:
        """Of its vehicles; what is done with them may change what is due."""
        self._due_us[:] = 0
        managers = (vehicle.alarm_manager for vehicle in self._vehicles.values())
        return (manager for manager in managers if manager is not None)

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
        vehicles = self._listed(MOST_BRIEF_NOW)
        return link, [vehicle.judge.now(vehicle.reader, self._sorter.latest_rx_us) for vehicle in vehicles]

    def finish(self) -> list[Event]:
        """Nothing follows."""
        if self._datagrams:
            return []
        return self.take(Chunks.of([Chunk(b"", self._sorter.latest_rx_us, Framing.STREAM)]), final=True)

    def entry(self, name: str) -> schema.File:
        """The link's entry in the report."""
        vehicles = [vehicle.judge.entry(vehicle.reader) for vehicle in self._listed(MOST_BRIEF)]
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
        vehicles = [vehicle for _, vehicle in sorted(self._vehicles.items()) if vehicle.reader.is_vehicle]
        if sum(vehicle.is_brief for vehicle in vehicles) <= most_brief:
            return vehicles
        return [vehicle for vehicle in vehicles if not vehicle.is_brief]

    def _remarks(self, salvage: Salvage) -> Iterator[str]:
        """What there is to say of how the bytes came."""
        if salvage.line_ends is not None:
            yield (
                f"a text conversion has turned {salvage.line_ends} in it, as if it were text: what that broke is lost; "
                "copy it anew as binary"
            )
        vehicles = self._listed(MOST_BRIEF)
        for vehicle in vehicles:
            repeated = self._scanner.repeated(*vehicle.reader.vehicle.address)
            told = copies(vehicle.reader.received, repeated)
            if told is not None:
                yield f"{told}, by {{}},{{}}: it counts once".format(*vehicle.reader.vehicle.address)
        unlisted = sum(vehicle.reader.is_vehicle for vehicle in self._vehicles.values()) - len(vehicles)
        if unlisted:
            yield f"{unlisted} that claim to be vehicles were heard too briefly to be judged, and are not listed"
        wanted = self._judged.sysid
        if wanted is not None and all(one.sysid != wanted for one in self._roster.heard()):
            present = sorted({one.sysid for one in self._roster.heard()})
            yield f"system {wanted} was not heard; there are {', '.join(map(str, present)) or 'none'}"

    def _judge(self, batch: SortedFrames) -> list[Notice]:
        self._roster.note(batch.buffer, batch.frames)
        return self._tell_pauses_once(list(self._judge_batch(batch)), batch.clock)

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

    def _judge_batch(self, batch: SortedFrames) -> Iterator[Notice]:
        requests = [one for share in batch.shares if asks(share) for one in self._requests_of(batch, share)]
        if requests:
            requests.sort(key=lambda one: one.frame_index)
            there = {share.address for share in batch.shares}
            for address, vehicle in self._vehicles.items():
                if address not in there:
                    yield from vehicle.ask(requests)
        for share in batch.shares:
            vehicle = self._vehicles.get(share.address) or self._new_vehicle(share.address)
            yield from vehicle.take(batch, share, requests)
            self._due_us[vehicle.place] = vehicle.due_us
        yield from self._pass_time(batch.clock)

    def _requests_of(self, batch: SortedFrames, share: Share) -> list[RateRequest]:
        return rate_requests(batch, share, self._judged.dialect)

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


def salvage_entry(salvage: Salvage, remarks: Iterable[str] = ()) -> schema.Salvage:
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
        remarks=tuple(remarks),
        gap_count=salvage.gap_count,
        gaps=tuple(schema.Gap(offset=offset, bytes=length) for offset, length in salvage.gaps),
    )
