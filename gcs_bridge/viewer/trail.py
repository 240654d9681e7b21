"""Where a vehicle was, and how it stood there: its place in the world, the trail behind it, the same on a map.

The world begins at the first place that a vehicle tells, and others near to it share it. Of the messages that tell
places the best one that is believed is followed through a boot: GLOBAL_POSITION_INT, else LOCAL_POSITION_NED, whose
origin is the vehicle's own, else GPS_RAW_INT. A place is believed once a second one bears it out: one that could be
reached. What jumps is left out, and if it stays there the trail goes on from there, without a line to it.

    vehicle/1.1/place              its place
    vehicle/1.1/place/name         its name above it, as large from afar as from near
    vehicle/1.1/place/airframe     its attitude there: the quaternion's, or else the Euler angles'
    vehicle/1.1/place/airframe/solid   as in the other view, larger the further the vehicle has come
    vehicle/1.1/plumb              from it to the height of the world's origin
    vehicle/1.1/trail              the way, piece by piece: a view shows those up to the cursor
    vehicle/1.1/geo/now, trail     the same as latitude and longitude
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gcs_bridge.columns import Floats
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.telemetry.positions import LOCAL, PositionSamples
from gcs_bridge.telemetry.samples import AttitudeSamples
from gcs_bridge.viewer.earth import Geodetic, Ned, TangentPlane, distance_m
from gcs_bridge.viewer.figure import New, as_displayed
from gcs_bridge.viewer.rows import Rows
from gcs_bridge.viewer.scene import Source, path_of, place_airframe_parts, place_parts
from gcs_bridge.viewer.stretch import Angles, Stretch
from gcs_bridge.viewer.times import Times

__all__ = ["Origins", "Reach", "Trail"]

_SHARED_M = 50_000.0  # so near to the world's origin a vehicle stands in it; float32 tells 4 mm there
_SLACK_M, _FASTEST_M_S = 50.0, 400.0  # what lies further off than this cannot have been reached
_STEP_M, _STEP_SHARE = 0.3, 1 / 300  # a piece of the trail is so long at least; the share is of how far it has come
_PERIOD_S, _PIECES = 0.4, 4000  # and is so far from the one before in time: twice that after each so many pieces
_LEVEL = (1.0, 0.0, 0.0, 0.0)
_AIRFRAME_SHARE, _GROWS = 1 / 9, 1.5  # how large the airframe is drawn, of how far apart the vehicles have been
_LEAST_SCALE = 2.0


class Reach(NamedTuple):
    """Between which corners of the world a vehicle has been, NED, m."""

    low: Ned
    high: Ned

    def with_(self, place: Ned) -> Reach:
        """The same, with another place."""
        low, high = zip(*((min(a, p), max(b, p)) for a, b, p in zip(*self, place, strict=True)), strict=True)
        return Reach(low, high)

    @property
    def size_m(self) -> float:
        """From one corner to the other."""
        return math.dist(self.low, self.high)


class Origins:
    """Where the worlds begin: one for all vehicles that are near to each other."""

    def __init__(self) -> None:
        """Start with none."""
        self.reach: Reach | None = None  # of all vehicles
        self._planes: list[TangentPlane] = []

    def near(self, place: Geodetic) -> TangentPlane:
        """The world that a place lies in; its own, where it is far from all that was told."""
        for plane in self._planes:
            if distance_m(plane.origin, place) < _SHARED_M:
                return plane
        self._planes.append(TangentPlane(place))
        return self._planes[-1]


class _Message:
    """What one message tells: which of its places are believed."""

    def __init__(self, *, local: bool) -> None:
        self._local = local
        self.believed: tuple[int, Geodetic] | None = None  # the last one, with its time
        self._doubted: tuple[int, Geodetic] | None = None

    def believe(self, t_us: int, place: Geodetic) -> bool:
        """Whether a place is believed, by those before it."""
        now = t_us, place
        if not (self._reaches(self.believed, now) or self._reaches(self._doubted, now)):
            self._doubted = now
            return False
        self.believed, self._doubted = now, None
        return True

    def goes_on(self, t_us: int, place: Geodetic) -> bool:
        """Whether a place can have been reached from the last one that is believed."""
        return self._reaches(self.believed, (t_us, place))

    def _reaches(self, before: tuple[int, Geodetic] | None, now: tuple[int, Geodetic]) -> bool:
        if before is None:
            return False
        (before_us, here), (now_us, there) = before, now
        apart_m = math.dist(here, there) if self._local else distance_m(here, there)
        return apart_m <= _SLACK_M + _FASTEST_M_S * max(now_us - before_us, 0) / 1e6


class _Drawn(NamedTuple):
    """A place to be drawn; `since`: a piece of the trail begins there."""

    row: int
    at: Ned
    geodetic: Geodetic | None
    since: tuple[Ned, Geodetic | None] | None


class Trail:
    """Follows where one vehicle is, and makes rows of it."""

    def __init__(self, key: VehicleId, place: int, origins: Origins) -> None:
        """Start with no place known of the `place`-th vehicle, from 0."""
        self._key, self._place, self._origins = key, place, origins
        self._type = "unknown"
        self.reach: Reach | None = None  # None: no place is known
        self._scale = _LEAST_SCALE
        self._pieces = 0
        self._boot: int | None = None
        self._start_boot()

    def _start_boot(self) -> None:
        self._messages = [_Message(local=message == LOCAL) for message in range(3)]
        self._best = len(self._messages)  # the message that is followed; the number of them: none yet
        self._plane: TangentPlane | None = None
        self._head: tuple[int, Ned, Geodetic | None] | None = None  # where the trail ends
        self._before: dict[Source, AttitudeSamples | None] = {"euler": None, "quaternion": None}  # the last attitudes

    def feed(self, stretch: Stretch) -> Iterator[New | Rows]:
        """What batches add."""
        if stretch.boot != self._boot:
            self._boot = stretch.boot
            self._start_boot()
        if stretch.type != self._type:
            self._type = stretch.type
            if self.reach is not None:
                yield self._airframe()
        positions = stretch.positions
        drawn = list(self._follow(positions)) if len(positions) else []
        q_nb = self._attitudes(stretch.angles, positions.frame_index[[one.row for one in drawn]].tolist())
        if drawn:
            yield from self._grow([one.at for one in drawn])
            yield from self._rows(positions, drawn, q_nb)

    def _follow(self, positions: PositionSamples) -> Iterator[_Drawn]:
        """The places that are believed, of the best message."""
        for row, message in enumerate(positions.message.tolist()):
            told = positions.p_n_m if message == LOCAL else positions.geodetic
            place: Geodetic = tuple(told[row].tolist())
            if message > self._best or not all(map(math.isfinite, place)):
                continue
            t_us, source = int(positions.t_boot_us[row]), self._messages[message]
            goes_on = message == self._best and source.goes_on(t_us, place)
            if not source.believe(t_us, place):
                continue
            self._best = message
            geodetic = None if message == LOCAL else place
            if not goes_on:
                self._head = None
                self._plane = None if geodetic is None else self._origins.near(geodetic)
            at = place if self._plane is None else self._plane.ned(place)
            yield _Drawn(row, at, geodetic, self._piece(t_us, at, geodetic))

    def _piece(self, t_us: int, at: Ned, geodetic: Geodetic | None) -> tuple[Ned, Geodetic | None] | None:
        """Where the piece of the trail begins that ends here; None: there is none, or it would be too short."""
        head = self._head
        if head is not None:
            least_m = max(_STEP_M, 0.0 if self.reach is None else _STEP_SHARE * self.reach.size_m)
            least_us = 1e6 * _PERIOD_S * 2 ** (self._pieces // _PIECES)
            if math.dist(head[1], at) < least_m or abs(t_us - head[0]) < least_us:
                return None
            self._pieces += 1
        self._head = t_us, at, geodetic
        return None if head is None else head[1:]

    def _attitudes(self, sources: list[Angles], frame_indices: list[int]) -> Floats:
        """The attitude (n, 4) known at each of these frames, as displays are to show it; the identity before any."""
        found = np.tile(_LEVEL, (len(frame_indices), 1))
        came = {angles.source: angles.samples for angles in sources}
        for source, before in self._before.items():  # where both are known, the quaternion
            known = [samples for samples in (before, came.get(source)) if samples is not None]
            if known and frame_indices:
                samples = AttitudeSamples.joined(known)
                rows = np.searchsorted(samples.frame_index, frame_indices) - 1
                found[rows >= 0] = as_displayed(samples[rows[rows >= 0]])
            if source in came:
                self._before[source] = came[source][-1:]
        return found

    def _grow(self, places: list[Ned]) -> Iterator[New]:
        """Take in how far it has come."""
        if self.reach is None:
            self.reach = Reach(places[0], places[0])
            yield New(list(place_parts(self._key, self._place)))
            yield self._airframe()
        north, east, down = zip(*places, strict=True)
        self.reach = self.reach.with_((min(north), min(east), min(down))).with_((max(north), max(east), max(down)))
        whole = self._origins.reach or self.reach
        self._origins.reach = whole.with_(self.reach.low).with_(self.reach.high)
        yield from self.fit(_GROWS)

    def fit(self, grows: float = 1.0) -> Iterator[New]:
        """Draw the airframe larger, where all vehicles have come so much further than it shows."""
        whole = self._origins.reach
        scale = _LEAST_SCALE if whole is None else _AIRFRAME_SHARE * whole.size_m
        if self.reach is not None and scale > grows * self._scale:
            self._scale = scale
            yield self._airframe()

    def _airframe(self) -> New:
        return New(list(place_airframe_parts(self._key, self._place, self._type, self._scale)))

    def _rows(self, positions: PositionSamples, drawn: list[_Drawn], q_nb: Floats) -> Iterator[Rows]:
        assert self._boot is not None
        at = np.array([one.at for one in drawn])
        down = np.column_stack((at[:, :2], np.zeros(len(at))))
        yield Rows(
            _times(positions, drawn),
            {path_of(self._key, "place", "airframe"): q_nb},
            poses={path_of(self._key, "place"): at},
            strips={path_of(self._key, "plumb"): np.stack((at, down), axis=1)},
        )
        on_map = [one for one in drawn if one.geodetic is not None]
        if on_map:
            now = np.array([one.geodetic for one in on_map])[:, :2]
            yield Rows(_times(positions, on_map), geo_points={path_of(self._key, "geo", "now"): now})
        pieces = [one for one in drawn if one.since is not None]
        if pieces:
            strips = np.array([(one.since[0], one.at) for one in pieces if one.since is not None])
            yield Rows(_times(positions, pieces), strips={path_of(self._key, "trail"): strips})
        pieces = [one for one in pieces if one.since is not None and one.since[1] is not None]
        if pieces:
            lines = np.array([(one.since[1], one.geodetic) for one in pieces if one.since is not None])[:, :, :2]
            yield Rows(_times(positions, pieces), geo_strips={path_of(self._key, "geo", "trail"): lines})


def _times(positions: PositionSamples, drawn: list[_Drawn]) -> Times:
    rows = [one.row for one in drawn]
    return Times(boot=int(positions.boot[0]), t_boot_us=positions.t_boot_us[rows], t_rx_us=positions.t_rx_us[rows])
