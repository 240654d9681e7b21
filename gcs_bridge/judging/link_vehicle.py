"""One (system, component) of a link: when enough came of it to be judged, and from when on what is judged is told.

Anybody can send a frame under any number, and what judges a vehicle is large: what comes waits until there is more of
it, and is told once it is known to be a vehicle's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from gcs_bridge.alarms.manager import AlarmManager
from gcs_bridge.columns import Int64Rows, Int64s, record
from gcs_bridge.events import Notice, Rank, VehicleLost, VehicleSeen, head, in_order
from gcs_bridge.judging.observation import Observation, Observer
from gcs_bridge.judging.rating import Beside
from gcs_bridge.judging.vehicle import VehicleJudge
from gcs_bridge.mavlink.dialect import Dialect
from gcs_bridge.mavlink.signing import Signing
from gcs_bridge.settings import Settings
from gcs_bridge.telemetry.batches import VehicleBatch
from gcs_bridge.telemetry.clocks import NO_TIMES
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.known import NOTHING_KNOWN
from gcs_bridge.telemetry.link_clock import NEVER_US, LinkClock
from gcs_bridge.telemetry.messages import KIND
from gcs_bridge.telemetry.others import OfOthers
from gcs_bridge.telemetry.samples import STREAMS
from gcs_bridge.telemetry.sorting import Share, SortedFrames
from gcs_bridge.telemetry.vehicle_presence import Presence

_NO_FRAMES: Int64s = np.empty(0, np.int64)
JUDGED_ATTITUDES, JUDGED_FRAMES = 2, 32  # of one stream, and of all: with either a component is judged
_MOST_OBSERVED = 256  # batches: of who may be a vehicle for longer, the latest alone are shown
_MOST_WAITING = 128  # what others say is kept for it no longer
_LONGEST_WAIT_S = 12  # behind a frame the longest deadline, see stream_liveness, has passed


@record
class Judged:
    """What is judged of every link, by what, and who looks on; `window_s`: between these times after the start.

    With `signing` frames are verified. `doctor_waits`: who judges asks for each diagnosis, when there is time for it.
    `beside`: by which some checks are judged in another thread.
    """

    settings: Settings
    dialect: Dialect
    sysid: int | None
    window_s: tuple[float | None, float | None]
    observer: Observer | None
    signing: Signing | None = None
    doctor_waits: bool = False
    beside: Beside | None = None


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
        self.vehicle = vehicle
        self.known = NOTHING_KNOWN  # with the last frame that was judged
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
    def judged_from(self) -> int | None:
        """The frame with which enough came of it to be judged."""
        return self._told_from

    @property
    def is_brief(self) -> bool:
        """Whether it was heard too briefly to be judged."""
        return self._told_from is None

    @property
    def judge(self) -> VehicleJudge:
        """What judges it, by all that came so far; it is made where it waits for more."""
        if self._judge is None:
            observer = self._observed.append if self._observer else None
            self._judge = judge = VehicleJudge(
                self.vehicle,
                self._judged.settings,
                observer,
                doctor_waits=self._judged.doctor_waits,
                beside=self._judged.beside,
            )
            assert self._early is not None
            for hand in self._waiting:
                self._early += hand(judge)
            self._waiting.clear()
        return self._judge

    @property
    def alarm_manager(self) -> AlarmManager | None:
        """Its alarms, if it is judged."""
        return None if self._judge is None else self._judge.alarm_manager

    @property
    def calm_s(self) -> float | None:
        """As `Monitor.calm_s`; None: it is no vehicle, was lost, or is not judged, and has no part in that."""
        no_vehicle = self.known.is_decided and not self.known.is_vehicle
        if self._judge is None or no_vehicle or self._presence.is_lost:
            return None
        return self._judge.calm_s if self._seen else 0.0

    @property
    def is_asked(self) -> bool:
        """Whether a question to its doctor is open."""
        return self._judge is not None and self._judge.doctor.is_asked

    def answer(self) -> list[Notice]:
        """Have its doctor answer one question."""
        return self._release(self._told(list(self.judge.answer())))

    def take(
        self, heard: VehicleBatch, batch: SortedFrames, share: Share, said: Sequence[OfOthers] = ()
    ) -> list[Notice]:
        """Judge what was read of its share of a batch, and what others said to it meanwhile."""
        if self._first_frame_index is None:
            self._first_frame_index = int(heard.frame_index[0])
        self.known, clock, told_it = heard.known, batch.clock, self._of(said)
        turns = list(self._turns(heard.frame_index, clock, heard.timed))
        if self._told_from is None:
            self._told_from = self._first_told(heard, batch, share)
        if self._judge is None and self._told_from is None:
            self._waiting.append(lambda judge: judge.take(heard, heard.frame_index, clock, told_it))
            if heard.segments or self._waits_since_us != NEVER_US:
                self._waits_since_us, self._waited_s = int(clock.heard_us[-1]), 0
            return self._release(turns)
        told = self._told(list(self.judge.take(heard, heard.frame_index, clock, told_it)))
        self._show()
        return self._release([*turns, *told])

    def _first_told(self, heard: VehicleBatch, batch: SortedFrames, share: Share) -> int | None:
        """The frame of its share with which enough came of it, None where that is not so yet."""
        frames = []
        for stream, name in enumerate(STREAMS):
            before, count = self._attitudes[stream], share.counts[KIND[name]]
            self._attitudes[stream] += count
            if before < JUDGED_ATTITUDES <= before + count:
                frames.append(batch.first + int(batch.rows(share, KIND[name])[JUDGED_ATTITUDES - 1 - before]))
        received = heard.known.received
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

    def hear(self, said: Sequence[OfOthers]) -> list[Notice]:
        """What others said, in a batch that brought nothing of this vehicle."""
        told_it = self._of(said)
        if not told_it:
            return []
        if self._judge is not None:
            return self._release(self._told(list(self._judge.hear(told_it))))
        if len(self._waiting) < _MOST_WAITING:
            self._waiting.append(lambda judge: judge.hear(told_it))
        return []

    def _of(self, said: Sequence[OfOthers]) -> Sequence[OfOthers]:
        """What is meant for it, and came when it was there."""
        since = self._first_frame_index
        if not said or since is None:
            return ()
        address = self.vehicle.address
        return [one for one in said if one.is_for(address) and one.by != address and one.frame_index > since]

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
        if self.known.is_vehicle and self._observer is not None:
            for observation in self._observed:
                self._observer(observation)
        if self.known.is_decided:
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
            event = kind(**head(self.vehicle, None, None, turn.t_rx_us))
            yield Notice(turn.frame_index, event, Rank.IDENTITY)

    def _release(self, notices: list[Notice]) -> list[Notice]:
        """The notices to pass on: those at which it is a vehicle; earlier ones come behind the news that it is one."""
        if not self._seen:
            self._held += notices
            if self.known.seen is None:
                return []
            frame_index, t_rx_us = self.known.seen
            self._seen = True
            seen = VehicleSeen(**head(self.vehicle, 0, None, t_rx_us))
            held = (
                notice._replace(frame_index=max(notice.frame_index, frame_index))
                for notice in in_order(self._held)
                if notice.rank is not Rank.IDENTITY
                or notice.frame_index > frame_index  # was it lost before it was known?
            )
            notices = [Notice(frame_index, seen, Rank.IDENTITY), *held]
            self._held = []
        return [notice for notice in notices if self.known.is_vehicle_at(notice.frame_index)]
