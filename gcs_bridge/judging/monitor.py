"""Wires the stages: bytes → frames → samples → judged vehicles → events and report.

No I/O and no clock inside: bytes and receive times come as arguments. Live links and recordings go the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from gcs_bridge.alarms.manager import AlarmManager
from gcs_bridge.chunks import Chunk, Chunks, Framing
from gcs_bridge.errors import UsageError
from gcs_bridge.events import Event, Notice
from gcs_bridge.judging.link import Datagram, FrameObserver, Link, ScannedBatch, events_of
from gcs_bridge.judging.link_vehicle import Judged
from gcs_bridge.judging.observation import Observer
from gcs_bridge.judging.rating import Beside
from gcs_bridge.judging.snapshot import Snapshot
from gcs_bridge.mavlink.dialect import Dialect, load_dialect
from gcs_bridge.mavlink.signing import Signing, SigningKey, Unsigned
from gcs_bridge.report import Report
from gcs_bridge.settings import Settings, load_settings
from gcs_bridge.telemetry.census import Census
from gcs_bridge.telemetry.samples import STREAMS

_LATEST_RX_US = 253_402_300_800_000_000  # the year 10,000: nanoseconds are taken for what they are
_RECORDING = "recording"
_RECORDING_NUMBER = -1  # beside links, which have theirs from 0 on


class Scan(NamedTuple):
    """What was found on a link and is to be judged."""

    link: Link
    scanned: ScannedBatch


class LinkCensus(NamedTuple):
    """Who sends what on a link; from its first receive time to the last, and that one, µs; line ends that were turned.

    `latest_rx_us` −1: it has no receive times. `line_ends`: into which others, as if it were text; None: none were.
    """

    census: Census
    span_us: int
    latest_rx_us: int
    line_ends: str | None


class Monitor:
    """Judges links and recordings as their bytes come.

    Fed with `feed` (a link's bytes) or `feed_recording` (a .tlog's), in pieces cut anywhere, or with the chunks of
    either by `take`; the events that a piece brought about come back. `close` returns the report.
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
        census: bool = False,
        signing_key: bytes | SigningKey | None = None,
        unsigned: Unsigned | None = None,
        doctor_waits: bool = False,
        beside: Beside | None = None,
    ) -> None:
        """Take the settings of `profile`, or `settings`; judge `sysid` alone, or between two times after the start.

        `observer` is shown each vehicle's samples and pairs as they are judged; `on_frames` each link's frames as they
        came, before they are judged: whoever sent them, unknown ids included. With `census`, who sends what is counted.
        With `signing_key`, of 32 bytes, their signatures are verified, and `unsigned` says what is done with those that
        do not hold: see `mavlink.signing`. Raises UsageError for an unknown profile or dialect, and a key of another
        length. With `doctor_waits` an alarm's diagnosis comes by `answer`, and not with the alarm. With `beside`, by
        which something is begun in another thread, large batches take less time, and come out the same.
        """
        self._judged = Judged(
            settings=settings or load_settings(profile),
            dialect=open_dialect(dialect),
            sysid=sysid,
            window_s=(from_s, to_s),
            observer=observer,
            signing=Signing.of(signing_key, unsigned),
            doctor_waits=doctor_waits,
            beside=beside,
        )
        self._on_frames = on_frames
        self._takes_census = census
        self._links: dict[int | str, Link] = {}

    def open_link(self, link: int, *, datagrams: bool = False) -> None:
        """Say before its first bytes that `link` brings datagrams: each `feed` is then one, with its borders."""
        found = self._links.get(link)
        if found is None:
            self._new_link(link, Framing.DATAGRAM if datagrams else Framing.STREAM)
        elif found.is_open:
            raise ValueError(f"link {link} is open already")
        else:
            found.open(datagrams=datagrams)

    def close_link(self, link: int, t_rx_us: int) -> list[Event]:
        """A link has ended at `t_rx_us`: half a frame that it left behind is dropped and counted as unreadable.

        `advance` goes on telling of its vehicles, which fall silent and are lost in time. With `open_link`, or its next
        bytes, it is there again. ValueError where it is not open.
        """
        refuse_no_time(t_rx_us)
        found = self._links.get(link)
        if found is None or not found.is_open:
            raise ValueError(f"link {link} is not open")
        return found.close(t_rx_us)

    def take(self, chunks: Chunks | Sequence[Chunk], link: int = 0) -> list[Event]:
        """Take chunks of a link, or of a recording whatever `link` is, as one batch: as one by one, at less cost.

        A link that was closed is open again, as what it was before.
        """
        return self.judge(self.scan(chunks, link)) if len(chunks) else []

    def scan(self, chunks: Chunks | Sequence[Chunk], link: int = 0) -> Scan:
        """Find the frames in chunks, one at least, of a link: the first half of `take`.

        The next ones may be scanned in another thread while these are judged.
        """
        if not isinstance(chunks, Chunks):
            chunks = Chunks.of(chunks)
        name = _RECORDING if chunks.framing is Framing.RECORDS else link
        found = self._links.get(name) or self._new_link(name, chunks.framing)
        found.is_open = True
        return Scan(found, found.scan(chunks))

    def judge(self, scan: Scan) -> list[Event]:
        """Judge what `scan` found, in the order in which it was scanned."""
        return scan.link.judge(scan.scanned)

    def feed(self, data: bytes | bytearray | memoryview, t_rx_us: int, link: int = 0) -> list[Event]:
        """Take the next bytes of a link, or one datagram, received at `t_rx_us` (µs since 1970; −1: unknown).

        TypeError or ValueError, and nothing is taken, where `t_rx_us` is no such time; the same holds wherever one is
        given.
        """
        refuse_no_time(t_rx_us)
        return self.take([Chunk(data, t_rx_us, Framing.STREAM)], link)

    def feed_datagrams(self, datagrams: Sequence[Datagram], link: int = 0) -> list[Event]:
        """Take several datagrams of a link at once: the same as one `feed` each, at less cost."""
        for _, t_rx_us in datagrams:
            refuse_no_time(t_rx_us)
        return self.take([Chunk(data, t_rx_us, Framing.DATAGRAM) for data, t_rx_us in datagrams], link)

    def feed_recording(self, piece: bytes | bytearray | memoryview) -> list[Event]:
        """Take the next piece of a .tlog, cut anywhere; its records bring their receive times."""
        return self.take([Chunk(piece, -1, Framing.RECORDS)])

    def advance(self, t_rx_us: int, link: int | None = None) -> list[Event]:
        """Time has come to `t_rx_us` and nothing came, on `link` or on any: tell of the deadlines that have passed."""
        refuse_no_time(t_rx_us)
        quiet = self._links.values() if link is None else filter(None, [self._links.get(link)])
        return [event for one in quiet for event in one.advance(t_rx_us)]

    def calm_s(self) -> float:
        """In how many seconds of the vehicles' time an alarm may be raised, or go, at the earliest.

        0 while one is pending or about to go, and before there is any vehicle. It is of alarms that wait for a delay:
        what one message tells by itself, a reboot or a reset of the estimator, comes whenever it comes.
        """
        return min((link.calm_s for link in self._links.values()), default=0.0)

    @property
    def is_asked(self) -> bool:
        """Whether a question to a doctor is open: never, unless the doctor waits."""
        return any(link.asked is not None for link in self._links.values())

    def answer(self) -> list[Event]:
        """Have a doctor answer one open question of each link: 5 to 70 ms each."""
        return [event for link in self._links.values() for event in link.answer()]

    def set_clock(self, t_rx_us: int) -> None:
        """The clock that tells receive times was set, forward or back: it is `t_rx_us`, and no time has passed by that.

        Who listens and knows it says so, on all links: else a clock set forward is a silence to `advance`, and one set
        back hides a silence until it has caught up.
        """
        refuse_no_time(t_rx_us)
        for link in self._links.values():
            link.set_clock(t_rx_us)

    def acknowledge(self, alarm_id: str, t_rx_us: int) -> list[Event]:
        """Somebody has seen an alarm; UsageError for one that is not known, or was acknowledged before."""
        return self._answer(alarm_id, lambda manager, frame_index: manager.acknowledge(alarm_id, frame_index, t_rx_us))

    def shelve(self, alarm_id: str, t_rx_us: int, duration_s: float) -> list[Event]:
        """Tell nothing of an alarm, and of its returns, for `duration_s` of receive time; UsageError as above."""
        return self._answer(
            alarm_id, lambda manager, frame_index: manager.shelve(alarm_id, frame_index, t_rx_us, duration_s)
        )

    def unshelve(self, alarm_id: str, t_rx_us: int) -> list[Event]:
        """Tell of an alarm again before its time; UsageError for one that is not shelved."""
        return self._answer(alarm_id, lambda manager, frame_index: manager.unshelve(alarm_id, frame_index, t_rx_us))

    def _answer(self, alarm_id: str, what: Callable[[AlarmManager, int], Iterable[Notice]]) -> list[Event]:
        for link in self._links.values():
            for manager in link.alarm_managers():
                if manager.owns(alarm_id):
                    return events_of(what(manager, link.frames))
        raise UsageError(f"unknown alarm {alarm_id!r}")

    def snapshot(self, *, most_vehicles: int | None = None) -> Snapshot:
        """What is known now of every link and vehicle; nothing is closed or changed by it.

        `most_vehicles`: of each link no more than so many, those that could be judged first, so that one that is listed
        stays so whoever comes later; and none that was heard too briefly to be judged.
        """
        parts = [link.now(name, most_vehicles) for name, link in self._links.items()]
        vehicles = tuple(vehicle for _, several in parts for vehicle in several)
        return Snapshot(links=tuple(link for link, _ in parts), vehicles=vehicles)

    def finish(self) -> list[Event]:
        """Nothing follows: decide what is still undecided, and tell what comes of it."""
        told = [event for link in self._links.values() for event in link.finish()]
        while self.is_asked:
            told += self.answer()
        return told

    def close(self) -> Report:
        """Nothing follows: report, one entry a link. Who wants the last events calls `finish` before."""
        self.finish()
        return Report.of(link.entry(str(name)) for name, link in self._links.items())

    def censuses(self) -> list[LinkCensus]:
        """Of each link who sends what, in the order in which they were opened; of a Monitor that takes a census."""
        return [
            LinkCensus(link.census, link.span_us, link.latest_rx_us, link.line_ends)
            for link in self._links.values()
            if link.census is not None
        ]

    def frames_of(self, link: int) -> int:
        """How many frames of known messages came on a link so far, those included that were refused."""
        found = self._links.get(link)
        return 0 if found is None else found.found

    @property
    def window_is_empty(self) -> bool:
        """Whether frames were read, and none of them within the times to judge."""
        links = self._links.values()
        return any(link.frames for link in links) and not any(link.in_window for link in links)

    @property
    def span_s(self) -> float:
        """From the first receive time to the last, over all links."""
        return max((link.span_us for link in self._links.values()), default=0) / 1e6

    def _new_link(self, name: int | str, framing: Framing) -> Link:
        number = (name if isinstance(name, int) else _RECORDING_NUMBER) if self._links else None
        census = Census(self._judged.dialect) if self._takes_census else None
        link = Link(self._judged, framing, number=number, census=census)
        if self._on_frames is not None:
            link.on_frames = partial(self._on_frames, name)
        self._links[name] = link
        return link


def refuse_no_time(t_rx_us: int) -> None:
    """TypeError for what is no whole number, ValueError for a number that no clock of µs since 1970 shows."""
    if not isinstance(t_rx_us, int | np.integer):
        raise TypeError(f"t_rx_us is a {type(t_rx_us).__name__}: it must be an int, µs since 1970")
    if not -1 <= t_rx_us < _LATEST_RX_US:
        raise ValueError(f"t_rx_us is {t_rx_us}: it must be µs since 1970, or −1 where that is not known")


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
