"""Fills the scene from what a Monitor tells: samples and disagreements by its observer, and events.

Attitudes are drawn as sent, never normalised.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import rerun as rr

from gcs_bridge.checks.euler_quaternion import EulerQuaternion
from gcs_bridge.events import (
    AlarmCleared,
    AlarmRaised,
    AlarmShelved,
    CompareResumed,
    Event,
    NoCompare,
    Reboot,
    vehicle_of,
)
from gcs_bridge.judging.observation import Observation
from gcs_bridge.telemetry.identity import VehicleId
from gcs_bridge.viewer import scene
from gcs_bridge.viewer.base import Beside, ViewerSink
from gcs_bridge.viewer.drawing import Drawing
from gcs_bridge.viewer.event_text import text_of
from gcs_bridge.viewer.figure import New
from gcs_bridge.viewer.followed import Followed
from gcs_bridge.viewer.frames import Frames
from gcs_bridge.viewer.held import Held
from gcs_bridge.viewer.motion_lines import MotionLines
from gcs_bridge.viewer.pace import Pace
from gcs_bridge.viewer.rows import Rows, Shown
from gcs_bridge.viewer.scene import UTC, boot_timeline, path_of
from gcs_bridge.viewer.stretch import Angles, Stretch
from gcs_bridge.viewer.times import Aligned, Instant, instant_of
from gcs_bridge.viewer.world import World

__all__ = ["RerunSink", "sinks_of"]


# How often each part of the picture is drawn, µs of the vehicle's time: bodies as often as a live link is judged, which
# is some 17 times a second; the indicator eight times; plots twice, since the eye sees no more, and each time costs as
# much as 100 rows. Of several vehicles all but the bodies is drawn less often: of four, plots each 1.2 s.
_PARTS = _BODIES, _INDICATOR, _REST = range(3)
_BODIES_US, _INDICATOR_US, _REST_US = 35_000, 105_000, 480_000
_MORE_EACH, _MOST = 0.5, 4.0
# So many vehicles' plots are drawn at once, at half the cost of one by one: it takes less time than batches are apart,
# so no body waits for it. Of a fleet, one in so many.
_AT_ONCE, _OF_FLEET = 4, 16


class RerunSink(ViewerSink):
    """Draws one link session, or one file, into a world."""

    def __init__(
        self,
        world: World,
        *,
        label: str | None = None,
        aligned: Aligned | None = None,
        gather: int = 1,
        pace: Pace | None = None,
    ) -> None:
        """`label`: by which its vehicles are told from those of others in the world; `aligned`: where it meets them.

        `gather`: rows to be drawn at a time, where nobody waits for the newest. `pace`: whether who looks on keeps up;
        else samples are left out.
        """
        self._world = world
        self._rec = Drawing(world.recording, aligned=aligned, prefix=world.prefix)
        self._label = label
        self._live = world.live
        self._gather = gather
        self._frames = Frames() if world.live and gather == 1 else None
        self._held: dict[VehicleId, Held] = {}
        self._waiting: dict[tuple[int | str, ...], list[Rows]] = {}
        self._pace = pace
        self._vehicles: dict[VehicleId, Followed] = {}
        self._first: Instant | None = None
        self._latest_rx_us = -1
        self._boots: set[int] = set()

    def observe(self, observation: Observation) -> None:
        """Take samples and their comparison, which are drawn with the batch's events."""
        if self._pace is not None and not self._pace.is_kept:
            return
        held = self._held.setdefault(observation.vehicle, Held(len(_PARTS)))
        if held.boot not in (None, observation.segment.boot):
            self._draw_held(observation.vehicle, held)
        held.add(observation)

    def _draw_due(self) -> None:
        """Each part of the picture that is to be drawn again: the bodies first, then what may wait."""
        slower = min(1.0 + _MORE_EACH * max(len(self._vehicles) - 1, 0), _MOST)
        for part, each_us in ((_BODIES, _BODIES_US), (_INDICATOR, slower * _INDICATOR_US)):
            for vehicle, held in self._held.items():
                if held.waits_us(part) >= each_us:
                    self._draw_part(vehicle, held, part)
        self._move()
        waits_us = {vehicle: held.waits_us(_REST) for vehicle, held in self._held.items()}
        if max(waits_us.values(), default=-1) >= slower * _REST_US:
            at_once = max(_AT_ONCE, len(waits_us) // _OF_FLEET) if self._live else len(waits_us)
            for vehicle in sorted(waits_us, key=waits_us.__getitem__, reverse=True)[:at_once]:
                if waits_us[vehicle] >= 0:
                    self._draw_part(vehicle, self._held[vehicle], _REST)

    def _draw_observed(self) -> None:
        for vehicle, held in self._held.items():
            self._draw_held(vehicle, held)

    def _draw_held(self, vehicle: VehicleId, held: Held) -> None:
        for part in _PARTS:
            if held.waits_us(part) >= 0:
                self._draw_part(vehicle, held, part)

    def _draw_part(self, vehicle: VehicleId, held: Held, part: int) -> None:
        key, stretch = self._key(vehicle), held.take(part)
        if stretch.sent:
            self._vehicle(key)
        if key in self._vehicles:
            (self._draw_bodies, self._draw_indicator, self._draw_rest)[part](key, stretch)

    def _draw_bodies(self, key: VehicleId, stretch: Stretch) -> None:
        """Attitudes, and what shows how they differ."""
        vehicle = self._vehicles[key]
        self._draw_each(vehicle.figure.becomes(stretch.type))
        for angles in stretch.angles:
            self._draw_attitude(key, vehicle, angles)
        self._draw_each(vehicle.figure.appears(stretch))
        self._draw_first_compared(key, vehicle, stretch)
        for one in stretch.observations:
            self._draw_each(vehicle.apart.feed(one))
        self._draw_each(vehicle.figure.second(stretch))

    def _draw_indicator(self, key: VehicleId, stretch: Stretch) -> None:
        self._draw_each(self._vehicles[key].panels.indicate(stretch))

    def _draw_rest(self, key: VehicleId, stretch: Stretch) -> None:
        """Lines, arrows and places."""
        vehicle = self._vehicles[key]
        self._draw_each(vehicle.figure.arrows(stretch))
        self._draw_each(vehicle.panels.plot(stretch))
        self._draw_motion(key, vehicle, stretch)
        self._draw_trail(vehicle, stretch)

    def events(self, events: Sequence[Event]) -> None:
        """Draw what the batch showed; write its events into the log, and what they mean into the lanes."""
        self._draw_due()
        for event in events:
            self._draw_event(event)
        self._settle()
        if events:
            self._move()

    def _move(self) -> None:
        if self._frames is not None:
            self._frames.send(self._rec)

    def _settle(self) -> None:
        for vehicle in self._vehicles.values():
            self._show(vehicle.panels.settle())

    def _draw_event(self, event: Event) -> None:
        self._draw_observed()  # it leads up to the event, and no plot waits for more when a stream falls silent
        moment = instant_of(event)
        if moment.t_boot_us is None and moment.t_rx_us < 0:
            moment = moment._replace(t_rx_us=self._latest_rx_us)
        self._rec.set_time(moment)
        lines, levels = text_of(event, self._label)
        path = path_of(self._key(vehicle_of(event)), "events") if event.vehicle else "link/events"
        if times := moment.columns(len(lines), self._rec.aligned):
            self._rec.send_columns(path, times, rr.TextLog.columns(text=lines, level=levels))
        if not event.vehicle:
            return
        key = self._key(vehicle_of(event))
        vehicle = self._vehicle(key)
        self._show(vehicle.panels.hear(event))
        self._rec.set_time(moment)
        if isinstance(event, AlarmRaised):
            vehicle.raised[event.id] = event.severity
            self._state(key, vehicle.state)
        elif isinstance(event, AlarmCleared):
            vehicle.raised.pop(event.id, None)
            self._state(key, vehicle.state)
        elif isinstance(event, AlarmShelved):
            self._show(vehicle.apart.told(event))
        elif isinstance(event, Reboot):
            vehicle.silent, vehicle.raised = False, {}
            self._state(key, "not compared")  # until the new boot's first pair
        elif isinstance(event, NoCompare | CompareResumed) and event.check == EulerQuaternion.name:
            vehicle.silent = isinstance(event, NoCompare)
            self._state(key, vehicle.state)
            if vehicle.silent:
                self._show(vehicle.apart.silent(moment))

    def finish(self, at: Event | int | None = None) -> bool:
        """Lay the whole out, around an event's time or a receive time if `at` asks for it."""
        self.close()
        if at is None:
            self._lay_out()
            return True
        moment = self._at(at) if isinstance(at, int) else instant_of(at)
        where = None if moment is None else self._where(moment)
        if where is None:
            return False
        self._lay_out(*where)
        return True

    def finish_moment(self, t_boot_us: int) -> None:
        """Nothing follows, and all was around this time of the only boot: lay it out so that it opens there."""
        self.close()
        self._lay_out(None, t_boot_us, at_end=True)

    def close(self) -> None:
        """Draw what waits for more: none will come."""
        self.flush()
        self._settle()

    def flush(self) -> None:
        """Draw what waits for more."""
        self._draw_observed()
        self._move()
        for waiting in self._waiting.values():
            if waiting:
                Rows.joined(waiting).send(self._rec)
                waiting.clear()

    def _key(self, vehicle: VehicleId) -> VehicleId:
        """By which a vehicle of this recording is known in the world."""
        return vehicle if self._label is None else vehicle._replace(recording=self._label)

    def _vehicle(self, key: VehicleId) -> Followed:
        vehicle = self._vehicles.get(key)
        if vehicle is None:
            vehicle = self._vehicles[key] = Followed(key, self._world.add(key), self._world.origins)
            if self._live:
                self._lay_out()
        return vehicle

    def _draw_attitude(self, key: VehicleId, vehicle: Followed, angles: Angles) -> None:
        times = angles.times
        if self._first is None:
            self._first = times.moment(0)
        self._boots.add(times.boot)
        if not vehicle.named:  # nor has anything been said of it yet
            self._rec.set_time(times.moment(0))
            self._name(key, None)
        self._latest_rx_us = max(self._latest_rx_us, int(times.t_rx_us.max()))
        self._draw_rows(Rows(times, {path_of(key, "body", angles.source): angles.samples.q_nb}))

    def _draw_first_compared(self, key: VehicleId, vehicle: Followed, stretch: Stretch) -> None:
        """Say that the two forms are compared, from the boot's first pair on that is judged."""
        if stretch.boot in vehicle.compared or stretch.compared is None:
            return
        times, found = stretch.compared
        judged = np.flatnonzero(found.judged)
        if len(judged):
            vehicle.compared.add(stretch.boot)
            self._rec.set_time(times.moment(int(judged[0])))
            self._state(key, "compared")

    def _draw_motion(self, key: VehicleId, vehicle: Followed, stretch: Stretch) -> None:
        """Draw how the vehicle moves, from its first inertial sample on."""
        lines = vehicle.motion
        if lines is None:
            if all(one.flight.imu is None for one in stretch.observations):
                return
            self._world.draw(scene.motion_parts(key))
            self._world.draw_legend({"down"})
            self._world.moves(key)
            vehicle.motion = MotionLines(key, stretch.boot)
            if self._live:
                self._lay_out()
        elif lines.boot != stretch.boot:
            vehicle.motion = MotionLines(key, stretch.boot)
        if vehicle.motion is not None and stretch.seen is not None:
            self._draw_each(vehicle.motion.feed(stretch.seen))

    def _draw_trail(self, vehicle: Followed, stretch: Stretch) -> None:
        was_known = vehicle.trail.reach is not None
        self._draw_each(vehicle.trail.feed(stretch))
        if self._live and not was_known and vehicle.trail.reach is not None:
            self._lay_out()

    def _draw_each(self, several: Iterable[Rows | Shown | New]) -> None:
        for one in several:
            if isinstance(one, Rows):
                self._draw_rows(one)
            elif isinstance(one, Shown):
                self._show([one])
            else:
                self._world.draw(one.parts)
                self._world.draw_legend(one.names)

    def _draw_rows(self, rows: Rows) -> None:
        """Draw rows now, or with those that follow."""
        if self._frames is not None:
            rest = self._frames.take(rows)
            if rest is None:
                return
            rows = rest
        if self._gather == 1:
            rows.send(self._rec)
            return
        waiting = self._waiting.setdefault((rows.times.boot, *rows.paths), [])
        waiting.append(rows)
        if sum(len(one.times) for one in waiting) >= self._gather:
            Rows.joined(waiting).send(self._rec)
            waiting.clear()

    def _show(self, several: Iterable[Shown]) -> None:
        for shown in several:
            self._rec.set_time(shown.moment)
            for path, archetype in shown.parts:
                self._rec.log(path, archetype, static=shown.static)

    def _state(self, key: VehicleId, state: scene.State) -> None:
        self._rec.log(path_of(key, "state"), rr.StateChange(state=state))
        self._name(key, state)

    def _name(self, key: VehicleId, state: scene.State | None) -> None:
        self._vehicle(key).named = True
        self._rec.log(path_of(key, "body", "name"), scene.name_tag(key, state))

    def _timeline(self) -> str:
        """The clock to show things by: a boot's where there is but one, else the common one, if it is known."""
        if self._world.timeline is not None:
            return self._world.timeline
        alone = len(self._vehicles) <= 1 and len(self._boots) <= 1
        if self._latest_rx_us > 0 and (self._live or not alone):
            return UTC
        return UTC if self._live and self._first is None else boot_timeline(min(self._boots, default=0))

    def _where(self, moment: Instant) -> tuple[str, int] | None:
        """A moment on the timeline that things are shown by, µs; None: it is unknown there."""
        timeline, time_us = self._timeline(), moment.t_boot_us
        if self._rec.aligned is not None:
            time_us = self._rec.aligned.at(moment)
        elif timeline == UTC:
            time_us = moment.t_rx_us if moment.t_rx_us > 0 else None
        else:
            timeline = boot_timeline(moment.boot)
        return None if time_us is None else (timeline, time_us)

    def _lay_out(self, timeline: str | None = None, around_us: int | None = None, *, at_end: bool = False) -> None:
        for key, vehicle in self._vehicles.items():
            self._draw_each(vehicle.trail.fit())
            self._world.reaches(key, vehicle.trail.reach)
        self._world.lay_out(timeline or self._timeline(), around_us, at_end=at_end)

    def _at(self, t_rx_us: int) -> Instant | None:
        """A receive time as a moment of the first vehicle's first boot; None where it is past the end, or unknown."""
        first = self._first
        if first is None or first.t_rx_us <= 0 or first.t_boot_us is None or t_rx_us > self._latest_rx_us:
            return None
        return Instant(first.boot, max(first.t_boot_us + t_rx_us - first.t_rx_us, 0), t_rx_us)


def sinks_of(
    world: World, several: Sequence[Beside | None], *, gather: int = 1, pace: Pace | None = None
) -> list[RerunSink]:
    """What draws each of several recordings side by side into a world; None: it is alone."""

    def sink_of(one: Beside | None) -> RerunSink:
        label = None if one is None else one.label
        return RerunSink(world, label=label, aligned=_aligned(one), gather=gather, pace=pace)

    return [sink_of(one) for one in several]


def _aligned(one: Beside | None) -> Aligned | None:
    if one is None or one.timeline == UTC:
        return None
    if isinstance(one.zero, int):
        return Aligned(one.timeline, Instant(0, None, one.zero))
    return Aligned(one.timeline, None if one.zero is None else instant_of(one.zero))
