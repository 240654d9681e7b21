"""What is kept of a recording for its page while it is judged: curves, and the attitudes when alarms were raised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs_bridge import attitude
from gcs_bridge.columns import Floats
from gcs_bridge.events import AlarmRaised, Event
from gcs_bridge.judging.observation import Observation
from gcs_bridge.pages.thinned import Thinned
from gcs_bridge.sinks.base import Sink
from gcs_bridge.telemetry.samples import AttitudeSamples

__all__ = ["BootCurves", "Curves", "Moment"]


@dataclass(frozen=True)
class Moment:
    """The attitude of both forms when an alarm was raised: q_nb (4,), None where one never came."""

    q_euler: Floats | None
    q_quaternion: Floats | None


@dataclass
class BootCurves:
    """Curves of one boot of a vehicle, degrees over boot time."""

    euler: Thinned = field(default_factory=lambda: Thinned(3))  # roll, pitch, yaw
    quaternion: Thinned = field(default_factory=lambda: Thinned(3))
    pairs: Thinned = field(default_factory=lambda: Thinned(4))  # angle, limit, tilt, heading


class Curves(Sink):
    """Keeps curves by (system, component, boot), and moments by alarm id."""

    def __init__(self) -> None:
        """Start with nothing."""
        self.boots: dict[tuple[int, int, int], BootCurves] = {}
        self.moments: dict[str, Moment] = {}
        self._latest: dict[tuple[int, int], list[Floats | None]] = {}  # of the Euler angles, of the quaternion

    def observe(self, observation: Observation) -> None:
        """Take what one batch showed of a vehicle."""
        segment, pairs, found = observation.segment, observation.pairs, observation.disagreement
        if not len(segment.euler) and not len(segment.quaternion):
            return
        boot = self.boots.setdefault((*observation.vehicle.address, segment.boot), BootCurves())
        latest = self._latest.setdefault(observation.vehicle.address, [None, None])
        if len(segment.euler):
            boot.euler.take(segment.euler.t_boot_us, _wrapped_deg(segment.euler))
            latest[0] = observation.flight.euler.q_nb[-1]  # expected differences undone
        if len(segment.quaternion):
            boot.quaternion.take(segment.quaternion.t_boot_us, _wrapped_deg(segment.quaternion))
            latest[1] = segment.quaternion.q_nb[-1]
        if len(pairs):
            rows = np.degrees(np.column_stack((found.angle, found.limit, found.tilt, np.abs(found.heading))))
            boot.pairs.take(pairs.t_boot_us, rows)

    def events(self, events: Sequence[Event]) -> None:
        """Remember where the body was when an alarm was raised."""
        for event in events:
            if isinstance(event, AlarmRaised) and event.vehicle is not None and event.id not in self.moments:
                self.moments[event.id] = Moment(*self._latest.get(event.vehicle, (None, None)))


def _wrapped_deg(samples: AttitudeSamples) -> Floats:
    """Roll, pitch and yaw (n, 3) in degrees, roll and yaw within ±180; NaN for what is no number."""
    rpy_rad = attitude.rpy_from_quaternion(samples.q_nb) if samples.rpy_rad is None else samples.rpy_rad
    deg: Floats = np.degrees(np.where(np.isfinite(rpy_rad), rpy_rad, np.nan))
    deg[:, [0, 2]] = (deg[:, [0, 2]] + 180.0) % 360.0 - 180.0
    return deg
