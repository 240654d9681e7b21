"""The `Monitor` that other programs use: events are plain dicts with the keys of the contract's JSON."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from gcs_bridge.chunks import Chunk, Chunks
from gcs_bridge.contract import plain
from gcs_bridge.events import Event
from gcs_bridge.judging import monitor
from gcs_bridge.judging.link import Datagram, FrameObserver
from gcs_bridge.judging.observation import Observer
from gcs_bridge.judging.snapshot import Snapshot
from gcs_bridge.mavlink.signing import SigningKey, Unsigned
from gcs_bridge.report import Report
from gcs_bridge.settings import Settings

__all__ = ["Monitor"]

PlainEvent = dict[str, Any]
"""An event as `json.loads` gives it; `schema/event.json` tells its keys."""


class Monitor:
    """Judges links and recordings as their bytes come.

    Fed with `feed` (a link's bytes) or `feed_recording` (a .tlog's), in pieces cut anywhere, or with the chunks of
    either by `take`; the events that a piece brought about come back as dicts with the contract's keys. `close` returns
    the report.
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
        signing_key: bytes | SigningKey | None = None,
        unsigned: Unsigned | None = None,
    ) -> None:
        """Take the settings of `profile`, or `settings`; judge `sysid` alone, or between two times after the start.

        `observer` is shown each vehicle's samples and pairs as they are judged; `on_frames` each link's frames as they
        came, before they are judged: whoever sent them, unknown ids included.
        With `signing_key`, 32 bytes, MAVLink's signatures are verified; `unsigned` says what is done with frames that
        are not signed by it, or again: "accept" them, "flag" (the default then: accept, and tell), or "reject": what is
        judged is as if they had not come.
        Raises UsageError for an unknown profile or dialect, and a key of another length.
        """
        self._monitor = monitor.Monitor(
            profile,
            settings=settings,
            dialect=dialect,
            sysid=sysid,
            from_s=from_s,
            to_s=to_s,
            observer=observer,
            on_frames=on_frames,
            signing_key=signing_key,
            unsigned=unsigned,
        )

    def open_link(self, link: int, *, datagrams: bool = False) -> None:
        """Say before its first bytes that `link` brings datagrams: each `feed` is then one, with its borders."""
        self._monitor.open_link(link, datagrams=datagrams)

    def close_link(self, link: int, t_rx_us: int) -> list[PlainEvent]:
        """A link has ended at `t_rx_us`: half a frame that it left behind is dropped and counted as unreadable.

        `advance` goes on telling of its vehicles, which fall silent and are lost in time. With `open_link`, or its next
        bytes, it is there again. ValueError where it is not open.
        """
        return _plain(self._monitor.close_link(link, t_rx_us))

    def take(self, chunks: Chunks | Sequence[Chunk], link: int = 0) -> list[PlainEvent]:
        """Take chunks of a link, or of a recording whatever `link` is, as one batch: as one by one, at less cost.

        A link that was closed is open again, as what it was before.
        """
        return _plain(self._monitor.take(chunks, link))

    def feed(self, data: bytes | bytearray | memoryview, t_rx_us: int, link: int = 0) -> list[PlainEvent]:
        """Take the next bytes of a link, or one datagram, received at `t_rx_us` (µs since 1970; −1: unknown)."""
        return _plain(self._monitor.feed(data, t_rx_us, link))

    def feed_datagrams(self, datagrams: Sequence[Datagram], link: int = 0) -> list[PlainEvent]:
        """Take several datagrams of a link at once: the same as one `feed` each, at less cost."""
        return _plain(self._monitor.feed_datagrams(datagrams, link))

    def feed_recording(self, piece: bytes | bytearray | memoryview) -> list[PlainEvent]:
        """Take the next piece of a .tlog, cut anywhere; its records bring their receive times."""
        return _plain(self._monitor.feed_recording(piece))

    def advance(self, t_rx_us: int, link: int | None = None) -> list[PlainEvent]:
        """Time has come to `t_rx_us` and nothing came, on `link` or on any: tell of the deadlines that have passed."""
        return _plain(self._monitor.advance(t_rx_us, link))

    def set_clock(self, t_rx_us: int) -> None:
        """The clock that tells receive times was set, forward or back: it is `t_rx_us`, and no time has passed by that.

        Who listens and knows it says so, on all links: else a clock set forward is a silence to `advance`, and one set
        back hides a silence until it has caught up.
        """
        self._monitor.set_clock(t_rx_us)

    def acknowledge(self, alarm_id: str, t_rx_us: int) -> list[PlainEvent]:
        """Somebody has seen an alarm; UsageError for one that is not known, or was acknowledged before."""
        return _plain(self._monitor.acknowledge(alarm_id, t_rx_us))

    def shelve(self, alarm_id: str, t_rx_us: int, duration_s: float) -> list[PlainEvent]:
        """Tell nothing of an alarm, and of its returns, for `duration_s` of receive time; UsageError as above."""
        return _plain(self._monitor.shelve(alarm_id, t_rx_us, duration_s))

    def unshelve(self, alarm_id: str, t_rx_us: int) -> list[PlainEvent]:
        """Tell of an alarm again before its time; UsageError for one that is not shelved."""
        return _plain(self._monitor.unshelve(alarm_id, t_rx_us))

    def snapshot(self, *, most_vehicles: int | None = None) -> Snapshot:
        """What is known now of every link and vehicle; nothing is closed or changed by it.

        `most_vehicles`: of each link no more than so many, those that could be judged first.
        """
        return self._monitor.snapshot(most_vehicles=most_vehicles)

    def finish(self) -> list[PlainEvent]:
        """Nothing follows: decide what is still undecided, and tell what comes of it."""
        return _plain(self._monitor.finish())

    def close(self) -> Report:
        """Nothing follows: report, one entry a link. Who wants the last events calls `finish` before."""
        return self._monitor.close()

    @property
    def window_is_empty(self) -> bool:
        """Whether frames were read, and none of them within the times to judge."""
        return self._monitor.window_is_empty

    @property
    def span_s(self) -> float:
        """From the first receive time to the last, over all links."""
        return self._monitor.span_s


def _plain(events: Iterable[Event]) -> list[PlainEvent]:
    return [plain(event) for event in events]
